//! Matrix products of tensors, in all transpositions.

use crate::kernels::blocks::{SERIAL_BELOW, for_each_part};
use crate::kernels::gemm::Matrix;
use crate::kernels::product::gemm;
use crate::{Backward, Real, Var};

impl<F: Real> Var<'_, F> {
    /// `A B`.
    ///
    /// `2 M K N` flops each, at about nine tenths of the peak of a Zen 4 core for large ones
    /// (bench `gemm`).
    ///
    /// # Shapes
    /// `self [.., M, K]`, `other [.., K, N]` → `[.., M, N]`. The leading axes are equal, or `other` is one matrix
    /// `[K, N]` for all.
    #[track_caller]
    #[inline(never)]
    pub fn matmul(self, other: Self) -> Self {
        self.matmul_transposed(other, [false, false])
    }

    /// [`matmul`](Self::matmul) of operands of which either may be read as its transpose, without
    /// a copy.
    ///
    /// # Shapes
    /// As for [`matmul`](Self::matmul), with the last two axes of an operand that is read as its transpose exchanged:
    /// with `[true, false]`, `self [.., K, M]` and `other [.., K, N]` → `[.., M, N]`.
    ///
    /// # Panics
    /// If the inner sizes or the leading axes differ, or an operand has fewer than two axes.
    #[track_caller]
    #[inline(never)]
    pub fn matmul_transposed(self, other: Self, transposed: [bool; 2]) -> Self {
        let (a, b) = (self.value(), other.value());
        let plan = match Product::new(a.shape(), b.shape(), transposed) {
            Ok(plan) => plan,
            Err(message) => {
                let left = if transposed[0] { ".., K, M" } else { ".., M, K" };
                let right = if transposed[1] { ".., N, K" } else { ".., K, N" };
                let operands = [("left", a.shape(), left), ("right", b.shape(), right)];
                self.tape.refuse("matmul", message, &operands)
            }
        };
        let mut shape = a.shape()[..a.ndim() - 2].to_vec();
        shape.extend([
            if transposed[0] { a.shape()[a.ndim() - 1] } else { a.shape()[a.ndim() - 2] },
            plan.n,
        ]);
        let mut y = self.tape.array(&shape);
        plan.forward(a.as_slice(), b.as_slice(), y.as_slice_mut());
        self.tape.record_fn("matmul", &[self, other], y, move |cx: &mut Backward<'_, F>| {
            let (a, b, g) = (cx.input(0), cx.input(1), cx.grad_out());
            cx.give_with(0, |ga| plan.grad_left(b.as_slice(), g.as_slice(), ga));
            cx.give_with(1, |gb| plan.grad_right(a.as_slice(), g.as_slice(), gb));
        })
    }
}

/// The sizes of a batch of products.
struct Product {
    batch: usize,
    /// Whether all products have the same right operand.
    shared: bool,
    m: usize,
    k: usize,
    n: usize,
    transposed: [bool; 2],
}

impl Product {
    fn new(a: &[usize], b: &[usize], transposed: [bool; 2]) -> Result<Self, String> {
        let ([leading_a @ .., a0, a1], [leading_b @ .., b0, b1]) = (a, b) else {
            return Err("at least two axes expected".to_owned());
        };
        let (m, k) = if transposed[0] { (*a1, *a0) } else { (*a0, *a1) };
        let (inner, n) = if transposed[1] { (*b1, *b0) } else { (*b0, *b1) };
        if k != inner {
            return Err(format!("K is {k} in left and {inner} in right"));
        }
        let mut shared = leading_b.is_empty();
        if !shared && leading_a != leading_b {
            return Err("the leading axes differ".to_owned());
        }
        let (mut batch, mut m) = (leading_a.iter().product::<usize>(), m);
        if shared && !transposed[0] {
            // All rows of all matrices are one tall matrix.
            (batch, m) = (1, batch * m);
        }
        shared &= batch != 1;
        Ok(Self { batch, shared, m, k, n, transposed })
    }

