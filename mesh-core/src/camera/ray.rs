//! Where rays go, and where several of them meet.

use nalgebra::{Matrix3, Vector3};

/// A half-line in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Ray {
    /// Where it starts.
    pub origin: [f64; 3],
    /// Where it goes; unit length.
    pub direction: [f64; 3],
}

/// How flat the rays may lie to each other: least over greatest eigenvalue of the normal equations.
const PARALLEL: f64 = 1e-4;

impl Ray {
    /// From a point to the line along the ray, in the world's units.
    pub fn distance(&self, point: [f64; 3]) -> f64 {
        let to = Vector3::from(point) - Vector3::from(self.origin);
        let along = Vector3::from(self.direction);
        (to - along * to.dot(&along)).norm()
    }

    /// The point nearest to all lines along rays: `Σ (I - d dᵀ) p = Σ (I - d dᵀ) o`. `None` where they are as good as
    /// parallel, so that no point is.
    ///
    /// ```
    /// use mesh_core::{Camera, Ray};
    ///
    /// let views = [[2.0, 0.0, 0.0], [0.0, 0.0, 3.0]]
    ///     .map(|eye| Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.8, 64, 64));
    /// let axes = views.iter().map(|camera| camera.ray(32.0, 32.0));
    /// let point = Ray::nearest_point(axes).unwrap();
    /// assert!(point.iter().all(|x| x.abs() < 1e-9));
    /// ```
    pub fn nearest_point(rays: impl IntoIterator<Item = Self>) -> Option<[f64; 3]> {
        let (mut normal, mut right) = (Matrix3::zeros(), Vector3::zeros());
        for ray in rays {
            let (origin, direction) = (Vector3::from(ray.origin), Vector3::from(ray.direction));
            let across = Matrix3::identity() - direction * direction.transpose();
            normal += across;
            right += across * origin;
        }
        solve(normal, right)
    }
}

// Not generic, so that nalgebra's eigenvalues and inverse are compiled here and not by every caller.
fn solve(normal: Matrix3<f64>, right: Vector3<f64>) -> Option<[f64; 3]> {
    let spread = normal.symmetric_eigenvalues();
    let point = normal.try_inverse()? * right;
    let fixed = spread.min() > PARALLEL * spread.max() && point.iter().all(|v| v.is_finite());
    fixed.then(|| point.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
        Ray { origin, direction }
    }

    #[test]
    fn skew_lines_are_met_half_way() {
        let lines = [ray([5.0, 0.0, 1.0], [1.0, 0.0, 0.0]), ray([0.0, -7.0, 3.0], [0.0, 1.0, 0.0])];
        let point = Ray::nearest_point(lines);
        assert!(point.is_some_and(|p| {
            p.iter().zip([0.0, 0.0, 2.0]).all(|(a, b)| (a - b).abs() < 1e-12)
        }));
        assert_eq!(lines.map(|line| line.distance([0.0, 0.0, 2.0])), [1.0; 2]);
    }

    #[test]
    fn parallel_lines_have_no_point() {
        let along = [0.6, 0.0, 0.8];
        let lines = [[0.0; 3], [1.0, 2.0, 0.0], [-1.0, 0.0, 4.0]].map(|o| ray(o, along));
        assert_eq!(Ray::nearest_point(lines), None);
        assert_eq!(Ray::nearest_point(lines[..1].iter().copied()), None);
        assert_eq!(Ray::nearest_point([]), None);
    }
}
