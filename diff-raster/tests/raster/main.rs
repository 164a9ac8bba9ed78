//! What is drawn and what its gradients are: against values by hand, kaolin's, finite differences and the twins in `reference`.
//! One program: of several, each would compile the kernels anew.
#![allow(clippy::unwrap_used, reason = "tests")]

mod analytic;
mod common;
mod golden;
mod gradients;
mod layers;
mod renderer;
mod softras;
mod twins;
