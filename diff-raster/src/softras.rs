//! SoftRas: every face is a cloud, and depth decides by a soft maximum.

use std::sync::Arc;

use autodiff_lite::Real;

use crate::Faces;
use crate::kernels::setup::Centers;
use crate::kernels::softras::State;
use crate::scratch_pool::ScratchPool;
use crate::softras_settings::SoftRasSettings;

/// What [`softras`](fn@crate::softras) needs beside its inputs: faces, settings, and memory that it uses
/// again. Make it once and share it.
#[derive(Debug)]
pub struct SoftRas<F: Real = f32> {
    pub(crate) faces: Arc<Faces>,
    pub(crate) settings: SoftRasSettings,
    pub(crate) centers: Centers<F>,
    pub(crate) states: ScratchPool<State<F>>,
}

impl<F: Real> SoftRas<F> {
    /// For these faces and images.
    ///
    /// # Panics
    /// If a temperature is not positive, the range of depths is empty, or the least coverage is not between 0 and a half.
    pub fn new(faces: &Arc<Faces>, settings: &SoftRasSettings) -> Arc<Self> {
        let s = settings;
        assert!(
            s.sigma > 0.0 && s.gamma > 0.0 && s.far > s.near && s.least > 0.0 && s.least < 0.5,
            "SoftRas: sigma {} and gamma {} must be positive, depths {} to {} a range, the least \
             coverage {} within (0, 0.5)",
            s.sigma,
            s.gamma,
            s.near,
            s.far,
            s.least
        );
        let mut centers = Centers::default();
        centers.prepare(s.height, s.width);
        Arc::new(Self {
            faces: Arc::clone(faces),
            settings: s.clone(),
            centers,
            states: ScratchPool::default(),
        })
    }

    /// The faces.
    pub fn faces(&self) -> &Arc<Faces> {
        &self.faces
    }

    /// The settings.
    pub fn settings(&self) -> &SoftRasSettings {
        &self.settings
    }
}

/// The barycentric coordinates of the middles of a face's `side²` texels, in the order in which
/// [`Paint::Texels`](crate::Paint) has them: where to look a texture up.
///
/// ```
/// let middles = diff_raster::texel_centers(6);
/// assert_eq!(middles.len(), 36);
/// assert!(middles.iter().all(|w| w.iter().all(|&w| w > 0.0)));
/// ```
pub fn texel_centers(side: usize) -> Vec<[f64; 3]> {
    let size = side as f64;
    let middle = |at: usize| {
        let (i, j) = (at / side, at % side);
        // The lower triangles, and the upper ones turned into the other half of the square.
        let part = |k: usize| {
            if i + j < side {
                (k as f64 + 1.0 / 3.0) / size
            } else {
                ((side - 1 - k) as f64 + 2.0 / 3.0) / size
            }
        };
        [part(j), part(i), 1.0 - part(i) - part(j)]
    };
    (0..side * side).map(middle).collect()
}
