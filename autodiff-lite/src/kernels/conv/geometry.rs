//! Sizes of a convolution.

use crate::kernels::extent::{elements, work};

/// Stride, padding and dilation, each as (rows, columns).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct ConvGeometry {
    /// Pixels between the windows of neighbouring outputs; at least 1.
    pub stride: [usize; 2],
    /// Rows and columns of zeros on each side of the input.
    pub padding: [usize; 2],
    /// Pixels between the taps of a window; at least 1.
    pub dilation: [usize; 2],
    /// Which algorithm may run.
    pub algorithm: ConvAlgorithm,
}

impl Default for ConvGeometry {
    fn default() -> Self {
        Self { stride: [1; 2], padding: [0; 2], dilation: [1; 2], algorithm: ConvAlgorithm::Auto }
    }
}

impl ConvGeometry {
    /// Stride 1, no padding, no dilation.
    pub fn new() -> Self {
        Self::default()
    }

    /// The same stride along rows and columns.
    #[must_use]
    pub fn stride(self, stride: usize) -> Self {
        Self { stride: [stride; 2], ..self }
    }

    /// The same padding on all four sides.
    #[must_use]
    pub fn padding(self, padding: usize) -> Self {
        Self { padding: [padding; 2], ..self }
    }

    /// The same dilation along rows and columns.
    #[must_use]
    pub fn dilation(self, dilation: usize) -> Self {
        Self { dilation: [dilation; 2], ..self }
    }

    /// Which algorithm may run.
    #[must_use]
    pub fn algorithm(self, algorithm: ConvAlgorithm) -> Self {
        Self { algorithm, ..self }
    }

    /// Output size along one axis (0 rows, 1 columns):
    /// `(size + 2 padding - dilation (kernel - 1) - 1) / stride + 1`, or none if the window does
    /// not fit.
    pub fn output_size(&self, axis: usize, size: usize, kernel: usize) -> Option<usize> {
        let window = window(self.dilation[axis], kernel)?;
        let framed = size.checked_add(self.padding[axis].checked_mul(2)?)?;
        let room = framed.checked_sub(window)?;
        Some(room.checked_div(self.stride[axis])? + 1)
    }

    /// Input size along one axis that a transposed convolution of `size` makes:
    /// `(size - 1) stride - 2 padding + dilation (kernel - 1) + 1 + output_padding`, or none if
    /// that is negative.
    pub fn transposed_size(
        &self,
        axis: usize,
        size: usize,
        kernel: usize,
        output_padding: usize,
    ) -> Option<usize> {
        let window = window(self.dilation[axis], kernel)?;
        let corners = size.checked_sub(1)?.checked_mul(self.stride[axis])?;
        let framed = corners.checked_add(window)?.checked_add(output_padding)?;
        framed.checked_sub(self.padding[axis].checked_mul(2)?)
    }
}

/// Which convolution algorithm may run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ConvAlgorithm {
    /// Winograd F(4,3) where it pays (`f32`, 3x3, stride 1, enough channels and pixels), else
    /// direct. Winograd's rounding errors are about five times those of the direct form.
    #[default]
    Auto,
    /// Always the direct form.
    Direct,
}

/// Pixels from the first to the last tap of a window.
fn window(dilation: usize, kernel: usize) -> Option<usize> {
    dilation.checked_mul(kernel.checked_sub(1)?)?.checked_add(1)
}

/// All sizes of one convolution.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConvSizes {
    /// N.
    pub batch: usize,
    /// Rows and columns of the input.
    pub input: [usize; 2],
    /// I.
    pub in_channels: usize,
    /// Rows and columns of the output.
    pub output: [usize; 2],
    /// O.
    pub out_channels: usize,
    /// Rows and columns of the window.
    pub kernel: [usize; 2],
    /// Pixels between windows.
    pub stride: [usize; 2],
    /// Zeros on each side.
    pub padding: [usize; 2],
    /// Pixels between taps.
    pub dilation: [usize; 2],
}

impl ConvSizes {
    /// Of `x [N, H, W, I]` and `w [O, I, KH, KW]`; none if the window does not fit the input.
    pub fn new(x: [usize; 4], w: [usize; 4], geometry: &ConvGeometry) -> Option<Self> {
        let size = |axis: usize| geometry.output_size(axis, x[1 + axis], w[2 + axis]);
        Some(Self {
            batch: x[0],
            input: [x[1], x[2]],
            in_channels: x[3],
            output: [size(0)?, size(1)?],
            out_channels: w[0],
            kernel: [w[2], w[3]],
            stride: geometry.stride,
            padding: geometry.padding,
            dilation: geometry.dilation,
        })
    }

    /// `N H W I`.
    ///
    /// # Panics
    /// If they are more than a slice can have.
    pub fn input_len(&self) -> usize {
        elements(&[self.batch, self.input[0], self.input[1], self.in_channels])
    }

    /// `N OH OW O`.
    ///
    /// # Panics
    /// If they are more than a slice can have.
    pub fn output_len(&self) -> usize {
        elements(&[self.batch, self.output[0], self.output[1], self.out_channels])
    }

    /// `O I KH KW`.
    ///
    /// # Panics
    /// If they are more than a slice can have.
    pub fn weight_len(&self) -> usize {
        elements(&[self.out_channels, self.in_channels, self.kernel[0], self.kernel[1]])
    }

    /// Multiplications and additions of the direct form; the largest number there is, where they
    /// are more.
    pub fn flops(&self) -> usize {
        let [rows, columns] = self.kernel;
        work(&[2, self.output_len(), self.in_channels, rows, columns])
    }

    /// Whether every window of the output lies in the padded input.
    pub(crate) fn fits(&self) -> bool {
        let fits = |axis: usize| {
            let window = window(self.dilation[axis], self.kernel[axis])?;
            let last = self.output[axis].saturating_sub(1).checked_mul(self.stride[axis])?;
            let framed = self.input[axis].checked_add(self.padding[axis].checked_mul(2)?)?;
            Some(self.stride[axis] > 0 && last.checked_add(window)? <= framed)
        };
        fits(0) == Some(true) && fits(1) == Some(true)
    }

    /// The convolution that is the gradient of the input, where the stride is 1: input and output
    /// change places.
    pub(crate) fn transposed(&self) -> Self {
        let pad = |axis: usize| {
            let reach = self.dilation[axis].saturating_mul(self.kernel[axis].saturating_sub(1));
            reach.saturating_sub(self.padding[axis])
        };
        Self {
            input: self.output,
            in_channels: self.out_channels,
            output: self.input,
            out_channels: self.in_channels,
            padding: [pad(0), pad(1)],
            ..*self
        }
    }
}
