//! The mean shapes: spheres at first.

use autodiff_lite::Param;
use mesh_core::{Subdivision, Topology, primitives};
use ndarray::Array3;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::config::McmrConfig;

/// Where the optimiser keeps what it knows of the mean shapes.
pub(super) const PATH: &str = "shapes";

/// The faces that all mean shapes share, and where each vertex lies on the sphere that they were.
#[derive(Debug)]
pub(super) struct Template {
    /// Unit vectors, and after a subdivision points between them: the surface of the first sphere's faces, so
    /// that the texture stays where it is.
    pub(super) sphere: Vec<[f32; 3]>,
    pub(super) corners: Vec<[u32; 3]>,
    pub(super) topology: Topology,
}

impl Template {
    /// An icosphere.
    pub(super) fn new(level: u32) -> Self {
        let sphere = primitives::icosphere(level);
        Self::of(sphere.positions, sphere.faces)
    }

    fn of(sphere: Vec<[f32; 3]>, corners: Vec<[u32; 3]>) -> Self {
        let topology = Topology::new(sphere.len(), &corners);
        Self { sphere, corners, topology }
    }

    /// Each face in four, and how values of the vertices go there.
    pub(super) fn subdivided(&self) -> (Self, Split) {
        let split = Subdivision::of(self.sphere.len(), &self.corners);
        let finer = Self::of(split.apply(&self.sphere), split.faces.clone());
        (finer, Split(split))
    }
}

/// From the vertices of shapes to those of their subdivisions.
#[derive(Debug)]
pub(super) struct Split(Subdivision);

impl Split {
    /// Values `[N, V, 3]` of vertices; a new one, in the middle of an edge, gets the mean of its ends'. So do its
    /// moments: they are what they would be, had the ends always had the same gradients.
    pub(super) fn finer(&self, values: &[f32]) -> Vec<f32> {
        let shapes = values.chunks_exact(3 * self.0.old_vertices);
        shapes.flat_map(|shape| self.0.apply_rows(shape, 3)).collect()
    }

    /// The shapes themselves.
    pub(super) fn shapes(&self, shapes: &Param) -> Param {
        let size = (shapes.shape()[0], self.0.vertex_count(), 3);
        let values = Array3::from_shape_vec(size, self.finer(shapes.as_slice()));
        Param::new(values.expect("three numbers for each vertex of each shape"))
    }
}

/// The first mean shapes, `[N, V, 3]`: spheres, each stretched along the axes by numbers of its own if the
/// configuration asks for it. They stay symmetric in x.
pub(super) fn first(config: &McmrConfig, seed: u64, template: &Template) -> Param {
    let vertices = template.sphere.len();
    let mut values = Vec::with_capacity(config.shapes * vertices * 3);
    for shape in 0..config.shapes {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        rng.set_stream((1 << 33) + shape as u64);
        let stretch = [(); 3]
            .map(|()| config.radius * (1.0 + config.perturb * (2.0 * rng.random::<f64>() - 1.0)));
        for p in &template.sphere {
            values.extend((0..3).map(|k| (stretch[k] * f64::from(p[k])) as f32));
        }
    }
    let values = Array3::from_shape_vec((config.shapes, vertices, 3), values);
    Param::new(values.expect("three numbers for each vertex of each shape"))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::vector::norm;

    use super::*;

    #[test]
    fn spheres_are_equal_or_not() {
        let template = Template::new(1);
        let equal = McmrConfig { shapes: 2, level: 1, ..McmrConfig::default() };
        let shapes = first(&equal, 3, &template);
        let (a, b) = shapes.as_slice().split_at(42 * 3);
        assert_eq!(a, b);
        let lengths = a.as_chunks::<3>().0.iter().map(|&p| norm(p));
        assert!({ lengths }.all(|r| (r - 0.25).abs() < 1e-6));
        let differ = first(&McmrConfig { perturb: 0.3, ..equal.clone() }, 3, &template);
        let (c, d) = differ.as_slice().split_at(42 * 3);
        assert_ne!(c, d);
        // The first does not depend on how many there are.
        let one = first(&McmrConfig { perturb: 0.3, shapes: 1, ..equal }, 3, &template);
        assert_eq!(one.as_slice(), c);
    }
}
