//! What is exported: each layer and network of `nets`, and each system.

use autodiff_lite::{Activation, ConvGeometry, Module, PoolGeometry, Tape, Var};
use models::predict::Predictor;
use models::{depth, img2mesh, mcmr, pixel2mesh};
use ndarray::ArrayD;
use nets::onnx::{OnnxGraph, OnnxModel, OnnxValue, ToOnnx, channels_first, channels_last};
use nets::{
    AdaptiveAvgPool2d, BatchNorm2d, Conv2d, ConvFrontEnd, ConvTranspose2d, EncoderInit,
    FeedForward, FrozenBatchNorm2d, GroupNorm, ImageDecoder, InceptionKind, InceptionV3, Init,
    LayerNorm, Linear, Mlp, MultiHeadAttention, NormPlacement, Pixel2MeshEncoder, PointMlp,
    PointMlpConfig, ResNet, ResNetConfig, SmallCnn, TransformerConfig, TransformerEncoder, Vgg16,
    ViewpointHead, VoxelHead, WeightNormLinear,
};
use train::Configuration;

type OnTape = Box<dyn Fn(&[ArrayD<f32>]) -> Vec<ArrayD<f32>>>;

/// A network in both forms.
pub(crate) struct Network {
    pub(crate) name: String,
    pub(crate) model: OnnxModel,
    /// The same on the tape, in the axes of the model.
    pub(crate) tape: OnTape,
}

fn numbers(x: Var<'_>) -> ArrayD<f32> {
    ArrayD::from_shape_vec(x.shape(), x.value().as_slice().to_vec()).unwrap()
}

/// A map in the axes of graphs; all else as it is.
fn out(x: Var<'_>) -> ArrayD<f32> {
    let array = numbers(x);
    if array.ndim() == 4 { channels_first(&array) } else { array }
}

/// What a graph has is what a function of the tape has; values are called `y0`, `y1` and so on.
fn network(
    name: &str,
    shape: &[usize],
    graph: impl FnOnce(&mut OnnxGraph, &OnnxValue) -> Vec<OnnxValue>,
    tape: impl for<'t> Fn(Var<'t>) -> Vec<Var<'t>> + 'static,
) -> Network {
    let mut built = OnnxGraph::new(name);
    let x = built.input("x", shape);
    for (k, y) in graph(&mut built, &x).iter().enumerate() {
        built.output(&format!("y{k}"), y);
    }
    let on_tape = move |inputs: &[ArrayD<f32>]| {
        let place = Tape::eval();
        let x = if inputs[0].ndim() == 4 { channels_last(&inputs[0]) } else { inputs[0].clone() };
        tape(place.constant(x)).into_iter().map(out).collect()
    };
    Network { name: name.to_owned(), model: built.finish(), tape: Box::new(on_tape) }
}

/// A layer with one output.
fn layer<L: ToOnnx<Output = OnnxValue> + Clone + 'static>(
    name: &str,
    layer: L,
    shape: &[usize],
    forward: impl for<'t> Fn(&L, Var<'t>) -> Var<'t> + 'static,
) -> Network {
    let own = layer.clone();
    let graph = move |graph: &mut OnnxGraph, x: &OnnxValue| vec![own.to_onnx(graph, x)];
    network(name, shape, graph, move |x| vec![forward(&layer, x)])
}

/// No parameter as it begins: norms with statistics of their own, biases that are not 0.
fn stirred<M: Module<f32>>(mut module: M) -> M {
    let mut at = 0;
    module.visit_mut("", &mut |path: &str, param: &mut autodiff_lite::Param| {
        let name = path.rsplit('.').next().unwrap().to_owned();
        for x in param.as_slice_mut() {
            at += 1;
            let wave = (0.37 * f64::from(at)).sin() as f32;
            match &*name {
                "running_var" => *x = 1.0 + 0.5 * wave,
                "running_mean" => *x = 0.1 * wave,
                "bias" => *x += 0.05 * wave,
                _ => *x *= 1.0 + 0.1 * wave,
            }
        }
    });
    module
}

/// Layers, encoders and heads.
pub(crate) fn layers() -> Vec<Network> {
    let mut all = rows();
    all.extend(images());
    all.extend(encoders());
    all.extend(heads());
    all
}

