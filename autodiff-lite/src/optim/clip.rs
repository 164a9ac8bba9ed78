//! Limits on gradients.

use crate::{Gradients, Real};

/// Scales all gradients so that their common Euclidean norm is at most `limit`, and returns what
/// it was. As `torch.nn.utils.clip_grad_norm_`: the factor is `limit / (norm + 1e-6)`.
///
/// A norm that is not finite scales by NaN or zero: check what is returned.
pub fn clip_grad_norm<F: Real>(gradients: &mut Gradients<F>, limit: f64) -> f64 {
    let norm = gradients.norm();
    let factor = limit / (norm + 1e-6);
    if factor < 1.0 || factor.is_nan() {
        gradients.scale(F::from_f64(factor));
    }
    norm
}

/// Limits each entry of each gradient to `[-limit, limit]`. NaN stays NaN.
pub fn clip_value<F: Real>(gradients: &mut Gradients<F>, limit: f64) {
    let limit = F::from_f64(limit);
    for gradient in gradients.slices_mut() {
        for g in gradient {
            if *g > limit {
                *g = limit;
            } else if *g < -limit {
                *g = -limit;
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use ndarray::arr1;

    use super::*;
    use crate::{Param, Tape};

    #[test]
    fn norm_and_value() {
        let p = Param::<f64>::new(arr1(&[3.0, -4.0]));
        let tape = Tape::train(0);
        let mut gradients = tape.param(&p).square().scale(0.5).sum().backward();
        assert_eq!(clip_grad_norm(&mut gradients, 10.0), 5.0);
        assert_eq!(gradients.slice_of(&p), Some(&[3.0, -4.0][..]));
        assert_eq!(clip_grad_norm(&mut gradients, 1.0), 5.0);
        assert!((gradients.norm() - 5.0 / (5.0 + 1e-6)).abs() < 1e-12);
        clip_value(&mut gradients, 0.7);
        let clipped = gradients.slice_of(&p).unwrap();
        assert!((clipped[0] - 0.6).abs() < 1e-6 && clipped[1] == -0.7);
    }
}
