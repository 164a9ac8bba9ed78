//! From a feature map to the occupancy of cells.

use autodiff_lite::{Activation, ConvGeometry, Real, Var, impl_module};

use crate::{Conv2d, ConvTranspose2d, FanMode, Init, Nonlinearity};

/// Mesh R-CNN's voxel head: the coarsest feature map to `V³` logits, the steps in depth as channels.
///
/// ```text
/// resize to V/2 x V/2, bilinear                 I channels
/// conv 3x3, ReLU, `depth` times                 I -> hidden
/// transposed conv 2x2 stride 2, ReLU            V x V
/// conv 1x1                                      hidden -> V: the logit of cell z at [row, column, z]
/// ```
///
/// As published: 48 cells, 256 hidden channels, 4 convolutions. The logits' sigmoid is the probability that a
/// cell is inside. Names are those of the published code (`voxel_fcn1` .., `deconv`, `predictor`), and so are
/// the initial distributions (He's over the outputs; deviation 0.001 in the last layer, so that all begins
/// undecided).
///
/// ```
/// use autodiff_lite::Tape;
/// use nets::{Init, VoxelHead};
///
/// let head = VoxelHead::<f32>::new(&Init::new(0).at("voxel_head"), 64, 16, 4, 24);
/// let tape = Tape::eval();
/// let map = tape.constant(ndarray::Array4::zeros((2, 3, 5, 64)));
/// assert_eq!(head.forward(map).shape(), [2, 24, 24, 24]);
/// ```
///
/// # References
/// Gkioxari, Malik, Johnson 2019, *Mesh R-CNN*, section 3.1.
#[derive(Clone, Debug)]
pub struct VoxelHead<F: Real = f32> {
    /// The first layers, at half the size; `voxel_fcn1` and so on in files.
    pub voxel_fcns: Vec<Conv2d<F>>,
    /// To the full size.
    pub deconv: ConvTranspose2d<F>,
    /// To the logits.
    pub predictor: Conv2d<F>,
}

impl<F: Real> VoxelHead<F> {
    /// Of maps with `inputs` channels, through `depth` convolutions of `hidden` channels, to `cells³` logits.
    ///
    /// # Panics
    /// If the number of cells is odd or zero.
    pub fn new(init: &Init, inputs: usize, hidden: usize, depth: usize, cells: usize) -> Self {
        assert!(
            cells > 0 && cells.is_multiple_of(2),
            "VoxelHead: {cells} cells, expected an even number"
        );
        let same = ConvGeometry::new().padding(1);
        let layer = |k: usize| {
            let inputs = if k == 0 { inputs } else { hidden };
            Conv2d::kaiming(&init.at(&name(k)), inputs, hidden, 3, same)
        };
        let at = init.at("deconv");
        let shape = [if depth == 0 { inputs } else { hidden }, hidden, 2, 2];
        let deconv = ConvTranspose2d {
            weight: at.at("weight").kaiming_normal(&shape, FanMode::Out, Nonlinearity::Relu),
            bias: Some(at.at("bias").zeros(&[hidden])),
            geometry: ConvGeometry::new().stride(2),
            output_padding: 0,
        };
        let at = init.at("predictor");
        let predictor = Conv2d::normal(&at, hidden, cells, 1, 0.001, ConvGeometry::new());
        Self { voxel_fcns: (0..depth).map(layer).collect(), deconv, predictor }
    }

    /// The number of cells along each axis.
    pub fn cells(&self) -> usize {
        self.predictor.weight.shape()[0]
    }

    /// Logits of a grid of cells before the camera.
    ///
    /// # Shapes
    /// `map [N, H, W, I]` → `[N, V, V, V]`, `V` being [`cells`](Self::cells): row (downwards), column, step in depth.
    #[track_caller]
    pub fn forward<'t>(&self, map: Var<'t, F>) -> Var<'t, F> {
        let half = self.cells() / 2;
        let x = map.resize_bilinear(half, half, false);
        let relu = Activation::Relu;
        let x = self.voxel_fcns.iter().fold(x, |x, conv| conv.forward_then(x, relu));
        self.predictor.forward(self.deconv.forward_then(x, relu))
    }
}

