//! A stage that looks at the views where each vertex is seen.

use autodiff_lite::{Activation, Param, Var, impl_module};
use ndarray::Array1;
use nets::{
    GraphConv, Init, LayerNorm, Linear, MapSampling, MultiHeadAttention, SmallCnn, pool_linear,
};

use super::config::Img2MeshConfig;
use super::level::Level;
use super::observation::{FACING, Observations, SIGNALS, VISIBLE};

/// Vertex-aligned features of every view, attention over the views at each vertex, graph convolutions.
///
/// ```text
/// e = ReLU(W maps(π_k(p)) + W' signals)                       each view k, [N, V, K, H]
/// s = ReLU(W'' [place, what the stage before left there])     [N, V, H]
/// h = norm(W''' [s, attention(s over e), mean e, variance e])
/// h = h + ReLU(graph convolution(h))                          so many times
/// p + tanh(W h) / 2,  colour = g Σ_k softmax(b_k) colour_k + (1 - g) colour before,  g = sigmoid(W h)
/// ```
///
/// `π_k` is the camera of view `k`. The offset begins at zero: a new stage leaves the mesh where it is.
///
/// # References
/// Wen et al. 2019, *Pixel2Mesh++*, section 3.2 (cross-view features of vertices, their mean, largest and deviation); Wang et
/// al. 2018, *Pixel2Mesh*, sections 3.3 and 3.4 (pooling at vertices, coarse to fine). Attention instead of statistics is the
/// seed's, put at each vertex.
#[derive(Clone, Debug)]
pub(super) struct ViewStage {
    bottleneck: Linear,
    signals: Linear,
    state: Linear,
    attention: MultiHeadAttention,
    merge: Linear,
    norm: LayerNorm,
    gconvs: Vec<GraphConv>,
    offset: Linear,
    /// How much each view's colour counts.
    blend: Linear,
    /// How much the views' colours count beside the colour before.
    gate: Linear,
}
impl_module!(ViewStage: f32 { bottleneck, signals, state, attention, merge, norm, gconvs, offset, blend, gate });

/// The longest offset of a stage along an axis, in the model's frame.
const LONGEST: f32 = 0.5;
/// How much more a view counts at first, of which the surface is seen, and squarely.
const SEEN_FIRST: f32 = 4.0;

/// A mesh after a stage.
#[derive(Clone, Copy, Debug)]
pub(super) struct Refined<'t> {
    /// `[N, V, 3]`.
    pub(super) offset: Var<'t>,
    /// `[N, V, 3]`.
    pub(super) colors: Var<'t>,
    /// `[N, V, H]`.
    pub(super) hidden: Var<'t>,
}

impl ViewStage {
    /// The maps of the encoder that are looked at, and their channels together.
    const MAPS: std::ops::Range<usize> = 1..4;

    /// A stage for features of `previous` numbers of the stage before.
    pub(super) fn new(init: &Init, config: &Img2MeshConfig, previous: usize) -> Self {
        let hidden = config.vertex_features;
        let he = |name: &str, inputs: usize| {
            let at = init.at(name);
            Linear::normal(&at, inputs, hidden, (2.0 / inputs as f64).sqrt())
        };
        let gconv = |i: usize| {
            let at = init.at("gconvs").index(i);
            let part = |name: &str| {
                Linear::normal(&at.at(name), hidden, hidden, (0.5 / hidden as f64).sqrt())
            };
            GraphConv { w0: part("w0"), w1: part("w1") }
        };
        let mut gate = Linear::zeros(&init.at("gate"), hidden, 1);
        // The views' colours at first, where it is not known better.
        gate.bias = Some(Param::new(Array1::from(vec![2.0])));
        Self {
            bottleneck: Linear { bias: None, ..he("bottleneck", Self::channels()) },
            signals: he("signals", SIGNALS),
            state: he("state", 6 + previous),
            attention: MultiHeadAttention::new(&init.at("attention"), hidden, config.vertex_heads),
            merge: he("merge", 4 * hidden),
            norm: LayerNorm::new(&init.at("norm"), hidden),
            gconvs: (0..config.graph_convolutions).map(gconv).collect(),
            offset: Linear::zeros(&init.at("offset"), hidden, 3),
            blend: Linear::zeros(&init.at("blend"), hidden, 1),
            gate,
        }
    }

