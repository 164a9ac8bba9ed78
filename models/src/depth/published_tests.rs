//! The published forms: sizes, and that the options do what they say.

#![allow(clippy::unwrap_used, reason = "tests")]

use std::sync::Arc;

use autodiff_lite::Tape;
use train::{Draw, StepInfo, System};

use super::encoder::Encoder;
use super::*;
use crate::testing::{preset_with, trained};

/// ResNet-50 without its classifier and with a fourth channel; 3,840 channels of maps; three stages.
const BACKBONE: usize = 25_557_032 - 2_049_000 + 49 * 64;
const REFINEMENT: [usize; 3] = [593_420, 626_188, 626_188];

#[test]
fn parts_are_as_large_as_published() {
    let convolutions = |inputs: usize| 2 * (inputs * 128 + 128);
    let stage = |previous: usize| {
        let after = 2 * convolutions(128 + 3);
        3840 * 128 + 128 + convolutions(128 + 3 + previous) + after + 3 * (128 + 3) + 3
    };
    assert_eq!([stage(0), stage(128), stage(128)], REFINEMENT);
    let stages = ["mesh_head.stages.0", "mesh_head.stages.1", "mesh_head.stages.2"];
    let config = preset_with::<MeshRcnn>("paper", &[]).system;
    let parts = [&["encoder", "beginning.head.voxel_fcn", "beginning.head"], &stages[..]].concat();
    let found = trained(&MeshRcnn::new(&config, 0), &parts);
    let fully = 2048 * 256 * 9 + 256 + 3 * (256 * 256 * 9 + 256);
    let rest = 4 * 256 * 256 + 256 + 256 * 48 + 48;
    assert_eq!(found[..3], [BACKBONE, fully, rest]);
    assert_eq!(found[3..], REFINEMENT);
    let all: usize = BACKBONE + 6_763_824 + REFINEMENT.iter().sum::<usize>();
    let summary = MeshRcnn::summary(&config);
    // Running means and variances are not trained.
    assert_eq!((summary.trainable, summary.frozen), (all, 53_120));
    let config = preset_with::<DepthPixel2Mesh>("paper", &[]).system;
    let summary = DepthPixel2Mesh::summary(&config);
    assert_eq!(summary.trainable, BACKBONE + REFINEMENT.iter().sum::<usize>());
}

/// The poster's table of shapes, from modules: a whole forward pass takes seconds.
#[test]
fn shapes_are_the_posters() {
    let config = preset_with::<MeshRcnn>("paper", &[]).system;
    let rows = MeshRcnn::summary(&config).shapes;
    let shapes: Vec<&str> = rows.iter().map(|(_, shape)| shape.as_str()).collect();
    let expected = [
        "137 x 137 x 4",
        "35 x 35 x 256",
        "18 x 18 x 512",
        "9 x 9 x 1024",
        "5 x 5 x 2048",
        "24 x 24 x 2048",
        "48 x 48 x 48",
        "V x 3, F x 3",
        "V x 3, F x 3",
        "V x 3, F x 3",
        "V x 3, F x 3",
    ];
    assert_eq!(shapes, expected);
    let config = preset_with::<DepthPixel2Mesh>("paper", &[]).system;
    let counts: Vec<u32> = config.levels();
    assert_eq!(counts, [2, 3, 4]);
    let summary = DepthPixel2Mesh::summary(&config);
    assert!(summary.shapes.iter().any(|(_, shape)| shape.starts_with("162, 642, 2562")));
}

/// The same as published but small: what is set, and one object.
fn tiny<S: System<Data = Scenes>>(settings: &[(&str, &str)]) -> (S, S::Config, Scenes)
where
    S::ReadOptions: Default,
{
    let small = [
        ("image-size", "32"),
        ("backbone", "resnet18"),
        ("width", "4"),
        ("hidden", "8"),
        ("points", "50"),
        ("objects", "1"),
        ("test-objects", "1"),
        ("synthetic-views", "1"),
        ("families", "[\"car\"]"),
    ];
    let config = preset_with::<S>("paper", &[&small, settings].concat()).system;
    let options = S::ReadOptions::default();
    let source = train::Source { path: None, options: &options, seed: 0, progress: &|_, _| () };
    let scenes = S::open(&config, &source).unwrap();
    (S::new(&config, 1), config, scenes)
}

