#![allow(clippy::unwrap_used, reason = "tests")]

use autodiff_lite::{Module, Param};
use datasets::{Catalog, Dataset, Entry, Layout, ReadOptions, ReadViewsError, Views};
use mesh_core::primitives::icosphere;
use synth::{Orbit, RenderOptions, render_views};
use train::progress::Watch;
use train::{Better, Configuration, Job, Provenance, RunFolder, train};

use super::*;

type Config = Configuration<Img2MeshConfig>;

pub(super) fn tiny() -> Img2MeshConfig {
    Img2MeshConfig {
        features: 16,
        image_size: 16,
        render_size: 16,
        feed_forward: 16,
        level: 1,
        silhouette: SilhouetteKind::Antialiased,
        ..Img2MeshConfig::default()
    }
}

/// Views of a red ellipsoid.
pub(super) fn ellipsoid(radii: [f32; 3], count: usize, side: usize) -> Views {
    let mesh = icosphere(3).scaled(radii).colored([0.9, 0.2, 0.1]);
    let orbit = Orbit { count, width: side, height: side, ..Orbit::default() };
    let views =
        render_views(&mesh, &orbit.cameras(), &RenderOptions::default(), &|_, _| ()).unwrap();
    Views::in_memory(views)
}

#[test]
fn presets_are_in_range_and_parameters_are_counted() {
    crate::testing::assert_presets::<Img2Mesh>();
    for (encoder, attention, freeze_encoder, coarse_levels) in [
        (EncoderKind::Small, AttentionKind::Views, false, 0),
        (EncoderKind::Small, AttentionKind::Mean, true, 1),
        (EncoderKind::Cnn, AttentionKind::Published, false, 0),
        (EncoderKind::None, AttentionKind::Mean, false, 1),
    ] {
        let more = Img2MeshConfig { freeze_encoder, coarse_levels, ..tiny() };
        let config = Img2MeshConfig { encoder, attention, camera_embedding: true, ..more };
        let system = Img2Mesh::new(&config, 0);
        let summary = config.summary();
        assert_eq!(system.parameter_count(), summary.trainable, "{encoder:?}");
        let mut all = 0;
        system.visit("", &mut |_: &str, param: &Param| all += param.value.len());
        assert_eq!(all, summary.trainable + summary.frozen, "{encoder:?}");
    }
    for stages in [1, 2] {
        let config = Img2MeshConfig { stages, vertex_features: 8, vertex_heads: 2, ..tiny() };
        assert_eq!(Img2Mesh::new(&config, 0).parameter_count(), config.summary().trainable);
    }
    // The base model: VGG16 with one linear layer, counted without making its 134 million numbers.
    let base = Img2MeshConfig { encoder: EncoderKind::Vgg16, freeze_encoder: true, ..tiny() };
    let base = Img2MeshConfig { image_size: 64, ..base };
    assert_eq!(base.summary().frozen, 14_714_688 + 25_089 * 4096 + 4);
    // VGG16 to its third pool, and the four convolutions behind it.
    let cnn = Img2MeshConfig { encoder: EncoderKind::Cnn, ..tiny() };
    let head = Img2MeshConfig { features: cnn.width(), ..tiny() };
    let small = 387_936 + 960 + cnn.width() * 4099;
    let [cnn, head] = [cnn, head].map(|config| config.summary().trainable);
    assert_eq!(cnn, head - small + 1_735_488 + 157_369);
    // As many heads as the widest encoder has features.
    let wide = Img2MeshConfig { encoder: EncoderKind::Cnn, image_size: 1024, ..tiny() };
    let wide = Img2MeshConfig { heads: wide.width(), ..wide };
    assert_eq!(wide.check(), Vec::<String>::new());
    let wrong = Img2MeshConfig { heads: 3, level: 9, mask_weight: f64::NAN, ..tiny() };
    let problems = wrong.check().join("; ");
    for field in ["`heads`", "`level`", "`mask-weight`"] {
        assert!(problems.contains(field), "{problems}");
    }
}

