//! What stands in an OBJ file.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::path::Path;

use super::lines::{Lines, split_word};
use crate::io::atlas::NONE;
use crate::io::polygons::Polygons;
use crate::io::remark::counted;
use crate::io::{ReadMeshError, Remark};
use crate::{Budget, OverLimit};

/// Stands for "no colour"; those of a file are finite.
pub(super) const UNCOLORED: [f32; 3] = [f32::INFINITY; 3];

/// What stands in the file; indices of vertices are in range.
#[derive(Default)]
pub(super) struct Parsed {
    pub(super) positions: Vec<[f32; 3]>,
    /// One per position where any has one, else empty.
    pub(super) colors: Vec<[f32; 3]>,
    pub(super) uvs: Vec<[f32; 2]>,
    pub(super) faces: Vec<[u32; 3]>,
    /// For each face its texture coordinates, [`NONE`] for none; empty where no corner has any.
    pub(super) uv_faces: Vec<[u32; 3]>,
    /// The materials after `usemtl`, numbered as they come.
    pub(super) names: BTreeMap<String, u32>,
    /// Which material begins with which face, in order.
    uses: Vec<(u32, usize)>,
    /// What stands after `mtllib`, each once.
    pub(super) libraries: Vec<String>,
}

impl Parsed {
    /// The materials that faces have, in the order of the faces.
    pub(super) fn used(&self) -> impl Iterator<Item = usize> {
        self.parts().map(|(material, _)| material)
    }

    /// The same, each with the faces.
    pub(super) fn parts(&self) -> impl Iterator<Item = (usize, Range<usize>)> {
        let ends = self.uses.iter().skip(1).map(|u| u.1).chain([self.faces.len()]);
        let parts = self.uses.iter().zip(ends).map(|((m, start), end)| (*m as usize, *start..end));
        parts.filter(|(_, faces)| !faces.is_empty())
    }
}

/// A corner of a face; indices from 0.
#[derive(Clone, Copy)]
struct Corner {
    position: u32,
    uv: u32,
}

struct Parser<'a> {
    path: &'a Path,
    budget: &'a mut Budget,
    parsed: Parsed,
    known_libraries: BTreeSet<String>,
    /// The largest index that no vertex had yet when a face named it, and the face's line: faces may
    /// name vertices that come later.
    pending: Vec<(u32, usize)>,
    polygons: Polygons,
    short: usize,
    first_short: Option<usize>,
    repeated: usize,
}

pub(super) fn parse(
    bytes: &[u8],
    path: &Path,
    budget: &mut Budget,
    remarks: &mut Vec<Remark>,
) -> Result<Parsed, ReadMeshError> {
    let over = ReadMeshError::over_limit(path);
    let mut parser = Parser {
        path,
        budget,
        parsed: Parsed::default(),
        known_libraries: BTreeSet::new(),
        pending: Vec::new(),
        polygons: Polygons::default(),
        short: 0,
        first_short: None,
        repeated: 0,
    };
    let mut lines = Lines::new(bytes);
    while let Some((number, line)) = lines.next(parser.budget).map_err(&over)? {
        parser.line(&line, number)?;
    }
    parser.finish(remarks)
}

