//! The published form: sizes, and that the options do what they say.

#![allow(clippy::unwrap_used, reason = "tests")]

use autodiff_lite::{Module, Param, Tape};
use datasets::Views;
use mesh_core::primitives::icosphere;
use ndarray::Array4;
use synth::{Orbit, RenderOptions, render_views};

use super::*;
use crate::testing::{preset_with, trained};

fn paper(settings: &[(&str, &str)]) -> Img2MeshConfig {
    preset_with::<Img2Mesh>("paper", settings).system
}

/// Layer by layer: VGG16 to its third pooling and four convolutions, one transformer layer of width 1,024, and the heads.
#[test]
fn parts_are_as_large_as_published() {
    let config = paper(&[]);
    let system = Img2Mesh::new(&config, 0);
    let parts = ["encoder", "layers", "fc", "mesh_fc", "mesh_pos_fc", "mesh_color_fc"];
    let expected = [
        1_735_488 + 147_520 + 9_232 + 580 + 37,
        // Attention in and out, feed-forward, two norms.
        3_148_800 + 1_049_600 + 2_099_200 + 2_098_176 + 4_096,
        1_049_600,
        1024 * 3 * 642 + 3 * 642,
        1024 * 3 + 3,
        1024 * 3 * 642 + 3 * 642,
    ];
    assert_eq!(trained(&system, &parts), expected);
    assert_eq!(config.summary().trainable, 15_293_704);
    // VGG16 without its last two layers is frozen; what is trained is four times as wide.
    let base = preset_with::<Img2Mesh>("paper-base", &[]).system.summary();
    assert_eq!(base.frozen, 14_714_688 + 102_764_544 + 4);
    assert_eq!(base.trainable, 83_924_992 + 16_781_312 + 2 * 7_890_822 + 12_291);
}

#[test]
fn shapes_are_as_published() {
    let config = paper(&[]);
    let system = Img2Mesh::new(&config, 0);
    let tape = Tape::eval();
    let images = tape.constant(Array4::from_elem((1, 256, 256, 3), 0.5));
    let features = system.model.encode(images);
    assert_eq!(features.shape(), [1, 1024]);
    let cameras = tape.constant(ndarray::Array2::zeros((1, 12)));
    let meshes = system.model.forward(1, features, cameras);
    for shape in [meshes.raw, meshes.positions, meshes.colors].map(|x| x.shape()) {
        assert_eq!(shape, [1, 642, 3]);
    }
    assert_eq!(system.finest().renderer.topology.edges.len(), 1920);
}

fn tiny(settings: &[(&str, &str)]) -> Img2MeshConfig {
    let small = [
        ("encoder", "small"),
        ("features", "16"),
        ("image-size", "16"),
        ("render-size", "24"),
        ("feed-forward", "16"),
        ("dropout", "0.0"),
        ("level", "1"),
        ("hold-out", "none"),
    ];
    paper(&[&small, settings].concat())
}

/// Views of an ellipsoid before grey.
fn views(count: usize) -> Views {
    let mesh = icosphere(3).scaled([1.0, 0.6, 0.8]).colored([0.9, 0.2, 0.1]);
    let orbit = Orbit { count, width: 24, height: 24, ..Orbit::default() };
    let options = RenderOptions::default();
    let mut views = render_views(&mesh, &orbit.cameras(), &options, &|_, _| ()).unwrap();
    for view in &mut views {
        let pixels = view.color.data.chunks_exact_mut(3).zip(&view.mask.data);
        pixels.filter(|(_, m)| **m == 0).for_each(|(pixel, _)| pixel.fill(40));
    }
    Views::in_memory(views)
}

/// Attention as published mixes the objects of a batch and not the views of an object; repaired, the other way round.
#[test]
fn published_attention_is_over_the_batch() {
    let tape = Tape::eval();
    let changed = |attention: &str, object: usize, view: usize| {
        let config = tiny(&[("attention", attention)]);
        let system = Img2Mesh::new(&config, 1);
        let of = |other: bool| {
            let features = ndarray::Array2::from_shape_fn((4, 16), |(i, k)| {
                let own = ((7 * i + 3 * k) as f32).sin();
                if other && i == 2 * object + view { own + (k as f32).cos() } else { own }
            });
            let cameras = tape.constant(ndarray::Array2::zeros((4, 12)));
            system.model.forward(2, tape.constant(features), cameras).raw.value()
        };
        let (before, after) = (of(false), of(true));
        [0, 1].map(|object| {
            let one = |x: &autodiff_lite::Tensor<f32>| x.as_slice()[object * 126..][..126].to_vec();
            one(&before) != one(&after)
        })
    };
    assert_eq!(changed("views", 1, 0), [false, true]);
    assert_eq!(changed("published", 1, 0), [true, true]);
    // Without mixing, what a view adds to the mean does not depend on the other view.
    let of = |attention: &str, second: f32| {
        let config = tiny(&[("attention", attention)]);
        let system = Img2Mesh::new(&config, 1);
        let token = |i: usize, k: usize| {
            if i == 0 { (3.0 * k as f32).sin() } else { second * (k as f32).cos() }
        };
        let tokens = ndarray::Array3::from_shape_fn((1, 2, 16), |(_, i, k)| token(i, k));
        let layer = system.model.attend(tape.constant(tokens)).value();
        layer.as_slice()[..16].to_vec()
    };
    assert_eq!(of("published", 1.0), of("published", 2.0));
    assert_ne!(of("views", 1.0), of("views", 2.0));
}

