//! Photographs in Pix3D's layout, cut to their given boxes, from files to a trained step.

#![allow(clippy::unwrap_used, reason = "tests")]

use std::path::Path;

use mesh_core::primitives::cuboid;
use mesh_core::{Camera, TriMesh, encode_png, io::write_mesh};
use synth::{RenderOptions, render_views};
use train::progress::Watch;
use train::{
    Draw, Job, Provenance, RunFolder, Source, StepInfo, Subset, System, TrainConfig, train,
};

use super::*;
use crate::paired::PairsConfig;

const SIZE: [usize; 2] = [72, 48];
const FOCAL: f64 = 80.0;

/// A box of its own, off the middle of its photographs.
fn model(i: usize) -> TriMesh {
    cuboid([0.5, 0.3 + 0.1 * i as f32, 0.4]).colored([0.8, 0.3, 0.2])
}

/// Pix3D has its principal point in the middle: cameras look beside the object for it to be elsewhere.
fn camera(i: usize, view: usize) -> Camera {
    let angle = 0.7 * i as f64 + 1.9 * view as f64;
    let distance = 2.0 + 0.8 * view as f64;
    let eye = [distance * angle.cos(), 0.6, distance * angle.sin()];
    let beside = [0.15, 0.05 * i as f64, -0.1];
    let camera = Camera::look_at(eye, beside, [0.0, 1.0, 0.0], 0.6, SIZE[0], SIZE[1]);
    let [w, h] = SIZE.map(|n| n as f64 / 2.0);
    let lens = mesh_core::Lens::Perspective { fx: FOCAL, fy: FOCAL, cx: w, cy: h };
    Camera { lens, ..camera }
}

/// Three models, each in two photographs.
fn fixture(folder: &Path) {
    let mut records = Vec::new();
    for i in 0..3 {
        let model_file = format!("model/chair/made_{i}/model.obj");
        std::fs::create_dir_all(folder.join(&model_file).parent().unwrap()).unwrap();
        write_mesh(folder.join(&model_file), &model(i)).unwrap();
        let cameras: Vec<Camera> = (0..2).map(|view| camera(i, view)).collect();
        let options = RenderOptions::default();
        let views = render_views(&model(i), &cameras, &options, &|_, _| ()).unwrap();
        for (k, view) in views.iter().enumerate() {
            let [img, mask] = ["img", "mask"].map(|kind| format!("{kind}/chair/{i}{k}.png"));
            for (name, image) in [(&img, &view.color), (&mask, &view.mask)] {
                std::fs::create_dir_all(folder.join(name).parent().unwrap()).unwrap();
                std::fs::write(folder.join(name), encode_png(image)).unwrap();
            }
            let [top, left, height, width] = view.mask_bounds().unwrap();
            let pose = view.camera.to_pytorch3d_screen().unwrap();
            // `X R + T` there, `R X + T` in Pix3D.
            let r = pose.rotation;
            let rows: [[f64; 3]; 3] = std::array::from_fn(|a| std::array::from_fn(|b| r[b][a]));
            records.push(serde_json::json!({
                "img": img, "mask": mask, "model": model_file, "category": "chair",
                "img_size": SIZE, "bbox": [left, top, left + width, top + height],
                "rot_mat": rows, "trans_mat": pose.translation,
                "focal_length": FOCAL * 32.0 / SIZE[0] as f64,
            }));
        }
    }
    let text = serde_json::to_string(&records).unwrap();
    std::fs::write(folder.join("pix3d.json"), text).unwrap();
}

fn refine() -> RefineConfig {
    RefineConfig {
        pairs: PairsConfig {
            image_size: 32,
            scale: 1.0,
            points: 60,
            hold_out: Some(3),
            scored_views: 2,
            ..PairsConfig::default()
        },
        place: PlaceKind::Known,
        reach: [0.5, 1.6],
        depth: DepthKind::True,
        depth_weight: 0.5,
        width: 4,
        hidden: 8,
        ..RefineConfig::default()
    }
}

