//! Reading OBJ as people have it.

use std::path::Path;

use super::mtl::{Material, materials, split_word};
use crate::io::{ReadMeshError, read_bytes};
use crate::{Image, Texture, TriMesh, read_image};

/// Reads an OBJ file and the texture of its material library.
///
/// Vertices keep their order, used or not. Polygons become fans of triangles. Indices may be
/// negative, corners may be `v`, `v/vt`, `v//vn` or `v/vt/vn` in any mixture, lines may end in CR
/// LF or continue after a backslash, and `v` may carry a weight (ignored) or a colour. Where only
/// some vertices have a colour the others are white. A texture that is not there is left out: see
/// [`read_with_notes`].
///
/// # Errors
/// The file cannot be read; a number is missing, unreadable or not finite; an index is 0 or out
/// of range; an image that is there cannot be read.
pub fn read(path: impl AsRef<Path>) -> Result<TriMesh, ReadMeshError> {
    read_with_notes(path, &mut Vec::new())
}

/// The same, and a sentence in `notes` for each thing that the mesh cannot hold or that is missing.
///
/// # Errors
/// As [`read`].
pub fn read_with_notes(
    path: impl AsRef<Path>,
    notes: &mut Vec<String>,
) -> Result<TriMesh, ReadMeshError> {
    let path = path.as_ref();
    let parsed = parse(&read_bytes(path)?, path)?;
    let library = library(&parsed, path, notes);
    let image = match image_of(&parsed, &library, notes) {
        Some(file) => Some(
            read_image(file)
                .map_err(|source| ReadMeshError::Texture { path: path.to_owned(), source })?,
        ),
        None => None,
    };
    let texture = image.map(|image| (Image::from(&image.to_rgb()), &parsed));
    let texture = texture.map(|(image, parsed)| texture_of(parsed, image, notes));
    Ok(TriMesh { texture, ..mesh_of(parsed) })
}

/// The mesh in the bytes of an OBJ file; no other file is looked at, so it has no texture.
///
/// `name` stands for the file in errors.
///
/// # Errors
/// As [`read`], less those of files.
pub fn decode(bytes: &[u8], name: impl AsRef<Path>) -> Result<TriMesh, ReadMeshError> {
    parse(bytes, name.as_ref()).map(mesh_of)
}

/// What stands in the file, checked.
#[derive(Default)]
struct Parsed {
    positions: Vec<[f32; 3]>,
    /// One per position where any has one.
    colors: Vec<[f32; 3]>,
    colored: bool,
    uvs: Vec<[f32; 2]>,
    faces: Vec<[u32; 3]>,
    /// For each face its texture coordinates, `u32::MAX` for none.
    uv_faces: Vec<[u32; 3]>,
    /// Names after `usemtl` and the face that each begins with.
    materials: Vec<(String, usize)>,
    libraries: Vec<String>,
}

const NONE: u32 = u32::MAX;

struct Corner {
    position: u32,
    uv: u32,
}

fn parse(bytes: &[u8], path: &Path) -> Result<Parsed, ReadMeshError> {
    let text = String::from_utf8_lossy(bytes);
    let mut parsed = Parsed::default();
    // The line of each face: indices may point forward, so ranges are checked at the end.
    let mut lines: Vec<usize> = Vec::new();
    let mut corners: Vec<Corner> = Vec::new();
    let mut joined = String::new();
    for (k, raw) in text.lines().enumerate() {
        let line_number = k + 1;
        if let Some(part) = raw.trim_end().strip_suffix('\\') {
            joined.push_str(part);
            joined.push(' ');
            continue;
        }
        let whole;
        let line = if joined.is_empty() {
            raw
        } else {
            joined.push_str(raw);
            whole = std::mem::take(&mut joined);
            whole.as_str()
        };
        let (word, rest) = split_word(line);
        let bad = |field: &str, found: &str, expected: &str| {
            ReadMeshError::at_line(path, Some(line_number), field, format!("{found:?}"), expected)
        };
        match word {
            "v" => {
                let (count, n) = numbers::<8>(rest).map_err(|w| bad("v", w, "a finite number"))?;
                if count < 3 {
                    return Err(bad("v", rest, "three coordinates"));
                }
                parsed.positions.push([n[0], n[1], n[2]]);
                // Six numbers: a colour follows; seven: a weight before it is not in use, an
                // alpha after it is.
                let color = (count >= 6).then_some([n[3], n[4], n[5]]);
                parsed.colored |= color.is_some();
                parsed.colors.push(color.unwrap_or([1.0; 3]));
            }
            "vt" => {
                let (count, n) = numbers::<3>(rest).map_err(|w| bad("vt", w, "a finite number"))?;
                if count < 1 {
                    return Err(bad("vt", rest, "one to three coordinates"));
                }
                parsed.uvs.push([n[0], if count > 1 { n[1] } else { 0.0 }]);
            }
            "f" => {
                corners.clear();
                for word in rest.split_whitespace() {
                    let corner = corner(word, &parsed).ok_or_else(|| {
                        bad("f", word, "v, v/vt, v//vn or v/vt/vn, none of them 0")
                    })?;
                    corners.push(corner);
                }
                let [first, middle @ .., _] = corners.as_slice() else {
                    return Err(bad("f", rest, "at least three corners"));
                };
                if middle.is_empty() {
                    return Err(bad("f", rest, "at least three corners"));
                }
                for pair in corners[1..].windows(2) {
                    let fan = [first, &pair[0], &pair[1]];
                    parsed.faces.push(fan.map(|c| c.position));
                    parsed.uv_faces.push(fan.map(|c| c.uv));
                    lines.push(line_number);
                }
            }
            "usemtl" => parsed.materials.push((rest.to_owned(), parsed.faces.len())),
            "mtllib" => parsed.libraries.push(rest.to_owned()),
            _ => {} // names, groups, smoothing, normals, lines, curves: no part of a mesh here
        }
    }
    for (face, line) in lines.iter().enumerate() {
        let check = |field: &str, indices: [u32; 3], count: usize| match indices
            .iter()
            .find(|&&i| i != NONE && i as usize >= count)
        {
            None => Ok(()),
            Some(&i) => Err(ReadMeshError::at_line(
                path,
                Some(*line),
                field,
                format!("index {}", u64::from(i) + 1),
                format!("1 to {count}"),
            )),
        };
        check("f (vertex)", parsed.faces[face], parsed.positions.len())?;
        check("f (texture coordinate)", parsed.uv_faces[face], parsed.uvs.len())?;
    }
    Ok(parsed)
}

