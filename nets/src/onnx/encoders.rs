//! Image encoders as nodes of a graph.

use autodiff_lite::{Activation, PoolGeometry};

use super::ToOnnx;
use super::graph::{OnnxGraph, OnnxValue};
use super::layers::normed;
use crate::backbones::conv_front_end::{BLOCKS as FRONT_BLOCKS, LEAK};
use crate::backbones::pixel2mesh_encoder::name;
use crate::backbones::small_cnn::GRID as SMALL_GRID;
use crate::backbones::vgg::{BLOCKS, GRID};
use crate::{
    Branch, Conv2d, ConvFrontEnd, ConvNormRelu, InceptionV3, Mixed, MixedPool, Pixel2MeshEncoder,
    ResNet, ResidualBlock, SmallCnn, Vgg16,
};

/// What a [`SmallCnn`] makes of images.
#[derive(Clone, Debug)]
pub struct SmallCnnOnnx {
    /// The maps behind each convolution, finest first.
    pub maps: Vec<OnnxValue>,
    /// `[N, D]`.
    pub features: OnnxValue,
}

impl ToOnnx for SmallCnn {
    type Output = SmallCnnOnnx;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> SmallCnnOnnx {
        let (mut x, mut maps) = (x.clone(), Vec::new());
        for (i, (conv, norm)) in self.convs.iter().zip(&self.norms).enumerate() {
            let names = [format!("convs/{i}"), format!("norms/{i}")];
            let names = [&*names[0], &*names[1]];
            x = normed(graph, &x, (names, conv, norm), Activation::Relu);
            maps.push(x.clone());
        }
        let grid = graph.adaptive_avg_pool2d(&x, SMALL_GRID, SMALL_GRID);
        // The weights are in the order of features-last maps.
        let grid = graph.permute(&grid, &[1, 2, 0]);
        let flat = graph.reshape(&grid, &[grid.shape.iter().product()]);
        let y = graph.scope("fc", |graph| self.fc.to_onnx(graph, &flat));
        let features = graph.scope("norm", |graph| self.norm.to_onnx(graph, &y));
        SmallCnnOnnx { maps, features }
    }
}

/// Convolutions of VGG16 with their ReLUs, `count` of them.
fn relu_convs<'a>(
    graph: &mut OnnxGraph,
    x: &OnnxValue,
    layers: &mut impl Iterator<Item = &'a (usize, Conv2d)>,
    count: usize,
) -> OnnxValue {
    layers.take(count).fold(x.clone(), |x, (index, conv)| {
        graph.scope(&format!("features/{index}"), |graph| {
            let y = conv.to_onnx(graph, &x);
            graph.activate(&y, Activation::Relu)
        })
    })
}

impl Vgg16 {
    /// Adds its convolutions; the maps after each pool, largest first.
    pub fn maps_to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> Vec<OnnxValue> {
        let (mut x, mut maps, mut layers) = (x.clone(), Vec::new(), self.features.0.iter());
        for block in &BLOCKS[..self.pools()] {
            let y = relu_convs(graph, &x, &mut layers, block.len());
            x = graph.max_pool2d(&y, PoolGeometry::square(2));
            maps.push(x.clone());
        }
        maps
    }
}

impl ToOnnx for Vgg16 {
    type Output = OnnxValue;

    /// Through features and what there is of the classifier: as [`Vgg16::forward`].
    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let mut x = self.maps_to_onnx(graph, x).pop().unwrap_or_else(|| x.clone());
        if !self.classifier.is_empty() {
            x = graph.adaptive_avg_pool2d(&x, GRID, GRID);
        }
        x = graph.reshape(&x, &[x.shape.iter().product()]);
        for (index, layer) in &self.classifier.0 {
            x = graph.scope(&format!("classifier/{index}"), |graph| {
                let y = layer.to_onnx(graph, &x);
                let last = *index >= 6;
                graph.activate(&y, if last { Activation::None } else { Activation::Relu })
            });
        }
        x
    }
}

impl ToOnnx for ConvFrontEnd {
    type Output = OnnxValue;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let ([_, h, w], by) = (x.image(), self.downscale.max(1));
        let mut x = graph.resize_bilinear(x, h / by, w / by);
        let mut layers = self.features.0.iter();
        for block in FRONT_BLOCKS {
            let y = relu_convs(graph, &x, &mut layers, block);
            x = graph.max_pool2d(&y, PoolGeometry::square(2));
        }
        for (i, conv) in self.narrow.iter().enumerate() {
            x = graph.scope(&format!("narrow/{i}"), |graph| {
                let y = conv.to_onnx(graph, &x);
                graph.activate(&y, LEAK)
            });
        }
        graph.reshape(&x, &[x.shape.iter().product()])
    }
}

impl ToOnnx for Pixel2MeshEncoder {
    type Output = [OnnxValue; 4];

