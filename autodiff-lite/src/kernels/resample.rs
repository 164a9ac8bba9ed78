//! Bilinear reading of features-last images on a grid.

use crate::Real;
use crate::kernels::blocks::{SERIAL_ELEMENTS, for_each_part};
use crate::kernels::extent::elements;

/// Two pixels and their weights along one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blend<F> {
    /// The first and the second pixel.
    pub at: [usize; 2],
    /// The weight of the second; that of the first is 1 less it.
    pub weight: F,
}

/// The blends that resize an axis of `from` pixels to `to`.
///
/// With `align_corners` the outermost pixel centres stay where they are, else the outermost
/// edges: `source = (i + 1/2) from / to - 1/2`, clamped to the image, as in PyTorch.
pub fn resize_blends<F: Real>(from: usize, to: usize, align_corners: bool) -> Vec<Blend<F>> {
    let last = from.saturating_sub(1);
    (0..to)
        .map(|i| {
            let source = if align_corners {
                if to > 1 { i as f64 * last as f64 / (to - 1) as f64 } else { 0.0 }
            } else {
                (i as f64 + 0.5) * from as f64 / to as f64 - 0.5
            };
            let source = source.clamp(0.0, last as f64);
            let first = (source.floor() as usize).min(last);
            let weight = F::from_f64(source - first as f64);
            Blend { at: [first, (first + 1).min(last)], weight }
        })
        .collect()
}

/// `x [N, H, W, C]` to `y [N, rows, columns, C]`.
///
/// # Panics
/// If a length does not fit.
pub fn resize<F: Real>(
    [n, h, w, c]: [usize; 4],
    rows: &[Blend<F>],
    columns: &[Blend<F>],
    x: &[F],
    y: &mut [F],
) {
    assert_eq!(x.len(), elements(&[n, h, w, c]));
    assert_eq!(y.len(), elements(&[n, rows.len(), columns.len(), c]));
    let parallel = y.len() >= SERIAL_ELEMENTS;
    for_each_part(y, columns.len() * c, parallel, |row, y| {
        let (image, blend) = (row / rows.len(), rows[row % rows.len()]);
        let line = |at: usize| &x[(image * h + at) * w * c..][..w * c];
        let [top, bottom] = blend.at.map(line);
        for (y, across) in y.chunks_exact_mut(c).zip(columns) {
            let [left, right] = across.at.map(|at| at * c);
            for i in 0..c {
                let upper = top[left + i] + (top[right + i] - top[left + i]) * across.weight;
                let lower =
                    bottom[left + i] + (bottom[right + i] - bottom[left + i]) * across.weight;
                y[i] = upper + (lower - upper) * blend.weight;
            }
        }
    });
}

/// Adds the gradient of [`resize`]'s input.
///
/// # Panics
/// If a length does not fit.
pub fn resize_grad<F: Real>(
    [n, h, w, c]: [usize; 4],
    rows: &[Blend<F>],
    columns: &[Blend<F>],
    g: &[F],
    gx: &mut [F],
) {
    assert_eq!(gx.len(), elements(&[n, h, w, c]));
    let output = elements(&[rows.len(), columns.len(), c]);
    assert_eq!(g.len(), elements(&[n, output]));
    if g.is_empty() {
        return;
    }
    for_each_part(gx, h * w * c, g.len() >= SERIAL_ELEMENTS, |image, gx| {
        let g = &g[image * output..(image + 1) * output];
        for (g, blend) in g.chunks_exact(columns.len() * c).zip(rows) {
            for (g, across) in g.chunks_exact(c).zip(columns) {
                let one = F::one();
                for (row, down) in blend.at.into_iter().zip([one - blend.weight, blend.weight]) {
                    for (column, over) in
                        across.at.into_iter().zip([one - across.weight, across.weight])
                    {
                        let to = &mut gx[(row * w + column) * c..][..c];
                        for (gx, &g) in to.iter_mut().zip(g) {
                            *gx += g * down * over;
                        }
                    }
                }
            }
        }
    });
}
