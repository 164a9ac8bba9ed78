//! NumPy arrays in and out: borrowed on the way in, moved or shared on the way out.

use std::any::Any;

use autodiff_lite::{Real, Tape, Tensor};
use ndarray::{ArrayD, ArrayViewD};
use numpy::{
    Element, PyArray1, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods, PyReadonlyArrayDyn,
    PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::conversion::FromPyObjectOwned;
use pyo3::exceptions::{PyOverflowError, PyTypeError, PyValueError};
use pyo3::prelude::*;

use crate::error;
use crate::precision::Precision;

/// A floating-point array that Python lends for a call.
pub(crate) enum Floats<'py> {
    Single(PyReadonlyArrayDyn<'py, f32>),
    Double(PyReadonlyArrayDyn<'py, f64>),
}

impl<'py> FromPyObject<'_, 'py> for Floats<'py> {
    type Error = PyErr;

    fn extract(object: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        let array = aligned(&object)?;
        if let Ok(array) = array.cast::<PyArrayDyn<f32>>() {
            return Ok(Self::Single(array.try_readonly().map_err(error::value)?));
        }
        if let Ok(array) = array.cast::<PyArrayDyn<f64>>() {
            return Ok(Self::Double(array.try_readonly().map_err(error::value)?));
        }
        let found = found(&object)?;
        let expected = "a NumPy array of float32 or float64 expected";
        let hint = match found.as_str() {
            "a torch.Tensor" => "; unsphere.torch takes tensors, and .numpy() makes arrays of them",
            _ => "",
        };
        Err(PyTypeError::new_err(format!("{expected}, found {found}{hint}")))
    }
}

/// An array whose elements stand where numbers of its type may, a copy of one whose do not, as a field of records of 15 bytes: strides
/// are counted in elements from here on. Whatever is no array as it is.
fn aligned<'py>(object: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let is_array = object.cast::<PyUntypedArray>().is_ok();
    if is_array && !object.getattr("flags")?.getattr("aligned")?.is_truthy()? {
        return object.call_method0("copy");
    }
    Ok(object.clone())
}

/// What an object is, for messages.
pub(crate) fn found(object: &Bound<'_, PyAny>) -> PyResult<String> {
    let kind = object.get_type().fully_qualified_name()?.to_string();
    Ok(match object.cast::<PyUntypedArray>() {
        Ok(array) => format!("an array of {}", array.dtype()),
        Err(_) => format!("a {kind}"),
    })
}

impl Floats<'_> {
    pub(crate) fn shape(&self) -> &[usize] {
        match self {
            Self::Single(array) => array.shape(),
            Self::Double(array) => array.shape(),
        }
    }

    pub(crate) fn dtype(&self) -> &'static str {
        match self {
            Self::Single(_) => "float32",
            Self::Double(_) => "float64",
        }
    }

    /// Checks that the last axis has the three coordinates of points.
    ///
    /// # Errors
    /// If it has another size. [`Shapes`](autodiff_lite::Shapes), which sees to the other axes, would call 3 a letter.
    pub(crate) fn check_coordinates(&self, op: &str, name: &str) -> PyResult<()> {
        let shape = self.shape();
        match shape.last() {
            None | Some(3) => Ok(()),
            Some(found) => Err(error::value(format!(
                "{op}: {name} has {found} in its last axis, expected 3: its shape is {shape:?}"
            ))),
        }
    }

    /// Checks that all elements are in [0, 1], but for what rounding adds.
    ///
    /// # Errors
    /// Names the first that is not.
    pub(crate) fn check_unit(&self, name: &str) -> PyResult<()> {
        let outside = match self {
            Self::Single(array) => outside_unit(&array.as_array()),
            Self::Double(array) => outside_unit(&array.as_array()),
        };
        match outside {
            None => Ok(()),
            Some(found) => {
                Err(error::value(format!("{name}: values in [0, 1] expected, found {found}")))
            }
        }
    }

    /// Checks that no element is NaN.
    ///
    /// # Errors
    /// Says where the first is.
    pub(crate) fn check_numbers(&self, op: &str, name: &str) -> PyResult<()> {
        let found = match self {
            Self::Single(array) => first_nan(&array.as_array()),
            Self::Double(array) => first_nan(&array.as_array()),
        };
        match found {
            None => Ok(()),
            Some(index) => Err(error::value(format!("{op}: {name} is NaN at {index:?}"))),
        }
    }

    /// The elements in single precision, in rows of `K`.
    pub(crate) fn rows<const K: usize>(&self, name: &str) -> PyResult<Vec<[f32; K]>> {
        if !matches!(*self.shape(), [_, k] if k == K) {
            return Err(PyValueError::new_err(format!(
                "{name}: an array [n, {K}] expected, found {:?}",
                self.shape()
            )));
        }
        let flat = self.singles();
        let (rows, _) = flat.as_chunks::<K>();
        Ok(rows.to_vec())
    }

    /// The elements in single precision, the last axis running fastest.
    pub(crate) fn singles(&self) -> Vec<f32> {
        match self {
            Self::Single(array) => array.as_array().iter().copied().collect(),
            Self::Double(array) => array.as_array().iter().map(|&x| x as f32).collect(),
        }
    }

    /// The elements in double precision, the last axis running fastest.
    pub(crate) fn doubles(&self) -> Vec<f64> {
        match self {
            Self::Single(array) => array.as_array().iter().map(|&x| f64::from(x)).collect(),
            Self::Double(array) => array.as_array().iter().copied().collect(),
        }
    }

    /// A tensor in the memory of a tape: the array may change afterwards, and gradients are still those of what it was.
    ///
    /// # Errors
    /// If it is of the other precision.
    pub(crate) fn tensor<F: Precision>(&self, name: &str, tape: &Tape<F>) -> PyResult<Tensor<F>> {
        let Some(array) = F::of(self) else {
            return Err(PyTypeError::new_err(format!(
                "{name}: an array of {} expected as the others are, found {}",
                F::DTYPE,
                self.dtype()
            )));
        };
        let mut tensor = tape.array(array.shape());
        let lent = array.as_array();
        // A view's slice is row-major, where that of NumPy's array may be in Fortran's order.
        match lent.as_slice() {
            Some(slice) => tensor.as_slice_mut().copy_from_slice(slice),
            None => tensor.view_mut().assign(&lent),
        }
        Ok(tensor)
    }
}

