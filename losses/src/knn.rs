//! The k nearest points of a set, and what is there.

use autodiff_lite::{Backward, Real, Var};

use crate::kernels::neighbors::{Norm, k_nearest};

/// Which k points of one set are nearest to each point of another: plain values, nearest first.
///
/// Which they are is not differentiable; [`knn_distances`] and [`knn_gather`] carry gradients over them. Keep it from
/// step to step: it is then found again in the same memory.
///
/// ```
/// use autodiff_lite::Tape;
/// use losses::{Neighbors, Norm, knn_distances, knn_gather};
///
/// let tape = Tape::<f64>::train(0);
/// let x = tape.leaf(ndarray::arr2(&[[0.0, 0.0, 0.0]]));
/// let y = tape.leaf(ndarray::arr2(&[[3.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 2.0]]));
/// let mut near = Neighbors::default();
/// near.find(x, y, 2, Norm::L2);
/// assert_eq!(near.indices(), [1, 2]);
/// let squared = knn_distances(x, y, &near); // [1, 2]
/// assert_eq!(squared.value().as_slice(), [1.0, 4.0]);
/// assert_eq!(knn_gather(y, &near).shape(), [1, 2, 3]);
/// let gradients = squared.sum().backward();
/// assert_eq!(gradients.wrt(x).unwrap().as_slice(), [0.0, -2.0, -4.0]);
/// ```
#[derive(Clone, Debug, Default)]
pub struct Neighbors {
    indices: Vec<u32>,
    /// N, P, Q and k.
    sizes: [usize; 4],
    norm: Norm,
}

impl Neighbors {
    /// Finds the k nearest points of one set to each of another, or of N pairs of sets.
    ///
    /// Of equally near points the lowest come first.
    ///
    /// # Shapes
    /// `x [P, D]` and `y [Q, D]`, of which the neighbours are; or `[N, P, D]` and `[N, Q, D]`.
    /// # Cost
    /// `O(N P Q D)`: all pairs are compared, in parallel over the points of `x`.
    /// # Panics
    /// If the shapes are others, or `y` has fewer than k points (PyTorch3D pads with zeros there).
    #[track_caller]
    pub fn find<F: Real>(&mut self, x: Var<'_, F>, y: Var<'_, F>, k: usize, norm: Norm) {
        let [n, p, q, width] = sets("knn", x, y);
        if p > 0 && q < k {
            let message = format!("{k} neighbours of {q} points");
            x.tape().refuse("knn", message, &[("x", &x.shape(), ""), ("y", &y.shape(), "")]);
        }
        self.sizes = [n, p, q, k];
        self.norm = norm;
        self.indices.clear();
        self.indices.resize(n * p * k, 0);
        if width == 0 || self.indices.is_empty() {
            return;
        }
        let (x, y) = (x.value(), y.value());
        let sets = x.as_slice().chunks(p * width).zip(y.as_slice().chunks(q * width));
        for ((x, y), indices) in sets.zip(self.indices.chunks_mut(p * k)) {
            k_nearest(x, y, width, k, norm, indices);
        }
    }

    /// `[P, k]`, set after set in a batch: places in the set of `y`, nearest first.
    pub fn indices(&self) -> &[u32] {
        &self.indices
    }

    /// How many neighbours each point has.
    pub fn k(&self) -> usize {
        self.sizes[3]
    }
}

/// Finds the k nearest points and how far they are: [`Neighbors::find`], then [`knn_distances`].
///
/// PyTorch3D's `knn_points(x, y, K=k)`: the distances are **squared**.
///
/// # Shapes
/// `x [P, D]` and `y [Q, D]` → `[P, k]`, or `[N, P, D]` and `[N, Q, D]` → `[N, P, k]`; squared units.
///
/// # Panics
/// As [`Neighbors::find`].
#[track_caller]
pub fn knn_points<'t, F: Real>(x: Var<'t, F>, y: Var<'t, F>, k: usize) -> (Var<'t, F>, Neighbors) {
    let mut near = Neighbors::default();
    near.find(x, y, k, Norm::L2);
    (knn_distances(x, y, &near), near)
}

