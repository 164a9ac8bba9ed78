//! Normalisation: of rows (layer norm), of channels or groups of them over pixels (batch norm,
//! group norm), each followed by scale, shift and activation in the same pass.

use crate::Real;
use crate::kernels::activation::{self, Activation};
use crate::kernels::blocks::{SERIAL_ELEMENTS, for_each_part};
use crate::kernels::columns::fold_rows;
use crate::kernels::extent::elements;
use crate::kernels::simd::clones;
use crate::kernels::workspace;

/// An array seen as `[sets, rows, channels]`, whose statistics are taken per set and group of
/// neighbouring channels, over all rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NormSizes {
    /// Independent sets: images for group norm, 1 for batch norm.
    pub sets: usize,
    /// Rows of each set: pixels.
    pub rows: usize,
    /// Numbers in a row.
    pub channels: usize,
    /// Groups of neighbouring channels; a divisor of `channels`.
    pub groups: usize,
}

impl NormSizes {
    /// Numbers that share one mean and variance.
    ///
    /// # Panics
    /// If they are more than a slice can have.
    pub fn population(&self) -> usize {
        elements(&[self.rows, self.channels]) / self.groups
    }
}

/// Mean and `1 / sqrt(variance + epsilon)` of each set and group.
#[derive(Debug)]
pub struct Statistics<'a, F> {
    /// `[sets, groups]`.
    pub mean: &'a [F],
    /// `[sets, groups]`.
    pub inverse: &'a [F],
}

/// Adds `Σ (x - from)` and `Σ (x - from)²` of each channel, the second half of `sums` being the second.
#[inline(always)]
fn spread_body<F: Real>(x: &[F], from: &[F], sums: &mut [F]) {
    let c = from.len();
    let (plain, squares) = sums.split_at_mut(c);
    for x in x.chunks_exact(c) {
        for i in 0..c {
            let far = x[i] - from[i];
            plain[i] += far;
            squares[i] += far * far;
        }
    }
}

#[inline(always)]
fn apply_body<F: Real>(x: &[F], scale: &[F], shift: &[F], activation: Activation, y: &mut [F]) {
    let c = scale.len();
    for (x, y) in x.chunks_exact(c).zip(y.chunks_exact_mut(c)) {
        for (((y, &x), &scale), &shift) in y.iter_mut().zip(x).zip(scale).zip(shift) {
            *y = x * scale + shift;
        }
        activation::apply(activation, y);
    }
}

/// What the output was before its activation: `x scale + shift`.
#[derive(Clone, Copy)]
struct Line<'a, F> {
    scale: &'a [F],
    shift: &'a [F],
}

/// The gradient `g` behind a ReLU, if there is one: none comes back where `before` is not positive.
#[inline(always)]
fn behind<F: Real, const RELU: bool>(g: F, before: F) -> F {
    if !RELU || before > F::zero() { g } else { F::zero() }
}

/// Adds `Σ g` and `Σ g x̂` of each channel, the second half of `sums` being the second.
#[inline(always)]
fn moments_body<F: Real, const RELU: bool>(
    x: &[F],
    g: &[F],
    line: Line<'_, F>,
    mean: &[F],
    inverse: &[F],
    sums: &mut [F],
) {
    let c = mean.len();
    let (plain, weighted) = sums.split_at_mut(c);
    let (scale, shift) = (&line.scale[..c], &line.shift[..c]);
    for (x, g) in x.chunks_exact(c).zip(g.chunks_exact(c)) {
        for i in 0..c {
            let g = behind::<F, RELU>(g[i], x[i] * scale[i] + shift[i]);
            plain[i] += g;
            weighted[i] += g * (x[i] - mean[i]) * inverse[i];
        }
    }
}

/// `g` becomes `a g - b - x c`, each of `a`, `b`, `c` per channel.
#[inline(always)]
fn center_body<F: Real, const RELU: bool>(
    x: &[F],
    line: Line<'_, F>,
    a: &[F],
    b: &[F],
    c: &[F],
    g: &mut [F],
) {
    let n = a.len();
    let (scale, shift) = (&line.scale[..n], &line.shift[..n]);
    for (x, g) in x.chunks_exact(n).zip(g.chunks_exact_mut(n)) {
        for i in 0..n {
            let own = behind::<F, RELU>(g[i], x[i] * scale[i] + shift[i]);
            g[i] = own * a[i] - b[i] - x[i] * c[i];
        }
    }
}

