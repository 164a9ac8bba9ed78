//! Differentiable operations, one family per file: methods on [`Var`](crate::Var) and
//! [`Tape`](crate::Tape).

mod elementwise;
mod reduce;
