//! Results that know the way back: a value, and its vector-Jacobian product.

use std::sync::{Mutex, PoisonError};

use autodiff_lite::{NestedTape, ShapeError, Tensor, Vjp};
use numpy::PyArrayMethods;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyIterator, PyTuple};

use crate::arrays::{self, Floats};
use crate::error;
use crate::precision::{self, Precision};
use crate::wanted::Wanted;

/// What a differentiable function found, with the way back to its inputs.
///
/// `value` is a float where the result is a single number, else a read-only array that shares its memory with this object (copy it to
/// change it). `backward` gives the gradients of the inputs, in the order of `inputs`. It unpacks into both:
///
/// >>> import numpy, unsphere
/// >>> loss, backward = unsphere.l2(numpy.zeros(4), numpy.ones(4))
/// >>> of_image, of_target = backward()
/// >>> loss, of_image
/// (1.0, array([-0.5, -0.5, -0.5, -0.5]))
#[pyclass(frozen, module = "unsphere")]
pub(crate) struct Recorded {
    #[pyo3(get)]
    value: Py<PyAny>,
    call: Call,
    back: Box<dyn Back>,
}

/// What was called: its name, its differentiable inputs, and the shapes of those whose gradients are wanted.
pub(crate) struct Call {
    op: &'static str,
    inputs: Vec<&'static str>,
    wanted: Vec<Option<Vec<usize>>>,
}

impl Call {
    /// Of differentiable inputs of these shapes.
    ///
    /// # Errors
    /// If `wrt` names none of them.
    pub(crate) fn new(
        op: &'static str,
        inputs: &[(&'static str, &[usize])],
        wrt: Option<&Wanted>,
    ) -> PyResult<Self> {
        let names: Vec<&'static str> = inputs.iter().map(|(name, _)| *name).collect();
        let wanted = Wanted::among(wrt, op, &names)?;
        let shapes = inputs.iter().map(|(_, shape)| shape.to_vec());
        let wanted = shapes.zip(wanted).map(|(shape, wanted)| wanted.then_some(shape)).collect();
        Ok(Self { op, inputs: names, wanted })
    }

    /// Of which inputs gradients are wanted; of none beyond those that are differentiable.
    pub(crate) fn wanted<const N: usize>(&self) -> [bool; N] {
        std::array::from_fn(|i| self.wanted.get(i).is_some_and(Option::is_some))
    }
}

#[pymethods]
impl Recorded {
    /// The names of the inputs that `backward` has gradients of, in their order.
    #[getter]
    fn inputs(&self) -> Vec<&'static str> {
        self.call.inputs.clone()
    }

    /// The gradients of `(cotangent * value).sum()`, a tuple with one array for each of `inputs`.
    ///
    /// `cotangent` has shape and dtype of the value (a float where that is one) and may be left out where the value is a single number;
    /// then it is 1. An input of which no gradient was wanted (`wrt`) has None. It may be called more than once.
    #[pyo3(signature = (cotangent=None))]
    fn backward<'py>(
        &self,
        py: Python<'py>,
        cotangent: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.back.pull(py, &self.call, cotangent)?)
    }

    fn __iter__<'py>(this: &Bound<'py, Self>) -> PyResult<Bound<'py, PyIterator>> {
        let value = this.get().value.bind(this.py());
        PyTuple::new(this.py(), [value, &this.getattr("backward")?])?.try_iter()
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let value = self.value.bind(py);
        let value = match value.getattr("shape") {
            Ok(shape) => format!("array of shape {}", shape.repr()?),
            Err(_) => value.repr()?.to_string(),
        };
        Ok(format!("<{} of {}: {value}>", self.call.op, self.call.inputs.join(", ")))
    }
}

impl Recorded {
    /// Computes on a tape while other threads of Python run, and keeps the tape.
    pub(crate) fn new<F: Precision, const N: usize>(
        py: Python<'_>,
        call: Call,
        compute: impl FnOnce() -> Vjp<F, N> + Send,
    ) -> PyResult<Self> {
        let vjp = py.detach(|| error::caught(compute))?;
        let value = vjp.value();
        let value = match value.as_slice() {
            &[only] if value.ndim() == 0 => only.to_f64().into_pyobject(py)?.into_any().unbind(),
            _ => arrays::tensor(py, value)?.into_any().unbind(),
        };
        Ok(Self { value, call, back: Box::new(Mutex::new(vjp)) })
    }
}

/// A way back without its precision.
trait Back: Send + Sync {
    fn pull<'py>(
        &self,
        py: Python<'py>,
        call: &Call,
        cotangent: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Vec<Option<Bound<'py, PyAny>>>>;
}

