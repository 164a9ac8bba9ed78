//! PyTorch's own weight files, `.pth` and `.pt`.
//!
//! Two layouts are read. Since PyTorch 1.6 a file is an uncompressed zip archive:
//! `<name>/data.pkl` is a pickle in which each storage has a key, and `<name>/data/<key>` are its
//! bytes. Before (and in torchvision's older files, VGG16 among them) it is three short pickles,
//! the pickle of the object, a pickle with the list of keys, and then for each key the number of
//! elements, 8 bytes, and the bytes. Both: the file formats of `torch/serialization.py`.
//!
//! Nothing is executed, and memory is taken only for numbers that are there: at most so much for each
//! byte of the file, beside what any file may take.

use std::collections::BTreeMap;
use std::io::Cursor;

use autodiff_lite::state::{State, from_bfloat, from_half, length};
use pickle::budget::Budget;
use pickle::{Item, Pickle, Storage, Tensor};

use super::error::PthError;

/// Keys under which training programs keep the weights among other things.
const NESTED: [&str; 3] = ["state_dict", "model_state_dict", "model"];

/// The magic number that the first pickle of an old file holds, as it is written: LONG1, 10 bytes.
const MAGIC: [u8; 14] =
    [0x80, 2, 0x8a, 10, 0x6c, 0xfc, 0x9c, 0x46, 0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19];

/// What a storage's place takes in a tree whose nodes are half full, and its name.
const STORAGE: usize = 200;
/// What an array's place takes in such a tree.
const ARRAY: usize = 400;

/// Whether the bytes begin like a `.pth` file of either layout.
pub(super) fn recognises(bytes: &[u8]) -> bool {
    bytes.starts_with(b"PK\x03\x04") || bytes.starts_with(&MAGIC)
}

/// Reads the bytes of a `.pth` file.
pub(super) fn read(bytes: &[u8]) -> Result<State, PthError> {
    let budget = Budget::of(bytes.len());
    if bytes.starts_with(&MAGIC) { old(bytes, &budget) } else { archive(bytes, &budget) }
}

/// Where the list of an archive's files begins: its last record.
const END_OF_ARCHIVE: &[u8] = b"PK\x05\x06";
/// What the reader of archives keeps of each file.
const ENTRY: usize = 1200;

/// Takes the memory for the list of an archive's files, each of which has at least 46 bytes there.
fn listed(bytes: &[u8], budget: &Budget) -> Result<(), PthError> {
    let files = bytes.windows(4).filter(|&w| w == b"PK\x01\x02").count();
    let end = bytes.windows(4).rposition(|w| w == END_OF_ARCHIVE);
    end.ok_or_else(|| PthError::Archive("it has no list of its files".to_owned()))?;
    Ok(budget.take(files.saturating_mul(ENTRY))?)
}

fn archive(bytes: &[u8], budget: &Budget) -> Result<State, PthError> {
    listed(bytes, budget)?;
    let mut zip = zip::ZipArchive::new(Cursor::new(bytes))
        .map_err(|error| PthError::Archive(error.to_string()))?;
    let name = zip
        .file_names()
        .filter_map(Result::ok)
        .find(|name| name.ends_with("/data.pkl") || *name == "data.pkl")
        .map(std::borrow::Cow::into_owned)
        .ok_or(PthError::NoPickle)?;
    let folder = name.trim_end_matches("data.pkl").to_owned();
    if entry(&mut zip, bytes, &format!("{folder}byteorder"))?.is_some_and(|o| o != b"little") {
        return Err(PthError::BigEndian);
    }
    let main = entry(&mut zip, bytes, &name)?.unwrap_or_default();
    let pickle = Pickle::parse_within(main, budget)
        .map_err(|source| PthError::Pickle { part: name, source })?;
    let mut storages = BTreeMap::new();
    for Storage { key, .. } in pickle.storages() {
        if !storages.contains_key(key) {
            budget.take(STORAGE + key.len() + folder.len())?;
            let name = format!("{folder}data/{key}");
            let data = entry(&mut zip, bytes, &name)?;
            let reason = "is missing from the archive";
            storages.insert(key, data.ok_or(PthError::Entry { name, reason })?);
        }
    }
    collect(&pickle, &storages, budget)
}

