//! Photographs whose camera chose exposure and white balance anew for each.

use std::f64::consts::PI;

use datasets::{View, Views};
use mesh_core::TriMesh;
use mesh_core::primitives::icosphere;
use recon::fit::{ColorKind, FitConfig, Fitted, fit};
use synth::{Orbit, Placement, RenderOptions, render_views};
use train::progress::Watch;

/// An egg with soft patches.
fn egg() -> TriMesh {
    let mesh = icosphere(4).scaled([0.4, 0.5, 0.35]);
    let patch = |p: &[f32; 3]| {
        std::array::from_fn(|c| 0.4 + 0.2 * (8.0 * p[c] + 3.0 * p[(c + 1) % 3]).sin())
    };
    let colors = mesh.positions.iter().map(patch).collect();
    TriMesh { colors: Some(colors), ..mesh }
}

/// How bright a channel of a view is.
fn brightness(view: usize, channel: usize) -> f64 {
    let exposure = 0.2 * (2.0 * PI * view as f64 * 0.37).sin();
    let balance = 0.06 * (2.0 * PI * (view as f64 * 0.61 + channel as f64 / 3.0)).sin();
    (exposure + balance).exp()
}

fn photographs(uneven: bool) -> Vec<View> {
    let orbit = Orbit {
        count: 20,
        placement: Placement::Fibonacci,
        width: 96,
        height: 96,
        ..Orbit::default()
    };
    let options = RenderOptions::default();
    let views = render_views(&egg(), &orbit.cameras(), &options, &|_, _| ());
    let mut views = views.expect("an egg that can be drawn");
    for (i, view) in views.iter_mut().enumerate().filter(|_| uneven) {
        for (k, byte) in view.color.data.iter_mut().enumerate() {
            *byte = (f64::from(*byte) * brightness(i, k % 3)).round().min(255.0) as u8;
        }
    }
    views
}

fn fitted(views: Vec<View>, config: &FitConfig) -> Fitted {
    let views = Views::in_memory(views);
    let options = FitConfig { level: 4, hold_out: None, ..config.clone() };
    fit(&views, &options, &mut Watch::default()).expect("an egg that can be fitted")
}

/// Mean absolute difference of the vertices' colours from those of the true surface's nearest vertices.
fn error(found: &TriMesh) -> f64 {
    let truth = egg();
    let (own, colors) = (found.colors.as_ref(), truth.colors.as_ref());
    let (own, colors) = own.zip(colors).expect("colours");
    let near = losses::metrics::point_distances(&found.positions, &truth.positions);
    let away = |(a, &i): (&[f32; 3], &u32)| -> f64 {
        (0..3).map(|c| f64::from((a[c] - colors[i as usize][c]).abs())).sum::<f64>() / 3.0
    };
    own.iter().zip(&near.accuracy_index).map(away).sum::<f64>() / own.len() as f64
}

#[test]
fn exposures_are_found_and_taken_out() {
    let even = fitted(photographs(false), &FitConfig::default());
    assert_eq!(even.exposures, None, "nothing to take out");
    let uneven = fitted(photographs(true), &FitConfig::default());
    let found = uneven.exposures.as_ref().expect("exposures that differ");
    // Only their ratios can be seen.
    let mean: [f64; 3] =
        std::array::from_fn(|c| (0..20).map(|i| brightness(i, c).ln()).sum::<f64>() / 20.0);
    for (i, found) in found.iter().enumerate() {
        for c in 0..3 {
            let truth = brightness(i, c) / mean[c].exp();
            let ratio = f64::from(found[c]) / truth;
            assert!((ratio - 1.0).abs() < 0.02, "view {i}, channel {c}: {} of {truth}", found[c]);
        }
    }
    let mixed = FitConfig { balance_colors: false, ..FitConfig::default() };
    let mixed = fitted(photographs(true), &mixed);
    let [clean, balanced, mixed] = [even, uneven, mixed].map(|fitted| error(&fitted.mesh));
    let words = format!("{clean:.4} even, {balanced:.4} balanced, {mixed:.4} mixed");
    assert!(balanced < clean + 0.004 && mixed > 2.0 * balanced, "{words}");
}

/// A texture's texels are brought to the same exposure.
#[test]
fn textures_are_balanced_too() {
    let config = FitConfig { color: ColorKind::Texture, ..FitConfig::default() };
    let spread = |balance_colors: bool| {
        let found = fitted(photographs(true), &FitConfig { balance_colors, ..config.clone() });
        let TriMesh { texture, .. } = found.mesh;
        let image = texture.expect("a texture").image;
        // Beside its neighbour in the row: seams between photographs are steps.
        let pixels: Vec<f32> = image.data.chunks_exact(3).map(|p| p[1]).collect();
        let steps = pixels.windows(2).filter(|w| w[0] > 0.0 && w[1] > 0.0);
        steps.map(|w| f64::from((w[1] - w[0]).abs())).filter(|d| *d < 0.1).sum::<f64>()
    };
    let [balanced, mixed] = [spread(true), spread(false)];
    assert!(balanced < mixed, "{balanced} balanced, {mixed} mixed");
}
