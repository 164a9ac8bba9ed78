//! Objects before busy backgrounds, found by their colours in all views: nothing is told but the cameras.

#![allow(clippy::unwrap_used, reason = "tests")]

use datasets::{View, segment_by_color};
use mesh_core::{TriMesh, primitives};
use synth::shapes::Family;
use synth::{Cloth, Lighting, Orbit, RenderOptions, Room, Wall, marbled};

/// A pebble with a waist and bumps, painted all over.
fn pebble() -> TriMesh {
    let mut mesh = primitives::icosphere(5);
    for p in &mut mesh.positions {
        let [x, y, z] = *p;
        let bump = 1.0 + 0.12 * (5.0 * x + 1.0).sin() * (4.0 * z).cos() + 0.18 * (3.0 * y).cos();
        *p = [0.8 * bump * x, 0.9 * bump * y, 0.65 * bump * z];
    }
    marbled(&mesh, [[0.75, 0.16, 0.12], [0.95, 0.72, 0.30]], 2.5, 9)
}

/// Photographs from around and above, `count` of them.
fn photographed(object: &TriMesh, room: &Room, count: usize, size: usize) -> Vec<View> {
    let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for p in &object.positions {
        for a in 0..3 {
            low[a] = low[a].min(f64::from(p[a]));
            high[a] = high[a].max(f64::from(p[a]));
        }
    }
    let reach = 0.5 * (0..3).map(|a| (high[a] - low[a]).powi(2)).sum::<f64>().sqrt();
    let orbit = Orbit {
        count,
        target: std::array::from_fn(|a| 0.5 * (low[a] + high[a])),
        distance: [4.0 * reach, 4.4 * reach],
        elevation: [12.0, 50.0],
        fov_y: 40.0,
        width: size * 4 / 3,
        height: size,
        ..Orbit::default()
    };
    let options = RenderOptions { lighting: Lighting::studio(), ..RenderOptions::default() };
    room.photograph(object, &orbit.cameras(), &options).unwrap()
}

/// Intersection over union with the truth, view by view.
fn scores(truth: &[View], found: &[mesh_core::ByteImage]) -> Vec<f64> {
    let score = |(view, mask): (&View, &mesh_core::ByteImage)| {
        let pairs = || view.mask.data.iter().zip(&mask.data);
        let both = pairs().filter(|(a, b)| **a != 0 && **b != 0).count();
        let any = pairs().filter(|(a, b)| **a != 0 || **b != 0).count();
        both as f64 / any.max(1) as f64
    };
    truth.iter().zip(found).map(score).collect()
}

/// The views without the truth.
fn masked_whole(views: &[View]) -> Vec<View> {
    let whole = |view: &View| {
        let mut view = view.clone();
        view.mask.data.fill(255);
        view
    };
    views.iter().map(whole).collect()
}

fn segmented(name: &str, object: &TriMesh, room: Room) {
    let truth = photographed(object, &room, 24, 96);
    let found = segment_by_color(&masked_whole(&truth), None, &|_, _| ()).unwrap();
    let scores = scores(&truth, &found);
    let mean = scores.iter().sum::<f64>() / scores.len() as f64;
    assert!(mean >= 0.97, "{name}: {mean:.4}, {scores:.3?}");
}

#[test]
fn a_clock_before_confetti() {
    let clock = Family::AlarmClock.draw(7).mesh();
    let room = Room { cloth: Cloth::Checker, wall: Wall::Confetti, shadow: 0.3, seed: 1 };
    segmented("clock", &clock, room);
}

#[test]
fn a_car_before_squares() {
    let car = Family::Car.draw(3).mesh();
    let room = Room { cloth: Cloth::Wood, wall: Wall::Checker, shadow: 0.3, seed: 2 };
    segmented("car", &car, room);
}

#[test]
fn a_pebble_before_a_landscape() {
    let room = Room { cloth: Cloth::Print, wall: Wall::Landscape, shadow: 0.3, seed: 3 };
    segmented("pebble", &pebble(), room);
}