/// The distances to known neighbours, under the norm that they were found with: squared for [`Norm::L2`].
///
/// # Shapes
/// `x [P, D]` and `y [Q, D]` → `[P, k]`, or `[N, P, D]` and `[N, Q, D]` → `[N, P, k]`.
/// # Gradient
/// To both sets, the neighbours being as they are.
/// # Cost
/// `O(N P k D)`.
/// # Panics
/// If the shapes are not those of the sets that were searched.
/// # References
/// `knn_points` of PyTorch3D. Its gradient of the L1 norm is -1 where two coordinates are equal; here it is 0.
#[track_caller]
pub fn knn_distances<'t, F: Real>(
    x: Var<'t, F>,
    y: Var<'t, F>,
    neighbors: &Neighbors,
) -> Var<'t, F> {
    let name = "knn_distances";
    let tape = x.tape();
    let [n, p, q, width] = sets(name, x, y);
    let Neighbors { sizes, norm, .. } = *neighbors;
    let k = sizes[3];
    if sizes[..3] != [n, p, q] {
        let message = format!("the neighbours are of {sizes:?} sets, points, points and k");
        tape.refuse(name, message, &[("x", &x.shape(), ""), ("y", &y.shape(), "")]);
    }
    let mut shape = x.shape();
    if let Some(last) = shape.last_mut() {
        *last = k;
    }
    let mut kept = tape.indices(neighbors.indices.len());
    for (i, (kept, &near)) in kept.iter_mut().zip(&neighbors.indices).enumerate() {
        // Counted through all sets.
        *kept = (i / (p * k) * q) as u32 + near;
    }
    let (a, b) = (x.value(), y.value());
    let mut out = tape.array(&shape);
    for (i, (out, &j)) in out.as_slice_mut().iter_mut().zip(kept.iter()).enumerate() {
        let (from, to) = (row(a.as_slice(), i / k, width), row(b.as_slice(), j as usize, width));
        *out = norm.between(from, to);
    }
    tape.record_fn(name, &[x, y], out, move |cx: &mut Backward<'_, F>| {
        let (a, b, g) = (cx.input(0), cx.input(1), cx.grad_out());
        let (a, b, g) = (a.as_slice(), b.as_slice(), g.as_slice());
        for side in 0..2 {
            if !cx.needs(side) {
                continue;
            }
            let out = cx.grad_slice_mut(side);
            for (i, (&g, &j)) in g.iter().zip(kept.iter()).enumerate() {
                let (i, j) = (i / k, j as usize);
                let to = if side == 0 { i } else { j };
                let sign = if side == 0 { g } else { -g };
                for axis in 0..width {
                    let along = norm.derivative(a[i * width + axis], b[j * width + axis]);
                    out[to * width + axis] += sign * along;
                }
            }
        }
    })
}

/// What known neighbours carry: rows of `values`, PyTorch3D's `knn_gather`.
///
/// # Shapes
/// `values [Q, D]` → `[P, k, D]`, or `[N, Q, D]` → `[N, P, k, D]`; D may be another than that of the search.
/// # Gradient
/// To `values`; a row that is nobody's neighbour gets zero.
/// # Cost
/// `O(N P k D)`.
/// # Panics
/// If there are not as many rows as points were searched.
#[track_caller]
pub fn knn_gather<'t, F: Real>(values: Var<'t, F>, neighbors: &Neighbors) -> Var<'t, F> {
    let name = "knn_gather";
    let tape = values.tape();
    let [n, q, width] = rows(name, "values", values);
    let [sets, p, searched, k] = neighbors.sizes;
    if [n, q] != [sets, searched] {
        let message = format!("the neighbours are among {searched} points in {sets} sets");
        tape.refuse(name, message, &[("values", &values.shape(), "N, Q, D")]);
    }
    let mut kept = tape.indices(neighbors.indices.len());
    for (i, (kept, &near)) in kept.iter_mut().zip(&neighbors.indices).enumerate() {
        *kept = (i / (p * k) * q) as u32 + near;
    }
    let mut shape = values.shape();
    let axis = shape.len() - 2;
    shape.splice(axis..=axis, [p, k]);
    let (from, mut out) = (values.value(), tape.array(&shape));
    for (out, &j) in out.as_slice_mut().chunks_exact_mut(width.max(1)).zip(kept.iter()) {
        out.copy_from_slice(row(from.as_slice(), j as usize, width));
    }
    tape.record_fn(name, &[values], out, move |cx: &mut Backward<'_, F>| {
        let grad = cx.grad_out();
        let out = cx.grad_slice_mut(0);
        for (g, &j) in grad.as_slice().chunks_exact(width.max(1)).zip(kept.iter()) {
            let row = &mut out[j as usize * width..(j as usize + 1) * width];
            row.iter_mut().zip(g).for_each(|(out, &g)| *out += g);
        }
    })
}

