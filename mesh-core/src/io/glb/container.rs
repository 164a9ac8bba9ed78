//! The container: a document, and the binary chunk behind it.

use std::collections::BTreeMap;
use std::path::Path;

use super::document::{Document, PER_ITEM, PER_OBJECT};
use super::{BIN, JSON, MAGIC};
use crate::io::open::Root;
use crate::io::{NotRead, ReadMeshError};
use crate::{Budget, Limits};

/// Extensions that are read, or that leave positions and indices as they are.
fn is_harmless(extension: &str) -> bool {
    const KNOWN: [&str; 7] = [
        "KHR_mesh_quantization",
        "KHR_texture_transform",
        "KHR_lights_punctual",
        // Kinds of images: those that are not read are left out.
        "KHR_texture_basisu",
        "EXT_texture_webp",
        "EXT_texture_avif",
        "MSFT_texture_dds",
    ];
    KNOWN.contains(&extension) || extension.starts_with("KHR_materials_")
}

/// A GLB file that was opened.
pub(super) struct Glb<'a> {
    pub(super) path: &'a Path,
    pub(super) document: Document,
    pub(super) bin: &'a [u8],
    pub(super) limits: &'a Limits,
    /// As [`Contents::root`].
    pub(super) root: Option<Root>,
    /// As [`Contents::only_uvs`].
    pub(super) only_uvs: bool,
}

/// What was left out on the way.
#[derive(Default)]
pub(super) struct LeftOut {
    pub(super) lines: usize,
    pub(super) textures: usize,
    /// Images that were not read.
    pub(super) unread: BTreeMap<String, NotRead>,
    /// Parts whose texture would be multiplied by colours of its own.
    pub(super) tints: usize,
    /// Corners of parts without the texture.
    pub(super) bare: usize,
}

impl<'a> Glb<'a> {
    pub(super) fn open(
        bytes: &'a [u8],
        path: &'a Path,
        limits: &'a Limits,
        budget: &mut Budget,
    ) -> Result<Self, ReadMeshError> {
        let bad = |field: &str, found: &dyn ToString, expected: &str| {
            ReadMeshError::malformed(path, field, found.to_string(), expected)
        };
        let word = |at: usize| {
            let four = bytes.get(at..at + 4)?;
            Some(u32::from_le_bytes([four[0], four[1], four[2], four[3]]))
        };
        if word(0) != Some(MAGIC) {
            return Err(bad("first bytes", &"others", "glTF"));
        }
        match word(4) {
            Some(2) => {}
            Some(v) => return Err(bad("version", &v, "2")),
            None => return Err(bad("header", &"the end of the file", "12 bytes")),
        }
        let chunk = |at: usize, kind: u32, name: &str| {
            let (Some(length), Some(found)) = (word(at), word(at + 4)) else {
                return Err(bad(name, &"the end of the file", "a chunk"));
            };
            if found != kind {
                return Err(bad(name, &format!("type {found:#x}"), &format!("type {kind:#x}")));
            }
            let start = at + 8;
            let data = bytes.get(start..start.saturating_add(length as usize));
            data.ok_or_else(|| {
                let left = bytes.len() - start;
                bad(name, &format!("{left} bytes"), &format!("the {length} that it claims"))
            })
        };
        let json = chunk(12, JSON, "JSON chunk")?;
        let next = 20 + json.len();
        let bin = if next < bytes.len() { chunk(next, BIN, "BIN chunk")? } else { &[] };
        let text = json.trim_ascii_end();
        // Spaces pad the chunk, but some writers take zeros.
        let end = text.iter().rposition(|&b| b != 0).map_or(0, |last| last + 1);
        budget.take(json_bytes(&text[..end])).map_err(ReadMeshError::over_limit(path))?;
        let document: Document = serde_json::from_slice(&text[..end])
            .map_err(|e| bad("JSON chunk", &e, "a glTF 2.0 document"))?;
        if let Some(name) = document.extensions_required.iter().find(|name| !is_harmless(name)) {
            return Err(bad("extensionsRequired", name, "none that changes geometry or colours"));
        }
        Ok(Self { path, document, bin, limits, root: None, only_uvs: false })
    }

    pub(super) fn bad(&self, field: &str, found: impl ToString, expected: &str) -> ReadMeshError {
        ReadMeshError::malformed(self.path, field, found, expected)
    }

    pub(super) fn get<'b, T>(
        &self,
        list: &'b [T],
        index: usize,
        what: &str,
    ) -> Result<&'b T, ReadMeshError> {
        list.get(index).ok_or_else(|| {
            self.bad(what, format!("index {index}"), &format!("less than {}", list.len()))
        })
    }

    pub(super) fn view(&self, index: usize, name: &str) -> Result<&'a [u8], ReadMeshError> {
        let view = self.get(&self.document.buffer_views, index, "bufferView")?;
        let buffer = self.get(&self.document.buffers, view.buffer, "buffer")?;
        if view.buffer != 0 || buffer.uri.is_some() {
            return Err(self.bad(name, "data in another file", "data in the BIN chunk"));
        }
        let end = view.byte_offset.saturating_add(view.byte_length);
        let range = view.byte_offset as usize..end as usize;
        self.bin.get(range).ok_or_else(|| {
            let found = format!("bytes {} to {end} of {}", view.byte_offset, self.bin.len());
            self.bad(name, found, "a bufferView inside the BIN chunk")
        })
    }
}

/// What a document may take in memory, by the brackets and commas of its text: `{}` of two bytes
/// may become an object of a hundred.
fn json_bytes(text: &[u8]) -> u64 {
    let (mut objects, mut items) = (0, 0);
    for byte in text {
        objects += u64::from(*byte == b'{');
        items += u64::from(matches!(byte, b',' | b'['));
    }
    objects * PER_OBJECT + items * PER_ITEM + 2 * text.len() as u64
}
