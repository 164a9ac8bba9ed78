//! Networks in ONNX's form, for whoever runs them elsewhere.
//!
//! A graph is put together by hand: [`OnnxGraph`] has inputs, operators and outputs, and what implements [`ToOnnx`] adds the nodes of a
//! layer or a network with its weights. Graphs are of opset 17, in `f32`; the first axis of each input and output is the batch, of any
//! size. Images are channels-first there, `[N, C, H, W]`, as every runtime wants them, of the height and width that the graph is made for.
//!
//! ```
//! use nets::onnx::{OnnxGraph, ToOnnx};
//! use nets::{Init, SmallCnn};
//!
//! let encoder = SmallCnn::<f32>::new(&Init::new(0).at("encoder"), 3, 256);
//! let mut graph = OnnxGraph::new("encoder");
//! let image = graph.input("image", &[3, 64, 64]);
//! let made = encoder.to_onnx(&mut graph, &image);
//! graph.output("features", &made.features);
//! let model = graph.finish();
//! assert_eq!(model.outputs[0].shape, [256]); // of each element of the batch
//! let bytes: Vec<u8> = model.to_bytes(); // what encoder.onnx has
//! assert!(bytes.len() > 4 * 1_400_000);
//! ```
//!
//! Networks are exported as they predict: dropout does nothing, batch norms have their running statistics. Group norm, which opset 17
//! lacks, is an instance norm of the groups; means of windows that do not divide an image, and bilinear resizing by a factor that is no
//! power of two, are products with matrices.
//!
//! # References
//! <https://onnx.ai/onnx/operators/> at opset 17; `onnx.proto` for the file.

mod attention;
mod encoders;
mod graph;
mod heads;
mod layers;
mod operators;
mod proto;
mod resample;

use ndarray::ArrayD;

pub use encoders::SmallCnnOnnx;
pub use graph::{OnnxGraph, OnnxModel, OnnxValue};
pub use heads::ViewpointOnnx;

/// Images as graphs take them, in the order of the tape.
///
/// # Shapes
/// `images [N, C, H, W]` → `[N, H, W, C]`.
///
/// # Panics
/// If there are not four axes.
pub fn channels_last(images: &ArrayD<f32>) -> ArrayD<f32> {
    images.view().permuted_axes(&[0, 2, 3, 1][..]).as_standard_layout().into_owned()
}

/// Maps as the tape has them, in the order of graphs.
///
/// # Shapes
/// `maps [N, H, W, C]` → `[N, C, H, W]`.
///
/// # Panics
/// If there are not four axes.
pub fn channels_first(maps: &ArrayD<f32>) -> ArrayD<f32> {
    maps.view().permuted_axes(&[0, 3, 1, 2][..]).as_standard_layout().into_owned()
}

/// What a graph can have as a part.
pub trait ToOnnx {
    /// What it gives: a value, or several.
    type Output;

    /// Adds its nodes behind a value. Where the tape has `[N, H, W, C]` the graph has `[N, C, H, W]`; all else has the same axes.
    ///
    /// # Panics
    /// If the value's shape is none that the layer takes.
    fn to_onnx(&self, graph: &mut OnnxGraph, x: &OnnxValue) -> Self::Output;
}