impl Parser<'_> {
    fn line(&mut self, line: &str, number: usize) -> Result<(), ReadMeshError> {
        let path = self.path;
        let over = ReadMeshError::over_limit(path);
        let (word, rest) = split_word(line);
        let bad = |field: &str, found: &str, expected: &str| {
            ReadMeshError::at_line(path, Some(number), field, format!("{found:?}"), expected)
        };
        match word {
            "v" => {
                let (count, n) =
                    numbers::<8>(rest, finite).map_err(|w| bad("v", w, "a finite number"))?;
                if count < 3 {
                    return Err(bad("v", rest, "three coordinates"));
                }
                // Six numbers: a colour follows; seven: a weight before it is not in use, an
                // alpha after it is.
                let color = (count >= 6).then_some([n[3], n[4], n[5]]);
                self.vertex([n[0], n[1], n[2]], color).map_err(over)
            }
            "vt" => {
                let (count, n) =
                    numbers::<3>(rest, placed).map_err(|w| bad("vt", w, "a number"))?;
                if count < 1 {
                    return Err(bad("vt", rest, "one to three coordinates"));
                }
                let uv = [n[0], if count > 1 { n[1] } else { 0.0 }];
                self.budget.push(&mut self.parsed.uvs, uv).map_err(over)
            }
            "f" => self.face(rest, number),
            "usemtl" => self.material(rest).map_err(over),
            "mtllib" => self.library(rest).map_err(over),
            _ => Ok(()), // names, groups, smoothing, normals, points, lines: no part of a mesh here
        }
    }

    fn vertex(&mut self, position: [f32; 3], color: Option<[f32; 3]>) -> Result<(), OverLimit> {
        let Parsed { positions, colors, .. } = &mut self.parsed;
        if let Some(color) = color {
            // White for those before the first with a colour, and for those after it without.
            self.budget.fill(colors, positions.len(), UNCOLORED, 1)?;
            colors.push(color);
        }
        self.budget.push(positions, position)
    }

    /// Makes a fan of triangles of a polygon, as its corners come.
    fn face(&mut self, rest: &str, number: usize) -> Result<(), ReadMeshError> {
        let over = ReadMeshError::over_limit(self.path);
        let start = self.parsed.faces.len();
        let mut fan: [Option<Corner>; 2] = [None; 2];
        let (mut corners, mut worst) = (0, None);
        for word in rest.split_whitespace() {
            let corner = self.corner(word).ok_or_else(|| {
                let expected =
                    "v, v/vt, v//vn or v/vt/vn, none of them 0 or further back than there are";
                ReadMeshError::at_line(self.path, Some(number), "f", format!("{word:?}"), expected)
            })?;
            corners += 1;
            worst = worst.max(Some(corner.position));
            match fan {
                [None, _] => fan[0] = Some(corner),
                [Some(first), Some(last)] => {
                    self.triangle([first, last, corner]).map_err(&over)?;
                    fan[1] = Some(corner);
                }
                [Some(_), None] => fan[1] = Some(corner),
            }
        }
        if corners < 3 {
            self.short += 1;
            self.first_short.get_or_insert(number);
            return Ok(());
        }
        let end = self.parsed.faces.len();
        if end - start == corners - 2 {
            self.polygons.note(start..end, self.budget).map_err(&over)?;
        }
        // Of faces that name what is not there, the first in the file is the one to report; one
        // that reaches no further than another before it never is.
        let worst = worst.filter(|&w| w as usize >= self.parsed.positions.len());
        match worst {
            Some(w) if self.pending.last().is_none_or(|last| last.0 < w) => {
                self.budget.push(&mut self.pending, (w, number)).map_err(over)
            }
            _ => Ok(()),
        }
    }

    fn triangle(&mut self, corners: [Corner; 3]) -> Result<(), OverLimit> {
        let [a, b, c] = corners.map(|c| c.position);
        if a == b || b == c || c == a {
            self.repeated += 1;
            return Ok(());
        }
        let Parsed { faces, uv_faces, .. } = &mut self.parsed;
        let uvs = corners.map(|c| c.uv);
        if !uv_faces.is_empty() || uvs != [NONE; 3] {
            self.budget.fill(uv_faces, faces.len(), [NONE; 3], 1)?;
            uv_faces.push(uvs);
        }
        self.budget.push(faces, [a, b, c])
    }

    /// A corner of a face. `None` where the word is not one.
    fn corner(&self, word: &str) -> Option<Corner> {
        let index = |part: &str, count: usize| -> Option<u32> {
            let i: i64 = part.parse().ok()?;
            let zero_based = match i {
                1.. => i - 1,
                0 => return None,
                _ => (count as i64).checked_add(i)?,
            };
            // u32::MAX itself stands for "none".
            u32::try_from(zero_based).ok().filter(|&i| i != NONE)
        };
        let mut parts = word.split('/');
        let position = index(parts.next()?, self.parsed.positions.len())?;
        let uv = match parts.next() {
            None | Some("") => NONE,
            // Out of range is as good as none, but it must be a number.
            Some(part) => match index(part, self.parsed.uvs.len()) {
                Some(uv) => uv,
                None => part.parse::<i64>().map(|_| NONE).ok()?,
            },
        };
        if let Some(normal) = parts.next() {
            // Normals are not kept, but what stands there must be a number.
            (normal.is_empty() || normal.parse::<i64>().is_ok()).then_some(())?;
        }
        parts.next().is_none().then_some(Corner { position, uv })
    }

    fn material(&mut self, name: &str) -> Result<(), OverLimit> {
        let Parsed { names, uses, faces, .. } = &mut self.parsed;
        let number = names.get(name).copied().unwrap_or(names.len() as u32);
        if number as usize == names.len() {
            self.budget.take(entry(name))?;
            names.insert(name.to_owned(), number);
        }
        if uses.last().is_some_and(|last| last.1 == faces.len()) {
            uses.pop(); // no face has that one
        }
        self.budget.push(uses, (number, faces.len()))
    }

    /// One name that may hold spaces, or several names: which it is the folder says, later.
    fn library(&mut self, names: &str) -> Result<(), OverLimit> {
        if !names.is_empty() && !self.known_libraries.contains(names) {
            self.budget.take(2 * entry(names))?;
            self.known_libraries.insert(names.to_owned());
            self.budget.push(&mut self.parsed.libraries, names.to_owned())?;
        }
        Ok(())
    }

    fn finish(self, remarks: &mut Vec<Remark>) -> Result<Parsed, ReadMeshError> {
        let mut parsed = self.parsed;
        let count = parsed.positions.len();
        if let Some(&(index, line)) = self.pending.iter().find(|(i, _)| *i as usize >= count) {
            let (found, expected) = (u64::from(index) + 1, format!("1 to {count}"));
            let (field, found) = ("f (vertex)", format!("index {found}"));
            return Err(ReadMeshError::at_line(self.path, Some(line), field, found, expected));
        }
        let over = ReadMeshError::over_limit(self.path);
        if !parsed.colors.is_empty() {
            self.budget.fill(&mut parsed.colors, count, UNCOLORED, 0).map_err(&over)?;
        }
        if !parsed.uv_faces.is_empty() {
            let faces = parsed.faces.len();
            self.budget.fill(&mut parsed.uv_faces, faces, [NONE; 3], 0).map_err(&over)?;
            let uvs = parsed.uvs.len();
            for uv in parsed.uv_faces.iter_mut().flatten().filter(|uv| **uv as usize >= uvs) {
                *uv = NONE;
            }
        }
        let Parsed { positions, faces, uv_faces, .. } = &mut parsed;
        let others = Some(&mut uv_faces[..]).filter(|uvs| !uvs.is_empty());
        self.polygons.cut(positions, faces, others);
        let line = self.first_short;
        counted(remarks, self.short, |count| Remark::ShortFaces { count, line });
        counted(remarks, self.repeated, |count| Remark::RepeatedVertices { count });
        Ok(parsed)
    }
}

/// What a name takes in a sorted map, and in the list of materials, roughly.
fn entry(name: &str) -> u64 {
    name.len() as u64 + 160
}

fn finite(word: &str) -> Option<f32> {
    word.parse().ok().filter(|v: &f32| v.is_finite())
}

/// A texture coordinate. Faces without extent make exporters write what is not a number, some as
/// `-1.#IND`; no place on the image is as good as any.
fn placed(word: &str) -> Option<f32> {
    let is_none = || word.contains(".#").then_some(0.0);
    word.parse().ok().map(|v: f32| if v.is_finite() { v } else { 0.0 }).or_else(is_none)
}

/// Up to `N` numbers and how many there are; the first word that `number` makes none of otherwise.
fn numbers<const N: usize>(
    rest: &str,
    number: impl Fn(&str) -> Option<f32>,
) -> Result<(usize, [f32; N]), &str> {
    let mut values = [0.0; N];
    let mut count = 0;
    for (slot, word) in values.iter_mut().zip(rest.split_whitespace()) {
        *slot = number(word).ok_or(word)?;
        count += 1;
    }
    Ok((count, values))
}
