//! The two scalar types of the tape.

use std::iter::Sum;

use bytemuck::Pod;
use ndarray::NdFloat;

use crate::kernels::compiled::Compiled;
use crate::kernels::transcendental::Transcendental;
use crate::pool::Pooled;

mod sealed {
    pub trait Sealed {}
    impl Sealed for f32 {}
    impl Sealed for f64 {}
}

/// A floating-point number of the tape: exactly `f32` and `f64`.
///
/// `f32` is what networks and meshes are computed in; `f64` exists for gradient checks and for
/// reference twins. The trait is sealed, so that kernels may treat the two cases one by one.
pub trait Real:
    sealed::Sealed
    + NdFloat
    + Default
    + Sum
    + for<'a> Sum<&'a Self>
    + Transcendental
    + Compiled
    + Pooled
    + Pod
    + 'static
{
    /// `"f32"` or `"f64"`.
    const NAME: &'static str;

    /// The nearest representable number.
    fn from_f64(x: f64) -> Self;

    /// The same number in double precision.
    fn to_f64(self) -> f64;

    /// The slice as `f32`, if that is what it is: how generic code reaches an `f32`-only kernel.
    #[inline]
    fn as_f32(x: &[Self]) -> Option<&[f32]> {
        (Self::NAME == "f32").then(|| bytemuck::cast_slice(x))
    }

    /// The slice as `f32`, if that is what it is.
    #[inline]
    fn as_f32_mut(x: &mut [Self]) -> Option<&mut [f32]> {
        (Self::NAME == "f32").then(|| bytemuck::cast_slice_mut(x))
    }
}

impl Real for f32 {
    const NAME: &'static str = "f32";

    #[inline]
    fn from_f64(x: f64) -> Self {
        x as Self
    }

    #[inline]
    fn to_f64(self) -> f64 {
        self as f64
    }
}

impl Real for f64 {
    const NAME: &'static str = "f64";

    #[inline]
    fn from_f64(x: f64) -> Self {
        x
    }

    #[inline]
    fn to_f64(self) -> f64 {
        self
    }
}
