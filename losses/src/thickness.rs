//! Wall thickness: keeps the two sides of thin parts apart.

use autodiff_lite::{Real, Var};
use mesh_core::vertex_normals;

use crate::kernels::vec3::{add, dot, points, points_mut, scale, sub};
use crate::scalar::{record, vertices, wanted};

/// Sides face away from each other where the cosine between their normals is below this: 120 degrees.
const AWAY: f32 = -0.5;

/// Which vertices stand on the other side of a thin wall: a plain value, since it is not differentiable.
///
/// Keep it from step to step: it is then found again in the same memory.
///
/// ```
/// use autodiff_lite::Tape;
/// use losses::{Walls, wall_thickness};
/// use mesh_core::primitives::icosphere;
///
/// // A sheet 0.02 thick, and what pulls its sides apart until it is 0.05.
/// let sheet = icosphere(3).scaled([1.0, 0.01, 1.0]);
/// let tape = Tape::<f32>::train(0);
/// let positions = tape.leaf(sheet.vertices());
/// let mut walls = Walls::default();
/// walls.find(positions, &sheet.faces, 0.2);
/// let gradients = wall_thickness(positions, &walls, 0.05).backward();
/// let pull = gradients.wrt(positions).unwrap();
/// let top = sheet.positions.iter().position(|p| p[1] > 0.009).unwrap();
/// assert!(pull[[top, 1]] < 0.0); // down the gradient is up
/// ```
#[derive(Clone, Debug, Default)]
pub struct Walls {
    pairs: Vec<Pair>,
    /// How many meshes of how many vertices were looked at.
    shape: [usize; 2],
    order: Vec<u32>,
}

/// A vertex and the one behind it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pair {
    mesh: u32,
    vertex: u32,
    opposite: u32,
    normal: [f32; 3],
}

impl Walls {
    /// Finds, for each vertex, the nearest one within `reach` whose normal points away from its own, by more than 120 degrees.
    ///
    /// Which of the two lies farther out is not asked: where sides have passed through each other they have changed places, and
    /// their normals have not. So a gap between two parts that is narrower than `reach` looks like a wall that is inside out;
    /// let `reach` be a little more than an edge.
    ///
    /// # Shapes
    /// `positions [V, 3]` or `[N, V, 3]`; `reach` in their unit.
    /// # Cost
    /// `O(N V log V)` and one comparison for each pair of vertices of a mesh whose x are within `reach`.
    /// # Panics
    /// If the shape is another or a face names a vertex that does not exist.
    #[track_caller]
    pub fn find<F: Real>(&mut self, positions: Var<'_, F>, faces: &[[u32; 3]], reach: f64) {
        let [n, v] = vertices("wall_thickness", "positions", positions);
        self.shape = [n, v];
        self.pairs.clear();
        let value = positions.value();
        let narrow = |p: &[F; 3]| p.map(|x| x.to_f64() as f32);
        for (k, mesh) in points(value.as_slice()).chunks_exact(v.max(1)).enumerate() {
            let mesh: Vec<[f32; 3]> = mesh.iter().map(narrow).collect();
            self.find_in(k as u32, &mesh, faces, reach as f32);
        }
    }

    fn find_in(&mut self, mesh: u32, positions: &[[f32; 3]], faces: &[[u32; 3]], reach: f32) {
        let normals = vertex_normals(positions, faces);
        let x = |v: u32| positions[v as usize][0];
        self.order.clear();
        self.order.extend(0..positions.len() as u32);
        self.order.sort_unstable_by(|&a, &b| x(a).total_cmp(&x(b)).then(a.cmp(&b)));
        let mut first = 0;
        for (i, &vertex) in self.order.iter().enumerate() {
            let (here, normal) = (positions[vertex as usize], normals[vertex as usize]);
            while x(self.order[first]) < here[0] - reach && first < i {
                first += 1;
            }
            let mut nearest = (reach * reach, None);
            let near = self.order[first..].iter().take_while(|&&other| x(other) <= here[0] + reach);
            for &other in near {
                let way = sub(positions[other as usize], here);
                let squared = dot(way, way);
                // Of equally near ones the first by number, whatever their order.
                let nearer = squared < nearest.0
                    || squared == nearest.0 && nearest.1.is_some_and(|found| other < found);
                if nearer && dot(normal, normals[other as usize]) < AWAY {
                    nearest = (squared, Some(other));
                }
            }
            if let Some(opposite) = nearest.1 {
                self.pairs.push(Pair { mesh, vertex, opposite, normal });
            }
        }
    }

    /// How many vertices have another side within reach, over all meshes.
    pub fn len(&self) -> usize {
        self.pairs.len()
    }

    /// Whether no vertex has.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }
}

