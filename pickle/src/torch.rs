//! Tensors of PyTorch's: views of storages that lie elsewhere in the file.

use crate::value::{Value, wholes};
use crate::{Item, Pickle};

/// Numbers beside the pickle, as a persistent id names them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Storage<'p> {
    /// The type of its numbers: `FloatStorage`.
    pub kind: &'p str,
    /// Its name in the file.
    pub key: &'p str,
    /// How many numbers it has.
    pub elements: u64,
}

/// A tensor as a file describes it; nothing of it was checked against the storage.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Tensor<'p> {
    /// The storage that it is a part of.
    pub storage: Storage<'p>,
    /// Numbers of the storage before its first.
    pub offset: u64,
    /// Lengths of the axes.
    pub shape: Vec<u64>,
    /// Numbers from one place of an axis to the next, as many as there are axes.
    pub strides: Vec<u64>,
}

impl Pickle<'_> {
    /// All storages that the pickle names, in the order in which they stand there.
    pub fn storages(&self) -> impl Iterator<Item = Storage<'_>> {
        self.values.iter().filter_map(|value| self.storage(value))
    }

    fn storage(&self, value: &Value<'_>) -> Option<Storage<'_>> {
        let &Value::Storage { kind, key, elements } = value else { return None };
        let key = self.values[key as usize].text()?;
        let Value::Global(kind) = &self.values[kind as usize] else { return None };
        let kind = kind.rsplit('.').next()?;
        Some(Storage { kind, key, elements })
    }
}

impl<'p> Item<'p, '_> {
    /// The tensor that it is, if it is one.
    pub fn tensor(&self) -> Option<Tensor<'p>> {
        let &Value::Tensor { storage, offset, shape, strides } = self.value() else { return None };
        let values = &self.pickle.values;
        let storage = self.pickle.storage(&values[storage as usize])?;
        let (shape, strides) = (wholes(values, shape)?, wholes(values, strides)?);
        (shape.len() == strides.len()).then_some(Tensor { storage, offset, shape, strides })
    }
}
