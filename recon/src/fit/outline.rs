//! The outline of a closed mesh in a view: where it is, and how to move it onto the mask's edge.
//!
//! The outline of a closed, oriented mesh needs no rasteriser. It consists of edges between a face
//! that looks at the camera and one that does not. Along a line of pixel centres each such edge
//! that is crossed changes the number of layers in front by one, so the places where that number
//! leaves or reaches zero are the exact borders of the silhouette on that line.

use mesh_core::Topology;

use super::target::Target;

/// Which way each edge runs in the first of its faces; fixed per topology.
#[derive(Clone, Debug)]
pub(super) struct Edges {
    /// End points, the smaller index first.
    ends: Vec<[u32; 2]>,
    /// The two faces of each: all of them are looked at in every view, the ends of few.
    faces: Vec<[u32; 2]>,
    /// Whether the edge runs from its smaller to its larger index in its first face.
    forward: Vec<bool>,
}

impl Edges {
    /// The edges of a closed mesh.
    pub(super) fn new(topology: &Topology, faces: &[[u32; 3]]) -> Self {
        let (ends, sides) = (topology.edges.clone(), topology.edge_faces.clone());
        let forward = ends
            .iter()
            .zip(&sides)
            .map(|(&[a, b], &[first, _])| {
                let f = faces[first as usize];
                (0..3).any(|k| f[k] == a && f[(k + 1) % 3] == b)
            })
            .collect();
        Self { ends, faces: sides, forward }
    }
}

/// One place where the outline crosses a line of pixel centres.
#[derive(Clone, Copy, Debug)]
struct Crossing {
    line: u32,
    edge: u32,
    /// Where along the line, in pixels.
    at: f32,
    /// `+1` or `-1`: the change in the number of layers (rows count up, columns down).
    layers: i8,
}

