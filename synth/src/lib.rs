//! Views of a mesh that we render ourselves: known shape, known cameras, perfect masks.
//!
//! ```no_run
//! use synth::shapes::AlarmClock;
//! use synth::{Lighting, Orbit, RenderOptions, render_views, write_dataset};
//!
//! let clock = AlarmClock::default().build();
//! let cameras = Orbit { count: 100, ..Orbit::default() }.cameras();
//! let options = RenderOptions { lighting: Lighting::studio(), ..RenderOptions::default() };
//! let views = render_views(&clock, &cameras, &options, &|_, _| {})?;
//! write_dataset(&views, &clock, "clock".as_ref())?;
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod cameras;
mod collection;
mod dataset;
mod doubled;
pub mod generate;
mod monocular;
mod noise;
mod planted;
mod procedural;
mod r2n2;
mod relief_errors;
mod render;
mod rendering;
mod room;
mod shade;
pub mod shapes;
mod silhouettes;
mod sketch;

pub use cameras::{Orbit, Placement};
pub use collection::{PoseNoise, RoughPose};
pub use dataset::write_dataset;
pub use monocular::{Guess, Monocular};
pub use planted::Planted;
pub use procedural::{Procedural, families_named};
pub use r2n2::R2n2Cameras;
pub use render::{RenderOptions, render, render_each, render_view, render_views};
pub use rendering::{NormalSpace, Rendering};
pub use room::{Cloth, Room, Wall, marbled};
pub use shade::{Lamp, Lighting};
pub use silhouettes::silhouettes;
/// How [`generate`] tells what it does, and how it is ended early.
pub use train::progress;
