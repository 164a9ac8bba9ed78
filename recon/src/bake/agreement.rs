//! Whether a mesh lies where the masks show an object.

use diff_raster::{Faces, NONE};
use rayon::prelude::*;

use super::sight::Sight;
use crate::fit::target::Target;

/// How a mesh and masks meet.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Agreement {
    /// Mean over the views of the intersection over union, around the mask.
    pub(super) mask_iou: f64,
    /// Whether more of what is seen is the inside of the surface than the outside.
    pub(super) inside_out: bool,
}

/// Draws the mesh into every view; positions are in the frame of the targets.
pub(super) fn agreement(
    targets: &[Target],
    positions: &[[f32; 3]],
    faces: &[[u32; 3]],
) -> Agreement {
    let drawn = Faces::of_valid(positions.len(), faces);
    let look = |sight: &mut Sight, target: &Target| {
        sight.look_at_both_sides(target, positions, &drawn);
        let seen = &sight.fragments.face;
        let covered: Vec<bool> = seen.iter().map(|&face| face != NONE).collect();
        let shown = seen.iter().filter(|&&face| face != NONE);
        let behind = shown.filter(|&&face| sight.doubled_area(faces[face as usize]) < 0.0).count();
        (target.iou(&covered), behind, covered.iter().filter(|covered| **covered).count())
    };
    let found: Vec<_> = targets.par_iter().map_init(Sight::default, look).collect();
    let iou: f64 = found.iter().map(|(iou, ..)| iou).sum();
    let [behind, all] = found.iter().fold([0, 0], |[b, a], (_, behind, all)| [b + behind, a + all]);
    Agreement { mask_iou: iou / targets.len().max(1) as f64, inside_out: 2 * behind > all }
}
