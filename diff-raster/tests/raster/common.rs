//! Scenes for the tests.
#![allow(dead_code, reason = "each test uses what it needs")]

use std::sync::Arc;

use diff_raster::{Faces, Settings};
use ndarray::Array3;
use proptest::prelude::*;

/// Positions `[N, V, 3]`, faces and settings.
#[derive(Clone, Debug)]
pub(crate) struct Scene {
    pub(crate) positions: Array3<f64>,
    pub(crate) faces: Arc<Faces>,
    pub(crate) settings: Settings,
}

/// Random faces between random points, some of them far outside the image, with depths between 1
/// and 4. The points are in general position: no pixel centre lies on an edge.
pub(crate) fn scenes() -> impl Strategy<Value = Scene> {
    let settings = (3_usize..26, 3_usize..26, any::<bool>(), any::<bool>(), any::<bool>())
        .prop_flat_map(|(height, width, published, cull, sharp)| {
            let limit = prop_oneof![Just(None), (0_usize..4).prop_map(Some)];
            (Just((height, width, published, cull, sharp)), limit, 0.02..0.3)
        })
        .prop_map(|((height, width, published, cull_back_faces, sharp), max_faces, box_length)| {
            let base = if published {
                Settings::published(height, width)
            } else {
                Settings::new(height, width)
            };
            let sigma_inv = if sharp { 700.0 } else { 30.0 };
            Settings { cull_back_faces, max_faces, box_length, sigma_inv, ..base }
        });
    (1_usize..3, 3_usize..12, 1_usize..14, settings).prop_flat_map(|(n, v, f, settings)| {
        let coordinate = prop_oneof![4 => -1.0..1.0_f64, 1 => -3.0..3.0];
        let point = (coordinate.clone(), coordinate, 1.0..4.0_f64).prop_map(|(x, y, z)| [x, y, z]);
        let points = prop::collection::vec(point, n * v);
        let corner = 0..v as u32;
        let faces = prop::collection::vec([corner.clone(), corner.clone(), corner], f);
        // The same three points twice are equally near: which is nearer is for rounding to say.
        let faces = faces.prop_map(|faces: Vec<[u32; 3]>| {
            let mut seen = std::collections::BTreeSet::new();
            let sorted = |mut face: [u32; 3]| {
                face.sort_unstable();
                face
            };
            faces.into_iter().filter(|&face| seen.insert(sorted(face))).collect::<Vec<_>>()
        });
        (points, faces).prop_map(move |(points, faces)| Scene {
            positions: Array3::from_shape_vec((n, v, 3), points.concat()).unwrap(),
            faces: Arc::new(Faces::new(v, &faces).unwrap()),
            settings: settings.clone(),
        })
    })
}

/// Fixed weights in `[-1, 1]`, to turn images into numbers.
pub(crate) fn weights(len: usize) -> Vec<f64> {
    (0..len).map(|k| ((k * 7919 + 13) % 1009) as f64 / 504.5 - 1.0).collect()
}

/// This many cases, and no files written about failures.
pub(crate) fn cases(cases: u32) -> ProptestConfig {
    ProptestConfig { cases, failure_persistence: None, ..ProptestConfig::default() }
}
