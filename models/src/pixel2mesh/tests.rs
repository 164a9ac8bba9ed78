//! What the systems of a single image do.

#![allow(clippy::unwrap_used, reason = "tests")]

use autodiff_lite::{Param, Tape};
use train::settings::read_text;
use train::{Configuration, Draw, StepInfo, System};

use super::*;
use crate::paired::{FrameKind, Pairs, PairsConfig};

fn data() -> PairsConfig {
    PairsConfig {
        image_size: 32,
        points: 200,
        objects: 2,
        test_objects: 1,
        synthetic_views: 3,
        ..PairsConfig::default()
    }
}

fn shared() -> SharedConfig {
    SharedConfig { pairs: data(), channels: [4; 6], level: 0, hidden: 8, ..SharedConfig::default() }
}

fn ode() -> OdeConfig {
    OdeConfig { shared: shared(), step: [0.2, 0.3], time: 3, ..OdeConfig::default() }
}

fn stacked() -> OdeConfig {
    OdeConfig {
        deformation: DeformationKind::Stacked,
        augment_dim: 2,
        feature_dim: 5,
        segments: 3,
        ..ode()
    }
}

/// Another encoder under the same field.
fn residual_encoder() -> OdeConfig {
    let shared =
        SharedConfig { encoder_form: EncoderForm::Residual, feature_scale: 0.1, ..shared() };
    OdeConfig { shared, ..stacked() }
}

/// In the object's frame, with a camera head.
fn object() -> StagesConfig {
    let shared = SharedConfig {
        frame: FrameKind::Object,
        camera_weight: 1.0,
        stretch_weight: 0.1,
        bending_weight: 0.1,
        ..stages().shared
    };
    StagesConfig { shared, ..stages() }
}

fn stages() -> StagesConfig {
    let shared = SharedConfig {
        normal_weight: 0.1,
        laplacian_weight: 1.0,
        move_weight: 1.0,
        level: 1,
        ..shared()
    };
    StagesConfig { shared, blocks: 1, ..StagesConfig::default() }
}

#[test]
fn presets_are_in_range() {
    crate::testing::assert_presets::<OdePixel2Mesh>();
    crate::testing::assert_presets::<Pixel2Mesh>();
}

#[test]
fn parameters_are_counted_without_making_them() {
    fn counted<S: System>(config: &S::Config) {
        let mut all = 0;
        S::new(config, 0).visit("", &mut |_: &str, param: &Param| all += param.value.len());
        assert_eq!(all, S::summary(config).trainable);
    }
    counted::<OdePixel2Mesh>(&ode());
    counted::<OdePixel2Mesh>(&stacked());
    counted::<OdePixel2Mesh>(&residual_encoder());
    counted::<OdePixel2Mesh>(&OdeConfig { deformation: DeformationKind::Residual, ..ode() });
    counted::<Pixel2Mesh>(&stages());
    counted::<Pixel2Mesh>(&object());
    counted::<Pixel2Mesh>(&StagesConfig { shared: shared(), ..stages() });
}

/// The published sizes: 1/6.7 of the deep residual network's parameters, and 1/8 if the time is one column and the
/// blocks had it too.
#[test]
fn the_field_is_a_fraction_of_the_residual_network() {
    let channels = [16, 32, 64, 128, 256, 512];
    let shared = SharedConfig { channels, hidden: 192, ..SharedConfig::default() };
    let field = OdeConfig { shared, ..OdeConfig::default() };
    let deep = OdeConfig { deformation: DeformationKind::Residual, ..field.clone() };
    let share = deep.deformation_parameters() as f64 / field.deformation_parameters() as f64;
    assert!((share - 6.67).abs() < 0.05, "{share}");
    let one = OdeConfig { time: 1, ..field };
    let share = deep.deformation_parameters() as f64 / one.deformation_parameters() as f64;
    assert!((share - 8.0).abs() < 0.02, "{share}");
}

/// Checkpoints carry the configuration that they were trained with.
#[test]
fn fields_are_known_by_their_former_names() {
    let former = "deformation = \"stacked\"\nmemory = 2\nreading = 5\npieces = 3\nspeed = 4.0\ntest-from = 10000\n\
                  data-seed = 0\nvalidation-every = 3";
    let config: Configuration<OdeConfig> =
        read_text("former".as_ref(), former, &[("memory".into(), "6".into())]).unwrap();
    // A seed of 0 was one, and still is.
    assert_eq!(config.system.shared.pairs.data_seed, Some(0));
    assert_eq!(config.train.validation_every, Some(3));
    let config = config.system;
    let found = (config.augment_dim, config.feature_dim, config.segments, config.output_scale);
    assert_eq!(found, (6, 5, 3, 4.0));
    let error =
        read_text::<Configuration<OdeConfig>>("bad".as_ref(), "piece = 3", &[]).unwrap_err();
    assert!(error.to_string().contains("unknown field `piece`"), "{error}");
}

#[test]
fn what_is_out_of_range_is_named() {
    let wrong = OdeConfig {
        start: [0.5, 0.2],
        step: [0.0, 0.1],
        tolerance: Some(1e-3),
        feature_dim: 0,
        segments: 65,
        output_scale: 0.0,
        shared: SharedConfig { level: 7, ..shared() },
        ..ode()
    };
    let mut problems = OdePixel2Mesh::check(&wrong).join("; ");
    let camera = CameraSource::Estimated;
    let unframed = SharedConfig { camera, camera_weight: 1.0, ..shared() };
    problems += &OdePixel2Mesh::check(&OdeConfig { shared: unframed, ..ode() }).join("; ");
    let headless = SharedConfig { camera, frame: FrameKind::Object, ..shared() };
    let headless = OdePixel2Mesh::check(&OdeConfig { shared: headless, ..ode() }).join("; ");
    assert!(
        headless.contains("`camera`") && !headless.contains("`camera-weight` is"),
        "{headless}"
    );
    for field in [
        "`camera`",
        "`camera-weight`",
        "`start`",
        "`step`",
        "`tolerance`",
        "`level`",
        "`feature-dim`",
        "`segments`",
        "`output-scale`",
    ] {
        assert!(problems.contains(field), "{field}: {problems}");
    }
}

