//! The planes of a mesh's faces, by which it is known which of them look at a camera.

use mesh_core::vector::{cross, dot, sub};
use rayon::prelude::*;

/// Faces whose planes lie side by side, so that one instruction takes many of them.
pub(super) const LANES: usize = 16;
/// Blocks of so many faces that a thread takes at once.
const BLOCKS: usize = 64;

/// What views are looked at with: a plane for each face, and the box of all corners. Kept from step to step.
#[derive(Clone, Debug, Default)]
pub(super) struct Planes {
    /// Normal and offset, each for as many faces; zero behind the last one.
    blocks: Vec<[[f32; LANES]; 4]>,
    /// Least and greatest coordinates; of no end where a coordinate is no number.
    bounds: [[f32; 3]; 2],
}

impl Planes {
    pub(super) fn of(positions: &[[f32; 3]], faces: &[[u32; 3]]) -> Self {
        let mut planes = Self::default();
        planes.measure(positions, faces);
        planes
    }

    /// Takes those of other positions, or another mesh.
    pub(super) fn measure(&mut self, positions: &[[f32; 3]], faces: &[[u32; 3]]) {
        self.bounds = bounds(positions);
        self.blocks.clear();
        self.blocks.resize(faces.len().div_ceil(LANES), [[0.0; LANES]; 4]);
        let blocks = self.blocks.par_iter_mut().zip(faces.par_chunks(LANES));
        blocks.with_min_len(BLOCKS).for_each(|(block, faces)| {
            for (lane, face) in faces.iter().enumerate() {
                let [a, b, c] = face.map(|v| positions[v as usize]);
                let normal = cross(sub(b, a), sub(c, a));
                let plane = [normal[0], normal[1], normal[2], -dot(normal, a)];
                for (row, value) in block.iter_mut().zip(plane) {
                    row[lane] = value;
                }
            }
        });
    }

    /// For each face, and behind the last one some that do not exist, a bit for each eye that it looks at; an eye is a place and 1, or a
    /// direction towards it and 0 where it is infinitely far away.
    pub(super) fn facing(&self, eyes: &[[f32; 4]], out: &mut Vec<[u8; LANES]>) {
        out.clear();
        out.extend(self.blocks.iter().map(|[x, y, z, offset]| {
            let mut bits = [0; LANES];
            for (k, eye) in eyes.iter().enumerate() {
                for lane in 0..LANES {
                    let side = x[lane] * eye[0] + y[lane] * eye[1] + z[lane] * eye[2];
                    let looks = side + offset[lane] * eye[3] > 0.0;
                    bits[lane] |= if looks { 1 << k } else { 0 };
                }
            }
            bits
        }));
    }

    /// The least value of a function that is linear in the coordinates, with a constant behind their factors, in the box.
    pub(super) fn least(&self, linear: &[f32; 4]) -> f32 {
        let [low, high] = self.bounds;
        (0..3).map(|k| (linear[k] * low[k]).min(linear[k] * high[k])).sum::<f32>() + linear[3]
    }
}

fn bounds(positions: &[[f32; 3]]) -> [[f32; 3]; 2] {
    if !positions.as_flattened().iter().all(|x| x.is_finite()) {
        return [[f32::NEG_INFINITY; 3], [f32::INFINITY; 3]];
    }
    let start = [[f32::INFINITY; 3], [f32::NEG_INFINITY; 3]];
    positions.iter().fold(start, |[low, high], p| {
        [std::array::from_fn(|k| low[k].min(p[k])), std::array::from_fn(|k| high[k].max(p[k]))]
    })
}

#[cfg(test)]
mod tests {
    use mesh_core::primitives;

    use super::*;

    #[test]
    fn faces_look_at_eyes_before_their_planes() {
        // Twenty faces: not a whole number of blocks.
        let ball = primitives::icosphere(0);
        let planes = Planes::of(&ball.positions, &ball.faces);
        let eyes = [[0.0, 0.0, 3.0, 1.0], [0.0, 0.0, 1.0, 0.0], [0.3, -0.2, 0.1, 1.0]];
        let mut facing = Vec::new();
        planes.facing(&eyes, &mut facing);
        let bits = facing.as_flattened();
        assert!(bits[ball.faces.len()..].iter().all(|&bits| bits == 0));
        for (face, &bits) in ball.faces.iter().zip(bits) {
            let [a, b, c] = face.map(|v| ball.positions[v as usize]);
            let normal = cross(sub(b, a), sub(c, a));
            for (k, eye) in eyes.iter().enumerate() {
                let from = a.map(|x| eye[3] * x);
                let looks = dot(normal, sub([eye[0], eye[1], eye[2]], from)) > 0.0;
                assert_eq!(bits >> k & 1 == 1, looks, "{face:?}, eye {k}");
            }
        }
        // From within, none.
        assert!(bits.iter().all(|bits| bits >> 2 & 1 == 0));
    }

    #[test]
    fn the_least_is_that_of_a_corner_of_the_box() {
        let ball = primitives::icosphere(1).scaled([1.0, 2.0, 3.0]);
        let mut positions = ball.positions.clone();
        let linear = [1.0, -1.0, 0.5, 10.0];
        let least = Planes::of(&positions, &ball.faces).least(&linear);
        let reached = positions.iter().map(|p| p[0] - p[1] + 0.5 * p[2] + 10.0);
        assert!(least > 5.0 && reached.fold(f32::MAX, f32::min) >= least, "{least}");
        positions[3][1] = f32::NAN;
        let least = Planes::of(&positions, &ball.faces).least(&linear);
        assert!(least == f32::NEG_INFINITY, "{least}");
    }
}
