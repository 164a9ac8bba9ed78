//! Saving and loading: one safetensors file for parameters, buffers and optimiser moments.
//!
//! Names are module paths, which are PyTorch's when fields are named alike; layouts are PyTorch's
//! too (linear weights `[out, in]`, convolution weights `[O, I, KH, KW]`), because parameters are
//! kept in that master layout and kernels pack them. Files are behind the feature `files`. Moments stand under `optim.m.<path>` and
//! `optim.v.<path>`, the number of updates of a parameter under `optim.t.<path>`.
//!
//! ```
//! use autodiff_lite::Param;
//! use autodiff_lite::state::{load, save};
//!
//! let folder = tempfile::tempdir()?;
//! let path = folder.path().join("model.safetensors");
//! let model = (Param::<f32>::new(ndarray::arr1(&[1.0, 2.0])), Param::<f32>::new(ndarray::arr0(3.0)));
//! save(&path, &model)?;
//! let mut other = (Param::new(ndarray::arr1(&[0.0, 0.0])), Param::new(ndarray::arr0(0.0)));
//! load(&path, &mut other)?;
//! assert_eq!(other.0.value, model.0.value);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod error;
mod half;
#[cfg(feature = "files")]
mod read;
#[cfg(feature = "files")]
mod write;

use std::collections::BTreeMap;
#[cfg(feature = "files")]
use std::path::Path;

use crate::optim::{self, Method, Optimizer};
use crate::param::Shared;
use crate::{Module, Param, Real, Tensor};

pub use error::{LoadError, Mismatch, SaveError};
pub use half::{from_bfloat, from_half, to_half};

/// Names that begin so belong to optimisers.
const OPTIMIZER: &str = "optim.";
/// The moments of all methods here: a file with others than a method has is another method's.
const MOMENTS: [&str; 3] = ["m", "v", "a"];

/// Named arrays and a few words about them: the content of one file.
///
/// Collect with [`add_module`](Self::add_module) and [`add_optimizer`](Self::add_optimizer), then
/// [`write`](Self::write); or [`read`](Self::read), then [`load_module`](Self::load_module) and
/// [`load_optimizer`](Self::load_optimizer).
#[derive(Clone, Debug, Default, PartialEq)]
pub struct State {
    arrays: BTreeMap<String, Stored>,
    /// Free text about the file: step number, configuration, commit.
    pub metadata: BTreeMap<String, String>,
}

/// One array as it stands in the file.
#[derive(Clone, Debug, PartialEq)]
struct Stored {
    shape: Vec<usize>,
    numbers: Numbers,
}

#[derive(Clone, Debug, PartialEq)]
enum Numbers {
    /// IEEE half precision, as it is written; what is read is single.
    Halves(Vec<[u8; 2]>),
    Singles(Vec<f32>),
    Doubles(Vec<f64>),
    Counts(Vec<u64>),
    /// A type that nothing here is made of; kept by name so that it can be reported.
    Other(String),
}

impl Numbers {
    fn of<F: Real>(x: &[F]) -> Self {
        match F::as_f32(x) {
            Some(x) => Self::Singles(x.to_vec()),
            None => Self::Doubles(x.iter().map(|&x| x.to_f64()).collect()),
        }
    }

    fn type_name(&self) -> &str {
        match self {
            Self::Halves(_) => "F16",
            Self::Singles(_) => "F32",
            Self::Doubles(_) => "F64",
            Self::Counts(_) => "U64",
            Self::Other(name) => name,
        }
    }

    /// Copies into `target`, converting between single and double precision. The caller compared
    /// lengths and types.
    fn copy_to<F: Real>(&self, target: &mut [F]) {
        match self {
            Self::Halves(x) => {
                let singles = x.iter().map(|&x| f64::from(from_half(x)));
                target.iter_mut().zip(singles).for_each(|(t, x)| *t = F::from_f64(x));
            }
            Self::Singles(x) => {
                target.iter_mut().zip(x).for_each(|(t, &x)| *t = F::from_f64(x as f64));
            }
            Self::Doubles(x) => target.iter_mut().zip(x).for_each(|(t, &x)| *t = F::from_f64(x)),
            Self::Counts(_) | Self::Other(_) => {}
        }
    }

