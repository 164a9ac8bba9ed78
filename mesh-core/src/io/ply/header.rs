//! The header of a PLY file: what the rest consists of.

use std::collections::BTreeSet;
use std::path::Path;

use crate::Budget;
use crate::io::ReadMeshError;

/// What is looked at of a line: a path is no longer.
const LONGEST_LINE: usize = 4096;

/// How the numbers after the header are written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    Ascii,
    Little,
    Big,
}

/// A type of number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

#[derive(Clone, Debug)]
pub(super) struct Property {
    pub(super) name: String,
    /// The type of the length, for a list.
    pub(super) length: Option<Scalar>,
    pub(super) scalar: Scalar,
}

#[derive(Clone, Debug)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: u64,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// The place of the first property with one of these names that is a number, not a list.
    pub(super) fn number_named(&self, names: &[&str]) -> Option<usize> {
        self.properties.iter().position(|p| names.contains(&p.name.as_str()) && p.length.is_none())
    }
}

#[derive(Debug)]
pub(super) struct Header {
    pub(super) format: Format,
    pub(super) elements: Vec<Element>,
    pub(super) texture: Option<String>,
    /// How many more are named.
    pub(super) other_textures: usize,
    /// Where the numbers begin.
    pub(super) end: usize,
    /// How many lines the header has.
    pub(super) lines: usize,
}

impl Scalar {
    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// What 1.0 is in channels of this type of which `largest` is the greatest value: some programs write bytes as wider numbers or
    /// as floats. Floats are bytes where all are whole (`is_whole`) and one is above 1, since light above 1 has fractions.
    pub(super) fn white(self, largest: f32, is_whole: bool) -> f64 {
        match self {
            Self::I8 => 127.0,
            Self::U8 => 255.0,
            Self::F32 | Self::F64 => {
                if is_whole && largest > 1.0 {
                    255.0
                } else {
                    1.0
                }
            }
            _ if largest <= 255.0 => 255.0,
            Self::I16 => 32767.0,
            Self::U16 => 65535.0,
            _ if largest <= 65535.0 => 65535.0,
            Self::I32 => 2_147_483_647.0,
            Self::U32 => 4_294_967_295.0,
        }
    }

    fn named(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }
}

/// What an element or a property takes beside its name, while its list grows.
const ENTRY: u64 = 240;

/// A line of the header.
struct Line<'a> {
    path: &'a Path,
    /// Counted from 1.
    number: usize,
    text: &'a str,
}

impl Line<'_> {
    /// What is said of it where it is wrong.
    fn bad(&self, field: &str, expected: &str) -> ReadMeshError {
        let found = format!("{:?}", self.text);
        ReadMeshError::at_line(self.path, Some(self.number), field, found, expected)
    }

    fn scalar(&self, name: &str) -> Result<Scalar, ReadMeshError> {
        Scalar::named(name).ok_or_else(|| self.bad("property", "a type"))
    }
}

/// What the lines so far say.
#[derive(Default)]
struct Draft {
    format: Option<Format>,
    elements: Vec<Element>,
    names: BTreeSet<String>,
    texture: Option<String>,
    other_textures: usize,
}

impl Draft {
    /// Takes what a line says; whether it was the last one.
    fn take(&mut self, line: &Line<'_>, budget: &mut Budget) -> Result<bool, ReadMeshError> {
        // No line that counts has more words; a comment may.
        let words: Vec<&str> = line.text.split_whitespace().take(8).collect();
        match words.as_slice() {
            ["comment", "TextureFile", ..] => {
                let name = line.text.split_once("TextureFile");
                let name = name.map(|(_, name)| name.trim().to_owned());
                match &self.texture {
                    None => self.texture = name,
                    Some(first) => self.other_textures += usize::from(name.as_ref() != Some(first)),
                }
            }
            [] | ["obj_info" | "comment", ..] => {}
            ["format", kind, _version] => {
                self.format = Some(match *kind {
                    "ascii" => Format::Ascii,
                    "binary_little_endian" => Format::Little,
                    "binary_big_endian" => Format::Big,
                    _ => {
                        let known = "ascii, binary_little_endian or .._big_endian";
                        return Err(line.bad("format", known));
                    }
                });
            }
            ["element", name, count] => self.element(line, [name, count], budget)?,
            ["property", kind @ .., name] => self.property(line, kind, name, budget)?,
            ["end_header"] => return Ok(true),
            _ => {
                let known = "format, element, property, comment or end_header";
                return Err(line.bad("header", known));
            }
        }
        Ok(false)
    }

    fn element(
        &mut self,
        line: &Line<'_>,
        [name, count]: [&str; 2],
        budget: &mut Budget,
    ) -> Result<(), ReadMeshError> {
        let count = count.parse().map_err(|_| line.bad("element", "a name and a count"))?;
        let needed = ENTRY + 2 * name.len() as u64;
        budget.take(needed).map_err(ReadMeshError::over_limit(line.path))?;
        if !self.names.insert(name.to_owned()) {
            return Err(line.bad("element", "each name once"));
        }
        self.elements.push(Element { name: name.to_owned(), count, properties: Vec::new() });
        Ok(())
    }

    /// Adds a property of the last element.
    fn property(
        &mut self,
        line: &Line<'_>,
        kind: &[&str],
        name: &str,
        budget: &mut Budget,
    ) -> Result<(), ReadMeshError> {
        let (length, scalar) = match kind {
            [one] => (None, line.scalar(one)?),
            ["list", length, one] => (Some(line.scalar(length)?), line.scalar(one)?),
            _ => return Err(line.bad("property", "TYPE NAME or list TYPE TYPE NAME")),
        };
        let Some(element) = self.elements.last_mut() else {
            return Err(line.bad("property", "an element before it"));
        };
        let needed = ENTRY + name.len() as u64;
        budget.take(needed).map_err(ReadMeshError::over_limit(line.path))?;
        element.properties.push(Property { name: name.to_owned(), length, scalar });
        Ok(())
    }
}

/// Reads the header of the file `path`.
pub(super) fn parse(
    bytes: &[u8],
    path: &Path,
    budget: &mut Budget,
) -> Result<Header, ReadMeshError> {
    let (mut position, mut number) = (0, 0);
    let mut draft = Draft::default();
    loop {
        let rest = &bytes[position..];
        let Some(length) = rest.iter().position(|&b| b == b'\n') else {
            let what = if number == 0 { "ply" } else { "end_header" };
            return Err(ReadMeshError::malformed(path, "header", "no such line", what));
        };
        number += 1;
        position += length + 1;
        let text = String::from_utf8_lossy(&rest[..length.min(LONGEST_LINE)]);
        let line = Line { path, number, text: text.trim() };
        if number == 1 {
            if line.text != "ply" {
                return Err(line.bad("first line", "ply"));
            }
        } else if draft.take(&line, budget)? {
            break;
        }
    }
    let Draft { format, elements, texture, other_textures, .. } = draft;
    let format = format.ok_or_else(|| {
        ReadMeshError::malformed(path, "format", "no such line", "format ascii 1.0 or a binary one")
    })?;
    Ok(Header { format, elements, texture, other_textures, end: position, lines: number })
}
