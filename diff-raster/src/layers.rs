//! The nearest faces of each pixel, several of them: PyTorch3D's fragments.

use std::sync::Arc;

use autodiff_lite::kernels::parallel::{InParts, Parts};
use autodiff_lite::{Real, Var};

use crate::kernels::layers::{draw_layers, measure};
use crate::kernels::setup::{Centers, corner_positions};
use crate::{Faces, NONE, Positions};

/// Faces of pixels that one job measures at least.
const CHUNK: usize = 2048;

/// Size of the image, and which faces a pixel has.
///
/// ```
/// use diff_raster::LayerSettings;
///
/// // SoftRas in PyTorch3D: fifty faces a pixel, each spread by its blur.
/// let settings = LayerSettings { blur_radius: (1.0_f64 / 1e-4 - 1.0).ln() * 1e-4, ..LayerSettings::new(64, 64, 50) };
/// assert!(settings.perspective && settings.clip_barycentric);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct LayerSettings {
    /// Rows of the image, `H`.
    pub height: usize,
    /// Columns of the image, `W`.
    pub width: usize,
    /// At most this many faces a pixel, `K`, the nearest ones.
    pub faces_per_pixel: usize,
    /// A face has pixels outside of it whose **squared** distance from its border, in NDC, is less than this.
    pub blur_radius: f64,
    /// Whether barycentric coordinates are those in space, as a perspective camera sees them.
    pub perspective: bool,
    /// Whether they are cut off below at 0, after the perspective, and divided by their sum: a pixel beside a face then
    /// shows what its border has.
    pub clip_barycentric: bool,
    /// Whether faces that turn clockwise on the screen are left out.
    pub cull_back_faces: bool,
}

impl LayerSettings {
    /// No blur; perspective-correct, cut off.
    pub fn new(height: usize, width: usize, faces_per_pixel: usize) -> Self {
        Self {
            height,
            width,
            faces_per_pixel,
            blur_radius: 0.0,
            perspective: true,
            clip_barycentric: true,
            cull_back_faces: false,
        }
    }
}

/// The nearest `K` faces of each pixel of a batch of images, nearest first: plain values.
///
/// Where there are fewer, faces are [`NONE`] and all numbers -1, as in PyTorch3D.
#[derive(Clone, Debug)]
pub struct LayeredFragments<F: Real = f32> {
    /// The faces. `[N, H, W, K]`; PyTorch3D's `pix_to_face`, counted in each image by itself.
    pub face: Vec<u32>,
    /// Planar depth, linear in the barycentric coordinates. `[N, H, W, K]`; `zbuf`.
    pub depth: Vec<F>,
    /// Barycentric coordinates. `[N, H, W, K, 3]`; `bary_coords`.
    pub barycentric: Vec<F>,
    /// Squared distance from the border of the face in NDC, negative inside. `[N, H, W, K]`; `dists`.
    pub distance: Vec<F>,
    pub(crate) batch: usize,
    pub(crate) faces: Arc<Faces>,
    pub(crate) settings: LayerSettings,
    pub(crate) centers: Centers<F>,
}

impl<F: Real> LayeredFragments<F> {
    /// `[N, H, W, K]`
    pub fn shape(&self) -> [usize; 4] {
        let s = &self.settings;
        [self.batch, s.height, s.width, s.faces_per_pixel]
    }

    /// The faces that were drawn.
    pub fn faces(&self) -> &Arc<Faces> {
        &self.faces
    }

    /// How they were drawn.
    pub fn settings(&self) -> &LayerSettings {
        &self.settings
    }

    /// Fills in what the faces of each pixel show, at positions `[N, V, 3]`.
    fn measure(&mut self, positions: &[F]) {
        let [_, height, width, k] = self.shape();
        let (per_image, stride) = (height * width * k, 3 * self.faces.vertex_count());
        let Self { face, depth, barycentric, distance, faces, settings, centers, .. } = self;
        let numbers = barycentric.par_chunks_mut(3).zip(depth.par_iter_mut());
        let slots = numbers.zip(distance.par_iter_mut()).zip(face.par_iter()).enumerate();
        slots.with_min_len(CHUNK).for_each(|(slot, (((shown, depth), distance), &face))| {
            if face == NONE {
                return;
            }
            let n = slot / per_image;
            let own = &positions[stride * n..stride * (n + 1)];
            let corners = corner_positions(own, faces.corners()[face as usize]);
            let layer = measure(centers.at(slot / k, [height, width]), &corners, settings);
            shown.copy_from_slice(&layer.shown);
            (*depth, *distance) = (layer.depth, layer.signed);
        });
    }