/// Up to `N` numbers and how many there are; the first word that is no finite number otherwise.
fn numbers<const N: usize>(rest: &str) -> Result<(usize, [f32; N]), &str> {
    let mut values = [0.0; N];
    let mut count = 0;
    for (slot, word) in values.iter_mut().zip(rest.split_whitespace()) {
        *slot = word.parse().ok().filter(|v: &f32| v.is_finite()).ok_or(word)?;
        count += 1;
    }
    Ok((count, values))
}

/// A corner of a face; indices from 0. `None` where it is not one.
fn corner(word: &str, parsed: &Parsed) -> Option<Corner> {
    let index = |part: &str, count: usize| -> Option<u32> {
        let i: i64 = part.parse().ok()?;
        let zero_based = match i {
            1.. => i - 1,
            0 => return None,
            _ => count as i64 + i,
        };
        // u32::MAX itself stands for "none".
        u32::try_from(zero_based).ok().filter(|&i| i != NONE)
    };
    let mut parts = word.split('/');
    let position = index(parts.next()?, parsed.positions.len())?;
    let uv = match parts.next() {
        None | Some("") => NONE,
        Some(part) => index(part, parsed.uvs.len())?,
    };
    if let Some(normal) = parts.next() {
        // Normals are not kept, but what stands there must be a number.
        (normal.is_empty() || normal.parse::<i64>().is_ok()).then_some(())?;
    }
    parts.next().is_none().then_some(Corner { position, uv })
}

fn mesh_of(parsed: Parsed) -> TriMesh {
    let colors = parsed.colored.then(|| {
        let mut colors = parsed.colors;
        // Some tools write 0..255 where everyone else writes 0..1.
        let bytes = colors.iter().flatten().any(|&c| c > 1.5);
        for c in colors.iter_mut().flatten() {
            // White, for vertices without a colour, is 1 in either.
            *c = if bytes && *c != 1.0 { *c / 255.0 } else { *c }.clamp(0.0, 1.0);
        }
        colors
    });
    TriMesh { positions: parsed.positions, faces: parsed.faces, colors, texture: None }
}

fn texture_of(parsed: &Parsed, image: Image, notes: &mut Vec<String>) -> Texture {
    let mut uvs = parsed.uvs.clone();
    let mut faces = parsed.uv_faces.clone();
    let bare = faces.iter().flatten().filter(|&&i| i == NONE).count();
    if bare > 0 {
        notes.push(format!("{bare} corners without texture coordinates take those of (0, 0)"));
        let origin = uvs.len() as u32;
        uvs.push([0.0; 2]);
        for i in faces.iter_mut().flatten().filter(|i| **i == NONE) {
            *i = origin;
        }
    }
    Texture { uvs, faces, image }
}

/// The materials of all libraries that are there.
fn library(parsed: &Parsed, path: &Path, notes: &mut Vec<String>) -> Vec<Material> {
    let folder = path.parent().unwrap_or_else(|| Path::new(""));
    let mut list = Vec::new();
    for names in &parsed.libraries {
        // One name that may hold spaces, or several names.
        let whole = [names.as_str()];
        let several: Vec<&str> = names.split_whitespace().collect();
        let names = if folder.join(names).is_file() { &whole[..] } else { &several[..] };
        for name in names {
            let file = folder.join(name.replace('\\', "/"));
            match std::fs::read(&file) {
                Ok(bytes) => {
                    let folder = file.parent().unwrap_or(folder);
                    list.extend(materials(&String::from_utf8_lossy(&bytes), folder));
                }
                Err(error) => notes.push(format!("{}: {error}", file.display())),
            }
        }
    }
    list
}

/// The image of the first material in use that has one and whose file is there.
fn image_of<'a>(
    parsed: &Parsed,
    library: &'a [Material],
    notes: &mut Vec<String>,
) -> Option<&'a Path> {
    let mut chosen: Option<&Path> = None;
    for (k, (name, start)) in parsed.materials.iter().enumerate() {
        let end = parsed.materials.get(k + 1).map_or(parsed.faces.len(), |next| next.1);
        if *start == end {
            continue;
        }
        let Some(image) = library.iter().find(|m| m.name == *name).and_then(|m| m.image.as_deref())
        else {
            continue;
        };
        if !image.is_file() {
            let note =
                format!("{}: no such file, material {name:?} has no texture", image.display());
            if !notes.contains(&note) {
                notes.push(note);
            }
        } else if chosen.is_none() {
            chosen = Some(image);
        } else if chosen != Some(image) {
            notes.push(format!(
                "{}: a mesh holds one texture, this one is left out",
                image.display()
            ));
        }
    }
    chosen
}
