//! How SoftRas draws.

use crate::Instructions;

/// Size of the image and the two temperatures of SoftRas.
///
/// ```
/// use diff_raster::SoftRasSettings;
///
/// let settings = SoftRasSettings { sigma: 1e-4, ..SoftRasSettings::new(64, 64) };
/// assert!(settings.reach() > 0.03 && settings.reach() < 0.031); // in NDC: one pixel
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct SoftRasSettings {
    /// Rows of the image, `H`.
    pub height: usize,
    /// Columns of the image, `W`.
    pub width: usize,
    /// How far a face spreads: it covers a pixel at squared distance `d²` from its border, in NDC,
    /// by `sigmoid(± d² / sigma)`, plus inside. Must be positive.
    pub sigma: f64,
    /// How soft the decision between depths is: the smaller, the more the nearest face wins. In
    /// units of `far - near`. Must be positive.
    pub gamma: f64,
    /// The range of depths that colours come from.
    pub near: f64,
    /// Its end.
    pub far: f64,
    /// A face is left out where it would cover less than this.
    pub least: f64,
    /// The background stands at this part of the range from its end.
    pub background: f64,
    /// What shows where nothing is, one number for each channel of the paint. Empty is black, as published.
    pub background_color: Vec<f64>,
    /// Whether colours of vertices are interpolated as a perspective camera sees them. Depth is so
    /// in any case.
    pub perspective: bool,
    /// Which instructions to use; every choice gives the same images up to rounding.
    pub instructions: Instructions,
}

impl SoftRasSettings {
    /// The published temperatures, for cameras that stand a few units away; colours
    /// perspective-correct.
    pub fn new(height: usize, width: usize) -> Self {
        Self { perspective: true, ..Self::published(height, width) }
    }

    /// As published, where colours are interpolated linearly on the screen.
    ///
    /// Liu et al. 2019, *Soft Rasterizer*, and the defaults of its code: `sigma` 1e-5, `gamma` 1e-4,
    /// depths 1 to 100, coverage of 1e-4 at least, background at 1e-3.
    pub fn published(height: usize, width: usize) -> Self {
        Self {
            height,
            width,
            sigma: 1e-5,
            gamma: 1e-4,
            near: 1.0,
            far: 100.0,
            least: 1e-4,
            background: 1e-3,
            background_color: Vec::new(),
            perspective: false,
            instructions: Instructions::Best,
        }
    }

    /// How far from its border a face is seen, in NDC.
    pub fn reach(&self) -> f64 {
        (self.sigma * (1.0 / self.least - 1.0).ln()).max(0.0).sqrt()
    }
}
