//! Numbers in the binary chunk.

use super::component;
use super::container::Glb;
use super::document::{Accessor, Sparse, SparsePart};
use crate::io::ReadMeshError;

/// The items of an accessor, each `size` bytes, `stride` apart; all of them are there.
pub(super) struct Items<'a> {
    accessor: &'a Accessor,
    /// `None` where all are zero but those that stand elsewhere.
    bytes: Option<&'a [u8]>,
    stride: usize,
    size: usize,
    elsewhere: Option<Elsewhere<'a>>,
}

/// Items that stand elsewhere than the others, by their ascending indices.
struct Elsewhere<'a> {
    indices: &'a [u8],
    /// Bytes of an index.
    width: usize,
    values: &'a [u8],
}

/// An item of zeros; none is larger.
const ZEROS: [u8; 16] = [0; 16];

impl Items<'_> {
    pub(super) fn count(&self) -> usize {
        self.accessor.count as usize
    }

    fn item(&self, k: usize) -> &[u8] {
        if let Some(item) = self.elsewhere.as_ref().and_then(|e| e.item(k, self.size)) {
            return item;
        }
        self.bytes.map_or(&ZEROS[..self.size], |bytes| &bytes[k * self.stride..][..self.size])
    }
}

impl Elsewhere<'_> {
    fn count(&self) -> usize {
        self.indices.len() / self.width
    }

    fn index(&self, at: usize) -> u32 {
        let mut four = [0; 4];
        four[..self.width].copy_from_slice(&self.indices[at * self.width..][..self.width]);
        u32::from_le_bytes(four)
    }

    /// Item `k`, if it is one of these.
    fn item(&self, k: usize, size: usize) -> Option<&[u8]> {
        let (mut low, mut high) = (0, self.count());
        while low < high {
            let middle = low.midpoint(high);
            if (self.index(middle) as usize) < k {
                low = middle + 1;
            } else {
                high = middle;
            }
        }
        let is_there = low < self.count() && self.index(low) as usize == k;
        is_there.then(|| &self.values[low * size..][..size])
    }
}