#[test]
fn every_parameter_gets_a_gradient() {
    for (encoder, attention, stages) in [
        (EncoderKind::Small, AttentionKind::Views, 0),
        (EncoderKind::Small, AttentionKind::Views, 2),
        (EncoderKind::Small, AttentionKind::Published, 0),
        (EncoderKind::Cnn, AttentionKind::Mean, 0),
    ] {
        let config = Img2MeshConfig {
            stages,
            vertex_features: 8,
            bending_weight: 1e-3,
            encoder,
            attention,
            camera_embedding: true,
            extra_views: 1,
            dropout: 0.0,
            ..tiny()
        };
        let data = Data::one(&ellipsoid([1.0, 0.6, 0.8], 8, 24), &config).unwrap();
        let mut system = Img2Mesh::new(&config, 1);
        system.init_from_data(&data, None).unwrap();
        let batch: Vec<Sample> = (0..2)
            .map(|item| {
                let draw = Draw { seed: 0, epoch: 0, index: item as u64, item };
                system.draw(&data, &draw).unwrap()
            })
            .collect();
        // Offsets of a new stage, and what its colours count, begin at zero, and let no gradient through.
        system.visit_mut("", &mut |path: &str, param: &mut Param| {
            if path.starts_with("stages") {
                let values = param.as_slice_mut().iter_mut().enumerate();
                values.for_each(|(i, x)| *x += 0.1 * (i as f32).sin());
            }
        });
        let tape = Tape::train(0);
        let terms = system.loss(&tape, &batch, StepInfo { step: 0, epoch: 0 }).unwrap();
        let total = terms.0.iter().map(|t| t.value.scale(t.weight as f32)).reduce(|a, b| a + b);
        let gradients = total.unwrap().backward();
        system.visit("", &mut |path: &str, param: &Param| {
            if param.trainable {
                let gradient = gradients.slice_of(param).unwrap_or_default();
                let found = gradient.iter().any(|&g| g != 0.0) && gradients.is_finite();
                assert!(found, "{encoder:?} {attention:?}: no gradient for {path}");
            }
        });
    }
}

/// A few seconds of training on silhouettes and colours beat the sphere that it began with by far.
#[test]
fn a_tiny_training_finds_the_shape() {
    let place = tempfile::tempdir().unwrap();
    let mut config = Config { system: tiny(), ..Config::default() };
    config.system.dropout = 0.0;
    config.system.image_weight = 1.0;
    (config.train.epochs, config.train.batch, config.train.shards) = (20, 4, 2);
    (config.train.learning_rate, config.train.validation_every) = (2e-3, None);
    let data = Data::one(&ellipsoid([1.2, 0.5, 0.8], 40, 32), &config.system).unwrap();
    let mut fresh = Img2Mesh::new(&config.system, 0);
    fresh.init_from_data(&data, None).unwrap();
    let before = fresh.evaluate(&data, Subset::Validation).unwrap();
    let run = RunFolder::create(&place.path().join("run"), false).unwrap();
    let provenance = Provenance::default();
    let job = Job {
        config: &config,
        data: &data,
        run: &run,
        provenance: &provenance,
        resume: false,
        from: None,
    };
    let outcome = train::<Img2Mesh>(&job, &mut Watch::default()).unwrap();
    let after = &outcome.metrics;
    assert_eq!((after[0].name.as_str(), after[0].better), ("mask-iou", Better::Larger));
    // From 0.66 and 8.6 dB to 0.93 and 15.9 dB.
    assert!(after[0].value > before[0].value + 0.2, "{before:?} {after:?}");
    assert!(after[0].value > 0.9 && after[2].value > before[2].value + 5.0, "{before:?} {after:?}");
    // Any number of views, any size of image.
    let views = ellipsoid([1.2, 0.5, 0.8], 9, 40).views;
    for count in [1, 3, 8] {
        let mesh = outcome.system.predict(&views[..count]).unwrap();
        assert_eq!(mesh.positions.len(), 42);
        // Longer along x than along y, as a whole, where the sphere is as long: even one view, which
        // it never saw in training, is understood.
        let spread = |k: usize| -> f32 {
            let values = || mesh.positions.iter().map(|p| p[k]);
            let mean = values().sum::<f32>() / 42.0;
            values().map(|x| (x - mean).powi(2)).sum::<f32>().sqrt()
        };
        assert!(spread(0) > 1.6 * spread(1), "{count} views: {} {}", spread(0), spread(1));
    }
    assert!(outcome.system.predict(&[]).is_err());
    assert_eq!(outcome.system.evaluate_with(&data, Subset::Test, 3).unwrap().len(), 3);
    let page = std::fs::read_to_string(place.path().join("run/report.html")).unwrap();
    assert!(page.contains("mask-iou"));
}

