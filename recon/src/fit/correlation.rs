//! Normalised cross-correlation of two images, window by window.

use super::gray_image::GrayImage;

/// Half the side of a window, without its middle.
const REACH: usize = 3;
/// A window of which the standard deviation is less shows nothing; sRGB from 0 to 1.
const FLAT: f32 = 0.01;

/// An image's own sums over windows; only pixels of its mask count.
pub(super) struct Windows<'a> {
    image: &'a GrayImage,
    count: Vec<f32>,
    sum: Vec<f32>,
    /// Of the squares, less the mean's.
    square: Vec<f32>,
}

/// Sums over windows of what is compared, in memory that is kept.
#[derive(Default)]
pub(super) struct Sums {
    values: [Vec<f32>; 3],
    boxed: [Vec<f32>; 3],
    row: Vec<f32>,
}

impl<'a> Windows<'a> {
    pub(super) fn new(image: &'a GrayImage) -> Self {
        let mask: Vec<f32> = image.mask.iter().map(|&m| f32::from(u8::from(m))).collect();
        let masked = |f: &dyn Fn(f32) -> f32| -> Vec<f32> {
            image.brightness.iter().zip(&mask).map(|(&b, m)| m * f(b)).collect()
        };
        let boxed = |values: &[f32]| {
            let (mut row, mut out) = (Vec::new(), Vec::new());
            box_sums(values, image.size, 0..image.size[1], &mut row, &mut out);
            out
        };
        let (count, sum) = (boxed(&mask), boxed(&masked(&|b| b)));
        let mut square = boxed(&masked(&|b| b * b));
        for ((square, sum), count) in square.iter_mut().zip(&sum).zip(&count) {
            *square = (*square - sum * sum / count.max(1.0)).max(0.0);
        }
        Self { image, count, sum, square }
    }

    /// Whether the window around a pixel shows anything.
    pub(super) fn is_textured(&self, pixel: usize) -> bool {
        self.square[pixel] >= self.count[pixel].max(1.0) * FLAT * FLAT
    }

    /// The rows that windows around some rows reach.
    pub(super) fn reached(&self, rows: &std::ops::Range<usize>) -> std::ops::Range<usize> {
        rows.start.saturating_sub(REACH)..(rows.end + REACH).min(self.image.size[1])
    }

    /// The correlation with another image of the same size in some rows, from -1 to 1; pixels out of the mask are left as they are.
    pub(super) fn correlate(
        &self,
        other: &[f32],
        rows: std::ops::Range<usize>,
        sums: &mut Sums,
        out: &mut [f32],
    ) {
        let own = &self.image.brightness;
        let [w, _] = self.image.size;
        let Sums { values, boxed, row } = sums;
        let [plain, square, product] = values;
        for values in [&mut *plain, &mut *square, &mut *product] {
            values.resize(own.len(), 0.0);
        }
        let reached = self.reached(&rows);
        for pixel in reached.start * w..reached.end * w {
            let v = if self.image.mask[pixel] { other[pixel] } else { 0.0 };
            plain[pixel] = v;
            square[pixel] = v * v;
            product[pixel] = v * own[pixel];
        }
        for (values, boxed) in [&*plain, &*square, &*product].into_iter().zip(&mut *boxed) {
            box_sums(values, self.image.size, rows.clone(), row, boxed);
        }
        let [plain, square, product] = &*boxed;
        for pixel in rows.start * w..rows.end * w {
            if !self.image.mask[pixel] {
                continue;
            }
            let share = 1.0 / self.count[pixel];
            let varies = (square[pixel] - plain[pixel] * plain[pixel] * share).max(0.0);
            let together = product[pixel] - plain[pixel] * self.sum[pixel] * share;
            // What varies less than noise does not correlate, whatever the noise says.
            let least = 0.1 * self.count[pixel] * FLAT * FLAT;
            out[pixel] = together / ((varies + least) * (self.square[pixel] + least)).sqrt();
        }
    }
}

/// Sums over the window around each pixel of some rows.
fn box_sums(
    values: &[f32],
    [w, h]: [usize; 2],
    rows: std::ops::Range<usize>,
    row: &mut Vec<f32>,
    out: &mut Vec<f32>,
) {
    out.resize(w * h, 0.0);
    row.clear();
    row.resize(w + 2 * REACH, 0.0);
    for j in rows {
        // Few enough that they are added anew: sums that slide for long would lose their last digits.
        row.fill(0.0);
        for other in j.saturating_sub(REACH)..(j + REACH + 1).min(h) {
            for (sum, v) in row[REACH..].iter_mut().zip(&values[other * w..(other + 1) * w]) {
                *sum += v;
            }
        }
        let out = &mut out[j * w..(j + 1) * w];
        out.copy_from_slice(&row[..w]);
        for shift in 1..=2 * REACH {
            for (out, v) in out.iter_mut().zip(&row[shift..]) {
                *out += v;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// By hand: a ramp's windows inside are 49 pixels, those in a corner 16.
    #[test]
    fn windows_are_summed_and_end_at_the_border() {
        let (w, h) = (9, 8);
        let values: Vec<f32> = (0..w * h).map(|k| (k % w) as f32).collect();
        let (mut row, mut out) = (Vec::new(), Vec::new());
        box_sums(&values, [w, h], 0..h, &mut row, &mut out);
        assert_eq!(out[4 * w + 4], 7.0 * (1..=7).sum::<usize>() as f32);
        assert_eq!(out[0], 4.0 * (0.0 + 1.0 + 2.0 + 3.0));
        assert_eq!(out[w * h - 1], 4.0 * (5.0 + 6.0 + 7.0 + 8.0));
    }
}
