//! Inception v3 up to its pooled features.

mod mixed;

use autodiff_lite::{PoolGeometry, Real, Var, impl_module};

pub use mixed::{Branch, ConvNormRelu, Mixed, MixedPool};
use mixed::{half, one, same};

use crate::Init;

/// Which of the two networks that are called Inception v3.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum InceptionKind {
    /// The one that Fréchet distances are measured with (the TensorFlow model of 2015-12-05, in
    /// PyTorch's ports): means leave padding out, and the last block takes maxima.
    #[default]
    Fid,
    /// torchvision's: means count padding as zeros, in the last block too.
    Torchvision,
}

/// Inception v3 from images to the 2048 features before the classifier (`pool3`); names as in
/// torchvision's `inception_v3`, which the files for the FID share.
///
/// ```text
/// Conv2d_1a_3x3 /2   2a_3x3   2b_3x3   max pool 3x3 /2    3b_1x1   4a_3x3   max pool 3x3 /2      299 -> 35
/// Mixed_5b 5c 5d     6a /2   6b 6c 6d 6e   7a /2   7b 7c   mean over all pixels                   35, 17, 8
/// ```
///
/// Norms are frozen: this network measures and is not trained. Load a file with
/// [`LoadWeights::partial`](crate::LoadWeights::partial), since it has a classifier as well. Without
/// the weights that the Fréchet distance is defined by, the features mean nothing.
///
/// ```
/// use autodiff_lite::Tape;
/// use nets::{InceptionKind, InceptionV3, Init};
///
/// let net = InceptionV3::<f32>::new(&Init::new(0), InceptionKind::Fid);
/// let tape = Tape::eval();
/// let images = tape.constant(ndarray::Array4::zeros((1, 75, 75, 3)));
/// assert_eq!(net.forward_features(images).shape(), [1, 2048]);
/// ```
///
/// # References
/// Szegedy et al. 2016, *Rethinking the Inception architecture for computer vision*; Heusel et al. 2017,
/// *GANs trained by a two time-scale update rule converge to a local Nash equilibrium* (the distance).
#[derive(Clone, Debug)]
pub struct InceptionV3<F: Real = f32> {
    /// `Conv2d_1a_3x3`, `Conv2d_2a_3x3`, `Conv2d_2b_3x3`, `Conv2d_3b_1x1`, `Conv2d_4a_3x3`.
    pub stem: Vec<ConvNormRelu<F>>,
    /// `Mixed_5b` to `Mixed_7c`.
    pub mixed: Vec<Mixed<F>>,
}

const STEM: [&str; 5] =
    ["Conv2d_1a_3x3", "Conv2d_2a_3x3", "Conv2d_2b_3x3", "Conv2d_3b_1x1", "Conv2d_4a_3x3"];
const MIXED: [&str; 11] = [
    "Mixed_5b", "Mixed_5c", "Mixed_5d", "Mixed_6a", "Mixed_6b", "Mixed_6c", "Mixed_6d", "Mixed_6e",
    "Mixed_7a", "Mixed_7b", "Mixed_7c",
];

impl_module!(InceptionV3 lists { stem: |i: usize| STEM[i], mixed: |i: usize| MIXED[i] } {});

impl<F: Real> InceptionV3<F> {
    /// Rows and columns that images have in the definition of the Fréchet distance.
    pub const SIDE: usize = 299;

    /// With random weights, to be loaded; 22 million.
    pub fn new(init: &Init, kind: InceptionKind) -> Self {
        let stem = [
            (3, half(STEM[0], 32)),
            (32, (STEM[1], 32, [3, 3], 1, [0, 0])),
            (32, same(STEM[2], 64, [3, 3])),
            (64, one(STEM[3], 80)),
            (80, (STEM[4], 192, [3, 3], 1, [0, 0])),
        ];
        let stem = stem.map(|(inputs, l)| ConvNormRelu::new(&init.at(l.0), inputs, l)).into();
        let (mean, last) = match kind {
            InceptionKind::Fid => (MixedPool::MeanInside, MixedPool::Max),
            InceptionKind::Torchvision => (MixedPool::Mean, MixedPool::Mean),
        };
        let mut inputs = 192;
        let mut mixed: Vec<Mixed<F>> = Vec::new();
        for (i, name) in MIXED.into_iter().enumerate() {
            let at = init.at(name);
            let block = match i {
                0 => grid35(&at, inputs, mean, 32),
                1 | 2 => grid35(&at, inputs, mean, 64),
                3 => to_grid17(&at, inputs),
                4..8 => grid17(&at, inputs, mean, [128, 160, 160, 192][i - 4]),
                8 => to_grid8(&at, inputs),
                9 => grid8(&at, inputs, mean),
                _ => grid8(&at, inputs, last),
            };
            inputs = block.outputs(inputs);
            mixed.push(block);
        }
        Self { stem, mixed }
    }

