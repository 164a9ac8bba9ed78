//! What the system does as a whole.

#![allow(clippy::unwrap_used, reason = "tests")]

use std::path::Path;

use autodiff_lite::{Module, Param};
use nets::NormKind;
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use train::progress::{Ended, Event, Watch};
use train::{Configuration, Job, Outcome, Provenance, RunFolder, train};

use super::*;

type Config = Configuration<McmrConfig>;

fn preset(name: &str) -> Config {
    let (_, text) = Mcmr::PRESETS.iter().find(|(other, _)| *other == name).unwrap();
    toml::from_str(text).unwrap()
}

fn tiny() -> McmrConfig {
    let Config { system, .. } = preset("tiny");
    McmrConfig { objects: 2, test_objects: 1, ..system }
}

fn samples(config: &McmrConfig, data: &Data) -> Vec<<Mcmr as System>::Sample> {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    data.trained()
        .iter()
        .map(|&object| {
            (data.photo(object).unwrap().random(config, &mut rng), Arc::clone(data.perceptual()))
        })
        .collect()
}

const AT: StepInfo = StepInfo { step: 0, epoch: 0 };

#[test]
fn presets_are_in_range_and_parameters_are_counted() {
    crate::testing::assert_presets::<Mcmr>();
    let others = [
        McmrConfig { shapes: 5, image_size: 128, level: 2, ..tiny() },
        McmrConfig { camera_head: CameraHead::Viewpoint, norm: NormKind::Group, ..tiny() },
        McmrConfig { norm: NormKind::Frozen, ..tiny() },
    ];
    for config in others.into_iter().chain([tiny()]) {
        let summary = super::size::summary(&config);
        let (mut trained, mut all) = (0, 0);
        Mcmr::new(&config, 0).visit("", &mut |_: &str, param: &Param| {
            all += param.len();
            trained += if param.trainable { param.len() } else { 0 };
        });
        assert_eq!((trained, all), (summary.trainable, summary.trainable + summary.frozen));
    }
    let wrong = McmrConfig {
        shapes: 0,
        image_size: 100,
        mask_weight: f64::NAN,
        hold_out: Some(1),
        ..tiny()
    };
    let problems = wrong.check().join("; ");
    for field in ["`shapes`", "`image-size`", "`mask-weight`", "`hold-out`"] {
        assert!(problems.contains(field), "{problems}");
    }
}

