//! Procedural objects: parametric, coloured, made of watertight parts.

mod alarm_clock;

pub use alarm_clock::{AlarmClock, ClockColors};
