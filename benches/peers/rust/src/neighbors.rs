//! Nearest neighbours both ways between 2,466 and 9,000 points of a sphere, trees built each time.

use std::error::Error;
use std::hint::black_box;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use crate::timing::report;

pub fn time() -> Result<(), Box<dyn Error>> {
    let (a, b) = (sphere(2466), sphere(9000));
    report("chamfer/2466x9000/nearest/2t", "kiddo 6.3", || {
        black_box((nearest(&a, &b), nearest(&b, &a)));
    });
    Ok(())
}

fn nearest(from: &[[f32; 3]], to: &[[f32; 3]]) -> Vec<u32> {
    let tree: ImmutableKdTree<f32, 3> =
        ImmutableKdTree::new_from_slice(to).expect("points are finite");
    from.par_iter()
        .map(|point| tree.query(point).nearest_one::<SquaredEuclidean<f32>>().execute().item as u32)
        .collect()
}

/// Points of a spiral around the unit sphere.
fn sphere(count: usize) -> Vec<[f32; 3]> {
    (0..count)
        .map(|k| {
            let height = 1.0 - (2 * k + 1) as f32 / count as f32;
            let (sin, cos) = (2.399_963 * k as f32).sin_cos();
            let radius = (1.0 - height * height).sqrt();
            [radius * cos, radius * sin, height]
        })
        .collect()
}
