//! Pixel2Mesh's chain of graph convolutions.

use autodiff_lite::{Activation, Real, SparseMatrix, Var, impl_module};

use crate::{ChebyshevConv, Init};

/// Two graph convolutions with a skip: `(x + conv2(conv1(x))) / 2`, the activation after each.
#[derive(Clone, Debug)]
pub struct GraphResBlock<F: Real = f32> {
    /// From the block's width to the hidden one.
    pub conv1: ChebyshevConv<F>,
    /// And back.
    pub conv2: ChebyshevConv<F>,
    /// After each convolution.
    pub activation: Activation,
}
impl_module!(GraphResBlock { conv1, conv2 } fixed { activation });

impl<F: Real> GraphResBlock<F> {
    /// Of `width` features, `hidden` inside.
    pub fn new(init: &Init, width: usize, hidden: usize, activation: Activation) -> Self {
        Self {
            conv1: ChebyshevConv::new(&init.at("conv1"), width, hidden),
            conv2: ChebyshevConv::new(&init.at("conv2"), hidden, width),
            activation,
        }
    }

    /// Two graph convolutions and a skip.
    ///
    /// # Shapes
    /// `x [.., V, width]`, `graph [V, V]` → `[.., V, width]`.
    #[track_caller]
    pub fn forward<'t>(&self, x: Var<'t, F>, graph: &SparseMatrix<F>) -> Var<'t, F> {
        let hidden = self.conv1.forward_then(x, graph, self.activation);
        let h = self.conv2.forward_then(hidden, graph, self.activation);
        let half = F::from_f64(0.5);
        x.tape().lincomb(&[(half, x), (half, h)])
    }
}

/// One deformation block of Pixel2Mesh: a graph convolution to the hidden width, residual blocks, and a graph
/// convolution to coordinates; the hidden features go on to the next block.
///
/// As published, with 6 blocks, 192 (PyTorch) or 256 (TensorFlow) hidden features and `Activation::Relu`; the version
/// that the paper on neural ODEs started from has no activation at all: `Activation::None`.
///
/// ```
/// use autodiff_lite::{Activation, SparseMatrix, Tape};
/// use nets::{GraphBottleneck, Init};
///
/// let graph = SparseMatrix::from_triplets(4, 4, &[(0, 1, 0.5), (1, 0, 0.5), (2, 3, 0.5), (3, 2, 0.5)])?;
/// let block = GraphBottleneck::<f32>::new(&Init::new(0).at("gcns.0"), 6, [963, 192, 3], Activation::Relu);
/// let tape = Tape::eval();
/// let (coordinates, hidden) = block.forward(tape.constant(ndarray::Array3::zeros((1, 4, 963))), &graph);
/// assert_eq!((coordinates.shape(), hidden.shape()), (vec![1, 4, 3], vec![1, 4, 192]));
/// # Ok::<(), autodiff_lite::SparseError>(())
/// ```
///
/// # References
/// Wang et al. 2018, *Pixel2Mesh*, section 3.3 and figure 2.
#[derive(Clone, Debug)]
pub struct GraphBottleneck<F: Real = f32> {
    /// Between the two others.
    pub blocks: Vec<GraphResBlock<F>>,
    /// To the hidden width.
    pub conv1: ChebyshevConv<F>,
    /// To the outputs; no activation follows.
    pub conv2: ChebyshevConv<F>,
    /// After all other convolutions.
    pub activation: Activation,
}
impl_module!(GraphBottleneck { blocks, conv1, conv2 } fixed { activation });

impl<F: Real> GraphBottleneck<F> {
    /// With this many residual blocks; the widths of input, hidden and output features.
    pub fn new(
        init: &Init,
        blocks: usize,
        [input, hidden, output]: [usize; 3],
        activation: Activation,
    ) -> Self {
        let block = |i| GraphResBlock::new(&init.at("blocks").index(i), hidden, hidden, activation);
        Self {
            blocks: (0..blocks).map(block).collect(),
            conv1: ChebyshevConv::new(&init.at("conv1"), input, hidden),
            conv2: ChebyshevConv::new(&init.at("conv2"), hidden, output),
            activation,
        }
    }

    /// The output, and the hidden features from which it is made.
    ///
    /// # Shapes
    /// `x [.., V, input]`, `graph [V, V]` → `[.., V, output]` and `[.., V, hidden]`.
    #[track_caller]
    pub fn forward<'t>(&self, x: Var<'t, F>, graph: &SparseMatrix<F>) -> (Var<'t, F>, Var<'t, F>) {
        let first = self.conv1.forward_then(x, graph, self.activation);
        let hidden = self.blocks.iter().fold(first, |x, block| block.forward(x, graph));
        (self.conv2.forward(hidden, graph), hidden)
    }
}