impl Glb<'_> {
    /// The items of an accessor; everything that it claims is checked.
    pub(super) fn items(&self, index: usize, name: &str) -> Result<Items<'_>, ReadMeshError> {
        let accessor = self.get(&self.document.accessors, index, "accessor")?;
        let width = match accessor.kind.as_str() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            other => return Err(self.bad(name, format!("{other:?}"), "SCALAR or VEC2 to VEC4")),
        };
        let size = width
            * component_size(accessor.component_type).ok_or_else(|| {
                self.bad(name, format!("componentType {}", accessor.component_type), "5120 to 5126")
            })?;
        let elsewhere = accessor.sparse.as_deref();
        let elsewhere = elsewhere.map(|s| self.elsewhere(s, accessor, size, name)).transpose()?;
        let Some(view) = accessor.buffer_view else {
            // Nothing but a number says how many zeros there are.
            if elsewhere.is_none() || accessor.count > self.bin.len() as u64 {
                return Err(self.bad(name, "an accessor without data", "one with a bufferView"));
            }
            return Ok(Items { accessor, bytes: None, stride: size, size, elsewhere });
        };
        let bytes = self.view(view, name)?;
        let stride = self.document.buffer_views[view].byte_stride.unwrap_or(size as u64);
        if stride < size as u64 {
            return Err(self.bad(name, format!("byteStride {stride}"), &format!("{size} or more")));
        }
        let bytes = self.items_in(
            bytes,
            accessor.byte_offset,
            [accessor.count, stride, size as u64],
            name,
        )?;
        Ok(Items { accessor, bytes: Some(bytes), stride: stride as usize, size, elsewhere })
    }

    /// What follows an offset: so many items, so far apart, of so many bytes.
    fn items_in<'b>(
        &self,
        bytes: &'b [u8],
        offset: u64,
        [count, stride, size]: [u64; 3],
        name: &str,
    ) -> Result<&'b [u8], ReadMeshError> {
        // The last item need not be followed by the rest of its stride.
        let end = count.checked_sub(1).map_or(Some(0), |last| {
            last.checked_mul(stride)?.checked_add(offset)?.checked_add(size)
        });
        if end.is_none_or(|end| end > bytes.len() as u64) {
            return Err(self.bad(
                name,
                format!("{count} items in {} bytes", bytes.len()),
                "as many as there are bytes for",
            ));
        }
        // An accessor of nothing may begin anywhere.
        Ok(bytes.get(offset as usize..).unwrap_or_default())
    }

    /// The items of a sparse accessor that stand elsewhere.
    fn elsewhere(
        &self,
        sparse: &Sparse,
        accessor: &Accessor,
        size: usize,
        name: &str,
    ) -> Result<Elsewhere<'_>, ReadMeshError> {
        let Sparse { count, indices, values } = sparse;
        let width = match indices.component_type {
            component::U8 => 1,
            component::U16 => 2,
            component::U32 => 4,
            other => {
                return Err(self.bad(name, format!("componentType {other}"), "an unsigned one"));
            }
        };
        let part = |part: &SparsePart, size: usize| {
            let bytes = self.view(part.buffer_view, name)?;
            let bytes =
                self.items_in(bytes, part.byte_offset, [*count, size as u64, size as u64], name)?;
            Ok(&bytes[..*count as usize * size])
        };
        let elsewhere =
            Elsewhere { indices: part(indices, width)?, width, values: part(values, size)? };
        let mut next = 0;
        for at in 0..elsewhere.count() {
            let index = u64::from(elsewhere.index(at));
            if index < next || index >= accessor.count {
                let expected = format!("ascending ones below {}", accessor.count);
                return Err(self.bad(name, format!("sparse index {index}"), &expected));
            }
            next = index + 1;
        }
        Ok(elsewhere)
    }

    /// The items of an accessor of at least `N` numbers each.
    pub(super) fn floats<const N: usize>(
        &self,
        index: usize,
        name: &str,
    ) -> Result<Items<'_>, ReadMeshError> {
        let items = self.items(index, name)?;
        let size = component_size(items.accessor.component_type).unwrap_or(1);
        if items.count() > 0 && items.size < N * size {
            return Err(self.bad(name, &items.accessor.kind, &format!("VEC{N}")));
        }
        Ok(items)
    }

    /// The first `N` numbers of item `k`, of an accessor that has as many.
    pub(super) fn row<const N: usize>(
        &self,
        items: &Items<'_>,
        k: usize,
        name: &str,
    ) -> Result<[f32; N], ReadMeshError> {
        let size = component_size(items.accessor.component_type).unwrap_or(1);
        let item = items.item(k);
        let row: [f32; N] =
            std::array::from_fn(|c| number(&item[c * size..(c + 1) * size], items.accessor));
        match row.iter().find(|v| !v.is_finite()) {
            None => Ok(row),
            Some(bad) => Err(self.bad(name, bad, "finite numbers")),
        }
    }

    /// Item `k` of indices, less than `vertices`.
    pub(super) fn vertex(
        &self,
        items: &Items<'_>,
        k: usize,
        vertices: usize,
    ) -> Result<u32, ReadMeshError> {
        let index = match (items.accessor.component_type, items.item(k)) {
            (component::U8, &[a]) => u32::from(a),
            (component::U16, &[a, b]) => u32::from(u16::from_le_bytes([a, b])),
            (component::U32, &[a, b, c, d]) => u32::from_le_bytes([a, b, c, d]),
            _ => return Err(self.bad("indices", &items.accessor.kind, "unsigned SCALARs")),
        };
        if (index as usize) < vertices {
            Ok(index)
        } else {
            Err(self.bad("indices", index, &format!("less than {vertices}")))
        }
    }

    /// Refuses an attribute that is not there for each vertex.
    pub(super) fn as_many(
        &self,
        items: &Items<'_>,
        vertices: usize,
        name: &str,
    ) -> Result<(), ReadMeshError> {
        if items.count() == vertices {
            return Ok(());
        }
        let found = format!("{} for {vertices} positions", items.count());
        Err(self.bad(name, found, "as many of each"))
    }
}

fn component_size(component: u32) -> Option<usize> {
    match component {
        component::I8 | component::U8 => Some(1),
        component::I16 | component::U16 => Some(2),
        component::U32 | component::F32 => Some(4),
        _ => None,
    }
}

/// One number; whole numbers stand for themselves, or for fractions where they are normalised.
fn number(bytes: &[u8], accessor: &Accessor) -> f32 {
    let (value, one) = match (accessor.component_type, bytes) {
        (component::I8, &[a]) => (f32::from(a.cast_signed()), 127.0),
        (component::U8, &[a]) => (f32::from(a), 255.0),
        (component::I16, &[a, b]) => (f32::from(i16::from_le_bytes([a, b])), 32767.0),
        (component::U16, &[a, b]) => (f32::from(u16::from_le_bytes([a, b])), 65535.0),
        (component::U32, &[a, b, c, d]) => (u32::from_le_bytes([a, b, c, d]) as f32, 1.0),
        (_, &[a, b, c, d]) => (f32::from_le_bytes([a, b, c, d]), 1.0),
        _ => (f32::NAN, 1.0),
    };
    if accessor.normalized { (value / one).max(-1.0) } else { value }
}