    /// Features of images that have the range and size which the network takes.
    ///
    /// # Shapes
    /// `images [N, H, W, 3]` in `[-1, 1]`, at least 75 x 75 → `[N, 2048]`.
    ///
    /// # Panics
    /// If the images are smaller.
    #[track_caller]
    pub fn forward_features<'t>(&self, images: Var<'t, F>) -> Var<'t, F> {
        let pool = PoolGeometry::square(3).stride(2);
        let run = |x, layers: &[ConvNormRelu<F>]| layers.iter().fold(x, |x, l| l.forward(x));
        let x = run(images, &self.stem[..3]).max_pool2d(pool);
        let x = run(x, &self.stem[3..]).max_pool2d(pool);
        let x = self.mixed.iter().fold(x, |x, block| block.forward(x));
        let [n, _, _, c] = x.dims();
        x.adaptive_avg_pool2d(1, 1).reshape(&[n, c])
    }

    /// Features of images as the distance is defined in PyTorch's port: resized to 299 x 299 (bilinear, corners not
    /// aligned), then `2 x - 1`.
    ///
    /// # Shapes
    /// `images [N, H, W, 3]` in `[0, 1]`, of any size → `[N, 2048]`.
    #[track_caller]
    pub fn forward<'t>(&self, images: Var<'t, F>) -> Var<'t, F> {
        let two = F::from_f64(2.0);
        let x = images.resize_bilinear(Self::SIDE, Self::SIDE, false);
        self.forward_features(x.scale(two).add_scalar(-F::one()))
    }
}

/// `InceptionA`, on 35 x 35.
fn grid35<F: Real>(init: &Init, inputs: usize, pool: MixedPool, pooled: usize) -> Mixed<F> {
    let branches: [(&[_], &[_]); 3] = [
        (&[one("branch1x1", 64)], &[]),
        (&[one("branch5x5_1", 48), same("branch5x5_2", 64, [5, 5])], &[]),
        (
            &[
                one("branch3x3dbl_1", 64),
                same("branch3x3dbl_2", 96, [3, 3]),
                same("branch3x3dbl_3", 96, [3, 3]),
            ],
            &[],
        ),
    ];
    Mixed::new(init, inputs, &branches, pool, Some(pooled))
}

/// `InceptionB`, from 35 x 35 to 17 x 17.
fn to_grid17<F: Real>(init: &Init, inputs: usize) -> Mixed<F> {
    let branches: [(&[_], &[_]); 2] = [
        (&[half("branch3x3", 384)], &[]),
        (
            &[
                one("branch3x3dbl_1", 64),
                same("branch3x3dbl_2", 96, [3, 3]),
                half("branch3x3dbl_3", 96),
            ],
            &[],
        ),
    ];
    Mixed::new(init, inputs, &branches, MixedPool::HalvingMax, None)
}

/// `InceptionC`, on 17 x 17.
fn grid17<F: Real>(init: &Init, inputs: usize, pool: MixedPool, width: usize) -> Mixed<F> {
    let (row, column) = ([1, 7], [7, 1]);
    let branches: [(&[_], &[_]); 3] = [
        (&[one("branch1x1", 192)], &[]),
        (
            &[
                one("branch7x7_1", width),
                same("branch7x7_2", width, row),
                same("branch7x7_3", 192, column),
            ],
            &[],
        ),
        (
            &[
                one("branch7x7dbl_1", width),
                same("branch7x7dbl_2", width, column),
                same("branch7x7dbl_3", width, row),
                same("branch7x7dbl_4", width, column),
                same("branch7x7dbl_5", 192, row),
            ],
            &[],
        ),
    ];
    Mixed::new(init, inputs, &branches, pool, Some(192))
}

/// `InceptionD`, from 17 x 17 to 8 x 8.
fn to_grid8<F: Real>(init: &Init, inputs: usize) -> Mixed<F> {
    let branches: [(&[_], &[_]); 2] = [
        (&[one("branch3x3_1", 192), half("branch3x3_2", 320)], &[]),
        (
            &[
                one("branch7x7x3_1", 192),
                same("branch7x7x3_2", 192, [1, 7]),
                same("branch7x7x3_3", 192, [7, 1]),
                half("branch7x7x3_4", 192),
            ],
            &[],
        ),
    ];
    Mixed::new(init, inputs, &branches, MixedPool::HalvingMax, None)
}

/// `InceptionE`, on 8 x 8.
fn grid8<F: Real>(init: &Init, inputs: usize, pool: MixedPool) -> Mixed<F> {
    let (row, column) = ([1, 3], [3, 1]);
    let branches: [(&[_], &[_]); 3] = [
        (&[one("branch1x1", 320)], &[]),
        (
            &[one("branch3x3_1", 384)],
            &[same("branch3x3_2a", 384, row), same("branch3x3_2b", 384, column)],
        ),
        (
            &[one("branch3x3dbl_1", 448), same("branch3x3dbl_2", 384, [3, 3])],
            &[same("branch3x3dbl_3a", 384, row), same("branch3x3dbl_3b", 384, column)],
        ),
    ];
    Mixed::new(init, inputs, &branches, pool, Some(192))
}
