//! What both systems do.

#![allow(clippy::unwrap_used, reason = "tests")]

use autodiff_lite::{Param, Tape};
use mesh_core::TriMesh;
use nets::NormKind;
use train::{Configuration, Draw, StepInfo, System};

use super::*;
use crate::paired::PairsConfig;

pub(super) fn refine() -> RefineConfig {
    RefineConfig {
        pairs: PairsConfig {
            image_size: 32,
            scale: 1.0,
            points: 60,
            objects: 3,
            test_objects: 1,
            synthetic_views: 2,
            scored_views: 1,
            families: vec!["car".into()],
            ..PairsConfig::default()
        },
        depth: DepthKind::True,
        width: 4,
        hidden: 8,
        graph_convolutions: 2,
        colors: true,
        normal_weight: 0.1,
        depth_weight: 1.0,
        coverage: 0.1,
        ..RefineConfig::default()
    }
}

pub(super) fn sphere() -> SphereConfig {
    SphereConfig { refine: refine(), level: 0, ..SphereConfig::default() }
}

pub(super) fn voxels() -> VoxelConfig {
    VoxelConfig {
        refine: refine(),
        cells: 8,
        voxel_hidden: 8,
        voxel_convolutions: 1,
        ..VoxelConfig::default()
    }
}

#[test]
fn presets_are_in_range() {
    crate::testing::assert_presets::<DepthPixel2Mesh>();
    crate::testing::assert_presets::<MeshRcnn>();
}

/// The shapes of the poster's table, row by row.
#[test]
fn the_paper_preset_prints_the_posters_rows() {
    let (_, text) = MeshRcnn::PRESETS.iter().find(|(name, _)| *name == "paper").unwrap();
    let config: Configuration<VoxelConfig> = toml::from_str(text).unwrap();
    let shapes = MeshRcnn::summary(&config.system).shapes;
    let published = [
        ("input", "137 x 137 x 4"),
        ("conv2_3", "35 x 35 x 256"),
        ("conv3_4", "18 x 18 x 512"),
        ("conv4_6", "9 x 9 x 1024"),
        ("conv5_3", "5 x 5 x 2048"),
        ("bilinear", "24 x 24 x 2048"),
        ("voxel branch", "48 x 48 x 48"),
        ("cubify", "V x 3, F x 3"),
        ("stage 1", "V x 3, F x 3"),
        ("stage 2", "V x 3, F x 3"),
        ("stage 3", "V x 3, F x 3"),
    ];
    assert_eq!(shapes.len(), published.len());
    for (i, ((row, shape), (name, expected))) in shapes.iter().zip(published).enumerate() {
        assert!(row.starts_with(&format!("({})", i + 1)) && row.contains(name), "{row}: {name}");
        assert_eq!(shape, expected, "{row}");
    }
}

#[test]
fn numbers_are_counted_without_making_them() {
    fn counted<S: System>(config: &S::Config) {
        let (mut trained, mut all) = (0, 0);
        S::new(config, 0).visit("", &mut |_: &str, param: &Param| {
            all += param.len();
            trained += if param.trainable { param.len() } else { 0 };
        });
        let summary = S::summary(config);
        assert_eq!([trained, all], [summary.trainable, summary.trainable + summary.frozen]);
    }
    counted::<DepthPixel2Mesh>(&sphere());
    counted::<MeshRcnn>(&voxels());
    let told = RefineConfig { depth_residuals: true, ..refine() };
    counted::<MeshRcnn>(&VoxelConfig { refine: told, ..voxels() });
    let other = RefineConfig {
        backbone: BackboneKind::Resnet50,
        norm: NormKind::Frozen,
        depth: DepthKind::None,
        colors: false,
        stages: 2,
        ..refine()
    };
    counted::<MeshRcnn>(&VoxelConfig { refine: other, ..voxels() });
}

#[test]
fn what_is_out_of_range_is_named() {
    let wrong = VoxelConfig {
        cells: 7,
        prior: 1.0,
        refine: RefineConfig {
            depth: DepthKind::Estimated,
            depth_loss: DepthLossKind::Plain,
            reach: [1.5, 1.2],
            place: PlaceKind::Seen,
            depth_residuals: true,
            published_places: true,
            stages: 0,
            ..refine()
        },
        ..voxels()
    };
    let problems = MeshRcnn::check(&wrong).join("; ");
    for field in [
        "`cells`",
        "`prior`",
        "`depth-loss`",
        "`reach`",
        "`place`",
        "`depth-residuals`",
        "`stages`",
    ] {
        assert!(problems.contains(field), "{field}: {problems}");
    }
}