    /// Where the centre of a pixel (counted through all images) is in NDC.
    pub(crate) fn center(&self, pixel: usize) -> [F; 2] {
        let LayerSettings { height, width, .. } = self.settings;
        self.centers.at(pixel, [height, width])
    }
}

/// Finds the nearest faces of each pixel.
///
/// PyTorch3D's `rasterize_meshes`, pixel by pixel in the same terms and with its guards (1e-8 in areas and
/// perspective, 1e-5 in what is cut off). Two things differ: faces with a corner at depth 0 or behind are left out
/// whole, and distances are in the NDC of this crate, `[-1, 1]` along both axes, which is PyTorch3D's for square images
/// alone. Of equally near faces the lowest come first.
///
/// ```
/// use std::sync::Arc;
/// use diff_raster::{Faces, LayerSettings, NONE, rasterize_layers};
///
/// // Two triangles over the lower left half of the image, one behind the other.
/// let corners = |z: f32| [[-1.0, -1.0, z], [1.0, -1.0, z], [-1.0, 1.0, z]];
/// let points = [corners(2.0), corners(1.0)].concat();
/// let points = ndarray::Array3::from_shape_fn((1, 6, 3), |(_, v, k)| points[v][k]);
/// let faces = Arc::new(Faces::new(6, &[[0, 1, 2], [3, 4, 5]])?);
/// let layers = rasterize_layers(&points, &faces, &LayerSettings::new(4, 4, 3));
/// assert_eq!(layers.face[8 * 3..9 * 3], [1, 0, NONE]); // the third row, on the left
/// assert_eq!(layers.depth[8 * 3..9 * 3], [1.0, 2.0, -1.0]);
/// assert!(layers.distance[8 * 3] < 0.0); // inside
/// # Ok::<(), diff_raster::FacesError>(())
/// ```
///
/// # Shapes
/// `projected [N, V, 3]` as for [`rasterize`](crate::rasterize()): a variable, a tensor or an array.
/// # Cost
/// Each face at each pixel of its enlarged box, on one lane, in parallel over bands of rows, image after image.
/// # Panics
/// If the last axis is not 3, `V` is not the vertex count of `faces`, or the blur radius is below 0 or not a number.
/// # References
/// Ravi et al. 2020, *Accelerating 3D Deep Learning with PyTorch3D*.
pub fn rasterize_layers<F: Real>(
    projected: impl Positions<F>,
    faces: &Arc<Faces>,
    settings: &LayerSettings,
) -> Arc<LayeredFragments<F>> {
    projected.with(|projected| {
        let (batch, vertices, axes) = projected.dim();
        assert!(
            axes == 3 && vertices == faces.vertex_count(),
            "rasterize_layers: projected positions need the shape [N, V, 3] of V = {} vertices, not {:?}",
            faces.vertex_count(),
            projected.shape()
        );
        let radius = settings.blur_radius;
        assert!(radius >= 0.0, "rasterize_layers: blur_radius {radius}, expected at least 0");
        let slots = batch * settings.height * settings.width * settings.faces_per_pixel;
        let mut centers = Centers::default();
        centers.prepare(settings.height, settings.width);
        let none = -F::one();
        let mut found = LayeredFragments {
            face: vec![NONE; slots],
            depth: vec![none; slots],
            barycentric: vec![none; 3 * slots],
            distance: vec![none; slots],
            batch,
            faces: Arc::clone(faces),
            settings: settings.clone(),
            centers,
        };
        if slots == 0 {
            return Arc::new(found);
        }
        let positions = projected.as_standard_layout();
        let positions = positions.as_slice().expect("standard layout");
        let per_image = slots / batch;
        let images = found.face.chunks_mut(per_image).zip(found.depth.chunks_mut(per_image));
        for (n, (face, depth)) in images.enumerate() {
            let own = &positions[3 * vertices * n..3 * vertices * (n + 1)];
            draw_layers(own, faces.corners(), settings, &found.centers, face, depth);
        }
        found.measure(positions);
        Arc::new(found)
    })
}

