//! What a pickle is made of, and the few calls that mean something here.

use std::borrow::Cow;

use crate::dtype::{Array, Dtype, Kind};
use crate::text::latin;

/// No array or tensor has more axes, and no storage a longer name: both are read again and again.
const MOST_AXES: usize = 16;
const LONGEST_KEY: usize = 200;

/// A value; numbers point into the table of all values.
#[derive(Clone, Debug)]
pub(crate) enum Value<'a> {
    None,
    Bool(bool),
    Integer(i64),
    /// A number that is not whole, or longer than 64 bits: nobody asks how large.
    Number,
    /// Python 2 does not tell texts and bytes apart: what can be one is a text.
    Text(Cow<'a, str>),
    Bytes(Cow<'a, [u8]>),
    /// Bytes that Python 3 wrote for Python 2, as the characters of a text; translated only when
    /// they are asked for, because a file may ask to translate one text many times.
    Latin(u32),
    /// A list, tuple or set.
    Sequence(Vec<u32>),
    /// Keys and values in turns.
    Dictionary(Vec<u32>),
    /// A function or class, `module.name`.
    Global(String),
    /// What a call of this function would have made, which means nothing here.
    Foreign(u32),
    Dtype(Kind),
    /// An array of NumPy's, once it has its state.
    Array(Option<Array>),
    /// Numbers that lie elsewhere in a file of PyTorch's: their type, name and count.
    Storage {
        kind: u32,
        key: u32,
        elements: u64,
    },
    /// A view of a storage.
    Tensor {
        storage: u32,
        offset: u64,
        shape: u32,
        strides: u32,
    },
}

impl Value<'_> {
    pub(crate) fn kind(&self) -> &'static str {
        match self {
            Self::None => "None",
            Self::Bool(_) => "a truth value",
            Self::Integer(_) | Self::Number => "a number",
            Self::Text(_) | Self::Bytes(_) | Self::Latin(_) => "text or bytes",
            Self::Sequence(_) => "a list or tuple",
            Self::Dictionary(_) => "a dictionary",
            Self::Global(_) => "a class or function",
            Self::Foreign(_) => "an object",
            Self::Dtype(_) => "a dtype",
            Self::Array(_) => "an array",
            Self::Storage { .. } => "a storage",
            Self::Tensor { .. } => "a tensor",
        }
    }

    pub(crate) fn text(&self) -> Option<&str> {
        match self {
            Self::Text(text) => Some(text),
            _ => None,
        }
    }

    fn whole(&self) -> Option<u64> {
        match *self {
            Self::Integer(n) => n.try_into().ok(),
            Self::Bool(b) => Some(u64::from(b)),
            _ => None,
        }
    }

    fn items(&self) -> &[u32] {
        match self {
            Self::Sequence(items) => items,
            _ => &[],
        }
    }
}

