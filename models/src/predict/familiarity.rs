//! How far what a prediction was made from is from what the system was trained on.
//!
//! A [`Familiarity`] is learned of the features of training objects, which a network's encoder gives, once the training is over. It
//! knows the mean of each family and how features spread within it and among families. The distance of an image is the relative
//! Mahalanobis distance of Ren et al. 2021, *A Simple Fix to Mahalanobis Distance for Improving Near-OOD Detection* (arXiv
//! 2106.09022): the squared Mahalanobis distance to the nearest family (Lee et al. 2018, arXiv 1807.03888), less that to all families
//! as one. What is unusual of every family alike, another texture or another light, is in both and falls out, but for what is like
//! nothing at all; the rest may be below 0. Of one family only there is nothing to be relative to, and it is the former alone.
//!
//! There all families spread alike. Here each has a covariance of its own, drawn towards that within all families and towards a
//! ball's, as in Friedman 1989, *Regularized Discriminant Analysis*: chairs differ more among each other than buses do, and what is
//! as far from a bus as chairs are from each other is no bus. The logarithm of the determinant, which would make a density of it,
//! is left out, for with it a wide family is far from everything.
//!
//! A distance by itself says nothing: it is judged by those of the objects for validation.

use autodiff_lite::state::State;
use mesh_core::nalgebra::{DMatrix, DVector, SymmetricEigen};
use train::{Checkpoint, CheckpointError, DataError, Subset};

use super::judgement::Judgement;
use super::predictor::Predictor;
use super::sighting::{Features, Sighting};

/// Directions that are kept at most: those in which training objects differ the most.
const MOST_AXES: usize = 64;
/// Training objects that a direction takes at least: of fewer its spread is chance.
const OBJECTS_AN_AXIS: usize = 4;
/// Objects that are looked at: a covariance for each of nine families takes as many.
const MOST_OBJECTS: usize = 2000;
/// The share of a family's covariance that is of that within all families.
const SHARED: f64 = 0.75;
/// What all covariances are drawn towards that of a ball: by so much.
const SHRINKAGE: f64 = 0.1;
/// Features that an encoder gives at most: of more the eigenvectors take minutes, and the axes a file's worth.
const MOST_FEATURES: usize = 1024;
/// How much of the distance to all families as one falls out at most, for each axis: objects that were trained on have 1 in the
/// mean. Without an end noise would be like anything.
const FORGIVEN: f64 = 2.0;
/// Deviations that are taken for none.
const CONSTANT: f64 = 1e-6;

/// The names of its arrays.
const AXES: &str = "familiarity.axes";
const MIDDLE: &str = "familiarity.middle";
const WHITENINGS: &str = "familiarity.whitenings";
const FAMILIES: &str = "familiarity.families";
const DISTANCES: &str = "familiarity.distances";

/// What training objects look like to a network, and how far from that others are: the relative Mahalanobis distance of Ren et al.
/// 2021 (arXiv 2106.09022), judged by those of objects for validation.
///
/// Its `K` axes are turned and scaled such that features of all training objects have the covariance 1 along them.
#[derive(Clone, Debug, PartialEq)]
pub struct Familiarity {
    /// `[K, D]` of `D` features.
    axes: DMatrix<f32>,
    /// Where the features' mean is along the axes: `[K]`.
    middle: DVector<f32>,
    /// Means of families: `[C, K]`.
    families: DMatrix<f32>,
    /// What gives each of them the covariance 1: lower triangles, `[C, K, K]`.
    whitenings: Vec<DMatrix<f32>>,
    /// Distances of objects for validation, least first.
    distances: Vec<f32>,
}

