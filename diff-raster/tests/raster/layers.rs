//! Several faces a pixel: against PyTorch3D's formulas (`fixtures/peers.py`), finite differences, and itself with other
//! threads.

use std::sync::Arc;

use crate::common::{Scene, scenes, weights};
use autodiff_lite::testkit::{Options, check};
use autodiff_lite::{Tape, Tensor, Var};
use diff_raster::{BlendSettings, Faces, LayerSettings, Layers, NONE, rasterize_layers};
use mesh_core::{Camera, primitives};
use ndarray::{ArrayD, IxDyn};
use proptest::prelude::*;
use serde_json::Value;

struct Peers(Value);

impl Peers {
    fn read() -> Self {
        Self(serde_json::from_str(include_str!("../fixtures/peers.json")).unwrap())
    }

    fn array(&self, name: &str) -> ArrayD<f64> {
        let list = |key: &str| self.0[name][key].as_array().unwrap();
        let shape: Vec<usize> =
            list("shape").iter().map(|n| n.as_u64().unwrap() as usize).collect();
        let data = list("data").iter().map(|x| x.as_f64().unwrap()).collect();
        ArrayD::from_shape_vec(IxDyn(&shape), data).unwrap()
    }

    fn near(&self, name: &str, found: &Tensor<f64>) {
        let expected = self.array(name);
        assert_eq!(found.len(), expected.len(), "{name}");
        for (found, expected) in found.iter().zip(&expected) {
            let size = expected.abs().max(1.0);
            assert!(
                (found - expected).abs() < 1e-9 * size,
                "{name}: {found} instead of {expected}"
            );
        }
    }
}

/// cos(index), as the script weighs.
fn weighed(x: Var<'_, f64>) -> Var<'_, f64> {
    let mut i = -1.0;
    let weights = ArrayD::from_shape_simple_fn(IxDyn(&x.shape()), || {
        i += 1.0;
        f64::cos(i)
    });
    x.mul(x.tape().constant(weights)).sum()
}

#[test]
fn fragments_and_blends_are_those_of_pytorch3d() {
    let peers = Peers::read();
    let corners: Vec<u32> = peers.array("faces").iter().map(|&i| i as u32).collect();
    let faces = Arc::new(Faces::new(9, corners.as_chunks().0).unwrap());
    let settings = LayerSettings { blur_radius: 0.06, ..LayerSettings::new(7, 7, 3) };
    let tape = Tape::<f64>::train(0);
    let (verts, colors) = (tape.leaf(peers.array("verts")), tape.leaf(peers.array("colors")));
    let layers = Layers::new(verts, &faces, &settings);
    let expected = peers.array("face").mapv(|i| if i < 0.0 { NONE } else { i as u32 });
    assert_eq!(layers.fragments().face, expected.into_raw_vec_and_offset().0);
    let gradient_of = |name: &str, x: Var<'_, f64>, both: bool| {
        peers.near(name, &x.value());
        let gradients = weighed(x).backward();
        peers.near(&format!("{name}.grad.verts"), gradients.wrt(verts).unwrap());
        if both {
            peers.near(&format!("{name}.grad.colors"), gradients.wrt(colors).unwrap());
        }
    };
    gradient_of("zbuf", layers.depth(), false);
    gradient_of("bary", layers.barycentric(), false);
    gradient_of("dists", layers.distance(), false);
    gradient_of("alpha", layers.alpha(0.03), false);
    let texels = layers.interpolate(colors);
    peers.near("texels", &texels.value());
    for (name, gamma, far) in [("soft", 0.3, 100.0), ("hard", 0.02, 5.0)] {
        let background = vec![0.2, 1.0, 0.6];
        let blend = BlendSettings { sigma: 0.05, gamma, background, near: 1.0, far };
        gradient_of(name, layers.softmax_blend(texels, &blend), true);
    }
}

/// As in the scene, with any of the options.
fn settings(scene: &Scene, [perspective, clip_barycentric, blurred]: [bool; 3]) -> LayerSettings {
    let s = &scene.settings;
    LayerSettings {
        perspective,
        clip_barycentric,
        cull_back_faces: s.cull_back_faces,
        blur_radius: if blurred { 0.05 } else { 0.0 },
        ..LayerSettings::new(s.height, s.width, 3)
    }
}

