//! What lies on the parts of a GLB file: a texture, and the colours that it is multiplied by.

use std::path::PathBuf;

use super::container::{Glb, LeftOut};
use super::document::{Material, TextureInfo, TextureTransform};
use super::soup::Soup;
use super::uri;
use crate::io::open::Root;
use crate::io::{NotRead, ReadMeshError, open};
use crate::{Image, linear_to_srgb, srgb_to_linear};

/// The texture of a material and its colour, of linear light.
pub(super) struct Look<'a> {
    pub(super) texture: Option<&'a TextureInfo>,
    pub(super) factor: [f32; 3],
}

impl<'a> Look<'a> {
    pub(super) fn of(material: Option<&'a Material>) -> Self {
        let Some(material) = material else { return Self { texture: None, factor: [1.0; 3] } };
        let surface = &material.pbr_metallic_roughness;
        let (mut texture, mut factor) =
            (surface.base_color_texture.as_ref(), surface.base_color_factor);
        // Older programs say it there alone; where both stand there they say the same.
        if let (None, None, Some(diffuse)) =
            (texture, factor, &material.extensions.specular_glossiness)
        {
            (texture, factor) = (diffuse.diffuse_texture.as_ref(), diffuse.diffuse_factor);
        }
        Self { texture, factor: factor.map_or([1.0; 3], |f| [f[0], f[1], f[2]]) }
    }
}

impl TextureInfo {
    /// Which of a part's lists of texture coordinates counts.
    fn set(&self) -> u32 {
        let transform = self.extensions.transform.as_ref();
        transform.and_then(|transform| transform.tex_coord).unwrap_or(self.tex_coord)
    }
}

impl TextureTransform {
    /// Where a texture coordinate comes to lie; v goes down before and after.
    fn apply(&self, [u, v]: [f32; 2]) -> [f32; 2] {
        let [x, y] = self.scale.unwrap_or([1.0; 2]);
        let (sin, cos) = self.rotation.sin_cos();
        let [u, v] = [u * x, v * y];
        [cos * u + sin * v + self.offset[0], cos * v - sin * u + self.offset[1]]
    }
}

impl Glb<'_> {
    /// Whether a texture is the one that the mesh gets: the first that can be read.
    pub(super) fn lies(
        &self,
        info: &TextureInfo,
        soup: &mut Soup,
        left_out: &mut LeftOut,
    ) -> Result<bool, ReadMeshError> {
        let texture = self.get(&self.document.textures, info.index, "texture")?;
        let Some(source) = texture.source else {
            // Only an extension names the image, of a kind of its own.
            left_out.unread.insert(format!("texture {}", info.index), NotRead::UnknownKind);
            return Ok(false);
        };
        if let Some((first, _)) = &soup.image {
            let lies = info.set() == 0 && *first == source;
            left_out.textures += usize::from(!lies);
            return Ok(lies);
        }
        if info.set() != 0 {
            left_out.textures += 1;
            return Ok(false);
        }
        let name = self.image_name(source)?;
        if left_out.unread.contains_key(&name) {
            return Ok(false);
        }
        match self.image(source)? {
            Ok(image) => {
                soup.image = Some((source, image));
                Ok(true)
            }
            Err(why) => {
                left_out.unread.insert(name, why);
                Ok(false)
            }
        }
    }

    /// What a remark calls an image.
    fn image_name(&self, index: usize) -> Result<String, ReadMeshError> {
        let image = self.get(&self.document.images, index, "image")?;
        let name = image.uri.as_deref().filter(|uri| !uri.starts_with("data:"));
        Ok(name.map_or_else(|| format!("image {index}"), |uri| uri.chars().take(200).collect()))
    }

    /// Where an image of the file, or of one beside it, is decoded.
    fn image(&self, index: usize) -> Result<Result<Image, NotRead>, ReadMeshError> {
        let image = self.get(&self.document.images, index, "image")?;
        if let Some(view) = image.buffer_view {
            return open::picture(self.path, self.view(view, "image")?, self.path, self.limits);
        }
        match (&image.uri, &self.root) {
            (Some(data), _) if data.starts_with("data:") => match uri::data(data) {
                Some(bytes) => open::picture(self.path, &bytes, self.path, self.limits),
                None => Ok(Err(NotRead::UnknownKind)),
            },
            (Some(uri), Some(root)) => match found(root, uri) {
                Ok(file) => open::texture(self.path, &file, self.limits),
                Err(why) => Ok(Err(why)),
            },
            _ => Ok(Err(NotRead::Missing)),
        }
    }

    pub(super) fn texcoords(
        &self,
        accessor: usize,
        transform: Option<&TextureTransform>,
        base: usize,
        soup: &mut Soup,
        budget: &mut crate::Budget,
    ) -> Result<(), ReadMeshError> {
        let count = soup.positions.len() - base;
        let uvs = self.floats::<2>(accessor, "TEXCOORD_0")?;
        self.as_many(&uvs, count, "TEXCOORD_0")?;
        let filled = budget.fill(&mut soup.uvs, base, [0.0; 2], count);
        filled.map_err(ReadMeshError::over_limit(self.path))?;
        for k in 0..count {
            let uv: [f32; 2] = self.row(&uvs, k, "TEXCOORD_0")?;
            let [u, v] = transform.map_or(uv, |transform| transform.apply(uv));
            if !(u.is_finite() && v.is_finite()) {
                let found = format!("{uv:?} to [{u}, {v}]");
                return Err(self.bad("KHR_texture_transform", found, "finite numbers"));
            }
            soup.uvs.push([u, 1.0 - v]);
        }
        soup.split = true;
        Ok(())
    }
}

/// The file that a URI stands for: by the name as it is, which some programs write, or as URIs have it.
fn found(root: &Root, uri: &str) -> Result<PathBuf, NotRead> {
    let find = |name: &str| root.find(root.folder(), name);
    match (find(uri), uri::decoded(uri)) {
        (Err(NotRead::Missing), Some(name)) => find(&name),
        (found, _) => found,
    }
}

/// Multiplies what a texture shows by a colour of linear light, as glTF has it.
pub(super) fn tinted(mut image: Image, tint: [f32; 3]) -> Image {
    if tint == [1.0; 3] {
        return image;
    }
    for pixel in image.data.chunks_exact_mut(3) {
        for (c, t) in pixel.iter_mut().zip(tint) {
            *c = linear_to_srgb((srgb_to_linear(*c) * t).clamp(0.0, 1.0));
        }
    }
    image
}