/// How far walls are from being `least` thick, averaged over the vertices of the batch.
///
/// ```text
/// (1/NV) Σ_n Σ_i max(0, 1 - t_i / least)²     t_i = (p_i - p_o(i)) · n_i
/// ```
///
/// over the vertices that have another side `o(i)` in `walls`; `n_i` are the unit normals of the vertices that the walls were found with.
/// A thickness below 0 means that the sides have passed through each other.
///
/// # Shapes
/// `positions` as they were for [`Walls::find`] → a scalar; `least` in their unit.
/// # Gradient
/// Normals and pairs are held fixed: both vertices are pushed along the normal, away from each other. Zero at `least` and beyond.
/// # Cost
/// `O(NV)`; the gradient is made in the same pass.
/// # Panics
/// If the walls are those of another shape, or `least` is not above 0.
/// # References
/// Ours: the regularisers of DIB-R and Pixel2Mesh look along the surface and do not see the other side of it.
#[track_caller]
pub fn wall_thickness<'t, F: Real>(positions: Var<'t, F>, walls: &Walls, least: f64) -> Var<'t, F> {
    let [n, v] = vertices("wall_thickness", "positions", positions);
    if walls.shape != [n, v] {
        let [meshes, of] = walls.shape;
        let message = format!("the walls are those of {meshes} meshes of {of} vertices");
        positions.tape().refuse(
            "wall_thickness",
            message,
            &[("positions", &positions.shape(), "")],
        );
    }
    assert!(least > 0.0, "wall_thickness: a least thickness of {least}, expected above 0");
    let value = positions.value();
    let all = points(value.as_slice());
    let mut gradient = wanted(positions);
    let weight = 1.0 / (n * v).max(1) as f64;
    let slope = F::from_f64(-2.0 * weight / least);
    let mut total = 0.0;
    for &Pair { mesh, vertex, opposite, normal } in &walls.pairs {
        let [i, o] = [vertex, opposite].map(|w| mesh as usize * v + w as usize);
        let normal = normal.map(|x| F::from_f64(f64::from(x)));
        let lacking = F::one() - dot(sub(all[i], all[o]), normal) / F::from_f64(least);
        if lacking <= F::zero() {
            continue;
        }
        total += Real::to_f64(lacking * lacking);
        if let Some(gradient) = &mut gradient {
            let out = points_mut(gradient);
            let push = scale(normal, lacking * slope);
            out[i] = add(out[i], push);
            out[o] = sub(out[o], push);
        }
    }
    record("wall_thickness", [positions], weight * total, [gradient])
}

#[cfg(test)]
mod tests {
    use approx::assert_relative_eq;
    use autodiff_lite::Tape;
    use mesh_core::{TriMesh, primitives};
    use proptest::prelude::*;

    use super::*;
    use crate::testing;

    /// A sheet, thickest in the middle; below 0 its sides have changed places, and their normals have not.
    fn slab(thickness: f32) -> TriMesh {
        let mut mesh = primitives::icosphere(3);
        mesh.positions.iter_mut().for_each(|p| p[1] *= 0.5 * thickness);
        mesh
    }

    fn of(mesh: &TriMesh, reach: f64, least: f64) -> (usize, f64) {
        let mut found = 0;
        let value = testing::value(mesh, |x| {
            let mut walls = Walls::default();
            walls.find(x, &mesh.faces, reach);
            found = walls.len();
            wall_thickness(x, &walls, least)
        });
        (found, value)
    }

    proptest! {
        #[test]
        fn gradients(batch in proptest::option::of(1usize..4), thickness in -0.03f32..0.1, seed: u64) {
            let mut mesh = primitives::icosphere(1);
            mesh.positions.iter_mut().for_each(|p| p[1] *= 0.5 * thickness);
            // Found once, beside the function: what is nearest is held fixed.
            let tape = Tape::<f64>::eval();
            let one: ndarray::Array2<f64> = testing::array(&mesh.positions);
            let all = one.broadcast((batch.unwrap_or(1), 42, 3)).expect("as many meshes").to_owned();
            let all = match batch {
                Some(_) => tape.constant(all),
                None => tape.constant(one),
            };
            let mut walls = Walls::default();
            walls.find(all, &mesh.faces, 0.3);
            prop_assert!(!walls.is_empty());
            let shapes = [testing::shape(batch, 42)];
            testing::checked(&|x: &[Var<'_, f64>]| wall_thickness(x[0], &walls, 0.7), &shapes, &testing::options(seed))?;
        }

        #[test]
        fn only_scale_matters(a in -3.0f32..3.0, b in -3.0f32..3.0, s in 0.5f32..2.0) {
            let sheet = slab(0.04);
            let other = testing::moved(&sheet, [a, b], s, [0.3, -0.2, 0.9]);
            let (_, expected) = of(&sheet, 0.2, 0.1);
            let (_, value) = of(&other, 0.2 * f64::from(s), 0.1 * f64::from(s));
            prop_assert!((value - expected).abs() < 2e-3 * expected, "{value} of {expected}");
        }
    }

    #[test]
    fn a_ball_has_no_walls() {
        assert_eq!(of(&primitives::icosphere(3), 0.4, 0.2), (0, 0.0));
    }

    #[test]
    fn sides_that_changed_places_cost_more_than_those_that_touch() {
        let (pairs, thick) = of(&slab(0.2), 0.3, 0.05);
        assert!(pairs > 300, "{pairs}");
        let [thin, touching, crossed] =
            [0.02, 1e-4, -0.02].map(|thickness| of(&slab(thickness), 0.3, 0.05).1);
        assert!(
            thick < 0.3 * thin && thin < touching && touching < crossed,
            "{thick} {thin} {touching} {crossed}"
        );
    }

    #[test]
    fn steps_open_a_sheet_that_has_closed() {
        let mut sheet = slab(0.002);
        for _ in 0..200 {
            let tape = Tape::<f32>::train(0);
            let positions = tape.leaf(sheet.vertices());
            let mut walls = Walls::default();
            walls.find(positions, &sheet.faces, 0.2);
            let gradients = wall_thickness(positions, &walls, 0.04).backward();
            let pull = gradients.wrt(positions).expect("it depends on them");
            for (p, g) in sheet.positions.iter_mut().flatten().zip(pull.as_slice()) {
                *p -= 0.1 * g;
            }
        }
        let middle = sheet.positions.iter().filter(|p| p[0].hypot(p[2]) < 0.5);
        let thinnest = middle.map(|p| p[1].abs()).fold(f32::INFINITY, f32::min);
        assert!(thinnest > 0.015, "half of {thinnest}");
        assert_relative_eq!(sheet.positions[0][0], slab(0.002).positions[0][0], epsilon = 0.1);
    }
}