/// Ellipsoids of several shapes, in memory.
#[derive(Debug)]
struct Ellipsoids(Catalog);

impl Dataset for Ellipsoids {
    fn catalog(&self) -> &Catalog {
        &self.0
    }

    fn views(
        &self,
        object: usize,
        which: Option<&[usize]>,
        _: &ReadOptions,
        _: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Views, ReadViewsError> {
        let mut views = ellipsoid([1.0, 0.5 + 0.1 * object as f32, 0.8], 5, 20);
        if let Some(which) = which {
            views.views = which.iter().map(|&i| views.views[i].clone()).collect();
        }
        Ok(views)
    }
}

#[test]
fn many_objects_are_split_by_their_layout_or_by_us() {
    use datasets::Subset as Listed;
    let entries = |subset: fn(usize) -> Option<Listed>| {
        let entry = |k: usize| Entry {
            name: k.to_string(),
            views: 5,
            subset: subset(k),
            ..Entry::default()
        };
        let entries = (0..6).map(entry).collect();
        Box::new(Ellipsoids(Catalog { entries, ..Catalog::new(Layout::Memory, "memory") }))
    };
    let config = Img2MeshConfig { hold_out: Some(3), ..tiny() };
    let open = |dataset| Data::many(dataset, ReadOptions::default(), &config).unwrap();
    let data = open(entries(|_| None));
    let all = Subset::ALL.map(|subset| data.listed(subset).len());
    assert!(all.iter().sum::<usize>() == 6 && all.iter().all(|&size| size > 0), "{all:?}");
    assert_eq!(Img2Mesh::data_summary(&data).unwrap().sizes, all);
    let of = |k: usize| Some([Listed::Train, Listed::Test, Listed::Validation][k.min(3) % 3]);
    let data = open(entries(of));
    assert_eq!(Subset::ALL.map(|subset| data.listed(subset)), [&[0, 3, 4, 5][..], &[2], &[1]]);
    let system = Img2Mesh::new(&config, 0);
    assert_eq!(system.epoch_len(&data), 4);
    let draw = Draw { seed: 1, epoch: 0, index: 0, item: 2 };
    let sample = system.draw(&data, &draw).unwrap();
    let again = system.draw(&data, &draw).unwrap();
    assert_eq!(Img2Mesh::name_of(&sample), Img2Mesh::name_of(&again));
    assert!(Img2Mesh::name_of(&sample).contains("4 view"), "{}", Img2Mesh::name_of(&sample));
    for subset in Subset::ALL {
        let metrics = system.evaluate(&data, subset).unwrap();
        assert!(metrics[0].value > 0.0);
        crate::parts::tests::assert_means(&metrics, data.listed(subset).len());
    }
    let greedy = Img2MeshConfig { views: 9, ..config.clone() };
    // Nothing can be learned with so many, but what was learned can be scored.
    let few = Data::many(entries(|_| None), ReadOptions::default(), &greedy).unwrap();
    let error = Img2Mesh::new(&greedy, 0).init_from_data(&few, None).unwrap_err().to_string();
    assert!(error.contains("5 views") && error.contains('9'), "{error}");
    assert!(system.evaluate_with(&few, Subset::Test, 9).is_ok());
}

/// What `vary-views` draws depends on the step alone, and reaches from one view to all.
#[test]
fn the_number_of_views_varies_from_step_to_step() {
    let system = Img2Mesh::new(&Img2MeshConfig { views: 3, vary_views: true, ..tiny() }, 4);
    let given = |step: u64| system.given(StepInfo { step, epoch: 0 });
    let counts: Vec<usize> = (0..200).map(given).collect();
    assert_eq!(counts, (0..200).map(given).collect::<Vec<_>>());
    for k in 1..=3 {
        let share = counts.iter().filter(|&&count| count == k).count();
        assert!((40..100).contains(&share), "{k} views {share} times of 200");
    }
}

/// The first VGG16 layers from a file under torchvision's names; what is frozen stays so, bit by
/// bit, through training, and its features are computed once.
#[test]
fn pretrained_weights_are_loaded_and_frozen_ones_stay() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("vgg16.safetensors");
    let vgg = nets::Vgg16::<f32>::features_until_pool(&nets::Init::new(77), 4);
    autodiff_lite::state::save(&path, &vgg).unwrap();
    let mut config = Config { system: tiny(), ..Config::default() };
    config.system = Img2MeshConfig {
        encoder: EncoderKind::Cnn,
        freeze_encoder: true,
        weights: Some(path.display().to_string()),
        image_size: 32,
        ..config.system
    };
    (config.train.epochs, config.train.batch, config.train.max_steps) = (2, 2, Some(4));
    config.train.validation_every = None;
    let data = Data::one(&ellipsoid([1.2, 0.5, 0.8], 12, 24), &config.system).unwrap();
    let folder = place.path().join("run");
    let run = RunFolder::create(&folder, false).unwrap();
    let provenance = Provenance::default();
    let job = Job {
        config: &config,
        data: &data,
        run: &run,
        provenance: &provenance,
        resume: false,
        from: None,
    };
    let trained = train::<Img2Mesh>(&job, &mut Watch::default()).unwrap().system;
    let mut found = 0;
    trained.visit("", &mut |path: &str, param: &Param| {
        if let Some(name) = path.strip_prefix("encoder.cnn.features.") {
            let (index, which) = name.split_once('.').unwrap();
            let (_, conv) = vgg.features.0.iter().find(|(i, _)| i.to_string() == index).unwrap();
            let bias = conv.bias.as_ref().unwrap();
            let expected = if which == "weight" { &conv.weight } else { bias };
            assert_eq!(param.as_slice(), expected.as_slice(), "{path}");
            found += 1;
        }
    });
    assert_eq!(found, 14);
    // A system that was loaded from the checkpoint needs no file, and agrees.
    std::fs::remove_file(&path).unwrap();
    let last = run.last();
    let (loaded, _) = train::Checkpoint::read(&last).unwrap().load::<Img2Mesh>().unwrap();
    let views = ellipsoid([1.2, 0.5, 0.8], 3, 24).views;
    let [a, b] = [&trained, &loaded].map(|system| system.predict(&views).unwrap().positions);
    assert_eq!(a, b);
    let mut fresh = Img2Mesh::new(&config.system, 0);
    let error = fresh.init_from_data(&data, None).unwrap_err().to_string();
    assert!(error.contains("vgg16.safetensors"), "{error}");
    // Nor does one that begins with weights of its encoder, but with others it does.
    let mut inherited = train::Inherited::default();
    fresh.init_from_data(&data, Some(&inherited)).unwrap_err();
    inherited.parts.insert("encoder".into());
    fresh.init_from_data(&data, Some(&inherited)).unwrap();
}

