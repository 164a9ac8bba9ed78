//! The same twelve test objects for every row, from three sides, beside the truth.

use mesh_core::ByteImage;
use models::{MeshPair, MeshPairs};
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;
use recon::turntable::orbit;
use synth::{RenderOptions, render_view};
use train::DataError;

/// Objects that are shown.
pub(crate) const SHOWN: usize = 12;
/// Sides of each.
const SIDES: usize = 3;
/// Side of one image, pixels.
const SIDE: usize = 96;
/// How far the cameras look down, radians.
const ELEVATION: f64 = 0.35;

/// Which objects are shown: drawn by the seed, so that nobody picks, the same for every row of a seed.
pub fn drawn(names: &[String], seed: u64) -> Vec<String> {
    let mut all = names.to_vec();
    all.sort();
    all.dedup();
    all.shuffle(&mut ChaCha8Rng::seed_from_u64(seed));
    all.truncate(SHOWN);
    all.sort();
    all
}

/// A system's predictions for the objects that are shown.
///
/// # Errors
/// If a file cannot be read.
pub(crate) fn predicted<S: MeshPairs>(
    system: &S,
    data: &S::Data,
    seed: u64,
) -> Result<Vec<MeshPair>, DataError> {
    let names = drawn(&system.scored_objects(data), seed);
    let pairs = names.iter().map(|name| system.mesh_pair(data, name));
    Ok(pairs.collect::<Result<Vec<_>, _>>()?.into_iter().flatten().collect())
}

/// Predictions and truths, an object a column, a side a row; both from the same cameras, which the truth decides.
pub(crate) fn sheets(objects: &[MeshPair]) -> Option<[ByteImage; 2]> {
    if objects.is_empty() {
        return None;
    }
    let options = RenderOptions::studio();
    let mut sheets = [(); 2].map(|()| blank(SIDES * SIDE, objects.len() * SIDE));
    for (column, object) in objects.iter().enumerate() {
        let Some(bounds) = object.truth.bounds() else { continue };
        for (row, camera) in orbit(bounds, SIDES, ELEVATION, SIDE).iter().enumerate() {
            for (sheet, mesh) in sheets.iter_mut().zip([object.mesh.as_ref(), Some(&object.truth)])
            {
                let view = mesh.and_then(|mesh| render_view(mesh, camera, &options).ok());
                if let Some(view) = view {
                    sheet.paste(&view.color, [row * SIDE, column * SIDE]);
                }
            }
        }
    }
    Some(sheets)
}

fn blank(height: usize, width: usize) -> ByteImage {
    ByteImage { height, width, channels: 3, data: vec![255; 3 * height * width] }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::TriMesh;
    use mesh_core::bounds::longest_side;
    use mesh_core::primitives::icosphere;

    use super::*;

    #[test]
    fn the_same_objects_are_drawn_for_every_row() {
        let names: Vec<String> = (0..40).map(|k| format!("car/{k}")).collect();
        let mut other = names.clone();
        other.reverse();
        assert_eq!(drawn(&names, 3), drawn(&other, 3));
        assert_ne!(drawn(&names, 3), drawn(&names, 4));
        assert_eq!((drawn(&names, 3).len(), drawn(&names[..5], 3).len()), (SHOWN, 5));
    }

    #[test]
    fn a_prediction_and_its_truth_are_seen_alike() {
        let ball = icosphere(2);
        let (small, none) = (ball.clone().scaled([0.5; 3]), TriMesh::new(vec![], vec![]));
        let object = |mesh: Option<&TriMesh>| MeshPair {
            name: "ball".into(),
            mesh: mesh.cloned(),
            truth: ball.clone(),
        };
        let all = [object(Some(&ball)), object(Some(&small)), object(None), object(Some(&none))];
        let [own, truth] = sheets(&all).unwrap();
        assert_eq!((own.height, own.width), (SIDES * SIDE, all.len() * SIDE));
        let dark = |sheet: &ByteImage, column: usize| {
            let within = |k: &usize| k % sheet.width / SIDE == column;
            let pixels = 0..sheet.width * sheet.height;
            pixels.filter(within).filter(|k| sheet.data[3 * k] < 250).count()
        };
        assert_eq!(dark(&own, 0), dark(&truth, 0));
        assert!(dark(&own, 1) > 0 && 3 * dark(&own, 1) < dark(&truth, 1));
        assert_eq!((dark(&own, 2), dark(&own, 3)), (0, 0));
        assert!(sheets(&[]).is_none());
    }

    /// The mean of the vertices.
    fn middle(mesh: &TriMesh) -> [f32; 3] {
        let n = mesh.positions.len() as f32;
        std::array::from_fn(|k| mesh.positions.iter().map(|v| v[k]).sum::<f32>() / n)
    }

    /// Predictions are in the frame of the truth: even one that was not trained stands where the object is,
    /// nearer than `most` of its own length.
    fn stands_where_the_truth_does<S: MeshPairs<ReadOptions = datasets::ReadOptions>>(
        preset: &str,
        changes: &[(&'static str, &'static str)],
        most: f32,
    ) {
        let config = crate::preset::preset::<S>(preset, changes);
        let options = datasets::ReadOptions::default();
        let source = train::Source { path: None, options: &options, seed: 0, progress: &|_, _| () };
        let data = S::open(&config.system, &source).unwrap();
        let mut system = S::new(&config.system, 0);
        system.init_from_data(&data, None).unwrap();
        let pairs = predicted(&system, &data, 0).unwrap();
        assert!(!pairs.is_empty() && pairs.len() <= SHOWN);
        for pair in pairs {
            let longest = longest_side(pair.truth.bounds().unwrap());
            let (truth, own) = (middle(&pair.truth), middle(&pair.mesh.unwrap()));
            for k in 0..3 {
                let away = (truth[k] - own[k]).abs() / longest;
                assert!(away < most, "{} {}: {away}", S::NAME, pair.name);
            }
        }
        assert!(system.mesh_pair(&data, "no/such object").unwrap().is_none());
    }

    #[test]
    fn predictions_are_in_the_frame_of_the_truth() {
        let small = [
            ("image-size", "32"),
            ("objects", "2"),
            ("test-objects", "2"),
            ("synthetic-views", "4"),
            ("families", "[\"car\"]"),
        ];
        let with = |more: &[(&'static str, &'static str)]| [&small, more].concat();
        stands_where_the_truth_does::<models::pixel2mesh::OdePixel2Mesh>("table", &with(&[]), 0.3);
        // Three stages that were not trained drift by about the length of a car from where they start.
        let three = with(&[]);
        stands_where_the_truth_does::<models::depth::DepthPixel2Mesh>("table", &three, 1.5);
        stands_where_the_truth_does::<models::img2mesh::Img2Mesh>(
            "unseen",
            &with(&[("render-size", "32"), ("placed", "0"), ("views", "2")]),
            0.3,
        );
    }
}
