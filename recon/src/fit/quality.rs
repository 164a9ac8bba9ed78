//! How much a fit may cost: three configurations by name.

use std::path::Path;

use datasets::View;

use super::FitConfig;

/// How much time a fit may take for how fine a mesh. Each is a file of `presets/fit`, which says what it sets; what it leaves
/// out has its default.
///
/// ```
/// use recon::fit::{ColorKind, FitConfig, Quality};
///
/// assert_eq!(Quality::Normal.config(), FitConfig::default());
/// assert_eq!(Quality::High.config().color, ColorKind::Texture);
/// assert!(Quality::Draft.config().level < Quality::High.config().level);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Quality {
    /// A look in about a second.
    Draft,
    /// The defaults.
    #[default]
    Normal,
    /// A finer mesh with a texture, and larger images of it, in several times as long.
    High,
}

impl Quality {
    /// All, from the quickest on.
    pub const ALL: [Self; 3] = [Self::Draft, Self::Normal, Self::High];

    /// As the command line has it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Draft => "draft",
            Self::Normal => "normal",
            Self::High => "high",
        }
    }

    /// The configuration as TOML, with comments.
    pub fn toml(self) -> &'static str {
        match self {
            Self::Draft => include_str!("../../presets/fit/draft.toml"),
            Self::Normal => include_str!("../../presets/fit/normal.toml"),
            Self::High => include_str!("../../presets/fit/high.toml"),
        }
    }

    /// The configuration.
    pub fn config(self) -> FitConfig {
        train::settings::read_text(Path::new(self.name()), self.toml(), &[])
            .expect("a test reads all presets")
    }
}

/// More pixels of an object to a vertex than this, and the images show more than vertices can hold: about three along an edge.
const FINE: f64 = 8.0;

/// How many pixels of the object the views have on average for each vertex that a view shows, which is half of `vertices`; none
/// where it is few enough for a mesh with a colour at each vertex.
///
/// ```
/// use mesh_core::primitives::icosphere;
/// use recon::fit::unused_detail;
/// use synth::{Orbit, RenderOptions, render_views};
///
/// let ball = icosphere(3);
/// let cameras = Orbit { count: 2, width: 96, height: 96, ..Orbit::default() }.cameras();
/// let views = render_views(&ball, &cameras, &RenderOptions::default(), &|_, _| {})?;
/// assert!(unused_detail(&views, 42).unwrap() > 50.0);
/// assert_eq!(unused_detail(&views, 10_242), None);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn unused_detail(views: &[View], vertices: usize) -> Option<f64> {
    let pixels: usize = views.iter().map(View::mask_pixels).sum();
    let seen = 0.5 * (vertices * views.len()) as f64;
    let pixels = pixels as f64 / seen.max(1.0);
    (pixels > FINE).then_some(pixels)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_are_in_range_and_the_normal_one_says_every_default() {
        for quality in Quality::ALL {
            assert_eq!(quality.config().check(), Vec::<String>::new(), "{}", quality.name());
        }
        assert_eq!(Quality::Normal.config(), FitConfig::default());
        let written = train::settings::settings_of(Quality::Normal.toml());
        let all = train::settings::settings_of(&train::settings::to_toml(&FitConfig::default()));
        assert_eq!(written.keys().collect::<Vec<_>>(), all.keys().collect::<Vec<_>>());
    }

    #[test]
    fn each_is_finer_than_the_one_before() {
        let of = Quality::ALL.map(Quality::config);
        for [a, b] in [[&of[0], &of[1]], [&of[1], &of[2]]] {
            assert!(a.level < b.level && a.total_steps() <= b.total_steps());
            assert!(a.picture_size <= b.picture_size);
        }
    }
}
