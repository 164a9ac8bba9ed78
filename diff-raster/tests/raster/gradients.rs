//! Every operation against central differences, on random scenes, with visibility held fixed.

use std::sync::Arc;

use crate::common::{Scene, scenes};
use autodiff_lite::testkit::{Options, check};
use autodiff_lite::{Real, Tape, Var};
use diff_raster::{
    Fragments, Rule, Settings, antialiased_silhouette, depth, interpolate, interpolate_corners,
    rasterize, soft_silhouette, texture,
};
use ndarray::{ArrayD, IxDyn};
use proptest::prelude::*;

/// Pieces end where a pixel's nearest face, nearest edge or nearest point changes kind.
fn options() -> Options {
    Options { epsilon: 1e-7, tolerance: 3e-5, ..Options::default().pieces() }
}

fn drawn<F: Real>(scene: &Scene, projected: Var<'_, F>) -> Arc<Fragments<F>> {
    let positions = projected.value();
    let positions = positions.view().into_dimensionality().unwrap();
    rasterize(positions, &scene.faces, &scene.settings)
}

/// Differences that move a pixel from one face to another say nothing: leave out scenes where any
/// of them does, by asking whether all faces stay.
fn stays(scene: &Scene, epsilon: f64) -> bool {
    let before = rasterize(scene.positions.view(), &scene.faces, &scene.settings).face.clone();
    (0..scene.positions.len()).all(|k| {
        [epsilon, -epsilon].into_iter().all(|step| {
            let mut moved = scene.positions.clone();
            moved.as_slice_mut().unwrap()[k] += step;
            rasterize(moved.view(), &scene.faces, &scene.settings).face == before
        })
    })
}

/// Lets a closure be one for every tape.
fn rule<C: for<'t> Fn(&[Var<'t, f64>]) -> Var<'t, f64>>(closure: C) -> C {
    closure
}

fn attributes(shape: &[usize], seed: u64) -> ArrayD<f64> {
    Options { seed, ..Options::default() }.draw(&[shape.to_vec()]).remove(0)
}

proptest! {
    #![proptest_config(crate::common::cases(40))]

    #[test]
    fn interpolation(scene in scenes(), channels in 1_usize..7, batched: bool, seed: u64) {
        prop_assume!(stays(&scene, 1e-6));
        let (n, v) = (scene.positions.dim().0, scene.faces.vertex_count());
        let shape = if batched { vec![n, v, channels] } else { vec![v, channels] };
        let perspective = scene.settings.perspective;
        let inputs = [scene.positions.clone().into_dyn(), attributes(&shape, seed)];
        let f = rule(|x| interpolate(x[0], x[1], &drawn(&scene, x[0])));
        // Without perspective no value depends on depth, so one rule serves both.
        prop_assert_eq!(check(&f, &inputs, &options()), Ok(()), "perspective {}", perspective);
    }

    #[test]
    fn interpolation_of_corners(scene in scenes(), channels in 1_usize..6, seed: u64) {
        prop_assume!(stays(&scene, 1e-6));
        let shape = [scene.faces.len(), 3, channels];
        let inputs = [scene.positions.clone().into_dyn(), attributes(&shape, seed)];
        let f = rule(|x| interpolate_corners(x[0], x[1], &drawn(&scene, x[0])));
        prop_assert_eq!(check(&f, &inputs, &options()), Ok(()));
    }

    #[test]
    fn depths(scene in scenes()) {
        prop_assume!(stays(&scene, 1e-6));
        let f = rule(|x| depth(x[0], &drawn(&scene, x[0]), 0.5));
        prop_assert_eq!(check(&f, &[scene.positions.clone().into_dyn()], &options()), Ok(()));
    }

    #[test]
    fn soft_silhouettes(scene in scenes()) {
        // The borders of enlarged boxes are jumps. The published rule is not the gradient near an
        // edge, where it divides by `1 - p + 1e-7`: that is what the twin compares.
        let settings = Settings { box_length: 9.0, rule: Rule::Closed, ..scene.settings.clone() };
        let scene = Scene { settings, ..scene };
        prop_assume!(stays(&scene, 1e-6));
        let f = rule(|x| soft_silhouette(x[0], &drawn(&scene, x[0])));
        prop_assert_eq!(check(&f, &[scene.positions.clone().into_dyn()], &options()), Ok(()));
    }

    #[test]
    fn antialiased_silhouettes(scene in scenes()) {
        prop_assume!(stays(&scene, 1e-6));
        let f = rule(|x| antialiased_silhouette(x[0], &drawn(&scene, x[0])));
        prop_assert_eq!(check(&f, &[scene.positions.clone().into_dyn()], &options()), Ok(()));
    }

    #[test]
    fn textures(scene in scenes(), size in (1_usize..6, 1_usize..6, 1_usize..5), seed: u64) {
        let fragments = rasterize(scene.positions.view(), &scene.faces, &scene.settings);
        let [n, h, w] = fragments.shape();
        // From a little outside of the texture to a little outside.
        let uv = Options { seed, ..Options::default() }.range(-0.1, 1.1).draw(&[vec![n, h, w, 2]]);
        let inputs = [uv[0].clone(), attributes(&[size.0, size.1, size.2], seed)];
        let f = rule(|x| texture(x[0], x[1], &fragments));
        prop_assert_eq!(check(&f, &inputs, &options()), Ok(()));
    }
}

/// A gradient that is wrong must not pass: half of the pixels pull the other way.
#[test]
fn a_broken_rule_is_found() {
    let f = rule(|x| {
        let tape = x[0].tape();
        let doubled = x[0].value().mapv(|x| 2.0 * x);
        tape.record_fn("broken", &[x[0]], doubled, |cx| {
            let g = cx.take_grad_out();
            cx.give(0, g);
        })
    });
    let inputs = [ArrayD::from_elem(IxDyn(&[3]), 0.5)];
    assert!(check(&f, &inputs, &options()).is_err());
    let tape = Tape::<f64>::eval();
    assert_eq!(f(&[tape.constant(inputs[0].clone())]).shape(), [3]);
}
