//! Offsets of the vertices, level by level.

use autodiff_lite::{Module, SparseMatrix, Var, Visitor, VisitorMut};
use mesh_core::{Subdivision, primitives};
use nets::{Init, Linear};

/// Linear heads for icospheres of several levels, whose offsets are carried to the finest one and
/// added up there:
///
/// ```text
/// offset = U_c W_c x + .. + U_{f-1} W_{f-1} x + W_f x
/// ```
///
/// `U` takes the mean of an edge's ends for the vertex in its middle, so a coarse level moves whole
/// regions by a few numbers, and finer ones add what is left. With one level it is the published
/// head.
#[derive(Clone, Debug)]
pub(super) struct Offsets {
    /// The finest level's, under its published name.
    fine: Linear,
    /// The others', coarsest first.
    coarse: Vec<Linear>,
    up: Vec<SparseMatrix<f32>>,
    /// How many levels count, from the coarsest on.
    pub(super) active: usize,
}

impl Module<f32> for Offsets {
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<f32>) {
        self.fine.visit(path, visitor);
        self.coarse.visit(&format!("{path}.coarse"), visitor);
    }

    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<f32>) {
        self.fine.visit_mut(path, visitor);
        self.coarse.visit_mut(&format!("{path}.coarse"), visitor);
    }
}

impl Offsets {
    /// Heads of `coarsest` to `finest` on `width` features, each made by `head(init, outputs)`.
    pub(super) fn new(
        init: &Init,
        [coarsest, finest]: [u32; 2],
        head: impl Fn(&Init, usize) -> Linear,
    ) -> Self {
        let outputs = |level: u32| 3 * (10 * 4_usize.pow(level) + 2);
        let at = init.at("coarse");
        Self {
            fine: head(init, outputs(finest)),
            coarse: (coarsest..finest)
                .map(|level| head(&at.index((level - coarsest) as usize), outputs(level)))
                .collect(),
            up: (coarsest..finest).map(|level| carried(level, finest)).collect(),
            active: (finest - coarsest) as usize + 1,
        }
    }

    /// How many levels there are.
    pub(super) fn levels(&self) -> usize {
        self.coarse.len() + 1
    }

    /// All that counts as one linear layer from a code to the finest level's `3 V` numbers: weight, row by row, and bias.
    pub(super) fn folded(&self) -> (Vec<f32>, Vec<f32>) {
        let [rows, width] = [0, 1].map(|axis| self.fine.weight.shape()[axis]);
        let (mut weight, mut bias) = (vec![0.0; rows * width], vec![0.0; rows]);
        let mut add = |head: &Linear, row: usize, from: usize, share: f32| {
            let source = &head.weight.as_slice()[from * width..(from + 1) * width];
            let own = &mut weight[row * width..(row + 1) * width];
            own.iter_mut().zip(source).for_each(|(own, &value)| *own += share * value);
            bias[row] += share * head.bias.as_ref().map_or(0.0, |bias| bias.as_slice()[from]);
        };
        for (head, up) in self.coarse.iter().zip(&self.up).take(self.active) {
            let rows = up.view();
            for (vertex, ends) in rows.offsets.windows(2).enumerate() {
                for at in ends[0] as usize..ends[1] as usize {
                    let (parent, share) = (rows.indices[at] as usize, rows.values[at]);
                    (0..3).for_each(|k| add(head, 3 * vertex + k, 3 * parent + k, share));
                }
            }
        }
        if self.active > self.coarse.len() {
            (0..rows).for_each(|row| add(&self.fine, row, row, 1.0));
        }
        (weight, bias)
    }

    /// Codes `[N, D]` to offsets `[N, V, 3]` of the finest level.
    pub(super) fn forward<'t>(&self, code: Var<'t>) -> Var<'t> {
        let [n, _] = code.dims();
        let rows = |head: &Linear| {
            let y = head.forward(code);
            let [_, k] = y.dims();
            y.reshape(&[n, k / 3, 3])
        };
        let coarse = self.coarse.iter().zip(&self.up).take(self.active);
        let carried = coarse.map(|(head, up)| rows(head).sparse_matmul(up));
        let fine = (self.active > self.coarse.len()).then(|| rows(&self.fine));
        carried.chain(fine).reduce(|a, b| a + b).expect("one level is active at least")
    }
}

/// Values of an icosphere's vertices to those of a finer one: `[V fine, V coarse]`.
pub(super) fn carried(from: u32, to: u32) -> SparseMatrix<f32> {
    let sphere = primitives::icosphere(from);
    let columns = sphere.positions.len();
    let mut rows: Vec<Vec<(usize, f32)>> = (0..columns).map(|i| vec![(i, 1.0)]).collect();
    let mut faces = sphere.faces;
    for _ in from..to {
        let split = Subdivision::of(rows.len(), &faces);
        for &[a, b] in &split.parents {
            let half = |v: u32| rows[v as usize].iter().map(|&(i, w)| (i, 0.5 * w));
            let middle = half(a).chain(half(b)).collect();
            rows.push(middle);
        }
        faces = split.faces;
    }
    let entries: Vec<(usize, usize, f32)> = rows
        .iter()
        .enumerate()
        .flat_map(|(row, entries)| entries.iter().map(move |&(column, w)| (row, column, w)))
        .collect();
    SparseMatrix::from_triplets(rows.len(), columns, &entries)
        .expect("a subdivision's vertices lie between earlier ones")
}

#[cfg(test)]
mod tests {
    use autodiff_lite::Tape;
    use ndarray::Array2;

    use super::*;

    /// Positions of the coarse sphere, carried as if they were offsets, are those of the polyhedron
    /// that plain subdivision makes, in the finer sphere's order of vertices.
    #[test]
    fn coarse_values_are_carried_along_edges() {
        let (coarse, fine) = (primitives::icosphere(1), primitives::icosphere(3));
        let up = carried(1, 3);
        let tape = Tape::eval();
        let found =
            tape.constant(Array2::from(coarse.positions.clone())).sparse_matmul(&up).value();
        let plain = mesh_core::subdivide(&mesh_core::subdivide(&coarse));
        assert_eq!(plain.faces, fine.faces);
        for (i, p) in plain.positions.iter().enumerate() {
            for k in 0..3 {
                assert!((found[[i, k]] - p[k]).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn levels_that_do_not_count_are_left_out() {
        let head = |init: &Init, outputs: usize| Linear::new(init, 4, outputs);
        let mut offsets = Offsets::new(&Init::new(1), [0, 2], head);
        assert_eq!(offsets.levels(), 3);
        let tape = Tape::eval();
        let code = tape.constant(Array2::ones((2, 4)));
        let all = offsets.forward(code).value().to_owned();
        offsets.active = 1;
        let one = offsets.forward(code).value().to_owned();
        assert_eq!(one.shape(), [2, 162, 3]);
        assert_ne!(all, one);
        // What is left is linear along the edges of the coarsest level.
        let first = offsets.coarse[0].forward(code).reshape(&[2, 12, 3]).value().to_owned();
        for k in 0..3 {
            assert_eq!(one[[1, 5, k]], first[[1, 5, k]]);
        }
    }
}
