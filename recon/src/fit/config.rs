//! What a fit can be told.

use datasets::View;
use serde::{Deserialize, Serialize};
use train::settings::{LARGEST, Options as _};

use super::distance::Blur;
use super::target::Target;

/// What a fit looks at around the object in each view, as a share of the longer side of its box: of views that are
/// [cropped](View::cropped_to_object) to more nothing is missed.
pub const MARGIN: f32 = 0.3;
/// The most rounds in which cameras and shape are refined in turn after a level, and the steps of the shape in each.
pub(super) const REFINING: (usize, usize) = (20, 20);

train::options! {
    /// Options of a fit, each with the default that [`FitConfig::default`] gives.
    ///
    /// Lengths without a unit are relative to the object, so that no option depends on the scale of
    /// the input.
    #[serde(deny_unknown_fields)]
    pub struct FitConfig {
        /// Seed of everything random: the order of views where `views-per-step` is not all of them.
        pub seed: u64 = 0, in ..=LARGEST;
        /// Every how many views one is held out and scored: with 5 the views 4, 9, 14 and so on. Where the source keeps views
        /// for tests (NeRF's and nerfstudio's splits), it is those; `none` fits all.
        #[serde(with = "train::settings::optional")]
        pub hold_out: Option<usize> = Some(5), in 2..=LARGEST as usize;
        /// Subdivision level of the icosphere to start from; slender objects and those that show a hole start from their
        /// hull, at the level before the last or this one. Level 3 has 642 vertices.
        pub start_level: u32 = 3, in 1..=6;
        /// Subdivision level to end with; 5 has 10,242 vertices.
        pub level: u32 = 5, in 1..=7;
        /// How many holes the mesh may have: `"auto"`, those that masks show, or `"sphere"`, none; then an object that has some is cut.
        pub topology: TopologyKind = TopologyKind::Auto;
        /// Steps at each level, at most.
        pub steps: usize = 150, in 1..=100_000;
        /// Views in each step; without, all, which is cheap and has no noise, but 32 where surfaces are made even at the end.
        #[serde(with = "train::settings::optional")]
        pub views_per_step: Option<usize> = None, in 1..=LARGEST as usize;
        /// Length of a step, in radii of the sphere of the object's volume; it falls to a tenth of this within each
        /// level.
        pub learning_rate: f32 = 0.05, in 1e-6..=1.0;
        /// How far a pull on one vertex spreads over the surface: lambda of the preconditioner `(I + lambda L)^-1`.
        /// Larger is smoother and slower to follow corners.
        pub smoothness: f32 = 4.0, in 0.0..=1e4;
        /// Weight of the bending energy (squared uniform Laplacian of the Laplacian).
        pub bending: f32 = 0.1, in 0.0..=1e4;
        /// Every how many steps the vertices slide along the surface to even out the triangles.
        #[serde(with = "train::settings::optional")]
        pub relax_every: Option<usize> = Some(5), in 1..=LARGEST as usize;
        /// How far they slide, as a share of the way to their neighbours' centre.
        pub relax: f32 = 0.3, in 0.0..=1.0;
        /// How far from a mask's edge its pull still grows, as a share of the object's size in that image.
        pub reach: f32 = 0.15, in 0.001..=2.0;
        /// Blur of the masks' signed distance in pixels: what makes their edges known between pixels.
        pub mask_blur: f32 = 1.0, in 0.0..=16.0;
        /// Whether poses and focal length are refined where the outlines show that they are off.
        pub refine_cameras: bool = true;
        /// Whether colours are brought to one exposure and white balance where photographs differ in these.
        pub balance_colors: bool = true;
        /// Whether the surface moves into hollows, which no outline shows, where photographs agree about their depth.
        pub photometric: bool = false;
        /// Whether normals are evened out behind the last level, where outlines do not suffer: dimples go, sides become flat and edges sharp.
        pub filter_normals: bool = true;
        /// Whether thin parts and gaps get back the share of their width that the blur takes; where cameras are off, once they are refined.
        pub thin_parts: bool = true;
        /// A level ends early, after half of its steps, when the outline's distance to the masks falls by less than
        /// this share over 20 steps; never with `views-per-step`, where each step has other views.
        pub tolerance: f64 = 0.01, in 0.0..1.0;
        /// Where colours are kept: `"vertex"`, or `"texture"`, which has them per vertex as well.
        pub color: ColorKind = ColorKind::Vertex;
        /// Side of the texture in pixels, best a multiple of 8; without, it is as fine as the images.
        #[serde(with = "train::settings::optional")]
        pub texture_size: Option<usize> = None, in 64..=8192;
        /// Side of the turntable and of the page's images of views, pixels.
        pub picture_size: usize = 256, in 64..=2048;
    }
}

/// Where the colours of a fitted mesh are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ColorKind {
    /// One colour per vertex.
    Vertex,
    /// A texture, with one colour per vertex besides.
    Texture,
}

/// How many holes a fitted mesh may have.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TopologyKind {
    /// As many as masks show, and as many parts.
    Auto,
    /// None, in one part.
    Sphere,
}

impl FitConfig {
    /// What is wrong with these options, one sentence each; empty when nothing is.
    pub fn check(&self) -> Vec<String> {
        let mut problems = self.out_of_range();
        let (start, level) = (self.start_level, self.level);
        if level < start {
            problems.push(format!("`level` is {level}, expected at least `start-level`, {start}"));
        }
        problems
    }

    /// What the outline is pulled towards in a view, and colours are taken from; `None` where its mask is empty.
    pub(crate) fn target(&self, view: &View) -> Option<Target> {
        Target::new(view, self.blur(), self.reach, MARGIN)
    }

    /// How masks are measured.
    pub(super) fn blur(&self) -> Blur {
        Blur { sigma: self.mask_blur, keeps_thin: self.thin_parts }
    }

    /// The most steps that a fit with these options takes, without those in which it refines cameras.
    pub fn total_steps(&self) -> usize {
        let levels = self.level.saturating_sub(self.start_level).saturating_add(1);
        (levels as usize).saturating_mul(self.steps)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_in_range_and_survive_toml() {
        let config = FitConfig::default();
        assert_eq!(config.check(), Vec::<String>::new());
        let text = toml::to_string(&config).unwrap();
        assert!(text.contains("hold-out = 5"), "{text}");
        assert_eq!(toml::from_str::<FitConfig>(&text).unwrap(), config);
    }

    #[test]
    fn what_is_wrong_is_named() {
        let config = FitConfig {
            level: 2,
            learning_rate: f32::NAN,
            texture_size: Some(1),
            ..FitConfig::default()
        };
        let problems = config.check();
        assert_eq!(problems.len(), 3);
        assert!(problems[2].contains("`level` is 2"), "{problems:?}");
        // Who counts before checking is not told nonsense.
        assert_eq!(config.total_steps(), config.steps);
        assert_eq!(FitConfig::default().total_steps(), 3 * 150);
        assert!(toml::from_str::<FitConfig>("levle = 5").is_err());
    }
}
