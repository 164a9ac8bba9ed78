//! What no outline shows: a ball with a hollow, from painted photographs.

use datasets::{View, Views};
use mesh_core::TriMesh;
use mesh_core::primitives::icosphere;
use recon::fit::{FitConfig, Fitted, fit};
use synth::{Orbit, Placement, RenderOptions, marbled, render_views};
use train::progress::Watch;

/// Where the hollow is.
const POLE: [f32; 3] = [0.0, 0.0, 1.0];

/// A painted ball of radius 0.4, a third of it missing around a pole: a dish of that depth.
fn object(hollow: bool) -> TriMesh {
    let depth = |p: [f32; 3]| {
        let away: f32 = (0..3).map(|k| (p[k] - POLE[k]).powi(2)).sum();
        if hollow { 0.35 * (-away / 0.16).exp() } else { 0.0 }
    };
    let ball = icosphere(6).map_positions(|p: [f32; 3]| p.map(|v| 0.4 * (1.0 - depth(p)) * v));
    marbled(&ball, [[0.9, 0.8, 0.6], [0.2, 0.15, 0.35]], 8.0, 3)
}

fn fitted(object: &TriMesh, photometric: bool) -> Fitted {
    let orbit = Orbit {
        count: 30,
        placement: Placement::Fibonacci,
        width: 144,
        height: 144,
        ..Orbit::default()
    };
    let options = RenderOptions::default();
    let views = render_views(object, &orbit.cameras(), &options, &|_, _| ());
    let views: Vec<View> = views.expect("a ball that can be drawn");
    let config = FitConfig { level: 4, photometric, ..FitConfig::default() };
    fit(&Views::in_memory(views), &config, &mut Watch::default())
        .expect("a ball that can be fitted")
}

/// How far from the middle the surface is towards the pole.
fn height(mesh: &TriMesh) -> f32 {
    let towards = |p: &&[f32; 3]| p[0].hypot(p[1]) < 0.06 && p[2] > 0.0;
    let all: Vec<f32> = mesh.positions.iter().filter(towards).map(|p| p[2]).collect();
    all.iter().sum::<f32>() / all.len() as f32
}

#[test]
fn photographs_show_a_hollow_that_outlines_do_not() {
    let object = object(true);
    let [truth, outlines] = [height(&object), height(&fitted(&object, false).mesh)];
    assert!(outlines - truth > 0.04, "outlines leave {outlines}, the truth is {truth}");
    let found = fitted(&object, true);
    let left = height(&found.mesh) - truth;
    assert!(left.abs() < (outlines - truth) / 3.0, "{left} is left of {}", outlines - truth);
    let consistency = found.photo_consistency.expect("depths");
    assert!(consistency.kept && consistency.after > consistency.before + 0.003, "{consistency:?}");
    assert!(found.health.is_watertight());
    assert_eq!(found.self_intersections, 0);
}

#[test]
fn threads_do_not_change_the_surface() {
    let object = object(true);
    let on = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.expect("threads").install(|| fitted(&object, true).mesh.positions)
    };
    assert_eq!(on(1), on(3));
}

#[test]
fn what_has_no_hollow_stays_as_it_is() {
    let ball = object(false);
    let [plain, photographed] = [false, true].map(|photometric| fitted(&ball, photometric));
    let consistency = photographed.photo_consistency.expect("depths");
    let iou = |fitted: &Fitted| fitted.evaluations.last().expect("scores").1;
    assert!(iou(&photographed) > iou(&plain) - 0.002, "{consistency:?}");
    let off = |mesh: &TriMesh| (height(mesh) - 0.4).abs();
    assert!(off(&photographed.mesh) < off(&plain.mesh) + 0.002, "{consistency:?}");
}