proptest! {
    #![proptest_config(crate::common::cases(24))]

    #[test]
    fn gradients(scene in scenes(), perspective: bool, clip: bool, blurred: bool) {
        let settings = settings(&scene, [perspective, clip, blurred]);
        // Visibility is held fixed, so that differences are of smooth functions.
        let fragments = rasterize_layers(&scene.positions, &scene.faces, &settings);
        prop_assume!(fragments.face.iter().any(|&face| face != NONE));
        let colors = [scene.faces.vertex_count(), 2];
        let colors = ArrayD::from_shape_vec(IxDyn(&colors), weights(colors.iter().product())).unwrap();
        let inputs = [scene.positions.clone().into_dyn(), colors];
        let blend = BlendSettings { sigma: 0.05, gamma: 0.2, background: vec![0.1, 0.7], near: 0.5, far: 6.0 };
        let vertices = scene.faces.vertex_count();
        let f = rule(|x: &[Var<'_, f64>]| {
            let layers = Layers::of(x[0], &fragments);
            let image = layers.softmax_blend(layers.interpolate(x[1]), &blend);
            // Without a background's channels there is coverage alone.
            let colorless = x[1].tape().constant(ArrayD::zeros(IxDyn(&[vertices, 0])));
            let coverage = BlendSettings { background: Vec::new(), ..blend.clone() };
            let coverage = layers.softmax_blend(layers.interpolate(colorless), &coverage);
            image.sum().add(weighed(coverage)).add(weighed(layers.depth())).add(weighed(layers.distance()).scale(0.3))
                .add(weighed(layers.alpha(0.04)))
        });
        let options = Options { epsilon: 1e-7, tolerance: 3e-5, ..Options::default().pieces() };
        // Of slivers the coordinates run off faster than differences can follow.
        let slivers = fragments.barycentric.iter().any(|w| w.abs() > 20.0);
        prop_assume!(!slivers);
        prop_assert_eq!(check(&f, &inputs, &options), Ok(()));
    }

    #[test]
    fn threads_change_no_bit_and_layers_are_in_order(scene in scenes(), blurred: bool) {
        let settings = settings(&scene, [true, true, blurred]);
        let run = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| {
                let tape = Tape::<f32>::train(0);
                let x = tape.leaf(scene.positions.mapv(|x| x as f32));
                let layers = Layers::new(x, &scene.faces, &settings);
                let gradients = layers.alpha(0.01).sum().add(layers.depth().sum()).backward();
                (layers.fragments().depth.clone(), gradients.wrt(x).unwrap().to_owned())
            })
        };
        let one = run(1);
        prop_assert_eq!(&one, &run(3));
        for pixel in one.0.chunks(3) {
            let seen: Vec<f32> = pixel.iter().copied().filter(|&z| z >= 0.0).collect();
            prop_assert!(seen.is_sorted() && pixel[seen.len()..].iter().all(|&z| z == -1.0));
        }
    }
}

/// Lets a closure be one for every tape.
fn rule<C: for<'t> Fn(&[Var<'t, f64>]) -> Var<'t, f64>>(closure: C) -> C {
    closure
}

/// The first layer of a solid is what the hard rasteriser sees, the second its back: a mesh and a camera as they are.
#[test]
fn the_first_layer_is_what_is_seen() {
    let ball = primitives::icosphere(2);
    let camera = Camera::look_at([0.4, 0.8, 3.0], [0.0; 3], [0.0, 1.0, 0.0], 0.9, 24, 24);
    let tape = Tape::<f64>::eval();
    let projected =
        tape.constant(ball.vertices()).project(tape.constant(Camera::matrices(&[camera])));
    let faces = Arc::new(Faces::of(&ball).unwrap());
    let layers = rasterize_layers(projected, &faces, &LayerSettings::new(24, 24, 4));
    let seen = diff_raster::rasterize(projected, &faces, &diff_raster::Settings::new(24, 24));
    let mut covered = 0;
    for (pixel, &face) in seen.face.iter().enumerate() {
        let own = &layers.face[4 * pixel..4 * pixel + 4];
        if face != NONE && own[0] != NONE {
            assert_eq!(own[0], face);
            assert!(own[1] != NONE && own[2] == NONE, "front and back");
            covered += 1;
        }
    }
    assert!(covered > 50, "{covered}");
}