#[test]
fn kinds_of_depth_are_read_from_texts_and_switches() {
    let read = |text: &str| toml::from_str::<RefineConfig>(text).map(|config| config.depth);
    assert_eq!(read("depth = true").unwrap(), DepthKind::True);
    assert_eq!(read("depth = \"true\"").unwrap(), DepthKind::True);
    assert_eq!(read("depth = false").unwrap(), DepthKind::None);
    assert_eq!(read("depth = \"estimated\"").unwrap(), DepthKind::Estimated);
    let error = read("depth = \"measured\"").unwrap_err().to_string();
    assert!(error.contains("none, true or estimated"), "{error}");
}

/// A batch's terms by name, and the norm of each parameter's gradient.
#[allow(clippy::type_complexity, reason = "two lists")]
pub(super) fn step<S: System<Sample = Scene, Data = Scenes>>(
    system: &S,
    config: &RefineConfig,
    cells: usize,
) -> (Vec<(&'static str, f32)>, Vec<(String, f32)>) {
    let scenes = Scenes::synthetic(config, cells).unwrap();
    let draw = |i: u64| Draw { seed: 1, epoch: 0, index: i, item: i as usize };
    let batch: Vec<Scene> = (0..2).map(|i| system.draw(&scenes, &draw(i)).unwrap()).collect();
    let tape = Tape::train(0);
    let terms = system.loss(&tape, &batch, StepInfo { step: 3, epoch: 0 }).unwrap().0;
    let values = terms.iter().map(|term| (term.name, term.value.item())).collect();
    let total = terms.iter().map(|term| term.value.scale(term.weight as f32));
    let gradients = total.reduce(|a, b| a + b).unwrap().backward();
    let mut norms = Vec::new();
    system.visit("", &mut |path: &str, param: &Param| {
        if param.trainable {
            let gradient = gradients.slice_of(param).unwrap_or_default();
            norms.push((path.to_owned(), gradient.iter().map(|g| g * g).sum::<f32>()));
        }
    });
    (values, norms)
}

/// As stages begin: only what makes offsets has a gradient. With weights that are not zero everything learns.
pub(super) fn moved<S: System>(system: &mut S) {
    system.visit_mut("", &mut |path: &str, param: &mut Param| {
        if path.ends_with("vert_offset.weight") {
            let values = param.as_slice_mut().iter_mut().enumerate();
            values.for_each(|(i, x)| *x = 0.3 * ((i * 7 % 13) as f32 - 6.0) / 6.0);
        }
    });
}

#[test]
fn every_parameter_learns() {
    for kind in [DepthKind::None, DepthKind::True, DepthKind::Estimated] {
        let place = if kind == DepthKind::True { PlaceKind::Seen } else { PlaceKind::Fixed };
        let config = RefineConfig {
            depth: kind,
            depth_residuals: true,
            place,
            smoothness_weight: 0.1,
            bending_weight: 0.1,
            ..refine()
        };
        let ours = SphereConfig { refine: config.clone(), ..sphere() };
        let mut system = DepthPixel2Mesh::new(&ours, 3);
        moved(&mut system);
        let theirs = VoxelConfig { refine: config.clone(), carving: true, ..voxels() };
        let mut other = MeshRcnn::new(&theirs, 3);
        moved(&mut other);
        for (values, norms) in [step(&system, &config, 0), step(&other, &config, 8)] {
            assert!(values.iter().all(|(_, v)| v.is_finite() && *v > 0.0), "{kind:?} {values:?}");
            let names: Vec<&str> = values.iter().map(|(name, _)| *name).collect();
            for name in ["chamfer", "edge", "normal", "laplacian", "depth", "color", "picture"] {
                assert!(names.contains(&name), "{kind:?}: {name} of {names:?}");
            }
            for (path, norm) in norms {
                assert!(norm > 0.0 && norm.is_finite(), "{kind:?}: {path} gets no gradient");
            }
        }
    }
}

/// The system's mesh of a scene is what a mesh in the truth's place would be scored as: perfect.
#[test]
fn the_truth_scores_perfectly_and_a_grid_of_it_nearly() {
    let scenes = Scenes::synthetic(&refine(), 24).unwrap();
    // The nearer of two views: cells grow with the depth.
    let (object, scene) = scenes.trial(train::Subset::Test, 2, 1).unwrap();
    let surface = scenes.mesh(object).unwrap();
    let truth = scene.depth_targets.frame.mesh_placed(surface.mesh.as_ref().unwrap());
    let found = score::distances(&truth, &truth, 1.0);
    assert_eq!((found.chamfer, found.f_scores[0], found.chamfer_p2m), (0.0, 1.0, 0.0));
    let depth = score::depth_of(&truth, &scene).unwrap();
    assert_eq!((depth.mean, depth.uncovered), (0.0, 0.0));
    // Vertices of two parts at one place have two colours, and the nearest point has one.
    let color = score::color_error(&truth, &scene).unwrap();
    let gray = TriMesh { colors: Some(vec![[0.5; 3]; truth.positions.len()]), ..truth.clone() };
    let other = score::color_error(&gray, &scene).unwrap();
    assert!(color < 0.2 && color < 0.7 * other, "{color} {other}");
    // The depth of the data is in front of the camera, and about where the middle is said to be.
    let seen: Vec<f32> =
        scene.depth_targets.depth.iter().copied().filter(|z| z.is_finite()).collect();
    assert!(seen.len() > 60 && seen.iter().all(|z| (z - scene.depth_targets.middle).abs() < 0.8));
    // Moved by a tenth of a unit along the axis, depth says so.
    let moved = truth.clone().translated([0.0, 0.0, -0.1]);
    let depth = score::depth_of(&moved, &scene).unwrap();
    assert!((0.05..0.2).contains(&depth.mean), "{}", depth.mean);

    // The cells' own surface lies around the object.
    let volume = scene.depth_targets.volume(&scene.image);
    let values: Vec<f32> =
        scene.depth_targets.cells.iter().map(|&o| f32::from(u8::from(o))).collect();
    let bounds = mesh_core::CameraVolume::CUBE;
    let grid = mesh_core::VoxelGrid::from_channels([24; 3], bounds, &values, 0.5);
    let cells: TriMesh = volume.to_world(mesh_core::cubify(&grid, mesh_core::EmptyGrid::Nothing));
    let found = score::distances(&cells, &truth, 1.0);
    assert!(found.chamfer < 0.8 && found.f_scores[2] > 0.5, "{found:?}");
}

/// Where no cell is occupied there is still a mesh, by name: the central block.
#[test]
fn an_empty_grid_is_the_central_block() {
    let scenes = Scenes::synthetic(&refine(), 8).unwrap();
    let (_, scene) = scenes.trial(train::Subset::Test, 1, 0).unwrap();
    let system = MeshRcnn::new(&voxels(), 0);
    let (mesh, logits) = system.mesh_of(&scene);
    assert_eq!(logits.len(), 512);
    assert!(!system.mesh_init.occupied_cells(&logits).contains(&true));
    // Four cells along each axis: the surface of 4³ has 98 corners.
    assert_eq!((mesh.positions.len(), mesh.faces.len()), (98, 192));
    assert!(mesh.positions.iter().all(|p| p[2] < 0.0) && mesh.colors.is_some());
}

/// Stages begin as the identity: the mesh is the sphere, subdivided; in the form that is not, it stays as it is.
#[test]
fn a_sphere_grows_from_stage_to_stage() {
    let scenes = Scenes::synthetic(&refine(), 0).unwrap();
    let (_, scene) = scenes.trial(train::Subset::Test, 1, 0).unwrap();
    let counts = |subdivide: bool| -> Vec<usize> {
        let config = SphereConfig { subdivide, ..sphere() };
        let stages = DepthPixel2Mesh::new(&config, 0).mesh_and_stages_of(&scene).1;
        stages.iter().map(|mesh| mesh.positions.len()).collect()
    };
    assert_eq!(counts(true), [12, 12, 42, 162]);
    assert_eq!(counts(false), [12; 4]);
}

/// What is given of depth decides what the network sees of it, and nothing else of the data does.
#[test]
fn depth_channels_are_of_their_kind() {
    let of = |depth: DepthKind, raw_depth: bool| {
        let scenes = Scenes::synthetic(&RefineConfig { depth, raw_depth, ..refine() }, 0).unwrap();
        scenes.trial(train::Subset::Test, 1, 0).unwrap().1
    };
    let (none, real) = (of(DepthKind::None, false), of(DepthKind::True, false));
    let (guess, raw) = (of(DepthKind::Estimated, false), of(DepthKind::Estimated, true));
    assert_eq!(none.image.pixels, guess.image.pixels);
    assert_eq!(none.depth_targets.depth, guess.depth_targets.depth);
    assert!(none.depth_targets.channel.is_empty());
    let object: Vec<bool> = none.image.mask.iter().map(|&m| m > 127).collect();
    let outside = |scene: &Scene| -> f32 {
        let pairs = scene.depth_targets.channel.iter().zip(&object);
        pairs.filter(|(_, o)| !**o).map(|(c, _)| *c).fold(0.0, f32::max)
    };
    assert_eq!(outside(&guess), 0.0);
    assert!(outside(&raw) > 0.1, "the floor is seen");
    // Nearer is larger in both: they rise together.
    let inside: Vec<usize> = (0..object.len())
        .filter(|&p| real.depth_targets.compared[p] && guess.depth_targets.compared[p])
        .collect();
    let mean = |x: &[f32]| inside.iter().map(|&p| x[p]).sum::<f32>() / inside.len() as f32;
    let (a, b) = (&real.depth_targets.channel, &guess.depth_targets.channel);
    let (ma, mb) = (mean(a), mean(b));
    let cov: f32 = inside.iter().map(|&p| (a[p] - ma) * (b[p] - mb)).sum();
    assert!(inside.len() > 40 && cov > 0.0);
}

#[test]
fn made_objects_are_parted_and_drawn_by_the_seed() {
    let mut config = voxels();
    config.refine.pairs.test_objects = 3;
    let mut seeded = config.clone();
    seeded.refine.pairs.data_seed = Some(7);
    crate::testing::assert_data::<MeshRcnn>(&config, &seeded, [3, 2, 3]);
}

/// What is blind is shown the same of every image.
#[test]
fn controls_are_what_they_say() {
    let config = SphereConfig { refine: RefineConfig { blind: true, ..refine() }, ..sphere() };
    let data = Scenes::synthetic(&config.refine, 0).unwrap();
    let [a, b] = [0, 1].map(|view| data.trial(train::Subset::Test, 2, view).unwrap().1);
    assert_ne!(a.image.pixels, b.image.pixels);
    let images = |config: &SphereConfig| {
        let encoder = super::encoder::Encoder::new(&nets::Init::new(0), &config.refine);
        encoder.images(&Tape::eval(), &[&a, &b])
    };
    assert!(images(&config).as_slice().iter().all(|&x| x == 0.0));
    assert!(images(&sphere()).as_slice().iter().any(|&x| x != 0.0));
}

/// What carving says for sure is true: hardly a cell that it empties is occupied, and nearly every one that it fills is; together
/// they tell most of the volume.
#[test]
fn carving_empties_what_is_empty() {
    let pairs = PairsConfig { image_size: 64, ..refine().pairs };
    let config = RefineConfig { pairs, ..refine() };
    for (place, reach) in [(PlaceKind::Fixed, config.reach), (PlaceKind::Seen, [0.7, 1.45])] {
        let config = RefineConfig { place, reach, ..config.clone() };
        let scenes = Scenes::synthetic(&config, 16).unwrap();
        let (_, scene) = scenes.trial(train::Subset::Train, 1, 0).unwrap();
        // What is estimated may be wrong by more than a cell, and fills none.
        let estimated = super::carving::carved(&scene, 16, DepthKind::Estimated);
        let outlined = super::carving::carved(&scene, 16, DepthKind::None);
        assert!(estimated == outlined && estimated.iter().all(|&k| k <= 0.0));
        let known = super::carving::carved(&scene, 16, DepthKind::True);
        let share = |known_as: fn(f32) -> bool, occupied: bool| {
            let cells = known.iter().zip(&scene.depth_targets.cells);
            let chosen: Vec<bool> =
                cells.filter(|(k, _)| known_as(**k)).map(|(_, &o)| o == occupied).collect();
            chosen.iter().filter(|&&o| o).count() as f64 / chosen.len() as f64
        };
        let (empty, full) = (share(|k| k < 0.0, false), share(|k| k > 0.0, true));
        assert!(empty > 0.99 && full > 0.9, "{place:?}: {empty} of the empty, {full} of the full");
        let told = known.iter().filter(|k| **k != 0.0).count();
        assert!(told > known.len() / 2, "{told} of {}", known.len());
    }
}

/// A vertex on the surface that is seen is told 0, one behind it more and one before it less; beside the outline nothing is seen.
#[test]
fn residuals_are_zero_on_the_surface_that_is_seen() {
    let config = RefineConfig { depth_residuals: true, ..refine() };
    let scenes = Scenes::synthetic(&config, 0).unwrap();
    let (_, scene) = scenes.trial(train::Subset::Train, 1, 0).unwrap();
    let side = 32;
    let (channel, mask) = (&scene.depth_targets.channel, &scene.image.mask);
    // All around seen, so that nothing is mixed in.
    let inside = |p: &usize| {
        let (i, j) = (p / side, p % side);
        let near = |i: usize, j: usize| channel[i * side + j] > 0.0 && mask[i * side + j] > 127;
        (1..31).contains(&i) && (1..31).contains(&j) && near(i, j)
    };
    let pixels: Vec<usize> = (0..side * side).filter(inside).collect();
    assert!(pixels.len() > 50);
    let tape = Tape::eval();
    let told = |offset: f32, at: &dyn Fn(usize) -> (usize, usize)| {
        let places = ndarray::Array3::from_shape_fn((1, pixels.len(), 3), |(_, v, k)| {
            let (i, j) = at(pixels[v]);
            let along = |p: usize| (2.0 * p as f32 + 1.0) / side as f32 - 1.0;
            [along(j), -along(i), 1.0 - 2.0 * channel[pixels[v]] + offset][k]
        });
        let place = tape.constant(places);
        super::residuals::depth_residuals(place, &[&scene], (DepthKind::True, false)).value()
    };
    let there = |p: usize| (p / side, p % side);
    for (offset, least, most) in [(0.0, -1e-3, 1e-3), (0.1, 0.399, 0.401), (-0.1, -0.401, -0.399)] {
        let found = told(offset, &there);
        for v in 0..pixels.len() {
            assert!(found[[0, v, 0]] <= 0.0 && (found[[0, v, 2]] - 1.0).abs() < 1e-5);
            assert!((least..=most).contains(&found[[0, v, 1]]), "{offset}: {}", found[[0, v, 1]]);
        }
    }
    let beside = told(0.0, &|_| (0, 0));
    assert!(beside[[0, 0, 0]] > 0.0 && beside[[0, 0, 1]] == 0.0 && beside[[0, 0, 2]] == 0.0);
}

/// A Laplacian's weight means the same at any number of vertices and at any size: of a bump of one wavelength, on a sphere of
/// twice the radius and of four times the vertices.
#[test]
fn roughness_has_no_unit() {
    let rough = |level: u32, radius: f32| {
        let ball = mesh_core::primitives::icosphere(level);
        let packed = Packed::new(vec![std::sync::Arc::new(Shape::of(&ball))]);
        let tape = Tape::eval();
        let rows = |f: &dyn Fn([f32; 3]) -> [f32; 3]| {
            let rows: Vec<f32> = ball.positions.iter().flat_map(|&p| f(p)).collect();
            tape.constant(ndarray::Array3::from_shape_vec((1, rows.len() / 3, 3), rows).unwrap())
        };
        let before = rows(&|p| p.map(|x| radius * x));
        let positions = rows(&|p| p.map(|x| radius * x * (1.0 + 0.1 * (3.0 * p[0]).sin())));
        let stage = super::stage_meshes::StageMeshes { packed, positions, before };
        let config = RefineConfig { bending_weight: 1.0, ..refine() };
        let bending = super::surface::roughness(&stage, &config).unwrap().item();
        // A bump's curvature is its height over the square of its length: half at twice the size.
        bending * radius * radius
    };
    let base = rough(3, 1.0);
    assert!(base > 0.0);
    for other in [rough(3, 2.0), rough(4, 1.0), rough(4, 2.0)] {
        assert!((other / base - 1.0).abs() < 0.15, "{other} instead of {base}");
    }
}