#[test]
fn photographs_are_cut_to_their_boxes_and_trained_on() {
    let folder = tempfile::tempdir().unwrap();
    fixture(folder.path());
    let options = datasets::ReadOptions::default();
    let source =
        Source { path: Some(folder.path()), options: &options, seed: 0, progress: &|_, _| () };
    let system = VoxelConfig {
        refine: refine(),
        cells: 8,
        voxel_hidden: 8,
        voxel_convolutions: 1,
        ..VoxelConfig::default()
    };
    let data = MeshRcnn::open(&system, &source).unwrap();
    assert_eq!(Subset::ALL.map(|subset| data.pairs().listed(subset).len()), [1, 1, 1]);
    for k in 0..2 {
        let (object, scene) = data.trial(Subset::Test, 2, k).unwrap();
        // The object fills the image but for the margin, wherever it was in the photograph.
        let inside: Vec<usize> = (0..1024).filter(|&p| scene.image.mask[p] > 127).collect();
        let columns = || inside.iter().map(|p| p % 32);
        let rows = || inside.iter().map(|p| p / 32);
        let wide = columns().max().unwrap() - columns().min().unwrap() + 1;
        let high = rows().max().unwrap() - rows().min().unwrap() + 1;
        assert!((26..=31).contains(&wide.max(high)), "{wide} x {high}");
        // The camera went with it: the true mesh covers the mask, and the image is 2 units wide at the middle.
        let surface = data.mesh(object).unwrap();
        let truth = scene.depth_targets.frame.mesh_placed(surface.mesh.as_ref().unwrap());
        let depth = score::depth_of(&truth, &scene).unwrap();
        assert!(depth.uncovered < 0.02 && depth.mean < 0.02, "{depth:?}");
        let spread = |k: usize| {
            let all = || truth.positions.iter().map(|p| p[k]);
            all().fold(f32::NEG_INFINITY, f32::max) - all().fold(f32::INFINITY, f32::min)
        };
        assert!((1.3..2.6).contains(&spread(0).max(spread(1))), "{}", spread(0));
        assert!(scene.depth_targets.cells.iter().any(|&bit| bit));
    }
    let mut config = train::Configuration { train: TrainConfig::default(), system };
    (config.train.max_steps, config.train.batch, config.train.learning_rate) = (Some(6), 2, 1e-3);
    (config.train.epochs, config.train.tensorboard) = (6, false);
    let (out, provenance) = (tempfile::tempdir().unwrap(), Provenance::default());
    let run = RunFolder::create(&out.path().join("run"), true).unwrap();
    let job: Job<'_, MeshRcnn> = Job {
        config: &config,
        data: &data,
        run: &run,
        provenance: &provenance,
        resume: false,
        from: None,
    };
    let fresh = MeshRcnn::new(&config.system, 0);
    let outcome = train(&job, &mut Watch::default()).unwrap();
    assert_eq!(outcome.steps, 6);
    let batch: Vec<Scene> = (0..2)
        .map(|i| fresh.draw(&data, &Draw { seed: 0, epoch: 0, index: i, item: 0 }).unwrap())
        .collect();
    let total = |system: &MeshRcnn| -> f64 {
        let tape = autodiff_lite::Tape::train(0);
        let terms = system.loss(&tape, &batch, StepInfo { step: 0, epoch: 0 }).unwrap().0;
        terms.iter().map(|term| term.weight * f64::from(term.value.item())).sum()
    };
    let (before, after) = (total(&fresh), total(&outcome.system));
    assert!(after < before, "{before} {after}");
}

/// An image that shows a model twice has two annotations of one name.
#[test]
fn two_of_a_model_in_one_photograph_have_a_box_each() {
    use datasets::{Dataset as _, Pix3d, ReadOptions};

    let folder = tempfile::tempdir().unwrap();
    fixture(folder.path());
    let path = folder.path().join("pix3d.json");
    let text = std::fs::read_to_string(&path).unwrap();
    let mut records: Vec<serde_json::Value> = serde_json::from_str(&text).unwrap();
    let mut other = records[0].clone();
    other["bbox"] = serde_json::json!([10, 5, 20, 25]);
    records.insert(1, other);
    std::fs::write(&path, serde_json::to_string(&records).unwrap()).unwrap();
    let boxes = boxes::Boxes::new(Pix3d::open(&path).unwrap());
    let sides = |which: Option<&[usize]>, options: &ReadOptions| -> Vec<usize> {
        let views = boxes.views(0, which, options, &|_, _| ()).unwrap().views;
        views.iter().map(|view| view.color.width).collect()
    };
    let options = ReadOptions::default();
    let all = sides(None, &options);
    assert_eq!((all.len(), all[1]), (3, 22));
    assert_ne!(all[0], all[1]);
    assert_eq!(sides(Some(&[2, 1, 0]), &options), [all[2], all[1], all[0]]);
    // One that is left out takes no other's box with it.
    std::fs::remove_file(folder.path().join("img/chair/00.png")).unwrap();
    let lenient = ReadOptions { allow_missing: true, ..options };
    assert_eq!(sides(None, &lenient), [all[2]]);
}
