//! What a file holds, as plain values.

/// What a variable, a field or a cell holds.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    /// Numbers, column-major.
    Numbers(Array),
    /// Text; the rows of a character matrix end in line feeds, without their trailing blanks.
    Text(String),
    /// A struct array.
    Struct(Box<StructArray>),
    /// Cells, column-major.
    Cells(Vec<Value>),
    /// Something that is not read, in words.
    Unread(&'static str),
}

/// Numbers with their shape.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Array {
    /// Lengths of the axes, at least two.
    pub(crate) dims: Vec<usize>,
    /// As many values as the product of the axes, the first axis fastest.
    pub(crate) data: Data,
}

/// Numbers in the narrowest of three forms that holds them all.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Data {
    /// Nothing but 0 and 1: how many, and one bit for each.
    Bits(usize, Vec<u8>),
    /// Whole numbers from 0 to 255.
    Bytes(Vec<u8>),
    /// Anything else.
    Floats(Vec<f64>),
}

/// Structs of the same fields.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct StructArray {
    pub(crate) fields: Vec<String>,
    /// The fields of the first struct in their order, then those of the next.
    pub(crate) values: Vec<Value>,
}

impl Array {
    /// The value at a column-major index.
    ///
    /// # Panics
    /// If the index is not below the number of values.
    pub(crate) fn at(&self, index: usize) -> f64 {
        match &self.data {
            Data::Bits(count, bits) => {
                assert!(index < *count, "index {index} of {count}");
                f64::from(bits[index / 8] >> (index % 8) & 1)
            }
            Data::Bytes(bytes) => f64::from(bytes[index]),
            Data::Floats(floats) => floats[index],
        }
    }

    /// How many values there are.
    pub(crate) fn len(&self) -> usize {
        match &self.data {
            Data::Bits(count, _) => *count,
            Data::Bytes(bytes) => bytes.len(),
            Data::Floats(floats) => floats.len(),
        }
    }
}

impl StructArray {
    /// How many structs there are; none where they have no fields.
    pub(crate) fn len(&self) -> usize {
        if self.fields.is_empty() { 0 } else { self.values.len() / self.fields.len() }
    }

    /// A field of one struct.
    pub(crate) fn get(&self, index: usize, field: &str) -> Option<&Value> {
        let at = self.fields.iter().position(|name| name == field)?;
        self.values.get(index * self.fields.len() + at)
    }
}

impl Value {
    /// What it is, for messages.
    pub(crate) fn describe(&self) -> String {
        match self {
            Self::Numbers(array) => format!("{} numbers", sizes(&array.dims)),
            Self::Text(text) => {
                let short: String = text.chars().take(60).collect();
                format!("the text {short:?}")
            }
            Self::Struct(array) => format!("{} structs", array.len()),
            Self::Cells(cells) => format!("{} cells", cells.len()),
            Self::Unread(what) => (*what).to_owned(),
        }
    }
}

/// Axes as MATLAB writes them: `3x4`.
pub(super) fn sizes(dims: &[usize]) -> String {
    dims.iter().map(usize::to_string).collect::<Vec<_>>().join("x")
}
