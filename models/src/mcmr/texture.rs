//! The texture: an image around the sphere that the shape was.

use std::f32::consts::PI;

use autodiff_lite::{Real, Var};
use mesh_core::vector::interpolate;
use mesh_core::{Image, TriMesh, bilinear};
use ndarray::Array3;
use recon::atlas::{Atlas, mean_edge};

/// Part of an image's columns that overlap.
const OVERLAP: usize = 8;
/// Texels along a mean edge.
const EDGE: f32 = 12.0;
/// The longest side of a texture.
const MOST: usize = 4096;

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

/// Where a direction falls on a texture that has a seam, longitude and latitude as the published code has them: right and
/// down, -1 to 1, the centres of the outermost texels being the ends.
pub(super) fn seamed_place([x, y, z]: [f32; 3]) -> [f32; 2] {
    let [around, down] = [x.atan2(z), x.hypot(z).atan2(y)];
    [around / PI, 2.0 * down / PI - 1.0]
}

/// A texture `[H, W, 3]` as plain numbers.
#[derive(Clone, Debug)]
pub(super) struct Globe {
    pub(super) rows: usize,
    pub(super) columns: usize,
    pub(super) data: Vec<f32>,
    /// Whether it is [`closed`].
    pub(super) is_closed: bool,
}

impl Globe {
    /// One image of a batch.
    pub(super) fn of(texture: Var<'_>, index: usize, is_closed: bool) -> Self {
        let [_, rows, columns, channels] = texture.dims();
        let size = rows * columns * channels;
        let value = texture.value();
        let data = value.as_slice()[index * size..][..size].to_vec();
        Self { rows, columns, data, is_closed }
    }

    /// Colours in the given directions.
    fn colors(&self, directions: &[f32]) -> Vec<f32> {
        if !self.is_closed {
            return directions.as_chunks::<3>().0.iter().flat_map(|&d| self.seamed(d)).collect();
        }
        let mut out = vec![0.0; directions.len()];
        let (data, height, width) = (&self.data[..], self.rows, self.columns);
        let texture = diff_raster::kernels::texture::Texture { data, height, width, channels: 3 };
        diff_raster::kernels::sphere::sphere_texture(texture, directions, &mut out);
        out
    }

    /// The colour in a direction, between the texels of a texture that has a seam.
    fn seamed(&self, direction: [f32; 3]) -> [f32; 3] {
        let [x, y] = seamed_place(direction);
        let at = |place: f32, count: usize| 0.5 * (place + 1.0) * (count - 1) as f32;
        let texels = self.data.as_chunks::<3>().0;
        let place = [at(x, self.columns), at(y, self.rows)];
        bilinear([self.columns, self.rows], place, |i, j| texels[i * self.columns + j])
    }

