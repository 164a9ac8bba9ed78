//! The published form: sizes, and that the options do what they say.

#![allow(clippy::unwrap_used, reason = "tests")]

use autodiff_lite::Tape;
use ndarray::Array4;
use train::System;

use super::*;
use crate::testing::{preset_with, trained};

/// Part by part, from the layers of the published code, for Pascal3D+'s 12 mean shapes and CUB's 14.
#[test]
fn parts_are_as_large_as_published() {
    let parts = [
        "encoder",
        "enc_conv",
        "enc_norm",
        "enc_fc",
        "selection.",
        "selection_out",
        "shapes",
        "deformation",
        "camera.",
        "camera_out",
        "texture",
    ];
    for (name, n, all) in [("paper", 12, 19_606_001), ("paper-cub", 14, 19_609_151)] {
        let config = preset_with::<Mcmr>(name, &[]).system;
        let d = 256 + n + 3;
        // Weight norm adds a length for each of 512 rows.
        let deformation = [d * 512, 512 * 512, (512 + d) * 512, 512 * 512];
        let deformation = deformation.iter().sum::<usize>() + 4 * 1024 + 512 * 3 + 3;
        let expected = [
            11_689_512 - 513_000,
            4 * 4 * 512 * 256 + 256,
            2 * 256,
            4096 * 256 + 256 + 2 * 256,
            256 * 64 + 64 + 2 * 64,
            64 * n + n,
            n * 162 * 3,
            deformation,
            256 * 64 + 64 + 2 * 64,
            64 * 7 + 7,
            4_172_435,
        ];
        assert_eq!(trained(&Mcmr::new(&config, 0), &parts), expected, "{name}");
        assert_eq!(Mcmr::summary(&config).trainable, all, "{name}");
    }
}

/// Of one image of 256 pixels.
#[test]
fn shapes_are_as_published() {
    let config = preset_with::<Mcmr>("paper", &[]).system;
    let system = Mcmr::new(&config, 0);
    let tape = Tape::eval();
    let images = tape.constant(Array4::from_elem((1, 256, 256, 3), 0.5));
    let predicted = system.model.forward(&tape, images, None);
    assert_eq!(predicted.weights.shape(), [1, 12]);
    assert_eq!(predicted.offsets.shape(), [1, 162, 3]);
    assert_eq!(predicted.positions.shape(), [1, 162, 3]);
    assert_eq!((predicted.place.shape(), predicted.rotation.shape()), (vec![1, 3], vec![1, 4]));
    assert_eq!(predicted.texture.shape(), [1, 256, 256, 3]);
    // Faces made four at the 351st epoch: 642 vertices, 1,280 faces.
    let finer = system.template.subdivided().0;
    assert_eq!(
        (system.template.corners.len(), finer.sphere.len(), finer.corners.len()),
        (320, 642, 1280)
    );
    assert_eq!(config.subdivide_at, Some(350));
}

fn tiny(settings: &[(&str, &str)]) -> McmrConfig {
    let small = [
        ("image-size", "64"),
        ("width", "4"),
        ("features", "8"),
        ("texture-width", "1"),
        ("head", "8"),
        ("hidden", "8"),
        ("shapes", "2"),
        ("level", "1"),
        ("dropout", "0.0"),
        ("camera-dropout", "0.0"),
    ];
    preset_with::<Mcmr>("paper", &[&small, settings].concat()).system
}

/// The size is what the head says, or that and one.
#[test]
fn sizes_are_raw_as_published() {
    let tape = Tape::eval();
    let place = |first: &str| {
        let system = Mcmr::new(&tiny(&[("first-size", first)]), 3);
        let images = tape.constant(Array4::from_elem((2, 64, 64, 3), 0.4));
        system.model.forward(&tape, images, None).place.value()
    };
    let (published, ours) = (place("0.0"), place("1.0"));
    for (k, (a, b)) in published.iter().zip(&ours).enumerate() {
        let expected = if k % 3 == 0 { 1.0 } else { 0.0 };
        assert!((b - a - expected).abs() < 1e-6, "{k}: {a} {b}");
    }
}

/// SoftRas draws textures with and without a seam, with a gradient to them and to the vertices; DIB-R those without.
#[test]
fn the_published_renderer_draws_the_published_texture() {
    for (closed, sides) in [("false", [64, 64]), ("true", [66, 56])] {
        let config = tiny(&[("closed-texture", closed)]);
        let system = Mcmr::new(&config, 3);
        let tape = Tape::train(0);
        let images = tape.constant(Array4::from_shape_fn((2, 64, 64, 3), |(n, i, j, c)| {
            ((n + i * 3 + j * 5 + c) as f32).sin().abs()
        }));
        let predicted = system.model.forward(&tape, images, None);
        assert_eq!(predicted.texture.shape(), [2, sides[0], sides[1], 3]);
        let pose = Pose { scale: 1.0, place: [0.1, 0.0], rotation: [1.0, 0.0, 0.0, 0.0] };
        let drawn = system.drawn(&tape, &predicted, &[pose, pose]);
        let seen = drawn.image.sum() + drawn.silhouette.sum();
        assert!(drawn.silhouette.value().iter().any(|&x| x > 0.9), "{closed}");
        let gradients = seen.backward();
        assert!(gradients.is_finite());
        let found = gradients.slice_of(&system.model.shapes).unwrap();
        assert!(found.iter().any(|&g| g != 0.0), "{closed}");
        let mesh = system.mesh_of(&predicted, 1);
        mesh.validate().unwrap();
    }
    let wrong = tiny(&[("renderer", "dib-r")]).check().join(" ");
    assert!(wrong.contains("`closed-texture`"), "{wrong}");
    assert_eq!(
        tiny(&[("renderer", "dib-r"), ("closed-texture", "true")]).check(),
        Vec::<String>::new()
    );
}
