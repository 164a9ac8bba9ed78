//! Drawing in one precision, compiled here, once for all crates above: why and how stands in `autodiff-lite/src/instances.rs`.

use std::hint::black_box;

use autodiff_lite::Real;

use crate::{Frame, Layers, Renderer, rasterize_into, softras, sphere_texture};

/// Names the functions for one precision: what has an address is compiled.
fn compile<F: Real>() {
    macro_rules! named {
        ($($type:ident: $($name:ident)+;)+) => {
            $($(black_box($type::<F>::$name as *const ());)+)+
        };
    }
    named! {
        Renderer: frame;
        Frame: depth interpolate interpolate_corners soft_silhouette antialiased_silhouette texture;
        Layers: again softmax_blend alpha depth distance barycentric interpolate;
    }
    black_box(rasterize_into::<F> as *const ());
    black_box(softras::<F> as *const ());
    black_box(sphere_texture::<F> as *const ());
}

/// Single precision, in which fits and networks draw. A static is compiled even if nobody reads it.
#[allow(dead_code, reason = "it is there to be compiled")]
static SINGLE: fn() = compile::<f32>;
