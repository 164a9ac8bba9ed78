//! SoftRas's images. The rules stand in [`kernels::softras`](crate::kernels::softras).

use std::cell::RefCell;
use std::sync::Arc;

use autodiff_lite::{Backward, Real, Tensor, Var};

use crate::kernels::softras::{self, Colors};
use crate::softras::SoftRas;

/// What SoftRas paints faces with.
#[derive(Clone, Copy, Debug)]
pub enum Paint<'t, F: Real = f32> {
    /// Colours of vertices `[N, V, C]`, interpolated over faces.
    Vertices(Var<'t, F>),
    /// `side²` texels of each face `[N, F, side², C]`, whose middles are
    /// [`texel_centers`](crate::texel_centers); the nearest counts, so no gradient goes through them
    /// to where it lies.
    Texels(Var<'t, F>),
}

/// Images in which every face is a cloud: alpha from distances, colours by a soft maximum over depth.
///
/// ```text
/// D = sigmoid(± d² / sigma)      A = 1 - Π (1 - D)      C = Σ D e^(ζ/gamma) colour / (Σ D e^(ζ/gamma) + e^(ε/gamma))
/// ```
///
/// ζ runs from 0 at `far` to 1 at `near`. The original's aggregation, to compare with
/// [`interpolate`](crate::interpolate) and [`soft_silhouette`](crate::soft_silhouette): gradients reach
/// hidden faces and depths, and a silhouette shrinks as readily as it grows. Colours are not multiplied by
/// alpha: beside an object they are those of the nearest face around, and of the
/// [background](crate::SoftRasSettings::background_color) where no face reaches.
///
/// ```
/// use std::sync::Arc;
///
/// use autodiff_lite::Tape;
/// use diff_raster::{Faces, Paint, SoftRas, SoftRasSettings, softras};
/// use ndarray::arr3;
///
/// let corners = arr3(&[[[-0.5_f32, -0.5, 2.0], [0.5, -0.5, 2.0], [0.0, 0.5, 3.0]]]);
/// let colors = arr3(&[[[1.0_f32], [0.5], [0.0]]]);
/// let renderer = SoftRas::new(&Arc::new(Faces::new(3, &[[0, 1, 2]])?), &SoftRasSettings::new(32, 32));
/// let tape = Tape::train(0);
/// let [projected, colors] = [tape.leaf(corners), tape.leaf(colors)];
/// let image = softras(projected, Some(Paint::Vertices(colors)), &renderer); // [1, 32, 32, 2]
/// let alpha = image.slice_axis(3, 1..2);
/// let gradients = alpha.sum().backward();
/// assert!(gradients.wrt(projected).expect("moved")[[0, 2, 1]] > 0.0); // up is larger
/// # Ok::<(), diff_raster::FacesError>(())
/// ```
///
/// # Shapes
/// `projected [N, V, 3]` as for [`rasterize`](crate::rasterize()); paint of C channels, or none → `[N, H, W, C + 1]`, alpha last.
/// # Gradient
/// To all coordinates of `projected` and to the paint. Kinks where the nearest edge of a pixel or the
/// corner of a face that it is beyond changes; jumps of `least` where a face's reach ends.
/// # Cost
/// Each face at each pixel of its enlarged box, forward and backward, a vector of a row at a time: a few times
/// [`interpolate`](crate::interpolate). A gradient reads the image's planes again, `4 (2 C + 5)` bytes a pixel.
/// # Panics
/// If a shape does not fit.
/// # References
/// Liu et al. 2019, *Soft Rasterizer*, equations 1 to 6; constants as in its code, whose weight of the
/// background is `e^(2 ε/gamma)` (no image shows the difference).
#[track_caller]
#[inline(never)]
pub fn softras<'t, F: Real>(
    projected: Var<'t, F>,
    paint: Option<Paint<'t, F>>,
    renderer: &Arc<SoftRas<F>>,
) -> Var<'t, F> {
    let tape = projected.tape();
    let (positions, faces) = (projected.value(), &renderer.faces);
    let shape = positions.shape();
    let batch = match *shape {
        [n, v, 3] if v == faces.vertex_count() => n,
        _ => {
            let message = format!("{} vertices expected", faces.vertex_count());
            tape.refuse("softras", message, &[("projected", shape, "N, V, 3")])
        }
    };
    let (mode, channels) = paint.map_or((Mode::Vertices, 0), |paint| check(paint, batch, renderer));
    let behind = renderer.settings.background_color.len();
    if channels > 0 && behind > 0 && behind != channels {
        let message = format!("a background of {behind} channels behind paint of {channels}");
        tape.refuse("softras", message, &[("projected", shape, "N, V, 3")]);
    }
    let painted = paint.map(|(Paint::Vertices(x) | Paint::Texels(x))| x);
    let colors = painted.map(Var::value);
    let colors = colors.as_ref().map_or(&[][..], Tensor::as_slice);
    let settings = &renderer.settings;
    let mut out = tape.array(&[batch, settings.height, settings.width, channels + 1]);
    let mut state = renderer.states.lend();
    softras::softras(
        renderer,
        positions.as_slice(),
        mode.of(colors),
        channels,
        &mut state,
        out.as_slice_mut(),
    );
    let (renderer, state) = (Arc::clone(renderer), RefCell::new(state));
    let mut inputs = vec![projected];
    inputs.extend(painted);
    tape.record_fn("softras", &inputs, out, move |cx: &mut Backward<'_, F>| {
        let (image, grad) = (cx.output(), cx.grad_out());
        let planes = [&image, &grad].map(Tensor::as_slice);
        let colors = (cx.input_count() == 2).then(|| cx.input(1));
        let colors = colors.as_ref().map_or(&[][..], Tensor::as_slice);
        let zeros =
            |cx: &Backward<'_, F>, i: usize| cx.pool().filled(cx.input(i).shape(), F::zero());
        let mut of_projected = zeros(cx, 0);
        let wanted = cx.input_count() == 2 && cx.needs(1);
        let mut of_colors = wanted.then(|| zeros(cx, 1));
        softras::softras_grad(
            &renderer,
            mode.of(colors),
            channels,
            &mut state.borrow_mut(),
            planes,
            of_projected.as_slice_mut(),
            of_colors.as_mut().map_or(&mut [], Tensor::as_slice_mut),
        );
        cx.give(0, of_projected);
        if let Some(of_colors) = of_colors {
            cx.give(1, of_colors);
        }
    })
}