/// Buffers of [`outline`], kept from step to step.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    projected: Vec<[f32; 3]>,
    front: Vec<bool>,
    /// The edges of the outline, so many of them; what follows is of no account.
    contour: Vec<u32>,
    contour_edges: usize,
    crossings: Vec<Crossing>,
    sorted: Vec<Crossing>,
    starts: Vec<u32>,
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
/// `positions [V, 3]`, `faces [F, 3]` of a closed mesh, oriented outwards; `gradient [V, 3]`.
/// # Cost
/// Linear in faces and in the outline's length in pixels; independent of the image.
pub(super) fn outline(
    target: &Target,
    positions: &[[f32; 3]],
    faces: &[[u32; 3]],
    edges: &Edges,
    stride: usize,
    scratch: &mut Scratch,
    gradient: &mut [[f32; 3]],
) -> Option<Measure> {
    let mut measure = Measure::default();
    borders(target, positions, faces, edges, stride, scratch, |border, projected| {
        let Border { distance, weight, normal, ends, share, .. } = border;
        measure = measure.plus(border.measure());
        let force = distance * weight;
        for (vertex, share) in [(ends[0], 1.0 - share), (ends[1], share)] {
            let g = [force * share * normal[0], force * share * normal[1]];
            let pulled = target.pull(projected[vertex as usize], g);
            for (into, g) in gradient[vertex as usize].iter_mut().zip(pulled) {
                *into += g;
            }
        }
    })?;
    Some(measure)
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

/// Calls `visit` with every place where the outline crosses every `stride`-th line, and with the projected vertices. `None`,
/// without a call, when a vertex is not in front of the camera.
pub(super) fn borders(
    target: &Target,
    positions: &[[f32; 3]],
    faces: &[[u32; 3]],
    edges: &Edges,
    stride: usize,
    scratch: &mut Scratch,
    mut visit: impl FnMut(Border, &[[f32; 3]]),
) -> Option<()> {
    project(target, positions, faces, edges, scratch)?;
    for axis in 0..2 {
        let (lines, limit) =
            if axis == 0 { (target.height, target.width) } else { (target.width, target.height) };
        cross(edges, axis, lines, stride, scratch);
        walk(&scratch.sorted, |crossing, outward| {
            let ends = edges.ends[crossing.edge as usize];
            let (a, b) = (scratch.projected[ends[0] as usize], scratch.projected[ends[1] as usize]);
            let across = 1 - axis;
            let line = crossing.line as f32 + 0.5;
            let share = (line - a[across]) / (b[across] - a[across]);
            let derivative = (b[axis] - a[axis]) / (b[across] - a[across]);
            // Outward unit normal: along the line, and across it.
            let along = outward / (1.0 + derivative * derivative).sqrt();
            let mut normal = [0.0; 2];
            normal[axis] = along;
            normal[across] = -derivative * along;
            let point = if axis == 0 { [crossing.at, line] } else { [line, crossing.at] };
            let distance = target.distance(point[0], point[1]);
            if distance < 0.0 && !(0.0..=limit as f32).contains(&crossing.at) {
                return; // the picture cuts the object off: nothing is known beyond its border
            }
            let weight = along.abs() * stride as f32;
            visit(Border { point, normal, distance, weight, ends, share }, &scratch.projected);
        });
    }
    Some(())
}

/// Projects the vertices and finds the edges of the outline.
fn project(
    target: &Target,
    positions: &[[f32; 3]],
    faces: &[[u32; 3]],
    edges: &Edges,
    scratch: &mut Scratch,
) -> Option<()> {
    let Scratch { projected, front, contour, contour_edges, .. } = scratch;
    projected.clear();
    projected.extend(positions.iter().map(|&p| target.project(p)));
    // Not in front of the camera, or not a number: such a view says nothing.
    if !projected.iter().all(|p| p[2] > 0.0 && p[0].is_finite() && p[1].is_finite()) {
        return None;
    }
    front.clear();
    front.extend(faces.iter().map(|&[a, b, c]| {
        let at = |v: u32| &projected[v as usize];
        let (a, b, c) = (at(a), at(b), at(c));
        // Rows run down, so a face that looks at the camera turns clockwise.
        (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) < 0.0
    }));
    // Few edges are of it, here and there: written and overwritten, without a branch that would be guessed wrong.
    contour.resize(edges.faces.len() + 1, 0);
    let mut count = 0;
    for (e, [f, g]) in edges.faces.iter().enumerate() {
        contour[count] = e as u32;
        count += usize::from(front[*f as usize] != front[*g as usize]);
    }
    *contour_edges = count;
    Some(())
}

/// Finds the crossings with every `stride`-th line and sorts them by line, then along it.
fn cross(edges: &Edges, axis: usize, lines: usize, stride: usize, scratch: &mut Scratch) {
    let Scratch { projected, front, contour, contour_edges, crossings, sorted, starts } = scratch;
    let across = 1 - axis;
    crossings.clear();
    starts.clear();
    starts.resize(lines + 1, 0);
    // The lines in the middle of each run of `stride`.
    let phase = stride / 2;
    for &e in &contour[..*contour_edges] {
        let (ends, [first, _]) = (edges.ends[e as usize], edges.faces[e as usize]);
        let (a, b) = (projected[ends[0] as usize], projected[ends[1] as usize]);
        let upwards = b[across] > a[across];
        let (low, high) = if upwards { (a[across], b[across]) } else { (b[across], a[across]) };
        // Lines with low <= line + 0.5 < high: the half-open rule closes every loop.
        let (begin, end) = (line_from(low, lines), line_from(high, lines));
        if begin >= end {
            continue;
        }
        let derivative = (b[axis] - a[axis]) / (b[across] - a[across]);
        let along_front = front[first as usize] == edges.forward[e as usize];
        let layers = if upwards == along_front { 1 } else { -1 };
        let mut line = begin + (phase + stride - begin % stride) % stride;
        while line < end {
            let at = a[axis] + (line as f32 + 0.5 - a[across]) * derivative;
            crossings.push(Crossing { line: line as u32, edge: e, at, layers });
            starts[line] += 1;
            line += stride;
        }
    }
    let mut total = 0;
    for s in starts.iter_mut() {
        total += std::mem::replace(s, total);
    }
    sorted.clear();
    sorted.extend_from_slice(crossings); // any filling: every slot is written below
    for &c in crossings.iter() {
        let slot = &mut starts[c.line as usize];
        sorted[*slot as usize] = c;
        *slot += 1;
    }
    let mut begin = 0;
    while begin < sorted.len() {
        let line = sorted[begin].line;
        let mut end = begin + 1;
        while end < sorted.len() && sorted[end].line == line {
            end += 1;
        }
        sorted[begin..end].sort_unstable_by(|p, q| p.at.total_cmp(&q.at).then(p.edge.cmp(&q.edge)));
        begin = end;
    }
}

/// The first of so many lines of pixel centres that is not before a place.
#[inline]
fn line_from(at: f32, lines: usize) -> usize {
    // Rounded up by hand: most builds call a function to do it.
    let at = (at - 0.5).clamp(0.0, lines as f32);
    let whole = at as u32;
    (whole + u32::from((whole as f32) < at)) as usize
}

/// Calls `visit` for each crossing that borders the silhouette, with `+1` where outwards is along
/// the line and `-1` where it is against it.
fn walk(sorted: &[Crossing], mut visit: impl FnMut(&Crossing, f32)) {
    let mut layers = 0i32;
    let mut line = u32::MAX;
    for crossing in sorted {
        if crossing.line != line {
            line = crossing.line;
            layers = 0;
        }
        let before = layers;
        layers += i32::from(crossing.layers);
        match (before, layers) {
            (0, _) => visit(crossing, -1.0),
            (_, 0) => visit(crossing, 1.0),
            _ => {}
        }
    }
}

/// Which pixel centres of the target's box the mesh covers, row by row; `None` when a vertex is
/// not in front of the camera.
///
/// Exactly what a hard rasteriser finds, from the outline alone.
pub(super) fn coverage(
    target: &Target,
    positions: &[[f32; 3]],
    faces: &[[u32; 3]],
    edges: &Edges,
    scratch: &mut Scratch,
) -> Option<Vec<bool>> {
    project(target, positions, faces, edges, scratch)?;
    cross(edges, 0, target.height, 1, scratch);
    let mut covered = vec![false; target.height * target.width];
    let mut from = 0.0;
    walk(&scratch.sorted, |crossing, outward| {
        if outward < 0.0 {
            from = crossing.at;
        } else {
            let row = crossing.line as usize * target.width;
            let pixel = |at: f32| row + line_from(at, target.width);
            covered[pixel(from)..pixel(crossing.at)].fill(true);
        }
    });
    Some(covered)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use datasets::View;
    use mesh_core::{Camera, primitives};
    use synth::{RenderOptions, render_views};

    use super::*;
    use crate::fit::distance::Blur;

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
    fn coverage_is_what_the_rasteriser_finds() {
        let mesh = bumpy();
        let seen = view(&mesh, camera(96));
        let target = Target::new(&seen, Blur::plain(1.0), 0.2, 4.0).unwrap();
        assert_eq!((target.height, target.width), (88, 96)); // the margin takes in all of it
        let topology = Topology::new(mesh.positions.len(), &mesh.faces);
        let edges = Edges::new(&topology, &mesh.faces);
        let mut scratch = Scratch::default();
        let covered =
            coverage(&target, &mesh.positions, &mesh.faces, &edges, &mut scratch).unwrap();
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
        let topology = Topology::new(mesh.positions.len(), &mesh.faces);
        let edges = Edges::new(&topology, &mesh.faces);
        let mut scratch = Scratch::default();
        let mut functional = |positions: &[[f32; 3]]| -> f64 {
            let covered = coverage(&grid, positions, &mesh.faces, &edges, &mut scratch).unwrap();
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
        let mut own = Scratch::default();
        outline(&target, &mesh.positions, &mesh.faces, &edges, 1, &mut own, &mut gradient).unwrap();
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
        let topology = Topology::new(mesh.positions.len(), &mesh.faces);
        let edges = Edges::new(&topology, &mesh.faces);
        let mut gradient = vec![[0.0; 3]; mesh.positions.len()];
        let mut scratch = Scratch::default();
        let at =
            outline(&target, &mesh.positions, &mesh.faces, &edges, 1, &mut scratch, &mut gradient);
        assert!(at.unwrap().rms() < 0.35, "{}", at.unwrap().rms());
    }

    #[test]
    fn behind_the_camera_nothing_is_said() {
        let mut mesh = primitives::icosphere(2);
        let target = Target::new(&view(&mesh, camera(64)), Blur::plain(1.0), 0.2, 0.3).unwrap();
        let topology = Topology::new(mesh.positions.len(), &mesh.faces);
        let edges = Edges::new(&topology, &mesh.faces);
        mesh.positions[3] = [2.0, 3.0, 8.0];
        let mut gradient = vec![[0.0; 3]; mesh.positions.len()];
        let mut scratch = Scratch::default();
        let at =
            outline(&target, &mesh.positions, &mesh.faces, &edges, 1, &mut scratch, &mut gradient);
        assert!(at.is_none());
        assert!(gradient.iter().flatten().all(|g| *g == 0.0));
    }
}