/// The first element outside of [0, 1], or that is no number.
fn outside_unit<F: Precision>(array: &ArrayViewD<'_, F>) -> Option<f64> {
    const ROUNDING: f64 = 1e-5;
    let (low, high) = (F::from_f64(-ROUNDING), F::from_f64(1.0 + ROUNDING));
    let is_inside = |x: &F| (low..=high).contains(x);
    // Without a way out in the middle the compiler has vectors do it: nearly always all of them are inside.
    let all = match array.as_slice_memory_order() {
        Some(slice) => slice.iter().fold(true, |all, x| all & is_inside(x)),
        None => array.iter().all(is_inside),
    };
    if all { None } else { array.iter().find(|x| !is_inside(x)).map(|&x| Real::to_f64(x)) }
}

/// Where the first element is that is no number.
fn first_nan<F: Precision>(array: &ArrayViewD<'_, F>) -> Option<Vec<usize>> {
    let is_nan = |x: F| Real::to_f64(x).is_nan();
    // Indices are made only where one is wanted.
    let flat = array.iter().position(|&x| is_nan(x))?;
    array.indexed_iter().nth(flat).map(|(index, _)| ndarray::Dimension::slice(&index).to_vec())
}

/// Triples or pairs of indices that Python lends: any of NumPy's integers.
pub(crate) fn indices<const K: usize>(
    name: &str,
    array: &Bound<'_, PyAny>,
) -> PyResult<Vec<[u32; K]>> {
    let array = &aligned(array)?;
    let flat = match array.cast::<PyArrayDyn<u32>>() {
        Ok(array) => {
            array.try_readonly().map_err(error::value)?.as_array().iter().copied().collect()
        }
        Err(_) => narrowed(name, array)?,
    };
    let shape = array.cast::<PyUntypedArray>()?.shape().to_vec();
    if !matches!(shape[..], [_, k] if k == K) {
        return Err(PyValueError::new_err(format!(
            "{name}: an array [n, {K}] expected, found {shape:?}"
        )));
    }
    let (rows, _) = flat.as_chunks::<K>();
    Ok(rows.to_vec())
}

