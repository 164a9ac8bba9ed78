//! From files of others to meshes, and what an inspection says of good and of spoilt views.

use datasets::{ColmapForm, Layout, ReadOptions, Truth, View, Views, read_views, write_colmap};
use mesh_core::nalgebra::{Matrix3, Vector3};
use mesh_core::{Lens, TriMesh, primitives};
use recon::evaluate::score_views;
use recon::fit::{FitConfig, fit};
use recon::inspect::{ObjectInspection, inspect_views};
use recon::progress::Watch;
use synth::shapes::AlarmClock;
use synth::{Orbit, Planted, RenderOptions, render_views};

/// A box that looks different from every side, off the origin.
fn wedge() -> TriMesh {
    let mut mesh = mesh_core::subdivide(&primitives::cuboid([1.6, 1.0, 0.7]));
    for p in &mut mesh.positions {
        p[1] += 0.3 * p[0] * p[0].max(0.0);
        p[2] *= 1.0 + 0.4 * p[0];
    }
    mesh.translated([0.3, -0.2, 0.1])
}

fn views_of(mesh: &TriMesh, orbit: &Orbit) -> Vec<View> {
    let mut cameras = orbit.cameras();
    for camera in &mut cameras {
        // A lens that is not centred and whose pixels are not square.
        if let Lens::Perspective { fx, fy, cx, cy } = &mut camera.lens {
            (*fx, *fy, *cx, *cy) = (0.95 * *fx, 1.02 * *fy, *cx + 2.25, *cy - 1.5);
        }
    }
    render_views(mesh, &cameras, &RenderOptions::default(), &|_, _| {}).unwrap()
}

fn orbit(count: usize) -> Orbit {
    let target = [0.3, -0.2, 0.1];
    Orbit { count, target, distance: [4.0, 5.0], width: 64, height: 56, ..Orbit::default() }
}

#[test]
fn a_colmap_project_is_fitted() {
    let folder = tempfile::tempdir().unwrap();
    let made = views_of(&wedge(), &orbit(30));
    write_colmap(&made, folder.path(), ColmapForm::Text).unwrap();
    let views = read_views(folder.path(), &ReadOptions::default(), &|_, _| {}).unwrap();
    assert_eq!(views.layout, Layout::Colmap);
    let config = FitConfig { start_level: 2, level: 3, steps: 60, ..FitConfig::default() };
    let fitted = fit(&views, &config, &mut Watch::default()).unwrap();
    let score = |mesh: &TriMesh| {
        let held: Vec<&View> = fitted.held_out_views.iter().map(|&i| &made[i]).collect();
        score_views(mesh, &held, &|_, _| {}).unwrap().mask_iou
    };
    // As good as from memory: a principal point half a pixel off, or fx for fy, loses more.
    let views = Views { views: made.clone(), layout: Layout::Memory, ..views };
    let direct = fit(&views, &config, &mut Watch::default()).unwrap();
    let (read, direct) = (score(&fitted.mesh), score(&direct.mesh));
    assert!(read > 0.92 && (read - direct).abs() < 0.004, "{read} {direct}");
}

fn inspected(views: Vec<View>, truth: &Truth) -> ObjectInspection {
    let views = Views::in_memory(views);
    inspect_views(&views, truth)
}

const SMALL: [usize; 2] = [72, 64];

/// Views of the clock, spoilt in a way that has a name; with and without its true mesh.
#[track_caller]
fn is_named(kind: &str, [width, height]: [usize; 2], spoil: impl Fn(&mut View)) {
    let clock = AlarmClock::default().build();
    let orbit = Orbit { count: 20, width, height, ..Orbit::default() };
    let good = views_of(&clock, &orbit);
    let mut bad = good.clone();
    bad.iter_mut().for_each(spoil);
    for truth in [Truth::default(), Truth { mesh: Some(clock), ..Truth::default() }] {
        let content = inspected(good.clone(), &truth);
        assert!(content.problems.is_empty(), "{:?} {:?}", content.problems, content.agreement);
        assert!(content.agreement.hull_iou > Some(0.95), "{:?}", content.agreement.hull_iou);
        let found = inspected(bad.clone(), &truth);
        let kinds: Vec<_> = found.problems.iter().map(|p| p.kind).collect();
        assert!(kinds.contains(&kind), "{kinds:?} {:?}", found.agreement);
    }
}