clones!(fn add_spread[F: Real](x: &[F], from: &[F], sums: &mut [F]) = spread_body);
clones!(fn apply_rows[F: Real](x: &[F], scale: &[F], shift: &[F], activation: Activation, y: &mut [F]) = apply_body);
clones!(fn add_moments[F: Real](x: &[F], g: &[F], line: Line<'_, F>, mean: &[F], inverse: &[F], sums: &mut [F]) = moments_body::<F, false>);
clones!(fn add_moments_behind_relu[F: Real](x: &[F], g: &[F], line: Line<'_, F>, mean: &[F], inverse: &[F], sums: &mut [F]) = moments_body::<F, true>);
clones!(fn center_rows[F: Real](x: &[F], line: Line<'_, F>, a: &[F], b: &[F], c: &[F], g: &mut [F]) = center_body::<F, false>);
clones!(fn center_rows_behind_relu[F: Real](x: &[F], line: Line<'_, F>, a: &[F], b: &[F], c: &[F], g: &mut [F]) = center_body::<F, true>);

/// Rows whose mean distances are taken from: near enough to the mean that squares of what is left do not drown it.
const SAMPLED: usize = 16;

/// Mean and biased variance of each set and group, in one pass: those of each channel from sums about a mean of a few
/// rows, then those of the groups (Chan, Golub and LeVeque 1979, *Updating formulae and a pairwise algorithm for computing
/// sample variances*).
///
/// # Panics
/// If a length does not fit.
pub fn statistics<F: Real>(s: NormSizes, x: &[F], mean: &mut [F], variance: &mut [F]) {
    let (c, width) = (s.channels, s.channels / s.groups);
    assert_eq!(x.len(), elements(&[s.sets, s.rows, c]));
    let of = |count: usize| F::from_f64(1.0 / count.max(1) as f64);
    let mut memory = workspace::lend(3 * c);
    let (from, sums) = memory.split_at_mut(c);
    for set in 0..s.sets {
        let x = &x[set * s.rows * c..(set + 1) * s.rows * c];
        from.fill(F::zero());
        let sampled = SAMPLED.min(s.rows);
        let share = of(sampled);
        for k in 0..sampled {
            let row = &x[k * s.rows / sampled * c..][..c];
            from.iter_mut().zip(row).for_each(|(from, &x)| *from += x * share);
        }
        fold_rows(s.rows, c, 1, sums, |r, sums| {
            add_spread(&x[r.start * c..r.end * c], from, sums);
        });
        let (plain, squares) = sums.split_at_mut(c);
        for i in 0..c {
            // From here the mean of the channel, and the squares about it.
            let far = plain[i] * of(s.rows);
            squares[i] = (squares[i] - plain[i] * far).max(F::zero());
            plain[i] = from[i] + far;
        }
        let channels = plain.chunks_exact(width).zip(squares.chunks_exact(width));
        for ((means, squares), group) in channels.zip(set * s.groups..) {
            let own = means.iter().copied().sum::<F>() * of(width);
            let between = means.iter().map(|&m| (m - own) * (m - own)).sum::<F>();
            let within = squares.iter().copied().sum::<F>();
            mean[group] = own;
            variance[group] = within * of(s.population()) + between * of(width);
        }
    }
}

/// `y = activation((x - mean) inverse · weight + bias)`, weight and bias per channel.
///
/// # Panics
/// If a length does not fit.
pub fn normalize<F: Real>(
    s: NormSizes,
    x: &[F],
    statistics: &Statistics<'_, F>,
    [weight, bias]: [&[F]; 2],
    activation: Activation,
    y: &mut [F],
) {
    let (c, width) = (s.channels, s.channels / s.groups);
    assert_eq!([x.len(), y.len()], [elements(&[s.sets, s.rows, c]); 2]);
    let mut memory = workspace::lend(2 * c);
    let (scale, shift) = memory.split_at_mut(c);
    for set in 0..s.sets {
        for i in 0..c {
            let group = set * s.groups + i / width;
            scale[i] = statistics.inverse[group] * weight[i];
            shift[i] = bias[i] - statistics.mean[group] * scale[i];
        }
        let range = set * s.rows * c..(set + 1) * s.rows * c;
        let chunk = (16 * 1024 / c.max(1)).max(1) * c;
        let (x, y) = (&x[range.clone()], &mut y[range]);
        let parallel = x.len() >= SERIAL_ELEMENTS;
        for_each_part(y, chunk, parallel, |i, y| {
            apply_rows(&x[i * chunk..][..y.len()], scale, shift, activation, y);
        });
    }
}

type Moments<F> = fn(&[F], &[F], Line<'_, F>, &[F], &[F], &mut [F]);
type Center<F> = fn(&[F], Line<'_, F>, &[F], &[F], &[F], &mut [F]);

/// The first `N` parts of `len` numbers.
fn parts<F, const N: usize>(mut rest: &mut [F], len: usize) -> [&mut [F]; N] {
    std::array::from_fn(|_| {
        let (part, behind) = std::mem::take(&mut rest).split_at_mut(len);
        rest = behind;
        part
    })
}

/// Turns the gradient `g` of the normalised, scaled and shifted output into that of `x`, in place, and adds those of weight
/// and bias. With `relu` `g` is that of what a ReLU made of this output.
///
/// # Panics
/// If a length does not fit.
pub fn normalize_grad<F: Real>(
    s: NormSizes,
    x: &[F],
    statistics: &Statistics<'_, F>,
    [weight, bias]: [&[F]; 2],
    relu: bool,
    g: &mut [F],
    [grad_weight, grad_bias]: [&mut [F]; 2],
) {
    let (c, width) = (s.channels, s.channels / s.groups);
    assert_eq!([x.len(), g.len()], [elements(&[s.sets, s.rows, c]); 2]);
    let count = F::from_f64(1.0 / s.population().max(1) as f64);
    let mut memory = workspace::lend(9 * c);
    let (sums, rest) = memory.split_at_mut(2 * c);
    let [mean, inverse, first, second, third, scale, shift] = parts(rest, c);
    let (moments, center) = if relu {
        (add_moments_behind_relu as Moments<F>, center_rows_behind_relu as Center<F>)
    } else {
        (add_moments as Moments<F>, center_rows as Center<F>)
    };
    for set in 0..s.sets {
        for i in 0..c {
            let group = set * s.groups + i / width;
            (mean[i], inverse[i]) = (statistics.mean[group], statistics.inverse[group]);
            // To the bit as in [`normalize`].
            scale[i] = inverse[i] * weight[i];
            shift[i] = bias[i] - mean[i] * scale[i];
        }
        let line = Line { scale: &*scale, shift: &*shift };
        let range = set * s.rows * c..(set + 1) * s.rows * c;
        let (x, g) = (&x[range.clone()], &mut g[range]);
        let shared = &*g;
        fold_rows(s.rows, c, 2, sums, |r, sums| {
            let r = r.start * c..r.end * c;
            moments(&x[r.clone()], &shared[r], line, mean, inverse, sums);
        });
        for i in 0..c {
            grad_bias[i] += sums[i];
            grad_weight[i] += sums[c + i];
        }
        for group in 0..s.groups {
            let channels = group * width..(group + 1) * width;
            let (mut plain, mut weighted) = (F::zero(), F::zero());
            for i in channels.clone() {
                plain += weight[i] * sums[i] * count;
                weighted += weight[i] * sums[c + i] * count;
            }
            for i in channels {
                // inverse (w g - plain - x̂ weighted), with x̂ = (x - mean) inverse.
                first[i] = inverse[i] * weight[i];
                third[i] = inverse[i] * inverse[i] * weighted;
                second[i] = inverse[i] * plain - third[i] * mean[i];
            }
        }
        let chunk = (16 * 1024 / c.max(1)).max(1) * c;
        let parallel = x.len() >= SERIAL_ELEMENTS;
        for_each_part(g, chunk, parallel, |i, g| {
            center(&x[i * chunk..][..g.len()], line, first, second, third, g);
        });
    }
}

#[inline(always)]
fn layer_body<F: Real>(
    x: &[F],
    weight: &[F],
    bias: &[F],
    epsilon: F,
    activation: Activation,
    y: &mut [F],
    stats: &mut [F],
) {
    let c = weight.len();
    let count = F::one() / F::from_f64(c as f64);
    let rows = x.chunks_exact(c).zip(y.chunks_exact_mut(c)).zip(stats.chunks_exact_mut(2));
    for ((x, y), stats) in rows {
        let mean = lane_sum(x, |x| x) * count;
        let variance = lane_sum(x, |x| (x - mean) * (x - mean)) * count;
        let inverse = F::one() / (variance + epsilon).sqrt();
        (stats[0], stats[1]) = (mean, inverse);
        for (((y, &x), &weight), &bias) in y.iter_mut().zip(x).zip(weight).zip(bias) {
            *y = (x - mean) * inverse * weight + bias;
        }
        activation::apply(activation, y);
    }
}

#[inline(always)]
fn lane_sum<F: Real>(x: &[F], f: impl Fn(F) -> F) -> F {
    let mut lanes = [F::zero(); 16];
    for chunk in x.chunks(16) {
        for (sum, &x) in lanes.iter_mut().zip(chunk) {
            *sum += f(x);
        }
    }
    let mut sum = F::zero();
    for lane in lanes {
        sum += lane;
    }
    sum
}

#[inline(always)]
fn layer_grad_body<F: Real>(x: &[F], stats: &[F], weight: &[F], g: &mut [F]) {
    let c = weight.len();
    let count = F::one() / F::from_f64(c as f64);
    let rows = x.chunks_exact(c).zip(g.chunks_exact_mut(c)).zip(stats.chunks_exact(2));
    for ((x, g), stats) in rows {
        let (mean, inverse) = (stats[0], stats[1]);
        let [mut plain, mut weighted] = [[F::zero(); 16]; 2];
        for ((x, g), w) in x.chunks(16).zip(g.chunks(16)).zip(weight.chunks(16)) {
            for i in 0..x.len() {
                plain[i] += w[i] * g[i];
                weighted[i] += w[i] * g[i] * (x[i] - mean) * inverse;
            }
        }
        let [mut a, mut b] = [F::zero(); 2];
        for i in 0..16 {
            a += plain[i];
            b += weighted[i];
        }
        let (a, b) = (a * count, b * count);
        for ((g, &x), &w) in g.iter_mut().zip(x).zip(weight) {
            *g = inverse * (w * *g - a - (x - mean) * inverse * b);
        }
    }
}

clones!(fn layer_rows[F: Real](x: &[F], weight: &[F], bias: &[F], epsilon: F, activation: Activation, y: &mut [F], stats: &mut [F]) = layer_body);
clones!(fn layer_grad_rows[F: Real](x: &[F], stats: &[F], weight: &[F], g: &mut [F]) = layer_grad_body);

/// Normalises each row of `weight.len()` numbers; `stats` gets mean and inverse deviation of each
/// row.
///
/// # Panics
/// If a length does not fit.
pub fn layer_norm<F: Real>(
    x: &[F],
    [weight, bias]: [&[F]; 2],
    epsilon: F,
    activation: Activation,
    y: &mut [F],
    stats: &mut [F],
) {
    let c = weight.len();
    if c == 0 || x.is_empty() {
        return;
    }
    assert_eq!(x.len(), y.len());
    assert_eq!(stats.len(), x.len() / c * 2);
    let rows = (16 * 1024 / c).max(1);
    let shared = crate::kernels::blocks::Shared::new(stats);
    for_each_part(y, rows * c, x.len() >= SERIAL_ELEMENTS, |i, y| {
        // SAFETY: each task has the statistics of its own rows.
        let stats = unsafe { shared.slice(i * rows * 2, y.len() / c * 2) };
        let x = &x[i * rows * c..][..y.len()];
        layer_rows(x, weight, bias, epsilon, activation, y, stats);
    });
}

/// Turns the gradient `g` of [`layer_norm`]'s output (before the activation) into that of `x`, in
/// place, after adding those of weight and bias.
///
/// # Panics
/// If a length does not fit.
pub fn layer_norm_grad<F: Real>(
    x: &[F],
    stats: &[F],
    weight: &[F],
    g: &mut [F],
    [grad_weight, grad_bias]: [&mut [F]; 2],
) {
    let c = weight.len();
    if c == 0 || x.is_empty() {
        return;
    }
    let mut sums = workspace::lend(2 * c);
    let shared = &*g;
    fold_rows(x.len() / c, c, 2, &mut sums, |rows, sums| {
        let (plain, weighted) = sums.split_at_mut(c);
        for row in rows {
            let (x, g) = (&x[row * c..(row + 1) * c], &shared[row * c..(row + 1) * c]);
            let (mean, inverse) = (stats[row * 2], stats[row * 2 + 1]);
            for i in 0..c {
                plain[i] += g[i];
                weighted[i] += g[i] * (x[i] - mean) * inverse;
            }
        }
    });
    for i in 0..c {
        grad_bias[i] += sums[i];
        grad_weight[i] += sums[c + i];
    }
    let rows = (16 * 1024 / c).max(1);
    for_each_part(g, rows * c, x.len() >= SERIAL_ELEMENTS, |i, g| {
        let (first, here) = (i * rows, g.len() / c);
        let stats = &stats[first * 2..(first + here) * 2];
        layer_grad_rows(&x[first * c..(first + here) * c], stats, weight, g);
    });
}
