//! What each view shows where a vertex of the present mesh is seen.

use autodiff_lite::{Tape, Var};
use diff_raster::NONE;
use mesh_core::nalgebra::{Matrix3, Vector3};
use mesh_core::vector::{affine, norm};
use mesh_core::vertex_normals;
use rayon::prelude::*;

use super::level::Level;
use super::prepared::Prepared;

/// Numbers of a vertex in a view, beside the features of the image; see [`Observations::signals`].
pub(super) const SIGNALS: usize = 19;
/// Where the cosine of the line of sight with the surface's normal stands among them.
pub(super) const FACING: usize = 14;
/// Where it stands among them whether the vertex is seen.
pub(super) const VISIBLE: usize = 15;
/// How far behind the surface that a view shows a vertex may lie and still count as seen, in the model's frame.
const BEHIND: f32 = 0.05;
/// The longest step to the outline that is told, in the model's frame.
const LONGEST: f32 = 0.5;
/// What distances to the outline are multiplied by: beyond a quarter of the image's half side they only say "far".
const NEAR: f32 = 4.0;

/// What `N K` views show at the `V` vertices of `N` meshes. All are constants: positions learn from what the network makes
/// of it, not from how it changes with them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Observations<'t> {
    /// Where vertices are seen, x to the right and y down, the image from -1 to 1: `[N K, V, 2]`.
    pub(super) points: Var<'t>,
    /// `[N K, V, 19]`: the point and the depth beyond the frame's middle; the distance to the mask's outline, positive
    /// outside, kept within -1 to 1, and unbounded; the unit direction in space along which it grows the fastest; the step in space
    /// that would put the vertex on the outline; the unit direction to the camera; its cosine with the surface's normal; 1
    /// where nothing of the mesh is before the vertex; the image's colour.
    pub(super) signals: Var<'t>,
    /// The images' colours at the vertices: `[N K, V, 3]`.
    pub(super) colors: Var<'t>,
    /// Position and unit normal of each vertex: `[N, V, 6]`.
    pub(super) places: Var<'t>,
}

/// What `views`, `K` of each of `N` meshes, show of `positions [N, V, 3]`. `cameras [N K, 3, 4]` are from the model's frame.
pub(super) fn observe<'t>(
    tape: &'t Tape,
    level: &Level,
    positions: Var<'t>,
    views: &[&Prepared],
    cameras: Var<'t>,
) -> Observations<'t> {
    let [n, v, _] = positions.dims();
    let k = views.len() / n;
    let positions = positions.value();
    let fragments = level.renderer.fragments(tape.constant(positions.clone()), cameras);
    let cameras = cameras.value();
    let cameras = cameras.as_slice().as_chunks::<12>().0;
    let pixels = fragments.face.len() / views.len();
    let positions: Vec<&[[f32; 3]]> =
        positions.as_slice().as_chunks::<3>().0.chunks_exact(v).collect();
    let normals: Vec<Vec<[f32; 3]>> =
        positions.par_iter().map(|p| vertex_normals(p, &level.renderer.corners)).collect();
    let mut points = tape.array(&[n * k, v, 2]);
    let mut signals = tape.array(&[n * k, v, SIGNALS]);
    let mut colors = tape.array(&[n * k, v, 3]);
    let rows = points.as_slice_mut().par_chunks_exact_mut(2 * v);
    let rows = rows.zip(signals.as_slice_mut().par_chunks_exact_mut(SIGNALS * v));
    let rows = rows.zip(colors.as_slice_mut().par_chunks_exact_mut(3 * v));
    rows.enumerate().for_each(|(i, ((points, signals), colors))| {
        let pixels = i * pixels..(i + 1) * pixels;
        let surface = (&fragments.depth[pixels.clone()], &fragments.face[pixels]);
        let sampler = ViewSampler::new(views[i], &cameras[i], surface);
        let rows = points.as_chunks_mut::<2>().0.iter_mut();
        let rows = rows.zip(signals.as_chunks_mut::<SIGNALS>().0);
        let rows = rows.zip(colors.as_chunks_mut::<3>().0);
        let vertices = positions[i / k].iter().zip(&normals[i / k]);
        for (((point, signals), color), (&p, &normal)) in rows.zip(vertices) {
            (*point, *signals, *color) = sampler.sample(p, normal);
        }
    });
    let mut places = tape.array(&[n, v, 6]);
    let vertices = positions.iter().copied().flatten().zip(normals.iter().flatten());
    for (place, (p, normal)) in
        places.as_slice_mut().as_chunks_mut::<6>().0.iter_mut().zip(vertices)
    {
        place[..3].copy_from_slice(p);
        place[3..].copy_from_slice(normal);
    }
    let [points, signals, colors, places] =
        [points, signals, colors, places].map(|array| tape.constant(array));
    Observations { points, signals, colors, places }
}

