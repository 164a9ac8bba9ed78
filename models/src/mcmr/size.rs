//! How large the model is, without making it.

use nets::{NormKind, ViewpointHead};
use train::Summary;

use super::config::{CameraHead, McmrConfig};
use crate::viewpoint::DIRECTIONS;

/// Trainable parameter count, those that are not, and the shapes between the parts.
pub(super) fn summary(config: &McmrConfig) -> Summary {
    let linear = |inputs: usize, outputs: usize| outputs * (inputs + 1);
    let normed = |inputs: usize, outputs: usize| linear(inputs, outputs) + 2 * outputs;
    let McmrConfig { width, features, head, hidden, shapes, .. } = *config;
    let map = 16 * config.texture_width;
    let side = config.image_size / 64;
    // A convolution without bias, and the two numbers a channel of its norm.
    let conv = |k: usize, i: usize, o: usize| k * k * i * o + 2 * o;
    let mut encoder = conv(7, 3, width);
    for stage in 0..4 {
        let [i, o] = [width << stage.max(1) >> 1, width << stage];
        encoder += conv(3, i, o) + 3 * conv(3, o, o);
        encoder += if stage > 0 { conv(1, i, o) } else { 0 };
    }
    let neck = linear(4 * 4 * 8 * width, map) + 2 * map;
    let code = normed(side * side * map, features);
    let selection = normed(features, head) + linear(head, shapes);
    let camera = normed(features, head) + linear(head, 7);
    // A weight-normed layer has a length a row besides.
    let first = features + shapes + 3;
    let layer = |inputs: usize| linear(inputs, hidden) + hidden;
    let offsets = layer(first) + 2 * layer(hidden) + layer(hidden + first) + linear(hidden, 3);
    let spheres = shapes * config.vertices() * 3;
    let viewpoint = match config.camera_head {
        CameraHead::Quaternion => 0,
        CameraHead::Viewpoint => ViewpointHead::<f32>::parameters(3, DIRECTIONS),
    };
    let trainable = encoder
        + viewpoint
        + neck
        + code
        + selection
        + camera
        + offsets
        + spheres
        + decoder(config.texture_width);
    // Running means and variances: as many as norms have weights and biases.
    let norms = {
        let stages: usize = (0..4).map(|k| (width << k) * if k > 0 { 5 } else { 4 }).sum();
        width + stages + map + features + 2 * head
    };
    let vertices = config.vertices();
    let finest = if config.subdivide_at.is_some() { 4 * vertices - 6 } else { vertices };
    let shapes = [
        ("images", format!("[N, {0}, {0}, 3]", config.image_size)),
        ("code", format!("[N, {features}]")),
        ("mean shapes", format!("[{shapes}, {vertices}, 3]")),
        ("mesh", format!("[N, {finest}, 3], {} faces", 2 * finest - 4)),
        ("texture", format!("[N, {0}, {0}, 3]", config.image_size)),
    ];
    let shapes = shapes.map(|(name, shape)| (name.to_owned(), shape)).into();
    // Those behind convolutions are all but the three of codes and heads.
    let rows = features + 2 * head;
    let [trainable, frozen] = match config.norm {
        NormKind::Batch => [trainable, 2 * norms],
        NormKind::Frozen => [trainable - 2 * (norms - rows), 4 * (norms - rows) + 2 * rows],
        NormKind::Group => [trainable, 0],
    };
    Summary { trainable, frozen, shapes }
}

/// Numbers of the texture decoder.
fn decoder(width: usize) -> usize {
    let conv = |i: usize, o: usize| 9 * i * o + o;
    let block = |i: usize, o: usize| {
        let middle = i.min(o);
        let shortcut = if i == o { 0 } else { i * o };
        conv(i, middle) + conv(middle, o) + shortcut
    };
    let w = |k: usize| k * width;
    let same = 3 * block(w(16), w(16));
    let up = [(16, 8), (8, 4), (4, 2), (2, 1)].map(|(i, o)| block(w(i), w(o)));
    same + up.iter().sum::<usize>() + conv(width, 3)
}
