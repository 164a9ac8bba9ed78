//! What LPIPS knows beside its network.

use autodiff_lite::{Param, Real, Var, impl_module};

use crate::Init;

/// How much each channel of VGG16's maps counts in a perceptual distance: the learned weights of LPIPS,
/// under the names of its files (`lin0.model.1.weight` to `lin4..`, `[1, C, 1, 1]` each).
///
/// They belong to the maps of [`Vgg16::forward_before_pools`](crate::Vgg16::forward_before_pools), for
/// images that [`LpipsWeights::normalized`] has scaled.
///
/// # References
/// Zhang et al. 2018, *The unreasonable effectiveness of deep features as a perceptual metric*,
/// version 0.1 of its code.
#[derive(Clone, Debug)]
pub struct LpipsWeights<F: Real = f32> {
    /// `[1, C, 1, 1]` for each map; never trained here.
    pub lin: [Param<F>; 5],
}

impl_module!(LpipsWeights lists { lin: name } {});

fn name(i: usize) -> String {
    format!("lin{i}.model.1.weight")
}

impl<F: Real> LpipsWeights<F> {
    /// Channels of VGG16's maps before its pools.
    pub const CHANNELS: [usize; 5] = [64, 128, 256, 512, 512];

    /// Every channel alike, `1 / C`, until a file is loaded.
    pub fn uniform() -> Self {
        let lin = |c: usize| {
            Param::buffer(Init::new(0).constant::<F>(&[1, c, 1, 1], 1.0 / c as f64).value)
        };
        Self { lin: Self::CHANNELS.map(lin) }
    }

    /// The weights `[C]` of each map.
    pub fn vectors(&self) -> [&[F]; 5] {
        [0, 1, 2, 3, 4].map(|i| self.lin[i].as_slice())
    }

    /// Images as LPIPS gives them to VGG16. (MCMR's code gives it images in `[0, 1]` instead; for those of `[0, 1]` pass
    /// `2 x - 1`.)
    ///
    /// # Shapes
    /// `images [N, H, W, 3]` in `[-1, 1]` → `[N, H, W, 3]`.
    #[track_caller]
    pub fn normalized(images: Var<'_, F>) -> Var<'_, F> {
        let tape = images.tape();
        let row = |v: [f64; 3]| tape.constant(ndarray::Array1::from_iter(v.map(F::from_f64)));
        images.sub(row([-0.030, -0.088, -0.188])).div(row([0.458, 0.448, 0.450]))
    }
}

#[cfg(test)]
mod tests {
    use autodiff_lite::{Module, Tape};
    use ndarray::Array4;

    use super::*;

    #[test]
    fn names_and_scaling_are_those_of_lpips() {
        let weights = LpipsWeights::<f64>::uniform();
        let mut found = Vec::new();
        weights.visit("", &mut |path: &str, p: &Param<f64>| {
            found.push((path.to_owned(), p.shape().to_vec(), p.trainable));
        });
        assert_eq!(found[2], ("lin2.model.1.weight".to_owned(), vec![1, 256, 1, 1], false));
        assert_eq!(found.len(), 5);
        let tape = Tape::<f64>::eval();
        let image = Array4::from_shape_fn((1, 1, 1, 3), |(_, _, _, c)| [-0.03, 0.36, 0.262][c]);
        let y = LpipsWeights::normalized(tape.constant(image)).value();
        for (y, expected) in y.iter().zip([0.0, 1.0, 1.0]) {
            assert!((y - expected).abs() < 1e-12);
        }
    }
}