fn narrowed(name: &str, array: &Bound<'_, PyAny>) -> PyResult<Vec<u32>> {
    let outside = |x: &dyn std::fmt::Display| {
        PyValueError::new_err(format!("{name}: {x} is no index, expected 0 to 4294967294"))
    };
    let narrow = |x: i64| u32::try_from(x).map_err(|_| outside(&x));
    let is_whole =
        array.cast::<PyUntypedArray>().is_ok_and(|a| matches!(a.dtype().kind(), b'i' | b'u'));
    if is_whole {
        // What does not fit into 64 bits with a sign comes out below 0, and is refused.
        let wide = array.call_method1("astype", ("int64",))?;
        let wide = wide.cast::<PyArrayDyn<i64>>()?.try_readonly().map_err(error::value)?;
        return wide.as_array().iter().map(|&x| narrow(x)).collect();
    }
    let found = found(array)?;
    Err(PyTypeError::new_err(format!("{name}: a NumPy array of integers expected, found {found}")))
}

/// A whole number that is not negative; a negative one is a wrong value, as any that is out of range.
pub(crate) fn whole<'py, T: FromPyObjectOwned<'py>>(object: &Bound<'py, PyAny>) -> PyResult<T> {
    object.extract::<T>().map_err(|error| {
        let error: PyErr = error.into();
        if error.is_instance_of::<PyOverflowError>(object.py()) {
            let text = if object.lt(0).unwrap_or(false) {
                format!("a whole number from 0 on expected, found {object}")
            } else {
                format!("{object} is too large a number here")
            };
            return PyValueError::new_err(text);
        }
        error
    })
}

/// A NumPy array that takes the memory over.
pub(crate) fn moved<F: Element, D: ndarray::Dimension>(
    py: Python<'_>,
    array: ndarray::Array<F, D>,
) -> Bound<'_, PyArrayDyn<F>> {
    PyArrayDyn::from_owned_array(py, array.into_dyn())
}

/// A NumPy array `[n, K]` that takes the memory over.
pub(crate) fn table<F: Element + bytemuck::Pod, const K: usize>(
    py: Python<'_>,
    rows: Vec<[F; K]>,
) -> PyResult<Bound<'_, numpy::PyArray2<F>>> {
    let shape = [rows.len(), K];
    PyArray1::from_vec(py, rows.into_flattened()).reshape(shape)
}

/// What keeps the memory of an array that was shared with Python: the array's `base`.
#[pyclass(frozen, module = "unsphere")]
struct Memory(Box<dyn Any + Send + Sync>);

/// A NumPy array over memory that `owner` holds. Nothing is copied, so nobody may write to it.
pub(crate) fn shared<'py, T: Element, O: Send + Sync + 'static>(
    py: Python<'py>,
    owner: O,
    data: impl for<'a> FnOnce(&'a O) -> ArrayViewD<'a, T>,
) -> PyResult<Bound<'py, PyArrayDyn<T>>> {
    let memory = Bound::new(py, Memory(Box::new(owner)))?;
    let owner: &O = memory.get().0.downcast_ref().expect("it was just put there");
    let view = data(owner);
    #[allow(unsafe_code, reason = "NumPy's arrays know no lifetimes")]
    // SAFETY: `view` borrows from what `memory` owns in a box, which is frozen: it neither moves nor changes until `memory`, the base
    // of the array, is dropped. The array is made read-only below, before anybody has it.
    let array = unsafe { PyArrayDyn::borrow_from_array(&view, memory.clone().into_any()) };
    array.try_readwrite().map_err(error::value)?.make_nonwriteable();
    Ok(array)
}

/// A tensor as a read-only NumPy array over the same memory.
pub(crate) fn tensor<F: Precision>(
    py: Python<'_>,
    tensor: Tensor<F>,
) -> PyResult<Bound<'_, PyArrayDyn<F>>> {
    shared(py, tensor, |tensor| tensor.view())
}

/// Zeros of a shape.
pub(crate) fn zeros<'py, F: Precision>(
    py: Python<'py>,
    shape: &[usize],
) -> Bound<'py, PyArrayDyn<F>> {
    moved(py, ArrayD::zeros(shape))
}
