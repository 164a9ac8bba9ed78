//! Mesh R-CNN's refinement of a mesh by what an image shows where its vertices are seen.

use autodiff_lite::{Activation, Real, SparseMatrix, Var, impl_module};

use crate::{GraphConv, Init, Linear, MapSampling, pool_linear};

/// One refinement stage: what the maps say at each vertex, a few graph convolutions, an offset.
///
/// ```text
/// a  = ReLU(bottleneck(maps at p))                           ΣC -> hidden
/// h1 = ReLU(gconvs.0([a, place, previous]))                  hidden + 3 (+ hidden from the second stage on)
/// h  = ReLU(gconvs.i([h, place]))                            hidden + 3
/// offset = tanh(vert_offset([h, place]))                     3
/// ```
///
/// The graph is the adjacency of the edges, and neighbours are summed ([`GraphConv`]). `vert_offset` begins at
/// zero: a new stage leaves the mesh where it is. Names and initial distributions are those of the published
/// code; as published there are 3 stages with 3 convolutions of 128 features.
///
/// `place` is what the network is told about where a vertex is. In the published code it is where the vertex
/// is *seen* (normalised device coordinates, y up, the third one of depth), not where it is in the camera's
/// space, though offsets are in the latter.
///
/// ```
/// use autodiff_lite::{SparseMatrix, Tape};
/// use nets::{Init, MeshRefinementStage};
///
/// let edges = [(0, 1, 1.0), (1, 0, 1.0), (1, 2, 1.0), (2, 1, 1.0)];
/// let graph = SparseMatrix::from_triplets(3, 3, &edges)?;
/// let stage = MeshRefinementStage::<f32>::new(&Init::new(0).at("stages.0"), 12, 0, 16, 3);
/// let tape = Tape::eval();
/// let maps = [8, 4].map(|c| tape.constant(ndarray::Array4::ones((1, 32 / c, 32 / c, c))));
/// let place = tape.constant(ndarray::Array3::zeros((1, 3, 3)));
/// let (offset, hidden) = stage.forward(&maps, place, None, &graph);
/// assert_eq!((offset.shape(), hidden.shape()), (vec![1, 3, 3], vec![1, 3, 16]));
/// assert!(offset.value().iter().all(|&x| x == 0.0));
/// # Ok::<(), autodiff_lite::SparseError>(())
/// ```
///
/// # References
/// Gkioxari, Malik, Johnson 2019, *Mesh R-CNN*, section 3.3, and its code.
#[derive(Clone, Debug)]
pub struct MeshRefinementStage<F: Real = f32> {
    /// From the channels of all maps to the hidden features.
    pub bottleneck: Linear<F>,
    /// From the last features and the place to the offset.
    pub vert_offset: Linear<F>,
    /// Over the edges of the mesh.
    pub gconvs: Vec<GraphConv<F>>,
}
impl_module!(MeshRefinementStage { bottleneck, vert_offset, gconvs });

impl<F: Real> MeshRefinementStage<F> {
    /// For maps of `channels` channels together and `previous` features from the stage before (0 in the
    /// first), with `depth` graph convolutions to `hidden` features.
    ///
    /// # Panics
    /// If there is no convolution.
    pub fn new(init: &Init, channels: usize, previous: usize, hidden: usize, depth: usize) -> Self {
        Self::with_places(init, [channels, previous, hidden, 3], depth)
    }

    /// The same where more is said of a vertex than three numbers: `[channels, previous, hidden, places]`, the last how many
    /// columns [`refine`](Self::refine)'s `place` has.
    ///
    /// # Panics
    /// If there is no convolution.
    pub fn with_places(init: &Init, sizes: [usize; 4], depth: usize) -> Self {
        assert!(depth > 0, "MeshRefinementStage: at least one graph convolution expected");
        let [channels, previous, hidden, places] = sizes;
        let gconv = |i: usize| {
            let inputs = hidden + places + if i == 0 { previous } else { 0 };
            GraphConv::new(&init.at("gconvs").index(i), inputs, hidden)
        };
        Self {
            bottleneck: Linear::normal(&init.at("bottleneck"), channels, hidden, 0.01),
            vert_offset: Linear::zeros(&init.at("vert_offset"), hidden + places, 3),
            gconvs: (0..depth).map(gconv).collect(),
        }
    }