#[derive(Clone, Copy)]
enum Mode {
    Vertices,
    Texels(usize),
}

impl Mode {
    fn of<F>(self, colors: &[F]) -> Colors<'_, F> {
        match self {
            Self::Vertices => Colors::Vertices(colors),
            Self::Texels(side) => Colors::Texels(colors, side),
        }
    }
}

#[track_caller]
fn check<F: Real>(paint: Paint<'_, F>, batch: usize, renderer: &SoftRas<F>) -> (Mode, usize) {
    let faces = &renderer.faces;
    let (found, expected) = match paint {
        Paint::Vertices(x) => {
            if let [n, v, c] = x.shape()[..]
                && (n, v) == (batch, faces.vertex_count())
            {
                return (Mode::Vertices, c);
            }
            (x, "N, V, C")
        }
        Paint::Texels(x) => {
            if let [n, f, texels, c] = x.shape()[..]
                && (n, f) == (batch, faces.len())
                && texels.isqrt().pow(2) == texels
                && texels > 0
            {
                return (Mode::Texels(texels.isqrt()), c);
            }
            (x, "N, F, side², C")
        }
    };
    let message = format!(
        "paint for {batch} images of {} vertices or {} faces expected",
        faces.vertex_count(),
        faces.len()
    );
    found.tape().refuse("softras", message, &[("paint", &found.shape(), expected)])
}
