//! Arrays of NumPy's.

use crate::value::{Value, bytes, wholes};
use crate::{Item, PickleError, error};

/// How one number of an array is stored.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dtype {
    /// `f`, `i`, `u` or `b`, as NumPy calls them.
    pub(crate) kind: u8,
    pub(crate) size: u8,
    pub(crate) big_endian: bool,
}

/// An array as a pickle describes it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Array {
    /// The value that holds the lengths of its axes.
    pub(crate) shape: u32,
    pub(crate) dtype: Dtype,
    pub(crate) fortran: bool,
    /// The value that holds its bytes.
    pub(crate) data: u32,
}

/// An array of numbers, row-major.
#[derive(Clone, Debug, PartialEq)]
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
        let size = usize::from(dtype.size);
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

impl Dtype {
    /// From a name such as `f4`, `<i8`, `|u1`.
    pub(crate) fn named(name: &str) -> Option<Self> {
        let rest = name.strip_prefix(['<', '>', '|', '=']).unwrap_or(name);
        let kind = *rest.as_bytes().first().filter(|kind| b"fiub".contains(kind))?;
        let size = rest[1..].parse().ok()?;
        let sizes: &[u8] = match kind {
            b'f' => &[4, 8],
            b'b' => &[1],
            _ => &[1, 2, 4, 8],
        };
        sizes.contains(&size).then_some(Self { kind, size, big_endian: name.starts_with('>') })
    }

    fn number(self, bytes: &[u8]) -> f64 {
        let mut raw = [0_u8; 8];
        raw[..bytes.len()].copy_from_slice(bytes);
        if self.big_endian {
            raw[..bytes.len()].reverse();
        }
        let bits = u64::from_le_bytes(raw);
        match (self.kind, self.size) {
            (b'f', 4) => f64::from(f32::from_bits(bits as u32)),
            (b'f', _) => f64::from_bits(bits),
            (b'i', 1) => f64::from(bits as i8),
            (b'i', 2) => f64::from(bits as i16),
            (b'i', 4) => f64::from(bits as i32),
            (b'i', _) => bits as i64 as f64,
            _ => bits as f64,
        }
    }
}

/// Fortran order to row-major.
fn row_major(values: &[f64], shape: &[usize]) -> Vec<f64> {
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
