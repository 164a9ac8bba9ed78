//! How an estimated depth is wrong within the object: leaning, bent, flattened.

use mesh_core::nalgebra::{Matrix3, Vector3};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

/// Waves that a bend is a sum of.
const WAVES: usize = 4;
/// Their largest frequency, radians for half of the object's box: less than one wave across it, so that a bend is smooth.
const FASTEST: f64 = 3.0;

/// What was drawn for one image.
#[derive(Clone, Debug)]
pub(crate) struct ReliefErrors {
    /// How much the disparity rises along columns and rows, deviations for half of the object's box.
    tilt: [f64; 2],
    /// Deviation of the bend, in deviations of the disparity.
    warp: f64,
    /// Frequencies along columns and rows, and phase.
    waves: [[f64; 3]; WAVES],
    /// The share of the relief that is lost.
    flat: f64,
}

impl ReliefErrors {
    /// Of these sizes, in directions and forms that are drawn.
    pub(crate) fn drawn(tilt: f64, warp: f64, flat: f64, rng: &mut ChaCha8Rng) -> Self {
        let mut turn = || std::f64::consts::TAU * rng.random::<f64>();
        let (sin, cos) = turn().sin_cos();
        let waves = std::array::from_fn(|_| {
            let (direction, phase) = (turn(), turn());
            let frequency = FASTEST * (0.5 + 0.5 * turn() / std::f64::consts::TAU);
            [frequency * direction.cos(), frequency * direction.sin(), phase]
        });
        Self { tilt: [tilt * cos, tilt * sin], warp, waves, flat }
    }

    /// Changes the disparity of the object's pixels; what is beside it stays.
    pub(crate) fn apply(&self, disparity: &mut [f32], width: usize, object: &[bool]) {
        if self.tilt == [0.0; 2] && self.warp == 0.0 && self.flat == 0.0 {
            return;
        }
        let pixels: Vec<usize> = (0..disparity.len()).filter(|&p| object[p]).collect();
        let places = in_box(&pixels, width);
        let values: Vec<f64> = pixels.iter().map(|&p| f64::from(disparity[p])).collect();
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        let deviation = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / n).sqrt();
        let plane = plane(&places, &values);
        for ((&p, &[x, y]), &value) in pixels.iter().zip(&places).zip(&values) {
            let flat = plane[0] + plane[1] * x + plane[2] * y;
            let wave = |[a, b, phase]: [f64; 3]| (a * x + b * y + phase).cos();
            // The sum of so many cosines has half of their number for its variance.
            let bend = self.waves.map(wave).iter().sum::<f64>() / (0.5 * WAVES as f64).sqrt();
            let lean = self.tilt[0] * x + self.tilt[1] * y;
            let bent = value + self.flat * (flat - value);
            disparity[p] = (bent + deviation * (lean + self.warp * bend)) as f32;
        }
    }
}

/// Where pixels are in the box around all of them, from -1 to 1 along each side.
fn in_box(pixels: &[usize], width: usize) -> Vec<[f64; 2]> {
    let at = |p: usize| [(p % width) as f64, (p / width) as f64];
    let mut ends = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
    for &p in pixels {
        for (end, x) in ends.iter_mut().zip(at(p)) {
            *end = [end[0].min(x), end[1].max(x)];
        }
    }
    let of = |x: f64, [low, high]: [f64; 2]| 2.0 * (x - low) / (high - low).max(1.0) - 1.0;
    let place = |&p: &usize| [of(at(p)[0], ends[0]), of(at(p)[1], ends[1])];
    pixels.iter().map(place).collect()
}

