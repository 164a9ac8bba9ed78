//! How likely colours are: histograms in CIELAB.
//!
//! A textured object has more colours than a few Gaussians hold, and all views together have samples enough for cells.

use mesh_core::{ByteImage, srgb_to_linear};

/// Cells along lightness, green to red, blue to yellow; each is [`CELL`] units wide.
const CELLS: [usize; 3] = [18, 34, 36];
/// The side of a cell: about three times what an eye tells apart.
const CELL: f32 = 6.0;
/// Where the first cell of each axis begins.
const FIRST: [f32; 3] = [-3.0, -98.0, -114.0];

/// An image in CIELAB under D65: lightness 0 to 100, green to red, blue to yellow.
pub(super) fn lab(color: &ByteImage) -> Vec<[f32; 3]> {
    let linear: Vec<f32> = (0..=255).map(|v| srgb_to_linear(v as f32 / 255.0)).collect();
    let bend = |t: f32| {
        if t > 216.0 / 24389.0 { t.cbrt() } else { (24389.0 / 27.0 * t + 16.0) / 116.0 }
    };
    let of = |p: &[u8]| {
        let [r, g, b] = [p[0], p[1], p[2]].map(|v| linear[usize::from(v)]);
        let x = bend((0.412_456 * r + 0.357_576 * g + 0.180_438 * b) / 0.950_47);
        let y = bend(0.212_673 * r + 0.715_152 * g + 0.072_175 * b);
        let z = bend((0.019_334 * r + 0.119_192 * g + 0.950_304 * b) / 1.088_83);
        [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
    };
    color.data.chunks_exact(color.channels).map(of).collect()
}

/// A cell of the histogram.
pub(super) fn cell(lab: [f32; 3]) -> u16 {
    let at: [usize; 3] =
        std::array::from_fn(|k| (((lab[k] - FIRST[k]) / CELL).max(0.0) as usize).min(CELLS[k] - 1));
    ((at[0] * CELLS[1] + at[1]) * CELLS[2] + at[2]) as u16
}

/// How often each colour was met.
#[derive(Clone, Debug)]
pub(super) struct Palette {
    counts: Vec<f32>,
}

impl Palette {
    pub(super) fn new() -> Self {
        Self { counts: vec![0.0; CELLS.iter().product()] }
    }

    pub(super) fn count(&mut self, cell: u16) {
        self.counts[usize::from(cell)] += 1.0;
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.counts.iter_mut().zip(&other.counts).for_each(|(to, from)| *to += from);
    }

    /// How many cells there are.
    pub(super) fn len(&self) -> usize {
        self.counts.len()
    }

    /// The same spread over the neighbouring cells, and as shares of one.
    pub(super) fn smooth(&self) -> Self {
        let mut counts = self.counts.clone();
        let strides = [CELLS[1] * CELLS[2], CELLS[2], 1];
        for axis in 0..3 {
            let from = counts.clone();
            for (k, to) in counts.iter_mut().enumerate() {
                let at = k / strides[axis] % CELLS[axis];
                let below = if at > 0 { from[k - strides[axis]] } else { from[k] };
                let above = if at + 1 < CELLS[axis] { from[k + strides[axis]] } else { from[k] };
                *to = 0.25 * below + 0.5 * from[k] + 0.25 * above;
            }
        }
        let total = counts.iter().sum::<f32>().max(f32::MIN_POSITIVE);
        for n in &mut counts {
            *n /= total;
        }
        Self { counts }
    }

    /// Halfway between two that were smoothed.
    pub(super) fn with(&self, other: &Self) -> Self {
        let counts = self.counts.iter().zip(&other.counts).map(|(a, b)| 0.5 * (a + b)).collect();
        Self { counts }
    }

    /// The share of a cell.
    pub(super) fn share(&self, cell: usize) -> f32 {
        self.counts[cell]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_have_the_published_coordinates() {
        let data = vec![255, 255, 255, 0, 0, 0, 255, 0, 0, 0, 255, 0, 0, 0, 255, 119, 119, 119];
        let found = lab(&ByteImage { height: 1, width: 6, channels: 3, data });
        let wanted = [
            [100.0, 0.0, 0.0],
            [0.0, 0.0, 0.0],
            [53.24, 80.09, 67.20],
            [87.73, -86.18, 83.18],
            [32.30, 79.19, -107.86],
            [50.03, 0.0, 0.0],
        ];
        for (found, wanted) in found.iter().zip(&wanted) {
            let off = (0..3).map(|k| (found[k] - wanted[k]).abs()).fold(0.0, f32::max);
            assert!(off < 0.05, "{found:?} for {wanted:?}");
        }
    }

    #[test]
    fn no_color_falls_beside_the_cells() {
        let levels = [0, 51, 102, 153, 204, 255];
        let data: Vec<u8> = levels
            .iter()
            .flat_map(|&r| levels.iter().map(move |&g| [r, g]))
            .flat_map(|[r, g]| levels.iter().flat_map(move |&b| [r, g, b]))
            .collect();
        let cells: std::collections::BTreeSet<u16> =
            lab(&ByteImage { height: 6, width: 36, channels: 3, data })
                .into_iter()
                .map(cell)
                .collect();
        // Two of such steps are never one colour.
        assert!(cells.len() > 205, "{}", cells.len());
        let mut palette = Palette::new();
        for &cell in &cells {
            palette.count(cell);
        }
        let smooth = palette.smooth();
        let total: f32 = (0..smooth.len()).map(|k| smooth.share(k)).sum();
        assert!((total - 1.0).abs() < 1e-4);
        assert!(cells.iter().all(|&cell| smooth.share(cell.into()) > 0.0));
    }
}
