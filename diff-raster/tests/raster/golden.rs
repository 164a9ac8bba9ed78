//! kaolin's own expected outputs for two tiny scenes, in `dibr_golden/` (Apache-2.0; see the notice there).

use std::path::Path;
use std::sync::Arc;

use autodiff_lite::{Real, Tape};
use diff_raster::{Faces, Fragments, NONE, Settings, rasterize, reference, soft_silhouette};
use ndarray::{Array3, ArrayD, IxDyn};
use ndarray_npy::read_npy;

const HEIGHT: usize = 35;
const WIDTH: usize = 31;
const PARAMETERS: [(f64, f64); 4] = [(7000.0, 0.02), (7000.0, 0.2), (70.0, 0.02), (70.0, 0.2)];

fn golden<T: ndarray_npy::ReadableElement>(name: &str) -> ArrayD<T> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/dibr_golden");
    let path = folder.join(format!("{name}.npy"));
    read_npy(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn named(what: &str, (sigma_inv, box_length): (f64, f64)) -> String {
    format!("{what}_{HEIGHT}_{WIDTH}_{sigma_inv}_{box_length}")
}

/// Two images of three faces that share nothing, so 9 vertices; depth is minus kaolin's `z`.
fn scene() -> (Array3<f64>, Arc<Faces>) {
    let xy: [[[[f64; 2]; 3]; 3]; 2] = [
        [
            [[-0.7, 0.0], [0.0, -0.7], [0.0, 0.7]],
            [[-0.7, 0.0], [0.0, 0.7], [0.0, -0.7]],
            [[0.0, -0.7], [0.0, 0.7], [0.7, 0.0]],
        ],
        [[[-0.7, -0.7], [0.7, -0.7], [-0.7, 0.7]]; 3],
    ];
    let z: [[[f64; 3]; 3]; 2] = [
        [[-2.0, -1.0, -1.0], [-2.5, -3.0, -3.0], [-2.0, -2.0, -2.0]],
        [[-2.0, -1.0, -3.0], [-2.0, -2.0, -2.0], [-2.0, -3.0, -1.0]],
    ];
    let positions = Array3::from_shape_fn((2, 9, 3), |(n, v, k)| match k {
        2 => -z[n][v / 3][v % 3],
        _ => xy[n][v / 3][v % 3][k],
    });
    let faces = Faces::new(9, &[[0, 1, 2], [3, 4, 5], [6, 7, 8]]).unwrap();
    (positions, Arc::new(faces))
}

fn settings((sigma_inv, box_length): (f64, f64)) -> Settings {
    Settings { sigma_inv, box_length, ..Settings::published(HEIGHT, WIDTH) }
}

/// Hard coverage moved left by five pixels.
fn target(face: &[u32]) -> Vec<f64> {
    let covered = |at: usize| at % WIDTH + 5 < WIDTH && face[at + 5] != NONE;
    (0..face.len()).map(|at| f64::from(covered(at))).collect()
}

/// The gradient of `1 - mean_n (Σ ab / (Σ (a + b - ab) + 1e-10))` with respect to `a`.
fn iou_gradient(a: &[f64], b: &[f64]) -> Vec<f64> {
    let pixels = HEIGHT * WIDTH;
    let mut grad = Vec::new();
    for (a, b) in a.chunks(pixels).zip(b.chunks(pixels)) {
        let up: f64 = a.iter().zip(b).map(|(a, b)| a * b).sum();
        let down: f64 = a.iter().zip(b).map(|(a, b)| a + b - a * b).sum::<f64>() + 1e-10;
        grad.extend(b.iter().map(|b| -(b * down - up * (1.0 - b)) / (down * down) / 2.0));
    }
    grad
}

fn same_faces<F: Real>(fragments: &Fragments<F>) {
    let expected: ArrayD<i64> = golden(&format!("new_face_idx_{HEIGHT}_{WIDTH}"));
    for (at, (&face, &expected)) in fragments.face.iter().zip(&expected).enumerate() {
        let face = if face == NONE { -1 } else { i64::from(face) };
        assert_eq!(face, expected, "pixel {at}");
    }
}

fn check<F: Real>(tolerance: f64, of_gradient: f64) {
    for parameters in PARAMETERS {
        let (positions, faces) = scene();
        let positions = positions.mapv(F::from_f64);
        let fragments = rasterize(positions.view(), &faces, &settings(parameters));
        same_faces(&fragments);

        let tape = Tape::<F>::train(0);
        let projected = tape.leaf(positions);
        let soft = soft_silhouette(projected, &fragments);
        let value: Vec<f64> = soft.value().iter().map(|x| Real::to_f64(*x)).collect();
        let expected: ArrayD<f64> = golden(&named("soft_mask", parameters));
        for (at, (value, expected)) in value.iter().zip(&expected).enumerate() {
            assert!((value - expected).abs() <= tolerance, "pixel {at}: {value} {expected}");
        }

        let seed = iou_gradient(&value, &target(&fragments.face));
        let seed = ArrayD::from_shape_vec(IxDyn(&[2, HEIGHT, WIDTH]), seed).unwrap();
        let gradients = soft.backward_with(seed.mapv(F::from_f64));
        let gradient = gradients.wrt(projected).unwrap();
        let expected: ArrayD<f64> = golden(&named("grad_face_vertices_image", parameters));
        let expected = expected.into_shape_with_order((2, 9, 2)).unwrap();
        for ((n, v, k), &expected) in expected.indexed_iter() {
            let value = Real::to_f64(gradient[[n, v, k]]);
            let scale = expected.abs().max(1.0);
            assert!(
                (value - expected).abs() <= of_gradient * scale,
                "{parameters:?} {n} {v} {k}: {value} {expected}"
            );
        }
    }
}

#[test]
fn production_in_double_precision() {
    check::<f64>(1e-12, 1e-6);
}

#[test]
fn production_in_single_precision() {
    check::<f32>(1e-4, 1e-3);
}

/// The lists per pixel that only the twin keeps: face index, kind of the nearest part, probability.
#[test]
fn the_slow_twin_keeps_the_same_lists() {
    let (positions, faces) = scene();
    for parameters in PARAMETERS {
        let settings = settings(parameters);
        let indices: ArrayD<i32> = golden(&named("close_face_idx", parameters));
        let kinds: ArrayD<u8> = golden(&named("close_face_dist_type", parameters));
        let probabilities: ArrayD<f64> = golden(&named("close_face_prob", parameters));
        let masks: ArrayD<f64> = golden(&named("soft_mask", parameters));
        let gradients: ArrayD<f64> = golden(&named("grad_face_vertices_image", parameters));
        let gradients = gradients.into_shape_with_order((2, 9, 2)).unwrap();
        let all: ArrayD<i64> = golden(&format!("new_face_idx_{HEIGHT}_{WIDTH}"));
        let mut soft = Vec::new();
        let mut face = Vec::new();
        let points: Vec<Vec<[f64; 3]>> = positions
            .outer_iter()
            .map(|p| p.rows().into_iter().map(|p| [p[0], p[1], p[2]]).collect())
            .collect();
        for points in &points {
            let image = reference::rasterize(points, faces.corners(), &settings);
            soft.push(reference::soft_silhouette(points, faces.corners(), &settings, &image));
            face.extend(image.face);
        }
        let values: Vec<f64> = soft.iter().flat_map(|soft| soft.value.clone()).collect();
        let lists: Vec<_> = soft.iter().flat_map(|soft| soft.lists.clone()).collect();
        for (pixel, list) in lists.iter().enumerate() {
            let shown = if face[pixel] == NONE { -1 } else { i64::from(face[pixel]) };
            assert_eq!(shown, all.as_slice().unwrap()[pixel]);
            assert!((values[pixel] - masks.as_slice().unwrap()[pixel]).abs() < 1e-12);
            for k in 0..3 {
                let at = 3 * pixel + k;
                let near = list.get(k);
                let index = near.map_or(-1, |near| near.face as i32);
                assert_eq!(index, indices.as_slice().unwrap()[at], "pixel {pixel}");
                let kind = near.map_or(0, |near| near.kind);
                assert_eq!(kind, kinds.as_slice().unwrap()[at], "pixel {pixel}");
                let probability = near.map_or(0.0, |near| near.probability);
                assert!((probability - probabilities.as_slice().unwrap()[at]).abs() < 1e-12);
            }
        }
        let seed = iou_gradient(&values, &target(&face));
        for (n, points) in points.iter().enumerate() {
            let seed = &seed[n * HEIGHT * WIDTH..(n + 1) * HEIGHT * WIDTH];
            let corners = faces.corners();
            let gradient =
                reference::soft_silhouette_grad(points, corners, &settings, &soft[n], seed);
            for (v, gradient) in gradient.iter().enumerate() {
                for k in 0..2 {
                    let expected = gradients[[n, v, k]];
                    assert!((gradient[k] - expected).abs() < 1e-6 * expected.abs().max(1.0));
                }
            }
        }
    }
}
