//! SoftRas's aggregation against its slow twin, central differences, and itself with other threads.

use std::sync::Arc;

use crate::common::{Scene, scenes, weights};
use autodiff_lite::testkit::{Options, check};
use autodiff_lite::{Real, Tape, Var};
use diff_raster::reference::{self, Colored};
use diff_raster::{Faces, Instructions, Paint, SoftRas, SoftRasSettings, softras, texel_centers};
use ndarray::{Array3, ArrayD, IxDyn};
use proptest::prelude::*;

/// Wide clouds and soft depths, so that all terms matter.
fn settings(scene: &Scene, perspective: bool) -> SoftRasSettings {
    let s = &scene.settings;
    SoftRasSettings {
        sigma: 1.0 / s.sigma_inv,
        gamma: 0.1,
        near: 0.5,
        far: 6.0,
        // Black, or a colour behind both channels.
        background_color: if perspective { vec![0.3, -0.8] } else { Vec::new() },
        perspective,
        ..SoftRasSettings::new(s.height, s.width)
    }
}

fn array(shape: &[usize]) -> ArrayD<f64> {
    ArrayD::from_shape_vec(IxDyn(shape), weights(shape.iter().product())).unwrap()
}

/// Vertices with two channels, texels with two in squares of three, or no paint.
fn paint(scene: &Scene, kind: usize) -> Option<ArrayD<f64>> {
    let n = scene.positions.dim().0;
    match kind {
        0 => None,
        1 => Some(array(&[n, scene.faces.vertex_count(), 2])),
        _ => Some(array(&[n, scene.faces.len(), 9, 2])),
    }
}

