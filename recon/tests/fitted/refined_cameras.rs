//! Cameras that are a little off are put right by the fit, and right ones are left alone.

use datasets::{View, Views};
use mesh_core::nalgebra::{Matrix3, Vector3};
use mesh_core::{Camera, TriMesh};
use recon::evaluate::score_views;
use recon::fit::{FitConfig, Fitted, Quality, fit};
use recon::progress::{Ended, Event, Watch};
use synth::shapes::Family;
use synth::{Orbit, Placement, Planted, RenderOptions, render_views};

fn object() -> TriMesh {
    Family::Car.draw(5).mesh()
}

fn orbit(count: usize) -> Orbit {
    let distance = [1.6, 1.8];
    Orbit { count, target: [0.0; 3], distance, width: 128, height: 128, ..Orbit::default() }
}

fn rendered(orbit: &Orbit) -> Vec<View> {
    render_views(&object(), &orbit.cameras(), &RenderOptions::default(), &|_, _| {}).unwrap()
}

fn fitted(views: Vec<View>, refine_cameras: bool) -> Fitted {
    let config = FitConfig { hold_out: None, refine_cameras, ..Quality::Draft.config() };
    fit(&Views::in_memory(views), &config, &mut Watch::default()).unwrap()
}

/// The mesh brought from the frame of some cameras to that of the true ones by the similarity that takes the ones' centres to
/// the others' (Umeyama 1991).
fn aligned(mesh: &TriMesh, from: &[Camera], to: &[Camera]) -> TriMesh {
    let centers = |cameras: &[Camera]| cameras.iter().map(Camera::center).collect::<Vec<_>>();
    let (a, b) = (centers(from), centers(to));
    let mean = |points: &[Vector3<f64>]| points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let (middle_a, middle_b) = (mean(&a), mean(&b));
    let (mut covariance, mut square) = (Matrix3::zeros(), 0.0);
    for (p, q) in a.iter().zip(&b) {
        covariance += (q - middle_b) * (p - middle_a).transpose();
        square += (p - middle_a).norm_squared();
    }
    let svd = covariance.svd(true, true);
    let (u, v) = (svd.u.unwrap(), svd.v_t.unwrap());
    let turn = u * v;
    let scale = svd.singular_values.sum() / square;
    let positions = mesh.positions.iter().map(|p| {
        let p = scale * (turn * (Vector3::from(p.map(f64::from)) - middle_a)) + middle_b;
        [p.x as f32, p.y as f32, p.z as f32]
    });
    TriMesh { positions: positions.collect(), ..mesh.clone() }
}

/// Mean mask IoU on views from elsewhere, whose poses are exact, under a lens of so many times their focal length.
fn score(mesh: &TriMesh, focal: f64) -> f64 {
    let others = rendered(&Orbit { placement: Placement::Random, seed: 3, ..orbit(10) });
    let others = Planted::Focal(focal).plant(others, [0.0; 3], 0);
    let others: Vec<&View> = others.iter().collect();
    score_views(mesh, &others, &|_, _| {}).unwrap().mask_iou
}

/// Once a refinement is cancelled nothing of it goes on: two that end within its first round had their cameras moved as often.
#[test]
fn cameras_rest_where_a_refinement_is_stopped() {
    let noisy = Planted::Poses(0.3).plant(rendered(&orbit(14)), [0.0; 3], 1);
    let config = FitConfig { hold_out: None, ..Quality::Draft.config() };
    let planned = config.total_steps() as u64;
    let stopped = |steps: usize| {
        let mut refining = 0;
        let mut watch = Watch::default().until_event(move |event| {
            // Only steps of a refinement are more than was planned.
            refining += usize::from(matches!(event, Event::Step(step) if step.total > planned));
            refining == steps
        });
        fit(&Views::in_memory(noisy.clone()), &config, &mut watch).unwrap()
    };
    let [first, second] = [1, 2].map(stopped);
    assert_eq!((first.ended, second.ended), (Ended::Cancelled, Ended::Cancelled));
    let cameras = |fitted: &Fitted| fitted.cameras.as_ref().unwrap().cameras.clone();
    assert_eq!(cameras(&first), cameras(&second));
}

