//! Meshes of one topology into images, again and again.

use std::sync::Arc;

use autodiff_lite::{Real, Var};
use ndarray::Ix3;

use crate::{Faces, Frame, Scratch, Settings, rasterize_into};

/// A rasteriser for meshes of the same faces, which keeps its memory from one frame to the next.
///
/// Make it once and use it in every step: as soon as a tape was reset, what its frames held is used
/// again, so that a training in its steady state takes no fresh memory. It may be shared by threads,
/// each with a tape of its own. Frames do not depend on those before.
///
/// # Examples
/// ```
/// use std::sync::Arc;
///
/// use autodiff_lite::Tape;
/// use diff_raster::{Faces, Renderer, Settings};
/// use ndarray::arr3;
///
/// let faces = Arc::new(Faces::new(3, &[[0, 1, 2]])?);
/// let renderer = Renderer::new(faces, Settings::new(32, 32));
/// let mut corners = arr3(&[[[-0.5_f32, -0.5, 2.0], [0.5, -0.5, 2.0], [0.0, 0.5, 2.0]]]);
/// let mut tape = Tape::train(0);
/// let mut coverage = Vec::new();
/// for _ in 0..10 {
///     // Uphill: the triangle grows.
///     let projected = tape.leaf(corners.clone());
///     let mask = renderer.frame(projected).antialiased_silhouette();
///     coverage.push(mask.mean().item());
///     let gradients = mask.mean().backward();
///     let gradient = gradients.wrt(projected).expect("the mask depends on the positions");
///     corners.zip_mut_with(&gradient.view(), |x, g| *x += 0.1 * g);
///     drop(gradients);
///     tape.reset();
/// }
/// assert!(coverage.is_sorted() && coverage[9] > 1.2 * coverage[0]);
/// # Ok::<(), diff_raster::FacesError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Renderer<F: Real = f32> {
    faces: Arc<Faces>,
    settings: Settings,
    scratch: Scratch<F>,
}

impl<F: Real> Renderer<F> {
    /// For these faces and images.
    pub fn new(faces: Arc<Faces>, settings: Settings) -> Self {
        Self { faces, settings, scratch: Scratch::default() }
    }

    /// The same with memory that it shares with others: for meshes of many topologies, of which each
    /// is drawn now and then.
    #[must_use]
    pub fn with_scratch(self, scratch: &Scratch<F>) -> Self {
        Self { scratch: scratch.clone(), ..self }
    }

    /// The faces.
    pub fn faces(&self) -> &Arc<Faces> {
        &self.faces
    }

    /// The settings.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// Finds what is seen at each pixel; the frame draws it.
    ///
    /// # Shapes
    /// `projected [N, V, 3]`: NDC `x` (right), NDC `y` (up) and planar depth, as
    /// [`project`](Var::project) gives them and [`rasterize`](crate::rasterize()) takes them.
    /// # Cost
    /// `O(N (V + F + H W))` plus the pixels of the boxes of all faces.
    /// # Panics
    /// If the last axis is not 3, or `V` is not the vertex count of the faces.
    #[track_caller]
    #[inline(never)]
    pub fn frame<'t>(&self, projected: Var<'t, F>) -> Frame<'t, F> {
        let vertices = self.faces.vertex_count();
        let positions = projected.value();
        if !matches!(*positions.shape(), [_, v, 3] if v == vertices) {
            let message = format!("positions of {vertices} vertices expected");
            let operands = [("projected", positions.shape(), "N, V, 3")];
            projected.tape().refuse("frame", message, &operands);
        }
        let view = positions.view().into_dimensionality::<Ix3>().expect("three axes");
        let Self { faces, settings, scratch } = self;
        let fragments =
            scratch.fragments(|own| rasterize_into(view, faces, settings, scratch, own));
        Frame::new(projected, fragments, scratch.clone())
    }
}