#[test]
fn flips_are_named() {
    is_named("flipped_y", SMALL, |view| {
        let w = view.mask.width;
        view.mask.data = view.mask.data.chunks(w).rev().flatten().copied().collect();
    });
    is_named("flipped_x", SMALL, |view| {
        let w = view.mask.width;
        view.mask.data.chunks_mut(w).for_each(<[u8]>::reverse);
    });
}

#[test]
fn cameras_in_one_place_are_named() {
    is_named("coincident_cameras", SMALL, |view| {
        view.camera.translation = -view.camera.rotation * Vector3::new(0.3, 0.2, 4.0);
    });
}

#[test]
fn axes_of_another_tool_are_named() {
    let axes = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
    is_named("opencv_axes", SMALL, |view| {
        view.camera.rotation = axes * view.camera.rotation;
        view.camera.translation = axes * view.camera.translation;
    });
    is_named("inverse_pose", SMALL, |view| {
        let turned = view.camera.rotation.transpose();
        view.camera.translation = -(turned * view.camera.translation);
        view.camera.rotation = turned;
    });
}

#[test]
fn inverted_masks_are_named() {
    is_named("inverted_masks", SMALL, |view| view.mask.data.iter_mut().for_each(|m| *m = 255 - *m));
}

#[test]
fn wrong_focal_lengths_are_named() {
    for factor in [0.6, 1.8] {
        // On smaller images the width of a pixel hides what perspective tells.
        is_named("focal_length", [192, 170], |view| {
            if let Lens::Perspective { fx, fy, .. } = &mut view.camera.lens {
                (*fx, *fy) = (factor * *fx, factor * *fy);
            }
        });
    }
}

#[test]
fn both_sides_of_a_disagreement_are_measured() {
    let orbit = Orbit { count: 20, width: 96, height: 96, ..Orbit::default() };
    let good = views_of(&AlarmClock::default().build(), &orbit);
    let measured = |views: Vec<View>| {
        let found = inspected(views, &Truth::default()).agreement;
        (found.coherence.unwrap(), found.coherence_by_view)
    };
    let (before, by_view) = measured(good.clone());
    assert!(before.missing < 0.001 && before.gap < 0.2, "{before:?}");
    // A blob on one mask is missed by the hull of the others; a bite out of it is covered by that hull.
    let spoilt = 10;
    let blob = Planted::Blobs { views: 0.0, area: 0.1 }.plant(good.clone(), [0.0; 3], 1);
    let (_, with_blob) = measured(blob);
    let missing = with_blob[spoilt].unwrap().missing;
    assert!((0.02..0.12).contains(&missing), "{missing}");
    let bite = Planted::Bites { views: 0.0, area: 0.1 }.plant(good, [0.0; 3], 1);
    let (_, with_bite) = measured(bite);
    let grown = with_bite[spoilt].unwrap().excess - by_view[spoilt].unwrap().excess;
    assert!((0.02..0.12).contains(&grown), "{grown}");
}

#[test]
fn what_leaves_the_frame_and_what_stands_apart_is_named() {
    let mut views = views_of(&wedge(), &orbit(20));
    let other = views[7].mask.clone();
    views[3].mask = mesh_core::ByteImage {
        data: other.data.chunks(64).rev().flatten().copied().collect(),
        ..other
    };
    let found = inspected(views.clone(), &Truth::default());
    let odd = found.problems.iter().find(|p| p.kind == "odd_views");
    assert!(odd.is_none_or(|p| p.message.contains('3')), "{:?}", found.problems);
    let cut = found.problems.iter().any(|p| p.kind == "out_of_frame");
    assert!(!cut, "{:?}", found.problems);
    for view in &mut views {
        let (color, mask) = (view.color.cropped(0, 0, 34, 56), view.mask.cropped(0, 0, 34, 56));
        let camera = view.camera.cropped(0, 0, 34, 56);
        *view = View { color, mask, camera, ..view.clone() };
    }
    let found = inspected(views, &Truth::default());
    assert!(found.problems.iter().any(|p| p.kind == "out_of_frame"), "{:?}", found.problems);
}

