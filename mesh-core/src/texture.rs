//! The colours of a texture.

use std::borrow::Cow;

use crate::vector::interpolate;
use crate::{SurfacePoint, Texture, TriMesh, bilinear_repeat};

impl Texture {
    /// The colour at a texture coordinate, bilinear; beyond 0 to 1 the image is repeated, as OBJ and glTF (by default) have it.
    ///
    /// # Panics
    /// If the image has no pixels.
    pub fn color(&self, [u, v]: [f32; 2]) -> [f32; 3] {
        let image = &self.image;
        let texel = |i, j| {
            let texel = image.pixel(i, j);
            std::array::from_fn(|c| texel[c.min(image.channels - 1)])
        };
        let place = [u * image.width as f32 - 0.5, (1.0 - v) * image.height as f32 - 0.5];
        bilinear_repeat([image.width, image.height], place, texel)
    }

    /// The colour at a place of the surface.
    ///
    /// # Panics
    /// If the texture has no such face, or the image no pixels.
    pub fn color_at(&self, point: &SurfacePoint) -> [f32; 3] {
        let corners = self.faces[point.face as usize].map(|uv| self.uvs[uv as usize]);
        self.color(interpolate(point.barycentric, &corners))
    }
}

impl TriMesh {
    /// The colours of the vertices, or where there are none those of the texture, each at the first place that a
    /// face gives its vertex; white where no face does. `None` for a mesh without either.
    ///
    /// # Panics
    /// If the texture does not fit the mesh.
    pub fn vertex_colors(&self) -> Option<Cow<'_, [[f32; 3]]>> {
        if let Some(colors) = &self.colors {
            return Some(Cow::Borrowed(colors));
        }
        let texture = self.texture.as_ref()?;
        let mut colors = vec![None; self.positions.len()];
        for (face, uv) in self.faces.iter().zip(&texture.faces) {
            for (&v, &t) in face.iter().zip(uv) {
                colors[v as usize].get_or_insert_with(|| texture.color(texture.uvs[t as usize]));
            }
        }
        Some(colors.into_iter().map(|color| color.unwrap_or([1.0; 3])).collect())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use crate::{Image, SurfacePoint, Texture, TriMesh};

    #[test]
    fn colors_of_places() {
        // Red to the left, green to the right.
        let image = Image { height: 1, width: 2, channels: 3, data: vec![1., 0., 0., 0., 1., 0.] };
        let uvs = vec![[0.25, 0.5], [0.75, 0.5], [9.75, -9.0]];
        let texture = Texture { uvs, faces: vec![[0, 1, 2]], image };
        assert_eq!(texture.color([0.5, 0.5]), [0.5, 0.5, 0.0]);
        assert_eq!(texture.color([-6.75, 2.0]), [1.0, 0.0, 0.0]);
        assert_eq!(texture.color([3.75, 0.5]), [0.0, 1.0, 0.0]);
        let point = SurfacePoint { face: 0, barycentric: [0.75, 0.25, 0.0] };
        assert_eq!(texture.color_at(&point), [0.75, 0.25, 0.0]);

        let positions = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [5.0; 3]];
        let bare = TriMesh::new(positions, vec![[0, 1, 2]]);
        assert_eq!(bare.vertex_colors(), None);
        let mesh = TriMesh { texture: Some(texture), ..bare };
        let expected = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [1.0; 3]];
        assert_eq!(mesh.vertex_colors().unwrap(), &expected[..]);
        let own = mesh.colored([0.5; 3]);
        assert_eq!(own.vertex_colors().unwrap(), &[[0.5; 3]; 4][..]);
    }
}
