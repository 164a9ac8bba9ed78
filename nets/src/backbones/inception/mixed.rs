//! Inception's blocks: branches side by side, their maps one after another.

use autodiff_lite::{
    Activation, ConvGeometry, Module, PoolGeometry, Real, Var, Visitor, VisitorMut, impl_module,
    join_path,
};
use ndarray::Array4;

use crate::{Conv2d, Init, Norm, NormKind};

/// A convolution, its frozen norm (`eps` 1e-3) and a ReLU, in one pass.
#[derive(Clone, Debug)]
pub struct ConvNormRelu<F: Real = f32> {
    /// Without bias.
    pub conv: Conv2d<F>,
    /// Behind it.
    pub bn: Norm<F>,
}
impl_module!(ConvNormRelu { conv, bn });

/// Name, outputs, window, stride and padding of a convolution.
pub(super) type Layer = (&'static str, usize, [usize; 2], usize, [usize; 2]);

/// A 1x1 convolution.
pub(super) const fn one(name: &'static str, outputs: usize) -> Layer {
    (name, outputs, [1, 1], 1, [0, 0])
}

/// A convolution that keeps the size.
pub(super) const fn same(name: &'static str, outputs: usize, [h, w]: [usize; 2]) -> Layer {
    (name, outputs, [h, w], 1, [h / 2, w / 2])
}

/// A 3x3 convolution with stride 2 and no padding.
pub(super) const fn half(name: &'static str, outputs: usize) -> Layer {
    (name, outputs, [3, 3], 2, [0, 0])
}

impl<F: Real> ConvNormRelu<F> {
    pub(super) fn new(init: &Init, inputs: usize, layer: Layer) -> Self {
        let (_, outputs, [h, w], stride, padding) = layer;
        let geometry = ConvGeometry { padding, ..ConvGeometry::new().stride(stride) };
        // As torchvision, whose normal distribution is cut off at -2 and 2, twenty deviations: hardly ever.
        let weight = init.at("conv.weight").normal(&[outputs, inputs, h, w], 0.0, 0.1);
        let bn = Norm::new(&init.at("bn"), outputs, NormKind::Frozen).with_eps(1e-3);
        Self { conv: Conv2d { weight, bias: None, geometry }, bn }
    }

    /// Convolution, frozen batch norm, ReLU.
    ///
    /// # Shapes
    /// `x [N, H, W, I]` → `[N, H', W', O]`.
    #[track_caller]
    pub fn forward<'t>(&self, x: Var<'t, F>) -> Var<'t, F> {
        self.bn.after(&self.conv, x, Activation::Relu)
    }

    fn outputs(&self) -> usize {
        self.conv.weight.shape()[0]
    }
}

/// Convolutions one after another; after them those of `fork` side by side.
#[derive(Clone, Debug)]
pub struct Branch<F: Real = f32> {
    /// In order, with their names.
    pub chain: Vec<(&'static str, ConvNormRelu<F>)>,
    /// None, or two.
    pub fork: Vec<(&'static str, ConvNormRelu<F>)>,
}

/// How the last branch of a block pools.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MixedPool {
    /// Means of 3x3; padding counts as zeros: torchvision.
    Mean,
    /// Means of those of 3x3 pixels that are there: the network of the FID.
    MeanInside,
    /// The largest of 3x3: the last block of the network of the FID.
    Max,
    /// The largest of 3x3 with stride 2, in the blocks that halve.
    HalvingMax,
}

/// A block: branches of convolutions and one that pools.
#[derive(Clone, Debug)]
pub struct Mixed<F: Real = f32> {
    /// Side by side.
    pub branches: Vec<Branch<F>>,
    /// What the last branch does first.
    pub pool: MixedPool,
    /// And then; nothing in the blocks that halve.
    pub branch_pool: Option<ConvNormRelu<F>>,
}

impl<F: Real> Module<F> for Mixed<F> {
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<F>) {
        for branch in &self.branches {
            for (name, layer) in branch.chain.iter().chain(&branch.fork) {
                layer.visit(&join_path(path, name), visitor);
            }
        }
        self.branch_pool.visit(&join_path(path, "branch_pool"), visitor);
    }

    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<F>) {
        for branch in &mut self.branches {
            for (name, layer) in branch.chain.iter_mut().chain(&mut branch.fork) {
                layer.visit_mut(&join_path(path, name), visitor);
            }
        }
        self.branch_pool.visit_mut(&join_path(path, "branch_pool"), visitor);
    }
}

