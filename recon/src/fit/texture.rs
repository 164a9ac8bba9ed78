//! A texture for any mesh: every face has texels of its own.

use std::sync::Arc;

use datasets::View;
use diff_raster::Faces;
use mesh_core::{Image, Texture};
use rayon::prelude::*;

use super::{sight::Sight, target::Target};
use crate::atlas::Atlas;

/// Colour difference at which a view's weight has fallen to a half in the second round.
const OUTLIER: f32 = 0.15;

/// The side at which an edge has as many texels as pixels in the nearest view, at most 4096.
fn side_for(targets: &[Target], positions: &[[f32; 3]], faces: &[[u32; 3]]) -> usize {
    let area: f32 = mesh_core::face_areas(positions, faces).iter().sum();
    let edge = (area / faces.len().max(1) as f32 * 2.3).sqrt();
    let nearest =
        targets.iter().map(|t| t.pixels_per_unit(t.project([0.0; 3])[2])).fold(0.0, f32::max);
    let columns = (faces.len().div_ceil(2) as f64).sqrt().ceil() as usize;
    let most = (4096 / columns.max(1)).max(5);
    let cell = ((edge * nearest).ceil() as usize).saturating_add(3).clamp(5, most);
    (columns * cell).next_multiple_of(4)
}

/// Weighted mean of what the views show at every texel; `colors` where none shows it.
///
/// A view counts by how squarely and how large it shows the face, and not at all where another part of the
/// mesh is in front. In a second round views that differ from the mean of the first count less:
/// highlights are in few views.
///
/// Without a `side` an edge gets as many texels as it has pixels in the image that is nearest.
/// `None` if `side` has no room for the faces. `views` and `targets` correspond.
pub(super) fn bake(
    views: &[&View],
    targets: &[Target],
    positions: &[[f32; 3]],
    faces: &[[u32; 3]],
    colors: &[[f32; 3]],
    side: Option<usize>,
) -> Option<Texture> {
    let side = side.unwrap_or_else(|| side_for(targets, positions, faces));
    let atlas = Atlas::new(faces.len(), side)?;
    let drawn = Arc::new(
        Faces::new(positions.len(), faces).expect("the faces of a fitted mesh name its vertices"),
    );
    let per_face = {
        let mut count = 0;
        atlas.texels(0, |_, _| count += 1);
        count
    };
    let mut mean = vec![[0.0f32; 3]; per_face * faces.len()];
    for (texels, face) in mean.chunks_exact_mut(per_face).zip(faces) {
        let mut k = 0;
        atlas.texels(0, |_, b| {
            texels[k] = mix(b, face.map(|v| colors[v as usize]));
            k += 1;
        });
    }
    let mut sums = vec![[0.0f32; 4]; mean.len()];
    for round in 0..2 {
        sums.fill([0.0; 4]);
        let mut sight = Sight::default();
        for (target, view) in targets.iter().zip(views) {
            sight.look(target, positions, &drawn);
            let sight = &sight;
            sums.par_chunks_mut(per_face)
                .zip(mean.par_chunks(per_face))
                .enumerate()
                .with_min_len(256)
                .for_each(|(index, (sums, mean))| {
                    let face = faces[index];
                    let facing = sight.facing(target, positions, face);
                    if facing < 0.1 {
                        return;
                    }
                    let corners = face.map(|v| positions[v as usize]);
                    let mut k = 0;
                    atlas.texels(index, |_, b| {
                        let slot = k;
                        k += 1;
                        let q = target.project(mix(b, corners));
                        let Some((color, inside)) = seen(sight, target, view, q) else { return };
                        let scale = target.pixels_per_unit(q[2]);
                        let mut weight = inside * facing * facing * facing * scale * scale;
                        if round > 0 {
                            let square: f32 =
                                (0..3).map(|c| (color[c] - mean[slot][c]).powi(2)).sum();
                            weight /= 1.0 + square / (OUTLIER * OUTLIER);
                        }
                        for c in 0..3 {
                            sums[slot][c] += weight * color[c];
                        }
                        sums[slot][3] += weight;
                    });
                });
        }
        for (mean, sum) in mean.iter_mut().zip(&sums) {
            if sum[3] > 0.0 {
                *mean = std::array::from_fn(|c| sum[c] / sum[3]);
            }
        }
    }
    let mut image = Image::new(side, side, 3);
    for index in 0..faces.len() {
        let mut k = index * per_face;
        atlas.texels(index, |texel, _| {
            image.data[3 * texel..3 * texel + 3]
                .copy_from_slice(&mean[k].map(|c| c.clamp(0.0, 1.0)));
            k += 1;
        });
    }
    Some(atlas.texture(faces.len(), image))
}

/// The colour of a view at a projected point, bilinear, and how far inside the mask it is; `None`
/// where it is outside of the mask or behind another part of the mesh.
fn seen(sight: &Sight, target: &Target, view: &View, q: [f32; 3]) -> Option<([f32; 3], f32)> {
    let [column, row, depth] = q;
    let inside = -target.distance(column, row) - 0.4;
    let within = column >= 0.5
        && row >= 0.5
        && column < target.width as f32 - 0.5
        && row < target.height as f32 - 0.5;
    if !within || inside <= 0.0 {
        return None;
    }
    // A pixel's depth is the surface's within what the surface can slope in a pixel and a half.
    let nearest = row as usize * target.width + column as usize;
    let slack = 3.0 * target.depth_per_unit() / target.pixels_per_unit(depth);
    if depth > sight.fragments.depth[nearest] + slack {
        return None;
    }
    let (x, y) = (column - 0.5, row - 0.5);
    let (i, j) = (x as usize, y as usize);
    let (fx, fy) = (x - i as f32, y - j as f32);
    let channels = view.color.channels;
    let at = |r: usize, c: usize, k: usize| {
        let pixel = (target.top + j + r) * view.color.width + target.left + i + c;
        f32::from(view.color.data[pixel * channels + k.min(channels - 1)])
    };
    let color = std::array::from_fn(|k| {
        let upper = at(0, 0, k) * (1.0 - fx) + at(0, 1, k) * fx;
        let lower = at(1, 0, k) * (1.0 - fx) + at(1, 1, k) * fx;
        (upper * (1.0 - fy) + lower * fy) / 255.0
    });
    Some((color, inside.min(1.0)))
}

fn mix(b: [f32; 3], x: [[f32; 3]; 3]) -> [f32; 3] {
    std::array::from_fn(|k| b[0] * x[0][k] + b[1] * x[1][k] + b[2] * x[2][k])
}