/// With the statistics of each image alone, what becomes of one does not depend on the others of its batch.
#[test]
fn groups_do_not_couple_the_images_of_a_batch() {
    let still = McmrConfig { dropout: 0.0, camera_dropout: 0.0, ..tiny() };
    let config = McmrConfig { objects: 4, ..still };
    let data = Data::synthetic(&config).unwrap();
    let batch = samples(&config, &data);
    let all: Vec<&Sample> = batch.iter().map(|(sample, _)| sample).collect();
    let far = |norm: NormKind| {
        let system = Mcmr::new(&McmrConfig { norm, ..config.clone() }, 1);
        assert_eq!(system.coupling().is_none(), norm == NormKind::Group);
        let tape = Tape::train(0);
        let [one, other] = [&all[..2], &all[..3]].map(|samples| {
            let positions = system.predicted(&tape, samples).positions.value().to_owned();
            positions.iter().take(3 * config.vertices()).copied().collect::<Vec<f32>>()
        });
        one.iter().zip(&other).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    assert!(far(NormKind::Group) < 1e-5 && far(NormKind::Batch) > 1e-4);
    // What asks that all shapes are used, asks it of the batch.
    let balanced =
        McmrConfig { norm: NormKind::Group, balance_weight: 0.5, shapes: 2, ..config.clone() };
    assert!(Mcmr::new(&balanced, 1).coupling().is_some_and(|why| why.contains("balance-weight")));
}

/// The published weights, by the tables of the published configurations.
#[test]
fn both_sets_of_published_weights() {
    let weights = |name: &str| {
        let config = preset(name).system;
        [
            config.mask_weight,
            config.camera_weight,
            config.camera_length_weight,
            config.deform_weight,
            config.laplacian_weight,
            config.laplacian_offsets_weight,
            config.cotangent_weight,
            config.percept_weight,
            config.color_weight,
            config.lightness_weight,
        ]
    };
    assert_eq!(weights("paper"), [100.0, 20.0, 0.1, 0.05, 6.0, 1.8, 0.0, 0.8, 0.03, 0.005]);
    assert_eq!(weights("paper-cub"), [20.0, 2.0, 0.1, 0.005, 1.2, 0.18, 0.0, 3.2, 0.12, 0.02]);
    // 162 vertices that become 642, four layers of 512, twice the code of the small one.
    let paper = super::size::summary(&preset("paper").system);
    assert!(paper.shapes.iter().any(|(_, shape)| shape.contains("642, 3], 1280 faces")));
    assert!((13_000_000..20_000_000).contains(&paper.trainable), "{}", paper.trainable);
}

/// In proportion to faces, spheres of 162 and of 642 vertices are as smooth; as published, the finer one is asked about a quarter.
#[test]
fn laplacians_by_faces_do_not_depend_on_the_level() {
    let laplacian = |level: u32, laplacian_by_faces: bool| {
        let config = McmrConfig { level, laplacian_by_faces, ..tiny() };
        let data = Data::synthetic(&config).unwrap();
        let tape = Tape::eval();
        let batch = samples(&config, &data);
        let terms = Mcmr::new(&config, 1).loss(&tape, &batch[..1], AT).unwrap();
        let term = terms.0.iter().find(|term| term.name == "laplacian").unwrap();
        term.weight * f64::from(term.value.item())
    };
    let [coarse, fine] = [2, 3].map(|level| laplacian(level, true));
    assert!((fine / coarse - 1.0).abs() < 0.2, "{coarse} and {fine}");
    let published = laplacian(2, false) / laplacian(3, false);
    assert!((3.2..4.2).contains(&published), "{published}");
}

/// Where a deformation looks is a matter of its option alone.
#[test]
fn coordinates_are_multiplied_for_the_deformation_alone() {
    let config = McmrConfig { vertex_scale: 1.0, ..tiny() };
    let data = Data::synthetic(&config).unwrap();
    let batch = samples(&config, &data);
    let samples: Vec<&Sample> = batch[..1].iter().map(|(sample, _)| sample).collect();
    let shapes = |vertex_scale: f64| {
        let tape = Tape::eval();
        let system = Mcmr::new(&McmrConfig { vertex_scale, ..config.clone() }, 1);
        let predicted = system.predicted(&tape, &samples);
        let [positions, offsets] =
            [predicted.positions, predicted.offsets].map(|v| v.value().to_owned());
        (positions - &offsets, offsets)
    };
    let [(mean, offsets), (same_mean, others)] = [1.0, 16.0].map(shapes);
    assert!(mean.iter().zip(&same_mean).all(|(a, b)| (a - b).abs() < 1e-6));
    // How much offsets differ from vertex to vertex.
    let spread = |of: &ndarray::ArrayD<f32>| {
        let all: Vec<f32> = of.iter().step_by(3).copied().collect();
        let [least, most] = [f32::min, f32::max].map(|f| all.iter().copied().reduce(f).unwrap());
        most - least
    };
    assert!(spread(&others) > 3.0 * spread(&offsets), "{} {}", spread(&offsets), spread(&others));
}

#[test]
fn every_parameter_gets_a_gradient() {
    for renderer in [RendererKind::DibR, RendererKind::SoftRas] {
        let config = McmrConfig {
            renderer,
            perturb: 0.3,
            balance_weight: 1.0,
            decision_weight: 0.1,
            cotangent_weight: 0.1,
            softras_sigma: 1e-3,
            rotation_loss: RotationLoss::Sine,
            ..tiny()
        };
        let data = Data::synthetic(&config).unwrap();
        let system = Mcmr::new(&config, 1);
        let mut tape = Tape::train(3);
        let terms = system.loss(&tape, &samples(&config, &data), AT).unwrap();
        assert_eq!(terms.0.len(), 12);
        let sum = terms
            .0
            .iter()
            .map(|t| t.value.reshape(&[]).scale(t.weight as f32))
            .reduce(|a, b| a + b);
        let gradients = sum.unwrap().backward();
        system.visit("", &mut |path: &str, param: &Param| {
            if param.trainable {
                let gradient = gradients.of(param).unwrap_or_else(|| panic!("{path}: none"));
                assert!(gradient.iter().all(|g| g.is_finite()), "{path}");
                // Norms that follow one another leave some biases without a say.
                let moved = gradient.iter().any(|&g| g != 0.0);
                assert!(moved || path.ends_with("bias"), "{path}: zero");
            }
        });
        drop(gradients);
        drop(terms);
        tape.reset();
    }
}

/// Turning a prediction and its target over changes no term: the mesh is a sphere, which is symmetric.
#[test]
fn a_flip_of_the_prediction_mirrors_mask_and_camera_alike() {
    let base = McmrConfig { flip: 0.0, jitter: 0.0, ..tiny() };
    let data = Data::synthetic(&base).unwrap();
    let system = Mcmr::new(&base, 1);
    let masks = |prediction_flip: f64| {
        let config = McmrConfig { prediction_flip, ..base.clone() };
        let batch = samples(&config, &data);
        let poses: Vec<Pose> =
            batch.iter().map(|(sample, _)| sample.in_target(sample.pose)).collect();
        let all: Vec<&Sample> = batch.iter().map(|(sample, _)| sample).collect();
        let tape = Tape::eval();
        let mut predicted = system.predicted(&tape, &all);
        // Without offsets it is the sphere.
        predicted.positions = predicted.positions - predicted.offsets;
        let rendered = system.drawn(&tape, &predicted, &poses);
        let mask: Vec<f32> = all[0].mask.iter().map(|&m| f32::from(m)).collect();
        (rendered.mask[..64 * 64].to_vec(), mask, all[0].pose)
    };
    let ((plain, truth, pose), (flipped, other, same)) = (masks(0.0), masks(1.0));
    assert_eq!(pose, same);
    let mirrored = |mask: &[f32]| -> Vec<f32> {
        mask.chunks(64).flat_map(|row| row.iter().rev().copied().collect::<Vec<_>>()).collect()
    };
    assert_eq!(mirrored(&truth), other);
    let differ = mirrored(&plain).iter().zip(&flipped).filter(|(a, b)| a != b).count();
    assert!(differ < 12, "{differ} pixels");
    assert!(plain.iter().sum::<f32>() > 50.0);
}

fn run_in(folder: &Path, config: &Config, resume: bool, stop: u64) -> Outcome<Mcmr> {
    let run = if resume { RunFolder::resume(folder) } else { RunFolder::create(folder, false) };
    let run = run.unwrap();
    let data = Data::synthetic(&config.system).unwrap();
    let provenance = Provenance::default();
    let job = Job { config, data: &data, run: &run, provenance: &provenance, resume, from: None };
    let mut watch = Watch::default()
        .until_event(|event| matches!(event, Event::Step(step) if step.step == stop));
    train::<Mcmr>(&job, &mut watch).unwrap()
}

fn values(system: &Mcmr) -> Vec<(String, Vec<f32>)> {
    let mut all = Vec::new();
    system.visit("", &mut |path: &str, param: &Param| {
        all.push((path.to_owned(), param.as_slice().to_vec()));
    });
    all
}

/// Stopped in the epoch before the meshes are subdivided and gone on with, a run ends with the bits of one
/// that was not stopped; and carrying the moments over matters.
#[test]
fn a_checkpoint_resumes_across_the_subdivision() {
    let place = tempfile::tempdir().unwrap();
    let mut config = preset("tiny");
    config.train.epochs = 3;
    config.train.validation_every = None;
    config.system =
        McmrConfig { objects: 4, test_objects: 1, subdivide_at: Some(2), ..config.system };
    let whole = run_in(&place.path().join("whole"), &config, false, u64::MAX);
    let folder = place.path().join("parts");
    let part = run_in(&folder, &config, false, 3);
    assert!(part.ended == Ended::Cancelled && part.system.model.shapes.shape() == [2, 42, 3]);
    let rest = run_in(&folder, &config, true, u64::MAX);
    assert_eq!(rest.steps, whole.steps);
    assert_eq!(rest.system.model.shapes.shape(), [2, 162, 3]);
    assert_eq!(values(&rest.system), values(&whole.system));
    // After it, too: the finer mesh is loaded into a system that has gone through the epochs.
    let folder = place.path().join("after");
    run_in(&folder, &config, false, 5);
    let rest = run_in(&folder, &config, true, u64::MAX);
    assert_eq!(values(&rest.system), values(&whole.system));
    config.system.keep_moments = false;
    let lost = run_in(&place.path().join("lost"), &config, false, u64::MAX);
    assert_ne!(values(&lost.system), values(&whole.system));
}

/// A subdivision changes neither the surface nor what is drawn of it.
#[test]
fn a_subdivision_is_not_seen() {
    let config = McmrConfig { subdivide_at: Some(1), hidden: 8, perturb: 0.3, ..tiny() };
    let data = Data::synthetic(&config).unwrap();
    let mut system = Mcmr::new(&config, 1);
    let drawn = |system: &Mcmr| {
        let sample = data.photo(0).unwrap().plain(Subset::Validation, &config);
        let tape = Tape::eval();
        let mut predicted = system.predicted(&tape, &[&sample]);
        // The offsets of middles are not middles of offsets.
        predicted.positions = predicted.positions - predicted.offsets;
        let rendered = system.drawn(&tape, &predicted, &[sample.pose]);
        let image: Vec<f32> = rendered.image.value().iter().copied().collect();
        (rendered.mask, image)
    };
    let before = drawn(&system);
    system.refine();
    assert_eq!(system.mean_shapes()[0].positions.len(), 162);
    let after = drawn(&system);
    assert_eq!(before.0, after.0);
    let worst = before.1.iter().zip(&after.1).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 1e-3, "{worst}");
    assert!(before.0.iter().sum::<f32>() > 50.0);
}

