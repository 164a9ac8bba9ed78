//! How long jobs tell what they do, and how they are ended early: the same for a fit, a training, a dataset that is
//! generated and a study.
//!
//! Each takes a [`Watch`]: those who hear of every [`Event`], and a [`Cancel`] that anybody may pull, from any thread. A job that is cancelled ends
//! at the next place where what it has is whole, keeps that, and says [`Ended::Cancelled`] of itself.
//!
//! ```
//! use train::progress::{Ended, Event, JsonLines, Watch};
//!
//! # fn long_job(watch: &mut Watch<'_>) -> Ended {
//! #     for done in 0..10 {
//! #         watch.tell(&Event::Progress { done, total: 10, text: String::new() });
//! #         if watch.is_cancelled() {
//! #             return Ended::Cancelled;
//! #         }
//! #     }
//! #     Ended::Completed
//! # }
//! // A log for programs, and whatever a program of one's own wants to know.
//! let (mut lines, mut reached) = (Vec::new(), 0);
//! let mut watch = Watch::new(JsonLines::new(&mut lines)).and(|event: &Event| {
//!     if let Event::Progress { done, .. } = event {
//!         reached = *done;
//!     }
//! });
//! // Pulled by a button, a signal, another thread.
//! let cancel = watch.cancel();
//! cancel.cancel();
//! assert_eq!(long_job(&mut watch), Ended::Cancelled);
//! drop(watch);
//! assert_eq!(reached, 0);
//! assert!(String::from_utf8(lines)?.contains(r#""event":"progress","done":0,"total":10"#));
//! # Ok::<(), std::string::FromUtf8Error>(())
//! ```
//!
#![doc = include_str!("events.md")]

mod cancel;
mod communication;
mod ended;
mod event;
mod facts;
mod json_lines;
mod watch;

pub use cancel::Cancel;
pub use communication::Communication;
pub use ended::Ended;
pub use event::{Event, Step, TrainingStep};
pub use facts::Facts;
pub use json_lines::JsonLines;
pub use watch::{Observer, Watch};