/// Samples a view where vertices are projected into it, knowing the depth of the mesh there.
struct ViewSampler<'a> {
    view: &'a Prepared,
    rows: [[f32; 4]; 3],
    center: [f32; 3],
    /// Depth of the frame's middle.
    middle: f32,
    /// Depth of the nearest surface in each pixel, and the face that it is of.
    surface: (&'a [f32], &'a [u32]),
    side: usize,
}

impl<'a> ViewSampler<'a> {
    fn new(view: &'a Prepared, camera: &[f32; 12], surface: (&'a [f32], &'a [u32])) -> Self {
        let rows: [[f32; 4]; 3] =
            std::array::from_fn(|i| std::array::from_fn(|j| camera[4 * i + j]));
        let side = surface.0.len().isqrt();
        Self { view, rows, center: center(&rows), middle: rows[2][3], surface, side }
    }

    /// Point, signals and colour.
    fn sample(&self, p: [f32; 3], normal: [f32; 3]) -> ([f32; 2], [f32; SIGNALS], [f32; 3]) {
        let [a, b, w] = affine(&self.rows, p);
        let w = w.max(1e-3);
        let (x, y) = ((a / w).clamp(-4.0, 4.0), (b / w).clamp(-4.0, 4.0));
        let (distance, gradient) = self.outline(x, y);
        // How the distance changes with the vertex: by the gradient in the image, through the projection.
        let along: [f32; 3] = std::array::from_fn(|j| {
            let [m, n, o] = [self.rows[0][j], self.rows[1][j], self.rows[2][j]];
            (gradient[0] * (m - x * o) + gradient[1] * (n - y * o)) / w
        });
        let steep = norm(along).max(1e-6);
        let uphill = along.map(|g| g / steep);
        let step = (-distance / steep).clamp(-LONGEST, LONGEST);
        let to_camera: [f32; 3] = std::array::from_fn(|j| self.center[j] - p[j]);
        let far = norm(to_camera).max(1e-6);
        let to_camera = to_camera.map(|d| d / far);
        let facing: f32 = (0..3).map(|j| to_camera[j] * normal[j]).sum();
        let color = self.color(x, y);
        let mut signals = [0.0; SIGNALS];
        let seen = f32::from(self.visible(x, y, w));
        let bounded = (NEAR * distance).clamp(-1.0, 1.0);
        signals[..5].copy_from_slice(&[x, -y, w - self.middle, bounded, distance]);
        signals[5..8].copy_from_slice(&uphill);
        signals[8..11].copy_from_slice(&uphill.map(|u| u * step));
        signals[11..14].copy_from_slice(&to_camera);
        (signals[FACING], signals[VISIBLE]) = (facing, seen);
        signals[16..].copy_from_slice(&color);
        ([x, -y], signals, color)
    }

