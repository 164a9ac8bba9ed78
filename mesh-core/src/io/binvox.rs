//! binvox: occupancy grids, run-length encoded.
//!
//! A few lines of text (`#binvox 1`, `dim`, `translate`, `scale`, `data`), then pairs of bytes: a
//! value, 0 or 1, and how many cells in a row have it, 1 to 255. Cells are ordered with x slowest,
//! then z, then y. Along each axis the middle of cell `i` of `n` is at
//! `translate + scale * (i + 0.5) / n`, so the grid fills a cube of side `scale`.
//!
//! # References
//! P. Min, *binvox*, the description of the file format that comes with the program.

use std::path::Path;
use std::str::FromStr;

use super::open::Contents;
use super::{ReadMeshError, WriteError, write_atomic};
use crate::{Budget, Limits, VoxelGrid};

/// The most cells that a pair of bytes stands for.
const LONGEST_RUN: usize = 255;

/// What is looked at of a line of the header.
const LONGEST_LINE: usize = 4096;

/// Reads a grid.
///
/// # Errors
/// The file cannot be read or is not as the format says; dimensions that the bytes after the
/// header cannot fill are refused before anything is allocated.
pub fn read(path: impl AsRef<Path>) -> Result<VoxelGrid, ReadMeshError> {
    let limits = Limits::default();
    let Contents { bytes, path, mut budget, .. } = Contents::of_file(path.as_ref(), &limits)?;
    parse(&bytes, path, &mut budget)
}

/// The same for bytes that are already in memory; `name` stands for them in errors.
///
/// # Errors
/// As [`read`].
pub fn decode(bytes: &[u8], name: impl AsRef<Path>) -> Result<VoxelGrid, ReadMeshError> {
    decode_with(bytes, name, &Limits::default())
}

/// [`decode`] within other limits.
///
/// # Errors
/// As [`read`].
pub fn decode_with(
    bytes: &[u8],
    name: impl AsRef<Path>,
    limits: &Limits,
) -> Result<VoxelGrid, ReadMeshError> {
    parse(bytes, name.as_ref(), &mut limits.budget(bytes.len() as u64))
}

fn parse(bytes: &[u8], path: &Path, budget: &mut Budget) -> Result<VoxelGrid, ReadMeshError> {
    let header = Header::parse(bytes, path)?;
    let mut grid = header.empty_grid(bytes.len() - header.end, path, budget)?;
    let cells = grid.bits.len();
    let mut filled = 0;
    for pair in bytes[header.end..].chunks(2) {
        if filled == cells {
            break; // some writers end with a newline
        }
        let &[value, count] = pair else { break };
        let count = usize::from(count);
        let at = |field: &str| format!("{field} of the run at cell {filled}");
        if value > 1 {
            return Err(ReadMeshError::malformed(path, at("value"), value, "0 or 1"));
        }
        if count == 0 || count > cells - filled {
            let expected = format!("1 to {}", (cells - filled).min(LONGEST_RUN));
            return Err(ReadMeshError::malformed(path, at("length"), count, expected));
        }
        if value == 1 {
            for cell in filled..filled + count {
                let index = grid.index(place(cell, grid.dims));
                grid.bits[index] = true;
            }
        }
        filled += count;
    }
    if filled < cells {
        let found = format!("runs for {filled} cells");
        return Err(ReadMeshError::malformed(path, "data", found, format!("for {cells}")));
    }
    Ok(grid)
}

/// Writes a grid; the file appears whole or not at all.
///
/// # Errors
/// The file cannot be written, or the format cannot hold the grid: see [`encode`].
pub fn write(path: impl AsRef<Path>, grid: &VoxelGrid) -> Result<(), WriteError> {
    let path = path.as_ref();
    let bytes = encode(grid)
        .map_err(|what| WriteError::Voxels { path: path.to_owned(), what: what.to_owned() })?;
    write_atomic(path, |w| w.write_all(&bytes))
}

/// The bytes of a file with this grid.
///
/// # Errors
/// A sentence, where the format cannot hold the grid: its box is not a cube, or its number of
/// cells is not that of its dimensions.
pub fn encode(grid: &VoxelGrid) -> Result<Vec<u8>, &'static str> {
    let cells = grid.dims.iter().try_fold(1_usize, |n, &d| n.checked_mul(d));
    if cells != Some(grid.bits.len()) || grid.bits.is_empty() {
        return Err("the number of cells is not that of its dimensions");
    }
    let sides: [f64; 3] = std::array::from_fn(|k| f64::from(grid.cell[k]) * grid.dims[k] as f64);
    let scale = sides[0];
    let cube = sides.iter().all(|side| (side - scale).abs() <= 1e-5 * scale);
    let finite = grid.origin.iter().all(|x| x.is_finite());
    if !(scale.is_finite() && scale > 0.0 && cube && finite) {
        return Err("binvox holds cubes only, and the grid's box is none");
    }
    let [[nx, ny, nz], [x, y, z]] =
        [grid.dims.map(|n| n.to_string()), grid.origin.map(|x| x.to_string())];
    let header = format!(
        "#binvox 1\ndim {nx} {nz} {ny}\ntranslate {x} {y} {z}\nscale {}\ndata\n",
        scale as f32
    );
    let mut bytes = header.into_bytes();
    let bit = |cell: usize| grid.bits[grid.index(place(cell, grid.dims))];
    let (mut value, mut count) = (bit(0), 0_u8);
    for cell in 0..grid.bits.len() {
        let next = bit(cell);
        if next != value || count == u8::MAX {
            bytes.extend([u8::from(value), count]);
            (value, count) = (next, 0);
        }
        count += 1;
    }
    bytes.extend([u8::from(value), count]);
    Ok(bytes)
}