fn rows() -> Vec<Network> {
    let init = Init::new(3);
    let relu = Activation::Relu;
    let transformer = |norm, feed_forward| {
        let config =
            TransformerConfig { hidden: 24, norm, feed_forward, ..TransformerConfig::new(16, 4) };
        stirred(TransformerEncoder::<f32>::new(&init.at("transformer"), 2, &config))
    };
    vec![
        layer("linear", stirred(Linear::<f32>::new(&init.at("a"), 7, 5)), &[7], |l, x| {
            l.forward(x)
        }),
        layer("linear-tokens", Linear::<f32>::new(&init.at("b"), 7, 5), &[4, 7], |l, x| {
            l.forward(x)
        }),
        layer("weight-norm", WeightNormLinear::<f32>::new(&init.at("c"), 7, 5), &[7], |l, x| {
            l.forward(x)
        }),
        layer("mlp", Mlp::<f32>::new(&init.at("d"), &[7, 12, 9, 3], relu), &[7], |l, x| {
            l.forward(x)
        }),
        layer("layer-norm", stirred(LayerNorm::<f32>::new(&init.at("e"), 9)), &[4, 9], |l, x| {
            l.forward(x)
        }),
        layer(
            "batch-norm-rows",
            stirred(BatchNorm2d::<f32>::new(&init.at("f"), 6)),
            &[6],
            |l, x| l.forward(x),
        ),
        layer(
            "attention",
            stirred(MultiHeadAttention::<f32>::new(&init.at("g"), 16, 4)),
            &[5, 16],
            |l, x| l.forward(x, None),
        ),
        layer(
            "transformer-post",
            transformer(NormPlacement::Post, FeedForward::Relu),
            &[5, 16],
            |l, x| l.forward(x, None),
        ),
        layer(
            "transformer-pre",
            transformer(NormPlacement::Pre, FeedForward::Gelu),
            &[5, 16],
            |l, x| l.forward(x, None),
        ),
    ]
}

fn images() -> Vec<Network> {
    let init = Init::new(4);
    let uneven =
        ConvGeometry { padding: [2, 1], dilation: [2, 1], ..ConvGeometry::new().stride(2) };
    let twice = ConvGeometry::new().stride(2).padding(1);
    let up = ConvTranspose2d::<f32> {
        output_padding: 1,
        ..ConvTranspose2d::new(&init.at("b"), 5, 4, 3, twice)
    };
    let mean = |height, width| AdaptiveAvgPool2d { height, width };
    let resized = |name: &str, shape: [usize; 3], [h, w]: [usize; 2]| {
        network(
            name,
            &shape,
            move |graph, x| vec![graph.resize_bilinear(x, h, w)],
            move |x| vec![x.resize_bilinear(h, w, false)],
        )
    };
    vec![
        layer("conv", Conv2d::<f32>::new(&init.at("a"), 3, 6, 3, uneven), &[3, 13, 10], |l, x| {
            l.forward(x)
        }),
        layer("conv-transposed", up, &[5, 6, 7], |l, x| l.forward(x)),
        layer(
            "batch-norm",
            stirred(BatchNorm2d::<f32>::new(&init.at("c"), 6)),
            &[6, 4, 5],
            |l, x| l.forward(x),
        ),
        layer(
            "frozen-norm",
            stirred(FrozenBatchNorm2d::<f32>::new(&init.at("d"), 6)),
            &[6, 4, 5],
            |l, x| l.forward(x),
        ),
        layer(
            "group-norm",
            stirred(GroupNorm::<f32>::new(&init.at("e"), 3, 12)),
            &[12, 5, 4],
            |l, x| l.forward(x),
        ),
        layer("means-that-divide", mean(2, 3), &[4, 8, 9], |l, x| l.forward(x)),
        layer("means-that-do-not", mean(4, 3), &[4, 7, 8], |l, x| l.forward(x)),
        layer("means-of-few", mean(4, 4), &[4, 2, 3], |l, x| l.forward(x)),
        resized("twice-as-large", [3, 5, 4], [10, 8]),
        resized("a-quarter", [3, 16, 12], [4, 3]),
        resized("another-size", [3, 5, 7], [8, 6]),
        network(
            "largest",
            &[3, 9, 8],
            |graph, x| vec![graph.max_pool2d(x, PoolGeometry::square(3).stride(2).padding(1))],
            |x| vec![x.max_pool2d(PoolGeometry::square(3).stride(2).padding(1))],
        ),
    ]
}