#[test]
fn noise_of_poses_and_focal_length_is_taken_back() {
    let good = rendered(&orbit(24));
    let truth: Vec<Camera> = good.iter().map(|view| view.camera.clone()).collect();
    let clean = score(&fitted(good.clone(), true).mesh, 1.0);
    // One draw of the noise more or less moves the score by two thousandths.
    let mut lost = Vec::new();
    for seed in 1..=4 {
        // All have the same wrong lens, those that score too; their poses are right.
        let noisy = Planted::Poses(0.3).plant(good.clone(), [0.0; 3], seed);
        let noisy = Planted::Focal(1.01).plant(noisy, [0.0; 3], seed);
        if seed == 1 {
            let given: Vec<Camera> = noisy.iter().map(|view| view.camera.clone()).collect();
            let plain = fitted(noisy.clone(), false);
            assert!(plain.cameras.is_none());
            let without = score(&aligned(&plain.mesh, &given, &truth), 1.01);
            assert!(without < clean - 0.03, "clean {clean:.4}, noisy {without:.4}");
        }
        let refined = fitted(noisy, true);
        let cameras = refined.cameras.as_ref().unwrap();
        let mesh = aligned(&refined.mesh, &cameras.cameras, &truth);
        lost.push(clean - score(&mesh, 1.01 * cameras.focal));
        let found = format!(
            "clean {clean:.4}, focal {:.4}, motion {:.2}, {:?}, {:?}",
            cameras.focal, cameras.motion, cameras.distance, cameras.gap
        );
        // The outlines fit together nearly as those of exact cameras do.
        assert!(cameras.gap[1] < 0.25 * cameras.gap[0] && cameras.gap[1] < 0.22, "{found}");
        assert!((cameras.focal * 1.01 - 1.0).abs() < 0.01, "{found}");
    }
    // What the noise costs comes back.
    let mean = lost.iter().sum::<f64>() / lost.len() as f64;
    assert!(mean < 0.003, "clean {clean:.4}, lost {mean:.4}: {lost:.4?}");
}

#[test]
fn held_out_poses_are_found_by_the_finished_mesh() {
    let good = rendered(&orbit(20));
    let noisy = Planted::Poses(0.3).plant(good.clone(), [0.0; 3], 1);
    let config = FitConfig { hold_out: Some(5), ..Quality::Draft.config() };
    let scores = |views: &[View]| {
        let views = Views::in_memory(views.to_vec());
        let fitted = fit(&views, &config, &mut Watch::default()).unwrap();
        let located = fitted.cameras.map_or_else(Vec::new, |found| found.located);
        let held_out = |cameras: &[Camera]| {
            let of = |(k, &i): (usize, &usize)| {
                let camera = cameras.get(k).unwrap_or(&views.views[i].camera).clone();
                View { camera, ..views.views[i].clone() }
            };
            let seen: Vec<View> = fitted.held_out_views.iter().enumerate().map(of).collect();
            let seen: Vec<&View> = seen.iter().collect();
            score_views(&fitted.mesh, &seen, &|_, _| {}).unwrap().mask_iou
        };
        (held_out(&[]), held_out(&located))
    };
    let (clean, _) = scores(&good);
    let (given, located) = scores(&noisy);
    assert!(given < clean - 0.02, "given {given:.4}, clean {clean:.4}");
    assert!(located > clean - 0.003, "located {located:.4}, clean {clean:.4}");
}

#[test]
fn exact_cameras_are_left_alone() {
    let views = rendered(&orbit(16));
    let (with, without) = (fitted(views.clone(), true), fitted(views, false));
    assert!(with.cameras.is_none(), "{:?}", with.cameras.map(|c| (c.motion, c.distance)));
    assert_eq!(with.mesh, without.mesh);
}