    /// Distance to the mask's outline in halves of the image's side, and its gradient in x (right) and y (up).
    fn outline(&self, x: f32, y: f32) -> (f32, [f32; 2]) {
        let side = self.view.mask.len().isqrt();
        let unit = 2.0 / side as f32;
        let at = |x: f32, y: f32| {
            bilinear(side, x, y, |i| f32::from(self.view.outline[i])) * unit
                / Prepared::OUTLINE_STEPS
        };
        let gradient = [at(x + unit, y) - at(x - unit, y), at(x, y + unit) - at(x, y - unit)];
        // Beyond the image it is as far again as to its border.
        let beyond = (x.abs() - 1.0).max(0.0).hypot((y.abs() - 1.0).max(0.0));
        (at(x, y) + beyond, gradient.map(|d| d / (2.0 * unit)))
    }

    fn color(&self, x: f32, y: f32) -> [f32; 3] {
        let side = self.view.mask.len().isqrt();
        let byte = |channel: usize| move |i: usize| f32::from(self.view.target[3 * i + channel]);
        [0, 1, 2].map(|channel| bilinear(side, x, y, byte(channel)) / 255.0)
    }

    /// Whether no part of the mesh lies before what is seen at depth `w`: in one of the pixels about the point, since a vertex of
    /// the outline lies between them.
    fn visible(&self, x: f32, y: f32, w: f32) -> bool {
        let side = self.side as f32;
        let (column, row) = (0.5 * (x + 1.0) * side - 0.5, 0.5 * (1.0 - y) * side - 0.5);
        let pixel = |at: f32| at.clamp(0.0, side - 1.0) as usize;
        let near = [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0)];
        near.iter().any(|&(i, j)| {
            let at = pixel(row.floor() + i) * self.side + pixel(column.floor() + j);
            let (depth, face) = self.surface;
            face[at] == NONE || w <= depth[at] + BEHIND
        })
    }
}

/// Between the centres of the pixels of a square image, its border repeated; x to the right and y up, from -1 to 1.
fn bilinear(side: usize, x: f32, y: f32, value: impl Fn(usize) -> f32) -> f32 {
    let last = side as f32 - 1.0;
    let place = |t: f32| (0.5 * (t + 1.0) * side as f32 - 0.5).clamp(0.0, last);
    let (column, row) = (place(x), place(-y));
    let (j, i) = (column as usize, row as usize);
    let (u, v) = (column - j as f32, row - i as f32);
    let (right, below) = ((j + 1).min(side - 1), (i + 1).min(side - 1));
    let line = |i: usize| (1.0 - u) * value(i * side + j) + u * value(i * side + right);
    (1.0 - v) * line(i) + v * line(below)
}

/// Where the camera is: `-A⁻¹ b` of its matrix `[A | b]`.
fn center(rows: &[[f32; 4]; 3]) -> [f32; 3] {
    let part = Matrix3::from_fn(|i, j| f64::from(rows[i][j]));
    let shift = Vector3::from_fn(|i, _| f64::from(rows[i][3]));
    // A pinhole's matrix has an inverse; of one that has none, nowhere is as good as anywhere.
    let inverse = part.try_inverse().unwrap_or_default();
    (-(inverse * shift)).map(|x| x as f32).into()
}

#[cfg(test)]
mod tests {
    use mesh_core::TriMesh;
    use mesh_core::primitives::icosphere;
    use ndarray::Array3;
    use synth::{Orbit, RenderOptions, render_views};

    use super::*;
    use crate::img2mesh::{Img2MeshConfig, SilhouetteKind};

    const SIDE: usize = 64;

    fn config() -> Img2MeshConfig {
        Img2MeshConfig {
            image_size: SIDE,
            render_size: SIDE,
            stages: 1,
            level: 2,
            radius: 1.0,
            silhouette: SilhouetteKind::Antialiased,
            ..Img2MeshConfig::default()
        }
    }

    /// Views of a red ball, in a frame that is the world.
    fn views(count: usize) -> Vec<Prepared> {
        let ball = icosphere(4).colored([0.8, 0.2, 0.1]);
        let orbit = Orbit { count, width: SIDE, height: SIDE, ..Orbit::default() };
        let options = RenderOptions::default();
        let views = render_views(&ball, &orbit.cameras(), &options, &|_, _| ()).expect("a ball");
        let prepared = views.iter().map(|view| Prepared::new(view, &config()));
        prepared.collect::<Result<_, _>>().expect("a ball")
    }