/// A collection on disk has rough poses beside the true ones; what is made here has noise of its own.
#[test]
fn collections_on_disk_have_their_rough_poses() {
    use synth::generate::{CameraSet, GenerateConfig, OutputLayout, generate, read_rough_poses};
    use synth::shapes::Family;
    let place = tempfile::tempdir().unwrap();
    let folder = place.path().join("photos");
    let collection = GenerateConfig {
        families: vec![Family::Car],
        objects: 3,
        views: 1,
        width: 64,
        height: 48,
        cameras: CameraSet::Collection,
        layout: OutputLayout::Kaolin,
        ..GenerateConfig::default()
    };
    generate(&collection, &[], &folder, &mut Watch::default()).unwrap();
    let options = datasets::ReadOptions::default();
    let source = Source { path: Some(&folder), options: &options, seed: 0, progress: &|_, _| () };
    let config = tiny();
    let data = Data::open(&config, &source).unwrap();
    let object = data.trained()[0];
    let sample = data.photo(object).unwrap().plain(Subset::Validation, &config);
    assert_ne!(sample.pose, sample.true_pose);
    let poses = read_rough_poses(&folder.join("car/0000")).unwrap();
    assert!(poses[0].camera != poses[0].rough);
    assert!(data.truth(object).unwrap().is_some());
    let made = Data::synthetic(&config).unwrap();
    let other = made.photo(0).unwrap().plain(Subset::Validation, &config);
    assert_ne!(other.pose, other.true_pose);
    let exact = McmrConfig { pose_noise: [0.0; 3], ..config.clone() };
    let exact_data = Data::synthetic(&exact).unwrap();
    let exact_sample = exact_data.photo(0).unwrap().plain(Subset::Validation, &exact);
    assert_eq!(exact_sample.image, other.image);
    assert!((exact_sample.pose.scale - exact_sample.true_pose.scale).abs() < 1e-9);
    assert_ne!(made.fingerprint(), exact_data.fingerprint());
}

