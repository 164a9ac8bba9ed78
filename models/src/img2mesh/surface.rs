//! A mesh against the true surface.

use losses::metrics::{Points, Protocol, evaluate};
use mesh_core::TriMesh;

use crate::quality::Quality;

/// Points on each surface for distances; the protocol's 100,000 would take longer than the training.
const POINTS: usize = 10_000;

/// How a mesh compares with the true one.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Surface {
    pub(super) chamfer: f64,
    pub(super) f_score: f64,
    pub(super) quality: Quality,
}

/// Occupancy Networks' protocol with fewer points: the unit is the true mesh's longest edge. A mesh
/// that cannot be compared, having no area for example, is as far away as that.
pub(super) fn compared(mesh: &TriMesh, truth: &TriMesh) -> Surface {
    let mut protocol = Protocol::occ_net(0);
    protocol.points = Some(Points::Surface { samples: POINTS });
    (protocol.iou, protocol.normals) = (None, false);
    let report = evaluate(mesh, truth, &protocol).ok();
    let found = report.and_then(|report| {
        let f_score = report.f_scores.first()?.f_score;
        Some((report.chamfer?, f_score))
    });
    let (chamfer, f_score) = found.unwrap_or((1.0, 0.0));
    Surface { chamfer, f_score, quality: Quality::of(mesh) }
}
