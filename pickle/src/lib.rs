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
//! Calls that make neither are not made: what they would have made is an object of which nothing can be
//! asked. In PyTorch's weight files tensors are views of storages that lie elsewhere: [`Item::tensor`].
//!
//! # Invariants
//!
//! - No bytes can make it execute, recurse, or take more memory than a constant times their number.
//! - A mistake is a [`PickleError`]: where, what is there, what was expected.
//!
//! # References
//! CPython, *Lib/pickletools.py*, for the instructions; NumPy, `ndarray.__reduce__`.

pub mod budget;
mod dtype;
mod error;
mod machine;
mod numpy;
mod text;
mod torch;
mod value;

use crate::budget::{Budget, OverLimit};
use crate::error::error;
use crate::value::Value;

pub use dtype::Dtype;
pub use error::PickleError;
pub use numpy::{Numbers, row_major};
pub use torch::{Storage, Tensor};

/// A parsed pickle.
#[derive(Debug)]
pub struct Pickle<'a> {
    values: Vec<Value<'a>>,
    root: u32,
    length: usize,
    /// Memory that may still be taken for the numbers of arrays.
    budget: Budget,
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
        Self::parse_within(bytes, &Budget::of(bytes.len()))
    }

    /// [`parse`](Self::parse) of a pickle that is a part of a file: its values, and the arrays that
    /// are made of it later, count as memory of that file's.
    ///
    /// # Errors
    /// What was found instead, and where.
    pub fn parse_within(bytes: &'a [u8], budget: &Budget) -> Result<Self, PickleError> {
        let machine::Finished { values, root, length } = machine::run(bytes, budget)?;
        Ok(Self { values, root, length, budget: budget.clone() })
    }

    /// How many bytes the pickle took.
    pub fn length(&self) -> usize {
        self.length
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

    fn part(&self, index: u32, place: impl std::fmt::Display) -> Self {
        Item { pickle: self.pickle, index, field: format!("{}[{place}]", self.field) }
    }

    /// The error where it is something else than was expected.
    fn wrong(&self, expected: &str) -> PickleError {
        let found = match self.value() {
            Value::Foreign(function) => match &self.pickle.values[*function as usize] {
                Value::Global(name) => format!("a call of {name}"),
                other => format!("a call of {}", other.kind()),
            },
            other => other.kind().to_owned(),
        };
        error(&self.field, found, expected)
    }

    /// Takes memory for what is made of this value, and keeps it taken: several arrays may have
    /// the same bytes.
    fn take(&self, bytes: usize) -> Result<(), PickleError> {
        self.pickle.budget.take(bytes).map_err(|OverLimit { needed, most }| {
            let expected = format!("arrays that take at most {most}");
            error(&self.field, format!("{needed} bytes of memory"), &expected)
        })
    }

    /// The elements of a list or tuple, in order.
    ///
    /// # Errors
    /// What was found instead, and where.
    pub fn sequence(&self) -> Result<impl ExactSizeIterator<Item = Self>, PickleError> {
        match self.value() {
            Value::Sequence(items) => {
                Ok(items.iter().enumerate().map(|(i, &index)| self.part(index, i)))
            }
            _ => Err(self.wrong("a list or tuple")),
        }
    }

    /// The elements of a list or tuple that has this many.
    ///
    /// # Errors
    /// What was found instead, and where.
    pub fn elements(&self, count: usize) -> Result<Vec<Self>, PickleError> {
        let items = self.sequence()?;
        if items.len() != count {
            let expected = format!("a list or tuple of {count}");
            return Err(error(&self.field, format!("{} elements", items.len()), &expected));
        }
        Ok(items.collect())
    }

    /// The values of a dictionary whose keys are texts, in order; none of anything else.
    pub fn entries(&self) -> impl Iterator<Item = (&'p str, Self)> {
        let pairs: &[u32] = match self.value() {
            Value::Dictionary(pairs) => pairs,
            _ => &[],
        };
        pairs.as_chunks().0.iter().filter_map(|&[key, value]| {
            let key = self.pickle.values[key as usize].text()?;
            // Keys may be long, and stand in many dictionaries.
            let shown = key.char_indices().nth(60).map_or(key, |(end, _)| &key[..end]);
            Some((key, self.part(value, format_args!("{shown:?}"))))
        })
    }

    /// The text that it is, if it is one.
    pub fn text(&self) -> Option<&'p str> {
        self.value().text()
    }

    /// The truth value that it is, if it is one.
    pub fn truth(&self) -> Option<bool> {
        match *self.value() {
            Value::Bool(truth) => Some(truth),
            _ => None,
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn objects_without_a_meaning_are_passed_over() {
        // {"a": object(state), "n": [2 ** 72, frozenset((1.5,))], "t": (None, True)}
        let bytes = b"\x80\x04}(\x8c\x01acmodel\nNet\n)\x81}\x8c\x01xK\x01sb\x8c\x01n](\
            \x8a\x0a\0\0\0\0\0\0\0\0\0\x01(G?\xf8\0\0\0\0\0\0\x91e\x8c\x01tN\x88\x86u.rest";
        let pickle = Pickle::parse(bytes).unwrap();
        assert_eq!(pickle.length(), bytes.len() - 4);
        let entries: Vec<_> = pickle.root().entries().collect();
        assert_eq!(entries.iter().map(|(name, _)| *name).collect::<Vec<_>>(), ["a", "n", "t"]);
        let error = entries[0].1.numbers().unwrap_err().to_string();
        assert!(error.starts_with("pickle[\"a\"]: found a call of model.Net"), "{error}");
        let [long, set] = &entries[1].1.elements(2).unwrap()[..] else { unreachable!() };
        assert_eq!(long.elements(0).unwrap_err().found, "a number");
        assert_eq!(set.sequence().unwrap().len(), 1);
        assert_eq!(entries[2].1.elements(2).unwrap()[1].truth(), Some(true));
    }

    /// `{"names": np.array(["ab"]), "objects": np.array([None], dtype=object), "x": np.array([1.5], np.float16)}`.
    #[test]
    fn arrays_of_other_things_than_numbers_do_not_hide_the_rest() {
        let array = |dtype: &str, order: &str, state: &str, data: &[u8]| {
            let front =
                "cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n(I0\ntVb\ntR(I1\n(I1\nt";
            let dtype =
                format!("cnumpy\ndtype\n(V{dtype}\nI00\nI01\ntR(I3\nV{order}\n{state}tbI00\n");
            [front.as_bytes(), dtype.as_bytes(), data, b"tb"].concat()
        };
        let plain = "NNNI-1\nI-1\nI0\n";
        let parts = [
            b"(Vnames\n".to_vec(),
            array("U2", "<", "NNNI8\nI4\nI8\n", b"C\x08a\0\0\0b\0\0\0"),
            b"Vobjects\n".to_vec(),
            array("O8", "|", "NNNI-1\nI-1\nI63\n", b"(Nl"),
            b"Vx\n".to_vec(),
            array("f2", "<", plain, b"C\x02\0\x3e"),
            b"d.".to_vec(),
        ];
        let bytes = parts.concat();
        let pickle = Pickle::parse(&bytes).unwrap();
        let entries: Vec<_> = pickle.root().entries().map(|(_, item)| item).collect();
        let found = |k: usize| entries[k].numbers().unwrap_err().found;
        assert_eq!((found(0), found(1)), ("an array of U2".into(), "an array of O8".into()));
        assert!(entries[0].is_array());
        assert_eq!(entries[2].numbers().unwrap().data, [1.5]);
    }

    /// Arrays without numbers, `[0, 3]`, as Python 3 writes them at protocols 0 to 2, which have no bytes.
    #[test]
    fn bytes_may_be_empty() {
        let plain = b"cnumpy.core.multiarray\n_reconstruct\np0\n(cnumpy\nndarray\np1\n(I0\ntp2\nc_codecs\nencode\n\
            p3\n(Vb\np4\nVlatin1\np5\ntp6\nRp7\ntp8\nRp9\n(I1\n(I0\nI3\ntp10\ncnumpy\ndtype\np11\n(Vf4\np12\nI00\nI01\n\
            tp13\nRp14\n(I3\nV<\np15\nNNNI-1\nI-1\nI0\ntp16\nbI00\nc__builtin__\nbytes\np17\n(tRp18\ntp19\nb.";
        let binary = b"\x80\x02cnumpy.core.multiarray\n_reconstruct\nq\0cnumpy\nndarray\nq\x01K\0\x85q\x02c_codecs\n\
            encode\nq\x03X\x01\0\0\0bq\x04X\x06\0\0\0latin1q\x05\x86q\x06Rq\x07\x87q\x08Rq\t(K\x01K\0K\x03\x86q\n\
            cnumpy\ndtype\nq\x0bX\x02\0\0\0f4q\x0c\x89\x88\x87q\rRq\x0e(K\x03X\x01\0\0\0<q\x0fNNNJ\xff\xff\xff\xff\
            J\xff\xff\xff\xffK\0tq\x10b\x89c__builtin__\nbytes\nq\x11)Rq\x12tq\x13b.";
        for bytes in [&plain[..], binary] {
            let numbers = Pickle::parse(bytes).unwrap().root().numbers().unwrap();
            assert_eq!((numbers.shape, numbers.data.len()), (vec![0, 3], 0));
        }
        // `bytes(3)` is another matter.
        let error = Pickle::parse(b"\x80\x02cbuiltins\nbytes\nK\x03\x85R.").unwrap();
        assert!(error.root().numbers().unwrap_err().found.contains("a call of builtins.bytes"));
    }

    #[test]
    fn marks_hold_the_stack_up() {
        // What is below a mark is out of reach until the mark is gone.
        assert!(Pickle::parse(b"N(0.").is_ok() && Pickle::parse(b"N(N1.").is_ok());
        for program in [&b"N(."[..], b"N(\x85.", b"N(Na.", b"0.", b"1."] {
            let error = Pickle::parse(program).unwrap_err();
            assert!(error.found.contains("empty stack") || error.found.contains("mark"), "{error}");
        }
    }

    #[test]
    fn tensors_are_views_of_storages() {
        let bytes = b"\x80\x02}X\x01\0\0\0wctorch._utils\n_rebuild_tensor_v2\n((X\x07\0\0\0storage\
            ctorch\nFloatStorage\nX\x01\0\0\0kX\x03\0\0\0cpuK\x06tQK\x01(K\x02K\x02t(K\x01K\x02t\x89}tRs.";
        let pickle = Pickle::parse(bytes).unwrap();
        let storage = Storage { kind: "FloatStorage", key: "k", elements: 6 };
        assert_eq!(pickle.storages().collect::<Vec<_>>(), [storage]);
        let (name, item) = pickle.root().entries().next().unwrap();
        let view = Tensor { storage, offset: 1, shape: vec![2, 2], strides: vec![1, 2] };
        assert_eq!((name, item.tensor()), ("w", Some(view)));
    }
}
