//! Procedural objects: parametric, coloured, made of watertight parts.
//!
//! Nine families, each a function of a seed. Two draws differ in topology and silhouette, not only
//! in scale.
//!
//! ```
//! use synth::shapes::Family;
//!
//! let clock = Family::AlarmClock.draw(7);
//! assert_eq!(clock.mesh(), Family::AlarmClock.draw(7).mesh());
//! assert!(clock.parts.iter().all(|part| part.mesh.health().is_watertight()));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod airplane;
mod alarm_clock;
mod assembly;
mod bicycle;
mod bus;
mod car;
mod chair;
mod coachwork;
mod draw;
mod family;
mod joinery;
mod lamp;
mod motorbike;
mod paint;
mod shape;
mod solid;
mod table;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod wheel;
mod workpiece;

pub use alarm_clock::{AlarmClock, ClockColors};
pub use family::{Family, UnknownFamily};
pub use shape::{Part, Shape};

impl Family {
    /// The instance of a seed: the same for the same seed, on every machine.
    pub fn draw(self, seed: u64) -> Shape {
        match self {
            Self::Airplane => airplane::draw(seed),
            Self::Car => car::draw(seed),
            Self::Bus => bus::draw(seed),
            Self::Chair => chair::draw(seed),
            Self::Table => table::draw(seed),
            Self::Lamp => lamp::draw(seed),
            Self::Bicycle => bicycle::draw(seed),
            Self::Motorbike => motorbike::draw(seed),
            Self::AlarmClock => alarm_clock::draw(seed),
        }
    }
}