impl<F: Real> Mixed<F> {
    /// `branches` of chains and forks; `pooled` outputs of the branch that pools, if it convolves.
    pub(super) fn new(
        init: &Init,
        inputs: usize,
        branches: &[(&[Layer], &[Layer])],
        pool: MixedPool,
        pooled: Option<usize>,
    ) -> Self {
        let made =
            |inputs, layer: Layer| (layer.0, ConvNormRelu::new(&init.at(layer.0), inputs, layer));
        let branch = |(chain, fork): &(&[Layer], &[Layer])| {
            let before = |i: usize| i.checked_sub(1).map_or(inputs, |last| chain[last].1);
            let chained = |(i, &layer): (usize, &Layer)| made(before(i), layer);
            let forked = |&layer: &Layer| made(before(chain.len()), layer);
            Branch {
                chain: chain.iter().enumerate().map(chained).collect(),
                fork: fork.iter().map(forked).collect(),
            }
        };
        Self {
            branches: branches.iter().map(branch).collect(),
            pool,
            branch_pool: pooled.map(|outputs| made(inputs, one("branch_pool", outputs)).1),
        }
    }

    /// Channels of the output, from those of the input.
    pub(super) fn outputs(&self, inputs: usize) -> usize {
        let of = |branch: &Branch<F>| {
            let last = branch.chain.last().map_or(0, |(_, layer)| layer.outputs());
            let fork: usize = branch.fork.iter().map(|(_, layer)| layer.outputs()).sum();
            if fork > 0 { fork } else { last }
        };
        let pooled = self.branch_pool.as_ref().map_or(inputs, ConvNormRelu::outputs);
        self.branches.iter().map(of).sum::<usize>() + pooled
    }

    /// All branches, side by side.
    ///
    /// # Shapes
    /// `x [N, H, W, I]` → `[N, H, W, O]`; about half the height and width in the blocks that halve.
    #[track_caller]
    pub fn forward<'t>(&self, x: Var<'t, F>) -> Var<'t, F> {
        let mut parts = Vec::new();
        for branch in &self.branches {
            let last = branch.chain.iter().fold(x, |x, (_, layer)| layer.forward(x));
            if branch.fork.is_empty() {
                parts.push(last);
            }
            parts.extend(branch.fork.iter().map(|(_, layer)| layer.forward(last)));
        }
        let window = PoolGeometry::square(3).stride(1).padding(1);
        let pooled = match self.pool {
            MixedPool::Mean => x.avg_pool2d(window),
            MixedPool::MeanInside => mean_inside(x, window),
            MixedPool::Max => x.max_pool2d(window),
            MixedPool::HalvingMax => x.max_pool2d(PoolGeometry::square(3).stride(2)),
        };
        parts.push(self.branch_pool.as_ref().map_or(pooled, |layer| layer.forward(pooled)));
        x.tape().concat(&parts, 3)
    }
}

/// Means of the pixels of each 3x3 window that are there: the mean that counts nine, times nine over
/// how many there are.
#[track_caller]
fn mean_inside<F: Real>(x: Var<'_, F>, window: PoolGeometry) -> Var<'_, F> {
    let [_, h, w, _] = x.dims();
    let there = |i: usize, n: usize| 1 + usize::from(i > 0) + usize::from(i + 1 < n);
    let factor = Array4::from_shape_fn((1, h, w, 1), |(_, i, j, _)| {
        F::from_f64(9.0 / (there(i, h) * there(j, w)) as f64)
    });
    x.avg_pool2d(window).mul(x.tape().constant(factor))
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use autodiff_lite::testkit::gradcheck;

    use super::*;

    gradcheck!(inside: |x| mean_inside(x, PoolGeometry::square(3).stride(1).padding(1)),
        shapes [[[2, 3, 4, 2]], [[1, 1, 1, 1]], [[1, 1, 5, 3]]]);

    #[test]
    fn the_mean_of_ones_is_one_at_the_border_too() {
        let tape = Tape::<f64>::eval();
        let x = tape.constant(Array4::ones((1, 4, 3, 2)));
        let y = mean_inside(x, PoolGeometry::square(3).stride(1).padding(1)).value();
        assert!(y.iter().all(|y| (y - 1.0).abs() < 1e-15));
    }
}
