//! Meshes into images: projection, visibility, colours and silhouettes.

use std::sync::Arc;

use autodiff_lite::Var;
use diff_raster::{Faces, Fragments, Frame, Renderer, Settings};
use mesh_core::{Topology, TriMesh};

use super::config::{Img2MeshConfig, SilhouetteKind};

/// A renderer of colored meshes from several cameras, and the topology of the meshes.
#[derive(Debug)]
pub(super) struct ViewRenderer {
    pub(super) topology: Topology,
    pub(super) corners: Vec<[u32; 3]>,
    kind: SilhouetteKind,
    renderer: Renderer,
}

/// A rendering of `M` views.
#[derive(Debug)]
pub(super) struct Rendered<'t> {
    /// `[M, R, R, 3]`, black background.
    pub(super) image: Var<'t>,
    /// `[M, R, R]`.
    pub(super) silhouette: Var<'t>,
    pub(super) frame: Frame<'t>,
}

impl ViewRenderer {
    pub(super) fn new(template: &TriMesh, config: &Img2MeshConfig) -> Self {
        let faces = Faces::of_valid(template.positions.len(), &template.faces);
        let size = config.render_size;
        let rules = if config.published_rules {
            // The published code hands over which faces look at the camera.
            Settings { cull_back_faces: true, ..Settings::published(size, size) }
        } else {
            Settings::new(size, size)
        };
        let settings = Settings { sigma_inv: config.sigma_inv, box_length: config.reach, ..rules };
        Self {
            topology: Topology::new(template.positions.len(), &template.faces),
            corners: template.faces.clone(),
            kind: config.silhouette,
            renderer: Renderer::new(faces, settings),
        }
    }

    /// What is seen of meshes `[N, V, 3]` in every pixel of `M / N` cameras each; see [`render`](Self::render).
    pub(super) fn fragments(&self, positions: Var<'_>, matrices: Var<'_>) -> Arc<Fragments> {
        let views = matrices.shape()[0] / positions.shape()[0];
        let frame = self.renderer.frame(repeat(positions, views).project(matrices));
        Arc::clone(frame.fragments())
    }

    /// Silhouettes alone; see [`render`](Self::render).
    pub(super) fn silhouettes<'t>(&self, positions: Var<'t>, matrices: Var<'t>) -> Var<'t> {
        let views = matrices.shape()[0] / positions.shape()[0];
        let frame = self.renderer.frame(repeat(positions, views).project(matrices));
        self.silhouette(&frame)
    }

    fn silhouette<'t>(&self, frame: &Frame<'t>) -> Var<'t> {
        match self.kind {
            SilhouetteKind::Soft => frame.soft_silhouette(),
            SilhouetteKind::Antialiased => frame.antialiased_silhouette(),
        }
    }

    /// Meshes `[N, V, 3]` from `M / N` cameras each; `matrices [M, 3, 4]`, object by object.
    pub(super) fn render<'t>(
        &self,
        positions: Var<'t>,
        colors: Var<'t>,
        matrices: Var<'t>,
    ) -> Rendered<'t> {
        let views = matrices.shape()[0] / positions.shape()[0];
        let (positions, colors) = (repeat(positions, views), repeat(colors, views));
        let frame = self.renderer.frame(positions.project(matrices));
        let image = frame.interpolate(colors);
        let silhouette = self.silhouette(&frame);
        Rendered { image, silhouette, frame }
    }
}

/// `[N, V, 3]` to `[N k, V, 3]`, each `k` times.
fn repeat(x: Var<'_>, k: usize) -> Var<'_> {
    let [n, v, axes] = x.dims();
    if k == 1 {
        return x;
    }
    let rows: Vec<u32> = (0..n as u32).flat_map(|i| std::iter::repeat_n(i, k)).collect();
    x.reshape(&[n, v * axes]).gather_rows(&rows).reshape(&[n * k, v, axes])
}
