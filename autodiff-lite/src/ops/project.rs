//! Points through cameras.

use crate::kernels::project::{self, Projection};
use crate::{Backward, Real, Tensor, Var};

impl<F: Real> Var<'_, F> {
    /// Perspective projection of points to `(X/W, Y/W, W)`, where
    ///
    /// ```text
    /// (X, Y, W) = M (x, y, z, 1)
    /// ```
    ///
    /// Gradients to both. A point with `|W| < 1e-8`, or whose W is not finite, has no place in
    /// the image: it is put at `(0, 0, W)` and gets no gradient.
    ///
    /// # Shapes
    /// `self [N, V, 3]`, or `[1, V, 3]` or `[V, 3]`, shared by all cameras; `matrices [N, 3, 4]` → `[N, V, 3]`.
    ///
    /// # Panics
    /// If sizes differ.
    #[track_caller]
    #[inline(never)]
    pub fn project(self, matrices: Self) -> Self {
        self.project_by(matrices, Projection::Perspective)
    }

    /// Affine projection, for orthographic cameras: [`project`](Self::project) without the
    /// division, to `(X, Y, W)`.
    ///
    /// # Shapes
    /// As for [`project`](Self::project).
    ///
    /// # Panics
    /// If sizes differ.
    #[track_caller]
    #[inline(never)]
    pub fn project_affine(self, matrices: Self) -> Self {
        self.project_by(matrices, Projection::Affine)
    }

    #[track_caller]
    fn project_by(self, matrices: Self, projection: Projection) -> Self {
        let (points, m) = (self.value(), matrices.value());
        let [n, v] = self.tape.check("project", |shapes| {
            let [n, rows, columns] = shapes.axes("matrices", m.shape(), ["N", "_", "_"])?;
            if [rows, columns] != [3, 4] {
                return Err(shapes.error("matrices of 3 rows and 4 columns expected"));
            }
            let [v, three] = match *points.shape() {
                [v, three] | [1, v, three] => {
                    shapes.axes("points", &[v, three], ["V", "_"])?;
                    [v, three]
                }
                _ => {
                    let [_, v, three] = shapes.axes("points", points.shape(), ["N", "V", "_"])?;
                    [v, three]
                }
            };
            if three != 3 {
                return Err(shapes.error("points of 3 coordinates expected"));
            }
            Ok([n, v])
        });
        let mut y = self.tape.array(&[n, v, 3]);
        project::project(projection, [n, v], points.as_slice(), m.as_slice(), y.as_slice_mut());
        self.tape.record_fn("project", &[self, matrices], y, move |cx: &mut Backward<'_, F>| {
            let (points, m, g) = (cx.input(0), cx.input(1), cx.grad_out());
            let [points, m, g] = [&points, &m, &g].map(Tensor::as_slice);
            if cx.needs(0) {
                project::grad_points(projection, [n, v], points, m, g, cx.grad_slice_mut(0));
            }
            if cx.needs(1) {
                project::grad_matrices(projection, [n, v], points, m, g, cx.grad_slice_mut(1));
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::Tape;
    use crate::testkit::{Options, gradcheck};
    use ndarray::{arr2, arr3};

    // Far enough from W = 0: its row has a constant of at least 4.
    gradcheck!(perspective: |p, m| {
        let far = p.tape().constant(arr2(&[[0.0; 4], [0.0; 4], [0.0, 0.0, 0.0, 4.0]]));
        p.scale(0.4).project(m.scale(0.5).add(far))
    }, shapes [[[2, 5, 3], [2, 3, 4]], [[1, 4, 3], [3, 3, 4]], [[1, 3], [1, 3, 4]], [[4, 3], [2, 3, 4]]]);
    gradcheck!(affine: |p, m| p.project_affine(m), shapes [[[2, 5, 3], [2, 3, 4]], [[4, 3], [3, 3, 4]]],
        options Options::default());

    #[test]
    fn a_point_by_hand() {
        let tape = Tape::<f32>::eval();
        let m = tape.constant(arr3(&[[
            [2.0, 0.0, 0.0, 1.0],
            [0.0, 3.0, 0.0, 0.0],
            [0.0, 0.0, -1.0, 0.0],
        ]]));
        let p = tape.constant(arr2(&[[1.0, 2.0, -4.0]]));
        assert_eq!(p.project(m).value().as_slice(), [0.75, 1.5, 4.0]);
        assert_eq!(p.project_affine(m).value().as_slice(), [3.0, 6.0, 4.0]);
    }

    #[test]
    fn points_in_the_camera_plane_stay_finite_and_still() {
        let tape = Tape::<f32>::train(0);
        let m =
            tape.leaf(arr3(&[[[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]]]));
        let p = tape.leaf(arr2(&[[1.0, 2.0, 0.0], [1.0, 2.0, 1e-12], [1.0, 2.0, f32::INFINITY]]));
        let y = p.project(m);
        let value = y.value();
        assert!(value.iter().take(8).all(|x| x.is_finite()));
        let gradients = y.backward_with(ndarray::Array3::<f32>::ones((1, 3, 3)));
        assert_eq!(gradients.wrt(p).map(|g| g.iter().all(|&g| g == 0.0)), Some(true));
        assert_eq!(gradients.wrt(m).map(|g| g.iter().all(|g| g.is_finite())), Some(true));
    }
}
