//! Objects whose textures are known, baked from their images.
#![allow(clippy::unwrap_used, reason = "tests")]

use std::f32::consts::TAU;

use mesh_core::{Image, UpAxis, primitives};
use synth::{Orbit, RenderOptions, render_views};

use super::*;

/// Side of the texture of the box, texels; each of its six sides has a square of 64 with a margin of 3.
const SIDE: usize = 192;
const MARGIN: f32 = 3.0;

/// What a texel of the true texture shows: waves of some 20 texels, others in each channel.
fn wave([x, y]: [f32; 2]) -> [f32; 3] {
    let of = |a: f32, b: f32| 0.5 + 0.3 * (TAU * (a * x + b * y)).sin();
    [of(0.05, 0.01), of(-0.02, 0.045), of(0.035, 0.035)]
}

/// A box with its own layout, and its true texture.
fn textured_box() -> TriMesh {
    let shape = primitives::cuboid([1.6, 1.4, 1.5]);
    let mut uvs = Vec::new();
    for side in 0..6 {
        let [left, top] = [side % 3, side / 3].map(|k| 64.0 * k as f32);
        let (low, high) = (MARGIN, 64.0 - MARGIN);
        for [x, y] in [[low, low], [low, high], [high, high], [high, low]] {
            uvs.push([(left + x) / SIDE as f32, (top + y) / SIDE as f32]);
        }
    }
    let corners =
        (0..6u32).flat_map(|k| [[4 * k, 4 * k + 1, 4 * k + 2], [4 * k, 4 * k + 2, 4 * k + 3]]);
    let mut image = Image::new(SIDE, SIDE, 3);
    for (k, texel) in image.data.chunks_exact_mut(3).enumerate() {
        texel.copy_from_slice(&wave([k % SIDE, k / SIDE].map(|x| x as f32 + 0.5)));
    }
    TriMesh { texture: Some(Texture { uvs, faces: corners.collect(), image }), ..shape }
}

fn views_of(object: &TriMesh, elevation: [f64; 2]) -> Vec<View> {
    let orbit = Orbit { count: 30, elevation, width: 160, height: 160, ..Orbit::default() };
    let cameras = Orbit { target: [0.0; 3], ..orbit }.cameras();
    render_views(object, &cameras, &RenderOptions::default(), &|_, _| ()).unwrap()
}

fn baked(mesh: &TriMesh, views: &[View], config: &BakeConfig) -> Baked {
    let views: Vec<&View> = views.iter().collect();
    bake(mesh, &views, config, &|_, _| ()).unwrap()
}

/// Mean absolute difference of a texture from the true one, moved by so many texels, on the sides of the box.
fn error(found: &Image, moved: [f32; 2]) -> f32 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (k, texel) in found.data.chunks_exact(3).enumerate() {
        let place = [k % SIDE, k / SIDE].map(|x| x as f32 + 0.5);
        // The sides lie in the lower two thirds.
        if place[1] < 64.0
            || place.iter().any(|x| !(MARGIN + 1.0..63.0 - MARGIN).contains(&(x % 64.0)))
        {
            continue;
        }
        let truth = wave([place[0] + moved[0], place[1] + moved[1]]);
        sum += (0..3).map(|c| (texel[c] - truth[c]).abs()).sum::<f32>() / 3.0;
        count += 1.0;
    }
    sum / count
}

/// The same of the two texels around each side, beside the truth at the nearest place of its border.
fn rim_error(found: &Image) -> f32 {
    let (mut sum, mut count) = (0.0, 0.0);
    for (k, texel) in found.data.chunks_exact(3).enumerate() {
        let place = [k % SIDE, k / SIDE].map(|x| x as f32 + 0.5);
        let cell = place.map(|x| 64.0 * (x / 64.0).floor());
        let border = [0, 1].map(|k| place[k].clamp(cell[k] + MARGIN, cell[k] + 64.0 - MARGIN));
        let away = (0..2).map(|k| (place[k] - border[k]).abs()).fold(0.0, f32::max);
        if place[1] < 64.0 || !(0.1..2.0).contains(&away) {
            continue;
        }
        let truth = wave(border);
        sum += (0..3).map(|c| (texel[c] - truth[c]).abs()).sum::<f32>() / 3.0;
        count += 1.0;
    }
    sum / count
}

const OWN: BakeConfig =
    BakeConfig { uv: UvKind::Auto, texture_size: Some(SIDE), balance_colors: false };

