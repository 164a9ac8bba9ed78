//! The production kernels against the slow twin, and against themselves with other instructions,
//! precision and thread counts.

use std::sync::Arc;

use crate::common::{Scene, scenes, weights};
use autodiff_lite::{Real, Tape};
use diff_raster::{
    Fragments, Instructions, NONE, Settings, antialiased_silhouette, depth, interpolate, rasterize,
    reference, soft_silhouette, texture,
};
use ndarray::{Array2, ArrayD, IxDyn};
use proptest::prelude::*;

const CHANNELS: usize = 3;

/// Everything that an image gives, and all gradients.
struct Drawn<F: Real> {
    fragments: Arc<Fragments<F>>,
    soft: Vec<f64>,
    of_soft: Vec<f64>,
    color: Vec<f64>,
    of_color: Vec<f64>,
    of_attributes: Vec<f64>,
    others: Vec<f64>,
}

fn plain<F: Real>(x: impl IntoIterator<Item = F>) -> Vec<f64> {
    x.into_iter().map(Real::to_f64).collect()
}

fn attributes(vertices: usize) -> Array2<f64> {
    Array2::from_shape_vec((vertices, CHANNELS), weights(vertices * CHANNELS)).unwrap()
}

fn draw<F: Real>(scene: &Scene, settings: &Settings) -> Drawn<F> {
    let positions = scene.positions.mapv(F::from_f64);
    let fragments = rasterize(positions.view(), &scene.faces, settings);
    let tape = Tape::<F>::train(0);
    let projected = tape.leaf(positions);
    let seed = |shape: &[usize]| {
        let values = weights(shape.iter().product()).into_iter().map(F::from_f64).collect();
        ArrayD::from_shape_vec(IxDyn(shape), values).unwrap()
    };
    let gradient = |value: autodiff_lite::Var<'_, F>, of: autodiff_lite::Var<'_, F>| {
        let gradients = value.backward_with(seed(&value.shape()));
        plain(gradients.wrt(of).unwrap().iter().copied())
    };
    let soft = soft_silhouette(projected, &fragments);
    let values = tape.leaf(attributes(scene.faces.vertex_count()).mapv(F::from_f64));
    let color = interpolate(projected, values, &fragments);
    let border = antialiased_silhouette(projected, &fragments);
    let depths = depth(projected, &fragments, F::zero());
    let uv = interpolate(projected, values.slice_axis(1, 0..2), &fragments);
    let texels = tape.leaf(seed(&[5, 4, 3]));
    let texture = texture(uv, texels, &fragments);
    let mut others = gradient(border, projected);
    others.extend(gradient(depths, projected));
    others.extend(gradient(texture, projected));
    others.extend(gradient(texture, texels));
    for image in [border, depths, texture] {
        others.extend(plain(image.value().iter().copied()));
    }
    Drawn {
        soft: plain(soft.value().iter().copied()),
        of_soft: gradient(soft, projected),
        color: plain(color.value().iter().copied()),
        of_color: gradient(color, projected),
        of_attributes: gradient(color, values),
        others,
        fragments,
    }
}

/// The largest difference, relative to the largest number.
fn difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let scale = a.iter().fold(1.0_f64, |scale, x| scale.max(x.abs()));
    let differences = a.iter().zip(b).map(|(a, b)| if a == b { 0.0 } else { (a - b).abs() });
    differences.fold(0.0, f64::max) / scale
}

fn matches_the_twin(scene: &Scene) -> Result<(), TestCaseError> {
    let settings = &scene.settings;
    let drawn = draw::<f64>(scene, settings);
    let (faces, vertices) = (scene.faces.corners(), scene.faces.vertex_count());
    let pixels = settings.pixels();
    let values = attributes(vertices).into_raw_vec_and_offset().0;
    let mut of_attributes = vec![0.0; values.len()];
    let batch = scene.positions.dim().0;
    let (soft_weights, color_weights) =
        (weights(batch * pixels), weights(batch * pixels * CHANNELS));
    for n in 0..batch {
        let points: Vec<[f64; 3]> =
            (0..vertices).map(|v| [0, 1, 2].map(|k| scene.positions[[n, v, k]])).collect();
        let range = n * pixels..(n + 1) * pixels;
        let wide = n * pixels * CHANNELS..(n + 1) * pixels * CHANNELS;
        let image = reference::rasterize(&points, faces, settings);
        prop_assert_eq!(&drawn.fragments.face[range.clone()], &image.face[..]);
        let depths = &drawn.fragments.depth[range.clone()];
        prop_assert!(difference(depths, &image.depth) < 1e-9);
        let weights = &drawn.fragments.barycentric[3 * range.start..3 * range.end];
        prop_assert!(difference(weights, image.barycentric.as_flattened()) < 1e-6);

        let soft = reference::soft_silhouette(&points, faces, settings, &image);
        prop_assert!(difference(&drawn.soft[range.clone()], &soft.value) < 1e-7);
        let grad = &soft_weights[range];
        let expected = reference::soft_silhouette_grad(&points, faces, settings, &soft, grad);
        let flat = |k: usize, of: &[f64]| {
            (0..vertices).map(|v| of[3 * (n * vertices + v) + k]).collect::<Vec<_>>()
        };
        for k in 0..2 {
            let expected: Vec<f64> = expected.iter().map(|g| g[k]).collect();
            prop_assert!(difference(&flat(k, &drawn.of_soft), &expected) < 1e-5);
        }

        let color = reference::interpolate(faces, &image, &values, CHANNELS);
        prop_assert!(difference(&drawn.color[wide.clone()], &color) < 1e-6);
        let (of_values, of_points) = reference::interpolate_grad(
            &points,
            faces,
            settings,
            &image,
            (&values, CHANNELS),
            &color_weights[wide],
        );
        of_attributes.iter_mut().zip(of_values).for_each(|(sum, x)| *sum += x);
        for k in 0..3 {
            let expected: Vec<f64> = of_points.iter().map(|g| g[k]).collect();
            prop_assert!(difference(&flat(k, &drawn.of_color), &expected) < 1e-6);
        }
    }
    prop_assert!(difference(&drawn.of_attributes, &of_attributes) < 1e-6);
    Ok(())
}