/// The bytes that a value stands for.
pub(crate) fn bytes<'v>(values: &'v [Value<'_>], index: u32) -> Option<Cow<'v, [u8]>> {
    match &values[index as usize] {
        Value::Bytes(bytes) => Some(Cow::Borrowed(bytes)),
        Value::Text(text) => Some(Cow::Borrowed(text.as_bytes())),
        Value::Latin(text) => latin(values[*text as usize].text()?).map(Cow::Owned),
        _ => None,
    }
}

/// The whole numbers in a list: lengths of axes, or steps.
pub(crate) fn wholes(values: &[Value<'_>], index: u32) -> Option<Vec<u64>> {
    match &values[index as usize] {
        Value::Sequence(items) if items.len() <= MOST_AXES => {
            items.iter().map(|&i| values[i as usize].whole()).collect()
        }
        _ => None,
    }
}

/// What a call makes.
pub(crate) enum Made<'a> {
    New(Value<'a>),
    /// One of its arguments as it is.
    Argument(u32),
}

/// What a call of a function stands for.
pub(crate) fn call<'a>(values: &[Value<'_>], function: u32, arguments: u32) -> Made<'a> {
    let indices = values[arguments as usize].items();
    let argument = |i: usize| indices.get(i).map(|&i| &values[i as usize]);
    let Value::Global(name) = &values[function as usize] else {
        return Made::New(Value::Foreign(function));
    };
    let made = match name.as_str() {
        "collections.OrderedDict" | "builtins.dict" => Some(Value::Dictionary(Vec::new())),
        // Python 3 writes empty bytes so for Python 2.
        "__builtin__.bytes" | "builtins.bytes" if indices.is_empty() => {
            Some(Value::Bytes(Cow::Borrowed(&[])))
        }
        "numpy.dtype" => {
            let number = argument(0).and_then(Value::text).and_then(Dtype::named);
            // What is no number stays a type, so that the rest of the pickle can be read beside its arrays.
            let kind = number.map_or_else(|| Kind::Other(indices.first().copied()), Kind::Number);
            Some(Value::Dtype(kind))
        }
        "numpy.core.multiarray._reconstruct" | "numpy._core.multiarray._reconstruct" => {
            Some(Value::Array(None))
        }
        // (buffer, dtype, shape, order)
        "numpy.core.numeric._frombuffer" | "numpy._core.numeric._frombuffer" => {
            match (indices, argument(1)) {
                (&[data, _, shape, ..], Some(&Value::Dtype(dtype))) => {
                    let fortran = argument(3).and_then(Value::text) == Some("F");
                    Some(Value::Array(Some(Array { shape, dtype, fortran, data })))
                }
                _ => None,
            }
        }
        // Python 3 writes bytes so for Python 2.
        "_codecs.encode" => match argument(0) {
            Some(Value::Text(_)) => Some(Value::Latin(indices[0])),
            _ => None,
        },
        // (storage, offset, size, stride, ..)
        "torch._utils._rebuild_tensor" | "torch._utils._rebuild_tensor_v2" => {
            match (indices, argument(0), argument(1).and_then(Value::whole)) {
                (&[storage, _, shape, strides, ..], Some(Value::Storage { .. }), Some(offset)) => {
                    Some(Value::Tensor { storage, offset, shape, strides })
                }
                _ => None,
            }
        }
        // The tensor that the parameter wraps.
        "torch._utils._rebuild_parameter" | "torch._utils._rebuild_parameter_with_state" => {
            if let Some(&tensor) = indices.first() {
                return Made::Argument(tensor);
            }
            None
        }
        _ => None,
    };
    Made::New(made.unwrap_or(Value::Foreign(function)))
}

/// Gives an array or a dtype its state; whether it is one. The state of other objects means nothing here.
pub(crate) fn complete(values: &mut [Value<'_>], target: u32, state: u32) -> bool {
    let indices = values[state as usize].items();
    let part = |i: usize| indices.get(i).map(|&i| &values[i as usize]);
    let completed = match values[target as usize] {
        // (version, byte order, ..)
        Value::Dtype(Kind::Number(dtype)) => part(1)
            .and_then(Value::text)
            .map(|order| Value::Dtype(Kind::Number(Dtype { big_endian: order == ">", ..dtype }))),
        // (version, shape, dtype, Fortran order, bytes)
        Value::Array(_) => match (indices, part(2), part(3).and_then(Value::whole)) {
            (&[_, shape, _, _, data, ..], Some(dtype), Some(order)) => {
                let dtype = match *dtype {
                    Value::Dtype(dtype) => dtype,
                    _ => Kind::Other(None),
                };
                Some(Value::Array(Some(Array { shape, dtype, fortran: order != 0, data })))
            }
            _ => None,
        },
        // The byte order of other types than numbers' means nothing here either.
        _ => return true,
    };
    let complete = completed.is_some();
    values[target as usize] = completed.unwrap_or(Value::None);
    complete
}

/// What a persistent id stands for: `('storage', type, key, location, elements, ..)`.
pub(crate) fn storage<'a>(values: &[Value<'_>], id: u32) -> Value<'a> {
    if let &[_, kind, key, _, elements, ..] = values[id as usize].items()
        && let Value::Global(_) = values[kind as usize]
        && values[key as usize].text().is_some_and(|key| key.len() <= LONGEST_KEY)
        && let Value::Integer(elements) = values[elements as usize]
    {
        return Value::Storage { kind, key, elements: elements.try_into().unwrap_or(0) };
    }
    Value::None
}
