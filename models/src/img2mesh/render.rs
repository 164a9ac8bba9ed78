//! Meshes into images: projection, visibility, colours and silhouettes.

use std::sync::{Arc, Mutex, PoisonError};

use autodiff_lite::Var;
use diff_raster::{
    Faces, Fragments, Settings, antialiased_silhouette, interpolate, rasterize_into,
    soft_silhouette,
};
use mesh_core::{Topology, TriMesh};
use ndarray::Ix3;

use super::config::{Img2MeshConfig, SilhouetteKind};

/// What never changes between renderings, and the memory of those before.
#[derive(Debug)]
pub(super) struct Renderer {
    pub(super) faces: Arc<Faces>,
    pub(super) topology: Topology,
    pub(super) corners: Vec<[u32; 3]>,
    settings: Settings,
    kind: SilhouetteKind,
    /// Fragments of earlier steps; one that nobody else holds is used again.
    spare: Mutex<Vec<Arc<Fragments<f32>>>>,
}

/// A rendering of `M` views.
#[derive(Debug)]
pub(super) struct Rendered<'t> {
    /// `[M, R, R, 3]`, black background.
    pub(super) image: Var<'t>,
    /// `[M, R, R]`.
    pub(super) silhouette: Var<'t>,
    pub(super) fragments: Arc<Fragments<f32>>,
}

impl Renderer {
    pub(super) fn new(template: &TriMesh, config: &Img2MeshConfig) -> Self {
        let faces = Faces::of(template).expect("an icosphere's faces name its vertices");
        let size = config.render_size;
        Self {
            faces: Arc::new(faces),
            topology: Topology::new(template.positions.len(), &template.faces),
            corners: template.faces.clone(),
            kind: config.silhouette,
            settings: Settings {
                sigma_inv: config.sigma_inv,
                box_length: config.reach,
                ..Settings::new(size, size)
            },
            spare: Mutex::default(),
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
        let projected = positions.project(matrices);
        let values = projected.value();
        let values = values.view().into_dimensionality::<Ix3>().expect("[M, V, 3]");
        let mut fragments = self.take();
        rasterize_into(values, &self.faces, &self.settings, &mut fragments);
        self.keep(&fragments);
        let image = interpolate(projected, colors, &fragments);
        let silhouette = match self.kind {
            SilhouetteKind::Soft => soft_silhouette(projected, &fragments),
            SilhouetteKind::Antialiased => antialiased_silhouette(projected, &fragments),
        };
        Rendered { image, silhouette, fragments }
    }

    fn take(&self) -> Arc<Fragments<f32>> {
        let mut spare = self.spare.lock().unwrap_or_else(PoisonError::into_inner);
        let free = spare.iter().position(|fragments| Arc::strong_count(fragments) == 1);
        free.map_or_else(Arc::default, |i| spare.swap_remove(i))
    }

    fn keep(&self, fragments: &Arc<Fragments<f32>>) {
        self.spare.lock().unwrap_or_else(PoisonError::into_inner).push(Arc::clone(fragments));
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
