//! A hollow from photographs, by what `fit` does and by gradients on the tape: the two agree.
//!
//! `fit` searches along each pixel's ray and follows what it found; `diff-raster`'s example `photo_consistency`, of which these are the
//! modules, descends the difference of colours through DIB-R's interpolation. They have no line in common but the rasteriser's.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "../../../diff-raster/examples/photo_consistency/photographs.rs"]
mod photographs;
#[path = "../../../diff-raster/examples/photo_consistency/surface.rs"]
mod surface;

use autodiff_lite::Tensor;
use datasets::{View, Views};
use mesh_core::primitives::icosphere;
use mesh_core::{Camera, TriMesh};
use recon::fit::{FitConfig, fit};
use synth::{Orbit, Placement, RenderOptions, marbled, render_views};
use train::progress::Watch;

use photographs::{Pairs, tensor};

const RADIUS: f32 = 0.4;
const SIZE: usize = 128;

/// A painted ball with a dish towards z, a third of the radius deep.
fn object() -> TriMesh {
    let ball = icosphere(6).map_positions(|p: [f32; 3]| {
        let away = p[0] * p[0] + p[1] * p[1] + (p[2] - 1.0).powi(2);
        p.map(|v| RADIUS * (1.0 - 0.35 * (-away / 0.16).exp()) * v)
    });
    marbled(&ball, [[0.9, 0.8, 0.6], [0.2, 0.15, 0.35]], 8.0, 3)
}

/// Each view that looks into the dish with the three that look the most alike.
fn pairs(views: &[View]) -> Pairs {
    let cameras: Vec<Camera> = views.iter().map(|view| view.camera.clone()).collect();
    let floats = |bytes: &[u8]| bytes.iter().map(|&b| f32::from(b) / 255.0).collect::<Vec<f32>>();
    let all = |of: &dyn Fn(&View) -> Vec<f32>, channels: &[usize]| {
        let shape = [&[views.len(), SIZE, SIZE], channels].concat();
        tensor(views.iter().flat_map(of).collect(), &shape)
    };
    let images = all(&|view| floats(&view.color.data), &[3]);
    let masks = all(&|view| floats(&view.mask.data), &[]);
    let towards: Vec<[f64; 3]> =
        cameras.iter().map(|c| c.ray(0.5 * SIZE as f64, 0.5 * SIZE as f64).direction).collect();
    let near = |k: usize| {
        let alike = |j: usize| -> f64 { (0..3).map(|a| towards[k][a] * towards[j][a]).sum() };
        let mut others: Vec<usize> = (0..views.len()).filter(|&j| j != k).collect();
        others.sort_by(|&a, &b| alike(b).total_cmp(&alike(a)));
        others.truncate(3);
        others.into_iter().map(move |j| [k, j])
    };
    let into = (0..views.len()).filter(|&k| towards[k][2] < -0.3);
    let pairs: Vec<[usize; 2]> = into.flat_map(near).collect();
    let matrices: Tensor<f32> = Camera::matrices(&cameras).into();
    Pairs::of(&images, &masks, &matrices, &pairs)
}

/// How far from the middle the surface is, at the middle of the dish.
fn height(mesh: &TriMesh) -> f32 {
    let middle = mesh.positions.iter().filter(|p| p[0].hypot(p[1]) < 0.06 && p[2] > 0.0);
    let (sum, count) = middle.fold((0.0, 0), |(sum, count), p| (sum + p[2], count + 1));
    sum / count as f32
}

#[test]
fn the_tape_finds_the_hollow_that_fit_finds() {
    let object = object();
    let orbit = Orbit {
        count: 30,
        placement: Placement::Fibonacci,
        width: SIZE,
        height: SIZE,
        ..Orbit::default()
    };
    let views =
        render_views(&object, &orbit.cameras(), &RenderOptions::default(), &|_, _| ()).unwrap();
    // Photographs alone are compared, so that what makes surfaces even in `fit` is left out of both.
    let fitted = |photometric: bool| {
        let config =
            FitConfig { level: 4, photometric, filter_normals: false, ..FitConfig::default() };
        fit(&Views::in_memory(views.clone()), &config, &mut Watch::default()).unwrap().mesh
    };
    let (outlines, searched) = (fitted(false), fitted(true));
    let mut descended = outlines.clone();
    let middle = pairs(&views).halved();
    let coarse = middle.halved();
    for (pairs, steps) in [(&coarse, 150), (&middle, 60)] {
        let history = surface::follow(&mut descended, pairs, steps, 0.008).unwrap();
        assert!(history[steps - 1] < history[0], "{history:?}");
    }
    let [truth, outlines, searched, descended] =
        [&object, &outlines, &searched, &descended].map(height);
    let deep = outlines - truth;
    assert!(deep > 0.05, "outlines leave {deep}");
    assert!((descended - truth).abs() < deep / 3.0, "{descended}, the truth is {truth}");
    assert!((descended - searched).abs() < deep / 8.0, "{descended}, `fit` has {searched}");
}
