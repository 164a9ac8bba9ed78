//! What is read from material libraries: which image lies on which material, and else its colour.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use super::lines::{Lines, split_word};
use super::parse::{Parsed, UNCOLORED};
use crate::io::open::{Root, folder_of};
use crate::io::regular;
use crate::io::remark::{counted, not_read};
use crate::io::{NotRead, ReadMeshError, Remark};
use crate::{Budget, Limits};

/// The image of a material.
pub(super) struct MapFile {
    pub(super) name: String,
    /// Which library names it.
    pub(super) library: usize,
    /// What texture coordinates are multiplied by (`-s`), and what is then added to them (`-o`).
    pub(super) scale: [f32; 2],
    pub(super) offset: [f32; 2],
}

/// For each material that the mesh uses, its `map_Kd` and its `Kd`.
#[derive(Default)]
pub(super) struct Materials {
    pub(super) maps: Vec<Option<MapFile>>,
    /// sRGB.
    pub(super) colors: Vec<Option<[f32; 3]>>,
    /// The folders of the libraries, from which the names of their images start.
    pub(super) folders: Vec<PathBuf>,
}

impl Materials {
    /// What the mesh's libraries say of the materials that it uses; each library is read once.
    pub(super) fn read(
        parsed: &Parsed,
        root: &Root,
        path: &Path,
        limits: &Limits,
        remarks: &mut Vec<Remark>,
    ) -> Result<Self, ReadMeshError> {
        let mut materials = Self::default();
        materials.maps.resize_with(parsed.names.len(), || None);
        materials.colors.resize(parsed.names.len(), None);
        let mut defined = vec![false; parsed.names.len()];
        let mut seen = BTreeSet::new();
        for names in &parsed.libraries {
            // One name that may hold spaces, or several names.
            let whole = root.find(root.folder(), names);
            let mut several = names.split_whitespace();
            let is_one = whole.is_ok() || several.nth(1).is_none();
            let most = if is_one { 1 } else { usize::MAX };
            for name in names.split_whitespace().take(most) {
                let name = if is_one { names } else { name };
                let file = match root.find(root.folder(), name) {
                    Ok(file) => file,
                    Err(why) => {
                        not_read(remarks, name, why);
                        continue;
                    }
                };
                if !seen.insert(file.clone()) {
                    continue;
                }
                let Ok(bytes) = regular(&file) else {
                    not_read(remarks, name, NotRead::Missing);
                    continue;
                };
                let mut budget = limits.budget(bytes.len() as u64);
                materials
                    .library(&bytes, folder_of(&file), &parsed.names, &mut defined, &mut budget)
                    .map_err(ReadMeshError::over_limit(path))?;
            }
        }
        Ok(materials)
    }

    /// Takes from a library what it says of the materials in use; the first to define one counts.
    fn library(
        &mut self,
        bytes: &[u8],
        folder: &Path,
        names: &BTreeMap<String, u32>,
        defined: &mut [bool],
        budget: &mut Budget,
    ) -> Result<(), crate::OverLimit> {
        let mut current = None;
        let mut lines = Lines::new(bytes);
        while let Some((_, line)) = lines.next(budget)? {
            let (word, rest) = split_word(&line);
            match word {
                "newmtl" => {
                    let material = names.get(rest).map(|&m| m as usize);
                    current = material.filter(|&m| !std::mem::replace(&mut defined[m], true));
                }
                "map_Kd" | "map_kd" => {
                    if let (Some(material), Some(map)) = (current, map(rest, self.folders.len())) {
                        self.maps[material] = Some(map);
                    }
                }
                "Kd" => {
                    if let Some(material) = current {
                        self.colors[material] = color(rest);
                    }
                }
                _ => {}
            }
        }
        self.folders.push(folder.to_owned());
        Ok(())
    }