/// The name of a convolution in files: they count from one.
pub(crate) fn name(k: usize) -> String {
    format!("voxel_fcn{}", k + 1)
}

impl_module!(VoxelHead lists { voxel_fcns: name } { deconv, predictor });

#[cfg(test)]
mod tests {
    use autodiff_lite::testkit::{Options, assert_gradients, function};
    use autodiff_lite::{Module, Tape};
    use ndarray::Array4;

    use super::*;
    use crate::testing::{parameter_gradients, randomize};

    #[test]
    fn names_and_sizes_as_published() {
        let head = VoxelHead::<f32>::new(&Init::new(0), 2048, 256, 4, 48);
        let mut found = Vec::new();
        head.visit("", &mut |path: &str, p: &autodiff_lite::Param<f32>| {
            found.push((path.to_owned(), p.shape().to_vec()));
        });
        let expected = [
            ("voxel_fcn1.weight", vec![256, 2048, 3, 3]),
            ("voxel_fcn1.bias", vec![256]),
            ("voxel_fcn2.weight", vec![256, 256, 3, 3]),
            ("voxel_fcn2.bias", vec![256]),
            ("voxel_fcn3.weight", vec![256, 256, 3, 3]),
            ("voxel_fcn3.bias", vec![256]),
            ("voxel_fcn4.weight", vec![256, 256, 3, 3]),
            ("voxel_fcn4.bias", vec![256]),
            ("deconv.weight", vec![256, 256, 2, 2]),
            ("deconv.bias", vec![256]),
            ("predictor.weight", vec![48, 256, 1, 1]),
            ("predictor.bias", vec![48]),
        ];
        assert_eq!(found, expected.map(|(name, shape)| (name.to_owned(), shape)));
        let mut head = head;
        let mut again = Vec::new();
        head.visit_mut("", &mut |path: &str, _: &mut autodiff_lite::Param<f32>| {
            again.push(path.to_owned());
        });
        assert!(again.iter().eq(found.iter().map(|(path, _)| path)));
    }

    #[test]
    fn gradients() {
        let mut head = VoxelHead::<f64>::new(&Init::new(3), 3, 4, 2, 4);
        randomize(&mut head);
        // Rectifiers have kinks, wherever the sums happen to pass zero.
        let options = Options::default().pieces();
        let forward = function(|x| head.forward(x[0]));
        assert_gradients(&forward, &[vec![2, 3, 2, 3]], &options);
        let x = options.draw(&[vec![2, 3, 2, 3]]).remove(0);
        parameter_gradients(&head, |head, tape| head.forward(tape.constant(x.clone())));
    }

    /// Nothing is decided at first, and a bright corner stays in its corner.
    #[test]
    fn cells_are_where_the_pixels_are() {
        let mut head = VoxelHead::<f32>::new(&Init::new(1), 1, 8, 0, 4);
        let tape = Tape::eval();
        let lit = Array4::from_shape_fn((1, 2, 2, 1), |(_, i, j, _)| {
            f32::from(u8::from(i == 0 && j == 1))
        });
        let lit = tape.constant(lit);
        let first = head.forward(lit).value();
        assert!(first.iter().all(|x| x.abs() < 0.05));
        head.deconv.weight = Init::new(0).ones(&[1, 8, 2, 2]);
        head.predictor.weight = Init::new(0).ones(&[4, 8, 1, 1]);
        let found = head.forward(lit).value();
        for (i, j, z) in
            (0..4).flat_map(|i| (0..4).flat_map(move |j| (0..4).map(move |z| (i, j, z))))
        {
            let expected = if i < 2 && j >= 2 { 8.0 } else { 0.0 };
            assert_eq!(found[[0, i, j, z]], expected, "row {i}, column {j}, step {z}");
        }
    }
}
