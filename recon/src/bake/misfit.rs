//! What is probably wrong where a mesh and the masks do not meet.

use datasets::View;
use mesh_core::{TriMesh, UpAxis};

use super::agreement::agreement;
use super::placed::{Placed, targets};
use crate::fit::bounding_sphere;

/// Views that are looked at, at most.
const VIEWS: usize = 12;
/// The mask IoU below which a mesh is hardly where the object is.
pub const MISSED: f64 = 0.5;
/// How many times as large as the object a mesh is at least that is in another unit.
const UNIT: f64 = 2.0;

/// Why a mesh lies elsewhere than the object that the views show.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Misfit {
    /// Turned so that this axis of it is up, it would lie there.
    Turned {
        /// The axis that is up in the mesh.
        up: UpAxis,
        /// The mask IoU that it would have.
        mask_iou: f64,
    },
    /// It is in another unit: so many times as large as the object.
    Scaled {
        /// How many times.
        factor: f64,
    },
    /// It lies beside the object: so far from it, in radii of the object.
    Moved {
        /// How far.
        radii: f64,
    },
    /// Neither of these.
    Unknown,
}

impl Misfit {
    /// Looks for the reason; `None` where the mean mask IoU of a dozen views is [`MISSED`] or more, or no view has a mask.
    ///
    /// `up` is the axis that is up in the world of the cameras.
    ///
    /// ```
    /// use mesh_core::{UpAxis, primitives};
    /// use recon::bake::Misfit;
    /// use synth::{Orbit, RenderOptions, render_views};
    ///
    /// let object = primitives::cuboid([0.4, 2.0, 0.4]);
    /// let cameras = Orbit { count: 6, width: 48, height: 48, ..Orbit::default() }.cameras();
    /// let views = render_views(&object, &cameras, &RenderOptions::default(), &|_, _| ())?;
    /// let views: Vec<_> = views.iter().collect();
    /// assert_eq!(Misfit::find(&object, &views, UpAxis::Y), None);
    /// let lying = object.laid(UpAxis::Z);
    /// let found = Misfit::find(&lying, &views, UpAxis::Y);
    /// assert!(matches!(found, Some(Misfit::Turned { up: UpAxis::Z | UpAxis::MinusZ, .. })));
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Panics
    /// If a face names a vertex that is not there.
    pub fn find(mesh: &TriMesh, views: &[&View], up: UpAxis) -> Option<Self> {
        let stride = views.len().div_ceil(VIEWS).max(1);
        let views: Vec<&View> = views.iter().step_by(stride).copied().collect();
        let (mut targets, views) = targets(&views);
        let mut mask_iou = |mesh: &TriMesh| {
            let Some(placed) = Placed::of(mesh) else { return 0.0 };
            placed.place(&mut targets);
            agreement(&targets, &placed.positions, &mesh.faces).mask_iou
        };
        if views.is_empty() || mask_iou(mesh) >= MISSED {
            return None;
        }
        let turned = UpAxis::ALL.map(|up_in_mesh| {
            let turned = mesh.clone().upright(up_in_mesh).laid(up);
            (up_in_mesh, mask_iou(&turned))
        });
        let best = turned.into_iter().fold((up, 0.0), |a, b| if b.1 > a.1 { b } else { a });
        if best.1 >= MISSED {
            return Some(Self::Turned { up: best.0, mask_iou: best.1 });
        }
        let (Ok((center, radius)), Some(own)) = (bounding_sphere(&views), Placed::of(mesh)) else {
            return Some(Self::Unknown);
        };
        let factor = own.radius / radius;
        if !(1.0 / UNIT..=UNIT).contains(&factor) {
            return Some(Self::Scaled { factor });
        }
        let between: f64 = (0..3).map(|k| (own.center[k] - center[k]).powi(2)).sum();
        let radii = between.sqrt() / radius;
        Some(if radii > 1.0 { Self::Moved { radii } } else { Self::Unknown })
    }
}
