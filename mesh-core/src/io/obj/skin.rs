//! What lies on the faces of an OBJ file: one texture, made of those of all materials and of the colours of the others.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::mtl::Materials;
use super::parse::Parsed;
use crate::io::atlas::{Faces, Look, NONE, atlas};
use crate::io::open::{self, Root};
use crate::io::remark::{counted, not_read};
use crate::io::{ReadMeshError, Remark};
use crate::{Budget, Image, Limits, OverLimit, Texture};

/// What a swatch of one colour takes on its way into the atlas, roughly.
const PER_SWATCH: u64 = 600;

/// The image files of the materials in use, in the order of the faces.
struct Files {
    /// Each with the name that a library has for it.
    list: Vec<(PathBuf, String)>,
    /// For each material its file.
    of: Vec<Option<usize>>,
}

/// The texture of the mesh; `None` where no material in use has an image that can be read.
pub(super) fn texture(
    parsed: &mut Parsed,
    materials: &Materials,
    root: &Root,
    (path, limits): (&Path, &Limits),
    budget: &mut Budget,
    remarks: &mut Vec<Remark>,
) -> Result<Option<Texture>, ReadMeshError> {
    let files = files(parsed, materials, root, remarks);
    let mut sheets = Sheets::default();
    let left_out = sheets.read(&files, path, limits, remarks)?;
    let Some(first) = sheets.images.first() else { return Ok(None) };
    let over = ReadMeshError::over_limit(path);
    let looks = sheets.looks(parsed, materials, &files);
    let main = parsed.used().find_map(|m| looks[m].image()).unwrap_or(PLAIN);
    let other = |m: usize| match looks[m] {
        Lies::Image(look) => look != main,
        Lies::Color(_) => true,
        Lies::Nothing => false,
    };
    if parsed.used().any(other) {
        // Where the atlas comes to nothing.
        let first = first.clone();
        let made = sheets.joined(parsed, &looks, main, limits, budget).map_err(&over)?;
        if let Some((texture, bare)) = made {
            counted(remarks, bare, |count| Remark::MissingTexcoords { count });
            counted(remarks, left_out, |count| Remark::OtherTextures { count });
            return Ok(Some(texture));
        }
        let others = files.list.len() - 1;
        counted(remarks, others, |count| Remark::OtherTextures { count });
        return one(parsed, main, first, budget, remarks).map(Some).map_err(&over);
    }
    counted(remarks, left_out, |count| Remark::OtherTextures { count });
    let image = sheets.images.swap_remove(0);
    one(parsed, main, image, budget, remarks).map(Some).map_err(&over)
}

/// The whole first image.
pub(super) const PLAIN: Look = Look { sheet: 0, scale: [1.0; 2], offset: [0.0; 2] };

/// What lies on the faces of a material.
#[derive(Clone, Copy)]
enum Lies {
    Image(Look),
    Color([f32; 3]),
    /// No library says.
    Nothing,
}

impl Lies {
    fn image(self) -> Option<Look> {
        if let Self::Image(look) = self { Some(look) } else { None }
    }
}

fn files(parsed: &Parsed, materials: &Materials, root: &Root, remarks: &mut Vec<Remark>) -> Files {
    let mut known: BTreeMap<PathBuf, usize> = BTreeMap::new();
    let mut files = Files { list: Vec::new(), of: vec![None; materials.maps.len()] };
    // Each material is looked up once.
    let mut seen = vec![false; materials.maps.len()];
    for material in parsed.used() {
        if std::mem::replace(&mut seen[material], true) {
            continue;
        }
        let Some(map) = &materials.maps[material] else { continue };
        match root.find(&materials.folders[map.library], &map.name) {
            Err(why) => not_read(remarks, &map.name, why),
            Ok(file) => {
                let next = files.list.len();
                let number = *known.entry(file.clone()).or_insert(next);
                if number == next {
                    files.list.push((file, map.name.clone()));
                }
                files.of[material] = Some(number);
            }
        }
    }
    files
}

/// The images that were read, and those of one pixel for materials of one colour.
#[derive(Default)]
struct Sheets {
    images: Vec<Image>,
    /// For each file its image.
    of: Vec<Option<usize>>,
}

