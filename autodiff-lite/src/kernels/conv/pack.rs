//! Copies that a sweep needs: zero-padded activations, and weights in the order of its products.

use crate::kernels::blocks::{SERIAL_ELEMENTS, Shared, for_each_block};
use crate::kernels::extent::elements;
use crate::kernels::lane::Lane;

/// Where the pixels of an image go in a larger one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Frame {
    pub(super) batch: usize,
    /// Rows and columns of the image.
    pub(super) size: [usize; 2],
    pub(super) channels: usize,
    /// Rows and columns of zeros before it.
    pub(super) before: [usize; 2],
    /// Rows and columns of the framed image.
    pub(super) framed: [usize; 2],
}

impl Frame {
    /// Whether the frame is the image.
    pub(super) fn is_plain(&self) -> bool {
        self.size == self.framed
    }

    /// Numbers in the framed image; 0 if it is the image itself.
    pub(super) fn len(&self) -> usize {
        if self.is_plain() {
            0
        } else {
            elements(&[self.batch, self.framed[0], self.framed[1], self.channels])
        }
    }

    /// `x` itself or, in `out`, `x` with zeros around it.
    pub(super) fn fill<'a, F: Lane>(&self, x: &'a [F], out: &'a mut [F]) -> &'a [F] {
        if self.is_plain() {
            return x;
        }
        let [h, w] = self.size;
        let (line, row) = (w * self.channels, self.framed[1] * self.channels);
        let left = self.before[1] * self.channels;
        let shared = Shared::new(out);
        // One block for each image: few, large copies.
        let parallel = out.len() >= SERIAL_ELEMENTS;
        for_each_block(self.batch * self.framed[0], parallel, |block| {
            let (n, y) = (block / self.framed[0], block % self.framed[0]);
            // SAFETY: each block is a row of its own.
            let to = unsafe { shared.slice(block * row, row) };
            if y < self.before[0] || y >= self.before[0] + h {
                to.fill(F::zero());
                return;
            }
            let from = (n * h + y - self.before[0]) * line;
            to[..left].fill(F::zero());
            to[left..left + line].copy_from_slice(&x[from..from + line]);
            to[left + line..].fill(F::zero());
        });
        out
    }
}

/// One step of a window along one axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Tap {
    /// Pixels from the window's first.
    pub(super) offset: usize,
    /// Which row or column of the kernel.
    pub(super) k: usize,
}

/// How weights `[O, I, KH, KW]` are read: which index is the sum's, which the output's.
#[derive(Clone, Copy, Debug)]
pub(super) struct Roles {
    /// Number and step of the index that is summed over.
    pub(super) summed: [usize; 2],
    /// Number and step of the index of the output's channels.
    pub(super) output: [usize; 2],
}

/// Numbers in packed weights.
pub(super) fn packed_len(taps: usize, roles: &Roles, columns: usize) -> usize {
    elements(&[roles.output[0].div_ceil(columns), columns, roles.summed[0], taps])
}

/// Outputs that are packed together: a line of what is written, and as many lines of what is read as stay in L1.
const OUTPUTS: usize = 16;

/// Packs `w` as `[block of outputs][tap][summed][columns]`, zero in columns that do not exist.
pub(super) fn pack<F: Lane>(
    w: &[F],
    kernel: [usize; 2],
    taps: &[(usize, usize)],
    roles: &Roles,
    columns: usize,
    out: &mut [F],
) {
    let [summed, summed_step] = roles.summed;
    let [outputs, output_step] = roles.output;
    let panel = taps.len() * summed * columns;
    if panel == 0 {
        return;
    }
    let parallel = out.len() >= 16 * 1024;
    let shared = Shared::new(out);
    for_each_block(outputs.div_ceil(columns), parallel, |block| {
        // SAFETY: each block is a panel of its own.
        let panel = unsafe { shared.slice(block * panel, panel) };
        for first in (0..columns).step_by(OUTPUTS) {
            let output = block * columns + first;
            let width = OUTPUTS.min(columns - first);
            let count = width.min(outputs.saturating_sub(output));
            for channel in 0..summed {
                let start = output * output_step + channel * summed_step;
                for (tap, &(ky, kx)) in taps.iter().enumerate() {
                    let to = &mut panel[(tap * summed + channel) * columns + first..][..width];
                    if count == OUTPUTS {
                        let from = &w[start + ky * kernel[1] + kx..];
                        let from = &from[..=(OUTPUTS - 1) * output_step];
                        for (k, to) in to.iter_mut().enumerate() {
                            *to = from[k * output_step];
                        }
                        continue;
                    }
                    to.fill(F::zero());
                    for (k, to) in to[..count].iter_mut().enumerate() {
                        *to = w[start + ky * kernel[1] + kx + k * output_step];
                    }
                }
            }
        }
    });
}
