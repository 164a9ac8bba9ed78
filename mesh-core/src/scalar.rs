//! The two precisions of coordinates and matrix entries.

use std::fmt::Debug;
use std::ops::{Add, Mul, Sub};

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

/// A coordinate or an entry of a matrix: exactly `f32` and `f64`.
///
/// Geometry is computed in `f64` in either case; this says in what it comes and goes.
pub trait Scalar:
    sealed::Sealed
    + Copy
    + Debug
    + Default
    + PartialEq
    + PartialOrd
    + Add<Output = Self>
    + Mul<Output = Self>
    + Sub<Output = Self>
    + Send
    + Sync
    + 'static
{
    /// The distance from 1 to the next larger number.
    const EPSILON: f64;

    /// The nearest representable number.
    fn narrowed(x: f64) -> Self;

    /// The same number in double precision.
    fn widened(self) -> f64;
}

impl Scalar for f32 {
    const EPSILON: f64 = Self::EPSILON as f64;

    #[inline]
    fn narrowed(x: f64) -> Self {
        x as Self
    }

    #[inline]
    fn widened(self) -> f64 {
        f64::from(self)
    }
}

impl Scalar for f64 {
    const EPSILON: f64 = Self::EPSILON;

    #[inline]
    fn narrowed(x: f64) -> Self {
        x
    }

    #[inline]
    fn widened(self) -> f64 {
        self
    }
}
