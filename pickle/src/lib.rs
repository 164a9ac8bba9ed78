//! Python's pickles, as far as numbers go: lists, tuples, NumPy arrays and PyTorch's tensors. Nothing is executed.
//!
//! What Python 2 and 3 write at protocols 0 to 5 is read, as long as it is made of numbers, text,
//! lists, tuples, dictionaries and arrays. Values stand in one table and refer to each other by
//! index, so that neither depth nor sharing costs anything, and bytes stay slices of the file: the
//! memory is at most a constant times the file's size, whatever it claims.
//!
//! ```
//! use pickle::Pickle;
//!
//! // pickle.dumps([[1.5, 2.5], "a"], 2)
//! let bytes = b"\x80\x02](](G?\xf8\0\0\0\0\0\0G@\x04\0\0\0\0\0\0eU\x01ae.";
//! let pickle = Pickle::parse(bytes)?;
//! let [numbers, text] = &pickle.root().elements(2)?[..] else { unreachable!() };
//! assert_eq!(numbers.elements(2)?.len(), 2);
//! assert!(text.numbers().is_err()); // "a" is no array: the error says what and where
//! # Ok::<(), pickle::PickleError>(())
//! ```
//!
//! [`torch`] reads the pickles inside PyTorch's weight files, whose tensors are views of storages that
//! lie elsewhere in the file.
//!
//! # Invariants
//!
//! - No bytes can make it execute, recurse, or take more memory than a constant times their number.
//! - A mistake is a [`PickleError`]: where, what is there, what was expected.
//!
//! # References
//! CPython, *Lib/pickletools.py*, for the instructions; NumPy, `ndarray.__reduce__`.

pub mod budget;
mod machine;
pub mod torch;

use std::borrow::Cow;
use std::cell::RefCell;

use crate::budget::{Budget, OverLimit};
use machine::Machine;

/// What is wrong with a pickle, and where: the place of the instruction, or the value's path.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field}: found {found}, expected {expected}")]
pub struct PickleError {
    /// The place of the instruction, or the path of the value.
    pub field: String,
    /// What is there.
    pub found: String,
    /// What was expected.
    pub expected: String,
}

fn error(field: impl Into<String>, found: impl Into<String>, expected: &str) -> PickleError {
    PickleError { field: field.into(), found: found.into(), expected: expected.to_owned() }
}

/// A value; indices point into the table of all values.
#[derive(Clone, Debug)]
enum Value<'a> {
    None,
    Number(f64),
    /// Text or bytes: Python 2 does not tell them apart.
    Bytes(Cow<'a, [u8]>),
    /// Bytes that Python 3 wrote for Python 2, as the characters of a text; translated only when
    /// they are asked for, because a file may ask to translate one text many times.
    Latin(u32),
    /// A list, tuple or dictionary (keys and values in turns).
    Sequence(Vec<u32>),
    /// A function or class, by module and name.
    Global(Cow<'a, [u8]>),
    Dtype(Dtype),
    Array(Option<Box<RawArray>>),
    Mark,
}

/// How one number of an array is stored.
#[derive(Clone, Copy, Debug)]
struct Dtype {
    /// `f`, `i`, `u` or `b`, as NumPy calls them.
    kind: u8,
    size: usize,
    big_endian: bool,
}

#[derive(Clone, Debug)]
struct RawArray {
    shape: Vec<usize>,
    dtype: Dtype,
    fortran: bool,
    /// The value that holds its bytes.
    data: u32,
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

/// A parsed pickle.
#[derive(Debug)]
pub struct Pickle<'a> {
    values: Vec<Value<'a>>,
    root: u32,
    /// Memory that may still be taken for the numbers of arrays.
    budget: RefCell<Budget>,
}

/// A value of a pickle and where it stands, like `[1][0]`.
#[derive(Clone, Debug)]
pub struct Item<'p, 'a> {
    pickle: &'p Pickle<'a>,
    index: u32,
    /// Its path from the root, for messages.
    pub field: String,
}

impl<'a> Pickle<'a> {
    /// Reads the first pickle in these bytes.
    ///
    /// # Errors
    /// What was found instead, and where.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, PickleError> {
        let (values, root, budget) = Machine::new(bytes).run()?;
        Ok(Self { values, root, budget: RefCell::new(budget) })
    }

    /// The bytes that a value stands for.
    fn bytes(&self, index: u32) -> Option<Cow<'_, [u8]>> {
        match &self.values[index as usize] {
            Value::Bytes(bytes) => Some(Cow::Borrowed(bytes)),
            Value::Latin(text) => match &self.values[*text as usize] {
                Value::Bytes(text) => latin(text).map(Cow::Owned),
                _ => None,
            },
            _ => None,
        }
    }

    /// The value that the whole pickle stands for.
    pub fn root(&self) -> Item<'_, 'a> {
        Item { pickle: self, index: self.root, field: "pickle".to_owned() }
    }
}