fn scene<S: System<Data = Scenes, Sample = Scene>>(system: &S, scenes: &Scenes) -> Scene {
    system.draw(scenes, &Draw { seed: 0, epoch: 0, index: 0, item: 0 }).unwrap()
}

/// The published sphere begins around the camera; the loss and its gradient are numbers nonetheless.
#[test]
fn the_published_sphere_is_around_the_camera() {
    let around = |around: &str| {
        let (system, _, scenes) =
            tiny::<DepthPixel2Mesh>(&[("level", "1"), ("around-camera", around)]);
        let scene = scene(&system, &scenes);
        let (_, stages) = system.mesh_and_stages_of(&scene);
        let count = stages[0].positions.len() as f32;
        let middle = stages[0].positions.iter().map(|p| p[2]).sum::<f32>() / count;
        let tape = Tape::train(0);
        let terms = system.loss(&tape, &[scene], StepInfo { step: 0, epoch: 0 }).unwrap().0;
        let total = terms.iter().map(|t| t.value.scale(t.weight as f32)).reduce(|a, b| a + b);
        let total = total.unwrap();
        assert!(total.item().is_finite() && total.backward().is_finite());
        assert!(terms.iter().any(|term| term.name == "normal" && term.weight == 1.0));
        middle
    };
    assert!(around("true").abs() < 1e-5);
    assert!((around("false") + 1.4).abs() < 1e-4);
    // Without published places there is nothing behind the camera.
    let wrong = preset_with::<DepthPixel2Mesh>("paper", &[("published-places", "false")]);
    assert!(DepthPixel2Mesh::check(&wrong.system).join(" ").contains("`around-camera`"));
}

/// In the first hundred steps random tetrahedra are refined, others in each; then what the cells say.
#[test]
fn tetrahedra_stand_in_at_first() {
    let (system, _, scenes) = tiny::<MeshRcnn>(&[("cells", "8"), ("voxel-hidden", "4")]);
    let sample = scene(&system, &scenes);
    let edge = |step: u64| {
        let tape = Tape::train(0);
        let at = StepInfo { step, epoch: 0 };
        let terms = system.loss(&tape, std::slice::from_ref(&sample), at).unwrap().0;
        assert!(terms.iter().any(|term| term.name == "voxel"));
        terms.iter().find(|term| term.name == "edge").unwrap().value.item()
    };
    // Edges between normal points have a mean square of 6; those of cells are shorter.
    let [first, last, after] = [0, 99, 100].map(edge);
    assert!(first != last && first > after && last > after, "{first} {last} {after}");
    assert_eq!(after, edge(7_000));
}

/// Images are black where their masks are empty, and the same inside.
#[test]
fn the_background_is_black_as_published() {
    let of = |black: &str| {
        let (system, config, scenes) =
            tiny::<MeshRcnn>(&[("cells", "8"), ("black-background", black)]);
        let scene = Arc::new(scene(&system, &scenes));
        (Encoder::new(&nets::Init::new(0), &config.refine).images(&Tape::eval(), &[&*scene]), scene)
    };
    let ((black, scene), (white, _)) = (of("true"), of("false"));
    let pairs = black.as_slice().chunks_exact(4).zip(white.as_slice().chunks_exact(4));
    for ((black, white), &mask) in pairs.zip(&scene.image.mask) {
        match mask {
            0 => {
                let expected = [(0.0 - 0.485) / 0.229, (1.0 - 0.485) / 0.229];
                assert!(
                    (black[0] - expected[0]).abs() < 1e-5 && (white[0] - expected[1]).abs() < 1e-5
                );
            }
            255 => assert_eq!(black, white),
            _ => assert!(black[0] <= white[0]),
        }
    }
}
