//! Background pixels as bits, 64 to a word.

use crate::faces::NONE;
use crate::kernels::setup::PixelBox;

/// Pixels along a side of a tile.
const TILE: usize = 8;

/// One bit per pixel, set at background; each row begins a new word.
#[derive(Debug, Default)]
pub struct Bits {
    words: Vec<u64>,
    per_row: usize,
    /// One bit per tile: whether it holds any background.
    tiles: Vec<u64>,
    tiles_per_row: usize,
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
        self.tiles_per_row = self.per_row.div_ceil(TILE);
        self.tiles.clear();
        self.tiles.resize(height.div_ceil(TILE) * self.tiles_per_row, 0);
        for (k, word) in self.words.iter().enumerate() {
            let (row, column) = (k / self.per_row, k % self.per_row);
            // The lowest bit of each byte: whether any of the byte is set; then the eight bytes'
            // bits side by side.
            let mut any = word | word >> 4;
            any |= any >> 2;
            any |= any >> 1;
            let bits = (any & 0x0101_0101_0101_0101).wrapping_mul(0x0102_0408_1020_4080) >> 56;
            let tile = row / TILE * self.tiles_per_row + column / TILE;
            self.tiles[tile] |= bits << (8 * (column % TILE));
        }
    }

    /// Whether any tile that a box of pixels touches holds background. Bounds are inclusive and
    /// may lie outside the image.
    #[inline(always)]
    pub fn any_tile(&self, rows: [i32; 2], columns: [i32; 2]) -> bool {
        let [height, width] = [self.tiles.len() / self.tiles_per_row.max(1), 8 * self.per_row];
        let tile = |x: i32, size: usize| (x.max(0) as usize / TILE).min(size.max(1) - 1);
        let [first, last] = [tile(columns[0], width), tile(columns[1], width)];
        let (from, to) = (first / 64, last / 64);
        let head = u64::MAX << (first % 64);
        let tail = u64::MAX >> (63 - last % 64);
        for row in tile(rows[0], height)..=tile(rows[1], height) {
            let words = &self.tiles[row * self.tiles_per_row..(row + 1) * self.tiles_per_row];
            let hit = if from == to {
                words[from] & head & tail != 0
            } else {
                words[from] & head != 0
                    || words[from + 1..to].iter().any(|&word| word != 0)
                    || words[to] & tail != 0
            };
            if hit {
                return true;
            }
        }
        false
    }

    /// The same of a box that is enlarged by so many rows and columns.
    #[inline(always)]
    pub fn any_tile_around(&self, pixels: PixelBox, margin: [i32; 2]) -> bool {
        let around = |[first, end]: [u32; 2], margin: i32| {
            [(first as i32).saturating_sub(margin), (end as i32).saturating_add(margin)]
        };
        self.any_tile(around(pixels.rows, margin[0]), around(pixels.columns, margin[1]))
    }

    /// The words of a row.
    #[inline(always)]
    pub fn row(&self, row: usize) -> &[u64] {
        &self.words[row * self.per_row..(row + 1) * self.per_row]
    }

    /// From the first to one past the last column of a half-open range whose bit is set; an empty range if none is.
    #[inline(always)]
    pub fn span(&self, row: usize, [start, end]: [usize; 2]) -> [usize; 2] {
        if start >= end {
            return [end; 2];
        }
        let words = self.row(row);
        let (first, last) = (start / 64, (end - 1) / 64);
        let part = |k: usize| {
            let head = if k == first { u64::MAX << (start % 64) } else { u64::MAX };
            let tail = if k == last { u64::MAX >> (63 - (end - 1) % 64) } else { u64::MAX };
            words[k] & head & tail
        };
        let mut low = first;
        while low < last && part(low) == 0 {
            low += 1;
        }
        if part(low) == 0 {
            return [end; 2];
        }
        let mut high = last;
        while part(high) == 0 {
            high -= 1;
        }
        [
            64 * low + part(low).trailing_zeros() as usize,
            64 * high + 64 - part(high).leading_zeros() as usize,
        ]
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
                        let [first, end] = bits.span(1, [start, start + count]);
                        assert_eq!(
                            (first, end),
                            if expected { (set, set + 1) } else { (end, end) }
                        );
                        assert!(!bits.run(0, start, count) && !bits.run(2, start, count));
                        let columns = [start as i32, (start + count - 1) as i32];
                        assert!(!expected || bits.any_tile([-3, 40], columns));
                    }
                }
            }
            face[width + 2] = NONE;
            bits.fill(3, width, &face);
            assert_eq!(bits.span(1, [0, width]), [set.min(2), set.max(2) + 1]);
            face[width + 2] = 0;
            face[width + set] = NONE;
            bits.fill(3, width, &face);
            let far = (set as i32 + 100) % 200;
            assert!(!bits.any_tile([0, 2], [far, far]));
        }
    }
}
