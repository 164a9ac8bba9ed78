//! Meshes and textures into images.

use std::sync::Arc;

use autodiff_lite::{Tape, Var};
use diff_raster::{
    Faces, Frame, Paint, Renderer, Settings, SoftRas, SoftRasSettings, softras, sphere_texture,
    texel_centers,
};
use ndarray::{Array2, Array3};

use super::config::{McmrConfig, RendererKind};
use super::shapes::Template;

/// Texels along an edge of a face under SoftRas, as published.
const TEXELS: usize = 6;

/// A renderer for the textured meshes of one template.
#[derive(Debug)]
pub(super) struct TexturedRenderer {
    renderer: Renderer,
    exact: f64,
    sphere: Array2<f32>,
    /// With SoftRas, and the directions of its texels `[F, 36, 3]`.
    clouds: Option<(Arc<SoftRas>, Array3<f32>)>,
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
        let faces = Faces::new(template.sphere.len(), &template.corners);
        let faces = Arc::new(faces.expect("a template's faces name its vertices"));
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
            (SoftRas::new(&faces, &settings), directions(template))
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
        if let Some((renderer, middles)) = &self.clouds {
            let [n, ..] = texture.dims::<4>();
            let [f, texels, _] = [middles.shape()[0], middles.shape()[1], 3];
            let all = Array3::zeros((n, f * texels, 3));
            let flat = middles.to_shape((1, f * texels, 3)).expect("the same numbers");
            let colors = sphere_texture(tape.constant(all + flat), texture);
            let colors = colors.reshape(&[n, f, texels, 3]);
            let both = softras(projected, Some(Paint::Texels(colors)), renderer);
            let [n, h, w, _] = both.dims();
            let silhouette = both.slice_axis(3, 3..4).reshape(&[n, h, w]);
            return Rendered { image: both.slice_axis(3, 0..3), silhouette, mask };
        }
        let directions = frame.interpolate(tape.constant(self.sphere.clone()));
        let image = sphere_texture(directions, texture);
        Rendered { image, silhouette: self.silhouette(&frame), mask }
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

/// Where the texels of each face lie on the sphere: `[F, 36, 3]`.
fn directions(template: &Template) -> Array3<f32> {
    let middles = texel_centers(TEXELS);
    Array3::from_shape_fn((template.corners.len(), middles.len(), 3), |(face, texel, k)| {
        let at = |c: usize| template.sphere[template.corners[face][c] as usize][k];
        (0..3).map(|c| middles[texel][c] as f32 * at(c)).sum()
    })
}
