//! Meshes and cameras as arrays of ndarray, and back (feature `ndarray`): what a tape takes.

use ndarray::{Array2, Array3, ArrayView2};

use crate::{Camera, Scalar, TriMesh};

impl TriMesh {
    /// The positions as an array, in either precision: `tape.leaf(mesh.vertices())`.
    ///
    /// ```
    /// use mesh_core::primitives::icosphere;
    /// let vertices: ndarray::Array2<f64> = icosphere(2).vertices();
    /// assert_eq!(vertices.dim(), (162, 3));
    /// ```
    ///
    /// # Shapes
    /// `[V, 3]`, in the mesh's units.
    pub fn vertices<T: Scalar>(&self) -> Array2<T> {
        Array2::from_shape_fn((self.positions.len(), 3), |(vertex, axis)| {
            T::narrowed(f64::from(self.positions[vertex][axis]))
        })
    }

    /// Moves the vertices to the rows of an array: what [`vertices`](Self::vertices) gave, moved.
    ///
    /// Coordinates are rounded to `f32`.
    ///
    /// # Shapes
    /// `vertices [V, 3]`, in the mesh's units.
    ///
    /// # Panics
    /// If the array has another shape.
    #[allow(clippy::needless_pass_by_value, reason = "views are passed like slices")]
    pub fn set_vertices<T: Scalar>(&mut self, vertices: ArrayView2<'_, T>) {
        let expected = (self.positions.len(), 3);
        assert_eq!(vertices.dim(), expected, "TriMesh::set_vertices: [V, 3] expected");
        for (position, row) in self.positions.iter_mut().zip(vertices.outer_iter()) {
            *position = [0, 1, 2].map(|axis| row[axis].widened() as f32);
        }
    }
}

impl Camera {
    /// The [projections](Self::projection) of cameras as an array: what positions on a tape are projected by.
    ///
    /// ```
    /// use mesh_core::Camera;
    /// let camera = Camera::look_at([0.0, 0.0, 5.0], [0.0; 3], [0.0, 1.0, 0.0], 0.8, 64, 48);
    /// let matrices: ndarray::Array3<f32> = Camera::matrices(&[camera]);
    /// assert_eq!(matrices.dim(), (1, 3, 4));
    /// assert_eq!(matrices[[0, 2, 3]], 5.0); // the depth of the origin
    /// ```
    ///
    /// # Shapes
    /// N cameras → `[N, 3, 4]`: rows X, Y and W, each to be applied to `(x, y, z, 1)` of a point of the world. W is planar depth; NDC
    /// are `(X/W, Y/W)`, of an orthographic camera `(X, Y)`.
    pub fn matrices<T: Scalar>(cameras: &[Self]) -> Array3<T> {
        let rows: Vec<_> = cameras.iter().map(Self::projection).collect();
        Array3::from_shape_fn((cameras.len(), 3, 4), |(camera, row, column)| {
            T::narrowed(rows[camera][row][column])
        })
    }
}

#[cfg(test)]
mod tests {
    use crate::{Camera, primitives};
    use ndarray::{Array2, Array3};

    #[test]
    fn a_mesh_goes_and_comes_back() {
        let mut mesh = primitives::torus(1.0, 0.3, 7, 5);
        let before = mesh.positions.clone();
        let vertices: Array2<f64> = mesh.vertices();
        assert_eq!(vertices[[4, 2]], f64::from(before[4][2]));
        mesh.set_vertices((&vertices * 2.0).view());
        assert_eq!(mesh.positions[4][2], 2.0 * before[4][2]);
        mesh.set_vertices(vertices.view());
        assert_eq!(mesh.positions, before);
    }

    #[test]
    #[should_panic(expected = "[V, 3] expected")]
    fn another_number_of_vertices_is_refused() {
        primitives::icosphere(0).set_vertices(Array2::<f32>::zeros((11, 3)).view());
    }

    /// A point through the matrix lands where the camera puts it.
    #[test]
    fn matrices_project_as_the_camera_does() {
        let cameras = [0.3, 1.1]
            .map(|x| Camera::look_at([x, 0.4, 3.0], [0.1, 0.0, 0.0], [0.0, 1.0, 0.0], 0.7, 64, 48));
        let matrices: Array3<f64> = Camera::matrices(&cameras);
        let point = [0.2, -0.3, 0.5, 1.0];
        for (n, camera) in cameras.iter().enumerate() {
            let [x, y, w] =
                [0, 1, 2].map(|row| (0..4).map(|k| matrices[[n, row, k]] * point[k]).sum::<f64>());
            let seen = camera.project([0.2, -0.3, 0.5]);
            assert!((32.0 * (x / w + 1.0) - seen.column).abs() < 1e-12);
            assert!((24.0 * (1.0 - y / w) - seen.row).abs() < 1e-12);
            assert!((w - seen.depth).abs() < 1e-12);
        }
    }
}
