//! Networks: VGG16, ResNet-18, a transformer's encoder layer, graph convolutions, and an optimiser's step.

use autodiff_lite::optim::Adam;
use autodiff_lite::{Param, SparseMatrix, Tape, Tensor, impl_module};
use benches::{criterion, numbers, pool, yardsticks};
use criterion::{BenchmarkGroup, measurement::WallTime};
use mesh_core::primitives::icosphere;
use ndarray::ArrayD;
use nets::{
    GraphConv, Init, ResNet, ResNetConfig, TransformerConfig, TransformerEncoderLayer, Vgg16,
};
use rayon::ThreadPool;

struct Weights {
    w: Param,
}
impl_module!(Weights: f32 { w });

fn array(shape: &[usize], seed: u32) -> Tensor {
    let values = numbers(shape.iter().product(), seed);
    ArrayD::from_shape_vec(shape, values).expect("as many numbers as the shape has").into()
}

/// The group of all, with threads and first weights.
struct Bench<'c> {
    group: BenchmarkGroup<'c, WallTime>,
    pool: ThreadPool,
    init: Init,
}

impl Bench<'_> {
    fn all(mut self) {
        self.group.sample_size(10);
        self.vgg16();
        self.resnet18();
        self.group.sample_size(20);
        // One tape for all that follow, each with the memory of those before.
        let mut tape = Tape::train(0);
        self.encoder_layer(&mut tape);
        self.graph_conv(&mut tape);
        self.adam(&mut tape);
        self.group.finish();
    }

    fn vgg16(&mut self) {
        for [batch, side] in [[4, 224], [16, 64]] {
            let vgg = Vgg16::<f32>::features_until_pool(&self.init, 5);
            let images = array(&[batch, side, side, 3], 1);
            let mut tape = Tape::train(0);
            self.group.bench_function(
                format!("vgg16-features/{batch}x{side}x{side}/forward-backward/2t"),
                |b| {
                    self.pool.install(|| {
                        b.iter(|| {
                            let loss = vgg.forward_features(tape.constant(images.clone())).sum();
                            drop(loss.backward());
                            tape.reset();
                        });
                    });
                },
            );
        }
    }

    /// The published size, and a half-width encoder of small images; norms train.
    fn resnet18(&mut self) {
        for (name, width, [batch, side]) in
            [("resnet18", 64, [4, 256]), ("resnet18-half", 32, [8, 64])]
        {
            let config = ResNetConfig { width, ..ResNetConfig::resnet18() };
            let net = ResNet::<f32>::new(&self.init, &config);
            let images = array(&[batch, side, side, 3], 1);
            let mut tape = Tape::train(0);
            let id = format!("{name}/{batch}x{side}x{side}/forward-backward/2t");
            self.group.bench_function(id, |b| {
                self.pool.install(|| {
                    b.iter(|| {
                        let loss = net.forward_features(tape.constant(images.clone())).sum();
                        drop(loss.backward());
                        drop(tape.take_updates());
                        tape.reset();
                    });
                });
            });
        }
    }

    fn encoder_layer(&mut self, tape: &mut Tape) {
        let config = TransformerConfig::new(512, 8);
        let layer = TransformerEncoderLayer::<f32>::new(&self.init, &config);
        let tokens = array(&[8, 64, 512], 2);
        self.group.bench_function("encoder-layer/8x64x512/forward-backward/2t", |b| {
            self.pool.install(|| {
                b.iter(|| {
                    let loss = layer.forward(tape.leaf(tokens.clone()), None).sum();
                    drop(loss.backward());
                    tape.reset();
                });
            });
        });
    }

    fn graph_conv(&mut self, tape: &mut Tape) {
        // Each directed edge of an icosphere is the side of one face.
        let faces = icosphere(4).faces;
        let sides = faces.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
        let entries: Vec<_> = sides.map(|[a, b]| (a as usize, b as usize, 1.0)).collect();
        let graph = SparseMatrix::from_triplets(2562, 2562, &entries).expect("indices of vertices");
        for inputs in [963, 192] {
            let conv = GraphConv::<f32>::new(&self.init, inputs, 192);
            let features = array(&[2562, inputs], 4);
            let name = format!("graph-conv/2562/{inputs}-192");
            self.group.bench_function(format!("{name}/forward-backward/2t"), |b| {
                self.pool.install(|| {
                    b.iter(|| {
                        let y = conv.forward(tape.leaf(features.clone()), &graph);
                        drop(y.backward_with(y.value()));
                        tape.reset();
                    });
                });
            });
            self.group.bench_function(format!("{name}-unfused/forward-backward/2t"), |b| {
                self.pool.install(|| {
                    b.iter(|| {
                        let x = tape.leaf(features.clone());
                        let y = conv.w0.forward(x) + conv.w1.forward(x).sparse_matmul(&graph);
                        drop(y.backward_with(y.value()));
                        tape.reset();
                    });
                });
            });
        }
    }

    fn adam(&mut self, tape: &mut Tape) {
        let mut weights = Weights { w: Param::new(array(&[3_150_000], 3)) };
        let gradients = tape.param(&weights.w).square().sum().backward();
        tape.reset();
        let mut adam = Adam::new(1e-3);
        self.group.bench_function("adam/3.15M/2t", |b| {
            self.pool.install(|| b.iter(|| adam.step(&mut weights, &gradients)));
        });
    }
}

fn main() {
    let mut criterion = criterion();
    yardsticks(&mut criterion, "nets");
    let group = criterion.benchmark_group("nets");
    Bench { group, pool: pool(2), init: Init::new(0) }.all();
    criterion.final_summary();
}
