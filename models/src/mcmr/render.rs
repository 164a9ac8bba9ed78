//! Meshes and textures into images.

use std::sync::Arc;

use autodiff_lite::{Padding, Tape, Var};
use diff_raster::{
    Faces, Frame, Paint, Renderer, Settings, SoftRas, SoftRasSettings, softras, sphere_texture,
    texel_centers,
};
use ndarray::{Array2, Array3};

use super::config::{McmrConfig, RendererKind};
use super::shapes::Template;
use super::texture::seamed_place;

/// Texels along an edge of a face under SoftRas, as published.
const TEXELS: usize = 6;

/// A renderer for the textured meshes of one template.
#[derive(Debug)]
pub(super) struct TexturedRenderer {
    renderer: Renderer,
    exact: f64,
    sphere: Array2<f32>,
    /// With SoftRas, and where its texels are looked up.
    clouds: Option<(Arc<SoftRas>, Texels)>,
}

/// Where the 36 texels of each of `F` faces are in a texture.
#[derive(Debug)]
enum Texels {
    /// Their directions `[1, 36 F, 3]`, of a texture without a seam.
    Closed(Array3<f32>),
    /// Their places `[1, 36 F, 2]`, of one with a seam.
    Seamed(Array3<f32>),
}

impl Texels {
    fn new(template: &Template, closed: bool) -> Self {
        let directions = directions(template);
        if closed {
            return Self::Closed(directions);
        }
        let places: Vec<[f32; 2]> =
            directions.rows().into_iter().map(|d| seamed_place([d[0], d[1], d[2]])).collect();
        Self::Seamed(Array3::from_shape_fn((1, places.len(), 2), |(_, i, k)| places[i][k]))
    }

    /// Colours `[N, 36 F, 3]` from textures `[N, H, W, 3]`.
    fn colors<'t>(&self, texture: Var<'t>) -> Var<'t> {
        let [n, ..] = texture.dims::<4>();
        let all = |one: &Array3<f32>| {
            let (_, count, columns) = one.dim();
            texture.tape().constant(Array3::zeros((n, count, columns)) + one)
        };
        match self {
            Self::Closed(directions) => sphere_texture(all(directions), texture),
            Self::Seamed(places) => texture.bilinear_sample(all(places), Padding::Border, true),
        }
    }
}

/// A rendering of `N` meshes.
#[derive(Debug)]
pub(super) struct Rendered<'t> {
    /// `[N, S, S, 3]`, black background under DIB-R.
    pub(super) image: Var<'t>,
    /// `[N, S, S]`, soft.
    pub(super) silhouette: Var<'t>,
    /// What is seen at the pixels' centres, `[N, S, S]`: 1 or 0.
    pub(super) mask: Vec<f32>,
}

impl TexturedRenderer {
    pub(super) fn new(template: &Template, config: &McmrConfig) -> Self {
        let faces = Faces::of_valid(template.sphere.len(), &template.corners);
        let side = config.image_size;
        let settings = Settings {
            sigma_inv: config.sigma_inv,
            box_length: config.reach,
            ..Settings::new(side, side)
        };
        let clouds = (config.renderer == RendererKind::SoftRas).then(|| {
            let settings = SoftRasSettings {
                sigma: config.softras_sigma,
                gamma: config.softras_gamma,
                ..SoftRasSettings::published(side, side)
            };
            (SoftRas::new(&faces, &settings), Texels::new(template, config.closed_texture))
        });
        Self {
            exact: config.exact,
            sphere: Array2::from(template.sphere.clone()),
            clouds,
            renderer: Renderer::new(faces, settings),
        }
    }

    /// Meshes `[N, V, 3]` with closed textures `[N, H, W, 3]` through `matrices [N, 3, 4]`.
    pub(super) fn render<'t>(
        &self,
        tape: &'t Tape,
        positions: Var<'t>,
        texture: Var<'t>,
        matrices: Var<'t>,
    ) -> Rendered<'t> {
        let projected = positions.project(matrices);
        let frame = self.renderer.frame(projected);
        let mask = frame.mask();
        if let Some((renderer, texels)) = &self.clouds {
            let colors = texels.colors(texture);
            let [n, count, _] = colors.dims();
            let each = TEXELS * TEXELS;
            let colors = colors.reshape(&[n, count / each, each, 3]);
            let both = softras(projected, Some(Paint::Texels(colors)), renderer);
            let [n, h, w, _] = both.dims();
            let silhouette = both.slice_axis(3, 3..4).reshape(&[n, h, w]);
            return Rendered { image: both.slice_axis(3, 0..3), silhouette, mask };
        }
        let directions = frame.interpolate(tape.constant(self.sphere.clone()));
        let image = sphere_texture(directions, texture);
        Rendered { image, silhouette: self.silhouette(&frame), mask }
    }

    /// What is seen of meshes at the pixels' centres, `[N, S, S]`: 1 or 0.
    pub(super) fn mask<'t>(&self, positions: Var<'t>, matrices: Var<'t>) -> Vec<f32> {
        self.renderer.frame(positions.project(matrices)).mask()
    }

    fn silhouette<'t>(&self, frame: &Frame<'t>) -> Var<'t> {
        let soft = |share: f64| frame.soft_silhouette().scale(share as f32);
        let exact = |share: f64| frame.antialiased_silhouette().scale(share as f32);
        match self.exact {
            0.0 => soft(1.0),
            1.0 => exact(1.0),
            share => soft(1.0 - share).add(exact(share)),
        }
    }
}

/// Where the texels of each face lie on the sphere: `[1, 36 F, 3]`.
fn directions(template: &Template) -> Array3<f32> {
    let middles = texel_centers(TEXELS);
    let each = middles.len();
    Array3::from_shape_fn((1, template.corners.len() * each, 3), |(_, i, k)| {
        let (face, texel) = (i / each, i % each);
        let at = |c: usize| template.sphere[template.corners[face][c] as usize][k];
        (0..3).map(|c| middles[texel][c] as f32 * at(c)).sum()
    })
}