    /// The mesh with this texture; `sphere` is where its vertices lie on the sphere.
    ///
    /// Each face gets texels in its chart, taken from the sphere: a viewer that interpolates texture
    /// coordinates over faces shows no seam at the back and no star at the poles, where an image of longitude
    /// and latitude would have both. Vertices have colours too, for formats without textures.
    pub(super) fn on(&self, mut mesh: TriMesh, sphere: &[[f32; 3]]) -> TriMesh {
        let edge = mean_edge(&mesh.positions, &mesh.faces);
        let density = if edge.is_finite() && edge > 0.0 { EDGE / edge } else { 0.0 };
        let atlas = Atlas::new(&mesh.positions, &mesh.faces, density, MOST);
        let mut image = Image::new(atlas.side(), atlas.side(), 3);
        for texels in atlas.texels().chunks(1024) {
            let directions: Vec<f32> = texels
                .iter()
                .flat_map(|texel| {
                    let corners = mesh.faces[texel.face as usize].map(|v| sphere[v as usize]);
                    interpolate(texel.barycentric, &corners)
                })
                .collect();
            for (texel, color) in texels.iter().zip(self.colors(&directions).as_chunks::<3>().0) {
                image.data[3 * texel.index as usize..][..3]
                    .copy_from_slice(&color.map(|c| c.clamp(0.0, 1.0)));
            }
        }
        mesh.texture = Some(atlas.texture(image));
        let colors = self.colors(sphere.as_flattened());
        mesh.colors =
            Some(colors.as_chunks::<3>().0.iter().map(|c| c.map(|v| v.clamp(0.0, 1.0))).collect());
        mesh
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use autodiff_lite::Tape;
    use autodiff_lite::testkit::{Options, check, function};
    use diff_raster::sphere_texture;
    use ndarray::Array4;

    use super::*;

    #[test]
    fn gradients_of_closing() {
        let f = function(|x| closed(x[0]));
        let options = Options::default();
        check(&f, &options.draw(&[vec![2, 3, 16, 2]]), &options).unwrap();
    }

    /// A ramp from left to right, whose ends are as different as can be, has no step at the back: no two columns differ
    /// by more than the fade's share, and no two neighbours at the pole at all.
    #[test]
    fn there_is_no_seam_and_no_star() {
        let image = Array4::from_shape_fn((1, 64, 64, 1), |(_, i, j, _)| ((i + j) as f32) / 126.0);
        let tape = Tape::eval();
        let around = closed(tape.constant(image)).value();
        assert_eq!(around.shape(), [1, 66, 56, 1]);
        let step =
            |i: usize, j: usize| (around[[0, i, (j + 1) % 56, 0]] - around[[0, i, j, 0]]).abs();
        let worst = (0..66).flat_map(|i| (0..56).map(move |j| (i, j))).map(|(i, j)| step(i, j));
        // Nine steps share the difference of 56 columns.
        assert!({ worst }.fold(0.0, f32::max) < 56.0 / 126.0 / 8.0 + 0.01);
        assert!((0..56).all(|j| step(0, j) < 1e-6 && step(65, j) < 1e-6));
    }

    /// What a viewer shows of an exported face is what training saw, seam and poles included.
    #[test]
    fn an_exported_texture_shows_the_same() {
        let tape = Tape::eval();
        let image = Array4::from_shape_fn((1, 64, 64, 3), |(_, i, j, k)| {
            0.5 + 0.4 * (0.1 * i as f32 + 0.07 * j as f32 + k as f32).sin()
        });
        let globe = closed(tape.constant(image));
        let sphere = mesh_core::primitives::icosphere(2);
        let mesh = Globe::of(globe, 0, true).on(sphere.clone(), &sphere.positions);
        mesh.validate().unwrap();
        let texture = mesh.texture.as_ref().unwrap();
        let mut worst = 0.0_f32;
        for (face, corners) in mesh.faces.iter().zip(&texture.faces) {
            for b in [[0.6, 0.3, 0.1], [0.1, 0.1, 0.8], [0.5, 0.5, 0.0], [0.34, 0.33, 0.33]] {
                let mix = |at: [[f32; 3]; 3]| -> [f32; 3] {
                    std::array::from_fn(|k| (0..3).map(|c| b[c] * at[c][k]).sum())
                };
                let d = mix(face.map(|v| sphere.positions[v as usize]));
                let expected = sphere_texture(tape.constant(ndarray::arr2(&[d])), globe).value();
                let uv: [f32; 2] = std::array::from_fn(|k| {
                    (0..3).map(|c| b[c] * texture.uvs[corners[c] as usize][k]).sum()
                });
                let found = bilinear(&texture.image, uv);
                for k in 0..3 {
                    worst = worst.max((found[k] - expected[[0, k]]).abs());
                }
            }
        }
        // Most at the poles, where the texture turns within a few texels; another place would differ by up to 0.8.
        assert!(worst < 0.1, "{worst}");
    }

    /// Both ways to read a texture with a seam agree, and it has one where the published one has it, at the back.
    #[test]
    fn a_seam_is_read_alike_on_the_tape_and_off() {
        let tape = Tape::eval();
        let ramp = |_, i, j, k| 0.01 * (i * (k + 1)) as f32 + 0.02 * j as f32;
        let image = Array4::from_shape_fn((1, 16, 16, 3), |(n, i, j, k)| ramp(n, i, j, k));
        let image = tape.constant(image);
        let globe = Globe::of(image, 0, false);
        let directions = [[0.3, 0.2, 0.9], [-0.5, -0.7, -0.1], [0.0, 1.0, 0.0], [0.9, 0.0, -0.1]];
        let places = directions.map(seamed_place).to_vec();
        let points = ndarray::Array3::from_shape_fn((1, 4, 2), |(_, i, k)| places[i][k]);
        let border = autodiff_lite::Padding::Border;
        let expected = image.bilinear_sample(tape.constant(points), border, true).value();
        let found = globe.colors(directions.as_flattened());
        for (a, b) in found.iter().zip(expected.iter()) {
            assert!((a - b).abs() < 1e-5, "{a} {b}");
        }
        // The published formulas: 2 acos(up) / π - 1 downwards, the longitude over π to the right.
        assert_eq!(seamed_place([0.0, 1.0, 0.0])[1], -1.0);
        let [across, down] = seamed_place([0.6, -0.8, 0.0]);
        assert!(
            (across - 0.5).abs() < 1e-6
                && (down - (2.0 * (-0.8_f32).acos() / PI - 1.0)).abs() < 1e-6
        );
        let [left, right] = [-1e-4, 1e-4].map(|x| globe.colors(&[x, 0.0, -1.0])[0]);
        assert!((right - left - 0.02 * 15.0).abs() < 1e-3, "{left} {right}");
    }

    fn bilinear(image: &Image, [u, v]: [f32; 2]) -> [f32; 3] {
        let (x, y) = (u * image.width as f32 - 0.5, (1.0 - v) * image.height as f32 - 0.5);
        let (j, i) = (x.floor(), y.floor());
        let at = |i: f32, j: f32, k: usize| {
            let row = (i as usize).min(image.height - 1);
            let column = (j as usize).min(image.width - 1);
            image.data[(row * image.width + column) * 3 + k]
        };
        std::array::from_fn(|k| {
            let row = |i: f32| at(i, j, k) + (x - j) * (at(i, j + 1.0, k) - at(i, j, k));
            row(i) + (y - i) * (row(i + 1.0) - row(i))
        })
    }
}