fn painted<F: Real>(x: Option<Var<'_, F>>) -> Option<Paint<'_, F>> {
    x.map(|x| if x.rank() == 3 { Paint::Vertices(x) } else { Paint::Texels(x) })
}

/// The image and both gradients.
fn draw<F: Real>(scene: &Scene, settings: &SoftRasSettings, kind: usize) -> [Vec<f64>; 3] {
    let renderer = SoftRas::<F>::new(&scene.faces, settings);
    drawn(&renderer, &scene.positions.clone().into_dyn(), paint(scene, kind).as_ref())
}

/// The same of any faces.
fn drawn<F: Real>(
    renderer: &Arc<SoftRas<F>>,
    positions: &ArrayD<f64>,
    paint: Option<&ArrayD<f64>>,
) -> [Vec<f64>; 3] {
    let tape = Tape::<F>::train(0);
    let projected = tape.leaf(positions.mapv(F::from_f64));
    let colors = paint.map(|x| tape.leaf(x.mapv(F::from_f64)));
    let image = softras(projected, painted(colors), renderer);
    let seed = array(&image.shape()).mapv(F::from_f64);
    let gradients = image.backward_with(seed);
    let plain = |x: ArrayD<F>| x.iter().map(|&x| Real::to_f64(x)).collect();
    let of = |x: Var<'_, F>| plain(gradients.wrt(x).unwrap().to_owned());
    [plain(image.value().to_owned()), of(projected), colors.map(of).unwrap_or_default()]
}

proptest! {
    #![proptest_config(crate::common::cases(40))]

    #[test]
    fn the_slow_twin(scene in scenes(), kind in 0_usize..3, perspective: bool) {
        let settings = settings(&scene, perspective);
        let [image, ..] = draw::<f64>(&scene, &settings, kind);
        let channels = if kind == 0 { 0 } else { 2 };
        let all = paint(&scene, kind);
        let pixels = settings.height * settings.width;
        for (n, points) in scene.positions.outer_iter().enumerate() {
            let points: Vec<_> = points.rows().into_iter().map(|p| [p[0], p[1], p[2]]).collect();
            let row = |at: &[usize]| (0..2).map(|c| {
                let at: Vec<_> = [n].into_iter().chain(at.iter().copied()).chain([c]).collect();
                all.as_ref().unwrap()[&at[..]]
            }).collect::<Vec<f64>>();
            let vertices: Vec<_> = (0..if kind == 1 { points.len() } else { 0 }).map(|v| row(&[v])).collect();
            let texels: Vec<Vec<_>> = (0..if kind == 2 { scene.faces.len() } else { 0 })
                .map(|f| (0..9).map(|t| row(&[f, t])).collect())
                .collect();
            let paint = if kind == 2 { Colored::Texels(&texels, 3) } else { Colored::Vertices(&vertices) };
            let slow = reference::softras(&points, scene.faces.corners(), paint, channels, &settings);
            for (pixel, expected) in slow.iter().enumerate() {
                let at = (n * pixels + pixel) * (channels + 1);
                for (found, expected) in image[at..].iter().zip(expected) {
                    prop_assert!((found - expected).abs() < 1e-9, "{found} instead of {expected}");
                }
            }
        }
    }

    #[test]
    fn gradients(scene in scenes(), kind in 0_usize..3, perspective: bool) {
        // Where a face's reach ends is a jump of `least`.
        let settings = SoftRasSettings { least: 1e-12, ..settings(&scene, perspective) };
        let renderer = SoftRas::new(&scene.faces, &settings);
        let mut inputs = vec![scene.positions.clone().into_dyn()];
        inputs.extend(paint(&scene, kind));
        let f = rule(|x: &[Var<'_, f64>]| softras(x[0], painted(x.get(1).copied()), &renderer));
        let options = Options { epsilon: 1e-7, tolerance: 3e-5, ..Options::default().pieces() };
        prop_assert_eq!(check(&f, &inputs, &options), Ok(()), "perspective {} kind {}", perspective, kind);
    }

    #[test]
    fn threads_change_no_bit_and_single_precision_is_near(scene in scenes(), kind in 0_usize..3) {
        let settings = settings(&scene, true);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| draw::<f32>(&scene, &settings, kind))
        };
        let (one, exact) = (run(1), draw::<f64>(&scene, &settings, kind));
        prop_assert_eq!(&one, &run(3));
        let near = one[0].iter().zip(&exact[0]).filter(|(a, b)| (*a - *b).abs() < 1e-3).count();
        // A pixel on an edge or at the end of a reach may fall to either side.
        prop_assert!(near * 100 >= one[0].len() * 97, "{near} of {}", one[0].len());
    }
}

/// Vectors end beyond a face, a row and an image: an image of a width that no vector divides, faces of some
/// pixels and of all, and as many channels as there may be.
#[test]
fn every_instruction_set_draws_the_same() {
    let mesh = mesh_core::primitives::icosphere(2);
    let count = mesh.positions.len();
    let faces = Arc::new(Faces::of(&mesh).unwrap());
    let positions = ArrayD::from_shape_fn(IxDyn(&[2, count, 3]), |at| {
        let [x, y, z] = mesh.positions[at[1]].map(f64::from);
        let depth = 4.0 - if at[0] == 0 { z } else { -y };
        [3.4 * x / depth + 0.0137, 3.4 * (if at[0] == 0 { y } else { z }) / depth - 0.0071, depth]
            [at[2]]
    });
    let paints = [None, Some(array(&[2, count, 5])), Some(array(&[2, faces.len(), 9, 1]))];
    for paint in paints {
        let draw = |instructions| {
            let settings = SoftRasSettings {
                sigma: 1e-3,
                gamma: 1e-2,
                instructions,
                ..SoftRasSettings::new(45, 37)
            };
            drawn::<f32>(&SoftRas::new(&faces, &settings), &positions, paint.as_ref())
        };
        let settings = SoftRasSettings { sigma: 1e-3, gamma: 1e-2, ..SoftRasSettings::new(45, 37) };
        let exact = drawn::<f64>(&SoftRas::new(&faces, &settings), &positions, paint.as_ref());
        for instructions in [Instructions::Best, Instructions::Avx2, Instructions::Scalar] {
            for (what, (found, exact)) in draw(instructions).iter().zip(&exact).enumerate() {
                let norm = exact.iter().map(|x| x * x).sum::<f64>();
                let off = found.iter().zip(exact).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
                assert!(off <= 1e-10 * norm, "{what} by {instructions:?}: {off} of {norm}");
            }
        }
    }
}

/// Lets a closure be one for every tape.
fn rule<C: for<'t> Fn(&[Var<'t, f64>]) -> Var<'t, f64>>(closure: C) -> C {
    closure
}

/// Two squares, the near one smaller.
fn squares() -> (Array3<f64>, Arc<Faces>) {
    let square = |s: f64, z: f64| [[-s, -s, z], [s, -s, z], [s, s, z], [-s, s, z]];
    let all = [square(0.3, 2.0), square(0.7, 3.0)].concat().concat();
    let faces = [[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]];
    let positions = Array3::from_shape_vec((1, 8, 3), all).unwrap();
    (positions, Arc::new(Faces::new(8, &faces).unwrap()))
}

