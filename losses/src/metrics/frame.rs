//! Whether two meshes lie in the same coordinates at all.

use std::fmt;

use mesh_core::bounds::longest_side;
use mesh_core::{TriMesh, sample_points};

use super::bounds::bounds;
use super::{point_distances, voxel_iou};

/// Meshes of one object differ by less than this in size.
const SIZES: f64 = 3.0;
/// Volumes that share less than this share nothing.
const SHARED: f64 = 0.01;
/// Surfaces that are this far apart on average, in the prediction's longest sides, are not the same one.
const NEAR: f64 = 0.05;
/// Cells along the longest side of the grid on which volumes are compared.
const CELLS: usize = 32;
/// Points on each surface.
const SAMPLES: usize = 1_000;

/// Why a true mesh seems to be in other coordinates than the mesh that is compared with it.
///
/// Figures of such a pair are small for a reason that has nothing to do with the shapes. A turn about the object's own
/// centre is not found: the volumes meet.
///
/// ```
/// use losses::metrics::FrameMismatch;
/// use mesh_core::primitives::icosphere;
///
/// let ball = icosphere(2);
/// assert_eq!(FrameMismatch::of(&ball, &ball), None);
/// let millimetres = ball.clone().scaled([1000.0; 3]);
/// let found = FrameMismatch::of(&ball, &millimetres).unwrap();
/// assert_eq!(
///     found.to_string(),
///     "the truth lies in another frame: it is 1000 times as large as the mesh"
/// );
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum FrameMismatch {
    /// The sizes differ by more than a few times.
    Size {
        /// The truth's longest side, by that of the prediction.
        times: f64,
    },
    /// The bounding boxes do not meet.
    Apart {
        /// The distance of their centres, by the prediction's longest side.
        sides: f64,
    },
    /// The boxes meet, but neither volumes nor surfaces do.
    Disjoint {
        /// The 3D IoU.
        iou: f64,
        /// The mean distance from the truth's surface to the prediction, by the prediction's longest side.
        sides: f64,
    },
}

impl FrameMismatch {
    /// What speaks against a common frame; `None` where nothing does, and for meshes without a surface or with
    /// coordinates that are not finite.
    ///
    /// # Cost
    /// Milliseconds: 1,000 points each and a grid of 32 cells.
    pub fn of(prediction: &TriMesh, truth: &TriMesh) -> Option<Self> {
        if prediction.validate().is_err() || truth.validate().is_err() {
            return None;
        }
        let ((p0, p1), (t0, t1)) = (bounds(prediction)?, bounds(truth)?);
        let (own, other) = (longest_side((p0, p1)), longest_side((t0, t1)));
        if own <= 0.0 || other <= 0.0 {
            return None;
        }
        let times = other / own;
        if !(1.0 / SIZES..=SIZES).contains(&times) {
            return Some(Self::Size { times });
        }
        if (0..3).any(|k| p0[k] > t1[k] || t0[k] > p1[k]) {
            let square = |k: usize| (0.5 * (p0[k] + p1[k] - t0[k] - t1[k])).powi(2);
            let sides = (0..3).map(square).sum::<f64>().sqrt() / own;
            return Some(Self::Apart { sides });
        }
        let iou = voxel_iou(prediction, truth, CELLS);
        if iou >= SHARED {
            return None;
        }
        let [(points, _), (true_points, _)] =
            [prediction, truth].map(|mesh| sample_points(mesh, SAMPLES, 0));
        if points.is_empty() || true_points.is_empty() {
            return None;
        }
        let (_, completeness) = point_distances(&points, &true_points).chamfer(false);
        let sides = completeness / own;
        (sides > NEAR).then_some(Self::Disjoint { iou, sides })
    }
}

impl fmt::Display for FrameMismatch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("the truth lies in another frame: ")?;
        match *self {
            Self::Size { times } if times < 1.0 => {
                write!(f, "the mesh is {} times as large as it", Short(1.0 / times))
            }
            Self::Size { times } => {
                write!(f, "it is {} times as large as the mesh", Short(times))
            }
            Self::Apart { sides } => {
                let sides = Short(sides);
                write!(
                    f,
                    "the bounding boxes do not meet, their centres are {sides} of the mesh's sides apart"
                )
            }
            Self::Disjoint { iou, sides } => write!(
                f,
                "the volumes share nothing (3D IoU {iou:.4}), and its surface is {} of the mesh's sides away",
                Short(sides)
            ),
        }
    }
}

/// A number with two digits or three, as people say it.
struct Short(f64);

impl fmt::Display for Short {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let digits = if self.0 < 1.0 { 2 } else { usize::from(self.0 < 20.0) };
        write!(f, "{:.digits$}", self.0)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::primitives::{cuboid, icosphere, torus};

    use super::*;

    fn words(prediction: &TriMesh, truth: &TriMesh) -> String {
        FrameMismatch::of(prediction, truth).unwrap().to_string()
    }

    #[test]
    fn another_frame_is_told_from_a_bad_fit() {
        let ball = icosphere(3);
        let moved = |by: f32| ball.clone().translated([by, 0.0, 0.0]);
        // A fit that is poor, or moved by half of its size, lies in the same frame.
        for truth in [cuboid([1.2, 2.0, 0.9]), moved(1.0), torus(1.0, 0.1, 32, 8)] {
            assert_eq!(FrameMismatch::of(&ball, &truth), None);
        }
        assert!(
            words(&ball, &ball.clone().scaled([0.01; 3]))
                .contains("the mesh is 100 times as large")
        );
        assert!(words(&ball, &ball.clone().scaled([3.5; 3])).contains("it is 3.5 times as large"));
        let apart = words(&ball, &moved(10.4));
        assert!(apart.contains("do not meet") && apart.contains("5.2 of the mesh's sides"));
        // Beside each other at a corner: the boxes overlap, the balls do not.
        let corner = ball.clone().translated([1.5; 3]);
        let text = words(&ball, &corner);
        assert!(text.contains("share nothing (3D IoU 0.0000)"), "{text}");
    }

    #[test]
    fn a_truth_without_volume_is_judged_by_its_surface() {
        let card = |z: f32| {
            let corners = [[-1.0, -1.0, z], [1.0, -1.0, z], [1.0, 1.0, z], [-1.0, 1.0, z]];
            TriMesh::new(corners.to_vec(), vec![[0, 1, 2], [0, 2, 3]])
        };
        let slab = cuboid([2.0, 2.0, 0.02]);
        assert_eq!(FrameMismatch::of(&slab, &card(0.0)), None);
        assert!(FrameMismatch::of(&slab, &card(1.0)).is_some());
        assert_eq!(FrameMismatch::of(&TriMesh::default(), &slab), None);
    }
}
