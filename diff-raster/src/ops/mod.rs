//! The differentiable operations: thin glue between the tape and the kernels.
//!
//! What these functions need between their passes is allocated in each call; the same operations of a
//! [`Frame`](crate::Frame) use that of earlier frames.

mod depth;
mod interpolate;
mod silhouette;
mod softras;
mod sphere_texture;
mod texture;

pub use depth::depth;
pub use interpolate::{interpolate, interpolate_corners};
pub use silhouette::{antialiased_silhouette, soft_silhouette};
pub use softras::{Paint, softras};
pub use sphere_texture::sphere_texture;
pub use texture::texture;

pub(crate) use depth::draw_depth;
pub(crate) use interpolate::{interpolate_faces, interpolate_vertices};
pub(crate) use silhouette::{draw_antialiased, draw_soft};
pub(crate) use texture::draw_texture;

use autodiff_lite::{Real, ShapeError, Var};

use crate::Fragments;

/// Checks that `projected` has the shape of what was drawn.
#[track_caller]
fn check_projected<F: Real>(op: &'static str, projected: Var<'_, F>, fragments: &Fragments<F>) {
    let expected = [fragments.shape()[0], fragments.faces().vertex_count(), 3];
    let shape = projected.shape();
    if shape != expected {
        ShapeError::new(op, "the positions are not those that were rasterised")
            .operand("projected", &shape, "N, V, 3")
            .operand("rasterised", &expected, "N, V, 3")
            .at(projected.tape().path())
            .panic();
    }
}
