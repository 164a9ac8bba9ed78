//! Two-dimensional convolution on features-last arrays, and its gradients.
//!
//! In `[N, H, W, C]` the operands of one output pixel are a few contiguous runs of the (zero
//! padded) input, and the next pixel's lie `stride · C` further. So a convolution is a matrix
//! product whose left operand is read in place: only weights are packed, per call, for the
//! vector width that is found at run time. The gradient of the input is the same sweep over the
//! output's gradient, and the gradient of the weight the same tile with other steps.

mod direct;
mod geometry;
mod grad_weight;
mod grid;
mod operands;
mod pack;
mod transform;
mod wide;
mod winograd;

pub use geometry::{ConvAlgorithm, ConvGeometry, ConvSizes};

use crate::kernels::isa::Isa;
use crate::kernels::lane::Lane;
pub use operands::Operands;

/// What a convolution needs beside its operands.
#[derive(Clone, Copy, Debug)]
pub struct Conv {
    /// The sizes of all operands.
    pub sizes: ConvSizes,
    /// Which algorithm may run.
    pub algorithm: ConvAlgorithm,
    /// Which instructions to run on; [`Isa::best`] outside tests.
    pub isa: Isa,
}

/// What is wrong with sizes whose [windows do not fit](ConvSizes::fits).
pub(super) const OUTSIDE: &str = "a window of the output lies outside of the padded input";

/// How a convolution is computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Form {
    /// By tiles that read the input in place.
    Direct,
    /// By Winograd's minimal filtering, blocks of tiles against weights that a cache holds.
    Winograd,
    /// The same, panels of weights against all tiles.
    Wide,
}

impl Conv {
    /// On the fastest instructions of this machine.
    pub fn new(sizes: ConvSizes, algorithm: ConvAlgorithm) -> Self {
        Self { sizes, algorithm, isa: Isa::best() }
    }

    fn form<F: 'static>(&self) -> Form {
        let s = &self.sizes;
        match () {
            () if !self.may_transform::<F>() => Form::Direct,
            () if wide::pays(s) => Form::Wide,
            () if winograd::pays(s) => Form::Winograd,
            () => Form::Direct,
        }
    }

    fn grad_weight_form<F: 'static>(&self) -> Form {
        let s = &self.sizes;
        match () {
            () if !self.may_transform::<F>() => Form::Direct,
            () if wide::grad_weight_pays(s) => Form::Wide,
            () if winograd::pays(s) && winograd::grad_weight_pays(s) => Form::Winograd,
            () => Form::Direct,
        }
    }

    fn may_transform<F: 'static>(&self) -> bool {
        let f32_only = std::any::TypeId::of::<F>() == std::any::TypeId::of::<f32>();
        self.algorithm == ConvAlgorithm::Auto && f32_only
    }

    /// Numbers of scratch that [`forward`](Self::forward) needs.
    pub fn forward_scratch<F: Lane>(&self) -> usize {
        let s = &self.sizes;
        match self.form::<F>() {
            Form::Wide => wide::scratch(s),
            Form::Winograd => winograd::scratch(s),
            Form::Direct => direct::forward_scratch::<F>(s, self.isa),
        }
    }

    /// Numbers of scratch that [`grad_input`](Self::grad_input) needs.
    pub fn grad_input_scratch<F: Lane>(&self) -> usize {
        let s = &self.sizes;
        match self.form::<F>() {
            Form::Wide => wide::scratch(&s.transposed()),
            Form::Winograd => winograd::scratch(&s.transposed()),
            Form::Direct => direct::grad_input_scratch::<F>(s, self.isa),
        }
    }

    /// Numbers of scratch that [`grad_weight`](Self::grad_weight) needs.
    pub fn grad_weight_scratch<F: Lane>(&self) -> usize {
        let s = &self.sizes;
        match self.grad_weight_form::<F>() {
            Form::Wide => wide::grad_weight_scratch(s),
            Form::Winograd => winograd::grad_weight_scratch(s),
            Form::Direct => grad_weight::scratch::<F>(s, self.isa),
        }
    }
}

/// [`Conv::forward`] of sound operands.
pub(super) fn forward<F: Lane>(conv: &Conv, operands: Operands<'_, F>) {
    let run = match conv.form::<F>() {
        Form::Wide => wide::forward,
        Form::Winograd => winograd::forward,
        Form::Direct => direct::forward,
    };
    run(&conv.sizes, conv.isa, operands);
}

/// [`Conv::grad_input`] of sound operands.
pub(super) fn grad_input<F: Lane>(conv: &Conv, operands: Operands<'_, F>) {
    let run = match conv.form::<F>() {
        Form::Wide => wide::grad_input,
        Form::Winograd => winograd::grad_input,
        Form::Direct => direct::grad_input,
    };
    run(&conv.sizes, conv.isa, operands);
}

/// [`Conv::grad_weight`] of sound operands.
pub(super) fn grad_weight<F: Lane>(
    conv: &Conv,
    x: &[F],
    gy: &[F],
    gw: &mut [F],
    scratch: &mut [F],
) {
    let run = match conv.grad_weight_form::<F>() {
        Form::Wide => wide::grad_weight,
        Form::Winograd => winograd::grad_weight,
        Form::Direct => grad_weight::run,
    };
    run(&conv.sizes, conv.isa, x, gy, gw, scratch);
}

#[cfg(test)]
mod tests;