/// The cell that stands at this place of the file: x slowest, then z, then y.
fn place(cell: usize, [_, ny, nz]: [usize; 3]) -> [usize; 3] {
    [cell / (ny * nz), cell % ny, cell / ny % nz]
}

/// What stands before the runs.
struct Header {
    /// Cells along x, y, z.
    dims: [u64; 3],
    translate: [f32; 3],
    scale: f32,
    /// Where the runs begin.
    end: usize,
}

impl Header {
    fn parse(bytes: &[u8], path: &Path) -> Result<Self, ReadMeshError> {
        let (mut dims, mut translate, mut scale) = (None, [0.0; 3], 1.0);
        let (mut position, mut first) = (0, String::new());
        for number in 1.. {
            if number == 2 && first != "#binvox 1" {
                let found = format!("{first:?}");
                return Err(ReadMeshError::at_line(
                    path,
                    Some(1),
                    "first line",
                    found,
                    "#binvox 1",
                ));
            }
            let rest = &bytes[position..];
            let Some(length) = rest.iter().position(|&b| b == b'\n') else {
                let expected = if number == 1 { "#binvox 1" } else { "data" };
                return Err(ReadMeshError::malformed(path, "header", "no such line", expected));
            };
            position += length + 1;
            let line = String::from_utf8_lossy(&rest[..length.min(LONGEST_LINE)]);
            // No line that counts has more words.
            let words: Vec<&str> = line.split_whitespace().take(8).collect();
            let bad = |field: &str, expected: &str| {
                ReadMeshError::at_line(path, Some(number), field, format!("{line:?}"), expected)
            };
            match words.as_slice() {
                _ if number == 1 => first = words.join(" "),
                // The format calls them depth, height, width: x, z, y.
                ["dim", numbers @ ..] => {
                    let [x, z, y] = parsed::<u64, 3>(numbers)
                        .filter(|dims| dims.iter().all(|&d| d > 0))
                        .ok_or_else(|| bad("dim", "three counts above 0"))?;
                    dims = Some([x, y, z]);
                }
                ["translate", numbers @ ..] => {
                    translate = parsed(numbers)
                        .filter(|t: &[f32; 3]| t.iter().all(|x| x.is_finite()))
                        .ok_or_else(|| bad("translate", "three finite numbers"))?;
                }
                ["scale", numbers @ ..] => {
                    [scale] = parsed(numbers)
                        .filter(|[s]: &[f32; 1]| s.is_finite() && *s > 0.0)
                        .ok_or_else(|| bad("scale", "a finite number above 0"))?;
                }
                ["data"] => break,
                _ => {} // the format lets readers pass over words they do not know
            }
        }
        let dims = dims.ok_or_else(|| {
            ReadMeshError::malformed(path, "dim", "no such line", "dim and three counts")
        })?;
        Ok(Self { dims, translate, scale, end: position })
    }

    /// A grid without occupied cells, if the bytes that are left can fill it.
    fn empty_grid(
        &self,
        left: usize,
        path: &Path,
        budget: &mut Budget,
    ) -> Result<VoxelGrid, ReadMeshError> {
        let most = (left / 2).saturating_mul(LONGEST_RUN) as u64;
        let cells = self.dims.iter().try_fold(1_u64, |n, &d| n.checked_mul(d));
        if cells.is_none_or(|n| n > most.min(1 << 32)) {
            let [x, y, z] = self.dims;
            let expected = format!("at most {most} cells, which is what {left} bytes can fill");
            return Err(ReadMeshError::malformed(path, "dim", format!("{x} {z} {y}"), expected));
        }
        budget.take(cells.unwrap_or(u64::MAX)).map_err(ReadMeshError::over_limit(path))?;
        let dims = self.dims.map(|d| d as usize);
        let high = self.translate.map(|low| low + self.scale);
        // Where the numbers are of very different sizes, cells have no extent in them.
        let sound = (0..3).all(|k| {
            let side = (high[k] - self.translate[k]) / dims[k] as f32;
            side.is_finite() && side > 0.0
        });
        if !sound {
            let (found, low) = (self.scale, self.translate);
            let expected = format!("one that gives cells an extent at translate {low:?}");
            return Err(ReadMeshError::malformed(path, "scale", found, expected));
        }
        let mut grid = VoxelGrid::new(dims, (self.translate, high));
        // Not by way of the far corner, which rounds.
        grid.cell = dims.map(|n| self.scale / n as f32);
        Ok(grid)
    }
}

