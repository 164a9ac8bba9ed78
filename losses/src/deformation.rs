//! Deformation size: vertices should not move further than they must.

use autodiff_lite::{Real, Var};

use crate::kernels::vec3::{dot, points, points_mut, scale};
use crate::scalar::{record, vertices, wanted};

/// The mean length of the offsets, `(1/(N V)) Σ ‖Δv‖`.
///
/// # Shapes
/// `offsets [V, 3]` or `[N, V, 3]` → a scalar, in the units of the offsets.
/// # Gradient
/// Zero at an offset of zero.
/// # Panics
/// If the shape is another.
/// # References
/// Simoni et al. 2021, *Multi-Category Mesh Reconstruction From Image Collections* (deformation loss).
#[track_caller]
pub fn deformation_norm<F: Real>(offsets: Var<'_, F>) -> Var<'_, F> {
    let [n, v] = vertices("deformation_norm", "offsets", offsets);
    let count = (n * v).max(1) as f64;
    let weight = F::from_f64(1.0 / count);
    let value = offsets.value();
    let value = value.as_slice();
    let mut gradient = wanted(offsets);
    let mut total = 0.0;
    for (i, &d) in points(value).iter().enumerate() {
        let length = dot(d, d).sqrt();
        total += Real::to_f64(length);
        if let Some(gradient) = &mut gradient
            && length > F::zero()
        {
            points_mut(gradient)[i] = scale(d, weight / length);
        }
    }
    record("deformation_norm", [offsets], total / count, [gradient])
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use autodiff_lite::testkit::gradcheck;

    use super::*;

    gradcheck!(gradients: |x| deformation_norm(x), shapes [[[5, 3]], [[2, 4, 3]], [[1, 3]]]);

    #[test]
    fn by_hand() {
        let tape = autodiff_lite::Tape::<f64>::train(0);
        let x = tape.leaf(ndarray::arr2(&[[3.0, 4.0, 0.0], [0.0, 0.0, 0.0]]));
        let loss = deformation_norm(x);
        assert_relative_eq!(loss.item(), 2.5);
        let gradients = loss.backward();
        let gradient = gradients.wrt(x).expect("a leaf");
        for (&g, expected) in gradient.iter().zip([0.3, 0.4, 0.0, 0.0, 0.0, 0.0]) {
            assert_relative_eq!(g, expected, epsilon = 1e-15);
        }
    }
}
