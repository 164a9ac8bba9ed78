//! One method, one file.

mod bosh3;
mod dopri5;
mod euler;
mod heun;
mod midpoint;
mod rk4;

pub use bosh3::BOSH3;
pub use dopri5::DOPRI5;
pub use euler::EULER;
pub use heun::HEUN;
pub use midpoint::MIDPOINT;
pub use rk4::RK4;
