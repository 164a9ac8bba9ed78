//! Images of another size: means of windows that share them out, and bilinear blends.

use autodiff_lite::PoolGeometry;

use super::graph::{OnnxGraph, OnnxValue};
use super::proto::Attribute;

/// What each of `outputs` places along an axis takes of the `inputs` there are: `[outputs, inputs]`.
type Shares = Vec<f32>;

/// The mean from `floor(i inputs / outputs)` to `ceil((i + 1) inputs / outputs)`.
fn means(inputs: usize, outputs: usize) -> Shares {
    let mut shares = vec![0.0; inputs * outputs];
    for (i, row) in shares.chunks_mut(inputs).enumerate() {
        let (from, to) = (i * inputs / outputs, ((i + 1) * inputs).div_ceil(outputs));
        row[from..to].fill(1.0 / (to - from) as f32);
    }
    shares
}

/// Between the two pixels next to a place, the edges of the image staying where they are.
fn blends(inputs: usize, outputs: usize) -> Shares {
    let mut shares = vec![0.0; inputs * outputs];
    for (i, row) in shares.chunks_mut(inputs).enumerate() {
        let place = ((i as f64 + 0.5) * inputs as f64 / outputs as f64 - 0.5).max(0.0);
        let (low, share) = (place as usize, place.fract() as f32);
        row[low] += 1.0 - share;
        row[(low + 1).min(inputs - 1)] += share;
    }
    shares
}

fn transposed(shares: &[f32], columns: usize) -> Shares {
    let rows = shares.len() / columns;
    (0..shares.len()).map(|at| shares[(at % rows) * columns + at / rows]).collect()
}

impl OnnxGraph {
    /// The means of `height x width` windows that share out the image.
    pub fn adaptive_avg_pool2d(&mut self, x: &OnnxValue, height: usize, width: usize) -> OnnxValue {
        let [_, h, w] = x.image();
        if h.is_multiple_of(height) && w.is_multiple_of(width) {
            let kernel = [h / height, w / width];
            let geometry = PoolGeometry { kernel, stride: kernel, padding: [0; 2] };
            return if kernel == [1, 1] { x.clone() } else { self.avg_pool2d(x, geometry) };
        }
        self.shared(x, [height, width], means)
    }

    /// Bilinear, without antialiasing, corners not aligned.
    pub fn resize_bilinear(&mut self, x: &OnnxValue, height: usize, width: usize) -> OnnxValue {
        let [c, h, w] = x.image();
        if [h, w] == [height, width] {
            return x.clone();
        }
        // Where a float says the factor, and the product is the size.
        let exact = |from: usize, to: usize| {
            let (large, small) = (from.max(to), from.min(to));
            large.is_multiple_of(small) && (large / small).is_power_of_two()
        };
        if exact(h, height) && exact(w, width) {
            let factors = [1.0, 1.0, height as f32 / h as f32, width as f32 / w as f32];
            let factors = self.constant("scales", &[4], &factors);
            let attributes = vec![
                Attribute::text("mode", "linear"),
                Attribute::text("coordinate_transformation_mode", "half_pixel"),
            ];
            return self.node("Resize", &[&x.name, "", &factors], attributes, &[c, height, width]);
        }
        self.shared(x, [height, width], blends)
    }

    /// Means of the pixels of each 3x3 window that are there.
    pub(super) fn mean_inside(&mut self, x: &OnnxValue, window: PoolGeometry) -> OnnxValue {
        let [_, h, w] = x.image();
        let there = |i: usize, n: usize| 1 + usize::from(i > 0) + usize::from(i + 1 < n);
        let factors: Vec<f32> =
            (0..h * w).map(|at| 9.0 / (there(at / w, h) * there(at % w, w)) as f32).collect();
        let y = self.avg_pool2d(x, window);
        self.mul_constant(&y, "inside", &[1, h, w], &factors)
    }

    /// Rows and columns as shares of the image's.
    fn shared(
        &mut self,
        x: &OnnxValue,
        [height, width]: [usize; 2],
        shares: impl Fn(usize, usize) -> Shares,
    ) -> OnnxValue {
        let [c, h, w] = x.image();
        let rows = self.constant("rows", &[height, h], &shares(h, height));
        let columns = transposed(&shares(w, width), w);
        let columns = self.constant("columns", &[w, width], &columns);
        let y = self.node("MatMul", &[&rows, &x.name], Vec::new(), &[c, height, w]);
        self.node("MatMul", &[&y.name, &columns], Vec::new(), &[c, height, width])
    }
}