impl Sheets {
    /// Reads the files; how many were left out as damaged or too large. Those after the first share half of the limit.
    fn read(
        &mut self,
        files: &Files,
        path: &Path,
        limits: &Limits,
        remarks: &mut Vec<Remark>,
    ) -> Result<usize, ReadMeshError> {
        let mut left_out = 0;
        let mut room = limits.max_pixels;
        for (file, name) in &files.list {
            let image = open::texture(path, file, &Limits { max_pixels: room, ..*limits });
            self.of.push(None);
            match image {
                Ok(Ok(image)) => {
                    let pixels = (image.width * image.height) as u64;
                    let most = if self.images.is_empty() { limits.max_pixels / 2 } else { room };
                    room = most.saturating_sub(pixels);
                    *self.of.last_mut().expect("one for each file") = Some(self.images.len());
                    self.images.push(image);
                }
                Ok(Err(why)) => not_read(remarks, name, why),
                Err(error) if self.images.is_empty() => return Err(error),
                // One that is damaged, or larger than there is room for; others may be neither.
                Err(_) => left_out += 1,
            }
        }
        Ok(left_out)
    }

    /// What lies on each material's faces.
    fn looks(&self, parsed: &Parsed, materials: &Materials, files: &Files) -> Vec<Lies> {
        let mut looks = vec![Lies::Nothing; materials.maps.len()];
        for material in parsed.used() {
            let sheet = files.of[material].and_then(|file| self.of[file]);
            looks[material] = match (sheet, &materials.maps[material], materials.colors[material]) {
                (Some(sheet), Some(map), _) => {
                    Lies::Image(Look { sheet, scale: map.scale, offset: map.offset })
                }
                (_, _, Some(color)) => Lies::Color(color),
                _ => Lies::Nothing,
            };
        }
        looks
    }

    /// All in one image; faces before the first material have what the first of them has.
    fn joined(
        mut self,
        parsed: &mut Parsed,
        lies: &[Lies],
        main: Look,
        limits: &Limits,
        budget: &mut Budget,
    ) -> Result<Option<(Texture, usize)>, OverLimit> {
        let mut swatches: BTreeMap<[u32; 3], usize> = BTreeMap::new();
        let mut looks = Vec::new();
        budget.reserve(&mut looks, lies.len() + 1)?;
        for lies in lies {
            let color = match *lies {
                Lies::Image(look) => {
                    looks.push(look);
                    continue;
                }
                Lies::Color(color) => color,
                Lies::Nothing => [1.0; 3],
            };
            let next = self.images.len();
            let sheet = *swatches.entry(color.map(f32::to_bits)).or_insert(next);
            if sheet == next {
                budget.take(PER_SWATCH)?;
                let data = color.to_vec();
                self.images.push(Image { height: 1, width: 1, channels: 3, data });
            }
            looks.push(Look { sheet, ..PLAIN });
        }
        looks.push(main);
        let faces = parsed.faces.len();
        let mut of_face = Vec::new();
        budget.fill(&mut of_face, faces, lies.len() as u32, 0)?;
        for (material, faces) in parsed.parts() {
            of_face[faces].fill(material as u32);
        }
        budget.fill(&mut parsed.uv_faces, faces, [NONE; 3], 0)?;
        let (uvs, corners) = (&parsed.uvs, &parsed.uv_faces);
        let faces = Faces { uvs, corners, look: &of_face, looks: &looks };
        atlas(&faces, &self.images, limits, budget)
    }
}

/// One image on all faces.
pub(super) fn one(
    parsed: &mut Parsed,
    look: Look,
    image: Image,
    budget: &mut Budget,
    remarks: &mut Vec<Remark>,
) -> Result<Texture, OverLimit> {
    let (mut uvs, mut faces) =
        (std::mem::take(&mut parsed.uvs), std::mem::take(&mut parsed.uv_faces));
    if look != PLAIN {
        for uv in &mut uvs {
            *uv = look.place(*uv);
        }
    }
    budget.fill(&mut faces, parsed.faces.len(), [NONE; 3], 0)?;
    let bare = faces.iter().flatten().filter(|&&i| i == NONE).count();
    if bare > 0 {
        let origin = uvs.len() as u32;
        budget.push(&mut uvs, [0.0; 2])?;
        for i in faces.iter_mut().flatten().filter(|i| **i == NONE) {
            *i = origin;
        }
    }
    counted(remarks, bare, |count| Remark::MissingTexcoords { count });
    Ok(Texture { uvs, faces, image })
}