    /// How many are held: none of a type that is not kept.
    fn len(&self) -> usize {
        match self {
            Self::Halves(x) => x.len(),
            Self::Singles(x) => x.len(),
            Self::Doubles(x) => x.len(),
            Self::Counts(x) => x.len(),
            Self::Other(_) => 0,
        }
    }

    fn is_real(&self) -> bool {
        matches!(self, Self::Halves(_) | Self::Singles(_) | Self::Doubles(_))
    }
}

/// The number of elements in an array of this shape, if there can be one: whatever axes are empty, the
/// others together have to be fewer bytes than memory has addresses, as for ndarray.
///
/// Shapes that come from files are checked with it before anything is allocated.
///
/// ```
/// use autodiff_lite::state::length;
///
/// assert_eq!(length(&[2, 3]), Some(6));
/// assert_eq!(length(&[2, 0]), Some(0));
/// assert_eq!(length(&[usize::MAX, 2]), None);
/// assert_eq!(length(&[usize::MAX, 0]), None);
/// ```
pub fn length(shape: &[usize]) -> Option<usize> {
    let others = shape.iter().filter(|&&size| size > 0);
    let most = others.copied().try_fold(size_of::<f64>(), usize::checked_mul)?;
    isize::try_from(most).ok()?;
    Some(if shape.contains(&0) { 0 } else { most / size_of::<f64>() })
}

impl State {
    /// Nothing.
    pub fn new() -> Self {
        Self::default()
    }