    fn left<'a, F>(&self, a: &'a [F], i: usize) -> Matrix<'a, F> {
        let a = &a[i * self.m * self.k..][..self.m * self.k];
        if self.transposed[0] { Matrix::transposed(a, self.m) } else { Matrix::rows(a, self.k) }
    }

    fn right<'a, F>(&self, b: &'a [F], i: usize) -> Matrix<'a, F> {
        let i = if self.shared { 0 } else { i };
        let b = &b[i * self.k * self.n..][..self.k * self.n];
        if self.transposed[1] { Matrix::transposed(b, self.k) } else { Matrix::rows(b, self.n) }
    }

    fn output<'a, F>(&self, y: &'a [F], i: usize) -> Matrix<'a, F> {
        Matrix::rows(&y[i * self.m * self.n..][..self.m * self.n], self.n)
    }

    /// Calls `f` with each product's part of `out`; on several threads where each is small.
    fn each<F: Send>(&self, out: &mut [F], len: usize, f: impl Fn(usize, &mut [F]) + Sync + Send) {
        let flops = 2 * self.m * self.k * self.n;
        let parallel = flops < SERIAL_BELOW && flops * self.batch >= SERIAL_BELOW;
        for_each_part(out, len, parallel, f);
    }

    fn forward<F: Real>(&self, a: &[F], b: &[F], y: &mut [F]) {
        self.each(y, self.m * self.n, |i, y| {
            let sizes = [self.m, self.k, self.n];
            gemm(sizes, F::one(), self.left(a, i), self.right(b, i), F::zero(), y);
        });
    }

    fn grad_left<F: Real>(&self, b: &[F], g: &[F], ga: &mut [F]) {
        self.each(ga, self.m * self.k, |i, ga| {
            let (b, g) = (self.right(b, i), self.output(g, i));
            if self.transposed[0] {
                gemm([self.k, self.n, self.m], F::one(), b, g.flipped(), F::zero(), ga);
            } else {
                gemm([self.m, self.n, self.k], F::one(), g, b.flipped(), F::zero(), ga);
            }
        });
    }

    fn grad_right<F: Real>(&self, a: &[F], g: &[F], gb: &mut [F]) {
        let one = |i: usize, beta: F, gb: &mut [F]| {
            let (a, g) = (self.left(a, i), self.output(g, i));
            if self.transposed[1] {
                gemm([self.n, self.m, self.k], F::one(), g.flipped(), a, beta, gb);
            } else {
                gemm([self.k, self.m, self.n], F::one(), a.flipped(), g, beta, gb);
            }
        };
        if self.shared {
            gb.fill(F::zero());
            for i in 0..self.batch {
                one(i, F::one(), gb);
            }
        } else {
            self.each(gb, self.k * self.n, |i, gb| one(i, F::zero(), gb));
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::testkit::gradcheck;

    gradcheck!(matmul: |a, b| a.matmul(b),
        shapes [[[3, 5], [5, 2]], [[1, 1], [1, 1]], [[2, 3, 4], [4, 5]], [[2, 3, 4], [2, 4, 1]], [[2, 0], [0, 3]]]);
    gradcheck!(left_transposed: |a, b| a.matmul_transposed(b, [true, false]),
        shapes [[[5, 3], [5, 2]], [[2, 4, 3], [4, 5]], [[2, 4, 3], [2, 4, 1]]]);
    gradcheck!(right_transposed: |a, b| a.matmul_transposed(b, [false, true]),
        shapes [[[3, 5], [2, 5]], [[2, 3, 4], [5, 4]], [[3, 2, 3, 4], [3, 2, 1, 4]]]);
    gradcheck!(both_transposed: |a, b| a.matmul_transposed(b, [true, true]),
        shapes [[[5, 3], [2, 5]], [[2, 4, 3], [5, 4]], [[2, 4, 3], [2, 1, 4]]]);

    #[test]
    #[should_panic(expected = "K is 3 in left and 4 in right")]
    fn inner_sizes_must_agree() {
        let tape = crate::Tape::<f32>::eval();
        let a = tape.constant(ndarray::Array2::<f32>::zeros((2, 3)));
        let b = tape.constant(ndarray::Array2::<f32>::zeros((4, 2)));
        let _ = a.matmul(b);
    }
}