    /// The same with six numbers for each vertex: three of an offset and three of a colour, red, green, blue in (0, 1).
    /// `vert_offset` then has six rows; all begin at zero, and so a colour at grey.
    #[must_use]
    pub fn with_color(mut self, init: &Init) -> Self {
        let inputs = self.vert_offset.weight.shape()[1];
        self.vert_offset = Linear::zeros(&init.at("vert_offset"), inputs, 6);
        self
    }

    /// Offsets of a mesh's vertices from what maps show where they are: [`look`](Self::look), then
    /// [`refine`](Self::refine).
    ///
    /// # Shapes
    /// `maps [N, H, W, C]` of any sizes, `place [N, V, 3]`, `previous [N, V, previous]`, the features of the stage before
    /// brought to the vertices of this mesh, `graph [V, V]` → offsets `[N, V, 3]`, each in (-1, 1), and features
    /// `[N, V, hidden]`.
    ///
    /// # Panics
    /// If sizes differ.
    #[track_caller]
    pub fn forward<'t>(
        &self,
        maps: &[Var<'t, F>],
        place: Var<'t, F>,
        previous: Option<Var<'t, F>>,
        graph: &SparseMatrix<F>,
    ) -> (Var<'t, F>, Var<'t, F>) {
        let refined = self.refine(self.look(maps, place), place, previous, graph);
        (refined.offset, refined.hidden)
    }

    /// What the maps show at the vertices.
    ///
    /// Maps are read at `place`'s first two coordinates, x to the right and y *up*, (-1, 1) and (1, -1) the
    /// centres of the top left and bottom right pixel; beyond them a map fades to zero.
    ///
    /// # Shapes
    /// `maps [N, H, W, C]` of any sizes, `place [N, V, 3]` → `[N, V, hidden]`.
    ///
    /// # Panics
    /// If sizes differ.
    #[track_caller]
    pub fn look<'t>(&self, maps: &[Var<'t, F>], place: Var<'t, F>) -> Var<'t, F> {
        let down = place.tape().constant(ndarray::arr1(&[F::one(), -F::one()]));
        let points = place.slice_axis(2, 0..2).mul(down);
        pool_linear(maps, points, MapSampling::Centers, &self.bottleneck, Activation::Relu)
    }

    /// The graph convolutions, from what was [seen](Self::look) to offsets and features.
    ///
    /// Meshes of different graphs go through it together as one of N = 1: their vertices one after the other, and no edge
    /// between them.
    ///
    /// # Shapes
    /// `seen [N, V, hidden]`, `place [N, V, 3]`, or of as many columns as it was [made for](Self::with_places), `previous
    /// [N, V, previous]`, `graph [V, V]` → as [`RefinedVertices`] says.
    ///
    /// # Panics
    /// If sizes differ.
    #[track_caller]
    pub fn refine<'t>(
        &self,
        seen: Var<'t, F>,
        place: Var<'t, F>,
        previous: Option<Var<'t, F>>,
        graph: &SparseMatrix<F>,
    ) -> RefinedVertices<'t, F> {
        let tape = place.tape();
        let parts: Vec<Var<'t, F>> =
            [Some(seen), Some(place), previous].into_iter().flatten().collect();
        let mut features = tape.concat(&parts, 2);
        let mut hidden = seen;
        for gconv in &self.gconvs {
            hidden = gconv.forward_then(features, graph, Activation::Relu);
            features = tape.concat(&[hidden, place], 2);
        }
        if self.vert_offset.weight.shape()[0] == 3 {
            let offset = self.vert_offset.forward_then(features, Activation::Tanh);
            return RefinedVertices { offset, color: None, hidden };
        }
        let both = self.vert_offset.forward(features);
        let offset = both.slice_axis(2, 0..3).tanh();
        let color = Some(both.slice_axis(2, 3..6).sigmoid());
        RefinedVertices { offset, color, hidden }
    }
}

