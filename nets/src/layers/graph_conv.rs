//! Graph convolutions in their published forms.

use autodiff_lite::{Activation, GraphWeights, Param, Real, SparseMatrix, Var, impl_module};

use crate::{Init, Linear};

/// A vertex and the sum of its neighbours: `y_i = W0 x_i + b0 + Σ_j (W1 x_j + b1)`, over the neighbours `j` of `i`.
///
/// The graph is the adjacency matrix `[V, V]`, 1 for each direction of each edge and nothing on the diagonal: a **sum**
/// and no mean, so the bias `b1` counts once for each neighbour. Names, values and initial distributions
/// (deviation 0.01, biases 0) are those of PyTorch3D.
///
/// ```
/// use autodiff_lite::{Activation, SparseMatrix, Tape};
/// use nets::{GraphConv, Init};
///
/// // A path of three vertices.
/// let edges = [(0, 1, 1.0), (1, 0, 1.0), (1, 2, 1.0), (2, 1, 1.0)];
/// let graph = SparseMatrix::from_triplets(3, 3, &edges)?;
/// let conv = GraphConv::<f32>::new(&Init::new(0).at("gconvs.0"), 8, 4);
/// let tape = Tape::eval();
/// let x = tape.constant(ndarray::Array3::zeros((2, 3, 8)));
/// assert_eq!(conv.forward_then(x, &graph, Activation::Relu).shape(), [2, 3, 4]);
/// # Ok::<(), autodiff_lite::SparseError>(())
/// ```
///
/// # References
/// Gkioxari, Malik, Johnson 2019, *Mesh R-CNN*, section 3.1; `pytorch3d.ops.GraphConv`.
#[derive(Clone, Debug)]
pub struct GraphConv<F: Real = f32> {
    /// For the vertex.
    pub w0: Linear<F>,
    /// For its neighbours.
    pub w1: Linear<F>,
}
impl_module!(GraphConv { w0, w1 });

impl<F: Real> GraphConv<F> {
    /// From `inputs` to `outputs` features.
    pub fn new(init: &Init, inputs: usize, outputs: usize) -> Self {
        let linear = |name: &str| Linear::normal(&init.at(name), inputs, outputs, 0.01);
        Self { w0: linear("w0"), w1: linear("w1") }
    }

    forward! {
        /// The vertices' new features.
        ///
        /// # Shapes
        /// `x [.., V, in]`, `graph [V, V]` → `[.., V, out]`.
        |self, x, activation, graph: &SparseMatrix<F>| {
            let tape = x.tape();
            let bias = |linear: &Linear<F>| linear.bias.as_ref().map(|bias| tape.param(bias));
            let weights = GraphWeights {
                own: tape.param(&self.w0.weight),
                across: tape.param(&self.w1.weight),
                output_first: true,
                bias: bias(&self.w0),
                across_bias: bias(&self.w1),
            };
            x.graph_conv(graph, &weights, activation)
        }
    }
}

/// Pixel2Mesh's form with two supports, the identity and a matrix `A`: `y = x loop_weight + A x weight + bias`.
///
/// `A` is what the graph file of Pixel2Mesh lists second for each stage: the Chebyshev polynomial `2 L / λmax - I`,
/// its diagonal included. Any other matrix will do. Names, layout (`[in, out]`) and initial distribution (`±1 / √out`)
/// are those of the PyTorch versions; the original in TensorFlow begins with Glorot's.
///
/// # References
/// Wang et al. 2018, *Pixel2Mesh*, section 3.2; Defferrard et al. 2016, *Convolutional neural networks on graphs with
/// fast localized spectral filtering*.
#[derive(Clone, Debug)]
pub struct ChebyshevConv<F: Real = f32> {
    /// `[in, out]`, for what arrives over `A`.
    pub weight: Param<F>,
    /// `[in, out]`, for the vertex.
    pub loop_weight: Param<F>,
    /// `[out]`.
    pub bias: Option<Param<F>>,
}
impl_module!(ChebyshevConv { weight, loop_weight, bias });

impl<F: Real> ChebyshevConv<F> {
    /// From `inputs` to `outputs` features.
    pub fn new(init: &Init, inputs: usize, outputs: usize) -> Self {
        let bound = 1.0 / (outputs.max(1) as f64).sqrt();
        let weight = |name: &str, shape: &[usize]| init.at(name).uniform(shape, -bound, bound);
        Self {
            weight: weight("weight", &[inputs, outputs]),
            loop_weight: weight("loop_weight", &[inputs, outputs]),
            bias: Some(weight("bias", &[outputs])),
        }
    }

    forward! {
        /// The vertices' new features.
        ///
        /// # Shapes
        /// `x [.., V, in]`, `graph [V, V]` → `[.., V, out]`.
        |self, x, activation, graph: &SparseMatrix<F>| {
            let tape = x.tape();
            let weights = GraphWeights {
                own: tape.param(&self.loop_weight),
                across: tape.param(&self.weight),
                output_first: false,
                bias: self.bias.as_ref().map(|bias| tape.param(bias)),
                across_bias: None,
            };
            x.graph_conv(graph, &weights, activation)
        }
    }
}

#[cfg(test)]
mod tests {
    use autodiff_lite::{Module, Tape};
    use ndarray::{arr1, arr2};

    use super::*;

    #[test]
    fn a_sum_over_neighbors_by_hand() {
        // 0 - 1 - 2
        let edges = [(0, 1, 1.0), (1, 0, 1.0), (1, 2, 1.0), (2, 1, 1.0)];
        let graph = SparseMatrix::from_triplets(3, 3, &edges).expect("in range");
        let mut conv = GraphConv::<f64>::new(&Init::new(0), 1, 1);
        let line =
            |w, b| Linear { weight: Param::new(arr2(&[[w]])), bias: Some(Param::new(arr1(&[b]))) };
        (conv.w0, conv.w1) = (line(10.0, 0.5), line(1.0, 0.25));
        let tape = Tape::eval();
        let x = tape.constant(arr2(&[[1.0], [2.0], [-40.0]]));
        let y = conv.forward_then(x, &graph, Activation::Relu).value();
        // 10 + 0.5 + (2 + 0.25); 20 + 0.5 + (1 + 0.25) + (-40 + 0.25), rectified; -400 + .., rectified.
        assert_eq!(y.as_slice(), [12.75, 0.0, 0.0]);
        let y = conv.forward(x, &graph).value();
        assert_eq!(y.as_slice(), [12.75, -18.0, -397.25]);
    }

    #[test]
    fn parameters_have_the_names_and_spreads_of_the_originals() {
        let init = Init::new(0);
        let (mut paths, conv) = (Vec::new(), GraphConv::<f32>::new(&init, 300, 200));
        conv.visit("gconvs.0", &mut |path: &str, _: &_| paths.push(path.to_owned()));
        assert_eq!(paths[..2], ["gconvs.0.w0.weight", "gconvs.0.w0.bias"]);
        let spread = conv.w1.weight.value.iter().map(|w| w * w).sum::<f32>() / 60_000.0;
        assert!((spread.sqrt() / 0.01 - 1.0).abs() < 0.02, "{spread}");
        let conv = ChebyshevConv::<f32>::new(&init, 963, 192);
        assert_eq!(
            (conv.weight.shape(), conv.parameter_count()),
            (&[963, 192][..], 2 * 963 * 192 + 192)
        );
        let most = conv.loop_weight.value.iter().fold(0.0_f32, |most, w| most.max(w.abs()));
        assert!(most <= 1.0 / 192.0_f32.sqrt() && most > 0.99 / 192.0_f32.sqrt());
    }
}
