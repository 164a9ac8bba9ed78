//! One method, one file.

mod bosh3;
mod dopri5;
mod euler;
mod heun;
mod midpoint;
mod rk4;

use super::Tableau;

pub use bosh3::BOSH3;
pub use dopri5::DOPRI5;
pub use euler::EULER;
pub use heun::HEUN;
pub use midpoint::MIDPOINT;
pub use rk4::RK4;

impl Tableau {
    /// All methods of this crate.
    pub const ALL: [&'static Self; 6] = [&EULER, &HEUN, &MIDPOINT, &RK4, &BOSH3, &DOPRI5];

    /// The method of this name.
    pub fn named(name: &str) -> Option<&'static Self> {
        Self::ALL.into_iter().find(|tableau| tableau.name == name)
    }
}
