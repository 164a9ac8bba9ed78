//! A texture for any mesh, in charts that mipmaps do not mix.

use datasets::View;
use mesh_core::vector::interpolate;
use mesh_core::{Image, Texture, bilinear};
use rayon::prelude::*;

use super::exposure::Exposure;
use super::sight::{Photographed, Sight};
use crate::atlas::{Atlas, Texel};
use crate::fit::target::Target;

/// Colour difference at which a view's weight has fallen to a half in the second round.
const OUTLIER: f32 = 0.15;

/// The longest side of a texture that nobody asked for.
pub(super) const MOST: usize = 4096;

/// Rounds over all views.
const ROUNDS: usize = 2;

/// A texture, and how much of it is a guess.
pub(crate) struct Painted {
    /// As fine as its atlas.
    pub(crate) texture: Texture,
    /// The share of the texels on the surface that no view shows; 0 where there are none.
    pub(crate) unseen: f64,
}

/// Pixels to a unit of length of the frame in which the surface is, in the view that is nearest to its origin.
pub(super) fn finest(targets: &[Target]) -> f32 {
    let pixels = |t: &Target| t.pixels_per_unit(t.project([0.0; 3])[2]);
    targets.iter().map(pixels).fold(0.0, f32::max)
}

/// A layout of charts. Without a `side` an edge gets as many texels as it has pixels in the image that is nearest.
///
/// `None` if `side` has no room for the faces.
pub(crate) fn atlas(photographed: &Photographed<'_>, side: Option<usize>) -> Option<Atlas> {
    let &Photographed { targets, positions, faces, .. } = photographed;
    match side {
        Some(side) => Atlas::within(positions, faces, side),
        None => Some(Atlas::new(positions, faces, finest(targets), MOST)),
    }
}

/// Weighted mean of what the views show at every texel; `colors` where none shows it.
///
/// A view counts by how squarely and how large it shows the face, and not at all where another part of the
/// mesh is in front. In a second round views that differ from the mean of the first count less:
/// highlights are in few views. `progress` hears how many looks are done, of how many.
pub(crate) fn painted(
    photographed: &Photographed<'_>,
    exposure: &Exposure,
    colors: &[[f32; 3]],
    atlas: Atlas,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Painted {
    let &Photographed { views, targets, positions, faces, .. } = photographed;
    let texels = atlas.texels();
    let mut mean: Vec<[f32; 3]> = texels
        .par_iter()
        .map(|t| interpolate(t.barycentric, &faces[t.face as usize].map(|v| colors[v as usize])))
        .collect();
    let mut sums = vec![[0.0f32; 4]; mean.len()];
    let mut facing = vec![0.0; faces.len()];
    for round in 0..ROUNDS {
        sums.fill([0.0; 4]);
        let mut sight = Sight::default();
        for (index, (target, view)) in targets.iter().zip(views).enumerate() {
            sight.look(target, positions, &photographed.drawn);
            let sight = &sight;
            facing
                .par_iter_mut()
                .zip(faces)
                .with_min_len(1024)
                .for_each(|(facing, &face)| *facing = sight.facing(target, positions, face));
            let texels = sums.par_iter_mut().zip(&mean).zip(texels).with_min_len(4096);
            texels.for_each(|((sum, mean), texel)| {
                let facing = facing[texel.face as usize];
                if facing < 0.1 {
                    return;
                }
                let corners = faces[texel.face as usize].map(|v| positions[v as usize]);
                let q = target.project(interpolate(texel.barycentric, &corners));
                let Some((color, inside)) = seen(sight, target, view, q) else { return };
                let color = exposure.brought(index, color);
                let scale = target.pixels_per_unit(q[2]);
                let mut weight = inside * facing * facing * facing * scale * scale;
                if round > 0 {
                    let square: f32 = (0..3).map(|c| (color[c] - mean[c]).powi(2)).sum();
                    weight /= 1.0 + square / (OUTLIER * OUTLIER);
                }
                for c in 0..3 {
                    sum[c] += weight * color[c];
                }
                sum[3] += weight;
            });
            progress(round * targets.len() + index + 1, ROUNDS * targets.len());
        }
        for (mean, sum) in mean.iter_mut().zip(&sums) {
            if sum[3] > 0.0 {
                *mean = std::array::from_fn(|c| sum[c] / sum[3]);
            }
        }
    }
    let unseen = unseen(texels, &sums);
    let mut image = Image::new(atlas.side(), atlas.side(), 3);
    for (texel, mean) in texels.iter().zip(&mean) {
        image.data[3 * texel.index as usize..][..3]
            .copy_from_slice(&mean.map(|c| c.clamp(0.0, 1.0)));
    }
    Painted { texture: atlas.texture(image), unseen }
}

/// The share of the texels on the surface itself to which no view gave anything.
fn unseen(texels: &[Texel], sums: &[[f32; 4]]) -> f64 {
    // Those around a piece of it lie at the border of a face, or beyond.
    let on_surface = |texel: &Texel| texel.barycentric.iter().all(|&b| b > 0.0);
    let (mut all, mut without) = (0usize, 0usize);
    for (_, sum) in texels.iter().zip(sums).filter(|(texel, _)| on_surface(texel)) {
        all += 1;
        without += usize::from(sum[3] <= 0.0);
    }
    without as f64 / all.max(1) as f64
}

/// The colour of a view at a projected point, bilinear, and how far inside the mask it is; `None`
/// where it is outside of the mask or behind another part of the mesh.
fn seen(sight: &Sight, target: &Target, view: &View, q: [f32; 3]) -> Option<([f32; 3], f32)> {
    let [column, row, depth] = q;
    // A mesh that nobody fitted may reach behind the camera.
    if target.perspective && depth <= 0.0 {
        return None;
    }
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
    let bytes = bilinear([target.width, target.height], [column - 0.5, row - 0.5], |i, j| {
        let pixel = view.color.pixel(target.top + i, target.left + j);
        std::array::from_fn(|c| f32::from(pixel[c]))
    });
    Some((bytes.map(|byte| byte / 255.0), inside.min(1.0)))
}
