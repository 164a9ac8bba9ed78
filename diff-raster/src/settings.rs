//! What to draw, and by which rules.

use pulp::Arch;

/// Size of the image, visibility rules and the shape of the soft silhouette.
///
/// [`Settings::new`] is what to use; [`Settings::published`] is DIB-R as its authors defined it,
/// accidents included, for comparing with published results.
///
/// ```
/// use diff_raster::Settings;
///
/// let settings = Settings { sigma_inv: 70.0, ..Settings::new(240, 320) };
/// assert!(settings.perspective && settings.max_faces.is_none());
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Rows of the image, `H`.
    pub height: usize,
    /// Columns of the image, `W`.
    pub width: usize,
    /// Faces with a corner at this planar depth or nearer are dropped, so that nothing behind the
    /// camera is ever drawn mirrored. In the unit of the depths: [`near_within`](Self::near_within) suits any.
    pub near: f64,
    /// Whether faces that turn clockwise on the screen are invisible. The soft silhouette is made
    /// of all faces either way, as in DIB-R.
    pub cull_back_faces: bool,
    /// Whether depth and attributes are interpolated as a perspective camera sees them (linear in
    /// space). `false` interpolates linearly on the screen: right for orthographic cameras, and
    /// what DIB-R does always.
    pub perspective: bool,
    /// Sharpness of the soft silhouette: a face at squared distance `d²` (in NDC, where the image
    /// is 2 wide) covers a background pixel with probability `exp(-sigma_inv d²)`.
    pub sigma_inv: f64,
    /// A face reaches background pixels within its bounding box enlarged by this much, in NDC.
    pub box_length: f64,
    /// At most this many faces, the first by index, make the soft silhouette of a pixel.
    /// `None` is no limit.
    pub max_faces: Option<usize>,
    /// Which pixels on the border of a face belong to it, and the guards against division by zero.
    pub rule: Rule,
    /// Which instructions to use; every choice gives the same images up to rounding.
    pub instructions: Instructions,
}

impl Settings {
    /// Perspective-correct, no limit on faces; the silhouette as sharp as DIB-R's default.
    pub fn new(height: usize, width: usize) -> Self {
        Self {
            height,
            width,
            near: 1e-4,
            cull_back_faces: false,
            perspective: true,
            sigma_inv: 7000.0,
            box_length: 0.02,
            max_faces: None,
            rule: Rule::Closed,
            instructions: Instructions::Best,
        }
    }

    /// DIB-R, as kaolin implements it: interpolation linear on the screen, no near plane, the soft
    /// silhouette of a pixel made of the first 30 faces by index.
    ///
    /// Chen et al. 2019, *Learning to Predict 3D Objects with an Interpolation-based
    /// Differentiable Renderer*. Faces that do not face the camera are the caller's to cull
    /// ([`cull_back_faces`](Self::cull_back_faces)). Two things differ, neither of which shows on
    /// any mesh that shows anything: faces of zero area cover nothing, and kaolin's guards against
    /// division by zero in distances and areas (`1e-7` and `1e-8` at 1000 times the scale: a
    /// relative `1e-9` for edges of a pixel) are only in [`mod@crate::reference`].
    pub fn published(height: usize, width: usize) -> Self {
        Self {
            near: f64::NEG_INFINITY,
            perspective: false,
            max_faces: Some(30),
            rule: Rule::Published,
            ..Self::new(height, width)
        }
    }

    /// The same with its near plane at a millionth of the farthest of these depths where that is nearer than it is, so that no unit of
    /// the world is too small, and a vertex far away hides nothing; nowhere where rays are parallel, which also come from behind.
    ///
    /// ```
    /// use diff_raster::Settings;
    ///
    /// let settings = Settings::new(8, 8).near_within([2e-5, 3e-5]);
    /// assert!(settings.near > 0.0 && settings.near < 1e-10);
    /// assert_eq!(Settings::new(8, 8).near_within([3.0, 1e7]), Settings::new(8, 8));
    /// ```
    #[must_use]
    pub fn near_within(self, depths: impl IntoIterator<Item = f32>) -> Self {
        const SHARE: f64 = 1e-6;
        let near = if self.perspective {
            let farthest = depths.into_iter().filter(|depth| depth.is_finite()).fold(0.0, f32::max);
            self.near.min(SHARE * f64::from(farthest))
        } else {
            f64::NEG_INFINITY
        };
        Self { near, ..self }
    }

    /// Numbers with which a silhouette is a probability.
    #[track_caller]
    pub(crate) fn check(&self) {
        let Self { sigma_inv, box_length, near, .. } = *self;
        assert!(
            sigma_inv >= 0.0 && box_length >= 0.0 && !near.is_nan(),
            "rasterize: sigma_inv {sigma_inv}, box_length {box_length}, near {near}, expected the first two at least 0"
        );
    }

    /// Number of pixels of one image.
    pub fn pixels(&self) -> usize {
        self.height * self.width
    }
}

/// The two conventions on borders.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Rule {
    /// A pixel centre on the border of a face is inside. Neighbouring faces leave no gap.
    Closed,
    /// The same, but centres on the right or the top border of a face's bounding box are outside,
    /// and gradients of the soft silhouette divide by `1 - p + 1e-7`: DIB-R.
    Published,
}

/// Which vector instructions a kernel uses.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Instructions {
    /// The widest that the processor has.
    Best,
    /// None: the twin that every processor runs.
    Scalar,
    /// AVX2 and FMA, where the processor has them, else [`Scalar`](Self::Scalar).
    Avx2,
}

impl Instructions {
    /// What `pulp` calls it on this processor.
    pub fn arch(self) -> Arch {
        match self {
            Self::Best => Arch::new(),
            Self::Scalar => Arch::Scalar,
            #[cfg(any(target_arch = "x86", target_arch = "x86_64"))]
            Self::Avx2 => pulp::x86::V3::try_new().map_or(Arch::Scalar, Arch::V3),
            #[cfg(not(any(target_arch = "x86", target_arch = "x86_64")))]
            Self::Avx2 => Arch::Scalar,
        }
    }
}