impl Familiarity {
    /// Learned from the data of a training: of at most 2000 objects that were trained on, and all for validation. Nothing where
    /// the system has no features, or the data too few objects.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn of_data<S: Predictor>(system: &S, data: &S::Data) -> Result<Option<Self>, DataError> {
        let trained = system.features_of(data, Subset::Train, MOST_OBJECTS)?;
        let validation = system.features_of(data, Subset::Validation, MOST_OBJECTS)?;
        Ok(Self::learn(&trained, &validation))
    }

    /// Learned from objects that were trained on, and the measure of others by objects for validation; nothing where there are too
    /// few of them, their features do not differ or are not finite.
    ///
    /// Cost: that of the eigenvectors of `D x D` numbers, of `D` features.
    pub fn learn(trained: &[Sighting], validation: &[Sighting]) -> Option<Self> {
        let mut names: Vec<&str> = trained.iter().map(|object| object.family.as_str()).collect();
        names.sort_unstable();
        names.dedup();
        let images = trained.iter().flat_map(|object| {
            let family = names.binary_search(&object.family.as_str()).unwrap_or_default();
            object.features.iter().map(move |image| (family, image.as_slice()))
        });
        let images: Vec<(usize, &[f32])> = images.collect();
        let width = images.first()?.1.len();
        let count = width.min(MOST_AXES).min(trained.len() / OBJECTS_AN_AXIS);
        let all = trained.iter().chain(validation).flat_map(|object| &object.features);
        let mut sound =
            all.map(|image| image.len() == width && image.iter().all(|x| x.is_finite()));
        if count == 0 || width > MOST_FEATURES || validation.is_empty() || !sound.all(|sound| sound)
        {
            return None;
        }
        let mut familiarity = Self::axes_of(&images, (width, count), names.len())?;
        let distances =
            validation.iter().map(|object| familiarity.distance(&object.features) as f32);
        familiarity.distances = distances.collect();
        familiarity.distances.sort_by(f32::total_cmp);
        familiarity.is_finite().then_some(familiarity)
    }

    /// Of images with the numbers of their families; without distances.
    fn axes_of(
        images: &[(usize, &[f32])],
        (width, count): (usize, usize),
        families: usize,
    ) -> Option<Self> {
        let mut values = DMatrix::from_fn(images.len(), width, |i, j| f64::from(images[i].1[j]));
        let mean = values.row_mean();
        values.row_iter_mut().for_each(|mut row| row -= &mean);
        let scales: Vec<f64> =
            values.column_iter().map(|x| 1.0 / (x.variance().sqrt() + CONSTANT)).collect();
        values.column_iter_mut().zip(&scales).for_each(|(mut column, &scale)| column *= scale);
        let principal = SymmetricEigen::new(covariance(&values));
        let mut order: Vec<usize> = (0..width).collect();
        order.sort_by(|&a, &b| principal.eigenvalues[b].total_cmp(&principal.eigenvalues[a]));
        let directions = principal.eigenvectors.select_columns(&order[..count]);
        let places = values * &directions;
        let (means, deviations) = parted(&places, images, families);
        let total = SymmetricEigen::new(shrunk(covariance(&places)));
        if total.eigenvalues.min() <= 0.0 {
            return None;
        }
        let scaled = DMatrix::from_diagonal(&total.eigenvalues.map(|x| x.sqrt().recip()));
        let whiten = total.eigenvectors * scaled;
        let whitenings = whitenings(&(deviations * &whiten), images, families)?;
        let mut axes = (directions * &whiten).transpose();
        axes.column_iter_mut().zip(&scales).for_each(|(mut column, &scale)| column *= scale);
        Some(Self {
            middle: (&axes * mean.transpose()).cast(),
            axes: axes.cast(),
            families: (means * whiten).cast(),
            whitenings,
            distances: Vec::new(),
        })
    }

    /// How far an object is whose images have these features.
    ///
    /// # Errors
    /// If there are none, or as many numbers in one of them as the network's encoder does not give.
    pub fn judge(&self, features: &Features) -> Result<Judgement, DataError> {
        let expected = self.axes.ncols();
        let wrong = features.iter().map(Vec::len).find(|&found| found != expected);
        if let Some(found) = wrong.or_else(|| features.is_empty().then_some(0)) {
            return Err(DataError::Unfit(format!(
                "the weights' familiarity is of {expected} features, and the network has {found}"
            )));
        }
        let (distance, of) = (self.distance(features), self.distances.len());
        // A distance that is no number is as far as can be.
        let far = |&&other: &&f32| f64::from(other) >= distance;
        let farther = self.distances.iter().filter(far).count();
        Ok(Judgement { distance, quantile: (of - farther) as f64 / of as f64, of })
    }

    /// A mean over images; all of one family, which is that of the object.
    fn distance(&self, features: &Features) -> f64 {
        let mut sums = vec![0.0; self.families.nrows()];
        for image in features {
            let place = &self.axes * DVector::from_column_slice(image) - &self.middle;
            let all = f64::from(place.norm_squared()).min(FORGIVEN * place.len() as f64);
            let all = if sums.len() > 1 { all } else { 0.0 };
            let families = self.families.row_iter().zip(&self.whitenings);
            for (sum, (mean, whitening)) in sums.iter_mut().zip(families) {
                let own = whitening * (&place - mean.transpose());
                *sum += f64::from(own.norm_squared()) - all;
            }
        }
        sums.into_iter().reduce(f64::min).unwrap_or(f64::NAN) / features.len() as f64
    }

    /// As arrays that stand [beside](Checkpoint::weights_beside) the weights.
    pub fn to_state(&self) -> State {
        let (k, d) = self.axes.shape();
        let mut state = State::new();
        state.insert(AXES, &[k, d], self.axes.transpose().as_slice());
        state.insert(MIDDLE, &[k], self.middle.as_slice());
        let families = self.families.transpose();
        state.insert(FAMILIES, &[families.ncols(), k], families.as_slice());
        let rows = |whitening: &DMatrix<f32>| whitening.transpose().as_slice().to_vec();
        let rows: Vec<f32> = self.whitenings.iter().flat_map(rows).collect();
        state.insert(WHITENINGS, &[families.ncols(), k, k], &rows);
        state.insert(DISTANCES, &[self.distances.len()], &self.distances);
        state
    }

    /// What a checkpoint's file says; nothing where it has none, as before the weights were exported.
    ///
    /// # Errors
    /// If it says what cannot be.
    pub fn of(checkpoint: &Checkpoint<'_>) -> Result<Option<Self>, CheckpointError> {
        let names = [AXES, MIDDLE, FAMILIES, WHITENINGS, DISTANCES];
        let arrays = names.map(|name| checkpoint.beside(name));
        if arrays.iter().all(Option::is_none) {
            return Ok(None);
        }
        let [Some(axes), Some(middle), Some(families), Some(whitenings), Some(distances)] = arrays
        else {
            let expected = format!(
                "all of {}: an earlier version wrote it, export the run again (`unsphere export`)",
                names.join(", ")
            );
            return Err(checkpoint.wrong("familiarity", "incomplete", &expected));
        };
        let shapes = [&axes, &middle, &families, &whitenings, &distances];
        let shapes = shapes.map(|array| array.shape().to_vec());
        let &[[rows, d], [k], [c, columns], [several, height, width], [q]] =
            &shapes.each_ref().map(Vec::as_slice)
        else {
            let expected = "shapes [K, D], [K], [C, K], [C, K, K], [N]";
            return Err(checkpoint.wrong("familiarity", &format!("{shapes:?}"), expected));
        };
        if [rows, columns, height, width] != [k; 4] || several != c || [k, d, c, q].contains(&&0) {
            let expected = "shapes [K, D], [K], [C, K], [C, K, K], [N], none of them empty";
            return Err(checkpoint.wrong("familiarity", &format!("{shapes:?}"), expected));
        }
        let (&k, &d, &c) = (k, d, c);
        let square = |rows: &[f32]| DMatrix::from_row_slice(k, k, rows);
        let found = Self {
            axes: DMatrix::from_row_slice(k, d, axes.as_slice()),
            middle: DVector::from_column_slice(middle.as_slice()),
            families: DMatrix::from_row_slice(c, k, families.as_slice()),
            whitenings: whitenings.as_slice().chunks(k * k).map(square).collect(),
            distances: distances.as_slice().to_vec(),
        };
        if found.is_finite() {
            return Ok(Some(found));
        }
        let expected = "finite numbers, diagonals above 0 and distances in order";
        Err(checkpoint.wrong("familiarity", "out of range", expected))
    }

    fn is_finite(&self) -> bool {
        let numbers = self.axes.iter().chain(&self.middle).chain(&self.families);
        let mut numbers = numbers.chain(self.whitenings.iter().flatten()).chain(&self.distances);
        numbers.all(|x| x.is_finite())
            && self.whitenings.iter().all(|whitening| whitening.diagonal().min() > 0.0)
            && self.distances.is_sorted()
    }
}