    /// The names of all arrays, sorted.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.arrays.keys().map(String::as_str)
    }

    /// An array by its name, if it is there and of real numbers.
    ///
    /// # Shapes
    /// That which the array has in the file.
    pub fn array<F: Real>(&self, name: &str) -> Option<Tensor<F>> {
        let stored = self.arrays.get(name).filter(|stored| stored.numbers.is_real())?;
        // As many as there are: a shape alone may claim more than any memory holds.
        let mut numbers = vec![F::zero(); stored.numbers.len()];
        stored.numbers.copy_to(&mut numbers);
        let array = ndarray::ArrayD::from_shape_vec(stored.shape.as_slice(), numbers).ok()?;
        Some(array.into())
    }

    /// Adds an array, row-major, in place of one of that name.
    ///
    /// # Panics
    /// If there are more or fewer numbers than the shape has, or it is not one that an array can
    /// have.
    #[track_caller]
    pub fn insert<F: Real>(&mut self, name: &str, shape: &[usize], numbers: &[F]) {
        assert_eq!(length(shape), Some(numbers.len()), "{name}: shape and numbers");
        let stored = Stored { shape: shape.to_vec(), numbers: Numbers::of(numbers) };
        self.arrays.insert(name.to_owned(), stored);
    }

    /// Notes that there is an array of another type than real numbers, without its content.
    pub fn insert_other(&mut self, name: &str, shape: &[usize], type_name: &str) {
        let numbers = Numbers::Other(type_name.to_owned());
        self.arrays.insert(name.to_owned(), Stored { shape: shape.to_vec(), numbers });
    }

    /// The same with real numbers rounded to half precision: a half or a quarter of the bytes, about three digits. They are
    /// read back as single ones. Beyond 65,520 a number becomes infinite. What is an optimiser's stays as it is: second moments
    /// would become 0 below 3e-8, and steps infinite.
    ///
    /// ```
    /// use autodiff_lite::state::State;
    ///
    /// let mut state = State::new();
    /// state.insert("weight", &[2], &[1.0_f32, 1.0 / 3.0]);
    /// let halved = state.clone().halved();
    /// assert_eq!(halved.to_bytes().len() + 4, state.to_bytes().len());
    /// let read = State::from_bytes(&halved.to_bytes())?.array::<f32>("weight").expect("it was written");
    /// assert_eq!(read.as_slice(), [1.0, 0.33325195]);
    /// # Ok::<(), String>(())
    /// ```
    #[must_use]
    pub fn halved(mut self) -> Self {
        let own = self.arrays.iter_mut().filter(|(name, _)| !name.starts_with(OPTIMIZER));
        for (_, Stored { numbers, .. }) in own {
            let halves = match &*numbers {
                Numbers::Singles(x) => x.iter().map(|&x| to_half(x)).collect(),
                Numbers::Doubles(x) => x.iter().map(|&x| to_half(x as f32)).collect(),
                _ => continue,
            };
            *numbers = Numbers::Halves(halves);
        }
        self
    }

    /// The same arrays under other names; those of optimisers stay as they are.
    ///
    /// # Errors
    /// The first name that two arrays would have.
    pub fn renamed(self, rename: impl Fn(&str) -> String) -> Result<Self, String> {
        let mut arrays = BTreeMap::new();
        for (name, stored) in self.arrays {
            let name = if name.starts_with(OPTIMIZER) { name } else { rename(&name) };
            if arrays.contains_key(&name) {
                return Err(name);
            }
            arrays.insert(name, stored);
        }
        Ok(Self { arrays, metadata: self.metadata })
    }

    /// Adds all parameters and buffers of `module`, their names beginning with `prefix`.
    pub fn add_module<F: Real>(&mut self, prefix: &str, module: &(impl Module<F> + ?Sized)) {
        module.visit(prefix, &mut |path: &str, param: &Param<F>| {
            let shape = param.shape().to_vec();
            let numbers = Numbers::of(param.as_slice());
            self.arrays.insert(path.to_owned(), Stored { shape, numbers });
        });
    }

    /// Adds the moments of an optimiser.
    pub fn add_optimizer<M: Method, F: Real>(&mut self, optimizer: &Optimizer<M, F>) {
        for (path, state) in &optimizer.states {
            for (name, moment) in M::MOMENTS.iter().zip(&state.moments) {
                let stored = Stored { shape: vec![moment.len()], numbers: Numbers::of(moment) };
                self.arrays.insert(format!("{OPTIMIZER}{name}.{path}"), stored);
            }
            let numbers = Numbers::Counts(vec![state.steps]);
            self.arrays.insert(format!("{OPTIMIZER}t.{path}"), Stored { shape: vec![], numbers });
        }
    }

    /// Copies the arrays below `prefix` into the parameters of `module`. Numbers are converted
    /// between single and double precision.
    ///
    /// # Errors
    /// All names that are missing, unexpected (optimiser moments and PyTorch's
    /// `num_batches_tracked` aside) or of another shape or type, at once; the module is then
    /// unchanged.
    pub fn load_module<F: Real>(
        &self,
        prefix: &str,
        module: &mut (impl Module<F> + ?Sized),
    ) -> Result<(), Mismatch> {
        self.compare_module(prefix, module).into_result()?;
        self.load_matching(prefix, module);
        Ok(())
    }

    /// All differences between the arrays below `prefix` and the parameters of `module`; what is
    /// ignored is said at [`load_module`](Self::load_module).
    pub fn compare_module<F: Real>(
        &self,
        prefix: &str,
        module: &(impl Module<F> + ?Sized),
    ) -> Mismatch {
        let mut mismatch = Mismatch::default();
        let mut wanted = std::collections::BTreeSet::new();
        module.visit(prefix, &mut |path: &str, param: &Param<F>| {
            wanted.insert(path.to_owned());
            mismatch.compare(path, param.shape(), self.arrays.get(path));
        });
        let below = if prefix.is_empty() { String::new() } else { format!("{prefix}.") };
        let ignored =
            |name: &str| name.starts_with(OPTIMIZER) || name.ends_with("num_batches_tracked");
        mismatch.unexpected.extend(
            self.names()
                .filter(|name| {
                    name.starts_with(&below) && !ignored(name) && !wanted.contains(*name)
                })
                .map(str::to_owned),
        );
        mismatch
    }

    /// Copies those arrays below `prefix` that have the shape of their parameter, and leaves the
    /// others; [`compare_module`](Self::compare_module) tells which. A parameter that stands in two places gets what the file
    /// has for the first.
    pub fn load_matching<F: Real>(&self, prefix: &str, module: &mut (impl Module<F> + ?Sized)) {
        let mut shared = Shared::new();
        module.visit_mut(prefix, &mut |path: &str, param: &mut Param<F>| {
            let stored = self.arrays.get(path).filter(|stored| stored.shape == param.shape());
            if let Some(stored) = stored {
                shared.change(param, |param| stored.numbers.copy_to(param.as_slice_mut()));
            }
        });
    }

    /// Replaces the moments of an optimiser. Where there are none, as before a first step, it has none then.
    ///
    /// # Errors
    /// If a moment of a parameter is missing, unexpected (the file is of another method, as far as the names of moments tell)
    /// or of a wrong length or type; the optimiser is then unchanged.
    pub fn load_optimizer<M: Method, F: Real>(
        &self,
        optimizer: &mut Optimizer<M, F>,
    ) -> Result<(), Mismatch> {
        let mut mismatch = Mismatch::default();
        let mut states = BTreeMap::new();
        let counts = format!("{OPTIMIZER}t.");
        for (name, stored) in &self.arrays {
            let Some(path) = name.strip_prefix(&counts) else {
                mismatch.unexpected.extend(foreign::<M>(name).then(|| name.clone()));
                continue;
            };
            let Numbers::Counts(count) = &stored.numbers else {
                mismatch.wrong_type(name, "U64", stored.numbers.type_name());
                continue;
            };
            let &[steps] = count.as_slice() else {
                mismatch.wrong_shape(name, &[], &stored.shape);
                continue;
            };
            let mut moments: Vec<Vec<F>> = Vec::new();
            for moment in M::MOMENTS {
                let name = format!("{OPTIMIZER}{moment}.{path}");
                let stored = self.arrays.get(&name);
                // All moments of a parameter have its length: that of the first.
                let length = moments.first().map(Vec::len);
                let found = stored.map_or(0, |stored| stored.numbers.len());
                mismatch.compare(&name, &[length.unwrap_or(found)], stored);
                let mut values = vec![F::zero(); found];
                if let Some(stored) = stored {
                    stored.numbers.copy_to(&mut values);
                }
                moments.push(values);
            }
            states.insert(path.to_owned(), optim::State { steps, moments, owner: None });
        }
        mismatch.into_result()?;
        optimizer.states = states;
        Ok(())
    }
}