/// Features that are kept give the same bits as an encoder that is run each time.
#[test]
fn kept_features_change_nothing() {
    let config = Img2MeshConfig { dropout: 0.0, ..tiny() };
    let frozen = Img2MeshConfig { freeze_encoder: true, ..config.clone() };
    let views = ellipsoid([1.0, 0.6, 0.8], 5, 24);
    let data = Data::one(&views, &Img2MeshConfig { hold_out: None, ..config.clone() }).unwrap();
    let [run, kept] = [config, frozen].map(|config| {
        let mut system = Img2Mesh::new(&config, 3);
        system.init_from_data(&data, None).unwrap();
        // Twice: the second time from what was kept.
        let meshes = [(); 2].map(|()| system.predict(&views.views[..1]).unwrap().positions);
        assert_eq!(meshes[0], meshes[1]);
        meshes[0].clone()
    });
    assert_eq!(run, kept);
}

/// Finer levels come in by epochs, and a loaded system has those that its run had.
#[test]
fn levels_come_in_by_epochs() {
    let config = Img2MeshConfig { coarse_levels: 1, refine_every: Some(2), ..tiny() };
    let mut system = Img2Mesh::new(&config, 0);
    let active = [0, 1, 2, 5].map(|epoch| {
        system.activate_levels(epoch);
        system.model.mesh_fc.active
    });
    assert_eq!(active, [1, 1, 2, 2]);
    let all_at_once = Img2Mesh::new(&Img2MeshConfig { coarse_levels: 1, ..tiny() }, 0);
    assert_eq!(all_at_once.model.mesh_fc.active, 2);
}

