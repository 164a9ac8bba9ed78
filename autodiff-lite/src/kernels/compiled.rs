//! The largest kernels, each compiled in this crate for `f32` and for `f64`.
//!
//! A generic function is compiled in every crate that calls it with a type, and matrix products and convolutions are half a
//! megabyte of code for each instruction set: a program of five crates that all multiply would compile them five times. A method of
//! a trait that a type implements is compiled once, where the implementation stands.

use crate::kernels::conv::{self, Conv, Operands};
use crate::kernels::gemm::{self, Finish, Joined, Matrix};
use crate::kernels::lane::Lane;

/// Implemented for `f32` and `f64`.
pub trait Compiled: Lane {
    /// [`gemm_joined`](crate::kernels::product::gemm_joined) of sound sizes.
    fn products(
        joined: Joined,
        sizes: [usize; 3],
        alpha: Self,
        a: &[Matrix<'_, Self>],
        b: &[Matrix<'_, Self>],
        beta: Self,
        c: &mut [&mut [Self]],
        finish: Option<Finish<'_, Self>>,
    );
    /// [`Conv::forward`] of sound operands.
    fn convolve(conv: &Conv, operands: Operands<'_, Self>);
    /// [`Conv::grad_input`] of sound operands.
    fn convolve_back(conv: &Conv, operands: Operands<'_, Self>);
    /// [`Conv::grad_weight`] of sound operands.
    fn correlate(conv: &Conv, x: &[Self], gy: &[Self], gw: &mut [Self], scratch: &mut [Self]);
}

macro_rules! compiled {
    ($($float:ty),+) => {$(
        impl Compiled for $float {
            #[inline(never)]
            fn products(
                joined: Joined,
                sizes: [usize; 3],
                alpha: Self,
                a: &[Matrix<'_, Self>],
                b: &[Matrix<'_, Self>],
                beta: Self,
                c: &mut [&mut [Self]],
                finish: Option<Finish<'_, Self>>,
            ) {
                gemm::products(joined, sizes, alpha, a, b, beta, c, finish);
            }

            #[inline(never)]
            fn convolve(conv: &Conv, operands: Operands<'_, Self>) {
                conv::forward(conv, operands);
            }

            #[inline(never)]
            fn convolve_back(conv: &Conv, operands: Operands<'_, Self>) {
                conv::grad_input(conv, operands);
            }

            #[inline(never)]
            fn correlate(conv: &Conv, x: &[Self], gy: &[Self], gw: &mut [Self], scratch: &mut [Self]) {
                conv::grad_weight(conv, x, gy, gw, scratch);
            }
        }
    )+};
}
compiled!(f32, f64);