fn encoders() -> Vec<Network> {
    let init = Init::new(5);
    let small = stirred(SmallCnn::<f32>::new(&init.at("small"), 3, 64));
    let residual = Init::new(6);
    let channels = [4, 4, 8, 8, 16, 16];
    let plain = stirred(Pixel2MeshEncoder::<f32>::new(&init.at("p"), channels, EncoderInit::He));
    let skips = Pixel2MeshEncoder::<f32>::new(&residual, channels, EncoderInit::He);
    let skips = stirred(skips.residual(&residual));
    let resnet = |name: &str, config: ResNetConfig| {
        let net = stirred(ResNet::<f32>::new(&init.at(name), &config));
        let own = net.clone();
        network(
            name,
            &[config.inputs, 64, 48],
            move |graph, x| net.to_onnx(graph, x).to_vec(),
            move |x| own.forward_maps(x).to_vec(),
        )
    };
    let narrow = |config: ResNetConfig| ResNetConfig { width: 8, ..config };
    let classes = ResNetConfig { classes: Some(5), ..narrow(ResNetConfig::resnet18()) };
    let classifier = stirred(ResNet::<f32>::new(&init.at("classifier"), &classes));
    let front = ConvFrontEnd { downscale: 2, ..ConvFrontEnd::<f32>::new(&init.at("front")) };
    let vgg = Vgg16::<f32>::features_until_pool(&init.at("vgg"), 5);
    let maps = vgg.clone();
    let inception = |name: &str, kind| {
        let net = stirred(InceptionV3::<f32>::new(&init.at(name), kind));
        layer(name, net, &[3, 75, 75], |l, x| l.forward_features(x))
    };
    let two = |name: &str, net: Pixel2MeshEncoder, side: usize| {
        let own = net.clone();
        network(
            name,
            &[3, side, side],
            move |graph, x| net.to_onnx(graph, x).to_vec(),
            move |x| own.forward(x).to_vec(),
        )
    };
    let (graph_of, head) = (small.clone(), classifier.clone());
    vec![
        network(
            "small-cnn",
            &[3, 50, 44],
            move |graph, x| {
                let made = graph_of.to_onnx(graph, x);
                made.maps.into_iter().chain([made.features]).collect()
            },
            move |x| {
                let maps = small.maps(x);
                let features = small.features(&maps);
                maps.into_iter().chain([features]).collect()
            },
        ),
        two("pixel2mesh-encoder", plain, 64),
        two("pixel2mesh-residual", skips, 72),
        resnet("resnet18", ResNetConfig { inputs: 4, ..ResNetConfig::resnet18() }),
        resnet("resnet50", narrow(ResNetConfig::resnet50()).frozen()),
        network(
            "resnet-classifier",
            &[3, 40, 64],
            move |graph, x| vec![head.head_to_onnx(graph, x)],
            move |x| vec![classifier.forward(x)],
        ),
        layer("conv-front-end", front, &[3, 64, 64], |l, x| l.forward(x)),
        network(
            "vgg16-maps",
            &[3, 64, 32],
            move |graph, x| vgg.maps_to_onnx(graph, x),
            move |x| maps.forward_maps(x),
        ),
        layer("vgg16", Vgg16::<f32>::cut(&init.at("cut"), 1), &[3, 64, 64], |l, x| l.forward(x)),
        inception("inception-fid", InceptionKind::Fid),
        inception("inception-torchvision", InceptionKind::Torchvision),
    ]
}