/// The scale of the heads changes the first mesh by rounding alone, and what a step of Adam does by its factor.
#[test]
fn heads_speak_the_clocks_unit() {
    let tape = Tape::eval();
    let raw = |scale: &str, step: f32| {
        let mut system = Img2Mesh::new(&tiny(&[("offset-scale", scale)]), 2);
        system.model.mesh_fc.visit_mut("", &mut |path: &str, param: &mut Param| {
            if path == "bias" {
                param.as_slice_mut()[0] += step;
            }
        });
        let features = ndarray::Array2::from_shape_fn((2, 16), |(i, k)| ((5 * i + k) as f32).sin());
        let cameras = tape.constant(ndarray::Array2::zeros((2, 12)));
        system.model.forward(1, tape.constant(features), cameras).raw.value()
    };
    let (ours, published) = (raw("1.0", 0.0), raw("0.016", 0.0));
    for (a, b) in ours.iter().zip(&published) {
        assert!((a - b).abs() < 1e-6, "{a} {b}");
    }
    let moved = |scale, before: &autodiff_lite::Tensor<f32>| {
        raw(scale, 0.5).as_slice()[0] - before.as_slice()[0]
    };
    let factor = moved("1.0", &ours) / moved("0.016", &published);
    assert!((factor - 62.5).abs() < 0.01, "{factor}");
}

/// Colours begin as PyTorch draws them, a tenth around grey; ours 20 times nearer to it.
#[test]
fn first_colors_are_published_or_gray() {
    let data = Data::one(&views(4), &tiny(&[])).unwrap();
    let [published, ours] = ["1.0", "0.05"].map(|first| {
        let mut system = Img2Mesh::new(&tiny(&[("first-colors", first)]), 2);
        system.init_from_data(&data, None).unwrap();
        let mesh = system.predict(&views(2).views).unwrap();
        let colors = mesh.colors.unwrap();
        let colors = colors.as_flattened();
        (colors.iter().map(|c| (c - 0.5).powi(2)).sum::<f32>() / colors.len() as f32).sqrt()
    });
    assert!(published > 0.02 && (published / ours - 20.0).abs() < 0.1, "{published} {ours}");
}

/// Images are given and compared as they are, or black around the object.
#[test]
fn the_background_is_kept_as_published() {
    let view = &views(4).views[0];
    let [kept, black] =
        ["false", "true"].map(|mask| Prepared::new(view, &tiny(&[("mask-images", mask)])).unwrap());
    assert_eq!((kept.image[0], black.image[0]), (40, 0));
    assert_eq!((kept.target[0], black.target[0]), (40, 0));
}

/// A sphere that is turned inside out: its near faces turn away, so by the published rules its far side is seen.
#[test]
fn published_rules_draw_no_back_faces() {
    let tape = Tape::eval();
    let rows = [[2.0, 0.0, 0.0, 0.0], [0.0, 2.0, 0.0, 0.0], [0.0, 0.0, -1.0, 2.0]];
    let matrices =
        || tape.constant(ndarray::Array3::from_shape_fn((1, 3, 4), |(_, i, j)| rows[i][j]));
    let in_the_middle = |rules: &str, mirrored: f32| {
        let config = tiny(&[("published-rules", rules)]);
        let Level { template, renderer, .. } = Level::all(&config).swap_remove(0);
        let at = |i: usize, k: usize| {
            // Mirrored in x every face turns the other way.
            template.positions[i][k] * if k == 0 { mirrored } else { 1.0 }
        };
        let positions = ndarray::Array3::from_shape_fn((1, 42, 3), |(_, i, k)| at(i, k));
        // The near half is white.
        let colors =
            ndarray::Array3::from_shape_fn(
                (1, 42, 3),
                |(_, i, _)| {
                    if at(i, 2) > -0.1 { 1.0 } else { 0.2 }
                },
            );
        let drawn = renderer.render(tape.constant(positions), tape.constant(colors), matrices());
        drawn.image.value()[[0, 12, 12, 0]]
    };
    assert_eq!(["true", "false"].map(|rules| in_the_middle(rules, 1.0)), [1.0, 1.0]);
    assert_eq!(in_the_middle("false", -1.0), 1.0);
    assert!(in_the_middle("true", -1.0) < 0.9);
}
