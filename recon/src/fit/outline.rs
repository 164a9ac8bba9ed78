//! The outline of a closed mesh in a view: where it is, and how to move it onto the mask's edge.
//!
//! The outline of a closed, oriented mesh needs no rasteriser. It consists of edges between a face
//! that looks at the camera and one that does not. Along a line of pixel centres each such edge
//! that is crossed changes the number of layers in front by one, so the places where that number
//! leaves or reaches zero are the exact borders of the silhouette on that line.

use super::contour::{Contours, Surface};
use super::crossing::{Crossings, line_from};
use super::target::Target;

/// Buffers, kept from view to view and from step to step.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    contours: Contours,
    eyes: Vec<[f32; 4]>,
    /// The ends of the contour's edges in a view, in turn around a face that looks at it.
    ends: Vec<[[f32; 3]; 2]>,
    crossings: Crossings,
}

/// What [`outline`] measured in one view.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Measure {
    /// Half the squared distance of the outline to the mask's edge, integrated along it: pixels^3.
    pub(super) energy: f64,
    /// Length of the outline in pixels.
    pub(super) length: f64,
}

impl Measure {
    /// Sums two measures.
    pub(super) fn plus(self, other: Self) -> Self {
        Self { energy: self.energy + other.energy, length: self.length + other.length }
    }

    /// Root mean square distance of the outline to the mask's edge, in pixels.
    pub(super) fn rms(self) -> f64 {
        if self.length > 0.0 { (2.0 * self.energy / self.length).sqrt() } else { 0.0 }
    }
}

/// Measures the outline in one view and adds to `gradient` the way uphill.
///
/// With `S` the signed distance to the mask's edge, the gradient is the shape derivative of the
/// integral of `S` over the silhouette: moving the outline by `d` along its outward normal `n`
/// changes that integral by `S (n . d)` per unit length. It vanishes exactly where the outline
/// lies on the mask's edge, points outwards wherever the mask goes on and inwards where it does not,
/// whatever the distance, and grows with the distance up to the target's reach. The integral along the
/// outline is taken at its crossings with every `stride`-th row, weighted by `|n_x|`, and column,
/// weighted by `|n_y|`: together one sample per pixel of arc length, whatever the direction.
///
/// `None`, and nothing added, when a vertex is not in front of the camera.
///
/// # Shapes
/// `gradient [V, 3]`; the surface is closed and oriented outwards, and `view` the number of the target among those of the last [`look`].
/// # Cost
/// Linear in the outline's length in edges and in pixels; independent of the image.
pub(super) fn outline(
    surface: Surface<'_>,
    target: &Target,
    view: usize,
    stride: usize,
    scratch: &mut Scratch,
    gradient: &mut [[f32; 3]],
) -> Option<Measure> {
    let mut measure = Measure::default();
    borders(surface, target, view, stride, scratch, |border| {
        let Border { distance, weight, normal, ends, seen, share, .. } = border;
        measure = measure.plus(border.measure());
        let force = distance * weight;
        for ((vertex, seen), share) in ends.into_iter().zip(seen).zip([1.0 - share, share]) {
            let g = [force * share * normal[0], force * share * normal[1]];
            for (into, g) in gradient[vertex as usize].iter_mut().zip(target.pull(seen, g)) {
                *into += g;
            }
        }
    })?;
    Some(measure)
}

/// Finds the contours that [`outline`], [`borders`] and [`coverage`] of these views then follow: up to [`AT_ONCE`](super::contour::AT_ONCE).
///
/// # Cost
/// Linear in faces, a little for each view.
pub(super) fn look<'a>(
    surface: Surface<'_>,
    targets: impl Iterator<Item = &'a Target>,
    scratch: &mut Scratch,
) {
    scratch.eyes.clear();
    scratch.eyes.extend(targets.map(Target::eye));
    scratch.contours.find(surface, &scratch.eyes);
}

/// A place on the outline, where it crosses a line of pixel centres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Border {
    /// Column and row.
    pub(super) point: [f32; 2],
    /// Outward unit normal in the image.
    pub(super) normal: [f32; 2],
    /// Signed distance to the mask's edge in pixels, negative inside of the mask.
    pub(super) distance: f32,
    /// Length of the outline that it stands for, pixels.
    pub(super) weight: f32,
    /// The edge of the mesh that is crossed.
    pub(super) ends: [u32; 2],
    /// Where its ends are seen.
    seen: [[f32; 3]; 2],
    /// How far along it, in the image.
    pub(super) share: f32,
}

impl Border {
    /// What it adds to the measure of its outline.
    pub(super) fn measure(&self) -> Measure {
        let Self { distance, weight, .. } = *self;
        let energy = f64::from(0.5 * distance * distance * weight);
        Measure { energy, length: f64::from(weight) }
    }
}

