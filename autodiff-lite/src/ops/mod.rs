//! Differentiable operations, one family per file: methods on [`Var`](crate::Var) and
//! [`Tape`](crate::Tape).

mod dropout;
mod elementwise;
mod gather;
mod layout;
mod pairwise;
mod reduce;
