//! How much memory a file of weights may make its reader take.

/// What any file may take beside its own bytes, however short it is; with what is not counted, 256 MB.
const BASE: usize = 200_000_000;
/// What each byte of a file adds; its own bytes are one more.
const PER_BYTE: usize = 16;

/// Memory that is left for what is made of one file. The reader takes from it before it allocates.
#[derive(Clone, Copy, Debug)]
pub(super) struct Budget {
    whole: usize,
    left: usize,
}

impl Budget {
    /// What a file of so many bytes may take.
    pub(super) fn of(bytes: usize) -> Self {
        let whole = bytes.saturating_mul(PER_BYTE).saturating_add(BASE);
        Self { whole, left: whole }
    }

    /// Takes memory for something that is about to be made.
    ///
    /// # Errors
    /// There is not so much left.
    pub(super) fn take(&mut self, bytes: usize) -> Result<(), String> {
        self.left = self.left.checked_sub(bytes).ok_or_else(|| {
            let found = (self.whole - self.left).saturating_add(bytes);
            format!("it would take {found} bytes of memory, for its length at most {}", self.whole)
        })?;
        Ok(())
    }

    /// Gives memory back that was taken before.
    pub(super) fn give(&mut self, bytes: usize) {
        self.left = self.whole.min(self.left.saturating_add(bytes));
    }

    /// Makes room in a list for so many values more. While it moves, the old and the new list are
    /// both there.
    ///
    /// # Errors
    /// As [`Budget::take`].
    pub(super) fn reserve<T>(&mut self, list: &mut Vec<T>, more: usize) -> Result<(), String> {
        let needed = list.len().saturating_add(more);
        if needed <= list.capacity() {
            return Ok(());
        }
        let old = list.capacity();
        let new = needed.max(2 * old).max(4);
        self.take(new.saturating_mul(size_of::<T>()))?;
        list.reserve_exact(new - list.len());
        self.give(old * size_of::<T>());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_grow_within_the_budget() {
        let mut budget = Budget { whole: 1000, left: 1000 };
        let mut list: Vec<u64> = Vec::new();
        while budget.reserve(&mut list, 1).is_ok() {
            list.push(0);
        }
        // Beside the 512 bytes of 64 values the 1024 of a list twice as long do not fit.
        assert_eq!((list.len(), budget.left), (64, 1000 - 512));
    }
}