impl<'p, 'a> Item<'p, 'a> {
    fn value(&self) -> &'p Value<'a> {
        &self.pickle.values[self.index as usize]
    }

    /// Whether it is an array of numbers.
    pub fn is_array(&self) -> bool {
        matches!(self.value(), Value::Array(_))
    }

    /// The elements of a list or tuple that has this many.
    ///
    /// # Errors
    /// What was found instead, and where.
    pub fn elements(&self, count: usize) -> Result<Vec<Item<'p, 'a>>, PickleError> {
        let expected = format!("a list or tuple of {count}");
        match self.value() {
            Value::Sequence(items) if items.len() == count => Ok(items
                .iter()
                .enumerate()
                .map(|(i, &index)| Item {
                    pickle: self.pickle,
                    index,
                    field: format!("{}[{i}]", self.field),
                })
                .collect()),
            Value::Sequence(items) => {
                Err(error(&self.field, format!("{} elements", items.len()), &expected))
            }
            _ => Err(error(&self.field, self.value().kind(), &expected)),
        }
    }

    /// Takes memory for what is made of this value, and keeps it taken: several arrays may have
    /// the same bytes.
    fn take(&self, bytes: usize) -> Result<(), PickleError> {
        let taken = self.pickle.budget.borrow_mut().take(bytes as u64);
        taken.map_err(|OverLimit { needed, most }| {
            let expected = format!("arrays that take at most {most}");
            error(&self.field, format!("{needed} bytes of memory"), &expected)
        })
    }

    /// The numbers of an array.
    ///
    /// # Errors
    /// What was found instead, and where.
    pub fn numbers(&self) -> Result<Numbers, PickleError> {
        let wrong = |found: String, expected: &str| Err(error(&self.field, found, expected));
        let Value::Array(Some(array)) = self.value() else {
            return wrong(self.value().kind().to_owned(), "an array of numbers");
        };
        // What stands for bytes becomes a copy of them.
        if let Value::Latin(text) = self.pickle.values[array.data as usize]
            && let Value::Bytes(text) = &self.pickle.values[text as usize]
        {
            self.take(2 * text.len())?;
        }
        let Some(data) = self.pickle.bytes(array.data) else {
            return wrong("an array without bytes".to_owned(), "an array of numbers");
        };
        let RawArray { shape, dtype, fortran, .. } = &**array;
        let count = shape.iter().try_fold(1_usize, |n, &d| n.checked_mul(d));
        if count.and_then(|n| n.checked_mul(dtype.size)) != Some(data.len()) {
            let expected = format!("{shape:?} numbers of {} bytes", dtype.size);
            return wrong(format!("{} bytes", data.len()), &expected);
        }
        let turned = *fortran && shape.len() > 1;
        let copies = if turned { 2 } else { 1 };
        self.take(data.len() / dtype.size * copies * size_of::<f64>())?;
        let values: Vec<f64> = data.chunks_exact(dtype.size).map(|b| dtype.number(b)).collect();
        let data = if turned { row_major(&values, shape) } else { values };
        Ok(Numbers { shape: shape.clone(), data, bytes: dtype.kind == b'u' && dtype.size == 1 })
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

impl Value<'_> {
    fn kind(&self) -> &'static str {
        match self {
            Self::None => "None",
            Self::Number(_) => "a number",
            Self::Bytes(_) | Self::Latin(_) => "text or bytes",
            Self::Sequence(_) => "a list, tuple or dictionary",
            Self::Global(_) => "a class or function",
            Self::Dtype(_) => "a dtype",
            Self::Array(_) => "an array",
            Self::Mark => "a mark",
        }
    }
}

impl RawArray {
    /// What it takes beside its bytes.
    fn memory(&self) -> usize {
        size_of::<Self>() + size_of_val(&self.shape[..])
    }
}

impl Dtype {
    /// From a name such as `f4`, `<i8`, `|u1`.
    fn named(name: &[u8]) -> Option<Self> {
        let (order, rest) = match name {
            [order @ (b'<' | b'>' | b'|' | b'='), rest @ ..] => (*order, rest),
            rest => (b'=', rest),
        };
        let (&kind, size) = rest.split_first()?;
        let size: usize = std::str::from_utf8(size).ok()?.parse().ok()?;
        let known = match kind {
            b'f' => matches!(size, 4 | 8),
            b'i' | b'u' => matches!(size, 1 | 2 | 4 | 8),
            b'b' => size == 1,
            _ => false,
        };
        known.then_some(Self { kind, size, big_endian: order == b'>' })
    }

    fn number(self, bytes: &[u8]) -> f64 {
        let mut raw = [0_u8; 8];
        for (k, &b) in bytes.iter().enumerate() {
            raw[if self.big_endian { self.size - 1 - k } else { k }] = b;
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

/// UTF-8 whose characters stand for bytes.
fn latin(text: &[u8]) -> Option<Vec<u8>> {
    std::str::from_utf8(text).ok()?.chars().map(|c| u8::try_from(u32::from(c)).ok()).collect()
}
