//! Which elements dropout keeps, as bits, and their application.
//!
//! Randomness is drawn in chunks, each from its own place in the stream, so that threads share
//! the work and the bits do not depend on how many there are. Each element takes 16 random bits.

use rand::Rng;
use rand_chacha::ChaCha8Rng;

use crate::Real;
use crate::kernels::blocks::for_each_part;
use crate::kernels::elementwise::{CHUNK, PARALLEL_FROM};
use crate::kernels::simd::clones;

/// Words of bits that are drawn together: 8192 elements.
const WORDS: usize = 256;

/// Words of the stream that an element's word of 32 neighbours takes.
const RANDOM: usize = 16;

/// Which elements dropout keeps: one bit each, 32 to a number, and what they are multiplied by.
#[derive(Clone, Copy, Debug)]
pub struct Kept<'a, F> {
    /// At least as many bits as elements.
    pub bits: &'a [u32],
    /// One over the share that is kept.
    pub scale: F,
}

/// What of 65536 elements falls away at probability `p`: the nearest number, at most 65535.
pub fn dropped(p: f64) -> u16 {
    (p * 65536.0).round().clamp(0.0, 65535.0) as u16
}

/// For each element a bit that is 0 with probability `dropped / 65536`, from the beginning of a
/// stream of `rng`.
pub fn draw(rng: &ChaCha8Rng, dropped: u16, bits: &mut [u32]) {
    let parallel = 32 * bits.len() >= PARALLEL_FROM / 4;
    for_each_part(bits, WORDS, parallel, |chunk, bits| {
        let mut rng = rng.clone();
        rng.set_word_pos((chunk * WORDS * RANDOM) as u128);
        let mut random = [0; 4 * RANDOM * WORDS];
        let random = &mut random[..4 * RANDOM * bits.len()];
        rng.fill_bytes(random);
        compare(random, dropped, bits);
    });
}

#[inline(always)]
fn compare_body(random: &[u8], dropped: u16, bits: &mut [u32]) {
    for (bits, random) in bits.iter_mut().zip(random.as_chunks::<64>().0) {
        let mut alive = [0_u8; 32];
        for (alive, pair) in alive.iter_mut().zip(random.as_chunks::<2>().0) {
            *alive = u8::from(u16::from_le_bytes(*pair) >= dropped);
        }
        // Eight flags at once: the product carries the flag of byte k to bit 56 + k, and nothing
        // that is added on the way carries over.
        let mut word = 0;
        for (k, flags) in alive.as_chunks::<8>().0.iter().enumerate() {
            let byte = u64::from_le_bytes(*flags).wrapping_mul(0x0102_0408_1020_4080) >> 56;
            word |= (byte as u32) << (8 * k);
        }
        *bits = word;
    }
}

clones!(fn compare[](random: &[u8], dropped: u16, bits: &mut [u32]) = compare_body);

impl<F: Real> Kept<'_, F> {
    /// Scales and zeroes `x` in place; its first element is number `first`.
    pub fn apply(&self, first: usize, x: &mut [F]) {
        // Up to the first whole word, one by one.
        let (before, x) = x.split_at_mut((first.next_multiple_of(32) - first).min(x.len()));
        for (i, x) in before.iter_mut().enumerate() {
            let bit = self.bits[(first + i) / 32] >> ((first + i) % 32) & 1;
            *x = if bit == 1 { *x * self.scale } else { F::zero() };
        }
        if !x.is_empty() {
            update_words(&self.bits[(first + before.len()) / 32..], self.scale, x);
        }
    }

    /// [`apply`](Self::apply) from the first element on, on several threads where it pays.
    pub fn apply_all(&self, x: &mut [F]) {
        let parallel = x.len() >= PARALLEL_FROM;
        for_each_part(x, CHUNK, parallel, |i, x| self.apply(i * CHUNK, x));
    }

    /// As [`apply_all`](Self::apply_all), from `x` to `y`.
    ///
    /// # Panics
    /// If the lengths differ.
    pub fn apply_to(&self, x: &[F], y: &mut [F]) {
        assert_eq!(x.len(), y.len());
        let parallel = x.len() >= PARALLEL_FROM;
        for_each_part(y, CHUNK, parallel, |i, y| {
            let x = &x[i * CHUNK..i * CHUNK + y.len()];
            copy_words(&self.bits[i * CHUNK / 32..], self.scale, x, y);
        });
    }
}

