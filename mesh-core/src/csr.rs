//! Compressed sparse rows: lists of different lengths in two flat vectors.

/// Rows of indices of different lengths, stored end to end.
///
/// Row `i` is `indices[offsets[i]..offsets[i + 1]]`; `offsets` has one entry more than there are
/// rows.
///
/// ```
/// use mesh_core::Csr;
/// let rows = Csr::from_pairs(3, &[[2, 7], [0, 5], [2, 4]]);
/// assert_eq!(rows.row(0), [5]);
/// assert!(rows.row(1).is_empty());
/// assert_eq!(rows.row(2), [7, 4]); // the order of the pairs is kept
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Csr {
    /// Where each row begins in `indices`, and the end of the last.
    pub offsets: Vec<u32>,
    /// The entries of all rows.
    pub indices: Vec<u32>,
}

impl AsRef<Self> for Csr {
    fn as_ref(&self) -> &Self {
        self
    }
}

impl Csr {
    /// Groups `[row, entry]` pairs by row, keeping their order within each row.
    ///
    /// # Panics
    /// If a row is not below `rows`, or if there are more than `u32::MAX` pairs.
    pub fn from_pairs(rows: usize, pairs: &[[u32; 2]]) -> Self {
        assert!(u32::try_from(pairs.len()).is_ok(), "Csr: {} entries exceed u32", pairs.len());
        let mut offsets = vec![0_u32; rows + 1];
        for &[row, _] in pairs {
            assert!((row as usize) < rows, "Csr: row {row} of {rows}");
            offsets[row as usize + 1] += 1;
        }
        for row in 0..rows {
            offsets[row + 1] += offsets[row];
        }
        let mut next = offsets.clone();
        let mut indices = vec![0; pairs.len()];
        for &[row, entry] in pairs {
            let slot = &mut next[row as usize];
            indices[*slot as usize] = entry;
            *slot += 1;
        }
        Self { offsets, indices }
    }

    /// The number of rows.
    pub fn len(&self) -> usize {
        self.offsets.len().saturating_sub(1)
    }

    /// Whether there are no rows.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The entries of row `row`.
    ///
    /// # Panics
    /// If there is no such row.
    pub fn row(&self, row: usize) -> &[u32] {
        &self.indices[self.range(row)]
    }

    /// Where the entries of row `row` stand in `indices`, and in any array of values beside it.
    pub fn range(&self, row: usize) -> std::ops::Range<usize> {
        self.offsets[row] as usize..self.offsets[row + 1] as usize
    }

    /// All rows in order.
    pub fn rows(&self) -> impl ExactSizeIterator<Item = &[u32]> {
        (0..self.len()).map(|row| self.row(row))
    }

    /// Sorts the entries of each row ascending.
    pub fn sort_rows(&mut self) {
        for row in 0..self.len() {
            let range = self.range(row);
            self.indices[range].sort_unstable();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn groups_and_sorts() {
        let mut rows = Csr::from_pairs(4, &[[3, 1], [1, 9], [3, 0], [1, 2]]);
        assert_eq!(rows.offsets, [0, 0, 2, 2, 4]);
        assert_eq!(rows.row(3), [1, 0]);
        rows.sort_rows();
        assert_eq!(
            rows.rows().map(<[u32]>::to_vec).collect::<Vec<_>>(),
            [vec![], vec![2, 9], vec![], vec![0, 1]]
        );
    }

    #[test]
    fn no_rows() {
        assert!(Csr::from_pairs(0, &[]).is_empty());
        assert!(Csr::default().is_empty());
    }

    #[test]
    #[should_panic(expected = "row 2 of 2")]
    fn row_out_of_range() {
        Csr::from_pairs(2, &[[2, 0]]);
    }
}