/// What a stage says about each vertex.
#[derive(Clone, Copy, Debug)]
#[non_exhaustive]
pub struct RefinedVertices<'t, F: Real = f32> {
    /// How it moves, each coordinate in (-1, 1): `[N, V, 3]`.
    pub offset: Var<'t, F>,
    /// Its colour, in (0, 1), of a stage [with colours](MeshRefinementStage::with_color): `[N, V, 3]`.
    pub color: Option<Var<'t, F>>,
    /// Its features: `[N, V, hidden]`.
    pub hidden: Var<'t, F>,
}

/// The stages one after the other; between them the caller moves the mesh, and divides it if it wants to.
///
/// ```
/// use nets::{Init, MeshRefinementHead};
/// let head = MeshRefinementHead::<f32>::new(&Init::new(0).at("mesh_head"), 3840, 128, 3, 3);
/// assert_eq!(head.stages[1].gconvs[0].w0.weight.shape(), [128, 128 + 3 + 128]);
/// ```
#[derive(Clone, Debug)]
pub struct MeshRefinementHead<F: Real = f32> {
    /// Each with parameters of its own.
    pub stages: Vec<MeshRefinementStage<F>>,
}
impl_module!(MeshRefinementHead { stages });

impl<F: Real> MeshRefinementHead<F> {
    /// For maps of `channels` channels together: `stages` stages with `depth` graph convolutions of `hidden`
    /// features.
    ///
    /// # Panics
    /// If there is no convolution.
    pub fn new(init: &Init, channels: usize, hidden: usize, stages: usize, depth: usize) -> Self {
        Self::with_places(init, [channels, hidden, 3], stages, depth)
    }

    /// The same of stages [with more places](MeshRefinementStage::with_places): `[channels, hidden, places]`.
    ///
    /// # Panics
    /// If there is no convolution.
    pub fn with_places(
        init: &Init,
        [channels, hidden, places]: [usize; 3],
        stages: usize,
        depth: usize,
    ) -> Self {
        let stage = |i: usize| {
            let previous = if i == 0 { 0 } else { hidden };
            let init = init.at("stages").index(i);
            MeshRefinementStage::with_places(&init, [channels, previous, hidden, places], depth)
        };
        Self { stages: (0..stages).map(stage).collect() }
    }