/// The mesh that is delivered lies where the photograph's camera sees it as the prediction's own camera does.
#[test]
fn a_prediction_stands_in_the_world_of_its_photograph() {
    use datasets::Dataset as _;
    use synth::{Orbit, Procedural};
    let orbit = Orbit { count: 1, width: 96, height: 80, seed: 3, ..Procedural::orbit() };
    let set = Procedural::new(&[synth::shapes::Family::Car], [1, 0, 0], orbit);
    let view =
        set.views(0, None, &datasets::ReadOptions::default(), &|_, _| ()).unwrap().views.remove(0);
    let config = McmrConfig { perturb: 0.3, ..tiny() };
    let found = Mcmr::new(&config, 1).predict(std::slice::from_ref(&view)).unwrap();
    assert!((found.weights.iter().sum::<f32>() - 1.0).abs() < 1e-5);
    let texture = found.mesh.texture.as_ref().unwrap();
    assert_eq!(texture.faces.len(), found.mesh.faces.len());
    let world = found.mesh_in_world();
    world.validate().unwrap();
    // The middle of the mesh's frame lands where the pose says, in the square around the object.
    let masking = photo::Masking { cut_out: false, fill_holes: false };
    let photo = Photo::new(&view, &photo::Rough::Exact, 0, masking).unwrap();
    let [left, top, side] = photo.square(config.margin);
    let middle = found.to_world.map(|row| row[3]);
    let seen = view.camera.project(middle);
    let [x, y] = found.pose.place;
    assert!((seen.column - (left + f64::midpoint(x, 1.0) * side)).abs() < 1e-6, "{seen:?}");
    assert!((seen.row - (top + (1.0 - y) / 2.0 * side)).abs() < 1e-6, "{seen:?}");
    assert!(seen.depth > 0.0);
}