/// Loss terms of a batch at a step, and the gradient of their weighted sum by path.
fn step<S: System<Data = Pairs, ReadOptions = datasets::ReadOptions>>(
    config: &S::Config,
    step: u64,
) -> (Vec<f32>, Vec<(String, f32)>) {
    let system = S::new(config, 3);
    let pairs = crate::testing::made::<S>(config, 0);
    let draw = |i: u64| Draw { seed: 1, epoch: 0, index: i, item: i as usize };
    let batch: Vec<S::Sample> = (0..2).map(|i| system.draw(&pairs, &draw(i)).unwrap()).collect();
    let tape = Tape::train(0);
    let terms = system.loss(&tape, &batch, StepInfo { step, epoch: 0 }).unwrap().0;
    let values = terms.iter().map(|term| term.value.item()).collect();
    let total = terms.iter().map(|term| term.value.scale(term.weight as f32));
    let gradients = total.reduce(|a, b| a + b).unwrap().backward();
    let mut norms = Vec::new();
    system.visit("", &mut |path: &str, param: &Param| {
        let gradient = gradients.slice_of(param).unwrap_or_default();
        norms.push((path.to_owned(), gradient.iter().map(|g| g * g).sum::<f32>()));
    });
    (values, norms)
}

#[test]
fn every_parameter_learns_and_steps_are_drawn() {
    let residual = OdeConfig { deformation: DeformationKind::Residual, blocks: 2, ..ode() };
    for (values, norms) in [
        step::<OdePixel2Mesh>(&ode(), 0),
        step::<OdePixel2Mesh>(&stacked(), 0),
        step::<OdePixel2Mesh>(&residual_encoder(), 0),
        step::<OdePixel2Mesh>(&residual, 0),
        step::<Pixel2Mesh>(&stages(), 0),
        step::<Pixel2Mesh>(&object(), 0),
    ] {
        assert!(values.iter().all(|v| v.is_finite() && *v > 0.0), "{values:?}");
        for (path, norm) in norms {
            assert!(norm > 0.0, "{path} gets no gradient");
        }
    }
    // Another step of a training integrates otherwise; blocks do not.
    assert_eq!(step::<OdePixel2Mesh>(&ode(), 5).0, step::<OdePixel2Mesh>(&ode(), 5).0);
    assert_ne!(step::<OdePixel2Mesh>(&ode(), 5).0, step::<OdePixel2Mesh>(&ode(), 6).0);
    assert_eq!(step::<OdePixel2Mesh>(&residual, 5).0, step::<OdePixel2Mesh>(&residual, 6).0);
}

/// The sequence begins at the ellipsoid and ends at the prediction; another method takes the same parameters.
#[test]
fn a_sequence_goes_from_the_ellipsoid_to_the_prediction() {
    let pairs = Pairs::synthetic(&data()).unwrap();
    let pair = pairs.pair(pairs.listed(train::Subset::Test)[0], 0).unwrap();
    let system = OdePixel2Mesh::new(&ode(), 3);
    let (mesh, stats) = system.mesh_of(&pair.image).unwrap();
    assert_eq!((stats.evaluations, stats.accepted), (4, 4));
    let (same, sequence) = system.mesh_and_sequence_of(&pair.image, 5).unwrap();
    assert_eq!(same, mesh);
    assert_eq!(sequence.len(), 5);
    assert_eq!(sequence[0].positions, system.template.finest().mesh.positions);
    assert_eq!(sequence[4].positions, mesh.positions);
    let finer = OdeConfig { method: Method::Dopri5, tolerance: Some(1e-6), ..ode() };
    let (exact, _) = system.with_config(&finer).mesh_of(&pair.image).unwrap();
    let far = |a: &[[f32; 3]], b: &[[f32; 3]]| {
        let pairs = a.as_flattened().iter().zip(b.as_flattened());
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    let moved = far(&exact.positions, &sequence[0].positions);
    let error = far(&exact.positions, &mesh.positions);
    assert!(error > 0.0 && error < 0.5 * moved, "{error} of {moved}");
    let staged = Pixel2Mesh::new(&stages(), 0);
    let (_, staged) = staged.mesh_and_sequence_of(&pair.image, 9).unwrap();
    let counts: Vec<usize> = staged.iter().map(|mesh| mesh.positions.len()).collect();
    assert_eq!(counts, [156, 156, 618]);
}

#[test]
fn made_objects_are_parted_and_drawn_by_the_seed() {
    let pairs = PairsConfig { test_objects: 3, ..data() };
    let config = OdeConfig { shared: SharedConfig { pairs, ..shared() }, ..ode() };
    let mut seeded = config.clone();
    seeded.shared.pairs.data_seed = Some(7);
    crate::testing::assert_data::<OdePixel2Mesh>(&config, &seeded, [2, 2, 3]);
}

/// With more objects to train on, tests are the same images and the same points.
#[test]
fn tests_do_not_depend_on_what_is_trained_on() {
    let test = |objects: usize| {
        let pairs = Pairs::synthetic(&PairsConfig { objects, ..data() }).unwrap();
        let (_, pair) = pairs.trial(train::Subset::Test, 2, 1).unwrap();
        (pair.image.name.clone(), pair.image.pixels.clone(), pair.truth)
    };
    assert_eq!(test(2), test(9));
}
