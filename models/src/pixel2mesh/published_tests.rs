//! The published forms: sizes, and that the options do what they say.

#![allow(clippy::unwrap_used, reason = "tests")]

use autodiff_lite::{Module, Param, Tape};
use ndarray::Array4;
use train::{Configuration, Draw, StepInfo, System};

use super::deformer::Run;
use super::*;
use crate::paired::{Pairs, PairsConfig};
use crate::testing::{preset_with, trained};

/// A field of two layers on 3 coordinates, 960 features and 196 columns of time; blocks without the time.
#[test]
fn the_odes_parts_are_as_large_as_published() {
    let encoder = [2_768, 23_136, 92_352, 369_024, 1_999_616, 10_356_736];
    let field = 2 * 1159 * 192 + 192 + 2 * 192 * 3 + 3;
    let block = 2 * 963 * 192 + 192 + 2 * 192 * 3 + 3;
    assert_eq!((field, block), (446_403, 371_139));
    for (name, deformer) in [
        ("paper", field),
        ("paper-shallow", field),
        ("paper-res-deep", 8 * block),
        ("paper-res-shallow", 4 * block),
    ] {
        let config = preset_with::<OdePixel2Mesh>(name, &[]).system;
        let summary = OdePixel2Mesh::summary(&config);
        assert_eq!(summary.trainable, 12_843_632 + deformer, "{name}");
    }
    let config = preset_with::<OdePixel2Mesh>("paper", &[]).system;
    let stages = [0, 1, 2, 3, 4, 5].map(|stage| format!("encoder.conv{stage}_"));
    let mut parts: Vec<&str> = stages.iter().map(String::as_str).collect();
    parts.extend(["deformer.field.conv1", "deformer.field.conv2"]);
    let found = trained(&OdePixel2Mesh::new(&config, 0), &parts);
    assert_eq!(found[..6], encoder);
    assert_eq!(found[6..], [2 * 1159 * 192 + 192, 2 * 192 * 3 + 3]);
}

/// Three chains of 14 convolutions of width 256, and one more from 128 columns.
#[test]
fn pixel2meshs_parts_are_as_large_as_published() {
    let config = preset_with::<Pixel2Mesh>("paper", &[]).system;
    let conv = |i: usize, o: usize| 2 * i * o + o;
    let blocks = 12 * conv(256, 256);
    let parts =
        ["encoder", "deformer.gcns.0", "deformer.gcns.1", "deformer.gcns.2", "deformer.gconv"];
    let expected = [
        12_843_632,
        conv(963, 256) + blocks + conv(256, 3),
        conv(963 + 256, 256) + blocks + conv(256, 3),
        conv(963 + 256, 256) + blocks + conv(256, 128),
        conv(128, 3),
    ];
    assert_eq!(trained(&Pixel2Mesh::new(&config, 0), &parts), expected);
    assert_eq!(expected[1..], [2_070_787, 2_201_859, 2_265_984, 771]);
    assert_eq!(Pixel2Mesh::summary(&config).trainable, expected.iter().sum::<usize>());
}

/// One object as the published images show it, with fewer points.
fn one(side: usize) -> Pairs {
    Pairs::synthetic(&PairsConfig {
        image_size: side,
        points: 100,
        objects: 1,
        test_objects: 1,
        synthetic_views: 1,
        ..PairsConfig::default()
    })
    .unwrap()
}

#[test]
fn shapes_are_as_published() {
    let pairs = one(224);
    let pair = pairs.pair(0, 0).unwrap();
    let tape = Tape::eval();
    let config = preset_with::<OdePixel2Mesh>("paper", &[]).system;
    let system = OdePixel2Mesh::new(&config, 0);
    let images = tape.constant(Array4::zeros((1, 224, 224, 3)));
    let maps = system.encoder.forward(images).map(|map| map.shape());
    let expected = [[1, 56, 56, 64], [1, 28, 28, 128], [1, 14, 14, 256], [1, 7, 7, 512]];
    assert_eq!(maps, expected);
    let deformed = system.deformed(&tape, &[&*pair.image], Run::Test).unwrap();
    assert_eq!(deformed.stages[0].positions.shape(), [1, 2466, 3]);
    // From 0.125 in steps of 0.125 until the time exceeds 1.
    assert_eq!(deformed.stats.evaluations, 8);
    let config = preset_with::<Pixel2Mesh>("paper", &[]).system;
    let deformed = Pixel2Mesh::new(&config, 0).deformed(&tape, &[&*pair.image], Run::Test);
    let shapes: Vec<Vec<usize>> =
        deformed.unwrap().stages.iter().map(|stage| stage.positions.shape()).collect();
    assert_eq!(shapes, [[1, 156, 3], [1, 618, 3], [1, 2466, 3]]);
}

/// Few and small, the rest as published.
fn tiny<S: System>(name: &str, settings: &[(&str, &str)]) -> Configuration<S::Config> {
    let small = [
        ("image-size", "32"),
        ("channels", "[4, 4, 4, 4, 4, 4]"),
        ("encoder-init", "he"),
        ("hidden", "8"),
        ("points", "100"),
    ];
    preset_with::<S>(name, &[&small, settings].concat())
}