    /// Colours of the vertices by the materials of their faces, the first face's where several have one; white where none has.
    /// Empty where no material in use has a colour, or all are white.
    pub(super) fn vertex_colors(
        &self,
        parsed: &Parsed,
        budget: &mut Budget,
        remarks: &mut Vec<Remark>,
    ) -> Result<Vec<[f32; 3]>, crate::OverLimit> {
        let white = [1.0; 3];
        let is_colored = |m: usize| self.colors[m].is_some_and(|color| color != white);
        let mut colors = Vec::new();
        if !parsed.used().any(is_colored) {
            return Ok(colors);
        }
        budget.fill(&mut colors, parsed.positions.len(), UNCOLORED, 0)?;
        let mut between = 0;
        for (material, faces) in parsed.parts() {
            let color = self.colors[material].unwrap_or(white);
            for &v in parsed.faces[faces].iter().flatten() {
                let given = &mut colors[v as usize];
                if *given == UNCOLORED {
                    *given = color;
                } else if *given != color {
                    between += 1;
                }
            }
        }
        colors.iter_mut().filter(|c| **c == UNCOLORED).for_each(|c| *c = white);
        counted(remarks, between, |count| Remark::BetweenColors { count });
        Ok(colors)
    }
}

/// Three shares of red, green and blue; `None` for spectra, and for other spaces of colour.
fn color(rest: &str) -> Option<[f32; 3]> {
    let mut words = rest.split_whitespace().map(|word| word.parse::<f32>().ok());
    let mut next = || words.next()?.filter(|c| c.is_finite()).map(|c| c.clamp(0.0, 1.0));
    Some([next()?, next()?, next()?])
}

/// How many words follow an option of a texture statement.
fn words_after(option: &str) -> Option<usize> {
    match option {
        "-blendu" | "-blendv" | "-boost" | "-cc" | "-clamp" | "-imfchan" | "-texres" | "-bm"
        | "-type" => Some(1),
        "-mm" => Some(2),
        "-o" | "-s" | "-t" => Some(3),
        _ => None,
    }
}

/// What a texture statement says; the file name stands after the options and may hold spaces.
fn map(mut rest: &str, library: usize) -> Option<MapFile> {
    let (mut scale, mut offset) = ([1.0; 2], [0.0; 2]);
    while let (option, Some(count)) = (split_word(rest).0, words_after(split_word(rest).0)) {
        // `-o`, `-s` and `-t` take one to three numbers; a word that is none ends them.
        rest = split_word(rest).1;
        for k in 0..count {
            let (word, after) = split_word(rest);
            let number = word.parse::<f32>().ok();
            if k > 0 && count == 3 && number.is_none() {
                break;
            }
            let slot = match option {
                "-s" => scale.get_mut(k),
                "-o" => offset.get_mut(k),
                _ => None,
            };
            if let (Some(slot), Some(number)) = (slot, number.filter(|n| n.is_finite())) {
                *slot = number;
            }
            rest = after;
        }
    }
    let name = (!rest.is_empty()).then(|| rest.to_owned())?;
    Some(MapFile { name, library, scale, offset })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn images_are_found_behind_options_comments_and_backslashes() {
        let text = "# lib\nnewmtl a\r\n map_Kd -s 2 -3 -bm 0.5 tex\\my image.png # it\n\
                    newmtl b\nKd 1 0 0\nnewmtl c d\nmap_Kd -o 1 2 3 x#2.png\nnewmtl unused\n\
                    map_Kd y.png\nnewmtl a\nmap_Kd second.png\n";
        let names = [("a", 0), ("b", 1), ("c d", 2)].map(|(name, m)| (name.to_owned(), m)).into();
        let mut materials = Materials::default();
        materials.maps.resize_with(3, || None);
        materials.colors.resize(3, None);
        let mut budget = Limits::default().budget(0);
        materials
            .library(text.as_bytes(), Path::new("f"), &names, &mut [false; 3], &mut budget)
            .unwrap();
        let maps: Vec<_> =
            materials.maps.iter().map(|m| m.as_ref().map(|m| m.name.as_str())).collect();
        assert_eq!(maps, [Some("tex\\my image.png"), None, Some("x#2.png")]);
        let placed: Vec<_> = materials.maps.iter().flatten().map(|m| (m.scale, m.offset)).collect();
        assert_eq!(placed, [([2.0, -3.0], [0.0; 2]), ([1.0; 2], [1.0, 2.0])]);
        assert_eq!(materials.folders, [Path::new("f")]);
    }
}
