//! What learns nothing, from the same views: the nearest training view's object, the visual hull, `fit`.

use datasets::{View, Views};
use mesh_core::{Camera, EmptyGrid, TriMesh, VoxelGrid, cubify};
use models::img2mesh::{Data, Group, Img2MeshConfig, evaluate_meshes};
use recon::fit::{FitConfig, fit};
use train::{DataError, Metric, Subset};

use crate::nearest::{Nearest, features};
use crate::progress::Watch;

/// Cells of a hull along each side.
const CELLS: usize = 64;
/// How much wider than the frame of the training's objects the volume is that is carved: what bounds the cone of one view.
const ROOM: f64 = 1.3;
/// Side of the images that views are compared by.
const SIDE: usize = 64;

/// One of them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Control {
    Retrieval,
    Hull,
    Fit,
}

impl Control {
    /// All, with their jobs, the labels of their rows, and how many views each is given.
    pub(super) const ALL: [(Self, &'static str, &'static str, &'static [usize]); 3] = [
        (Self::Retrieval, "retrieval", "the nearest training view's object", &[1]),
        (Self::Hull, "hull", "visual hull", &[1, 2, 3, 5]),
        (Self::Fit, "fit", "fit", &[2, 5]),
    ];

    /// Scores of what it makes of so many views.
    pub(super) fn scored(
        self,
        data: &Data,
        config: &Img2MeshConfig,
        views: usize,
    ) -> Result<Vec<Metric>, DataError> {
        let known = if self == Self::Retrieval { training(data)? } else { Nearest::default() };
        let frame = data.frame(config)?;
        let of = |group: &Group| match self {
            Self::Retrieval => retrieved(&known, data, group),
            Self::Hull => Ok(hull(group, frame)),
            Self::Fit => Ok(fitted(group)),
        };
        evaluate_meshes(data, config, (Subset::Test, views), of)
    }
}

/// Every view of the objects that are trained on.
fn training(data: &Data) -> Result<Nearest<[usize; 2]>, DataError> {
    let mut known = Nearest::default();
    for object in 0..data.listed(Subset::Train).len() {
        for (k, view) in all_views(data, object)?.iter().enumerate() {
            known.add(seen(view), [object, k]);
        }
    }
    Ok(known)
}

/// Of the `object`-th that is trained on.
fn all_views(data: &Data, object: usize) -> Result<Vec<View>, DataError> {
    Ok(data.group((Subset::Train, usize::MAX), object)?.given)
}

fn seen(view: &View) -> Vec<f32> {
    let color = view.over([0; 3]).resized(SIDE, SIDE);
    features(&color.data, &view.mask.resized(SIDE, SIDE).data)
}

/// The object of the nearest view, standing before the first camera as it stood before its own.
fn retrieved(
    known: &Nearest<[usize; 2]>,
    data: &Data,
    group: &Group,
) -> Result<TriMesh, DataError> {
    let [object, view] =
        known.find(&seen(&group.given[0])).expect("objects to train on have views");
    let other = data.group((Subset::Train, usize::MAX), object)?;
    let Some(mesh) = other.truth else { return Ok(TriMesh::default()) };
    let (from, to) = (&other.given[view].camera, &group.given[0].camera);
    Ok(mesh.map_positions(|p| moved(from, to, p)))
}

/// A point before one camera, before another.
fn moved(from: &Camera, to: &Camera, p: [f32; 3]) -> [f32; 3] {
    let mut point = from.translation;
    point.copy_from_slice(&p.map(f64::from));
    let p = from.rotation * point + from.translation;
    let p = to.rotation.transpose() * (p - to.translation);
    [p.x as f32, p.y as f32, p.z as f32]
}

/// What all masks allow, in cells, of the mean colour of the object in the views; about the middle of the training's objects.
fn hull(group: &Group, frame: [f64; 4]) -> TriMesh {
    let views: Vec<&View> = group.given.iter().collect();
    let bound = |sign: f64| [0, 1, 2].map(|k| (frame[k] + sign * ROOM * frame[3]) as f32);
    let mut grid = VoxelGrid::new([CELLS; 3], (bound(-1.0), bound(1.0)));
    for z in 0..CELLS {
        for y in 0..CELLS {
            for x in 0..CELLS {
                let p = grid.center([x, y, z]).map(f64::from);
                if views.iter().all(|view| covers(view, p)) {
                    let at = grid.index([x, y, z]);
                    grid.bits[at] = true;
                }
            }
        }
    }
    let mut mesh = cubify(&grid, EmptyGrid::Nothing);
    mesh.colors = Some(vec![mean_color(&views); mesh.positions.len()]);
    mesh
}

/// Whether the mask has the object where a point is seen.
fn covers(view: &View, p: [f64; 3]) -> bool {
    let seen = view.camera.project(p);
    let (row, column) = (seen.row.floor(), seen.column.floor());
    let (height, width) = (view.mask.height, view.mask.width);
    let inside = seen.depth > 0.0 && row >= 0.0 && column >= 0.0;
    inside
        && (row as usize) < height
        && (column as usize) < width
        && view.mask.data[row as usize * width + column as usize] != 0
}

/// Of the object in all views, in `[0, 1]`.
fn mean_color(views: &[&View]) -> [f32; 3] {
    let (mut sums, mut all) = ([0.0_f64; 3], 0.0);
    for view in views {
        let colors = view.color.data.as_chunks::<3>().0;
        for (color, _) in colors.iter().zip(&view.mask.data).filter(|(_, m)| **m != 0) {
            all += 1.0;
            (0..3).for_each(|k| sums[k] += f64::from(color[k]) / 255.0);
        }
    }
    sums.map(|sum| if all > 0.0 { (sum / all) as f32 } else { 0.5 })
}

/// `fit`, on what is given alone. Where it refuses there is no mesh.
fn fitted(group: &Group) -> TriMesh {
    let config = FitConfig { hold_out: None, level: 4, ..FitConfig::default() };
    let views = Views::in_memory(group.given.clone());
    let fitted = fit(&views, &config, &mut Watch::default());
    fitted.map(|fitted| fitted.mesh).unwrap_or_default()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::preset::preset;
    use models::img2mesh::Img2Mesh;

    /// Of objects that stand where they are seen, what is made of five views is better than what is made of one.
    #[test]
    fn controls_are_scored_as_models_are() {
        let small = [
            ("objects", "3"),
            ("test-objects", "2"),
            ("placed", "0"),
            ("image-size", "48"),
            ("render-size", "48"),
            ("families", r#"["car"]"#),
        ];
        let config = preset::<Img2Mesh>("unseen", &small).system;
        let data = Data::synthetic(&config).unwrap();
        let of = |control: Control, views: usize, name: &str| {
            let metrics = control.scored(&data, &config, views).unwrap();
            metrics.iter().find(|metric| metric.name == name).unwrap().value
        };
        let hull = |views: usize| of(Control::Hull, views, "mask-iou");
        assert!(hull(5) > 0.75 && hull(5) > hull(1) + 0.05, "{} {}", hull(1), hull(5));
        assert!(of(Control::Hull, 5, "chamfer") < of(Control::Hull, 1, "chamfer"));
        let fitted = of(Control::Fit, 5, "mask-iou");
        assert!(fitted > 0.8, "{fitted}");
        let retrieved = of(Control::Retrieval, 1, "mask-iou");
        assert!((0.4..0.99).contains(&retrieved), "{retrieved}");
        assert!(of(Control::Retrieval, 1, "chamfer") < 0.1);
    }

    #[test]
    fn a_camera_takes_its_object_along() {
        let camera = |eye| Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.8, 8, 8);
        let (from, to) = (camera([2.0, 0.5, 1.0]), camera([-1.0, 1.0, 2.0]));
        let p = [0.3, -0.2, 0.1];
        let (a, b) =
            (from.project(p), to.project(moved(&from, &to, p.map(|x| x as f32)).map(f64::from)));
        assert!((a.row - b.row).abs() < 1e-5 && (a.depth - b.depth).abs() < 1e-6);
    }
}
