//! A small, fast reverse-mode tape on the CPU: tensors, operations, modules, optimisers.
//!
//! ```
//! use autodiff_lite::optim::Adam;
//! use autodiff_lite::{Param, Tape, Var, impl_module};
//! use ndarray::{Array1, Array2};
//!
//! // A model is a plain struct of parameters; how it is called is its own affair.
//! struct Line {
//!     slope: Param,
//!     offset: Param,
//! }
//! impl_module!(Line: f32 { slope, offset });
//!
//! impl Line {
//!     fn forward<'t>(&self, x: Var<'t>) -> Var<'t> {
//!         let tape = x.tape();
//!         x * tape.param(&self.slope) + tape.param(&self.offset)
//!     }
//! }
//!
//! let mut line = Line { slope: Param::new(Array1::zeros(1)), offset: Param::new(Array1::zeros(1)) };
//! let x = Array2::from_shape_fn((50, 1), |(i, _)| i as f32 / 50.0).into_shared();
//! let y = x.mapv(|x| 3.0 * x - 1.0).into_shared();
//!
//! let mut adam = Adam::new(0.05);
//! let mut tape = Tape::train(0);
//! for step in 0..500 {
//!     tape.reseed(step); // else dropout, where there is one, would drop the same elements each time
//!     let error = line.forward(tape.constant(x.clone())) - tape.constant(y.clone());
//!     let gradients = error.square().mean().backward();
//!     tape.reset(); // memory goes back to the tape's pool, parameters are unique again
//!     adam.step(&mut line, &gradients); // and are written in place
//! }
//! assert!((line.slope.value[0] - 3.0).abs() < 0.01);
//! ```
//!
//! # Where things are
//!
//! | for | see |
//! |---|---|
//! | values and handles | [`Tape`], [`NestedTape`], [`Var`], [`Tensor`] |
//! | gradients | [`Var::backward`], [`Gradients`]; of a function that owns its tape, [`Vjp`] |
//! | models | [`Param`], [`Module`], [`impl_module!`] |
//! | operations | the methods of [`Var`] and [`Tape`]; the loops behind them in [`kernels`] |
//! | an operation of your own | [`Tape::record_fn`], [`Op`], [`Backward`], [`Tape::check`], [`Var::map`], [`Var::zip`] |
//! | training | [`optim`]: SGD, RMSprop, Adam, AdamW, uniform Adam, schedules, clipping |
//! | files | `state::save`, `state::load` (feature `files`): safetensors, with optimiser moments; [`state`] |
//! | tests of operations | `testkit` (feature of that name): gradient checks in `f64` |
//!
//! # Conventions
//!
//! - Values are row-major without gaps, features last: images `[N, H, W, C]`, vertices
//!   `[N, V, 3]`, tokens `[N, T, D]`.
//! - Two operands broadcast by NumPy's rules.
//! - A wrong shape is a mistake in the program: it panics at the caller, naming the operation,
//!   every operand with its dimensions, and the [scope](Tape::scope) it happened in. Files and
//!   numbers are typed errors.
//! - `f32` is the type to compute in; `f64` is there for gradient checks and reference twins.
//!
//! # Invariants
//!
//! - Kernels know slices, never a tape; they hold the only `unsafe`.
//! - The same seed gives the same bits whatever the number of threads: parallel loops run over
//!   fixed chunks of the output, and sums over fixed chunks of the input.
//! - AVX-512 and AVX2 give the same bits (measured, on convolutions, sparse products, softmax and norms), but for products of
//!   matrices: with AVX-512 large ones of `f32` are sums over slabs of at most 320 products, with AVX2 the gemm crate cuts
//!   them. Without fused multiply-add these, convolutions and sparse products round twice: on processors that have neither,
//!   results differ in the last bits.
//! - The steady state of a training loop takes no fresh block of memory of 4 KiB or more, but for
//!   the packing buffer that the gemm crate takes and gives back in those matrix products that are left to it.
//! - Operations have a single output. Rules work on arrays, so there are no second derivatives.
//! - A tape belongs to one thread at a time.
//!
//! # Speed
//!
//! Kernels start threads through rayon only for large arrays. Run a whole training step inside
//! one `ThreadPool::install`: entering a pool from outside costs 10 to 20 µs per operation.
//!
//! # What this crate does not do
//!
//! GPUs, half precision, second derivatives, static shapes, automatic fusion.

/// The crate whose arrays go in and come out.
pub use ndarray;

pub mod kernels;
pub mod ops;
pub mod optim;
pub mod state;
#[cfg(feature = "testkit")]
pub mod testkit;

mod backward;
mod gradients;
#[cfg(feature = "compiled")]
mod instances;
mod module;
mod nested;
mod node;
mod op;
mod param;
mod pool;
mod real;
mod scope;
mod shape;
mod sparse;
mod tape;
mod tensor;
mod updates;
mod var;
mod vjp;
mod walk;

pub use backward::Backward;
pub use gradients::Gradients;
pub use kernels::activation::Activation;
pub use kernels::conv::{ConvAlgorithm, ConvGeometry};
pub use kernels::pooling::PoolGeometry;
pub use kernels::sampling::Padding;
pub use module::{Module, Visitor, VisitorMut, join_path};
pub use nested::NestedTape;
pub use op::Op;
pub use ops::{BatchStatistics, Conv3dGeometry, GraphWeights, LinearThen};
pub use param::{Param, ParamId};
pub use pool::{Pool, PoolVec, Pooled};
pub use real::Real;
pub use scope::Handles;
pub use shape::{ShapeError, Shapes, broadcast_shape};
pub use sparse::{SparseError, SparseMatrix};
pub use tape::Tape;
pub use tensor::Tensor;
pub use updates::{BufferUpdate, Updates};
pub use var::Var;
pub use vjp::Vjp;
