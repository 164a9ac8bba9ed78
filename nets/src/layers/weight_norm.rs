//! Weight norm: the length of each row of a weight apart from its direction.

use autodiff_lite::{Activation, Backward, Param, Real, ShapeError, Tensor, Var, impl_module};

use crate::Init;

/// A linear layer whose weight is kept as length and direction, as `torch.nn.utils.weight_norm` of
/// `torch.nn.Linear`:
///
/// ```text
/// W[o] = g[o] v[o] / ‖v[o]‖        y = W x + b
/// ```
///
/// ```
/// use autodiff_lite::Tape;
/// use nets::{Init, WeightNormLinear};
///
/// let layer = WeightNormLinear::<f32>::new(&Init::new(0).at("lin0"), 8, 3);
/// let tape = Tape::eval();
/// let y = layer.forward(tape.constant(ndarray::Array2::zeros((5, 8))));
/// assert_eq!(y.shape(), [5, 3]);
/// ```
///
/// # References
/// Salimans and Kingma 2016, *Weight normalization*, equation 2.
#[derive(Clone, Debug)]
pub struct WeightNormLinear<F: Real = f32> {
    /// Lengths `g`, `[out, 1]`.
    pub weight_g: Param<F>,
    /// Directions `v`, `[out, in]`, of any length but zero.
    pub weight_v: Param<F>,
    /// `[out]`.
    pub bias: Option<Param<F>>,
}
impl_module!(WeightNormLinear { weight_g, weight_v, bias });

impl<F: Real> WeightNormLinear<F> {
    /// PyTorch's initial values: those of a linear layer, and their lengths.
    pub fn new(init: &Init, inputs: usize, outputs: usize) -> Self {
        let shape = [outputs, inputs];
        // Under the name that the weight has without the norm.
        let v: Param<F> = init.at("weight").layer_weight(&shape);
        let lengths = v.as_slice().chunks(inputs.max(1)).map(|row| squares(row).sqrt()).collect();
        let g = ndarray::Array2::from_shape_vec((outputs, 1), lengths).expect("a row each");
        Self {
            weight_g: Param::new(g),
            weight_v: v,
            bias: Some(init.at("bias").layer_bias(outputs, &shape)),
        }
    }

    /// The weight, on the tape of `like`.
    ///
    /// # Shapes
    /// `like`: any → `[out, in]`.
    #[track_caller]
    pub fn weight<'t>(&self, like: Var<'t, F>) -> Var<'t, F> {
        let tape = like.tape();
        weight_norm(tape.param(&self.weight_v), tape.param(&self.weight_g))
    }

    forward! {
        /// [`Var::linear`] with the weight that direction and length make.
        ///
        /// # Shapes
        /// `x [.., in]` → `[.., out]`.
        |self, x, activation| {
            let bias = self.bias.as_ref().map(|bias| x.tape().param(bias));
            x.linear(self.weight(x), bias, activation)
        }
    }
}

