//! One method, one file.

mod adaptive_heun;
mod bosh3;
mod dopri5;
mod euler;
mod heun;
mod heun3;
mod midpoint;
mod rk4;
mod three_eighths;
mod tsit5;

use super::Tableau;

pub use adaptive_heun::ADAPTIVE_HEUN;
pub use bosh3::BOSH3;
pub use dopri5::DOPRI5;
pub use euler::EULER;
pub use heun::HEUN;
pub use heun3::HEUN3;
pub use midpoint::MIDPOINT;
pub use rk4::RK4;
pub use three_eighths::THREE_EIGHTHS;
pub use tsit5::TSIT5;

impl Tableau {
    /// All methods of this crate.
    pub const ALL: [&'static Self; 10] = [
        &EULER,
        &HEUN,
        &MIDPOINT,
        &RK4,
        &BOSH3,
        &DOPRI5,
        &HEUN3,
        &THREE_EIGHTHS,
        &ADAPTIVE_HEUN,
        &TSIT5,
    ];

    /// The method of this name.
    pub fn named(name: &str) -> Option<&'static Self> {
        Self::ALL.into_iter().find(|tableau| tableau.name == name)
    }
}
