//! Moving rows and blocks: gather, scatter, permute.

use crate::Real;
use crate::kernels::blocks::for_each_part;
use crate::kernels::elementwise::PARALLEL_FROM;

/// `y[b, k, :] = x[b, indices[k], :]` for `x [batch, rows, width]`.
///
/// # Panics
/// If an index is out of range.
pub fn gather<F: Real>([rows, width]: [usize; 2], x: &[F], indices: &[u32], y: &mut [F]) {
    let (from, to) = (rows * width, indices.len() * width);
    if from == 0 || to == 0 {
        assert!(indices.is_empty() || rows > 0, "rows of an empty table");
        return;
    }
    let one = |x: &[F], y: &mut [F]| match width {
        1 => gather_fixed::<F, 1>(x, indices, y),
        2 => gather_fixed::<F, 2>(x, indices, y),
        3 => gather_fixed::<F, 3>(x, indices, y),
        4 => gather_fixed::<F, 4>(x, indices, y),
        _ => {
            for (y, &i) in y.chunks_exact_mut(width).zip(indices) {
                y.copy_from_slice(&x[i as usize * width..][..width]);
            }
        }
    };
    let parallel = y.len() >= PARALLEL_FROM;
    for_each_part(y, to, parallel, |b, y| one(&x[b * from..][..from], y));
}

fn gather_fixed<F: Real, const W: usize>(x: &[F], indices: &[u32], y: &mut [F]) {
    let (x, y) = (x.as_chunks::<W>().0, y.as_chunks_mut::<W>().0);
    for (y, &i) in y.iter_mut().zip(indices) {
        *y = x[i as usize];
    }
}

/// `y[b, indices[k], :] += x[b, k, :]` for `y [batch, rows, width]`, in the order of `k`.
///
/// # Panics
/// If an index is out of range.
pub fn scatter_add<F: Real>([rows, width]: [usize; 2], x: &[F], indices: &[u32], y: &mut [F]) {
    let (from, to) = (indices.len() * width, rows * width);
    if from == 0 || to == 0 {
        assert!(indices.is_empty() || rows > 0, "rows of an empty table");
        return;
    }
    let one = |x: &[F], y: &mut [F]| match width {
        1 => scatter_fixed::<F, 1>(x, indices, y),
        2 => scatter_fixed::<F, 2>(x, indices, y),
        3 => scatter_fixed::<F, 3>(x, indices, y),
        4 => scatter_fixed::<F, 4>(x, indices, y),
        _ => {
            for (x, &i) in x.chunks_exact(width).zip(indices) {
                let y = &mut y[i as usize * width..][..width];
                y.iter_mut().zip(x).for_each(|(y, &x)| *y += x);
            }
        }
    };
    let parallel = x.len() >= PARALLEL_FROM;
    for_each_part(y, to, parallel, |b, y| one(&x[b * from..][..from], y));
}

fn scatter_fixed<F: Real, const W: usize>(x: &[F], indices: &[u32], y: &mut [F]) {
    let (x, y) = (x.as_chunks::<W>().0, y.as_chunks_mut::<W>().0);
    for (x, &i) in x.iter().zip(indices) {
        let y = &mut y[i as usize];
        for k in 0..W {
            y[k] += x[k];
        }
    }
}

/// Writes `x` of shape `dims` with its axes in the order `order`: `y[.., i_order[k], ..] = x[.., i_k, ..]`.
///
/// # Panics
/// If a length does not fit.
pub fn permute<F: Real>(dims: &[usize], order: &[usize], x: &[F], y: &mut [F]) {
    assert_eq!(dims.len(), order.len());
    assert_eq!(x.len(), y.len());
    if x.is_empty() {
        return;
    }
    let mut strides = vec![1; dims.len()];
    for k in (1..dims.len()).rev() {
        strides[k - 1] = strides[k] * dims[k];
    }
    // Axes of the output: size and step in the input; neighbours that stay together merge.
    let mut axes: Vec<(usize, usize)> = Vec::with_capacity(order.len());
    for &axis in order {
        let (size, step) = (dims[axis], strides[axis]);
        match axes.last_mut() {
            _ if size == 1 => {}
            Some((s, t)) if *t == step * size => (*s, *t) = (*s * size, step),
            _ => axes.push((size, step)),
        }
    }
    let Some(&(first, first_step)) = axes.first() else {
        y[0] = x[0];
        return;
    };
    let block = y.len() / first;
    let parallel = y.len() >= PARALLEL_FROM;
    for_each_part(y, block, parallel, |k, y| copy_strided(&axes[1..], &x[k * first_step..], y));
}

fn copy_strided<F: Real>(axes: &[(usize, usize)], x: &[F], y: &mut [F]) {
    match axes {
        [] => y[0] = x[0],
        [(_, 1)] => y.copy_from_slice(&x[..y.len()]),
        [(_, step)] => y.iter_mut().zip(x.iter().step_by(*step)).for_each(|(y, &x)| *y = x),
        [(size, step), rest @ ..] => {
            let block = y.len() / size;
            for (k, y) in y.chunks_exact_mut(block).enumerate() {
                copy_strided(rest, &x[k * step..], y);
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use ndarray::{ArrayD, IxDyn};
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn permute_is_what_ndarray_says(
            dims in proptest::collection::vec(1_usize..5, 1..5),
            seed in any::<u64>(),
        ) {
            let mut order: Vec<usize> = (0..dims.len()).collect();
            order.sort_by_key(|&k| (seed.wrapping_mul(k as u64 * 2 + 1)) >> 40);
            let n: usize = dims.iter().product();
            let x = ArrayD::from_shape_vec(IxDyn(&dims), (0..n).map(|k| k as f32).collect()).unwrap();
            let expected: Vec<f32> = x.view().permuted_axes(IxDyn(&order)).iter().copied().collect();
            let mut y = vec![0.0; n];
            permute(&dims, &order, x.as_slice().unwrap(), &mut y);
            prop_assert_eq!(y, expected);
        }
    }
}