#[inline(always)]
fn choose<F: Real>(bits: u32, k: usize, scale: F, x: F) -> F {
    if bits >> k & 1 == 1 { x * scale } else { F::zero() }
}

#[inline(always)]
fn update_body<F: Real>(bits: &[u32], scale: F, x: &mut [F]) {
    let (blocks, rest) = x.as_chunks_mut::<32>();
    let whole = blocks.len();
    for (block, &bits) in blocks.iter_mut().zip(bits) {
        for (k, x) in block.iter_mut().enumerate() {
            *x = choose(bits, k, scale, *x);
        }
    }
    for (k, x) in rest.iter_mut().enumerate() {
        *x = choose(bits[whole], k, scale, *x);
    }
}

#[inline(always)]
fn copy_body<F: Real>(bits: &[u32], scale: F, x: &[F], y: &mut [F]) {
    let ((from, rest), (to, end)) = (x.as_chunks::<32>(), y.as_chunks_mut::<32>());
    let whole = to.len();
    for ((to, from), &bits) in to.iter_mut().zip(from).zip(bits) {
        for (k, (y, &x)) in to.iter_mut().zip(from).enumerate() {
            *y = choose(bits, k, scale, x);
        }
    }
    for (k, (y, &x)) in end.iter_mut().zip(rest).enumerate() {
        *y = choose(bits[whole], k, scale, x);
    }
}

clones!(fn update_words[F: Real](bits: &[u32], scale: F, x: &mut [F]) = update_body);
clones!(fn copy_words[F: Real](bits: &[u32], scale: F, x: &[F], y: &mut [F]) = copy_body);

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use rand::SeedableRng;

    use super::*;

    fn bits(words: usize, dropped: u16, threads: usize) -> Vec<u32> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut bits = vec![0; words];
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        rng.set_stream(3);
        pool.install(|| draw(&rng, dropped, &mut bits));
        bits
    }

    #[test]
    fn bits_are_those_of_one_stream_for_any_number_of_threads() {
        let dropped = dropped(0.3);
        let found = bits(3 * WORDS + 7, dropped, 1);
        assert_eq!(found, bits(3 * WORDS + 7, dropped, 3));
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        rng.set_stream(3);
        for (i, &word) in found.iter().enumerate() {
            for k in (0..32).step_by(2) {
                let two = rng.next_u32();
                let alive = [two as u16, (two >> 16) as u16].map(|x| u32::from(x >= dropped));
                assert_eq!(word >> k & 3, alive[0] | alive[1] << 1, "word {i}, bit {k}");
            }
        }
    }

    #[test]
    fn the_share_is_that_which_was_asked_for() {
        for p in [0.1, 0.5, 0.9] {
            let words = bits(8192, dropped(p), 2);
            let kept: u32 = words.iter().map(|word| word.count_ones()).sum();
            let share = 1.0 - f64::from(kept) / (32.0 * 8192.0);
            // Four standard deviations of the mean of a quarter of a million flips.
            assert!((share - p).abs() < 4.0 * (p * (1.0 - p) / 262_144.0).sqrt(), "{share}");
            let places: Vec<u32> =
                (0..32).map(|k| words.iter().map(|word| word >> k & 1).sum()).collect();
            let far = places.iter().map(|&n| (f64::from(n) / 8192.0 - (1.0 - p)).abs());
            assert!(far.fold(0.0, f64::max) < 0.025, "{places:?}");
        }
    }

    #[test]
    fn parts_that_begin_anywhere_agree_with_the_whole() {
        let bits = bits(4, dropped(0.4), 1);
        let kept = Kept { bits: &bits, scale: 2.0_f32 };
        let x: Vec<f32> = (1..=120).map(|i| i as f32).collect();
        let mut whole = vec![0.0; 120];
        kept.apply_to(&x, &mut whole);
        for (i, &y) in whole.iter().enumerate() {
            let alive = bits[i / 32] >> (i % 32) & 1 == 1;
            assert_eq!(y, if alive { 2.0 * x[i] } else { 0.0 });
        }
        for (first, last) in [(0, 120), (3, 5), (31, 33), (32, 64), (40, 119), (120, 120)] {
            let mut part = x[first..last].to_vec();
            kept.apply(first, &mut part);
            assert_eq!(part, whole[first..last]);
        }
    }
}
