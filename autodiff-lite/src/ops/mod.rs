//! Differentiable operations, one family per file: methods on [`Var`](crate::Var) and
//! [`Tape`](crate::Tape).

mod conv;
mod dropout;
mod elementwise;
mod gather;
mod layout;
mod linear;
mod matmul;
mod pairwise;
mod reduce;