    /// Positions, and what the first of three views says of each: signals, colours.
    fn seen(mesh: &TriMesh) -> (Vec<[f32; SIGNALS]>, Vec<[f32; 3]>) {
        let (tape, level, views) = (Tape::eval(), Level::all(&config()).remove(0), views(3));
        let cameras: Vec<[f32; 12]> =
            views.iter().map(|view| view.matrix(&[0.0, 0.0, 0.0, 1.0])).collect();
        let views: Vec<&Prepared> = views.iter().collect();
        let v = mesh.positions.len();
        let positions = Array3::from_shape_fn((1, v, 3), |(_, i, k)| mesh.positions[i][k]);
        let mut matrices = tape.array(&[3, 3, 4]);
        matrices.as_slice_mut().copy_from_slice(cameras.as_flattened());
        let cameras = tape.constant(matrices);
        let found = observe(&tape, &level, tape.constant(positions), &views, cameras);
        assert_eq!(found.points.shape(), [3, v, 2]);
        let signals = found.signals.value().as_slice().as_chunks::<SIGNALS>().0[..v].to_vec();
        let colors = found.colors.value().as_slice().as_chunks::<3>().0[..v].to_vec();
        (signals, colors)
    }

    #[test]
    fn half_of_a_ball_is_seen_and_has_the_images_color() {
        let (signals, colors) = seen(&icosphere(2));
        for (signal, color) in signals.iter().zip(&colors) {
            let (facing, visible) = (signal[FACING], signal[VISIBLE]);
            // What just turns away lies on the outline.
            assert!(facing.abs() < 0.35 || (facing > 0.0) == (visible > 0.0), "{signal:?}");
            if facing > 0.5 {
                assert!(
                    (color[0] - 0.8).abs() < 0.02 && (color[2] - 0.1).abs() < 0.02,
                    "{color:?}"
                );
            }
        }
        assert!(signals.iter().filter(|s| s[VISIBLE] > 0.0).count() > 70);
    }

    /// Vertices of a ball too large that the view sees at its edge are led to the ball's own outline.
    #[test]
    fn the_step_leads_to_the_outline() {
        let large = icosphere(2).scaled([1.2; 3]);
        let (signals, _) = seen(&large);
        let mut edge = 0;
        for (signal, p) in signals.iter().zip(&large.positions) {
            let (distance, step) = (signal[4], &signal[8..11]);
            // Just inside the large ball's outline and outside of the true one.
            if distance > 0.03 && distance < 0.3 {
                let moved: f32 = (0..3).map(|k| (p[k] + step[k]).powi(2)).sum::<f32>().sqrt();
                let facing = signal[FACING];
                // Across the line of sight the ball's outline is where its radius is 1, nearly.
                if facing.abs() < 0.2 {
                    assert!((moved - 1.0).abs() < 0.08, "{moved} {signal:?}");
                    edge += 1;
                }
            }
        }
        assert!(edge > 5, "{edge}");
        // The ball itself has nowhere to go.
        let (signals, _) = seen(&icosphere(2));
        let outside = signals.iter().filter(|s| s[4] > 2.0 * 2.0 / SIDE as f32).count();
        assert_eq!(outside, 0);
    }

    #[test]
    fn the_center_is_where_nothing_is_projected() {
        for view in views(3) {
            let camera = view.matrix(&[0.0, 0.0, 0.0, 1.0]);
            let rows: [[f32; 4]; 3] =
                std::array::from_fn(|i| std::array::from_fn(|j| camera[4 * i + j]));
            let c = center(&rows);
            for zero in affine(&rows, c) {
                assert!(zero.abs() < 1e-4, "{zero}");
            }
        }
    }
}
