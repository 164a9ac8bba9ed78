//! One image of a real car, learned by heart: the whole pipeline from the render to the mesh.

use std::path::PathBuf;

use autodiff_lite::Tape;
use autodiff_lite::optim::Adam;
use datasets::ReadOptions;
use losses::metrics::point_distances;
use models::paired::{Pair, Pairs, PairsConfig, point_scores};
use models::pixel2mesh::{
    Continuous, Deformer, Method, OdeConfig, SharedConfig, SingleView, Staged, StagesConfig,
};
use train::{Source, StepInfo, System};

/// Where the files of 3D-R2N2's car are.
fn car() -> PathBuf {
    let folder =
        std::env::var_os("UNSPHERE_DATA").expect("UNSPHERE_DATA names a folder of real inputs");
    PathBuf::from(folder).join("r2n2_car")
}

/// As many of the points as a mesh has vertices, each as far as can be from those before.
fn spread(points: &[[f32; 3]], count: usize) -> Vec<[f32; 3]> {
    let squared = |a: &[f32; 3], b: &[f32; 3]| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f32>();
    let mut far: Vec<f32> = vec![f32::INFINITY; points.len()];
    let mut chosen = vec![points[0]];
    while chosen.len() < count {
        let last = chosen[chosen.len() - 1];
        for (far, point) in far.iter_mut().zip(points) {
            *far = far.min(squared(point, &last));
        }
        let next = (0..points.len()).max_by(|&a, &b| far[a].total_cmp(&far[b])).unwrap();
        chosen.push(points[next]);
    }
    chosen
}

/// Pixel2Mesh's distance, times 1000.
fn chamfer(a: &[[f32; 3]], b: &[[f32; 3]]) -> f64 {
    let (there, back) = point_distances(a, b).chamfer(true);
    1e3 * (there + back)
}

/// Trains a system on one image of the car alone, and compares its mesh with the floor.
fn overfits_one_sample<D: Deformer>(config: &D::Config, learning_rate: f64, steps: u64) {
    let options = ReadOptions::default();
    let path = car();
    let source = Source { path: Some(&path), options: &options, seed: 0, progress: &|_, _| () };
    let data = Pairs::open(&pairs(), &source).unwrap();
    let pair: Pair = data.pair(0, 0).unwrap();
    let mut system = SingleView::<D>::new(config, 0);
    let (mut tape, mut adam) = (Tape::train(0), Adam::new(learning_rate));
    for step in 0..steps {
        let gradients = {
            let terms = system
                .loss(&tape, std::slice::from_ref(&pair), StepInfo { step, epoch: 0 })
                .unwrap()
                .0;
            let total = terms.iter().map(|term| term.value.scale(term.weight as f32));
            total.reduce(|a, b| a + b).unwrap().backward()
        };
        tape.reset();
        // Slower and slower, so that it settles.
        adam.set_lr(learning_rate * (1.0 - step as f64 / steps as f64).max(0.02));
        adam.step(&mut system, &gradients);
    }
    let (mesh, _) = system.mesh_of(&pair.image).unwrap();
    let found = point_scores(&mesh, &pair.truth).chamfer;
    let truth = &pair.truth.positions;
    let floor = chamfer(&spread(truth, mesh.positions.len()), truth);
    assert!(found <= 1.5 * floor, "{found}, the floor is {floor}");
}

fn pairs() -> PairsConfig {
    PairsConfig { image_size: 64, hold_out: None, ..PairsConfig::default() }
}

/// Few rules but the distance: what is learned by heart is already regular enough.
fn shared(hidden: usize) -> SharedConfig {
    SharedConfig {
        pairs: pairs(),
        level: 1,
        hidden,
        // A small encoder: there is one image to know.
        channels: [8, 8, 16, 16, 16, 16],
        edge_weight: 0.3,
        normal_weight: 0.0,
        laplacian_weight: 0.3,
        move_weight: 0.0,
        ..SharedConfig::default()
    }
}

#[test]
#[ignore = "needs UNSPHERE_DATA"]
fn pixel2mesh_overfits_one_car() {
    let config = StagesConfig { shared: shared(96), blocks: 4, ..StagesConfig::default() };
    overfits_one_sample::<Staged>(&config, 2e-3, 2400);
}

#[test]
#[ignore = "needs UNSPHERE_DATA"]
fn a_flow_overfits_one_car() {
    let config = OdeConfig {
        shared: shared(96),
        augment_dim: 8,
        time: 1,
        method: Method::Midpoint,
        start: [0.0, 0.0],
        step: [0.25, 0.25],
        ..OdeConfig::default()
    };
    overfits_one_sample::<Continuous>(&config, 4e-3, 2400);
}
