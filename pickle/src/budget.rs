//! How much memory a file may make its reader take.

use std::cell::Cell;
use std::rc::Rc;

/// What any file may take beside its own bytes, however short it is; with what is not counted,
/// 256 MB.
const BASE: u64 = 200_000_000;
/// What each byte of a file adds; its own bytes are one more.
const PER_BYTE: u64 = 16;

/// More memory was asked for than a file of its length may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("it would take {needed} bytes of memory, for its length at most {most}")]
pub struct OverLimit {
    /// Bytes that would have been held.
    pub needed: u64,
    /// Bytes that may be.
    pub most: u64,
}

/// What is held of the memory that one file may take. A reader counts before it allocates.
///
/// Clones count together: all of them are about the same file.
#[derive(Clone, Debug)]
pub struct Budget {
    most: u64,
    held: Rc<Cell<u64>>,
}

impl Budget {
    /// What a file of so many bytes may take.
    pub fn of(bytes: usize) -> Self {
        let most = (bytes as u64).saturating_mul(PER_BYTE).saturating_add(BASE);
        Self { most, held: Rc::default() }
    }

    /// Counts bytes that are about to be held.
    ///
    /// # Errors
    /// If that is more than there may be; nothing is counted then.
    pub fn take(&self, bytes: impl TryInto<u64>) -> Result<(), OverLimit> {
        let needed = self.held.get().saturating_add(bytes.try_into().unwrap_or(u64::MAX));
        if needed > self.most {
            return Err(OverLimit { needed, most: self.most });
        }
        self.held.set(needed);
        Ok(())
    }

    /// Counts bytes that are no longer held.
    pub fn give_back(&self, bytes: impl TryInto<u64>) {
        self.held.set(self.held.get().saturating_sub(bytes.try_into().unwrap_or(u64::MAX)));
    }

    /// Makes room in a list for so many values more. While it moves, the old and the new list are
    /// both there.
    ///
    /// # Errors
    /// As [`Budget::take`]; the list is as it was.
    pub fn reserve<T>(&self, list: &mut Vec<T>, more: usize) -> Result<(), OverLimit> {
        let (needed, old) = (list.len().saturating_add(more), list.capacity());
        if needed <= old {
            return Ok(());
        }
        let size = size_of::<T>().max(1);
        // Twice as long where there is room for it, so that pushing stays cheap.
        let room = (self.most - self.held.get()) / size as u64;
        let room = usize::try_from(room).unwrap_or(usize::MAX);
        let new = needed.max(room.min(old.saturating_mul(2).max(4)));
        self.take(new.saturating_mul(size))?;
        list.reserve_exact(new - list.len());
        self.give_back(old * size);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_grow_within_the_budget() {
        let budget = Budget { most: 1000, held: Rc::default() };
        let mut list: Vec<u64> = Vec::new();
        while budget.reserve(&mut list, 1).is_ok() {
            list.push(0);
        }
        // While a list moves, both are there: it ends at about half of the budget.
        assert!((50..=125).contains(&list.len()), "{}", list.len());
        assert_eq!(budget.clone().held.get(), 8 * list.capacity() as u64);
        assert!(budget.take(1000_usize).is_err());
    }
}