    /// Channels of all maps together.
    fn channels() -> usize {
        SmallCnn::<f32>::CHANNELS[Self::MAPS].iter().sum()
    }

    /// Trained numbers of a stage.
    pub(super) fn parameters(config: &Img2MeshConfig, previous: usize) -> usize {
        let h = config.vertex_features;
        let linear = |inputs: usize, outputs: usize| outputs * (inputs + 1);
        let looks = Self::channels() * h + linear(SIGNALS, h) + linear(6 + previous, h);
        let attention = 4 * linear(h, h);
        let merge = linear(4 * h, h) + 2 * h;
        let ends = linear(h, 3) + 2 * linear(h, 1);
        looks + attention + merge + config.graph_convolutions * 2 * linear(h, h) + ends
    }

    /// `maps` of `N K` images, what they show, what the stage before left at the vertices `[N, V, previous]`, and their colours
    /// before `[N, V, 3]`.
    pub(super) fn forward<'t>(
        &self,
        maps: &[Var<'t>],
        seen: &Observations<'t>,
        previous: Var<'t>,
        colors: Var<'t>,
        level: &Level,
    ) -> Refined<'t> {
        let tape = previous.tape();
        let ([n, v, _], [m, _, _]) = (previous.dims(), seen.signals.dims());
        let (k, h) = (m / n, self.norm.weight.shape()[0]);
        let maps = &maps[Self::MAPS];
        let pooled = pool_linear(
            maps,
            seen.points,
            MapSampling::Bilinear,
            &self.bottleneck,
            Activation::None,
        );
        let token = (pooled + self.signals.forward(seen.signals)).relu();
        // Views of a vertex side by side.
        let by_vertex = |x: Var<'t>, width: usize| {
            x.reshape(&[n, k, v, width]).permute(&[0, 2, 1, 3]).reshape(&[n * v, k, width])
        };
        let tokens = by_vertex(token, h);
        let state = tape.concat(&[seen.places, previous], 2);
        let state = self.state.forward_then(state, Activation::Relu).reshape(&[n * v, h]);
        let attended = self.attention.cross(state.reshape(&[n * v, 1, h]), tokens, None);
        let mean = tokens.mean_axis(1);
        let variance = tokens.square().mean_axis(1) - mean.square();
        let merged = tape.concat(&[state, attended.reshape(&[n * v, h]), mean, variance], 1);
        let mut hidden = self.norm.forward(self.merge.forward(merged)).reshape(&[n, v, h]);
        for gconv in &self.gconvs {
            hidden = hidden + gconv.forward_then(hidden, &level.graph, Activation::Relu);
        }
        let offset = self.offset.forward_then(hidden, Activation::Tanh).scale(LONGEST);
        let logits = self.blend.forward(tokens).reshape(&[n * v, k])
            + by_vertex(squarely(seen), 1).reshape(&[n * v, k]);
        let shares = logits.softmax().reshape(&[n * v, k, 1]);
        let shown = (by_vertex(seen.colors, 3) * shares).sum_axis(1).reshape(&[n, v, 3]);
        let gate = self.gate.forward_then(hidden, Activation::Sigmoid);
        let colors = colors + (shown - colors) * gate;
        Refined { offset, colors, hidden }
    }
}

/// How much views count for a vertex's colour before anything was learned: `[N K, V, 1]`.
fn squarely<'t>(seen: &Observations<'t>) -> Var<'t> {
    let at = |i: usize| seen.signals.slice_axis(2, i..i + 1);
    (at(FACING).relu() * at(VISIBLE)).scale(SEEN_FIRST)
}