/// `g v / ‖v‖`, row by row of the first axis: PyTorch's `weight_norm` with `dim=0`, for convolutions as well as for
/// linear layers.
///
/// A row of zeros, which has no direction, gives zeros and gets no gradient (PyTorch: NaN).
///
/// # Shapes
/// `v [O, ..]`, `g` of `O` elements in any axes → `[O, ..]`.
///
/// # Panics
/// If `g` has another number of elements than `v` rows.
#[track_caller]
pub fn weight_norm<'t, F: Real>(v: Var<'t, F>, g: Var<'t, F>) -> Var<'t, F> {
    let tape = v.tape();
    let (direction, length) = (v.value(), g.value());
    let rows = direction.shape().first().copied().unwrap_or(0);
    if length.len() != rows {
        ShapeError::new("weight_norm", "one length for each row expected")
            .operand("v", direction.shape(), "O, ..")
            .operand("g", length.shape(), "O, 1..")
            .at(tape.path())
            .panic();
    }
    let mut y = tape.array(direction.shape());
    let width = direction.len().checked_div(rows).unwrap_or(0).max(1);
    let (d, l) = (direction.as_slice(), length.as_slice());
    let out = y.as_slice_mut().chunks_mut(width);
    for ((out, row), &g) in out.zip(d.chunks(width)).zip(l) {
        let factor = g * inverse_length(row);
        out.iter_mut().zip(row).for_each(|(out, &v)| *out = factor * v);
    }
    tape.record_fn("weight_norm", &[v, g], y, move |cx: &mut Backward<'_, F>| {
        let (v, g, grad) = (cx.input(0), cx.input(1), cx.grad_out());
        let [v, g, grad] = [&v, &g, &grad].map(Tensor::as_slice);
        let rows = v.chunks(width).zip(grad.chunks(width));
        if cx.needs(0) {
            let of_v = cx.grad_slice_mut(0).chunks_mut(width);
            for (((v, grad), &g), of_v) in rows.clone().zip(g).zip(of_v) {
                // (g / ‖v‖) (s - u (u · s)) with u = v / ‖v‖.
                let inverse = inverse_length(v);
                let factor = g * inverse;
                let along = product(v, grad) * inverse * inverse;
                for ((of_v, &v), &grad) in of_v.iter_mut().zip(v).zip(grad) {
                    *of_v += factor * (grad - v * along);
                }
            }
        }
        if cx.needs(1) {
            for ((v, grad), of_g) in rows.zip(cx.grad_slice_mut(1)) {
                *of_g += product(v, grad) * inverse_length(v);
            }
        }
    })
}

fn inverse_length<F: Real>(row: &[F]) -> F {
    let length = squares(row).sqrt();
    if length > F::zero() { F::one() / length } else { F::zero() }
}

fn squares<F: Real>(row: &[F]) -> F {
    product(row, row)
}

/// `a · b` in eight sums, so that the loop vectorises.
fn product<F: Real>(a: &[F], b: &[F]) -> F {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<8>(), b.as_chunks::<8>());
    let mut lanes = [F::zero(); 8];
    for (a, b) in a.iter().zip(b) {
        for k in 0..8 {
            lanes[k] += a[k] * b[k];
        }
    }
    let rest = a_rest.iter().zip(b_rest).fold(F::zero(), |sum, (&a, &b)| sum + a * b);
    lanes.into_iter().fold(rest, |sum, lane| sum + lane)
}

#[cfg(test)]
mod tests {
    use autodiff_lite::testkit::gradcheck;
    use autodiff_lite::{Module, Tape};
    use ndarray::{Array2, arr2};

    use super::*;

    gradcheck!(rule: |v, g| weight_norm(v, g),
        shapes [[[3, 5], [3, 1]], [[2, 3, 2, 2], [2, 1, 1, 1]], [[1, 1], [1]], [[4, 19], [4, 1]]]);

    #[test]
    fn lengths_and_directions_are_apart() {
        let mut layer = WeightNormLinear::<f64>::new(&Init::new(0), 2, 2);
        layer.weight_v = Param::new(arr2(&[[3.0, 4.0], [0.0, 0.0]]));
        layer.weight_g = Param::new(arr2(&[[10.0], [7.0]]));
        layer.bias = None;
        let tape = Tape::train(0);
        let y = layer.forward(tape.constant(arr2(&[[1.0, 2.0]])));
        assert_eq!(y.value().as_slice(), [22.0, 0.0]);
        assert!(y.sum().backward().is_finite());
    }

    #[test]
    fn it_begins_as_the_layer_without() {
        let init = Init::new(5).at("lin0");
        let (plain, normed) =
            (crate::Linear::<f64>::new(&init, 7, 4), WeightNormLinear::<f64>::new(&init, 7, 4));
        let tape = Tape::eval();
        let x = tape.constant(Array2::from_shape_fn((3, 7), |(i, j)| (i as f64 - j as f64).sin()));
        for (a, b) in plain.forward(x).value().iter().zip(&normed.forward(x).value()) {
            assert!((a - b).abs() < 1e-14);
        }
        let mut paths = Vec::new();
        normed.visit("lin0", &mut |path: &str, _: &_| paths.push(path.to_owned()));
        assert_eq!(paths, ["lin0.weight_g", "lin0.weight_v", "lin0.bias"]);
    }
}