/// More views of an object are the same ones and others, scored at the same cameras.
#[test]
fn trials_of_many_objects_are_nested() {
    let config = Img2MeshConfig {
        objects: Some(2),
        test_objects: 1,
        families: vec!["car".into(), "lamp".into()],
        synthetic_views: 12,
        ..tiny()
    };
    let data = Data::synthetic(&config).unwrap();
    let sizes = Subset::ALL.map(|subset| data.listed(subset).len());
    assert_eq!((sizes, data.trials(Subset::Test, 3).unwrap()), ([4, 2, 2], 6));
    let names = |views: &[Arc<Prepared>]| -> Vec<String> {
        views.iter().map(|view| view.name.clone()).collect()
    };
    let trial = |views, k| data.trial(&config, (Subset::Test, views), k).unwrap();
    let [one, three] = [1, 3].map(|views| trial(views, 1));
    assert_eq!(names(&one.given)[..], names(&three.given)[..1]);
    assert_eq!((names(&one.scored), three.scored.len()), (names(&three.scored), 8));
    assert!(names(&three.scored).iter().all(|name| !names(&three.given).contains(name)));
    assert!(one.truth.is_some());
    let other = trial(3, 3);
    assert_ne!(names(&other.given), names(&three.given));
    let metrics = Img2Mesh::new(&config, 0).evaluate(&data, Subset::Test).unwrap();
    assert_eq!(metrics.last().unwrap().name, "folded");
    let none = Img2MeshConfig { families: vec!["cat".into()], ..config };
    assert!(none.check().join(" ").contains("cat"));
}

/// Groups that share views may be read at the same time, on any thread, and are the same.
#[test]
fn groups_read_at_the_same_time_are_their_own() {
    use rayon::prelude::*;
    let config = Img2MeshConfig {
        objects: Some(1),
        test_objects: 1,
        families: vec!["car".into()],
        synthetic_views: 10,
        ..tiny()
    };
    let names = |data: &Data, k: usize| -> Vec<String> {
        let trial = data.trial(&config, (Subset::Test, 2), k % 3).unwrap();
        trial.given.iter().chain(&trial.scored).map(|view| view.name.clone()).collect()
    };
    let alone = Data::synthetic(&config).unwrap();
    let expected: Vec<Vec<String>> = (0..3).map(|k| names(&alone, k)).collect();
    for _ in 0..5 {
        let data = Data::synthetic(&config).unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(6).build().unwrap();
        let found: Vec<Vec<String>> =
            pool.install(|| (0..12).into_par_iter().map(|k| names(&data, k)).collect());
        for (k, found) in found.iter().enumerate() {
            assert_eq!(*found, expected[k % 3]);
        }
    }
}