    /// The four maps, finest first.
    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> [OnnxValue; 4] {
        let (mut x, mut maps) = (x.clone(), Vec::new());
        for (s, stage) in self.stages.iter().enumerate() {
            for (i, conv) in stage.iter().enumerate() {
                let norm = self.norms.get(s).and_then(|norms| norms.get(i));
                let y = graph.scope(&name("conv", s, i), |graph| conv.to_onnx(graph, &x));
                let y = match norm {
                    None => y,
                    Some(norm) => {
                        let y = graph.scope(&name("norm", s, i), |graph| norm.to_onnx(graph, &y));
                        if i == 0 { y } else { graph.add(&x, &y) }
                    }
                };
                x = graph.activate(&y, Activation::Relu);
            }
            maps.push(x.clone());
        }
        std::array::from_fn(|k| maps[k + 2].clone())
    }
}

impl ToOnnx for ResidualBlock {
    type Output = OnnxValue;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let (relu, none) = (Activation::Relu, Activation::None);
        let y = normed(graph, x, (["conv1", "bn1"], &self.conv1, &self.bn1), relu);
        let second = if self.conv3.is_some() { relu } else { none };
        let mut y = normed(graph, &y, (["conv2", "bn2"], &self.conv2, &self.bn2), second);
        if let (Some(conv3), Some(bn3)) = (&self.conv3, &self.bn3) {
            y = normed(graph, &y, (["conv3", "bn3"], conv3, bn3), none);
        }
        let shortcut = match &self.downsample {
            Some((conv, norm)) => {
                normed(graph, x, (["downsample/0", "downsample/1"], conv, norm), none)
            }
            None => x.clone(),
        };
        let sum = graph.add(&y, &shortcut);
        graph.activate(&sum, relu)
    }
}

impl ToOnnx for ResNet {
    type Output = [OnnxValue; 4];

    /// The maps of the four stages: as [`ResNet::forward_maps`].
    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> [OnnxValue; 4] {
        let stem = (["conv1", "bn1"], &self.conv1, &self.bn1);
        let x = normed(graph, x, stem, Activation::Relu);
        let mut x = graph.max_pool2d(&x, PoolGeometry::square(3).stride(2).padding(1));
        let stages = [&self.layer1, &self.layer2, &self.layer3, &self.layer4];
        let mut k = 0;
        stages.map(|stage| {
            k += 1;
            for (i, block) in stage.iter().enumerate() {
                x = graph.scope(&format!("layer{k}/{i}"), |graph| block.to_onnx(graph, &x));
            }
            x.clone()
        })
    }
}

impl ResNet {
    /// Adds all of it, as [`ResNet::forward`]: logits, or the means of the last map where there is no classifier.
    pub fn head_to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let [.., last] = self.to_onnx(graph, x);
        let means = graph.adaptive_avg_pool2d(&last, 1, 1);
        let features = graph.reshape(&means, &[last.shape[0]]);
        match &self.fc {
            Some(fc) => graph.scope("fc", |graph| fc.to_onnx(graph, &features)),
            None => features,
        }
    }
}

impl ToOnnx for ConvNormRelu {
    type Output = OnnxValue;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        normed(graph, x, (["conv", "bn"], &self.conv, &self.bn), Activation::Relu)
    }
}

impl ToOnnx for Branch {
    type Output = Vec<OnnxValue>;

    /// The maps of its end: one, or those of the fork.
    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> Vec<OnnxValue> {
        let x = self.chain.iter().fold(x.clone(), |x, (name, layer)| {
            graph.scope(name, |graph| layer.to_onnx(graph, &x))
        });
        if self.fork.is_empty() {
            return vec![x];
        }
        let fork = self.fork.iter();
        fork.map(|(name, layer)| graph.scope(name, |graph| layer.to_onnx(graph, &x))).collect()
    }
}

impl ToOnnx for Mixed {
    type Output = OnnxValue;

    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let mut parts = Vec::new();
        for branch in &self.branches {
            parts.extend(branch.to_onnx(graph, x));
        }
        let window = PoolGeometry::square(3).stride(1).padding(1);
        let pooled = match self.pool {
            MixedPool::Mean => graph.avg_pool2d(x, window),
            MixedPool::MeanInside => graph.mean_inside(x, window),
            MixedPool::Max => graph.max_pool2d(x, window),
            MixedPool::HalvingMax => graph.max_pool2d(x, PoolGeometry::square(3).stride(2)),
        };
        parts.push(match &self.branch_pool {
            Some(layer) => graph.scope("branch_pool", |graph| layer.to_onnx(graph, &pooled)),
            None => pooled,
        });
        graph.concat(&parts.iter().collect::<Vec<_>>(), 0)
    }
}

impl ToOnnx for InceptionV3 {
    type Output = OnnxValue;

    /// Images in `[-1, 1]` to features `[N, 2048]`: as [`InceptionV3::forward_features`].
    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> OnnxValue {
        let pool = PoolGeometry::square(3).stride(2);
        let mut x = x.clone();
        for (i, layer) in self.stem.iter().enumerate() {
            x = graph.scope(&format!("stem/{i}"), |graph| layer.to_onnx(graph, &x));
            // Behind the third and the last.
            if i == 2 || i + 1 == self.stem.len() {
                x = graph.max_pool2d(&x, pool);
            }
        }
        for (i, block) in self.mixed.iter().enumerate() {
            x = graph.scope(&format!("mixed/{i}"), |graph| block.to_onnx(graph, &x));
        }
        let means = graph.adaptive_avg_pool2d(&x, 1, 1);
        graph.reshape(&means, &[x.shape[0]])
    }
}
