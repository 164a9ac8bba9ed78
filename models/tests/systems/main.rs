//! The systems from outside: what they may be told, and that each can learn one object by heart. One program: of several, each
//! would compile the systems anew.
#![allow(clippy::unwrap_used, reason = "tests")]

mod canonical;
mod familiar;
mod overfit;
mod ranges;