#[test]
fn made_objects_are_parted_and_drawn_by_the_seed() {
    let config = Img2MeshConfig {
        objects: Some(3),
        test_objects: 3,
        families: vec!["car".into(), "lamp".into()],
        synthetic_views: 6,
        ..tiny()
    };
    let seeded = Img2MeshConfig { data_seed: Some(7), ..config.clone() };
    crate::testing::assert_data::<Img2Mesh>(&config, &seeded, [6, 4, 6]);
    let said = Img2MeshConfig { validation_objects: Some(1), ..config };
    let sizes = Img2Mesh::data_summary(&crate::testing::made::<Img2Mesh>(&said, 0)).unwrap().sizes;
    assert_eq!(sizes, [6, 2, 6]);
}

/// An object that is for tests and stands in the list for training too, under the name of another of its views.
#[test]
fn a_planted_leak_is_found() {
    use datasets::Subset as Listed;
    let entry = |name: &str, subset| Entry {
        category: "chair".into(),
        name: name.into(),
        views: 5,
        subset: Some(subset),
    };
    let open = |planted: &str| {
        let entries = vec![
            entry("0/00", Listed::Train),
            entry("1/00", Listed::Validation),
            entry("2/00", Listed::Test),
            entry(planted, Listed::Train),
        ];
        let catalog = Catalog { entries, ..Catalog::new(Layout::Memory, "memory") };
        Data::many(Box::new(Ellipsoids(catalog)), ReadOptions::default(), &tiny())
    };
    assert!(open("3/00").is_ok());
    let error = open("2/01").unwrap_err();
    let DataError::Read(source) = &error else { panic!("{error}") };
    let leak = source.downcast_ref::<datasets::LeakError>().unwrap();
    assert_eq!((&*leak.object, leak.subsets), ("chair/2", [Listed::Train, Listed::Test]));
    assert!(error.to_string().contains("chair/2"), "{error}");
    // By one's own validation is chosen: that is a leak as well.
    let DataError::Read(source) = open("1/03").unwrap_err() else { panic!() };
    let leak = source.downcast_ref::<datasets::LeakError>().unwrap();
    assert_eq!(leak.subsets, [Listed::Train, Listed::Validation]);
}

/// Data of which all is for tests can be scored, and not trained on.
#[test]
fn tests_alone_are_never_trained_on() {
    use datasets::Subset as Listed;
    let entry = |k: usize| Entry {
        name: k.to_string(),
        views: 5,
        subset: Some(Listed::Test),
        ..Entry::default()
    };
    let catalog =
        Catalog { entries: (0..3).map(entry).collect(), ..Catalog::new(Layout::Memory, "memory") };
    let dataset = Box::new(Ellipsoids(catalog));
    let config = Config { system: tiny(), ..Config::default() };
    let data = Data::many(dataset, ReadOptions::default(), &config.system).unwrap();
    let system = Img2Mesh::new(&config.system, 0);
    assert!(system.evaluate(&data, Subset::Test).is_ok());
    let error = system.evaluate(&data, Subset::Validation).unwrap_err().to_string();
    assert!(error.contains("for validation"), "{error}");
    let place = tempfile::tempdir().unwrap();
    let run = RunFolder::create(&place.path().join("run"), false).unwrap();
    let provenance = Provenance::default();
    let job = Job {
        config: &config,
        data: &data,
        run: &run,
        provenance: &provenance,
        resume: false,
        from: None,
    };
    let error = train::<Img2Mesh>(&job, &mut Watch::default()).unwrap_err();
    assert!(error.to_string().contains("nothing to train on"), "{error}");
}
