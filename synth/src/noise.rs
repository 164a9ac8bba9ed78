//! Solid noise: the same at the same place, for any seed.

use fnv::FnvHasher;
use std::hash::Hasher as _;

/// A number in `[0, 1)` for each cell of space.
fn hash(cell: [i32; 3], seed: u64) -> f32 {
    let mut key = keyed(seed);
    for k in cell {
        key = with(key, k);
    }
    number(key)
}

/// FNV's state behind a seed.
fn keyed(seed: u64) -> u64 {
    let mut hasher = FnvHasher::default();
    hasher.write_u64(seed);
    hasher.finish()
}

/// FNV's state behind one more coordinate.
fn with(key: u64, coordinate: i32) -> u64 {
    let mut hasher = FnvHasher::with_key(key);
    hasher.write_i32(coordinate);
    hasher.finish()
}

/// A number in `[0, 1)`, of a state.
fn number(mut bits: u64) -> f32 {
    // FNV leaves the last bytes in the low bits: they are mixed down from all.
    bits ^= bits >> 33;
    bits = bits.wrapping_mul(0xff51_afd7_ed55_8ccd);
    bits ^= bits >> 33;
    (bits >> 40) as f32 / (1u64 << 24) as f32
}

/// Smooth noise of period 1.
fn value(p: [f32; 3], seed: u64) -> f32 {
    let cell = p.map(f32::floor);
    let mut weights = [[0.0; 2]; 3];
    for a in 0..3 {
        let t = p[a] - cell[a];
        let t = t * t * (3.0 - 2.0 * t);
        weights[a] = [1.0 - t, t];
    }
    let [i, j, k] = cell.map(|v| v as i32);
    // Corners share what they have in common of their hashes.
    let mut corners = [0.0; 8];
    let seeded = keyed(seed);
    for x in 0..2 {
        let in_x = with(seeded, i + x as i32);
        for y in 0..2 {
            let in_y = with(in_x, j + y as i32);
            for z in 0..2 {
                let weight = weights[0][x] * weights[1][y] * weights[2][z];
                corners[4 * z + 2 * y + x] = weight * number(with(in_y, k + z as i32));
            }
        }
    }
    corners.iter().sum()
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
    fn corners_share_what_their_hashes_have_in_common() {
        let (seed, t) = (9, 0.25f32 * 0.25 * (3.0 - 0.5));
        for cell in [[0, 0, 0], [3, -7, 12]] {
            let p = cell.map(|v| v as f32 + 0.25);
            let mut plain = 0.0;
            for corner in 0..8usize {
                let on: [i32; 3] = std::array::from_fn(|a| (corner >> a & 1) as i32);
                let weight: f32 = on.iter().map(|&on| if on == 1 { t } else { 1.0 - t }).product();
                plain += weight * hash(std::array::from_fn(|a| cell[a] + on[a]), seed);
            }
            assert_eq!(value(p, seed), plain);
        }
    }

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