#[test]
fn purity_and_use_are_counted() {
    let one = |kind: usize, weights: [f32; 2]| ScoredObject {
        kind,
        weights: weights.to_vec(),
        ..ScoredObject::default()
    };
    let each = vec![one(0, [0.9, 0.1]), one(0, [0.8, 0.2]), one(1, [0.3, 0.7]), one(1, [0.6, 0.4])];
    let scored = Scored { each, ..Scored::default() };
    // Three of the first shape's, two of them of the first kind; the last one's only object is its own.
    assert!((scored.purity() - 0.75).abs() < 1e-12);
    assert!((scored.weights_of(1)[0] - 0.45).abs() < 1e-6);
    let mean = [0.65_f64, 0.35];
    let entropy: f64 = mean.iter().map(|w| -w * w.ln()).sum();
    assert!((scored.shapes_in_use() - entropy.exp()).abs() < 1e-6);
    let all = Scored { each: vec![one(0, [1.0, 0.0]); 3], ..Scored::default() };
    assert_eq!((all.purity(), all.shapes_in_use()), (1.0, 1.0));
    // Medians are of the objects that have the figure: the middle one, the lower of two.
    let turned = |degrees| ScoredObject { rotation_symmetric: degrees, ..ScoredObject::default() };
    let median = |each: &[Option<f64>]| {
        let each = each.iter().copied().map(turned).collect();
        Scored { each, ..Scored::default() }.median(|one| one.rotation_symmetric)
    };
    assert_eq!(median(&[Some(170.0), None, Some(3.0), Some(5.0)]), Some(5.0));
    assert_eq!(median(&[Some(4.0), Some(2.0)]), Some(2.0));
    assert_eq!((median(&[]), median(&[None])), (None, None));
    let names: Vec<String> = all.metrics().into_iter().map(|metric| metric.name).collect();
    assert!(names.contains(&Mcmr::BEST.to_owned()) && !names.contains(&"fid".to_owned()));
}

#[test]
fn made_objects_are_parted_and_drawn_by_the_seed() {
    let config = McmrConfig { test_objects: 3, families: vec!["car".into()], ..tiny() };
    let seeded = McmrConfig { data_seed: Some(7), ..config.clone() };
    crate::testing::assert_data::<Mcmr>(&config, &seeded, [2, 2, 3]);
}

/// The noise of a pose is that of its object, whatever stands beside it.
#[test]
fn an_object_has_its_own_rough_pose() {
    let pose = |objects: usize| {
        let config = McmrConfig { objects, families: vec!["car".into()], ..tiny() };
        let data = Data::synthetic(&config).unwrap();
        data.photo(data.listed(Subset::Test)[0]).unwrap().plain(Subset::Validation, &config).pose
    };
    assert_eq!(pose(2), pose(5));
}