#[test]
fn published_settings_draw_the_nearest_face_and_a_hard_outline() {
    let (positions, faces) = squares();
    let renderer = SoftRas::new(&faces, &SoftRasSettings::published(32, 32));
    let tape = Tape::<f64>::eval();
    // A plain colour of each square, in texels: each face its own.
    let colors =
        ArrayD::from_shape_fn(IxDyn(&[1, 4, 36, 1]), |at| if at[1] < 2 { 0.25 } else { 0.75 });
    let (projected, colors) = (tape.constant(positions), tape.constant(colors));
    let image = softras(projected, Some(Paint::Texels(colors)), &renderer).value();
    for i in 0..32 {
        for j in 0..32 {
            let at = |k: usize| (2.0 * k as f64 - 31.0) / 32.0;
            let far = at(i).abs().max(at(j).abs());
            let (color, alpha) = (image[[0, i, j, 0]], image[[0, i, j, 1]]);
            if far < 0.28 {
                assert!((color - 0.25).abs() < 1e-6, "{color} at {i} {j}");
            } else if (0.33..0.68).contains(&far) {
                assert!((color - 0.75).abs() < 1e-6, "{color} at {i} {j}");
            } else if far > 0.72 {
                assert_eq!((color, alpha), (0.0, 0.0));
            }
            // Along the diagonal two faces meet, each half there: three quarters.
            if far < 0.68 {
                assert!(alpha > 0.74, "{alpha} at {i} {j}");
            }
        }
    }
}

/// What DIB-R does not do: a hidden face has a gradient, and depth has one.
#[test]
fn hidden_faces_and_depths_are_pulled() {
    let (positions, faces) = squares();
    let settings = SoftRasSettings { sigma: 1e-2, gamma: 1e-2, ..SoftRasSettings::new(16, 16) };
    let renderer = SoftRas::new(&faces, &settings);
    let tape = Tape::<f64>::train(0);
    let projected = tape.leaf(positions);
    let colors = ArrayD::from_shape_fn(IxDyn(&[1, 8, 1]), |at| if at[1] < 4 { 0.0 } else { 1.0 });
    let image = softras(projected, Some(Paint::Vertices(tape.constant(colors))), &renderer);
    let gradients = image.slice_axis(3, 0..1).sum().backward();
    let pull = gradients.wrt(projected).unwrap();
    // Brighter: the dark square further away, the bright one nearer.
    assert!((0..4).all(|v| pull[[0, v, 2]] > 0.0) && (4..8).all(|v| pull[[0, v, 2]] < 0.0));
}

#[test]
fn the_middle_of_a_texel_falls_on_it() {
    for side in [1, 2, 3, 6] {
        let faces = Arc::new(Faces::new(3, &[[0, 1, 2]]).unwrap());
        let settings = SoftRasSettings { sigma: 1e-6, ..SoftRasSettings::published(1, 1) };
        let renderer = SoftRas::new(&faces, &settings);
        let tape = Tape::<f64>::eval();
        let colors = ArrayD::from_shape_fn(IxDyn(&[1, 1, side * side, 1]), |at| at[2] as f64);
        let colors = tape.constant(colors);
        for (texel, w) in texel_centers(side).into_iter().enumerate() {
            // The one pixel lies at the origin: put the texel's middle there.
            let corners = [[-0.6, -0.5], [0.8, -0.4], [0.1, 0.9]];
            let at = |axis: usize| (0..3).map(|k| w[k] * corners[k][axis]).sum::<f64>();
            let moved = corners.map(|c| [c[0] - at(0), c[1] - at(1), 2.0]).concat();
            let projected = tape.constant(Array3::from_shape_vec((1, 3, 3), moved).unwrap());
            let image = softras(projected, Some(Paint::Texels(colors)), &renderer).value();
            assert!((image[[0, 0, 0, 0]] - texel as f64).abs() < 1e-9, "{texel} of {side}²");
        }
    }
}

#[test]
fn nothing_to_draw() {
    let faces = Arc::new(Faces::new(3, &[[0, 1, 2]]).unwrap());
    let renderer = SoftRas::new(&faces, &SoftRasSettings::new(3, 4));
    let tape = Tape::<f32>::train(0);
    // Behind the camera, not a number, of no area.
    for z in [[-1.0, 1.0, 1.0], [f32::NAN, 1.0, 1.0], [1.0, 1.0, 1.0]] {
        let at = |k: usize| [0.1 * k as f32, 0.2 * k as f32, z[k]];
        let positions = Array3::from_shape_fn((1, 3, 3), |(_, v, k)| at(v)[k]);
        let projected = tape.leaf(positions);
        let image = softras(projected, None, &renderer);
        assert_eq!((image.value().sum(), image.shape()), (0.0, vec![1, 3, 4, 1]));
        let gradients = image.sum().backward();
        assert!(gradients.wrt(projected).unwrap().iter().all(|&g| g == 0.0));
    }
}