/// The affine function of the place that is nearest to the values: its value at the middle, its slopes.
fn plane(places: &[[f64; 2]], values: &[f64]) -> [f64; 3] {
    let mut normal = Matrix3::<f64>::zeros();
    let mut right = Vector3::<f64>::zeros();
    for (&[x, y], &value) in places.iter().zip(values) {
        let row = Vector3::new(1.0, x, y);
        normal += row * row.transpose();
        right += row * value;
    }
    // A single row or column of pixels has no slope across it.
    let epsilon = 1e-9 * normal.norm();
    let found = normal.svd(true, true).solve(&right, epsilon);
    found.map_or([0.0; 3], Into::into)
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::SeedableRng;

    const WIDTH: usize = 30;

    fn errors(tilt: f64, warp: f64, flat: f64, seed: u64) -> ReliefErrors {
        ReliefErrors::drawn(tilt, warp, flat, &mut ChaCha8Rng::seed_from_u64(seed))
    }

    /// A dome on the left two thirds of an image.
    fn dome() -> (Vec<f32>, Vec<bool>) {
        let at = |p: usize| ((p % WIDTH) as f32 / 10.0 - 1.0, (p / WIDTH) as f32 / 10.0 - 1.0);
        let object: Vec<bool> = (0..WIDTH * 20).map(|p| p % WIDTH < 20).collect();
        let disparity = (0..WIDTH * 20).map(|p| {
            let (x, y) = at(p);
            if object[p] { 2.0 - 0.3 * (x * x + y * y) } else { 0.1 }
        });
        (disparity.collect(), object)
    }

    fn deviation(values: &[f64]) -> f64 {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt()
    }

    fn on(object: &[bool], values: &[f32]) -> Vec<f64> {
        values.iter().zip(object).filter(|(_, o)| **o).map(|(v, _)| f64::from(*v)).collect()
    }

    #[test]
    fn what_is_flattened_whole_is_a_plane_and_what_is_beside_stays() {
        let (before, object) = dome();
        let mut after = before.clone();
        errors(0.0, 0.0, 1.0, 1).apply(&mut after, WIDTH, &object);
        let bent = |values: &[f32]| -> f32 {
            let lines = values.chunks(WIDTH).map(|row| &row[..20]);
            let second =
                lines.flat_map(|row| row.windows(3).map(|w| (w[0] - 2.0 * w[1] + w[2]).abs()));
            second.fold(0.0, f32::max)
        };
        assert!(bent(&after) < 1e-5 && bent(&before) > 1e-3);
        let beside = |values: &[f32]| -> Vec<f32> {
            values.iter().zip(&object).filter(|(_, o)| !**o).map(|(v, _)| *v).collect()
        };
        assert_eq!(beside(&before), beside(&after));
        let mut same = before.clone();
        errors(0.0, 0.0, 0.0, 1).apply(&mut same, WIDTH, &object);
        assert_eq!(same, before);
    }

    /// A lean is a plane as steep as it says; a bend has, over many draws, the deviation that it says.
    #[test]
    fn leans_and_bends_are_as_large_as_they_say() {
        let (before, object) = dome();
        let own = deviation(&on(&object, &before));
        let added = |errors: &ReliefErrors| -> Vec<f64> {
            let mut after = before.clone();
            errors.apply(&mut after, WIDTH, &object);
            let pairs = on(&object, &after).into_iter().zip(on(&object, &before));
            pairs.map(|(a, b)| a - b).collect()
        };
        let lean = added(&errors(0.8, 0.0, 0.0, 5));
        // Of a plane over a square from -1 to 1 whose slope has length 1 the deviation is 1/√3, whatever its direction.
        assert!(
            (deviation(&lean) / own - 0.8 / 3.0_f64.sqrt()).abs() < 0.06,
            "{}",
            deviation(&lean) / own
        );
        let squares: f64 = (0..60)
            .map(|seed| {
                let bend = added(&errors(0.0, 0.5, 0.0, seed));
                bend.iter().map(|b| b * b).sum::<f64>() / bend.len() as f64
            })
            .sum();
        let bend = (squares / 60.0).sqrt() / own;
        assert!((0.4..0.6).contains(&bend), "{bend}");
    }

    #[test]
    fn a_line_of_pixels_and_none_are_no_trouble() {
        let mut line = vec![1.0, 2.0, 3.0, 0.0];
        errors(0.5, 0.5, 0.5, 2).apply(&mut line, 4, &[true, true, true, false]);
        assert!(line.iter().all(|v| v.is_finite()));
        let mut none = vec![1.0; 4];
        errors(0.5, 0.5, 0.5, 2).apply(&mut none, 4, &[false; 4]);
        assert_eq!(none, [1.0; 4]);
    }
}