#[test]
fn the_true_texture_comes_back_where_it_was() {
    let object = textured_box();
    let views = views_of(&object, [-90.0, 90.0]);
    // The image that lies on it is not looked at.
    let mut bare = object.clone();
    bare.texture.as_mut().unwrap().image = Image::new(1, 1, 3);
    let found = baked(&bare, &views, &BakeConfig { balance_colors: true, ..OWN });
    assert!(found.uv.kept, "{:?}", found.uv);
    assert_eq!((found.views.len(), found.exposures, found.unseen), (30, None, 0.0));
    assert!(found.mask_iou > 0.97, "{}", found.mask_iou);
    assert_eq!(found.warnings, Vec::<String>::new());
    let (texture, own) = (found.mesh.texture.unwrap(), object.texture.unwrap());
    assert_eq!((&texture.uvs, &texture.faces), (&own.uvs, &own.faces));
    let away = error(&texture.image, [0.0; 2]);
    assert!(away < 0.007, "{away}");
    // Half a texel beside its place it would be told from the true one.
    for moved in [[0.5, 0.0], [-0.5, 0.0], [0.0, 0.5], [0.0, -0.5]] {
        let beside = error(&texture.image, moved);
        assert!(beside > 1.5 * away && beside > 0.007, "{moved:?}: {beside}, {away}");
    }
    // The two texels around a side are those of its border, whose pixels are half of the next side of the box. As the plane goes
    // on they would be that side's alone: 0.21.
    let rim = rim_error(&texture.image);
    assert!(rim < 0.15, "{rim}");
    // What surrounds a side repeats its border, so that nothing bleeds in: no texel is black.
    assert!(texture.image.data.iter().all(|&x| x > 0.15));
}

#[test]
fn threads_change_no_bit() {
    let object = textured_box();
    let views = views_of(&object, [-90.0, 90.0]);
    let config = BakeConfig { texture_size: None, ..OWN };
    let by = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let found = pool.install(|| baked(&object, &views, &config));
        (found.mesh, found.unseen.to_bits(), found.mask_iou.to_bits())
    };
    let one = by(1);
    assert!(one == by(2) && one == by(3));
    // As fine as the images: a side has some 60 pixels, and is a fifth of the texture's side.
    let side = one.0.texture.unwrap().image.width;
    assert!((150..300).contains(&side) && side % 8 == 0, "{side}");
}

#[test]
fn layouts_are_chosen_and_why_is_said() {
    let object = textured_box();
    let views = views_of(&object, [-90.0, 90.0]);
    let seen: Vec<&View> = views.iter().collect();
    let with = |mesh: &TriMesh, uv| bake(mesh, &seen, &BakeConfig { uv, ..OWN }, &|_, _| ());
    let all_on_one = |object: &TriMesh| {
        let mut mesh = object.clone();
        for face in &mut mesh.texture.as_mut().unwrap().faces {
            *face = face.map(|t| t % 4);
        }
        mesh
    };
    let overlapping = all_on_one(&object);
    let found = with(&overlapping, UvKind::Auto).unwrap();
    assert!(!found.uv.kept && found.uv.reason.contains("overlap"), "{:?}", found.uv);
    assert!(found.uv.coverage.unwrap().overlap > 0.99);
    let texture = found.mesh.texture.unwrap();
    assert_eq!([texture.image.width, texture.image.height], [SIDE; 2]);
    let kept = with(&overlapping, UvKind::Keep).unwrap();
    assert!(kept.uv.kept && kept.warnings[0].contains("overlap"), "{:?}", kept.warnings);
    assert!(!with(&object, UvKind::New).unwrap().uv.kept);

    let mut tiled = object.clone();
    tiled.texture.as_mut().unwrap().uvs.iter_mut().for_each(|uv| uv[0] *= 3.0);
    assert!(with(&tiled, UvKind::Auto).unwrap().uv.reason.contains("unit square"));
    let bare = TriMesh { texture: None, ..object };
    assert_eq!(with(&bare, UvKind::Auto).unwrap().uv.reason, "the mesh has none");
    for (mesh, words) in [(&tiled, "unit square"), (&bare, "not in the file")] {
        let error = with(mesh, UvKind::Keep).unwrap_err().to_string();
        assert!(error.contains(words) && error.contains("unwrap it anew"), "{error}");
    }
}

#[test]
fn what_photographs_differ_by_is_taken_out_of_few_faces_too() {
    let object = textured_box();
    let mut views = views_of(&object, [-90.0, 90.0]);
    for (i, view) in views.iter_mut().enumerate() {
        let factor = 0.8 + 0.1 * (i % 5) as f32;
        for byte in &mut view.color.data {
            *byte = (factor * f32::from(*byte)).round().min(255.0) as u8;
        }
    }
    let found = baked(&object, &views, &BakeConfig { balance_colors: true, ..OWN });
    let exposures = found.exposures.as_ref().unwrap();
    for (i, exposure) in exposures.iter().enumerate() {
        let ratio = exposure[1] / exposures[2][1];
        assert!((ratio - (0.8 + 0.1 * (i % 5) as f32)).abs() < 0.02, "{i}: {ratio}");
    }
    let [least, most] = found.exposure_range().unwrap();
    assert!(least < 0.85 && most > 1.15, "{least} {most}");
    let mixed = baked(&object, &views, &OWN);
    assert_eq!(mixed.exposures, None);
    let away = |found: Baked| error(&found.mesh.texture.unwrap().image, [0.0; 2]);
    let (balanced, mixed) = (away(found), away(mixed));
    assert!(balanced < 0.02 && balanced < mixed, "{balanced} {mixed}");
}

