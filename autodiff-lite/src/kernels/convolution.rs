//! Convolutions: what is asked for, looked at, and handed to the [compiled](Compiled) [kernels](crate::kernels::conv).

use crate::kernels::activation::Activation;
use crate::kernels::compiled::Compiled;
use crate::kernels::conv::{Conv, OUTSIDE, Operands};

impl Conv {
    /// `y = activation(x * w + bias)`: `x [N, H, W, I]`, `w [O, I, KH, KW]`, `bias [O]`,
    /// `y [N, OH, OW, O]`, all of which is written.
    ///
    /// # Panics
    /// If a slice has another length than its shape, a window of the output lies outside of the
    /// padded input, or the scratch is too short.
    pub fn forward<F: Compiled>(
        &self,
        x: &[F],
        w: &[F],
        bias: Option<&[F]>,
        activation: Activation,
        y: &mut [F],
        scratch: &mut [F],
    ) {
        let s = &self.sizes;
        assert_eq!(x.len(), s.input_len());
        assert_eq!(w.len(), s.weight_len());
        assert_eq!(y.len(), s.output_len());
        assert!(y.is_empty() || s.fits(), "{OUTSIDE}");
        assert!(bias.is_none_or(|b| b.len() == s.out_channels));
        if y.is_empty() {
            return;
        }
        F::convolve(self, Operands { from: x, w, bias, activation, to: y, scratch });
    }

    /// The gradient of `x`, all of which is written, from that of `y`. With a bias `[I]` and an
    /// activation it is also the transposed convolution of `gy`.
    ///
    /// # Panics
    /// If a slice has another length than its shape, a window of the output lies outside of the
    /// padded input, or the scratch is too short.
    pub fn grad_input<F: Compiled>(
        &self,
        gy: &[F],
        w: &[F],
        bias: Option<&[F]>,
        activation: Activation,
        gx: &mut [F],
        scratch: &mut [F],
    ) {
        let s = &self.sizes;
        assert_eq!(gx.len(), s.input_len());
        assert_eq!(w.len(), s.weight_len());
        assert_eq!(gy.len(), s.output_len());
        assert!(bias.is_none_or(|b| b.len() == s.in_channels));
        assert!(gx.is_empty() || gy.is_empty() || s.fits(), "{OUTSIDE}");
        if gx.is_empty() {
            return;
        }
        F::convolve_back(self, Operands { from: gy, w, bias, activation, to: gx, scratch });
    }

    /// The gradient of `w`, all of which is written, from `x` and the gradient of `y`.
    ///
    /// # Panics
    /// If a slice has another length than its shape, a window of the output lies outside of the
    /// padded input, or the scratch is too short.
    pub fn grad_weight<F: Compiled>(&self, x: &[F], gy: &[F], gw: &mut [F], scratch: &mut [F]) {
        let s = &self.sizes;
        assert_eq!(x.len(), s.input_len());
        assert_eq!(gw.len(), s.weight_len());
        assert_eq!(gy.len(), s.output_len());
        assert!(gw.is_empty() || gy.is_empty() || s.fits(), "{OUTSIDE}");
        F::correlate(self, x, gy, gw, scratch);
    }
}
