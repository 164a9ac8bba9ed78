//! Operations of one precision, compiled here.
//!
//! A generic function is compiled anew in every crate that calls it, with all of its rules and kernels, unless it is
//! `#[inline(never)]` and a crate below has compiled it already: that is what happens here. The crate of a network then compiles
//! the network alone, and what is under it was optimised as this crate is, however the network's crate is built.

use std::hint::black_box;

use crate::optim::{AdamMethod, AdamWMethod, Optimizer, SgdMethod};
use crate::{Gradients, Real, SparseMatrix, Tape, Var};

/// Names the functions for one precision: what has an address is compiled.
fn compile<F: Real>() {
    macro_rules! named {
        ($($type:ident: $($name:ident)+;)+) => {
            $($(black_box($type::<F>::$name as *const ());)+)+
        };
    }
    named! {
        Var: attention self_attention conv2d conv_transpose2d conv3d dropout gather_rows scatter_add_rows graph_conv graph_sum
            linear linear_then matmul matmul_transposed layer_norm group_norm batch_norm max_pool2d avg_pool2d
            adaptive_avg_pool2d project project_affine resize_bilinear bilinear_sample add_bilinear_samples softmax
            log_softmax sparse_matmul;
        Var: scale add_scalar exp ln sqrt square recip sin cos abs relu leaky_relu elu softplus sigmoid tanh gelu silu
            hardsigmoid clamp powf powi neg;
        Var: add sub mul div maximum minimum;
        Var: reshape insert_axis permute slice_axis index_axis sum mean sum_axis mean_axis max_axis max min_axis min;
        Var: backward;
        Tape: lincomb concat stack backward_from reset param gradients take_updates;
        Gradients: accumulate scale norm is_finite;
        SparseMatrix: from_triplets from_csr transposed;
    }
    black_box(Optimizer::<SgdMethod, F>::update as *const ());
    black_box(Optimizer::<AdamMethod, F>::update as *const ());
    black_box(Optimizer::<AdamWMethod, F>::update as *const ());
}

/// Single precision, in which networks are trained. A static is compiled even if nobody reads it.
#[allow(dead_code, reason = "it is there to be compiled")]
static SINGLE: fn() = compile::<f32>;

/// Double precision, in which gradients are checked.
#[cfg(feature = "testkit")]
#[allow(dead_code, reason = "it is there to be compiled")]
static DOUBLE: fn() = compile::<f64>;
