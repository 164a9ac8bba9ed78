//! Views to a mesh without training: the fit of one object, its scores and its delivery.
//!
//! ```
//! use datasets::Views;
//! use synth::shapes::AlarmClock;
//! use recon::fit::{FitConfig, fit};
//! use recon::progress::{Event, Watch};
//! use synth::{Orbit, RenderOptions, render_views};
//!
//! // A dozen small images of a clock, with masks and cameras.
//! let cameras = Orbit { count: 12, width: 48, height: 48, ..Orbit::default() }.cameras();
//! let clock = AlarmClock::default().build();
//! let views = render_views(&clock, &cameras, &RenderOptions::default(), &|_, _| {})?;
//! let views = Views::in_memory(views);
//!
//! // A sphere becomes the clock; coarse and short, since this is an example.
//! let config = FitConfig { level: 3, steps: 40, ..FitConfig::default() };
//! let mut watch = Watch::new(|event: &Event| {
//!     if let Event::Evaluated { step, metrics, .. } = event {
//!         assert!(*step <= 40 && metrics[0].value > 0.0); // a progress bar would show it
//!     }
//! });
//! let fitted = fit(&views, &config, &mut watch)?;
//! assert!(fitted.health.is_watertight());
//! assert_eq!(fitted.health.euler, 2);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # By task
//!
//! - **fit one object**: [`fit`](mod@fit)
//! - **give a mesh a texture**: [`bake`](mod@bake)
//! - **score a mesh on views**: [`evaluate`]
//! - **find out what is wrong with views**: [`inspect`](mod@inspect)
//! - **know whether a fit can be trusted**: [`verdict`]
//! - **make views with a known truth**: the crate `synth`
//! - **deliver**: [`delivery`] writes what a user keeps, [`turntable`] its GIF
//!
//! # Invariants
//!
//! - Nothing is printed; [`progress`] says how a fit tells what happens, and how it is ended early.
//! - The same views and configuration give the same bytes for any number of threads.
//! - A fitted mesh is closed and oriented outwards, in the coordinates of the cameras. Its genus is that of its start: 0 with
//!   `topology = "sphere"`, else the holes that masks show.
//! - Output folders appear whole or not at all.

pub mod atlas;
pub mod bake;
pub mod delivery;
pub mod evaluate;
pub mod fit;
pub mod inspect;
pub mod scene;
pub mod turntable;
pub mod verdict;

/// How a fit tells what it does, and how it is ended early.
pub use train::progress;