/// Whether some face changes when everything moves by what `f32` rounds.
fn close_call(scene: &Scene) -> bool {
    let draw = |by: f64| {
        let moved = scene.positions.mapv(|x| x * (1.0 + by) + by);
        rasterize(moved.view(), &scene.faces, &scene.settings).face.clone()
    };
    let before = draw(0.0);
    [1e-5, -1e-5].into_iter().any(|by| draw(by) != before)
}

proptest! {
    #![proptest_config(crate::common::cases(200))]

    #[test]
    fn production_equals_the_twin(scene in scenes()) {
        matches_the_twin(&scene)?;
    }

    /// Corners on pixel centres and half-way between them, on images of 8 x 16: all products are
    /// exact, so that the rules on borders show.
    #[test]
    fn production_equals_the_twin_on_borders(
        scene in scenes(),
        snapped in prop::collection::vec((-9..10_i32, -17..18_i32, 1..4_i32), 24),
    ) {
        let mut positions = scene.positions.clone();
        for (mut p, &(y, x, z)) in positions.rows_mut().into_iter().zip(&snapped) {
            p[0] = f64::from(x) / 16.0;
            p[1] = f64::from(y) / 8.0;
            p[2] = f64::from(z);
        }
        let settings = Settings { height: 8, width: 16, ..scene.settings.clone() };
        let scene = Scene { positions, settings, ..scene };
        let drawn = rasterize(scene.positions.view(), &scene.faces, &scene.settings);
        let vertices = scene.faces.vertex_count();
        for n in 0..scene.positions.dim().0 {
            let points: Vec<[f64; 3]> =
                (0..vertices).map(|v| [0, 1, 2].map(|k| scene.positions[[n, v, k]])).collect();
            let image = reference::rasterize(&points, scene.faces.corners(), &scene.settings);
            let covered = |face: &[u32]| face.iter().map(|&f| f == NONE).collect::<Vec<_>>();
            prop_assert_eq!(
                covered(&drawn.face[128 * n..128 * (n + 1)]),
                covered(&image.face)
            );
        }
    }

    #[test]
    fn all_instructions_and_precisions_agree(scene in scenes()) {
        let exact = draw::<f64>(&scene, &scene.settings);
        for instructions in [Instructions::Best, Instructions::Avx2, Instructions::Scalar] {
            let settings = Settings { instructions, ..scene.settings.clone() };
            let drawn = draw::<f32>(&scene, &settings);
            // A pixel centre may be within rounding of an edge.
            let differ = drawn.fragments.face.iter().zip(&exact.fragments.face);
            if differ.filter(|(a, b)| a != b).count() > 0 {
                prop_assert!(close_call(&scene));
                continue;
            }
            prop_assert!(difference(&exact.soft, &drawn.soft) < 1e-4);
            prop_assert!(difference(&exact.of_soft, &drawn.of_soft) < 1e-3);
            prop_assert!(difference(&exact.color, &drawn.color) < 1e-3);
        }
    }

    #[test]
    fn any_number_of_threads_gives_the_same_bits(scene in scenes()) {
        let run = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let drawn = draw::<f32>(&scene, &scene.settings);
                let numbers = [
                    drawn.soft, drawn.of_soft, drawn.color, drawn.of_color,
                    drawn.of_attributes, drawn.others,
                ];
                (drawn.fragments.face.clone(), numbers.concat().iter().map(|x| x.to_bits()).collect::<Vec<_>>())
            })
        };
        let one = run(1);
        prop_assert_eq!(&one, &run(2));
        prop_assert_eq!(&one, &run(3));
    }
}
