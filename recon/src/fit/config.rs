//! What a fit can be told.

use serde::{Deserialize, Serialize};
use train::settings::in_toml;

/// Options of a fit, each with the default that [`FitConfig::default`] gives.
///
/// Lengths without a unit are relative to the object, so that no option depends on the scale of
/// the input.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields, rename_all = "kebab-case")]
pub struct FitConfig {
    /// Seed of everything random: the order of views when `views-per-step` is not 0. Default 0.
    pub seed: u64,
    /// Every how many views one is held out and scored: with 5 the views 4, 9, 14 and so on.
    /// 0 holds out none. Default 5.
    pub hold_out: usize,
    /// Subdivision level of the icosphere to start from, 1 to 6; slender objects start from their hull, at
    /// the level before the last or this one. Default 3: 642 vertices.
    pub start_level: u32,
    /// Subdivision level to end with, up to 7. Default 5: 10,242 vertices.
    pub level: u32,
    /// Steps at each level, at most. Default 150.
    pub steps: usize,
    /// Views in each step; 0 takes all, which is cheap and has no noise. Default 0.
    pub views_per_step: usize,
    /// Length of a step, in radii of the sphere of the object's volume; it falls to a tenth of this
    /// within each level. Default 0.05.
    pub learning_rate: f32,
    /// How far a pull on one vertex spreads over the surface: lambda of the preconditioner
    /// `(I + lambda L)^-1`. Larger is smoother and slower to follow corners. Default 4.
    pub smoothness: f32,
    /// Weight of the bending energy (squared uniform Laplacian of the Laplacian). Default 0.1.
    pub bending: f32,
    /// Every how many steps the vertices slide along the surface to even out the triangles.
    /// 0 never. Default 5.
    pub relax_every: usize,
    /// How far they slide, 0 to 1 of the way to their neighbours' centre. Default 0.3.
    pub relax: f32,
    /// How far from a mask's edge its pull still grows, as a share of the object's size in that
    /// image. Default 0.15.
    pub reach: f32,
    /// Blur of the masks' signed distance in pixels: what makes their edges known between pixels.
    /// Default 1.
    pub mask_blur: f32,
    /// A level ends early, after half of its steps, when the outline's distance to the masks falls by
    /// less than this share over 20 steps. Default 0.01.
    pub tolerance: f64,
    /// Where colours are kept: `"vertex"`, or `"texture"`, which has them per vertex as well.
    /// Default `"vertex"`.
    pub color: ColorKind,
    /// Side of the texture in pixels, 64 to 8192, or 0: as fine as the images. Default 0.
    pub texture_size: usize,
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

impl Default for FitConfig {
    fn default() -> Self {
        Self {
            seed: 0,
            hold_out: 5,
            start_level: 3,
            level: 5,
            steps: 150,
            views_per_step: 0,
            learning_rate: 0.05,
            smoothness: 4.0,
            bending: 0.1,
            relax_every: 5,
            relax: 0.3,
            reach: 0.15,
            mask_blur: 1.0,
            tolerance: 0.01,
            color: ColorKind::Vertex,
            texture_size: 0,
        }
    }
}

impl FitConfig {
    /// What is wrong with these options, one sentence each; empty when nothing is.
    pub fn check(&self) -> Vec<String> {
        let mut problems = Vec::new();
        let mut require = |holds: bool, field: &str, found: &dyn std::fmt::Display, what: &str| {
            if !holds {
                problems.push(format!("`{field}` is {found}, expected {what}"));
            }
        };
        let held = self.hold_out;
        require(held != 1 && in_toml(held), "hold-out", &held, "0 (none) or 2 to 2^63 - 1");
        require(in_toml(self.seed), "seed", &self.seed, "at most 2^63 - 1");
        for (count, field) in
            [(self.views_per_step, "views-per-step"), (self.relax_every, "relax-every")]
        {
            require(in_toml(count), field, &count, "at most 2^63 - 1");
        }
        require((1..=6).contains(&self.start_level), "start-level", &self.start_level, "1 to 6");
        require(
            (self.start_level..=7).contains(&self.level),
            "level",
            &self.level,
            "at least `start-level`, at most 7",
        );
        require((1..=100_000).contains(&self.steps), "steps", &self.steps, "1 to 100000");
        let within = |v: f32, low: f32, high: f32| v >= low && v <= high;
        require(
            within(self.learning_rate, 1e-6, 1.0),
            "learning-rate",
            &self.learning_rate,
            "1e-6 to 1",
        );
        require(within(self.smoothness, 0.0, 1e4), "smoothness", &self.smoothness, "0 to 10000");
        require(within(self.bending, 0.0, 1e4), "bending", &self.bending, "0 to 10000");
        require(within(self.relax, 0.0, 1.0), "relax", &self.relax, "0 to 1");
        require(within(self.reach, 0.001, 2.0), "reach", &self.reach, "0.001 to 2");
        require(within(self.mask_blur, 0.0, 16.0), "mask-blur", &self.mask_blur, "0 to 16");
        require(
            (0.0..1.0).contains(&self.tolerance),
            "tolerance",
            &self.tolerance,
            "0 to less than 1",
        );
        require(
            self.texture_size == 0 || (64..=8192).contains(&self.texture_size),
            "texture-size",
            &self.texture_size,
            "0 or 64 to 8192",
        );
        problems
    }

    /// The most steps that a fit with these options takes.
    pub fn total_steps(&self) -> usize {
        (self.level - self.start_level + 1) as usize * self.steps
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
    fn presets_are_in_range_and_the_default_is_the_default() {
        let read = |text: &str| toml::from_str::<FitConfig>(text).unwrap();
        assert_eq!(read(include_str!("../../presets/fit/default.toml")), FitConfig::default());
        for text in [
            include_str!("../../presets/fit/tiny.toml"),
            include_str!("../../presets/fit/fine.toml"),
        ] {
            assert_eq!(read(text).check(), Vec::<String>::new());
        }
    }

    #[test]
    fn what_is_wrong_is_named() {
        let config = FitConfig {
            level: 2,
            learning_rate: f32::NAN,
            texture_size: 1,
            ..FitConfig::default()
        };
        let problems = config.check();
        assert_eq!(problems.len(), 3);
        assert!(problems[0].contains("`level` is 2"), "{problems:?}");
        assert!(toml::from_str::<FitConfig>("levle = 5").is_err());
    }
}