/// Exactly `N` numbers.
fn parsed<T: FromStr, const N: usize>(words: &[&str]) -> Option<[T; N]> {
    let numbers: Vec<T> = words.iter().map_while(|word| word.parse().ok()).collect();
    if words.len() == N { numbers.try_into().ok() } else { None }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn grid(dims: [usize; 3], seed: u64) -> VoxelGrid {
        let mut grid = VoxelGrid::new(dims, ([-0.5, 1.0, 2.0], [1.0, 2.5, 3.5]));
        let mut state = seed;
        for bit in &mut grid.bits {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            *bit = state >> 61 == 0;
        }
        grid
    }

    #[test]
    fn the_order_is_x_then_z_then_y() {
        // 2 cells along x, 3 along y, 1 along z; occupied: (1, 0, 0) and (1, 2, 0).
        let bytes = b"#binvox 1\ndim 2 1 3\ntranslate -1 0 4\nscale 6\ndata\n\x00\x03\x01\x01\x00\x01\x01\x01";
        let grid = decode(bytes, "a.binvox").unwrap();
        assert_eq!(grid.dims, [2, 3, 1]);
        assert!(grid.get([1, 0, 0]) && grid.get([1, 2, 0]) && grid.count() == 2);
        assert_eq!(grid.center([1, 0, 0]), [-1.0 + 6.0 * 0.75, 6.0 * 0.5 / 3.0, 7.0]);
    }

    #[test]
    fn what_is_written_is_read_and_long_runs_are_split() {
        for dims in [[1, 1, 1], [4, 5, 6], [32, 32, 32], [600, 1, 1]] {
            let grid = grid(dims, 7);
            let read = decode(&encode(&grid).unwrap(), "a.binvox").unwrap();
            assert_eq!((&read.bits, read.dims, read.origin), (&grid.bits, dims, grid.origin));
            (0..3).for_each(|k| {
                approx::assert_relative_eq!(read.cell[k], grid.cell[k], max_relative = 1e-6);
            });
        }
        let mut flat = grid([2, 2, 2], 1);
        flat.cell[1] *= 2.0;
        assert!(encode(&flat).is_err());
        let folder = tempfile::tempdir().unwrap();
        let error = write(folder.path().join("flat.binvox"), &flat).unwrap_err().to_string();
        assert!(error.contains("flat.binvox") && error.contains("cube"), "{error}");
    }

    #[test]
    fn each_mistake_is_named() {
        let error = |text: &str| decode(text.as_bytes(), "a.binvox").unwrap_err().to_string();
        assert!(error("P6\n").contains("#binvox 1"));
        assert!(error("#binvox 1\ndim 2 2 2\n").contains("data"));
        assert!(error("#binvox 1\ndata\n\0\x08").contains("dim"));
        assert!(error("#binvox 1\ndim 2 0 2\ndata\n\0\x08").contains("a.binvox:2: dim"));
        assert!(error("#binvox 1\ndim 2 2\ndata\n\0\x08").contains("three counts"));
        assert!(error("#binvox 1\nscale nan\n").contains("scale"));
        assert!(error("#binvox 1\ntranslate 0 inf 0\n").contains("translate"));
        assert!(error("#binvox 1\ndim 2 2 2\ndata\n\0\x07").contains("runs for 7 cells"));
        assert!(error("#binvox 1\ndim 2 2 2\ndata\n\0\x09").contains("1 to 8"));
        assert!(error("#binvox 1\ndim 2 2 2\ndata\n\x02\x08").contains("0 or 1"));
        assert!(error("#binvox 1\ndim 2 2 2\ndata\n\0\0\0\x08").contains("length"));
        assert!(
            error("#binvox 1\ndim 99999999999 99999999999 9\ndata\n\0\x08").contains("can fill")
        );
        assert!(error("#binvox 1\ndim 2 2 2\ntranslate 1e30 0 0\ndata\n\0\x08").contains("scale"));
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(
            at in any::<prop::sample::Index>(), byte: u8, cut in any::<prop::sample::Index>(),
            header in "[#binvox 1dmtralsec\n.e0-9-]{0,80}",
        ) {
            let mut bytes = encode(&grid([5, 4, 3], 3)).unwrap();
            let place = at.index(bytes.len());
            bytes[place] = byte;
            let _ = decode(&bytes, "a");
            bytes.truncate(cut.index(bytes.len()));
            let _ = decode(&bytes, "a");
            let _ = decode(format!("#binvox 1\n{header}\ndata\n\0\u{8}\u{1}\u{9}").as_bytes(), "a");
        }
    }
}
