//! A small, fast reverse-mode tape on the CPU.

pub mod kernels;
pub mod ops;
pub mod optim;
pub mod state;
#[cfg(feature = "testkit")]
pub mod testkit;

mod backward;
mod gradients;
mod module;
mod op;
mod param;
mod pool;
mod real;
mod shape;
mod tape;
mod tensor;
mod updates;
mod var;

pub use backward::Backward;
pub use gradients::Gradients;
pub use module::{Module, Visitor, VisitorMut, join_path};
pub use op::Op;
pub use param::{Param, ParamId};
pub use pool::{Pool, PoolVec, Pooled};
pub use real::Real;
pub use shape::{ShapeError, Shapes, broadcast_shape};
pub use tape::{Handles, Tape};
pub use tensor::{CONTIGUOUS, IntoTensor, Tensor};
pub use updates::{BufferUpdate, Updates};
pub use var::Var;
