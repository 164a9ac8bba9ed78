//! The ellipsoid that Pixel2Mesh deforms.

use std::f64::consts::{PI, TAU};

use crate::vector::narrow;
use crate::{TriMesh, subdivide};

/// Semi-axes of the ellipsoid, and where its centre is.
const AXES: [f64; 3] = [0.2764, 0.1936, 0.199];
const CENTER: [f64; 3] = [0.0, 0.0, -0.8];

/// Vertices on each circle from the bottom pole to the top: 154, nearly in proportion to the
/// circles' lengths, so that the triangles are nearly equilateral.
const RINGS: [usize; 11] = [5, 10, 14, 18, 20, 20, 20, 18, 14, 10, 5];

/// An ellipsoid of the counts, size and place of Pixel2Mesh's, at one of its three levels.
///
/// | level | vertices | faces |
/// |---|---|---|
/// | 0 | 156 | 308 |
/// | 1 | 618 | 1232 |
/// | 2 | 2466 | 4928 |
///
/// Semi-axes (0.2764, 0.1936, 0.199), centre (0, 0, -0.8) in the camera's frame; each level is the
/// midpoint subdivision of the one before, new vertices on the chords, as there. How the 156
/// vertices are joined is our own: weights trained on the original's need the original's faces,
/// which come with its own files.
///
/// # Panics
/// If `level` is above 6.
///
/// # References
/// Wang et al. 2018, *Pixel2Mesh: Generating 3D Mesh Models from Single RGB Images*, section 3.
pub fn pixel2mesh_ellipsoid(level: u32) -> TriMesh {
    assert!(level <= 6, "pixel2mesh_ellipsoid: level {level}, expected 0..=6");
    let place = |p: [f64; 3]| narrow(std::array::from_fn(|k| CENTER[k] + AXES[k] * p[k]));
    let mut positions = vec![place([0.0, -1.0, 0.0])];
    let mut faces = Vec::with_capacity(308);
    let mut below = Ring { first: 0, count: 1 };
    for (i, &count) in RINGS.iter().enumerate() {
        let ring = Ring { first: positions.len() as u32, count };
        let (radius, height) = (PI * (i + 1) as f64 / (RINGS.len() + 1) as f64).sin_cos();
        positions.extend((0..count).map(|j| {
            let (sin, cos) = (TAU * ring.turn(j)).sin_cos();
            place([radius * cos, -height, -radius * sin])
        }));
        band(&below, &ring, &mut faces);
        below = ring;
    }
    let top = Ring { first: positions.len() as u32, count: 1 };
    positions.push(place([0.0, 1.0, 0.0]));
    band(&below, &top, &mut faces);

    let mut mesh = TriMesh::new(positions, faces);
    for _ in 0..level {
        mesh = subdivide(&mesh);
    }
    mesh
}

/// Equally spaced vertices on a circle; a single one is a pole.
struct Ring {
    first: u32,
    count: usize,
}

impl Ring {
    /// Where vertex `j` is, as a fraction of a turn.
    fn turn(&self, j: usize) -> f64 {
        j as f64 / self.count as f64
    }

    fn vertex(&self, j: usize) -> u32 {
        self.first + (j % self.count) as u32
    }
}

/// Joins two rings by `below.count + above.count` triangles (one side only at a pole), always
/// stepping on the ring whose next vertex comes first.
fn band(below: &Ring, above: &Ring, faces: &mut Vec<[u32; 3]>) {
    let steps = |ring: &Ring| if ring.count == 1 { 0 } else { ring.count };
    let (mut i, mut j) = (0, 0);
    while i < steps(below) || j < steps(above) {
        let step_below =
            j == steps(above) || (i < steps(below) && below.turn(i + 1) <= above.turn(j + 1));
        let (a, b) = (below.vertex(i), above.vertex(j));
        if step_below {
            i += 1;
            faces.push([a, below.vertex(i), b]);
        } else {
            j += 1;
            faces.push([a, above.vertex(j), b]);
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::super::tests::assert_sound;
    use super::*;

    #[test]
    fn counts_size_and_place() {
        for (level, vertices, faces) in [(0, 156, 308), (1, 618, 1232), (2, 2466, 4928)] {
            let mesh = pixel2mesh_ellipsoid(level);
            assert_sound(&mesh, 2);
            assert_eq!((mesh.positions.len(), mesh.faces.len()), (vertices, faces));
            let full = 4.0 / 3.0 * PI * AXES.iter().product::<f64>();
            approx::assert_relative_eq!(mesh.volume(), full, max_relative = 0.06);
        }
        let (low, high) = pixel2mesh_ellipsoid(0).bounds().unwrap();
        for k in 0..3 {
            let (low, high) = (f64::from(low[k]), f64::from(high[k]));
            approx::assert_abs_diff_eq!(0.5 * (low + high), CENTER[k], epsilon = 1e-3);
            approx::assert_relative_eq!(0.5 * (high - low), AXES[k], max_relative = 0.02);
        }
    }
}