fn heads() -> Vec<Network> {
    let init = Init::new(7);
    let viewpoint = stirred(ViewpointHead::<f32>::new(&init.at("viewpoint"), 3, 8));
    let own = viewpoint.clone();
    let voxels = VoxelHead::<f32>::new(&init.at("voxels"), 12, 8, 2, 12);
    let cells = voxels.clone();
    let points = stirred(PointMlp::<f32>::new(
        &init.at("points"),
        &PointMlpConfig { hidden: vec![16; 4], ..PointMlpConfig::published(10) },
    ));
    vec![
        network(
            "viewpoint-head",
            &[3, 132, 150],
            move |graph, x| {
                let guess = viewpoint.to_onnx(graph, x);
                vec![guess.logits, guess.turns, guess.elevation, guess.log_distance]
            },
            move |x| {
                let guess = own.forward(x);
                let column = |x: Var<'_>| x.shape()[0];
                let n = column(guess.elevation);
                let [elevation, distance] =
                    [guess.elevation, guess.log_distance].map(|x| x.reshape(&[n, 1]));
                vec![guess.logits, guess.turns, elevation, distance]
            },
        ),
        // Its four axes are no image's.
        Network {
            tape: Box::new(move |inputs| {
                let tape = Tape::eval();
                vec![numbers(cells.forward(tape.constant(channels_last(&inputs[0]))))]
            }),
            ..network(
                "voxel-head",
                &[12, 3, 5],
                move |graph, x| vec![voxels.to_onnx(graph, x)],
                |_| Vec::new(),
            )
        },
        layer(
            "image-decoder",
            louder(ImageDecoder::<f32>::new(&init.at("decoder"), 2, 3)),
            &[32, 2, 1],
            |l, x| l.forward(x),
        ),
        of_points(points),
    ]
}

/// With weights so large that the image is not grey all over.
fn louder(mut decoder: ImageDecoder) -> ImageDecoder {
    decoder.visit_mut("", &mut |_: &str, param: &mut autodiff_lite::Param| {
        param.as_slice_mut().iter_mut().for_each(|x| *x *= 8.0);
    });
    decoder
}

/// Code and points are two inputs.
fn of_points(points: PointMlp) -> Network {
    let mut graph = OnnxGraph::new("point-mlp");
    let code = graph.input("code", &[10]);
    let places = graph.input("points", &[6, 3]);
    let y = points.to_onnx(&mut graph, &code, &places);
    graph.output("y0", &y);
    let tape = move |inputs: &[ArrayD<f32>]| {
        let tape = Tape::eval();
        let [code, places] = [0, 1].map(|k| tape.constant(inputs[k].clone()));
        vec![numbers(points.forward(code, places))]
    };
    Network { name: "point-mlp".to_owned(), model: graph.finish(), tape: Box::new(tape) }
}

/// A system of a preset under settings, as it is before its first step but for what [`stirred`] changes.
fn system<S: Predictor>(name: &str, set: &[(&str, &str)]) -> Network {
    let preset = S::PRESETS.iter().find(|(name, _)| *name == "tiny").unwrap().1;
    let set: Vec<_> = set.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect();
    let config: Configuration<S::Config> =
        train::settings::read_text("tiny".as_ref(), preset, &set).unwrap();
    let system = stirred(S::new(&config.system, 1));
    let model = system.to_onnx().unwrap();
    let tape = Box::new(move |inputs: &[ArrayD<f32>]| system.onnx_outputs(inputs));
    Network { name: name.to_owned(), model, tape }
}

/// Each system, with each of its encoders.
pub(crate) fn systems() -> Vec<Network> {
    vec![
        system::<img2mesh::Img2Mesh>("img2mesh-small", &[("encoder", "small")]),
        system::<img2mesh::Img2Mesh>("img2mesh-mean", &[("attention", "mean")]),
        system::<img2mesh::Img2Mesh>("img2mesh-cnn", &[("encoder", "cnn"), ("image-size", "64")]),
        system::<img2mesh::Img2Mesh>("img2mesh-stages", &[("stages", "1")]),
        system::<img2mesh::Img2Mesh>("img2mesh-camera", &[("camera-embedding", "true")]),
        system::<pixel2mesh::Pixel2Mesh>("pixel2mesh", &[]),
        system::<pixel2mesh::Pixel2Mesh>(
            "pixel2mesh-camera",
            &[("frame", "object"), ("camera-weight", "1"), ("encoder-form", "residual")],
        ),
        system::<pixel2mesh::OdePixel2Mesh>("ode-pixel2mesh", &[]),
        system::<depth::DepthPixel2Mesh>("depth-pixel2mesh", &[]),
        system::<depth::MeshRcnn>("mesh-rcnn", &[]),
        system::<mcmr::Mcmr>("mcmr", &[]),
    ]
}
