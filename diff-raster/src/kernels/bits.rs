//! Background pixels as bits, 64 to a word.

use crate::faces::NONE;
use crate::kernels::setup::PixelBox;

/// One bit per pixel, set at background; each row begins a new word.
#[derive(Debug, Default)]
pub struct Bits {
    words: Vec<u64>,
    per_row: usize,
}

impl Bits {
    /// Sets the bits of the background of a face plane `[H, W]`.
    pub fn fill(&mut self, height: usize, width: usize, face: &[u32]) {
        self.per_row = width.div_ceil(64);
        self.words.resize(height * self.per_row, 0);
        let rows = self.words.chunks_exact_mut(self.per_row.max(1));
        for (words, face) in rows.zip(face.chunks_exact(width.max(1))) {
            for (word, face) in words.iter_mut().zip(face.chunks(64)) {
                *word = 0;
                for (k, &face) in face.iter().enumerate() {
                    *word |= ((face == NONE) as u64) << k;
                }
            }
        }
    }

    /// The words of a row.
    pub fn row(&self, row: usize) -> &[u64] {
        &self.words[row * self.per_row..(row + 1) * self.per_row]
    }

    /// Whether any bit of a box is set.
    #[inline(always)]
    pub fn any(&self, pixels: PixelBox) -> bool {
        let [start, end] = pixels.columns.map(|c| c as usize);
        (pixels.rows[0] as usize..pixels.rows[1] as usize)
            .any(|row| self.run(row, start, end - start))
    }

    /// Whether any of `count` bits from a column on is set.
    #[inline(always)]
    pub fn run(&self, row: usize, start: usize, count: usize) -> bool {
        let words = self.row(row);
        let (first, last) = (start / 64, (start + count - 1) / 64);
        let head = u64::MAX << (start % 64);
        let tail = u64::MAX >> (63 - (start + count - 1) % 64);
        if first == last {
            return words[first] & head & tail != 0;
        }
        words[first] & head != 0
            || words[first + 1..last].iter().any(|&word| word != 0)
            || words[last] & tail != 0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_see_exactly_their_bits() {
        let width = 200;
        for set in [0, 1, 63, 64, 65, 127, 128, 199] {
            let mut face = vec![0; 3 * width];
            face[width + set] = NONE;
            let mut bits = Bits::default();
            bits.fill(3, width, &face);
            for start in 0..width {
                for count in [1, 2, 16, 63, 64, 65, 130, 200] {
                    if start + count <= width {
                        let expected = (start..start + count).contains(&set);
                        assert_eq!(bits.run(1, start, count), expected);
                        assert!(!bits.run(0, start, count) && !bits.run(2, start, count));
                    }
                }
            }
        }
    }
}