#[inline]
fn row<F>(x: &[F], i: usize, width: usize) -> &[F] {
    &x[i * width..(i + 1) * width]
}

/// N, the number of rows, and their width.
#[track_caller]
fn rows<F: Real>(op: &'static str, name: &str, var: Var<'_, F>) -> [usize; 3] {
    let shape = var.shape();
    var.tape().check(op, |shapes| {
        if shape.len() == 2 {
            shapes.axes(name, &shape, ["P", "D"]).map(|[p, d]| [1, p, d])
        } else {
            shapes.axes(name, &shape, ["N", "P", "D"])
        }
    })
}

/// N, P, Q and D.
#[track_caller]
fn sets<F: Real>(op: &'static str, x: Var<'_, F>, y: Var<'_, F>) -> [usize; 4] {
    let ([n, p, width], [m, q, other]) = (rows(op, "x", x), rows(op, "y", y));
    if n != m || width != other || x.rank() != y.rank() {
        let message = "two sets of points of the same coordinates, or as many of the one as of the other, expected";
        let operands = [("x", &x.shape()[..], "N, P, D"), ("y", &y.shape(), "N, Q, D")];
        x.tape().refuse(op, message, &operands);
    }
    [n, p, q, width]
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use autodiff_lite::testkit::{Options, gradcheck};

    use super::*;

    fn distances<'t>(x: Var<'t, f64>, y: Var<'t, f64>, k: usize, norm: Norm) -> Var<'t, f64> {
        let mut near = Neighbors::default();
        near.find(x, y, k, norm);
        knn_distances(x, y, &near)
    }

    fn pieces() -> Options {
        Options::default().pieces()
    }

    gradcheck!(squared: |x, y| distances(x, y, 3, Norm::L2),
        shapes [[[5, 3], [7, 3]], [[2, 4, 3], [2, 3, 3]], [[3, 5], [6, 5]]], options pieces());
    gradcheck!(sums_of_differences: |x, y| distances(x, y, 2, Norm::L1),
        shapes [[[5, 3], [7, 3]], [[2, 4, 3], [2, 3, 3]]], options pieces());
    gradcheck!(gathered: |x, y, z| knn_gather(z, &knn_points(x, y, 2).1),
        shapes [[[4, 3], [5, 3], [5, 2]], [[2, 3, 3], [2, 4, 3], [2, 4, 1]]], options pieces());

    #[test]
    fn nothing_is_near_nothing() {
        let tape = Tape::<f32>::train(0);
        let none = tape.leaf(ndarray::Array2::zeros((0, 3)));
        let (distances, near) = knn_points(none, none, 2);
        assert_eq!((distances.shape(), near.indices().len()), (vec![0, 2], 0));
        assert_eq!(knn_gather(none, &near).shape(), [0, 2, 3]);
    }

    #[test]
    #[should_panic(expected = "knn: 3 neighbours of 2 points")]
    fn fewer_points_than_neighbors() {
        let tape = Tape::<f32>::eval();
        let x = tape.constant(ndarray::Array2::zeros((2, 3)));
        let _ = knn_points(x, x, 3);
    }
}
