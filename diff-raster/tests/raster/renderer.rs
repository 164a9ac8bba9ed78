//! Frames of a renderer against the free functions, and what they do to each other: nothing.

use std::sync::Arc;

use crate::common::{Scene, scenes, weights};
use autodiff_lite::{Tape, Var};
use diff_raster::{
    Faces, Renderer, Scratch, Settings, antialiased_silhouette, depth, interpolate,
    interpolate_corners, rasterize, soft_silhouette, texture,
};
use mesh_core::primitives::icosphere;
use ndarray::{Array3, ArrayD, IxDyn, arr3};
use proptest::prelude::*;

fn filled(shape: &[usize]) -> ArrayD<f64> {
    ArrayD::from_shape_vec(IxDyn(shape), weights(shape.iter().product())).unwrap()
}

/// Everything that can be drawn, by a frame or by the free functions.
fn images<'t>(
    scene: &Scene,
    renderer: Option<&Renderer<f64>>,
    [projected, attributes, corners, texels]: [Var<'t, f64>; 4],
) -> [Var<'t, f64>; 6] {
    // Both in the same order, in which gradients are summed.
    if let Some(renderer) = renderer {
        let frame = renderer.frame(projected);
        let uv = frame.interpolate_corners(corners);
        return [
            uv,
            frame.interpolate(attributes),
            frame.soft_silhouette(),
            frame.antialiased_silhouette(),
            frame.depth(0.5),
            frame.texture(uv, texels),
        ];
    }
    let fragments = &rasterize(scene.positions.view(), &scene.faces, &scene.settings);
    let uv = interpolate_corners(projected, corners, fragments);
    [
        uv,
        interpolate(projected, attributes, fragments),
        soft_silhouette(projected, fragments),
        antialiased_silhouette(projected, fragments),
        depth(projected, fragments, 0.5),
        texture(uv, texels, fragments),
    ]
}

/// The bits of all images and of the gradients of their weighted sum.
fn bits(tape: &Tape<f64>, scene: &Scene, renderer: Option<&Renderer<f64>>) -> Vec<u64> {
    let leaves = [
        tape.leaf(scene.positions.clone()),
        tape.leaf(filled(&[scene.faces.vertex_count(), 3])),
        tape.leaf(filled(&[scene.faces.len(), 3, 2])),
        tape.leaf(filled(&[4, 5, 3])),
    ];
    let images = images(scene, renderer, leaves);
    let sums = images.map(|image| image.mul(tape.constant(filled(&image.shape()))).sum());
    let gradients = sums.into_iter().reduce(Var::add).unwrap().backward();
    let gradients = leaves.iter().flat_map(|&leaf| gradients.wrt(leaf).unwrap().to_owned());
    let values = images.iter().flat_map(|image| image.value().to_owned());
    values.chain(gradients).map(f64::to_bits).collect()
}

proptest! {
    #![proptest_config(crate::common::cases(40))]

    /// Whatever the memory held before: other positions, other faces, other sizes.
    #[test]
    fn a_frame_is_what_the_free_functions_draw(scenes in prop::collection::vec(scenes(), 1..5)) {
        let scratch = Scratch::default();
        let mut tape = Tape::train(0);
        for scene in &scenes {
            let renderer = Renderer::new(Arc::clone(&scene.faces), scene.settings.clone());
            let renderer = renderer.with_scratch(&scratch);
            let free = bits(&Tape::train(0), scene, None);
            prop_assert_eq!(bits(&tape, scene, Some(&renderer)), free);
            tape.reset();
        }
    }
}

fn sphere(turn: f64) -> Array3<f64> {
    let mesh = icosphere(2);
    let (sin, cos) = turn.sin_cos();
    Array3::from_shape_fn((1, mesh.positions.len(), 3), |(_, v, k)| {
        let [x, y, z] = mesh.positions[v].map(f64::from);
        let depth = 4.0 - z * cos + x * sin;
        [(x * cos + z * sin) * 3.0 / depth, y * 3.0 / depth, depth][k]
    })
}

fn sphere_renderer() -> Renderer<f64> {
    Renderer::new(Arc::new(Faces::of(&icosphere(2)).unwrap()), Settings::new(40, 40))
}

