//! A network over points that knows what they belong to.

use autodiff_lite::{Activation, Module, Real, Var, Visitor, VisitorMut, join_path};

use crate::{Dropout, Init, Linear, WeightNormLinear};

/// What each point of a set becomes, given the point and a code for the whole set: `[code, point]`
/// through linear layers under weight norm, one of which sees `[code, point]` again.
///
/// ```text
/// u = [code, point]      h = relu(lin0 u), relu(lin1 h), relu(lin2 [h, u]), relu(lin3 h)      tanh(lin4 h)
/// ```
///
/// Dropout follows each ReLU. The result does not depend on how many points there are, so a mesh may
/// be subdivided under it. What the code contributes to a layer is computed once for each set rather
/// than for each point.
///
/// ```
/// use autodiff_lite::Tape;
/// use nets::{Init, PointMlp, PointMlpConfig};
///
/// let config = PointMlpConfig { hidden: vec![16; 4], ..PointMlpConfig::published(10) };
/// let mlp = PointMlp::<f32>::new(&Init::new(0), &config);
/// let tape = Tape::eval();
/// let (code, points) = (ndarray::Array2::zeros((2, 10)), ndarray::Array3::zeros((2, 42, 3)));
/// let offsets = mlp.forward(tape.constant(code), tape.constant(points));
/// assert_eq!(offsets.shape(), [2, 42, 3]);
/// ```
///
/// # References
/// Park et al. 2019, *DeepSDF*, as changed by Simoni et al. 2021, *Multi-Category Mesh Reconstruction
/// From Image Collections*, section 3.1; names as in their `Decoder`.
#[derive(Clone, Debug)]
pub struct PointMlp<F: Real = f32> {
    /// `lin0`, `lin1`, ..
    pub hidden: Vec<WeightNormLinear<F>>,
    /// The last `lin`, without weight norm.
    pub last: Linear<F>,
    /// Which hidden layer sees code and point again.
    pub skip: Option<usize>,
    /// After each ReLU, while training.
    pub dropout: Dropout,
    /// After the last layer.
    pub activation: Activation,
}

/// Sizes of a [`PointMlp`].
#[derive(Clone, Debug, PartialEq)]
pub struct PointMlpConfig {
    /// Numbers in the code.
    pub code: usize,
    /// Coordinates of a point.
    pub point: usize,
    /// Numbers that a point becomes.
    pub outputs: usize,
    /// Widths of the hidden layers.
    pub hidden: Vec<usize>,
    /// Which of them sees code and point again; not the first.
    pub skip: Option<usize>,
    /// Share of the hidden numbers that training drops.
    pub dropout: f64,
    /// After the last layer.
    pub activation: Activation,
}

impl PointMlpConfig {
    /// MCMR's: four layers of 512, the third of which sees the input again, dropout 0.2, `tanh`.
    pub fn published(code: usize) -> Self {
        Self {
            code,
            point: 3,
            outputs: 3,
            hidden: vec![512; 4],
            skip: Some(2),
            dropout: 0.2,
            activation: Activation::Tanh,
        }
    }
}

impl<F: Real> Module<F> for PointMlp<F> {
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<F>) {
        for (i, layer) in self.hidden.iter().enumerate() {
            layer.visit(&join_path(path, &format!("lin{i}")), visitor);
        }
        self.last.visit(&join_path(path, &format!("lin{}", self.hidden.len())), visitor);
    }

    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<F>) {
        let count = self.hidden.len();
        for (i, layer) in self.hidden.iter_mut().enumerate() {
            layer.visit_mut(&join_path(path, &format!("lin{i}")), visitor);
        }
        self.last.visit_mut(&join_path(path, &format!("lin{count}")), visitor);
    }
}

impl<F: Real> PointMlp<F> {
    /// With PyTorch's default initial values.
    ///
    /// # Panics
    /// If there is no hidden layer, or none after the first is the one that sees the input again.
    #[track_caller]
    pub fn new(init: &Init, config: &PointMlpConfig) -> Self {
        assert!(!config.hidden.is_empty(), "PointMlp: no hidden layer");
        let known = config.skip.is_none_or(|skip| (1..config.hidden.len()).contains(&skip));
        assert!(known, "PointMlp: no hidden layer after the first is {:?}", config.skip);
        let first = config.code + config.point;
        let mut inputs = 0;
        let layer = |(i, &width): (usize, &usize)| {
            let all = if i == 0 || config.skip == Some(i) { inputs + first } else { inputs };
            inputs = width;
            WeightNormLinear::new(&init.at(&format!("lin{i}")), all, width)
        };
        let hidden: Vec<_> = config.hidden.iter().enumerate().map(layer).collect();
        let at = init.at(&format!("lin{}", hidden.len()));
        Self {
            last: Linear::new(&at, inputs, config.outputs),
            hidden,
            skip: config.skip,
            dropout: Dropout::new(config.dropout),
            activation: config.activation,
        }
    }