/// Loss terms by name.
fn terms<S: System<Data = Pairs>>(config: &Configuration<S::Config>) -> Vec<(String, f64)> {
    let system = S::new(&config.system, 3);
    let draw = Draw { seed: 1, epoch: 0, index: 0, item: 0 };
    let sample = system.draw(&one(32), &draw).unwrap();
    let tape = Tape::train(0);
    let terms = system.loss(&tape, &[sample], StepInfo { step: 0, epoch: 0 }).unwrap().0;
    terms.iter().map(|term| (term.name.to_string(), f64::from(term.value.item()))).collect()
}

/// The published list of edges holds each vertex as an edge to itself: means over it are smaller by what is known of it.
#[test]
fn self_loops_dilute_means_over_edges() {
    let of = |loops: &str| {
        let settings = [("self-loops", loops), ("level", "0")];
        terms::<Pixel2Mesh>(&tiny::<Pixel2Mesh>("paper", &settings))
    };
    let (with, without) = (of("true"), of("false"));
    for ((name, a), (_, b)) in with.iter().zip(&without) {
        // 2 x 462 edges and 156 vertices, the 1,080 entries of the published support.
        let expected = if name == "edge" || name == "normal" { 924.0 / 1080.0 } else { 1.0 };
        assert!((a - expected * b).abs() < 1e-5 * b.abs().max(1.0), "{name}: {a} {b}");
    }
    assert!(with.iter().any(|(name, _)| name == "normal"));
}

/// Weight decay as terms of the loss, of the parts that are published.
#[test]
fn decays_are_terms_of_the_loss() {
    let config = tiny::<Pixel2Mesh>("paper", &[("level", "0")]);
    let found = terms::<Pixel2Mesh>(&config);
    let of = |name: &str| found.iter().find(|(other, _)| other == name).unwrap().1;
    let system = Pixel2Mesh::new(&config.system, 3);
    let (mut encoder, mut graph) = (0.0, 0.0);
    system.visit("", &mut |path: &str, param: &Param| {
        let half = 0.5 * param.as_slice().iter().map(|&w| f64::from(w).powi(2)).sum::<f64>();
        if path.starts_with("deformer") {
            graph += half;
        } else if path.ends_with("weight") {
            encoder += half;
        }
    });
    assert!((of("encoder-decay") / encoder - 1.0).abs() < 1e-4, "{found:?}");
    assert!((of("graph-decay") / graph - 1.0).abs() < 1e-4, "{found:?}");
    let without = [("level", "0"), ("encoder-decay", "0.0"), ("graph-decay", "0.0")];
    let without = terms::<Pixel2Mesh>(&tiny::<Pixel2Mesh>("paper", &without));
    assert_eq!(without.len() + 2, found.len());
}

/// The published camera takes the place of each image's own.
#[test]
fn the_published_camera_is_not_the_images() {
    let pairs = one(32);
    let pair = pairs.pair(0, 0).unwrap();
    let mesh = |projection: &str| {
        let config = tiny::<OdePixel2Mesh>("paper", &[("projection", projection), ("level", "0")]);
        OdePixel2Mesh::new(&config.system, 3).mesh_of(&pair.image).unwrap().0
    };
    assert_ne!(mesh("none"), mesh("[248.0, 111.5]"));
    // Our renderings' own camera, said as the published ones are.
    let (own, same) = (mesh("none"), mesh("[245.0, 112.0]"));
    for (a, b) in own.positions.as_flattened().iter().zip(same.positions.as_flattened()) {
        assert!((a - b).abs() < 1e-3, "{a} {b}");
    }
    let wrong = tiny::<OdePixel2Mesh>("paper", &[("projection", "[0.0, 300.0]")]);
    assert!(OdePixel2Mesh::check(&wrong.system).join(" ").contains("`projection`"));
    // In the object's frame it would be no camera at all.
    let wrong = tiny::<OdePixel2Mesh>("paper", &[("frame", "object")]);
    assert!(OdePixel2Mesh::check(&wrong.system).join(" ").contains("`projection`"));
}

/// Glorot's numbers where the first version has them, PyTorch's elsewhere.
#[test]
fn graph_convolutions_begin_as_published() {
    let most = |init: &str| {
        let config = tiny::<Pixel2Mesh>("paper", &[("graph-init", init), ("hidden", "64")]);
        let system = Pixel2Mesh::new(&config.system, 0);
        let (mut weight, mut bias) = (0.0_f32, 0.0_f32);
        system.visit("", &mut |path: &str, param: &Param| {
            let most = param.as_slice().iter().fold(0.0_f32, |most, w| most.max(w.abs()));
            if path.starts_with("deformer.gcns.0.blocks") {
                let of = if path.ends_with("bias") { &mut bias } else { &mut weight };
                *of = of.max(most);
            }
        });
        (weight, bias)
    };
    let (weight, bias) = most("glorot");
    assert!(bias == 0.0 && (weight - (6.0_f32 / 128.0).sqrt()).abs() < 1e-3, "{weight}");
    let (weight, bias) = most("uniform");
    assert!(bias > 0.1 && (weight - 1.0 / 8.0).abs() < 1e-3, "{weight} {bias}");
}