/// The views of the R2N2 car, straight from its files.
fn car() -> (Vec<View>, Truth) {
    let folder = std::path::PathBuf::from(std::env::var("UNSPHERE_DATA").unwrap()).join("r2n2_car");
    let text = std::fs::read_to_string(folder.join("rendering/rendering_metadata.txt")).unwrap();
    let views = text.lines().filter(|line| !line.trim().is_empty()).enumerate().map(|(i, line)| {
        let n: Vec<f64> = line.split_whitespace().map(|word| word.parse().unwrap()).collect();
        let picture = mesh_core::read_image(folder.join(format!("rendering/{i:02}.png"))).unwrap();
        View {
            crop: None,
            name: format!("{i:02}"),
            color: picture.over([255; 3]),
            mask: datasets::mask_from_alpha(&picture).unwrap(),
            camera: mesh_core::Camera::from_r2n2(n[0], n[1], n[3], 137, 137),
            depth: None,
        }
    });
    let text = std::fs::read_to_string(folder.join("model_normal.xyz")).unwrap();
    let rows: Vec<[f32; 6]> = text
        .lines()
        .map(|line| {
            let n: Vec<f32> = line.split_whitespace().map(|word| word.parse().unwrap()).collect();
            n.try_into().unwrap()
        })
        .collect();
    let points = datasets::SurfacePoints {
        positions: rows.iter().map(|r| [r[0], r[1], r[2]]).collect(),
        normals: rows.iter().map(|r| [r[3], r[4], r[5]]).collect(),
    };
    (views.collect(), Truth { points: Some(points), ..Truth::default() })
}

#[test]
#[ignore = "needs UNSPHERE_DATA"]
fn the_focal_length_that_the_cars_metadata_claims_is_flagged() {
    let (views, truth) = car();
    let mut claimed = views.clone();
    for view in &mut claimed {
        // 25 degrees, as the last column says.
        let f = 68.5 / 12.5f64.to_radians().tan();
        view.camera.lens = Lens::Perspective { fx: f, fy: f, cx: 68.5, cy: 68.5 };
    }
    for truth in [Truth::default(), truth] {
        let content = inspected(views.clone(), &truth);
        assert!(content.problems.is_empty(), "{:?} {:?}", content.problems, content.agreement);
        let found = inspected(claimed.clone(), &truth);
        let kinds: Vec<_> = found.problems.iter().map(|p| p.kind).collect();
        assert!(kinds.contains(&"focal_length"), "{kinds:?} {:?}", found.agreement);
    }
}

#[test]
#[ignore = "needs UNSPHERE_DATA"]
fn the_clocks_hull_is_that_of_the_reference() {
    let folder = std::path::PathBuf::from(std::env::var("UNSPHERE_DATA").unwrap());
    let path = folder.join("rendered_clock/views_256");
    let mut views = read_views(&path, &ReadOptions::default(), &|_, _| {}).unwrap().views;
    let content = inspected(views.clone(), &Truth::default());
    assert!(content.problems.is_empty(), "{:?} {:?}", content.problems, content.agreement);
    assert!(content.agreement.hull_iou > Some(0.89), "{:?}", content.agreement.hull_iou);
    for view in &mut views {
        view.mask.data = view.mask.data.chunks(256).rev().flatten().copied().collect();
    }
    let found = inspected(views, &Truth::default());
    assert_eq!(found.problems[0].kind, "flipped_y", "{:?}", found.agreement);
    assert!(found.agreement.hull_iou < Some(0.6), "{:?}", found.agreement.hull_iou);
}
