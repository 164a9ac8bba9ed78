//! Arrays of NumPy's.

use crate::Item;
use crate::dtype::{Array, Kind};
use crate::error::{PickleError, error};
use crate::value::{Value, bytes, wholes};

/// An array of numbers, row-major.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub struct Numbers {
    /// Lengths of the axes.
    pub shape: Vec<usize>,
    /// The numbers.
    pub data: Vec<f64>,
    /// Whether they are stored as single bytes without a sign, as images are.
    pub bytes: bool,
}

impl Item<'_, '_> {
    /// Whether it is an array of numbers.
    pub fn is_array(&self) -> bool {
        matches!(self.value(), Value::Array(_))
    }

    /// The numbers of an array.
    ///
    /// # Errors
    /// What was found instead, and where.
    pub fn numbers(&self) -> Result<Numbers, PickleError> {
        let values = &self.pickle.values;
        let &Value::Array(Some(Array { shape, dtype, fortran, data })) = self.value() else {
            return Err(self.wrong("an array of numbers"));
        };
        let wrong = |found: String, expected: &str| error(&self.field, found, expected);
        let dtype = match dtype {
            Kind::Number(dtype) => dtype,
            Kind::Other(name) => {
                let name = name.and_then(|name| values[name as usize].text());
                let name: String = name.unwrap_or("no simple type").chars().take(40).collect();
                return Err(wrong(format!("an array of {name}"), "an array of numbers"));
            }
        };
        let size = dtype.size();
        let axes = wholes(values, shape)
            .and_then(|axes| axes.into_iter().map(|n| n.try_into().ok()).collect());
        let shape: Vec<usize> = axes.ok_or_else(|| wrong("no shape".into(), "that of an array"))?;
        // What stands for bytes becomes a copy of them.
        if let Value::Latin(text) = values[data as usize] {
            self.take(2 * values[text as usize].text().map_or(0, str::len))?;
        }
        let data = bytes(values, data)
            .ok_or_else(|| wrong("an array without bytes".into(), "an array of numbers"))?;
        let count = shape.iter().try_fold(1_usize, |n, &d| n.checked_mul(d));
        if count.and_then(|n| n.checked_mul(size)) != Some(data.len()) {
            let expected = format!("{shape:?} numbers of {size} bytes");
            return Err(wrong(format!("{} bytes", data.len()), &expected));
        }
        let turned = fortran && shape.len() > 1;
        self.take(data.len() / size * (1 + usize::from(turned)) * size_of::<f64>())?;
        let numbers: Vec<f64> = data.chunks_exact(size).map(|b| dtype.number(b)).collect();
        let data = if turned { row_major(&numbers, &shape) } else { numbers };
        Ok(Numbers { shape, data, bytes: dtype.kind == b'u' && size == 1 })
    }

    /// An array of rows of `N` finite numbers; a plain vector where `N` is 1.
    ///
    /// # Errors
    /// What was found instead, and where.
    pub fn rows<const N: usize>(&self) -> Result<Vec<[f64; N]>, PickleError> {
        let numbers = self.numbers()?;
        let fits = match numbers.shape.as_slice() {
            [_] => N == 1,
            [_, columns] => *columns == N,
            _ => false,
        };
        if !fits {
            let found = format!("an array {:?}", numbers.shape);
            return Err(error(&self.field, found, &format!("one of rows of {N}")));
        }
        if let Some(i) = numbers.data.iter().position(|x| !x.is_finite()) {
            let field = format!("{}[{}]", self.field, i / N);
            return Err(error(field, numbers.data[i].to_string(), "a finite number"));
        }
        // A copy, and what the caller makes of it, which is no larger.
        self.take(2 * size_of_val(&numbers.data[..]))?;
        Ok(numbers.data.as_chunks().0.to_vec())
    }
}

/// Values in Fortran order, the first axis fastest, as row-major ones.
///
/// # Panics
/// If there are more of them than the shape has.
pub fn row_major<T: Copy>(values: &[T], shape: &[usize]) -> Vec<T> {
    let mut index = vec![0; shape.len()];
    let mut out = Vec::with_capacity(values.len());
    for _ in values {
        let offset = index.iter().zip(shape).rev().fold(0, |at, (&i, &n)| at * n + i);
        out.push(values[offset]);
        for axis in (0..shape.len()).rev() {
            index[axis] += 1;
            if index[axis] < shape[axis] {
                break;
            }
            index[axis] = 0;
        }
    }
    out
}
