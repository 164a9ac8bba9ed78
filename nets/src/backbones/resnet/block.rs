//! Residual blocks.

use autodiff_lite::kernels::elementwise;
use autodiff_lite::{Activation, Backward, ConvGeometry, Real, Tensor, Var, impl_module};

use crate::{Conv2d, Init, Norm, NormKind};

/// The two shapes of a residual block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BlockKind {
    /// Two 3x3 convolutions: ResNet-18 and -34.
    Basic,
    /// 1x1, 3x3, 1x1, the last four times as wide: ResNet-50 and deeper.
    Bottleneck,
}

impl BlockKind {
    /// Channels of a block's output over its width.
    pub fn expansion(self) -> usize {
        match self {
            Self::Basic => 1,
            Self::Bottleneck => 4,
        }
    }
}

/// `y = relu(f(x) + shortcut(x))`, where `f` is two or three convolutions with their norms.
///
/// The shortcut is `x`, or a strided 1x1 convolution with a norm where sizes change. A bottleneck
/// strides in its 3x3 convolution, as torchvision's does (the paper: in the first 1x1).
///
/// # References
/// He et al. 2016, *Deep residual learning for image recognition*, figure 5; names as in
/// torchvision's `BasicBlock` and `Bottleneck`.
#[derive(Clone, Debug)]
pub struct ResidualBlock<F: Real = f32> {
    /// 3x3, or 1x1 in a bottleneck.
    pub conv1: Conv2d<F>,
    /// Behind it.
    pub bn1: Norm<F>,
    /// 3x3.
    pub conv2: Conv2d<F>,
    /// Behind it.
    pub bn2: Norm<F>,
    /// 1x1, in a bottleneck.
    pub conv3: Option<Conv2d<F>>,
    /// Behind it.
    pub bn3: Option<Norm<F>>,
    /// The shortcut's convolution and norm, where sizes change.
    pub downsample: Option<(Conv2d<F>, Norm<F>)>,
}
impl_module!(ResidualBlock { conv1, bn1, conv2, bn2, conv3, bn3, downsample });

impl<F: Real> ResidualBlock<F> {
    /// From `inputs` channels to `width` times the kind's [expansion](BlockKind::expansion).
    pub fn new(
        init: &Init,
        kind: BlockKind,
        inputs: usize,
        width: usize,
        stride: usize,
        norm: NormKind,
    ) -> Self {
        let conv = |name: &str, i, o, kernel, stride| convolution(init, name, i, o, kernel, stride);
        let bn = |name: &str, channels| Norm::new(&init.at(name), channels, norm);
        let outputs = width * kind.expansion();
        let bottleneck = kind == BlockKind::Bottleneck;
        let (conv1, conv2) = if bottleneck {
            (conv("conv1", inputs, width, 1, 1), conv("conv2", width, width, 3, stride))
        } else {
            (conv("conv1", inputs, width, 3, stride), conv("conv2", width, width, 3, 1))
        };
        let shortcut =
            || (conv("downsample.0", inputs, outputs, 1, stride), bn("downsample.1", outputs));
        Self {
            conv1,
            bn1: bn("bn1", width),
            conv2,
            bn2: bn("bn2", width),
            conv3: bottleneck.then(|| conv("conv3", width, outputs, 1, 1)),
            bn3: bottleneck.then(|| bn("bn3", outputs)),
            downsample: (stride != 1 || inputs != outputs).then(shortcut),
        }
    }

    /// The block's convolutions and its shortcut, added.
    ///
    /// # Shapes
    /// `x [N, H, W, inputs]` → `[N, H / stride, W / stride, outputs]`, halves rounded up.
    #[track_caller]
    pub fn forward<'t>(&self, x: Var<'t, F>) -> Var<'t, F> {
        let (relu, none) = (Activation::Relu, Activation::None);
        let y = self.bn1.after(&self.conv1, x, relu);
        let y = match (&self.conv3, &self.bn3) {
            (Some(conv3), Some(bn3)) => {
                bn3.after(conv3, self.bn2.after(&self.conv2, y, relu), none)
            }
            _ => self.bn2.after(&self.conv2, y, none),
        };
        let shortcut = match &self.downsample {
            Some((conv, norm)) => norm.after(conv, x, none),
            None => x,
        };
        add_relu(y, shortcut)
    }

    /// Channels of the output.
    pub fn outputs(&self) -> usize {
        self.conv3.as_ref().unwrap_or(&self.conv2).weight.shape()[0]
    }
}