/// Of rows whose mean is 0.
fn covariance(rows: &DMatrix<f64>) -> DMatrix<f64> {
    rows.tr_mul(rows) / rows.nrows() as f64
}

/// Drawn towards a ball's of the same trace.
fn shrunk(covariance: DMatrix<f64>) -> DMatrix<f64> {
    let ball = SHRINKAGE * covariance.trace() / covariance.nrows() as f64;
    let (rows, columns) = covariance.shape();
    covariance * (1.0 - SHRINKAGE) + DMatrix::from_diagonal_element(rows, columns, ball)
}

/// What gives rows of each family the covariance 1, where rows are what they differ from their family's mean.
fn whitenings(
    rows: &DMatrix<f64>,
    images: &[(usize, &[f32])],
    families: usize,
) -> Option<Vec<DMatrix<f32>>> {
    let shared = covariance(rows) * SHARED;
    let whitening = |family: usize| {
        let own: Vec<usize> = (0..images.len()).filter(|&k| images[k].0 == family).collect();
        let own = covariance(&rows.select_rows(&own)) * (1.0 - SHARED);
        let triangle = shrunk(own + &shared).cholesky()?.unpack();
        let identity = DMatrix::identity(triangle.nrows(), triangle.ncols());
        Some(triangle.solve_lower_triangular(&identity)?.cast())
    };
    (0..families).map(whitening).collect()
}