    /// What points become under a code.
    ///
    /// # Shapes
    /// `code [N, D]`, `points [N, V, P]` → `[N, V, outputs]`.
    #[track_caller]
    pub fn forward<'t>(&self, code: Var<'t, F>, points: Var<'t, F>) -> Var<'t, F> {
        code.tape().check("PointMlp", |shapes| {
            shapes.axes("code", &code.shape(), ["N", "D"])?;
            shapes.axes("points", &points.shape(), ["N", "V", "P"])
        });
        let (first, others) = self.hidden.split_first().expect("`new` wants a hidden layer");
        let mut h = self.dropout.forward(conditioned(first, None, code, points));
        for (i, layer) in others.iter().enumerate() {
            let y = if self.skip == Some(i + 1) {
                conditioned(layer, Some(h), code, points)
            } else {
                layer.forward_then(h, Activation::Relu)
            };
            h = self.dropout.forward(y);
        }
        self.last.forward_then(h, self.activation)
    }
}

/// `relu(W [h, code, point] + b)`, the part of the code once for each set of points.
#[track_caller]
fn conditioned<'t, F: Real>(
    layer: &WeightNormLinear<F>,
    h: Option<Var<'t, F>>,
    code: Var<'t, F>,
    points: Var<'t, F>,
) -> Var<'t, F> {
    let weight = layer.weight(points);
    let [[n, d], [_, all]] = [code.dims(), weight.dims()];
    let before = h.map_or(0, |h| h.shape()[2]);
    let part = |range: std::ops::Range<usize>| weight.slice_axis(1, range);
    let bias = layer.bias.as_ref().map(|bias| points.tape().param(bias));
    let of_code = code.linear(part(before..before + d), bias, Activation::None);
    let of_points = points.linear(part(before + d..all), None, Activation::None);
    let sum = match h {
        Some(h) => h.linear(part(0..before), None, Activation::None).add(of_points),
        None => of_points,
    };
    let width = of_code.shape()[1];
    let step = |x: F| if x > F::zero() { F::one() } else { F::zero() };
    sum.zip(
        of_code.reshape(&[n, 1, width]),
        |a, b| if a + b <= F::zero() { F::zero() } else { a + b },
        move |_, _, y| (step(y), step(y)),
    )
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use autodiff_lite::Tape;
    use autodiff_lite::testkit::{Options, check, function};
    use ndarray::{Array2, Array3};

    use super::*;

    fn small() -> PointMlpConfig {
        PointMlpConfig { hidden: vec![6, 5, 7, 4], ..PointMlpConfig::published(4) }
    }

    /// The definition: everything beside every point.
    fn plain<'t>(mlp: &PointMlp<f64>, code: Var<'t, f64>, points: Var<'t, f64>) -> Var<'t, f64> {
        let [n, v, _] = points.dims();
        let ones = code.tape().constant(Array3::ones((n, v, 1)));
        let code = code.insert_axis(1).mul(ones);
        let input = code.tape().concat(&[code, points], 2);
        let mut x = input;
        for (i, layer) in mlp.hidden.iter().enumerate() {
            if mlp.skip == Some(i) {
                x = x.tape().concat(&[x, input], 2);
            }
            x = layer.forward(x).relu();
        }
        mlp.last.forward(x).tanh()
    }

    #[test]
    fn sharing_the_code_changes_rounding_alone() {
        let mlp = PointMlp::<f64>::new(&Init::new(3), &small());
        let tape = Tape::eval();
        let code = Array2::from_shape_fn((2, 4), |(i, j)| ((3 * i + j) as f64).sin());
        let points =
            Array3::from_shape_fn((2, 5, 3), |(n, v, k)| ((n + 2 * v + 5 * k) as f64).cos());
        let (code, points) = (tape.constant(code), tape.constant(points));
        let (found, expected) = (mlp.forward(code, points), plain(&mlp, code, points));
        for (a, b) in found.value().iter().zip(&expected.value()) {
            assert!((a - b).abs() < 1e-14, "{a} and {b}");
        }
    }

    #[test]
    fn gradients_reach_code_and_points() {
        let config = PointMlpConfig { dropout: 0.0, ..small() };
        let mlp = PointMlp::<f64>::new(&Init::new(3), &config);
        let f = function(|v| mlp.forward(v[0], v[1]));
        let options = Options::default().pieces();
        check(&f, &options.draw(&[vec![2, 4], vec![2, 5, 3]]), &options).unwrap();
        let tape = Tape::train(0);
        let [code, points] = [tape.leaf(Array2::ones((1, 4))), tape.leaf(Array2::ones((9, 3)))];
        let loss = mlp.forward(code, points.reshape(&[1, 9, 3])).sum();
        let gradients = loss.backward();
        mlp.visit("", &mut |path: &str, param: &autodiff_lite::Param<f64>| {
            assert!(gradients.of(param).is_some(), "{path}");
        });
    }

    #[test]
    fn names_and_sizes_are_the_published_ones() {
        let mlp = PointMlp::<f32>::new(&Init::new(0), &PointMlpConfig::published(258));
        let mut found = Vec::new();
        mlp.visit("decoder", &mut |path: &str, p: &autodiff_lite::Param| {
            if path.ends_with('v') || path.ends_with("weight") {
                found.push((path.to_owned(), p.shape()[1]));
            }
        });
        let expected = [261, 512, 512 + 261, 512].into_iter().enumerate();
        let mut expected: Vec<_> =
            expected.map(|(i, n)| (format!("decoder.lin{i}.weight_v"), n)).collect();
        expected.push(("decoder.lin4.weight".to_owned(), 512));
        assert_eq!(found, expected);
    }
}