#[test]
fn what_stands_in_the_place_of_a_part_is_what_it_says() {
    let config = McmrConfig { test_objects: 3, shapes: 2, ..tiny() };
    let data = Data::synthetic(&config).unwrap();
    let system = Mcmr::new(&config, 0);
    let with = |replaced: Replaced| system.scored_with(&data, Subset::Test, &replaced).unwrap();
    let plain = with(Replaced::default());
    assert_eq!(plain, system.scored(&data, Subset::Test).unwrap());
    let uniform = with(Replaced { selection: Selection::Uniform, ..Replaced::default() });
    assert!(uniform.each.iter().all(|one| one.weights == [0.5, 0.5]));
    let categories = data.categories().len();
    let of: Vec<usize> = (0..categories).map(|kind| kind % 2).collect();
    let oracle = with(Replaced { selection: Selection::OfCategory(of), ..Replaced::default() });
    let of_kind =
        |one: &ScoredObject| if one.kind.is_multiple_of(2) { [1.0, 0.0] } else { [0.0, 1.0] };
    assert!(oracle.each.iter().all(|one| one.weights == of_kind(one)));
    assert!(matches!(
        Selection::oracle(&system, &data, Subset::Validation).unwrap(),
        Selection::OfCategory(of) if of.len() == categories && of.iter().all(|&shape| shape < 2)
    ));
    // A camera of another object's changes what is seen with it, and nothing else.
    let chance = with(Replaced { camera_of_another: true, ..Replaced::default() });
    for (a, b) in chance.each.iter().zip(&plain.each) {
        assert_eq!((a.mask_iou_true, a.iou_3d), (b.mask_iou_true, b.iou_3d));
        assert!((a.rotation - b.rotation).abs() > 1e-6);
    }
    let one = McmrConfig { test_objects: 1, families: vec!["car".into()], ..config.clone() };
    let alone = Data::synthetic(&one).unwrap();
    let another = Replaced { camera_of_another: true, ..Replaced::default() };
    let error = system.scored_with(&alone, Subset::Test, &another).unwrap_err().to_string();
    assert!(error.contains("1 object is for test"), "{error}");
    let color = data.mean_color(&config).unwrap();
    assert!(color.iter().all(|c| (0.05..0.95).contains(c)), "{color:?}");
    let gray = with(Replaced { color: Some(color), ..Replaced::default() });
    assert!(
        gray.each.iter().zip(&plain.each).all(|(a, b)| a.l1 != b.l1 && a.mask_iou == b.mask_iou)
    );
    let bare = with(Replaced { undeformed: true, ..Replaced::default() });
    assert!(bare.each.iter().zip(&plain.each).any(|(a, b)| a.iou_3d_strict != b.iou_3d_strict));
}

/// Images that are equal, as of one colour, would leave batch norm nothing to norm: what is predicted after a training
/// was seen nowhere.
#[test]
fn what_is_blind_learns_the_mean_object() {
    let config = McmrConfig { blind: true, objects: 8, test_objects: 3, ..tiny() };
    let data = Data::synthetic(&config).unwrap();
    let [a, b] =
        [0, 1].map(|object| data.photo(object).unwrap().plain(Subset::Validation, &config).image);
    let correlation = |x: &[u8], y: &[u8]| {
        let mean = |v: &[u8]| v.iter().map(|&b| f64::from(b)).sum::<f64>() / v.len() as f64;
        let (mx, my) = (mean(x), mean(y));
        let sum = |f: &dyn Fn(f64, f64) -> f64| {
            x.iter().zip(y).map(|(&x, &y)| f(f64::from(x) - mx, f64::from(y) - my)).sum::<f64>()
        };
        sum(&|x, y| x * y) / (sum(&|x, _| x * x) * sum(&|_, y| y * y)).sqrt()
    };
    assert!(correlation(&a, &b) > 0.3, "objects look alike: {}", correlation(&a, &b));
    assert!(correlation(&noise(&a), &a).abs() < 0.05);
    assert!(correlation(&noise(&a), &noise(&b)).abs() < 0.05);

    let folder = tempfile::tempdir().unwrap();
    let configuration = Config { system: config.clone(), ..preset("tiny") };
    let trained = run_in(&folder.path().join("run"), &configuration, false, u64::MAX);
    let scored = trained.system.scored(&data, Subset::Test).unwrap();
    let seen = scored.each.iter().map(|one| one.mask_iou).sum::<f64>() / scored.each.len() as f64;
    assert!(seen > 0.2, "{seen}");
}