/// A convolution before a norm, with torchvision's initial values.
pub(crate) fn convolution<F: Real>(
    init: &Init,
    name: &str,
    inputs: usize,
    outputs: usize,
    kernel: usize,
    stride: usize,
) -> Conv2d<F> {
    let geometry = ConvGeometry::new().stride(stride).padding(kernel / 2);
    Conv2d::kaiming(&init.at(name), inputs, outputs, kernel, geometry).without_bias()
}

/// `max(a + b, 0)` in one pass; no gradient where the sum is not positive. Both summands have the same
/// gradient, so it is masked in place, once.
#[track_caller]
fn add_relu<'t, F: Real>(a: Var<'t, F>, b: Var<'t, F>) -> Var<'t, F> {
    let (tape, x, y) = (a.tape(), a.value(), b.value());
    assert_eq!(x.shape(), y.shape(), "a block and its shortcut differ in shape");
    let mut sum = tape.array(x.shape());
    let [x, y] = [&x, &y].map(Tensor::as_slice);
    // What is not a number stays visible.
    let positive = |x: F| if x <= F::zero() { F::zero() } else { x };
    elementwise::zip(x, y, sum.as_slice_mut(), |x, y| positive(x + y));
    tape.record_fn("add_relu", &[a, b], sum, |cx: &mut Backward<'_, F>| {
        let y = cx.output();
        let y = y.as_slice();
        let mut g = cx.take_grad_out();
        let own = g.as_slice_mut();
        elementwise::update(own, y, y, |g, y, _| if y > F::zero() { g } else { F::zero() });
        if cx.needs(0) && cx.needs(1) {
            cx.give_with(1, |other| elementwise::map(g.as_slice(), other, |g| g));
            cx.give(0, g);
        } else {
            cx.give(usize::from(cx.needs(1)), g);
        }
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use autodiff_lite::Tape;
    use autodiff_lite::testkit::{Options, check, function, gradcheck};
    use ndarray::Array4;

    use super::*;

    fn kinked() -> Options {
        Options::default().pieces()
    }
    gradcheck!(sums: |a, b| add_relu(a, b), shapes [[[2, 3, 4], [2, 3, 4]], [[1], [1]]], options kinked());
    gradcheck!(one_of_them: |a| add_relu(a, a.tape().constant(a.value().mapv(|_| 0.25))),
        shapes [[[3, 5]]], options kinked());

    #[test]
    fn gradients_pass_both_ways_around_a_block() {
        for (kind, inputs, stride) in
            [(BlockKind::Basic, 3, 2), (BlockKind::Basic, 2, 1), (BlockKind::Bottleneck, 3, 2)]
        {
            let block =
                ResidualBlock::<f64>::new(&Init::new(2), kind, inputs, 2, stride, NormKind::Batch);
            let f = function(|v| block.forward(v[0]));
            let options = Options::default().pieces().tolerance(1e-6);
            check(&f, &options.draw(&[vec![2, 4, 5, inputs]]), &options).unwrap();
        }
    }

    #[test]
    fn not_a_number_stays_visible() {
        let tape = Tape::<f32>::eval();
        let [a, b] = [f32::NAN, 1.0].map(|x| tape.constant(ndarray::arr1(&[x])));
        assert!(add_relu(a, b).value()[0].is_nan() && add_relu(b, a).value()[0].is_nan());
    }

    #[test]
    fn a_block_of_zeros_is_its_shortcut() {
        let mut block =
            ResidualBlock::<f32>::new(&Init::new(0), BlockKind::Basic, 4, 4, 1, NormKind::Frozen);
        assert!(block.downsample.is_none());
        block.conv2.weight = Init::new(0).zeros(&[4, 4, 3, 3]);
        let tape = Tape::<f32>::eval();
        let x = Array4::from_shape_fn((1, 3, 3, 4), |(_, i, j, c)| (i + 3 * j) as f32 - c as f32);
        let y = block.forward(tape.constant(x.clone())).value();
        for (y, x) in y.iter().zip(&x) {
            assert_eq!(*y, x.max(0.0));
        }
    }
}
