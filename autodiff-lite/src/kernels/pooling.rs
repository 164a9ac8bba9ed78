//! Pooling of features-last images.

use std::ops::Range;

use crate::Real;
use crate::kernels::blocks::{SERIAL_ELEMENTS, Shared, for_each_block, for_each_part};
use crate::kernels::extent::elements;
use crate::kernels::simd::clones;

/// Windows along both axes: for each output row (column) the input rows (columns) it covers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Windows {
    /// N.
    pub batch: usize,
    /// Rows and columns of the input.
    pub input: [usize; 2],
    /// C.
    pub channels: usize,
    /// For each output row and for each output column, the range that it covers, never empty.
    pub ranges: [Vec<(usize, usize)>; 2],
    /// What a mean divides by, if not by the number of covered pixels: the full window, for
    /// averages that count padding.
    pub area: Option<usize>,
}

/// Kernel, stride and padding of a pooling, each as (rows, columns).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PoolGeometry {
    /// Rows and columns of the window.
    pub kernel: [usize; 2],
    /// Pixels between windows; at least 1.
    pub stride: [usize; 2],
    /// Pixels on each side that windows may reach over; at most half the kernel.
    pub padding: [usize; 2],
}

impl PoolGeometry {
    /// Square windows side by side.
    pub fn square(kernel: usize) -> Self {
        Self { kernel: [kernel; 2], stride: [kernel; 2], padding: [0; 2] }
    }

    /// The same stride along both axes.
    #[must_use]
    pub fn stride(self, stride: usize) -> Self {
        Self { stride: [stride; 2], ..self }
    }

    /// The same padding on all sides.
    #[must_use]
    pub fn padding(self, padding: usize) -> Self {
        Self { padding: [padding; 2], ..self }
    }
}

impl Windows {
    /// Of a pooling of `[N, H, W, C]`; none if the window does not fit, or padding is more than
    /// half of it.
    pub fn new([batch, h, w, channels]: [usize; 4], geometry: &PoolGeometry) -> Option<Self> {
        let along = |axis: usize, size: usize| -> Option<Vec<(usize, usize)>> {
            let (kernel, stride) = (geometry.kernel[axis], geometry.stride[axis]);
            let padding = geometry.padding[axis];
            if kernel == 0 || stride == 0 || padding > kernel / 2 {
                return None;
            }
            let padded = size.checked_add(padding.checked_mul(2)?)?;
            let count = padded.checked_sub(kernel)? / stride + 1;
            let range = |i: usize| {
                let end = (i * stride + kernel).saturating_sub(padding).min(size);
                ((i * stride).saturating_sub(padding), end)
            };
            let ranges: Vec<_> = (0..count).map(range).collect();
            ranges.iter().all(|(start, end)| start < end).then_some(ranges)
        };
        let ranges = [along(0, h)?, along(1, w)?];
        let area = Some(geometry.kernel[0].checked_mul(geometry.kernel[1])?);
        Some(Self { batch, input: [h, w], channels, ranges, area })
    }

    /// Windows that divide `[N, H, W, C]` into `size` as evenly as whole pixels allow: output `i`
    /// covers `floor(i H / size) .. ceil((i + 1) H / size)`; none if the image is empty.
    pub fn adaptive([batch, h, w, channels]: [usize; 4], size: [usize; 2]) -> Option<Self> {
        let along = |input: usize, count: usize| -> Vec<(usize, usize)> {
            (0..count).map(|i| (i * input / count, ((i + 1) * input).div_ceil(count))).collect()
        };
        let ranges = [along(h, size[0]), along(w, size[1])];
        (h > 0 && w > 0).then_some(Self { batch, input: [h, w], channels, ranges, area: None })
    }

    /// `[N, H', W', C]`.
    pub fn output_shape(&self) -> [usize; 4] {
        [self.batch, self.ranges[0].len(), self.ranges[1].len(), self.channels]
    }

    fn input_len(&self) -> usize {
        elements(&[self.batch, self.input[0], self.input[1], self.channels])
    }

    fn output_len(&self) -> usize {
        elements(&self.output_shape())
    }

    fn parallel(&self) -> bool {
        self.input_len() >= SERIAL_ELEMENTS
    }

    fn scale<F: Real>(&self, covered: usize) -> F {
        F::from_f64(1.0 / self.area.unwrap_or(covered) as f64)
    }
}