    /// The same with colours from the last stage; see [`MeshRefinementStage::with_color`].
    #[must_use]
    pub fn with_color(mut self, init: &Init) -> Self {
        if let Some(last) = self.stages.pop() {
            let init = init.at("stages").index(self.stages.len());
            self.stages.push(last.with_color(&init));
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use autodiff_lite::testkit::{Options, assert_gradients, function};
    use autodiff_lite::{Module, Param, Tape};
    use ndarray::Array3;

    use super::*;
    use crate::testing::{parameter_gradients, randomize};

    /// A square with one diagonal.
    fn graph() -> SparseMatrix<f64> {
        let edges = [(0, 1), (1, 2), (2, 3), (3, 0), (0, 2)];
        let both: Vec<_> =
            edges.into_iter().flat_map(|(a, b)| [(a, b, 1.0), (b, a, 1.0)]).collect();
        SparseMatrix::from_triplets(4, 4, &both).expect("a graph of four vertices")
    }

    /// A stage whose weights are all of a size that gradients can be seen through.
    fn stage(previous: usize) -> MeshRefinementStage<f64> {
        let mut stage = MeshRefinementStage::new(&Init::new(0), 5, previous, 6, 2);
        randomize(&mut stage);
        stage
    }

    #[test]
    fn gradients() {
        let (graph, stage) = (graph(), stage(2));
        let shapes = [vec![2, 4, 3, 2], vec![2, 2, 2, 3], vec![2, 4, 3], vec![2, 4, 2]];
        // Kinks of rectifiers, and where a point passes from pixel to pixel.
        let options = Options::default().pieces().range(-0.9, 0.9);
        let both = function(|x| {
            let (offset, hidden) = stage.forward(&x[..2], x[2], Some(x[3]), &graph);
            x[0].tape().concat(&[offset, hidden], 2)
        });
        assert_gradients(&both, &shapes, &options);
        let drawn = options.draw(&shapes);
        parameter_gradients(&stage, |stage, tape| {
            let x: Vec<_> = drawn.iter().map(|x| tape.constant(x.clone())).collect();
            stage.forward(&x[..2], x[2], Some(x[3]), &graph).0
        });
    }

    #[test]
    fn gradients_with_colors() {
        let graph = graph();
        let mut stage =
            MeshRefinementStage::new(&Init::new(0), 5, 2, 6, 2).with_color(&Init::new(0));
        randomize(&mut stage);
        let shapes = [vec![1, 4, 6], vec![1, 4, 3], vec![1, 4, 2]];
        let options = Options::default().pieces().range(-0.9, 0.9);
        let both = function(|x| {
            let refined = stage.refine(x[0], x[1], Some(x[2]), &graph);
            let color = refined.color.expect("a stage with colours");
            x[0].tape().concat(&[refined.offset, color, refined.hidden], 2)
        });
        assert_gradients(&both, &shapes, &options);
    }

    /// Two meshes as one without edges between them: what each would be alone.
    #[test]
    fn packed_meshes_do_not_see_each_other() {
        let (one, stage) = (graph(), stage(2));
        let rows = one.view();
        let offsets = rows.offsets.iter().copied();
        let second = rows.offsets[1..].iter().map(|&o| o + rows.indices.len() as u32);
        let indices = rows.indices.iter().copied().chain(rows.indices.iter().map(|&v| v + 4));
        let values = [rows.values, rows.values].concat();
        let both = SparseMatrix::from_csr(
            8,
            8,
            offsets.chain(second).collect(),
            indices.collect(),
            values,
        )
        .expect("a graph of eight vertices");
        let options = Options::default().range(-0.9, 0.9);
        let drawn = options.draw(&[vec![2, 4, 6], vec![2, 4, 3], vec![2, 4, 2]]);
        let tape = Tape::<f64>::eval();
        let x: Vec<_> = drawn.iter().map(|x| tape.constant(x.clone())).collect();
        let apart = stage.refine(x[0], x[1], Some(x[2]), &one);
        let flat = |x: Var<'_, f64>| -> Vec<f64> { x.value().iter().copied().collect() };
        let joined: Vec<_> = x.iter().map(|x| x.reshape(&[1, 8, x.shape()[2]])).collect();
        let joined = stage.refine(joined[0], joined[1], Some(joined[2]), &both);
        assert_eq!(flat(apart.offset), flat(joined.offset));
        assert_eq!(flat(apart.hidden), flat(joined.hidden));
    }

    /// Each line of the formulas, vertex by vertex and neighbour by neighbour.
    #[test]
    fn the_formulas_vertex_by_vertex() {
        let (graph, stage) = (graph(), stage(2));
        let options = Options::default().range(-0.8, 0.8);
        let [map, place, previous] = [vec![1, 3, 3, 5], vec![1, 4, 3], vec![1, 4, 2]];
        let drawn = options.draw(&[map, place, previous]);
        let tape = Tape::<f64>::eval();
        let [map, place, previous] = [0, 1, 2].map(|i| tape.constant(drawn[i].clone()));
        let (offset, hidden) = stage.forward(&[map], place, Some(previous), &graph);

        let apply = |linear: &Linear<f64>, x: &[f64]| -> Vec<f64> {
            let bias = linear.bias.as_ref().expect("every layer has one").as_slice();
            let rows = linear.weight.as_slice().chunks(x.len()).zip(bias);
            rows.map(|(row, b)| b + row.iter().zip(x).map(|(w, x)| w * x).sum::<f64>()).collect()
        };
        let relu = |x: Vec<f64>| x.into_iter().map(|x| x.max(0.0)).collect::<Vec<_>>();
        let near = [[1, 2, 3].as_slice(), &[0, 2], &[0, 1, 3], &[0, 2]];
        let at = |v: usize| -> Vec<f64> { (0..3).map(|k| drawn[1][[0, v, k]]).collect() };
        let seen = |v: usize| {
            // Corner pixels have their centres at the corners of the square from -1 to 1.
            let (x, y) = (1.0 + at(v)[0], 1.0 - at(v)[1]);
            let value = |c: usize| -> f64 {
                let weight = |i: usize, j: usize| {
                    (1.0 - (x - j as f64).abs()).max(0.0) * (1.0 - (y - i as f64).abs()).max(0.0)
                };
                let cells = (0..3).flat_map(|i| (0..3).map(move |j| (i, j)));
                cells.map(|(i, j)| weight(i, j) * drawn[0][[0, i, j, c]]).sum()
            };
            relu(apply(&stage.bottleneck, &(0..5).map(value).collect::<Vec<_>>()))
        };
        let mut features: Vec<Vec<f64>> = (0..4)
            .map(|v| [seen(v), at(v), (0..2).map(|k| drawn[2][[0, v, k]]).collect()].concat())
            .collect();
        for gconv in &stage.gconvs {
            let next = |v: usize| {
                let mut sum = apply(&gconv.w0, &features[v]);
                for &n in near[v] {
                    sum.iter_mut().zip(apply(&gconv.w1, &features[n])).for_each(|(s, x)| *s += x);
                }
                [relu(sum), at(v)].concat()
            };
            features = (0..4).map(next).collect();
        }
        for v in 0..4 {
            let expected = apply(&stage.vert_offset, &features[v]);
            for k in 0..3 {
                assert!((offset.value()[[0, v, k]] - expected[k].tanh()).abs() < 1e-12);
            }
            for k in 0..6 {
                assert!((hidden.value()[[0, v, k]] - features[v][k]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn names_and_sizes_as_published() {
        let head = MeshRefinementHead::<f32>::new(&Init::new(0), 3840, 128, 3, 3);
        let mut found = std::collections::BTreeMap::new();
        head.visit("", &mut |path: &str, p: &Param<f32>| {
            found.insert(path.to_owned(), p.shape().to_vec());
        });
        assert_eq!(found.len(), 3 * (2 + 2 + 3 * 4));
        for (name, shape) in [
            ("stages.0.bottleneck.weight", vec![128, 3840]),
            ("stages.0.gconvs.0.w0.weight", vec![128, 131]),
            ("stages.2.gconvs.0.w1.weight", vec![128, 259]),
            ("stages.2.gconvs.1.w1.bias", vec![128]),
            ("stages.1.vert_offset.weight", vec![3, 131]),
        ] {
            assert_eq!(found[name], shape, "{name}");
        }
    }

    #[test]
    fn a_new_stage_is_the_identity_and_learns() {
        let graph = graph();
        let stage = MeshRefinementStage::<f64>::new(&Init::new(0), 2, 0, 8, 3);
        let tape = Tape::<f64>::train(0);
        let map = tape.constant(ndarray::Array4::from_elem((1, 4, 4, 2), 0.5));
        let place =
            tape.constant(Array3::from_shape_fn((1, 4, 3), |(_, v, k)| 0.1 * (v + k) as f64));
        let (offset, _) = stage.forward(&[map], place, None, &graph);
        assert!(offset.value().iter().all(|&x| x == 0.0));
        let gradients = offset.sum().backward();
        let moved = gradients.of(&stage.vert_offset.weight).expect("a parameter in use");
        assert!(moved.iter().any(|g| g.abs() > 1e-3));
    }
}