impl<F: Precision, const N: usize> Back for Mutex<Vjp<F, N>> {
    fn pull<'py>(
        &self,
        py: Python<'py>,
        call: &Call,
        cotangent: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Vec<Option<Bound<'py, PyAny>>>> {
        // Locked only while the interpreter is not held: whoever has the lock never waits for it.
        let locked = || self.lock().unwrap_or_else(PoisonError::into_inner);
        let shape = py.detach(|| locked().value().shape().to_vec());
        let seed = seed::<F>(call.op, &shape, cotangent)?;
        let gradients = py.detach(|| {
            let vjp = locked();
            error::caught(|| vjp.pullback(seed))
        })?;
        let found = call.wanted.iter().zip(gradients);
        Ok(found
            .map(|(wanted, gradient)| match (gradient, wanted) {
                (Some(gradient), _) => Some(arrays::moved(py, gradient.into_owned()).into_any()),
                (None, Some(shape)) => Some(arrays::zeros::<F>(py, shape).into_any()),
                (None, None) => None,
            })
            .collect())
    }
}

/// What is pulled back.
fn seed<F: Precision>(
    op: &str,
    shape: &[usize],
    cotangent: Option<&Bound<'_, PyAny>>,
) -> PyResult<Tensor<F>> {
    let one = |x: f64| Tensor::from(ndarray::arr0(F::from_f64(x)));
    let Some(cotangent) = cotangent else {
        return if shape.is_empty() {
            Ok(one(1.0))
        } else {
            let text = format!(
                "{op}: the value has the shape {shape:?}, so backward needs a cotangent of that shape"
            );
            Err(error::value(text))
        };
    };
    if shape.is_empty()
        && let Ok(factor) = cotangent.extract::<f64>()
    {
        return Ok(one(factor));
    }
    let array = cotangent.extract::<Floats<'_>>()?;
    let Some(own) = F::of(&array) else {
        let text = format!("{op}: a cotangent of {} expected, found {}", F::DTYPE, array.dtype());
        return Err(PyTypeError::new_err(text));
    };
    if array.shape() != shape {
        let found = array.shape();
        return Err(error::value(format!(
            "{op}: a cotangent of shape {shape:?} expected, found {found:?}"
        )));
    }
    Ok(own.to_owned_array().into())
}

/// The arrays that Python lends for a call.
pub(crate) struct Arguments<'a, 'py, const N: usize> {
    pub(crate) call: Call,
    arrays: [(&'static str, &'a Floats<'py>); N],
}

impl<'a, 'py, const N: usize> Arguments<'a, 'py, N> {
    /// All of them are differentiable.
    ///
    /// # Errors
    /// If `wrt` names none of them.
    pub(crate) fn new(
        op: &'static str,
        arrays: [(&'static str, &'a Floats<'py>); N],
        wrt: Option<&Wanted>,
    ) -> PyResult<Self> {
        Self::leading(N, op, arrays, wrt)
    }

    /// The first `count` are differentiable, the others data.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub(crate) fn leading(
        count: usize,
        op: &'static str,
        arrays: [(&'static str, &'a Floats<'py>); N],
        wrt: Option<&Wanted>,
    ) -> PyResult<Self> {
        let shapes = arrays.map(|(name, array)| (name, array.shape()));
        Ok(Self { call: Call::new(op, &shapes[..count], wrt)?, arrays })
    }

    /// Whether the first array, which decides, is of double precision.
    pub(crate) fn is_double(&self) -> bool {
        matches!(self.arrays.first(), Some((_, Floats::Double(_))))
    }

    /// The arrays in the memory of a tape.
    pub(crate) fn load<F: Precision>(&self) -> PyResult<(NestedTape<F>, [Tensor<F>; N])> {
        let tape = precision::tape::<F>();
        let mut tensors = Vec::with_capacity(N);
        for (name, array) in self.arrays {
            tensors.push(array.tensor(&format!("{}: {name}", self.call.op), &tape)?);
        }
        let tensors = tensors.try_into().unwrap_or_else(|_| unreachable!("one for each array"));
        Ok((tape, tensors))
    }
}

/// Shapes that do not fit are a `ValueError`.
pub(crate) fn fits<R>(check: Result<R, ShapeError>) -> PyResult<R> {
    check.map_err(error::value)
}

/// Computes a function of [`Arguments`] in their precision, and keeps the way back.
///
/// `record!(py, arguments, |x, y| losses::l2(x, y, None))`
macro_rules! record {
    ($py:expr, $arguments:expr, |$($var:ident),+| $body:expr) => {{
        let (py, arguments) = ($py, $arguments);
        let wanted = arguments.call.wanted();
        if arguments.is_double() {
            let (tape, inputs) = arguments.load::<f64>()?;
            $crate::recorded::Recorded::new(py, arguments.call, || {
                autodiff_lite::Vjp::new(tape, inputs, wanted, |[$($var),+]| $body)
            })
        } else {
            let (tape, inputs) = arguments.load::<f32>()?;
            $crate::recorded::Recorded::new(py, arguments.call, || {
                autodiff_lite::Vjp::new(tape, inputs, wanted, |[$($var),+]| $body)
            })
        }
    }};
}
pub(crate) use record;