/// The bytes of one file of the archive, as they lie in it.
fn entry<'a>(
    zip: &mut zip::ZipArchive<Cursor<&[u8]>>,
    bytes: &'a [u8],
    name: &str,
) -> Result<Option<&'a [u8]>, PthError> {
    let file = match zip.by_name(name) {
        Ok(file) => file,
        Err(zip::result::ZipError::FileNotFound) => return Ok(None),
        Err(error) => return Err(PthError::Archive(format!("{name}: {error}"))),
    };
    let wrong = |reason| PthError::Entry { name: name.to_owned(), reason };
    if file.compression() != zip::CompressionMethod::Stored || file.encrypted() {
        return Err(wrong("is compressed or encrypted, which PyTorch does not do"));
    }
    let range = file.data_start().and_then(|start| {
        let start = usize::try_from(start).ok()?;
        Some(start..start.checked_add(usize::try_from(file.size()).ok()?)?)
    });
    let found = range.and_then(|range| bytes.get(range));
    found.map(Some).ok_or_else(|| wrong("reaches past the end of the file"))
}

fn old(bytes: &[u8], budget: &Budget) -> Result<State, PthError> {
    let mut at = 0;
    let mut next = |what: &str| {
        let pickle = Pickle::parse_within(&bytes[at..], budget).map_err(|source| {
            PthError::Pickle { part: format!("{what}, which begins at byte {at}"), source }
        })?;
        at += pickle.length();
        Ok::<_, PthError>((pickle, at))
    };
    next("the magic number")?;
    next("the version")?;
    let (system, _) = next("the system's sizes")?;
    let little = system.root().entries().find(|(name, _)| *name == "little_endian");
    if little.is_some_and(|(_, item)| item.truth() == Some(false)) {
        return Err(PthError::BigEndian);
    }
    let (object, _) = next("the object")?;
    let (keys, at) = next("the list of storages")?;
    let storages = storages(bytes, at, &object, &keys, budget)?;
    collect(&object, &storages, budget)
}

/// The storages of an old file: from `at` on, in the order of the list of their keys.
fn storages<'k, 'a>(
    bytes: &'a [u8],
    mut at: usize,
    object: &Pickle<'_>,
    keys: &'k Pickle<'_>,
    budget: &Budget,
) -> Result<BTreeMap<&'k str, &'a [u8]>, PthError> {
    let kinds: BTreeMap<&str, &str> = object
        .storages()
        .map(|Storage { key, kind, .. }| budget.take(STORAGE).map(|()| (key, kind)))
        .collect::<Result<_, _>>()?;
    let list = |source| PthError::Pickle { part: "the list of storages".to_owned(), source };
    let mut storages = BTreeMap::new();
    for item in keys.root().sequence().map_err(list)? {
        let wrong = |key: &str, reason| PthError::Storage { key: key.to_owned(), reason };
        let key = item.text().ok_or_else(|| wrong(&item.field, "is not named by a text"))?;
        let missing = || wrong(key, "reaches past the end of the file");
        let (count, rest) = bytes[at..].split_first_chunk().ok_or_else(missing)?;
        let size = kinds.get(key).and_then(|kind| element_size(kind));
        let size = size.ok_or_else(|| wrong(key, "has a type of unknown size"))?;
        let length = usize::try_from(u64::from_le_bytes(*count)).ok();
        let length = length.and_then(|n| n.checked_mul(size)).ok_or_else(missing)?;
        budget.take(STORAGE + key.len())?;
        storages.insert(key, rest.get(..length).ok_or_else(missing)?);
        at += size_of_val(count) + length;
    }
    Ok(storages)
}

fn element_size(kind: &str) -> Option<usize> {
    Some(match kind {
        "DoubleStorage" | "LongStorage" | "ComplexFloatStorage" => 8,
        "FloatStorage" | "IntStorage" => 4,
        "HalfStorage" | "BFloat16Storage" | "ShortStorage" => 2,
        "ByteStorage" | "CharStorage" | "BoolStorage" | "UntypedStorage" => 1,
        _ => return None,
    })
}

