//! Losses between depth maps: up to scale and shift on disparity, up to scale on depth.
//!
//! All take images `[N, H, W]` or `[N, H, W, 1]` and a mask of the same shape, 1 where the object is. A pixel
//! counts where the mask is above one half and neither image holds `+∞`, the mark of the background; no
//! other pixel is read, and none gets a gradient. A NaN that counts is seen in the value. The target is
//! data: gradients go to the prediction alone. Without a pixel that counts, value and gradient are zero.

mod align;
mod gradient;
mod invariant;
mod log;
mod normalize;
mod pixels;
mod residual;

pub use align::{align_scale_shift, disparity};
pub use gradient::depth_gradients;
pub use invariant::{Robustness, ScaleShiftInvariant};
pub use log::log_depth;
pub use normalize::normalize_depth;
pub use pixels::DepthMean;
pub use residual::{depth_l1_trimmed, depth_l2};

#[cfg(test)]
mod tests;