/// Layers of faces on a tape: projected positions with their fragments, whose methods carry gradients.
///
/// PyTorch3D's rasteriser and shaders in their parts:
///
/// | PyTorch3D | here |
/// |---|---|
/// | `rasterize_meshes(..)` | [`Layers::new`] |
/// | `fragments.zbuf`, `.bary_coords`, `.dists` | [`depth`](Self::depth), [`barycentric`](Self::barycentric), [`distance`](Self::distance) |
/// | `interpolate_face_attributes` | [`interpolate`](Self::interpolate) |
/// | `softmax_rgb_blend` | [`softmax_blend`](Self::softmax_blend) |
/// | `sigmoid_alpha_blend` | [`alpha`](Self::alpha) |
///
/// ```
/// use std::sync::Arc;
///
/// use autodiff_lite::Tape;
/// use diff_raster::{BlendSettings, Faces, LayerSettings, Layers};
/// use ndarray::{arr2, arr3};
///
/// let faces = Arc::new(Faces::new(3, &[[0, 1, 2]])?);
/// let settings = LayerSettings { blur_radius: 0.01, ..LayerSettings::new(16, 16, 4) };
/// let tape = Tape::<f64>::train(0);
/// let projected = tape.leaf(arr3(&[[[-0.5, -0.5, 2.0], [0.5, -0.5, 2.0], [0.0, 0.5, 3.0]]]));
/// let colors = tape.leaf(arr2(&[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]));
/// let layers = Layers::new(projected, &faces, &settings);
/// let image = layers.softmax_blend(layers.interpolate(colors), &BlendSettings::default()); // [1, 16, 16, 4]
/// let gradients = image.slice_axis(3, 3..4).sum().backward();
/// assert!(gradients.wrt(projected).expect("alpha depends on them")[[0, 2, 1]] > 0.0); // up is larger
/// # Ok::<(), diff_raster::FacesError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Layers<'t, F: Real = f32> {
    pub(crate) projected: Var<'t, F>,
    pub(crate) fragments: Arc<LayeredFragments<F>>,
}

impl<'t, F: Real> Layers<'t, F> {
    /// Rasterises; which faces a pixel has is held fixed by all gradients.
    ///
    /// # Shapes
    /// `projected [N, V, 3]` as for [`rasterize_layers`]; cost and panics are the same.
    #[track_caller]
    pub fn new(projected: Var<'t, F>, faces: &Arc<Faces>, settings: &LayerSettings) -> Self {
        Self { projected, fragments: rasterize_layers(projected, faces, settings) }
    }

    /// The same faces at each pixel as in earlier layers, measured at other positions: visibility is held fixed for some
    /// steps, or for a test of gradients.
    ///
    /// # Shapes
    /// `projected [N, V, 3]`, of the batch and mesh that were rasterised.
    ///
    /// # Panics
    /// If the positions have not the shape of those that were rasterised.
    #[track_caller]
    #[must_use]
    #[inline(never)]
    pub fn again(&self, projected: Var<'t, F>) -> Self {
        Self::of(projected, &self.fragments)
    }

    /// [`again`](Self::again) from plain values, of [`rasterize_layers`] or of layers on another tape.
    ///
    /// # Shapes
    /// `projected [N, V, 3]`, of the batch and mesh that were rasterised.
    ///
    /// # Panics
    /// If the positions have not the shape of those that were rasterised.
    #[track_caller]
    pub fn of(projected: Var<'t, F>, earlier: &Arc<LayeredFragments<F>>) -> Self {
        let expected = [earlier.batch, earlier.faces.vertex_count(), 3];
        let positions = projected.value();
        if positions.shape() != expected {
            let message = "the positions are not of the meshes that were rasterised";
            let operands = [
                ("projected", positions.shape(), "N, V, 3"),
                ("rasterised", &expected[..], "N, V, 3"),
            ];
            projected.tape().refuse("layers", message, &operands);
        }
        let mut fragments = LayeredFragments::clone(earlier);
        fragments.measure(positions.as_slice());
        Self { projected, fragments: Arc::new(fragments) }
    }

    /// The plain values.
    pub fn fragments(&self) -> &Arc<LayeredFragments<F>> {
        &self.fragments
    }
}