/// All tensors of the dictionary of weights.
fn collect(
    pickle: &Pickle<'_>,
    storages: &BTreeMap<&str, &[u8]>,
    budget: &Budget,
) -> Result<State, PthError> {
    let mut state = State::new();
    for (name, item) in weights_of(pickle).entries() {
        let Some(tensor) = item.tensor() else { continue };
        let about = |reason: String| PthError::Tensor { name: name.to_owned(), reason };
        let Storage { kind, key, elements } = tensor.storage;
        let data = storages.get(key).ok_or_else(|| about("its storage is missing".into()))?;
        let plan = Plan::new(&tensor, elements).map_err(about)?;
        // Tensors may share a storage: what they take is counted each time. Numbers are gathered,
        // then copied into the state.
        let numbers = element_size(kind).unwrap_or(0).max(4).saturating_mul(plan.len());
        budget
            .take(numbers.saturating_add(ARRAY + name.len() + size_of_val(&plan.shape[..])))
            .and_then(|()| budget.take(numbers))
            .map_err(|reason| about(format!("{reason}: do tensors share storages too often?")))?;
        let shape = &plan.shape[..];
        let held = match kind {
            "FloatStorage" => {
                plan.gather(data, f32::from_le_bytes).map(|x| state.insert(name, shape, &x))
            }
            "DoubleStorage" => {
                plan.gather(data, f64::from_le_bytes).map(|x| state.insert(name, shape, &x))
            }
            "HalfStorage" => plan.gather(data, from_half).map(|x| state.insert(name, shape, &x)),
            "BFloat16Storage" => {
                plan.gather(data, from_bfloat).map(|x| state.insert(name, shape, &x))
            }
            other => {
                state.insert_other(name, shape, other);
                Some(())
            }
        };
        held.ok_or_else(|| about(format!("its storage has {} bytes, too few", data.len())))?;
        budget.give_back(numbers);
    }
    if state.names().next().is_none() {
        return Err(PthError::Empty);
    }
    Ok(state)
}

/// The dictionary of weights: the object itself if it holds a tensor, or what it holds under one
/// of the usual names.
fn weights_of<'p, 'a>(pickle: &'p Pickle<'a>) -> Item<'p, 'a> {
    let holds_tensors = |item: &Item<'_, '_>| item.entries().any(|(_, e)| e.tensor().is_some());
    let root = pickle.root();
    if holds_tensors(&root) {
        return root;
    }
    let nested = |name: &&str| root.entries().find(|(key, _)| key == name);
    let mut found = NESTED.iter().filter_map(nested).map(|(_, item)| item);
    found.find(holds_tensors).unwrap_or(root)
}

/// Where the elements of a tensor lie in its storage; all of them were seen to lie in it.
struct Plan {
    shape: Vec<usize>,
    strides: Vec<usize>,
    offset: usize,
}

impl Plan {
    fn new(view: &Tensor<'_>, elements: u64) -> Result<Self, String> {
        let overflow = || format!("a shape of {:?} is too large", view.shape);
        let sizes = |x: &[u64]| {
            let sizes = x.iter().map(|&n| usize::try_from(n));
            sizes.collect::<Result<Vec<_>, _>>().map_err(|_| overflow())
        };
        let shape = sizes(&view.shape)?;
        let count = length(&shape).ok_or_else(overflow)? as u64;
        // A tensor with more elements than its storage repeats them, which weights do not.
        if count > elements {
            return Err(overflow());
        }
        let mut last = view.offset;
        for (&size, &stride) in view.shape.iter().zip(&view.strides) {
            let reach = size.saturating_sub(1).checked_mul(stride).ok_or_else(overflow)?;
            last = last.checked_add(reach).ok_or_else(overflow)?;
        }
        if count > 0 && last >= elements {
            return Err(format!("element {last} of a storage of {elements}"));
        }
        Ok(Self {
            shape,
            strides: sizes(&view.strides)?,
            offset: usize::try_from(view.offset).map_err(|_| overflow())?,
        })
    }

    fn len(&self) -> usize {
        self.shape.iter().product()
    }

    /// The elements in row-major order; none if the storage is shorter than it says.
    fn gather<T, const N: usize>(&self, data: &[u8], convert: fn([u8; N]) -> T) -> Option<Vec<T>> {
        let (elements, _) = data.as_chunks::<N>();
        let count = self.len();
        if count == 0 {
            return Some(Vec::new());
        }
        let reach: usize = self.shape.iter().zip(&self.strides).map(|(n, s)| (n - 1) * s).sum();
        elements.get(self.offset + reach)?;
        let mut out = Vec::with_capacity(count);
        let mut index = vec![0; self.shape.len()];
        let mut at = self.offset;
        for _ in 0..count {
            out.push(convert(elements[at]));
            for axis in (0..index.len()).rev() {
                index[axis] += 1;
                at += self.strides[axis];
                if index[axis] < self.shape[axis] {
                    break;
                }
                at -= self.shape[axis] * self.strides[axis];
                index[axis] = 0;
            }
        }
        Some(out)
    }
}
