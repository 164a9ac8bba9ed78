//! What is seen at each pixel.

use std::sync::Arc;

use autodiff_lite::Real;

use crate::faces::{Faces, NONE};
use crate::kernels::setup::{Centers, Setup};
use crate::{Rule, Settings};

/// What is seen at each pixel of a batch of images: plain values, shared by the operations.
///
/// Visibility has no derivative; the operations that take fragments hold it fixed.
#[derive(Clone, Debug)]
pub struct Fragments<F: Real = f32> {
    /// The nearest face, [`NONE`] at background. `[N, H, W]`
    pub face: Vec<u32>,
    /// Its barycentric coordinates (perspective-correct if the settings say so), zero at
    /// background. `[N, H, W, 3]`
    pub barycentric: Vec<F>,
    /// Its planar depth, `+∞` at background. `[N, H, W]`
    pub depth: Vec<F>,
    pub(crate) batch: usize,
    pub(crate) faces: Arc<Faces>,
    pub(crate) settings: Settings,
    pub(crate) centers: Centers<F>,
    pub(crate) setups: Vec<Setup<F>>,
}

impl<F: Real> Default for Fragments<F> {
    fn default() -> Self {
        Self {
            face: Vec::new(),
            barycentric: Vec::new(),
            depth: Vec::new(),
            batch: 0,
            faces: Arc::default(),
            settings: Settings { rule: Rule::Closed, ..Settings::new(0, 0) },
            centers: Centers::default(),
            setups: Vec::new(),
        }
    }
}

/// Whether the same is seen of the same faces under the same settings.
impl<F: Real> PartialEq for Fragments<F> {
    fn eq(&self, other: &Self) -> bool {
        self.face == other.face
            && self.barycentric == other.barycentric
            && self.depth == other.depth
            && self.batch == other.batch
            && self.settings == other.settings
            && self.faces == other.faces
    }
}

impl<F: Real> Fragments<F> {
    /// `[N, H, W]`
    pub fn shape(&self) -> [usize; 3] {
        [self.batch, self.settings.height, self.settings.width]
    }

    /// The faces that were drawn.
    pub fn faces(&self) -> &Arc<Faces> {
        &self.faces
    }

    /// How they were drawn.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Hard coverage: 1 where a face is seen, else 0. `[N, H, W]`
    pub fn mask(&self) -> Vec<F> {
        let one = |&face: &u32| if face == NONE { F::zero() } else { F::one() };
        self.face.iter().map(one).collect()
    }

    /// Pixel centres of these images.
    pub fn centers(&self) -> &Centers<F> {
        &self.centers
    }

    /// The faces of one image as they were drawn.
    pub fn setup(&self, image: usize) -> &Setup<F> {
        &self.setups[image]
    }
}
