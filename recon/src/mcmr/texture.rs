//! The texture: an image around the sphere that the shape was.

use autodiff_lite::{Real, Var};
use mesh_core::{Image, Texture, TriMesh};
use ndarray::Array3;

use crate::atlas::Atlas;

/// Part of an image's columns that overlap.
const OVERLAP: usize = 8;
/// Texels along an edge of a face in an exported texture, at least.
const CELL: usize = 12;

/// An image `[N, S, S, C]` of a decoder, which knows of no other side, closed around a sphere:
/// `[N, S + 2, S - S/8, C]` for [`sphere_texture`](diff_raster::sphere_texture).
///
/// The last eighth of the columns fades into the first, so the image goes on over the back as smoothly as
/// anywhere else; above the first row and below the last stand the means of those rows, the poles.
pub(super) fn closed<F: Real>(image: Var<'_, F>) -> Var<'_, F> {
    let [_, _, columns, channels] = image.dims();
    let overlap = columns / OVERLAP;
    let kept = columns - overlap;
    let tape = image.tape();
    // How much the beginning counts in a column.
    let fade = Array3::from_shape_fn((1, kept, channels), |(_, j, _)| {
        F::from_f64(((j + 1) as f64 / (overlap + 1) as f64).min(1.0))
    });
    let fade = tape.constant(fade);
    let first = image.slice_axis(2, 0..kept);
    let last = image.slice_axis(2, kept..columns);
    // Behind the overlap the end counts nothing, so that what stands there does not matter.
    let beyond = first.slice_axis(2, overlap..kept);
    let end = tape.concat(&[last, beyond], 2);
    let around = end.add(first.sub(end).mul(fade));
    let pole = |row: usize| {
        let row = around.slice_axis(1, row..row + 1);
        let [n, _, w, c] = row.dims();
        let mean = row.mean_axis(2).reshape(&[n, 1, 1, c]);
        row.scale(F::zero()).add(mean).reshape(&[n, 1, w, c])
    };
    let [_, rows, ..] = around.dims::<4>();
    tape.concat(&[pole(0), around, pole(rows - 1)], 1)
}

/// A closed texture `[H, W, 3]` as plain numbers.
#[derive(Clone, Debug)]
pub(super) struct Globe {
    pub(super) rows: usize,
    pub(super) columns: usize,
    pub(super) data: Vec<f32>,
}

impl Globe {
    /// One image of a batch.
    pub(super) fn of(texture: Var<'_>, index: usize) -> Self {
        let [_, rows, columns, channels] = texture.dims();
        let size = rows * columns * channels;
        let value = texture.value();
        let data = value.as_slice().unwrap_or_default()[index * size..][..size].to_vec();
        Self { rows, columns, data }
    }

    /// Colours in the given directions.
    fn colors(&self, directions: &[f32]) -> Vec<f32> {
        let mut out = vec![0.0; directions.len()];
        let (data, height, width) = (&self.data[..], self.rows, self.columns);
        let texture = diff_raster::kernels::texture::Texture { data, height, width, channels: 3 };
        diff_raster::kernels::sphere::sphere_texture(texture, directions, &mut out);
        out
    }

    /// The mesh with this texture; `sphere` is where its vertices lie on the sphere.
    ///
    /// Each face gets texels of its own, taken from the sphere: a viewer that interpolates texture
    /// coordinates over faces shows no seam at the back and no star at the poles, where an image of longitude
    /// and latitude would have both. Vertices have colours too, for formats without textures.
    pub(super) fn on(&self, mut mesh: TriMesh, sphere: &[[f32; 3]]) -> TriMesh {
        let columns = (mesh.faces.len().div_ceil(2) as f64).sqrt().ceil() as usize;
        let side = (columns * CELL).next_multiple_of(4);
        let atlas = Atlas::new(mesh.faces.len(), side).expect("a cell has room for a face");
        let mut image = Image::new(side, side, 3);
        for (index, face) in mesh.faces.iter().enumerate() {
            let corners = face.map(|v| sphere[v as usize]);
            let (mut texels, mut directions) = (Vec::new(), Vec::new());
            atlas.texels(index, |texel, b| {
                texels.push(texel);
                directions
                    .extend((0..3).map(|k| (0..3).map(|c| b[c] * corners[c][k]).sum::<f32>()));
            });
            for (texel, color) in texels.iter().zip(self.colors(&directions).as_chunks::<3>().0) {
                image.data[3 * texel..3 * texel + 3]
                    .copy_from_slice(&color.map(|c| c.clamp(0.0, 1.0)));
            }
        }
        let faces = mesh.faces.len();
        let uvs = (0..faces).flat_map(|f| atlas.corners(f)).collect();
        let corners = (0..faces as u32).map(|f| [3 * f, 3 * f + 1, 3 * f + 2]).collect();
        mesh.texture = Some(Texture { uvs, faces: corners, image });
        let colors = self.colors(sphere.as_flattened());
        mesh.colors =
            Some(colors.as_chunks::<3>().0.iter().map(|c| c.map(|v| v.clamp(0.0, 1.0))).collect());
        mesh
    }
}