#[test]
fn what_no_view_shows_is_counted_and_filled() {
    let object = textured_box();
    // From above: the bottom is a sixth, with sides that are a little smaller.
    let found = baked(&object, &views_of(&object, [25.0, 90.0]), &OWN);
    assert!((found.unseen - 1.0 / 6.0).abs() < 0.01, "{}", found.unseen);
    let image = found.mesh.texture.unwrap().image;
    assert!(image.data.iter().all(|&x| (0.1..0.9).contains(&x)));
}

#[test]
fn a_mesh_that_is_turned_inside_out_is_turned_round() {
    let object = textured_box();
    let found = baked(&object.clone().flipped(), &views_of(&object, [-90.0, 90.0]), &OWN);
    assert!(found.warnings[0].contains("inwards"), "{:?}", found.warnings);
    assert!(found.mesh.volume() > 0.0);
    let away = error(&found.mesh.texture.unwrap().image, [0.0; 2]);
    assert!(away < 0.007, "{away}");
}

#[test]
fn any_mesh_is_baked_or_refused() {
    let object = textured_box();
    let views = views_of(&object, [-90.0, 90.0]);
    let seen: Vec<&View> = views.iter().collect();
    let fails = |mesh: &TriMesh, views: &[&View], config: &BakeConfig| {
        bake(mesh, views, config, &|_, _| ()).unwrap_err()
    };
    assert_eq!(fails(&object, &[], &OWN), BakeError::NoViews);
    assert!(matches!(fails(&TriMesh::default(), &seen, &OWN), BakeError::Mesh(_)));
    let point = TriMesh::new(vec![[1.0; 3]; 3], vec![[0, 1, 2]]);
    assert_eq!(fails(&point, &seen, &OWN), BakeError::NoExtent);
    let size = BakeConfig { texture_size: Some(63), ..OWN };
    assert!(fails(&object, &seen, &size).to_string().contains("texture-size"));
    let mut empty = views[0].clone();
    empty.mask.data.fill(0);
    assert_eq!(fails(&object, &[&empty], &OWN), BakeError::EmptyMasks { views: 1 });
    let ball = primitives::icosphere(5);
    let small = BakeConfig { texture_size: Some(64), ..OWN };
    let faces = ball.faces.len();
    assert_eq!(fails(&ball, &seen, &small), BakeError::Room { side: 64, faces });

    // A vertex without faces, a face without extent, a wall behind the cameras, a single face, a mesh that is elsewhere.
    let mut odd = TriMesh { texture: None, ..object.clone() };
    let first = odd.positions.len() as u32;
    odd.positions.extend([[0.3; 3], [0.1; 3], [0.1; 3], [0.1, 0.2, 0.1]]);
    odd.positions.extend([[-9.0, 0.0, 9.0], [9.0, 0.0, 9.0], [0.0, 9.0, -90.0]]);
    odd.faces.extend([[first + 1, first + 2, first + 3], [first + 4, first + 5, first + 6]]);
    let triangle = TriMesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]);
    let views = [&seen[..5], &[&empty]].concat();
    for mesh in [odd, triangle, object.translated([1e6, 0.0, 0.0])] {
        let found = bake(&mesh, &views, &BakeConfig { texture_size: None, ..OWN }, &|_, _| ());
        let found = found.unwrap();
        assert!(found.warnings.iter().any(|text| text.contains("mask is empty")));
        assert_eq!(found.views, [0, 1, 2, 3, 4]);
        assert!(found.mesh.validate().is_ok() && (0.0..=1.0).contains(&found.unseen));
        let colors = found.mesh.colors.unwrap();
        assert!(colors.iter().flatten().all(|x| (0.0..=1.0).contains(x)));
    }
}

#[test]
fn why_a_mesh_is_elsewhere_is_found() {
    let object = TriMesh { texture: None, ..textured_box() }.scaled([0.25, 1.5, 0.3]);
    let views = views_of(&object, [-90.0, 90.0]);
    let views: Vec<&View> = views.iter().collect();
    let found = |mesh: &TriMesh| Misfit::find(mesh, &views, UpAxis::Y);
    assert_eq!(found(&object), None);
    let turned = found(&object.clone().laid(UpAxis::Z));
    let Some(Misfit::Turned { mask_iou, .. }) = turned else { panic!("{turned:?}") };
    assert!(mask_iou > 0.9);
    let large = found(&object.clone().scaled([1000.0; 3]));
    let Some(Misfit::Scaled { factor }) = large else { panic!("{large:?}") };
    assert!((500.0..2000.0).contains(&factor), "{factor}");
    let moved = found(&object.clone().translated([9.0, 0.0, 0.0]));
    assert!(matches!(moved, Some(Misfit::Moved { radii }) if radii > 3.0), "{moved:?}");
    assert_eq!(Misfit::find(&object, &[], UpAxis::Y), None);
}