/// Two frames of one step: the second does not write into the first's memory, nor does a third
/// into fragments that the caller kept.
#[test]
fn what_is_still_held_is_not_overwritten() {
    let renderer = sphere_renderer();
    let drawn = |turn: f64| {
        rasterize(sphere(turn).view(), renderer.faces(), renderer.settings()).as_ref().clone()
    };
    let mut tape = Tape::train(0);
    let first = renderer.frame(tape.leaf(sphere(0.0)));
    let second = renderer.frame(tape.leaf(sphere(0.3)));
    assert_eq!(**first.fragments(), drawn(0.0));
    assert_eq!(**second.fragments(), drawn(0.3));
    assert_ne!(first.fragments(), second.fragments());
    let kept = Arc::clone(first.fragments());
    tape.reset();
    for _ in 0..3 {
        assert_eq!(**renderer.frame(tape.leaf(sphere(0.6))).fragments(), drawn(0.6));
        tape.reset();
    }
    assert_eq!(*kept, drawn(0.0));
}

/// Once a tape was reset, the next frame is drawn into the same memory.
#[test]
fn what_nobody_holds_is_used_again() {
    let renderer = sphere_renderer();
    let mut tape = Tape::train(0);
    let mut place = |turn: f64| {
        let at = {
            let frame = renderer.frame(tape.leaf(sphere(turn)));
            let _ = frame.soft_silhouette();
            frame.fragments().face.as_ptr()
        };
        tape.reset();
        at
    };
    let first = place(0.0);
    assert!([0.1, 0.2].into_iter().all(|turn| place(turn) == first));
}

#[test]
fn threads_share_a_renderer() {
    let renderer = sphere_renderer();
    let draw = |turn: f64| {
        let tape = Tape::train(0);
        let projected = tape.leaf(sphere(turn));
        let mask = renderer.frame(projected).soft_silhouette();
        let gradients = mask.sum().backward();
        (mask.value().to_owned(), gradients.wrt(projected).unwrap().to_owned())
    };
    let turns: [f64; 4] = [0.0, 0.2, 0.4, 0.6];
    let alone = turns.map(draw);
    std::thread::scope(|scope| {
        let threads: Vec<_> = turns
            .map(|turn| scope.spawn(move || (0..20).map(|_| draw(turn)).collect::<Vec<_>>()))
            .into();
        for (thread, alone) in threads.into_iter().zip(&alone) {
            assert!(thread.join().unwrap().iter().all(|drawn| drawn == alone));
        }
    });
}

#[test]
fn fragments_are_plain_values() {
    let faces = |mesh| Arc::new(Faces::of(&mesh).unwrap());
    let settings = Settings::new(24, 24);
    let one = rasterize(sphere(0.0).view(), &faces(icosphere(2)), &settings);
    // Another list of the same faces is as good.
    let same = rasterize(sphere(0.0).view(), &faces(icosphere(2)), &settings);
    let culled = Settings { cull_back_faces: true, ..settings.clone() };
    let other = rasterize(sphere(0.0).view(), &faces(icosphere(2)), &culled);
    assert!(one == same && *one == one.as_ref().clone() && one != other);
    assert_ne!(faces(icosphere(1)), faces(icosphere(2)));
}

#[test]
#[should_panic(expected = "positions of 162 vertices expected")]
fn positions_of_another_mesh_are_refused() {
    let tape = Tape::eval();
    let _ = sphere_renderer().frame(tape.constant(arr3(&[[[0.0, 0.0, 1.0]; 3]])));
}

#[test]
fn images_without_pixels_have_gradients_of_zero() {
    let mesh = mesh_core::primitives::icosphere(0);
    let faces = std::sync::Arc::new(diff_raster::Faces::of(&mesh).expect("faces"));
    for (height, width) in [(64, 0), (0, 64)] {
        let renderer =
            diff_raster::Renderer::new(faces.clone(), diff_raster::Settings::new(height, width));
        let tape = autodiff_lite::Tape::<f32>::train(0);
        let positions = tape.leaf(mesh.vertices().insert_axis(ndarray::Axis(0)).to_owned());
        let loss = renderer.frame(positions).interpolate(positions).sum();
        let gradients = loss.backward();
        assert!(gradients.wrt(positions).is_none_or(|g| g.as_slice().iter().all(|x| *x == 0.0)));
    }
}

#[test]
#[should_panic(expected = "sigma_inv")]
fn a_silhouette_is_a_probability() {
    let mesh = mesh_core::primitives::icosphere(0);
    let settings = diff_raster::Settings { sigma_inv: -7000.0, ..diff_raster::Settings::new(8, 8) };
    let renderer = diff_raster::Renderer::new(
        std::sync::Arc::new(diff_raster::Faces::of(&mesh).expect("faces")),
        settings,
    );
    let tape = autodiff_lite::Tape::<f32>::eval();
    let _ = renderer.frame(tape.constant(mesh.vertices().insert_axis(ndarray::Axis(0)).to_owned()));
}