/// Whether this is the name of a moment that the method does not have.
fn foreign<M: Method>(name: &str) -> bool {
    let moment = name.strip_prefix(OPTIMIZER).and_then(|name| name.split_once('.'));
    moment.is_some_and(|(moment, _)| MOMENTS.contains(&moment) && !M::MOMENTS.contains(&moment))
}

/// Saves the parameters and buffers of a module (feature `files`).
///
/// # Errors
/// If the file cannot be written; an earlier file of that name is then untouched.
#[cfg(feature = "files")]
pub fn save<F: Real>(
    path: impl AsRef<Path>,
    module: &(impl Module<F> + ?Sized),
) -> Result<(), SaveError> {
    let mut state = State::new();
    state.add_module("", module);
    state.write(path)
}

/// Loads the parameters and buffers of a module (feature `files`).
///
/// # Errors
/// If the file cannot be read or does not fit the module; the module is then unchanged.
#[cfg(feature = "files")]
pub fn load<F: Real>(
    path: impl AsRef<Path>,
    module: &mut (impl Module<F> + ?Sized),
) -> Result<(), LoadError> {
    let path = path.as_ref();
    State::read(path)?
        .load_module("", module)
        .map_err(|mismatch| LoadError::Mismatch { path: path.to_owned(), mismatch })
}
