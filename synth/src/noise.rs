//! Solid noise: the same at the same place, for any seed.

use fnv::FnvHasher;
use std::hash::Hasher as _;

/// A number in `[0, 1)` for each cell of space.
fn hash(cell: [i32; 3], seed: u64) -> f32 {
    let mut hasher = FnvHasher::default();
    hasher.write_u64(seed);
    for k in cell {
        hasher.write_i32(k);
    }
    // FNV leaves the last bytes in the low bits: they are mixed down from all.
    let mut bits = hasher.finish();
    bits ^= bits >> 33;
    bits = bits.wrapping_mul(0xff51_afd7_ed55_8ccd);
    bits ^= bits >> 33;
    (bits >> 40) as f32 / (1u64 << 24) as f32
}

/// Smooth noise of period 1.
fn value(p: [f32; 3], seed: u64) -> f32 {
    let cell = p.map(f32::floor);
    let t: [f32; 3] = std::array::from_fn(|a| {
        let t = p[a] - cell[a];
        t * t * (3.0 - 2.0 * t)
    });
    (0..8)
        .map(|corner: usize| {
            let on = |a: usize| corner >> a & 1;
            let at = std::array::from_fn(|a| cell[a] as i32 + on(a) as i32);
            let weight: f32 = (0..3).map(|a| if on(a) == 1 { t[a] } else { 1.0 - t[a] }).product();
            weight * hash(at, seed)
        })
        .sum()
}

/// A sum of octaves, each twice as fine and about half as strong, in `[0, 1]`.
pub(crate) fn clouds(p: [f32; 3], octaves: u32, seed: u64) -> f32 {
    let (mut sum, mut weights) = (0.0, 0.0);
    for octave in 0..octaves {
        let (fine, weight) = ((1u32 << octave) as f32, 0.6f32.powi(octave as i32));
        sum += weight * value(p.map(|v| fine * v + 0.37 * octave as f32), seed + u64::from(octave));
        weights += weight;
    }
    sum / weights
}

/// Scraps of any colour, one a cell of space, over another layer of them.
pub(crate) fn scatter(p: [f32; 3], seed: u64) -> [f32; 3] {
    let layer = |p: [f32; 3], seed: u64, radius: f32| {
        let cell = p.map(|v| v.floor() as i32);
        let middle: [f32; 3] =
            std::array::from_fn(|a| 0.3 + 0.4 * hash(cell, seed ^ (a as u64 + 11)));
        let apart: f32 =
            (0..3).map(|a| (p[a] - p[a].floor() - middle[a]).powi(2)).sum::<f32>().sqrt();
        (apart < radius).then(|| std::array::from_fn(|c| hash(cell, seed ^ (c as u64 + 21))))
    };
    layer(p, seed, 0.45)
        .or_else(|| layer(p.map(|v| 1.7 * v + 0.5), seed ^ 0x28, 0.5))
        .unwrap_or_else(|| [0.85 * clouds(p, 2, seed ^ 0x32); 3])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_smooth_and_fills_its_range() {
        let line: Vec<f32> =
            (0..4000).map(|k| clouds([k as f32 * 0.01, 0.3, -7.2], 4, 3)).collect();
        let (low, high) = line.iter().fold((1.0f32, 0.0f32), |(a, b), v| (a.min(*v), b.max(*v)));
        assert!(low > 0.0 && low < 0.3 && high < 1.0 && high > 0.7, "{low} {high}");
        let steepest = line.windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f32::max);
        assert!(steepest < 0.12, "{steepest}");
        assert_ne!(clouds([0.5; 3], 4, 3), clouds([0.5; 3], 4, 4));
    }
}