/// The means of families, and what each row differs from its own.
fn parted(
    rows: &DMatrix<f64>,
    images: &[(usize, &[f32])],
    families: usize,
) -> (DMatrix<f64>, DMatrix<f64>) {
    let mut means = DMatrix::zeros(families, rows.ncols());
    let mut counts = vec![0.0; families];
    for (row, &(family, _)) in rows.row_iter().zip(images) {
        let mut mean = means.row_mut(family);
        mean += row;
        counts[family] += 1.0;
    }
    means.row_iter_mut().zip(&counts).for_each(|(mut mean, &count)| mean /= count);
    let mut deviations = rows.clone();
    for (mut row, &(family, _)) in deviations.row_iter_mut().zip(images) {
        row -= means.row(family);
    }
    (means, deviations)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use std::path::Path;

    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    const WIDTH: usize = 12;

    /// About normal.
    fn drawn(rng: &mut ChaCha8Rng) -> f32 {
        (0..12).map(|_| rng.random::<f32>()).sum::<f32>() - 6.0
    }

    /// Objects of families whose means are 4 along an axis of their own, each of two images.
    fn objects(families: usize, count: usize, seed: u64) -> Vec<Sighting> {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let object = |k: usize| {
            let family = k % families;
            let image = |_| {
                let mut image: Vec<f32> = (0..WIDTH).map(|_| drawn(&mut rng)).collect();
                image[family] += 4.0;
                // One that never differs, as filters that answer nothing.
                image.push(0.0);
                image
            };
            Sighting { family: format!("family {family}"), features: (0..2).map(image).collect() }
        };
        (0..count).map(object).collect::<Vec<_>>()
    }

    fn learned(families: usize) -> Familiarity {
        Familiarity::learn(&objects(families, 120, 1), &objects(families, 40, 2)).unwrap()
    }

    /// Bytes of a checkpoint without parameters, with these arrays beside them.
    fn file(beside: &State) -> Vec<u8> {
        let mut state = State::new();
        state.metadata.insert("format".to_owned(), "1".to_owned());
        let bytes = state.to_bytes();
        Checkpoint::from_bytes(Path::new("bare"), &bytes).unwrap().weights_beside("", beside)
    }

    fn read(bytes: &[u8]) -> Result<Option<Familiarity>, CheckpointError> {
        Familiarity::of(&Checkpoint::from_bytes(Path::new("a.safetensors"), bytes)?)
    }

    fn shifted(features: &Features, by: f32) -> Features {
        features.iter().map(|image| image.iter().map(|x| x + by).collect()).collect()
    }

    #[test]
    fn it_is_read_as_it_was_written() {
        let familiarity = learned(3);
        assert_eq!(read(&file(&familiarity.to_state())).unwrap(), Some(familiarity));
        assert_eq!(read(&file(&State::new())).unwrap(), None);
    }

    #[test]
    fn what_cannot_be_is_an_error() {
        let sound = learned(3).to_state();
        let refused = |state: &State, expected: &str| {
            let error = read(&file(state)).unwrap_err().to_string();
            assert!(error.contains("`familiarity`") && error.contains(expected), "{error}");
        };
        let with = |name: &str, shape: &[usize], numbers: &[f32]| {
            let mut state = sound.clone();
            state.insert(name, shape, numbers);
            state
        };
        let k = sound.array::<f32>(MIDDLE).unwrap().len();
        for name in [AXES, MIDDLE, FAMILIES, WHITENINGS, DISTANCES] {
            let array = sound.array::<f32>(name).unwrap();
            let mut numbers = array.as_slice().to_vec();
            numbers[0] = f32::NAN;
            refused(&with(name, array.shape(), &numbers), "finite");
            refused(&with(name, &[0], &[]), "shapes");
            refused(&with(name, &[1, 1, 1], &[0.0]), "shapes");
        }
        refused(&with(AXES, &[k, 0], &[]), "shapes");
        refused(&with(FAMILIES, &[1, k + 1], &vec![0.0; k + 1]), "shapes");
        refused(&with(WHITENINGS, &[3, k, k + 1], &vec![0.0; 3 * k * (k + 1)]), "shapes");
        refused(&with(WHITENINGS, &[3, k, k], &vec![0.0; 3 * k * k]), "diagonals above 0");
        refused(&with(DISTANCES, &[2], &[1.0, 0.0]), "in order");
        let mut alone = State::new();
        alone.insert(AXES, &[1, 1], &[1.0_f32]);
        refused(&alone, "all of");
        // Any byte that is another one is damage, or no file.
        let bytes = file(&sound);
        for at in (0..bytes.len()).step_by(97) {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0x5a;
            assert!(read(&damaged).is_err(), "byte {at}");
        }
    }

    #[test]
    fn what_was_trained_on_is_near_and_what_is_nowhere_is_far() {
        for families in [1, 3] {
            let familiarity = learned(families);
            let judge = |features: &Features| familiarity.judge(features).unwrap();
            let trained = objects(families, 120, 1);
            let beyond = trained.iter().filter(|object| judge(&object.features).is_strange());
            assert!(beyond.count() <= 6, "{families}");
            let far = judge(&shifted(&trained[0].features, 40.0));
            assert_eq!((far.quantile, far.of), (1.0, 40));
            assert!(far.warning().is_some_and(|text| text.contains("all 40 objects")));
            assert!(far.to_string().starts_with("unlike"), "{far}");
            let middle = trained.iter().map(|object| judge(&object.features).quantile);
            let middle = middle.sum::<f64>() / trained.len() as f64;
            assert!(middle > 0.3 && middle < 0.6, "{families}: {middle}");
            // What is no number is as far as can be.
            assert!(judge(&vec![vec![f32::NAN; WIDTH + 1]]).is_strange());
        }
    }

    /// Another family is far, though it lies among the others; what every family differs by is not.
    #[test]
    fn it_is_relative_to_what_all_families_share() {
        let mut trained = objects(3, 120, 1);
        let validation = objects(3, 40, 2);
        for (k, object) in trained.iter_mut().enumerate() {
            // A texture: as wide within families as among all.
            object.features.iter_mut().for_each(|image| image[8] *= 1.0 + 4.0 * (k % 2) as f32);
        }
        let familiarity = Familiarity::learn(&trained, &validation).unwrap();
        let image = |at: usize, by: f32| {
            let mut image = vec![0.0; WIDTH + 1];
            image[0] = 4.0;
            image[at] += by;
            familiarity.judge(&vec![image]).unwrap()
        };
        // What is like nothing at all is not like this.
        assert!(image(8, 300.0).is_strange());
        let (own, textured, other) = (image(8, 0.0), image(8, 6.0), image(0, -4.0));
        assert!((textured.distance - own.distance).abs() < 0.2 * (other.distance - own.distance));
        assert!(other.quantile > 0.9 && own.quantile < 0.5, "{other:?} {own:?}");
    }

    /// What a wide family has within it is no part of a narrow one.
    #[test]
    fn each_family_has_a_spread_of_its_own() {
        let (mut trained, validation) = (objects(2, 240, 1), objects(2, 40, 2));
        for object in trained.iter_mut().filter(|object| object.family == "family 1") {
            object.features.iter_mut().for_each(|image| image[8] *= 4.0);
        }
        let familiarity = Familiarity::learn(&trained, &validation).unwrap();
        let off = |family: usize| {
            let mut image = vec![0.0; WIDTH + 1];
            image[family] = 4.0;
            let own = familiarity.judge(&vec![image.clone()]).unwrap().distance;
            image[8] = 6.0;
            familiarity.judge(&vec![image]).unwrap().distance - own
        };
        assert!(off(0) > off(1) + 1.0, "narrow {}, wide {}", off(0), off(1));
    }

    #[test]
    fn what_is_too_little_teaches_nothing() {
        let (trained, validation) = (objects(3, 120, 1), objects(3, 40, 2));
        assert_eq!(Familiarity::learn(&trained, &[]), None);
        assert_eq!(Familiarity::learn(&trained[..3], &validation), None);
        assert_eq!(Familiarity::learn(&[], &validation), None);
        let even = vec![Sighting { features: vec![vec![1.0; 4]], ..Sighting::default() }; 40];
        assert_eq!(Familiarity::learn(&even, &even), None);
        let mut short = trained.clone();
        short[7].features[1].pop();
        assert_eq!(Familiarity::learn(&short, &validation), None);
        let error = learned(3).judge(&vec![vec![0.0; 4]]).unwrap_err().to_string();
        assert!(error.contains("13 features") && error.contains("has 4"), "{error}");
        assert!(learned(3).judge(&Features::new()).is_err());
    }
}