/// Calls `visit` with every place where the outline crosses every `stride`-th line. `None`, without a call, when a vertex is not in front of
/// the camera.
pub(super) fn borders(
    surface: Surface<'_>,
    target: &Target,
    view: usize,
    stride: usize,
    scratch: &mut Scratch,
    mut visit: impl FnMut(Border),
) -> Option<()> {
    project(surface, target, view, scratch)?;
    let Scratch { contours, ends, crossings, .. } = scratch;
    let contour = contours.of(view);
    for axis in 0..2 {
        let (lines, limit) =
            if axis == 0 { (target.height, target.width) } else { (target.width, target.height) };
        crossings.find(ends, axis, lines, stride);
        crossings.walk(|line, crossing, outward| {
            let seen = ends[crossing.edge()];
            let [a, b] = seen;
            let across = 1 - axis;
            let (at, line) = (crossing.at(), line as f32 + 0.5);
            let share = (line - a[across]) / (b[across] - a[across]);
            let derivative = (b[axis] - a[axis]) / (b[across] - a[across]);
            // Outward unit normal: along the line, and across it.
            let along = outward / (1.0 + derivative * derivative).sqrt();
            let mut normal = [0.0; 2];
            normal[axis] = along;
            normal[across] = -derivative * along;
            let point = if axis == 0 { [at, line] } else { [line, at] };
            let distance = target.distance(point[0], point[1]);
            if distance < 0.0 && !(0.0..=limit as f32).contains(&at) {
                return; // the image cuts the object off: nothing is known beyond its border
            }
            let weight = along.abs() * stride as f32;
            let ends = surface.edges.ends(contour[crossing.edge()]);
            visit(Border { point, normal, distance, weight, ends, seen, share });
        });
    }
    Some(())
}

/// Projects the ends of the contour's edges.
fn project(
    surface: Surface<'_>,
    target: &Target,
    view: usize,
    scratch: &mut Scratch,
) -> Option<()> {
    if !target.has_before_it(surface) {
        return None;
    }
    let seen = |v: u32| target.project(surface.positions[v as usize]);
    scratch.ends.clear();
    let contour = scratch.contours.of(view).iter();
    scratch.ends.extend(contour.map(|&half| surface.edges.ends(half).map(seen)));
    Some(())
}

