//! Which views are fitted and which are kept back to judge the result; which objects are trained
//! on.

use std::hash::Hasher;

use fnv::FnvHasher;

use crate::dataset::{Entry, Subset};
use crate::mix64::mix64;
use crate::view::Views;

/// Indices of views, each list ascending.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Split {
    /// Views that the fit may look at.
    pub fit: Vec<usize>,
    /// Views that only the evaluation looks at.
    pub held_out: Vec<usize>,
}

/// Whether the view or object of this index is held back, of every `every` the last; without, none is.
///
/// The one rule of all that is not told what to hold back: views of an object, objects of a dataset.
pub fn is_held_out(index: usize, every: Option<usize>) -> bool {
    every.is_some_and(|every| every > 0 && index % every == every - 1)
}

/// Holds back views by [`is_held_out`].
///
/// `split(100, Some(5))` holds back 4, 9, 14, .., 99. Where nothing would remain to fit, nothing is held
/// back.
///
/// ```
/// let split = datasets::split(10, Some(5));
/// assert_eq!(split.held_out, [4, 9]);
/// assert_eq!(split.fit, [0, 1, 2, 3, 5, 6, 7, 8]);
/// ```
pub fn split(count: usize, every: Option<usize>) -> Split {
    let (held_out, fit): (Vec<_>, Vec<_>) = (0..count).partition(|&i| is_held_out(i, every));
    if fit.is_empty() {
        Split { fit: held_out, held_out: Vec::new() }
    } else {
        Split { fit, held_out }
    }
}

impl Views {
    /// Which views are fitted and which are held back: those that the source keeps for tests, or else every `every`th
    /// ([`split`](crate::split())). Without a number none is.
    pub fn split(&self, every: Option<usize>) -> Split {
        if every.is_none() || self.test.is_empty() || self.test.len() == self.len() {
            return split(self.len(), every);
        }
        let (held_out, fit) = (0..self.len()).partition(|i| self.test.binary_search(i).is_ok());
        Split { fit, held_out }
    }
}

/// Deals objects into subsets, by shares of training, validation and test.
///
/// An object's subset is a function of the seed, its category and its name alone, so it stays
/// where it is when others come or go, and every category is divided by the same shares. They hold
/// on average: of `n` objects a share `p` is missed by about `sqrt(n p (1 - p))`. Entries whose
/// names agree up to the last `/` are views of one object and stay together.
///
/// ```
/// use datasets::{Entry, Subset, split_objects};
///
/// let car = |name: &str| Entry { name: name.into(), ..Entry::default() };
/// let few = split_objects(&[car("a"), car("b")], [0.7, 0.1, 0.2], 7);
/// let more = split_objects(&[car("c"), car("a"), car("b")], [0.7, 0.1, 0.2], 7);
/// assert_eq!(few, more[1..]);
/// ```
///
/// # Panics
/// If a share is negative or not a number, or all are zero.
pub fn split_objects(entries: &[Entry], shares: [f64; 3], seed: u64) -> Vec<Subset> {
    let total: f64 = shares.iter().sum();
    let sound = shares.iter().all(|&s| s >= 0.0) && total > 0.0 && total.is_finite();
    assert!(sound, "split_objects: shares {shares:?}, expected none below 0 and a sum above it");
    let [train, validation, _] = shares.map(|share| share / total);
    let subset = |entry: &Entry| {
        let at = fraction(seed, &entry.object());
        if at < train {
            Subset::Train
        } else if at < train + validation || shares[2] == 0.0 {
            // Shares may sum to a little less than one.
            if shares[1] == 0.0 { Subset::Train } else { Subset::Validation }
        } else {
            Subset::Test
        }
    };
    entries.iter().map(subset).collect()
}

/// A number in `[0, 1)` that looks random: FNV-1a, then [`mix64`], because the last letters
/// alone would move only FNV's low bits.
pub(crate) fn fraction(seed: u64, words: &[&str]) -> f64 {
    let mut hash = FnvHasher::default();
    hash.write(&seed.to_le_bytes());
    for word in words {
        hash.write(word.as_bytes());
        hash.write(&[0xff]); // no byte of UTF-8, so that words cannot flow into each other
    }
    (mix64(hash.finish()) >> 11) as f64 / (1_u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn objects(category: &str, count: usize) -> Vec<Entry> {
        let entry = |i| Entry {
            category: category.to_owned(),
            name: format!("{i:04}"),
            views: 24,
            subset: None,
        };
        (0..count).map(entry).collect()
    }

    #[test]
    fn every_category_is_divided_by_the_shares() {
        for category in ["02691156", "02958343"] {
            let subsets = split_objects(&objects(category, 2000), [0.7, 0.1, 0.2], 3);
            for (subset, share) in
                [(Subset::Train, 0.7), (Subset::Validation, 0.1), (Subset::Test, 0.2)]
            {
                let found = subsets.iter().filter(|&&s| s == subset).count() as f64 / 2000.0;
                assert!((found - share).abs() < 0.035, "{category} {subset:?}: {found}");
            }
        }
        let plane = split_objects(&objects("02691156", 64), [0.5, 0.0, 0.5], 3);
        assert_ne!(plane, split_objects(&objects("02958343", 64), [0.5, 0.0, 0.5], 3));
        assert_ne!(plane, split_objects(&objects("02691156", 64), [0.5, 0.0, 0.5], 4));
        assert!(!plane.contains(&Subset::Validation));
        let all = split_objects(&objects("x", 500), [0.1, 0.0, 0.0], 1);
        assert!(all.iter().all(|&s| s == Subset::Train));
    }

    #[test]
    fn views_of_an_object_stay_together() {
        for i in 0..50 {
            let view = |v| Entry { name: format!("{i}/{v:02}"), ..Entry::default() };
            let subsets = split_objects(&[view(0), view(7), view(23)], [1.0, 1.0, 1.0], 9);
            assert!(subsets.iter().all(|&s| s == subsets[0]));
        }
    }

    #[test]
    fn every_view_is_on_exactly_one_side() {
        for count in 0..30 {
            for every in 0..7 {
                let s = split(count, Some(every));
                let mut all = [s.fit.clone(), s.held_out].concat();
                all.sort_unstable();
                assert_eq!(all, (0..count).collect::<Vec<_>>());
                assert!(count == 0 || !s.fit.is_empty());
            }
        }
    }
}
