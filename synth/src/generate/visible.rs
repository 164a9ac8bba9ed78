//! Points of a surface that can be seen from outside.

use datasets::SurfacePoints;
use diff_raster::FacesError;
use mesh_core::primitives::icosphere;
use mesh_core::vector::widen;
use mesh_core::{Camera, TriMesh, bounds, sample_points};

use crate::{RenderOptions, Rendering, render};

/// Width and height of the images that decide what is seen.
const SIDE: usize = 256;
/// Vertical angle of view, radians.
const FOV: f64 = 0.5;
/// How far behind what a pixel shows a point may lie and still count as seen, in diagonals of the box.
const BEHIND: f64 = 0.004;
/// The least cosine between a line of sight and the normal of what it sees: more squarely seen surfaces have depths that a pixel
/// can tell.
const SQUARELY: f64 = 0.25;
/// Points that are drawn for each that is wanted.
const DRAWN: usize = 3;

/// `count` points of what can be seen of a mesh from outside, fewer where hardly anything is, uniform by area, with normals that
/// look outwards.
///
/// Meshes as people make them have inner walls, faces on both sides and parts sunk into each other: a shape is what can be seen of
/// it. Depth images from 42 sides decide, so that walls thinner than 0.4 % of the diagonal count as one surface, and what only a
/// narrow gap shows as hidden.
///
/// # Errors
/// If a face names a vertex that does not exist.
pub(super) fn visible_points(
    mesh: &TriMesh,
    count: usize,
    seed: u64,
) -> Result<SurfacePoints, FacesError> {
    let Some(around) = mesh.bounds() else { return Ok(SurfacePoints::default()) };
    let (middle, diagonal) = (widen(bounds::center(around)), bounds::diagonal::<f64>(around));
    let away = 1.02 * 0.5 * diagonal / (0.5 * FOV).sin();
    let cameras: Vec<Camera> = icosphere(1)
        .positions
        .iter()
        .map(|side| {
            let eye = std::array::from_fn(|k| middle[k] + away * f64::from(side[k]));
            // None of the sides is this direction or its opposite.
            Camera::look_at(eye, middle, [0.31, 0.9, 0.17], FOV, SIDE, SIDE)
        })
        .collect();
    let options = RenderOptions { depth: true, supersample: 1, ..RenderOptions::default() };
    let plain = TriMesh::new(mesh.positions.clone(), mesh.faces.clone());
    let seen = render(&plain, &cameras, &options, &|_, _| ())?;
    let (positions, normals) = sample_points(mesh, DRAWN * count, seed);
    let drawn = positions.into_iter().zip(normals);
    let outside = drawn.filter_map(|(p, n)| Some((p, turned(n, view_of(p, n, &seen, diagonal)?))));
    let (positions, normals) = outside.take(count).unzip();
    Ok(SurfacePoints { positions, normals })
}

/// The direction to the camera that sees a point the most squarely; none where none sees it.
fn view_of(p: [f32; 3], normal: [f32; 3], seen: &[Rendering], diagonal: f64) -> Option<[f64; 3]> {
    let sees = |rendering: &Rendering| {
        let (camera, depth) = (&rendering.view.camera, rendering.view.depth.as_ref()?);
        let to_eye: [f64; 3] = std::array::from_fn(|k| camera.center()[k] - f64::from(p[k]));
        let facing = dot(to_eye, normal).abs() / dot64(to_eye, to_eye).sqrt();
        let at = camera.project(p.map(f64::from));
        let (row, column) = (at.row.floor(), at.column.floor());
        let inside = |x: f64| (0.0..SIDE as f64).contains(&x);
        if facing < SQUARELY || !inside(row) || !inside(column) {
            return None;
        }
        let surface = f64::from(depth.data[row as usize * SIDE + column as usize]);
        // A pixel is half as wide as its depths differ on a slope.
        let pixel = 2.0 * at.depth * (0.5 * FOV).tan() / SIDE as f64;
        (at.depth <= surface + BEHIND * diagonal + pixel / facing).then_some((facing, to_eye))
    };
    let best = seen.iter().filter_map(sees).max_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, to_eye)| to_eye)
}

/// The normal on the side of a direction.
fn turned(normal: [f32; 3], direction: [f64; 3]) -> [f32; 3] {
    if dot(direction, normal) < 0.0 { normal.map(|x| -x) } else { normal }
}

fn dot(a: [f64; 3], b: [f32; 3]) -> f64 {
    dot64(a, b.map(f64::from))
}

fn dot64(a: [f64; 3], b: [f64; 3]) -> f64 {
    (0..3).map(|k| a[k] * b[k]).sum()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::primitives::cuboid;

    use super::*;

    /// A ball within a box, whose faces look inwards: neither the ball nor the inside of the box is seen.
    #[test]
    fn what_is_inside_is_not_seen() {
        let mut mesh = cuboid([1.0, 0.5, 0.8]);
        mesh.faces.iter_mut().for_each(|face| face.swap(1, 2));
        assert!(mesh.append(&icosphere(3).scaled([0.15; 3])).is_ok());
        let points = visible_points(&mesh, 600, 3).unwrap();
        assert_eq!(points.positions.len(), 600);
        let half = [0.5_f32, 0.25, 0.4];
        for (p, n) in points.positions.iter().zip(&points.normals) {
            let side = (0..3).find(|&k| (p[k].abs() - half[k]).abs() < 1e-5);
            let k = side.expect("on the box");
            assert!(n[k] * p[k] > 0.0 && n[k].abs() > 0.99, "{p:?} {n:?}");
        }
        // All six sides by their area: those across z have 0.5 of 1.7 + 0.8.
        let ends = points.positions.iter().filter(|p| (p[2].abs() - 0.4).abs() < 1e-5).count();
        let share = 2.0 * 0.5 / (2.0 * (0.5 + 0.4 + 0.8));
        assert!((ends as f64 / 600.0 - share).abs() < 0.06, "{ends} {share}");
    }

    /// Walls that a person models on both sides count once, and both sides of a sheet are seen.
    #[test]
    fn an_open_sheet_is_seen_from_both_sides() {
        let corners = vec![[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
        let sheet = TriMesh::new(corners, vec![[0, 1, 2], [0, 2, 3]]);
        let points = visible_points(&sheet, 200, 1).unwrap();
        assert_eq!(points.positions.len(), 200);
        assert!(visible_points(&TriMesh::default(), 10, 1).unwrap().positions.is_empty());
    }
}