/// The largest pixel of each window and channel; `argument` gets where it lies in its image
/// (`row W + column`), the first if there are several. NaN wins.
///
/// # Panics
/// If a length does not fit.
pub fn max_pool<F: Real>(s: &Windows, x: &[F], y: &mut [F], argument: &mut [u32]) {
    assert_eq!(x.len(), s.input_len());
    assert_eq!(y.len(), s.output_len());
    assert_eq!(argument.len(), y.len());
    if y.is_empty() {
        return;
    }
    let (c, [h, w]) = (s.channels, s.input);
    let (rows, columns) = (s.ranges[0].len(), s.ranges[1].len());
    let (out, at) = (Shared::new(y), Shared::new(argument));
    for_each_block(s.batch * rows, s.parallel(), |row| {
        let (image, (top, bottom)) = (row / rows, s.ranges[0][row % rows]);
        for (column, &(left, right)) in s.ranges[1].iter().enumerate() {
            let start = (row * columns + column) * c;
            // SAFETY: each task has an output row of its own.
            let (y, argument) = unsafe { (out.slice(start, c), at.slice(start, c)) };
            let image = &x[image * h * w * c..(image + 1) * h * w * c];
            largest(image, w, [top..bottom, left..right], y, argument);
        }
    });
}

/// The largest of the pixels of one window, channel by channel.
#[inline(always)]
fn largest_body<F: Real>(
    image: &[F],
    width: usize,
    [rows, columns]: [Range<usize>; 2],
    y: &mut [F],
    argument: &mut [u32],
) {
    let c = y.len();
    let argument = &mut argument[..c];
    y.fill(F::neg_infinity());
    argument.fill((rows.start * width + columns.start) as u32);
    for i in rows {
        for j in columns.clone() {
            let place = i * width + j;
            let from = &image[place * c..][..c];
            for k in 0..c {
                let wins = from[k] > y[k] || from[k].is_nan();
                argument[k] = if wins { place as u32 } else { argument[k] };
                y[k] = if wins { from[k] } else { y[k] };
            }
        }
    }
}

clones!(fn largest[F: Real](image: &[F], width: usize, window: [Range<usize>; 2], y: &mut [F], argument: &mut [u32]) = largest_body);

/// Adds the gradient of [`max_pool`]'s input.
///
/// # Panics
/// If a length does not fit.
pub fn max_pool_grad<F: Real>(s: &Windows, g: &[F], argument: &[u32], gx: &mut [F]) {
    assert_eq!(gx.len(), s.input_len());
    assert_eq!(g.len(), argument.len());
    let c = s.channels;
    let (input, output) = (s.input[0] * s.input[1] * c, s.ranges[0].len() * s.ranges[1].len() * c);
    for_each_part(gx, input, s.parallel(), |image, gx| {
        let range = image * output..(image + 1) * output;
        let pixels = g[range.clone()].chunks_exact(c.max(1));
        for (g, places) in pixels.zip(argument[range].chunks_exact(c.max(1))) {
            for (k, (&g, &place)) in g.iter().zip(places).enumerate() {
                gx[place as usize * c + k] += g;
            }
        }
    });
}

/// The mean of each window and channel.
///
/// # Panics
/// If a length does not fit.
pub fn avg_pool<F: Real>(s: &Windows, x: &[F], y: &mut [F]) {
    assert_eq!(x.len(), s.input_len());
    assert_eq!(y.len(), s.output_len());
    let (c, [h, w]) = (s.channels, s.input);
    let (rows, line) = (s.ranges[0].len(), s.ranges[1].len() * c);
    for_each_part(y, line, s.parallel(), |row, y| {
        let (image, (top, bottom)) = (row / rows, s.ranges[0][row % rows]);
        for (y, &(left, right)) in y.chunks_exact_mut(c).zip(&s.ranges[1]) {
            y.fill(F::zero());
            for i in top..bottom {
                let from = ((image * h + i) * w + left) * c;
                for pixel in x[from..from + (right - left) * c].chunks_exact(c) {
                    for (y, &x) in y.iter_mut().zip(pixel) {
                        *y += x;
                    }
                }
            }
            let scale = s.scale::<F>((bottom - top) * (right - left));
            for y in y {
                *y *= scale;
            }
        }
    });
}

/// Adds the gradient of [`avg_pool`]'s input.
///
/// # Panics
/// If a length does not fit.
pub fn avg_pool_grad<F: Real>(s: &Windows, g: &[F], gx: &mut [F]) {
    assert_eq!(gx.len(), s.input_len());
    assert_eq!(g.len(), s.output_len());
    let (c, w) = (s.channels, s.input[1]);
    let (input, columns) = (s.input[0] * w * c, s.ranges[1].len());
    let output = s.ranges[0].len() * columns * c;
    for_each_part(gx, input, s.parallel(), |image, gx| {
        let g = &g[image * output..(image + 1) * output];
        for (row, &(top, bottom)) in s.ranges[0].iter().enumerate() {
            for (column, &(left, right)) in s.ranges[1].iter().enumerate() {
                let g = &g[(row * columns + column) * c..][..c];
                let scale = s.scale::<F>((bottom - top) * (right - left));
                for i in top..bottom {
                    let to = (i * w + left) * c;
                    for pixel in gx[to..to + (right - left) * c].chunks_exact_mut(c) {
                        for (gx, &g) in pixel.iter_mut().zip(g) {
                            *gx += g * scale;
                        }
                    }
                }
            }
        }
    });
}