/// Which pixel centres of the target's box the mesh covers, row by row; `None` when a vertex is
/// not in front of the camera.
///
/// Exactly what a hard rasteriser finds, from the outline alone.
pub(super) fn coverage(
    surface: Surface<'_>,
    target: &Target,
    view: usize,
    scratch: &mut Scratch,
) -> Option<Vec<bool>> {
    project(surface, target, view, scratch)?;
    scratch.crossings.find(&scratch.ends, 0, target.height, 1);
    let mut covered = vec![false; target.height * target.width];
    let mut from = 0.0;
    scratch.crossings.walk(|line, crossing, outward| {
        if outward < 0.0 {
            from = crossing.at();
        } else {
            let row = line * target.width;
            let pixel = |at: f32| row + line_from(at, target.width);
            covered[pixel(from)..pixel(crossing.at())].fill(true);
        }
    });
    Some(covered)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use datasets::View;
    use mesh_core::{Camera, Topology, primitives};
    use synth::{RenderOptions, render_views};

    use super::*;
    use crate::fit::contour::Edges;
    use crate::fit::distance::Blur;
    use crate::fit::planes::Planes;

    /// What is found of a mesh that one view looks at.
    fn looked<T>(
        positions: &[[f32; 3]],
        faces: &[[u32; 3]],
        target: &Target,
        find: impl FnOnce(Surface<'_>, &mut Scratch) -> T,
    ) -> T {
        let edges = Edges::new(&Topology::new(positions.len(), faces), faces);
        let planes = Planes::of(positions, faces);
        let surface = Surface { positions, planes: &planes, edges: &edges };
        let mut scratch = Scratch::default();
        look(surface, std::iter::once(target), &mut scratch);
        find(surface, &mut scratch)
    }

    fn covered(positions: &[[f32; 3]], faces: &[[u32; 3]], target: &Target) -> Vec<bool> {
        let find = |surface: Surface<'_>, scratch: &mut Scratch| {
            coverage(surface, target, 0, scratch).unwrap()
        };
        looked(positions, faces, target, find)
    }

    fn measured(
        mesh: &mesh_core::TriMesh,
        target: &Target,
        gradient: &mut [[f32; 3]],
    ) -> Option<Measure> {
        looked(&mesh.positions, &mesh.faces, target, |surface, scratch| {
            outline(surface, target, 0, 1, scratch, gradient)
        })
    }

    fn camera(size: usize) -> Camera {
        Camera::look_at([1.0, 1.5, 4.0], [0.1, 0.0, 0.0], [0.0, 1.0, 0.0], 0.7, size, size - 8)
    }

    fn view(mesh: &mesh_core::TriMesh, camera: Camera) -> View {
        let options = RenderOptions { supersample: 1, ..RenderOptions::default() };
        render_views(mesh, &[camera], &options, &|_, _| {}).unwrap().remove(0)
    }

    /// Dents and bumps, so that the outline hides parts of itself.
    fn bumpy() -> mesh_core::TriMesh {
        let mut mesh = primitives::icosphere(4);
        for p in &mut mesh.positions {
            let r = 0.8 + 0.25 * (4.0 * p[0]).sin() * (5.0 * p[1]).cos();
            *p = p.map(|v| v * r);
        }
        mesh
    }

    #[test]
    fn coverage_is_what_the_rasterizer_finds() {
        let mesh = bumpy();
        let seen = view(&mesh, camera(96));
        let target = Target::new(&seen, Blur::plain(1.0), 0.2, 4.0).unwrap();
        assert_eq!((target.height, target.width), (88, 96)); // the margin takes in all of it
        let covered = covered(&mesh.positions, &mesh.faces, &target);
        let differ = covered.iter().zip(&seen.mask.data).filter(|(c, m)| **c != (**m != 0)).count();
        assert!(differ <= 2, "{differ} pixels differ");
    }

    #[test]
    fn the_gradient_is_that_of_the_distance_integrated_over_the_silhouette() {
        // The functional by brute force: signed distances summed over an image 16 times finer.
        let mesh = bumpy();
        let ball = primitives::icosphere(4);
        let target = Target::new(&view(&ball, camera(64)), Blur::plain(1.0), 0.5, 4.0).unwrap();
        let fine = 16;
        let grid = Target::new(
            &view(&ball, camera(64).resized(64 * fine, 56 * fine)),
            Blur::plain(0.0),
            0.5,
            4.0,
        )
        .unwrap();
        let functional = |positions: &[[f32; 3]]| -> f64 {
            let covered = covered(positions, &mesh.faces, &grid);
            let pixel = |k: usize| (k as f32 + 0.5) / fine as f32;
            (0..covered.len())
                .filter(|&k| covered[k])
                .map(|k| {
                    f64::from(target.distance(pixel(k % grid.width), pixel(k / grid.width)))
                        / (fine * fine) as f64
                })
                .sum()
        };
        let mut gradient = vec![[0.0; 3]; mesh.positions.len()];
        measured(&mesh, &target, &mut gradient).unwrap();
        for (name, direction) in [
            ("inflate", [1.0, 1.0, 1.0]),
            ("stretch x", [1.0, 0.0, 0.0]),
            ("stretch y", [0.0, 1.0, 0.0]),
        ] {
            let moved = |by: f32| -> Vec<[f32; 3]> {
                let shift = |p: &[f32; 3]| std::array::from_fn(|k| p[k] + by * direction[k] * p[k]);
                mesh.positions.iter().map(shift).collect()
            };
            let h = 0.02;
            let difference = (functional(&moved(h)) - functional(&moved(-h))) / f64::from(2.0 * h);
            let product: f64 = gradient
                .iter()
                .zip(&mesh.positions)
                .map(|(g, p)| (0..3).map(|k| f64::from(g[k] * direction[k] * p[k])).sum::<f64>())
                .sum();
            assert!(
                (difference - product).abs() < 0.05 * difference.abs(),
                "{name}: gradient {product}, difference {difference}"
            );
        }
    }

    #[test]
    fn a_mesh_on_its_own_mask_feels_almost_nothing() {
        let mesh = bumpy();
        let target = Target::new(&view(&mesh, camera(128)), Blur::plain(1.0), 0.2, 0.3).unwrap();
        let mut gradient = vec![[0.0; 3]; mesh.positions.len()];
        let at = measured(&mesh, &target, &mut gradient);
        assert!(at.unwrap().rms() < 0.35, "{}", at.unwrap().rms());
    }

    #[test]
    fn behind_the_camera_nothing_is_said() {
        let mut mesh = primitives::icosphere(2);
        let target = Target::new(&view(&mesh, camera(64)), Blur::plain(1.0), 0.2, 0.3).unwrap();
        mesh.positions[3] = [2.0, 3.0, 8.0];
        let mut gradient = vec![[0.0; 3]; mesh.positions.len()];
        let at = measured(&mesh, &target, &mut gradient);
        assert!(at.is_none());
        assert!(gradient.iter().flatten().all(|g| *g == 0.0));
    }
}
