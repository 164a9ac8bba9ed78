//! Which objects are trained on, by which of them is chosen, and which are scored at the end.

use std::collections::BTreeMap;

use crate::dataset::{Entry, Subset};
use crate::split::{fraction, split};

/// Seed of what is dealt here: another than that of any data, so that objects that were chosen by their hash for training
/// are dealt anew.
const SEED: u64 = 0x5b5e_7a7e;
/// What is dealt out of training where a layout has no list for validation, or none for tests: a tenth, as many as
/// [`Subsets::of`] gives either of them by default.
const SHARE: f64 = 0.1;

/// Indices of objects, or of the views of one, by what they are for, each list ascending.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Subsets {
    /// What is trained on.
    pub train: Vec<usize>,
    /// By what settings and checkpoints are chosen.
    pub validation: Vec<usize>,
    /// What is scored at the end.
    pub test: Vec<usize>,
    /// Which of them are not apart, and why, one sentence each.
    pub warnings: Vec<String>,
}

/// One object is in two subsets.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "object {object} is in {} and in {}: what is scored must be neither trained on nor chosen by; take it out of one list",
    subsets[0].name(), subsets[1].name()
)]
pub struct LeakError {
    /// Category and name.
    pub object: String,
    /// The first two that it is in.
    pub subsets: [Subset; 2],
}

impl Subsets {
    /// Parts the objects that have views.
    ///
    /// Where the layout says what objects are for, that stands, and an object of which it says nothing, or several things,
    /// is trained on. If it has a list for validation alone beside training, or for tests alone, a tenth of the objects for
    /// training is dealt out for the other. If it has neither, one of `hold_out` objects is held out, and half of these are
    /// for validation: with 5 it is 80, 10 and 10 per cent. What is dealt follows from a hash of category and name alone.
    ///
    /// Of few objects at least one is dealt for each. Two objects leave one for validation and test together; a single one
    /// is scored by what it was trained on, as all are without `hold_out`; [`warnings`](Self::warnings) say so. Where
    /// nothing is for training, nothing is added to the lists that there are.
    ///
    /// ```
    /// use datasets::{Entry, Subset, Subsets};
    ///
    /// let entry = |name: &str, subset| Entry { name: name.into(), views: 1, subset, ..Entry::default() };
    /// let (train, test) = (Some(Subset::Train), Some(Subset::Test));
    /// let parts = Subsets::of(&[entry("a", train), entry("b", test), entry("c", train)], Some(5))?;
    /// assert_eq!((parts.train.len(), parts.validation.len(), &parts.test[..]), (1, 1, &[1][..]));
    ///
    /// let leak = Subsets::of(&[entry("a/00", train), entry("a/01", test)], Some(5)).unwrap_err();
    /// assert_eq!(leak.object, "a");
    /// # Ok::<(), datasets::LeakError>(())
    /// ```
    ///
    /// # Errors
    /// If the layout has one object in two subsets.
    pub fn of(entries: &[Entry], hold_out: Option<usize>) -> Result<Self, LeakError> {
        let mut parts = Self::default();
        let usable = || (0..entries.len()).filter(|&i| entries[i].views > 0);
        let said = usable().any(|i| entries[i].subset.is_some_and(|s| s != Subset::Train));
        for i in usable() {
            let subset = entries[i].subset.filter(|_| said).unwrap_or(Subset::Train);
            parts.list(subset).push(i);
        }
        let [no_validation, no_test] = [parts.validation.is_empty(), parts.test.is_empty()];
        if said {
            parts
                .deal(entries, [no_validation, no_test].map(|none| if none { SHARE } else { 0.0 }));
        } else if let Some(every) = hold_out {
            parts.deal(entries, [0.5 / every as f64; 2]);
        }
        parts.check(entries)?;
        parts.fill("object", said || hold_out.is_some());
        Ok(parts)
    }

    /// Parts the views of a single object: every `hold_out`th is held out, as [`split`] has it, and these are for
    /// validation and for tests by turns. A single one is for both, and where there is none scores are of what is trained
    /// on. Views that the source keeps for tests ([`Views::test`](crate::Views::test)) are those for tests, and the held out of
    /// the others for validation.
    ///
    /// ```
    /// let parts = datasets::Subsets::of_views(20, &[], Some(5));
    /// assert_eq!((parts.train.len(), parts.validation, parts.test), (16, vec![4, 14], vec![9, 19]));
    /// ```
    pub fn of_views(count: usize, kept: &[usize], hold_out: Option<usize>) -> Self {
        let mut parts = if kept.is_empty() || kept.len() >= count || hold_out.is_none() {
            let parts = split(count, hold_out);
            let turn = |turn: usize| parts.held_out.iter().skip(turn).step_by(2).copied().collect();
            let (validation, test) = (turn(0), turn(1));
            Self { train: parts.fit, validation, test, warnings: Vec::new() }
        } else {
            let others: Vec<usize> = (0..count).filter(|i| !kept.contains(i)).collect();
            let parts = split(others.len(), hold_out);
            let [train, validation] =
                [parts.fit, parts.held_out].map(|at| at.into_iter().map(|k| others[k]).collect());
            Self { train, validation, test: kept.to_vec(), warnings: Vec::new() }
        };
        parts.fill("view", hold_out.is_some());
        parts
    }

    /// The indices for this.
    pub fn get(&self, subset: Subset) -> &[usize] {
        match subset {
            Subset::Train => &self.train,
            Subset::Validation => &self.validation,
            Subset::Test => &self.test,
        }
    }

    /// Asserts that no object is in two subsets, by category and name: entries whose names agree up to the last `/` are one
    /// object.
    ///
    /// # Errors
    /// Names the first that is.
    ///
    /// # Panics
    /// If an index is of no entry.
    pub fn check(&self, entries: &[Entry]) -> Result<(), LeakError> {
        let mut known: BTreeMap<[&str; 2], Subset> = BTreeMap::new();
        for (_, subset) in Subset::NAMES {
            for &i in self.get(subset) {
                let first = *known.entry(entries[i].object()).or_insert(subset);
                if first != subset {
                    let (object, subsets) = (entries[i].object_name(), [first, subset]);
                    return Err(LeakError { object, subsets });
                }
            }
        }
        Ok(())
    }

    fn list(&mut self, subset: Subset) -> &mut Vec<usize> {
        match subset {
            Subset::Train => &mut self.train,
            Subset::Validation => &mut self.validation,
            Subset::Test => &mut self.test,
        }
    }

    /// Deals shares of what is trained on to validation and test; a share of 0 takes nothing.
    fn deal(&mut self, entries: &[Entry], shares: [f64; 2]) {
        let mut objects: BTreeMap<[&str; 2], Vec<usize>> = BTreeMap::new();
        for &i in &self.train {
            objects.entry(entries[i].object()).or_default().push(i);
        }
        let mut objects: Vec<(f64, Vec<usize>)> =
            objects.into_iter().map(|(object, all)| (fraction(SEED, &object), all)).collect();
        objects.sort_by(|a, b| a.0.total_cmp(&b.0));
        // The last by their hash are for tests, those before them for validation.
        let beyond = |share: f64| objects.iter().filter(|(at, _)| *at >= 1.0 - share).count();
        let wanted = shares.map(|share| usize::from(share > 0.0));
        let test = beyond(shares[1]).max(1) * wanted[1];
        let validation = beyond(shares[0] + shares[1]).saturating_sub(test).max(1) * wanted[0];
        let most = objects.len().saturating_sub(1);
        let [validation, test] = fitted([validation, test], most);
        for (into, count) in [(Subset::Test, test), (Subset::Validation, validation)] {
            let dealt = objects.split_off(objects.len() - count);
            self.list(into).extend(dealt.into_iter().flat_map(|(_, all)| all));
            self.list(into).sort_unstable();
        }
        self.train = objects.into_iter().flat_map(|(_, all)| all).collect();
        self.train.sort_unstable();
    }

    /// Gives a subset that is empty what is nearest to it, and says so.
    fn fill(&mut self, what: &str, asked: bool) {
        if self.train.is_empty() || !(self.validation.is_empty() || self.test.is_empty()) {
            return;
        }
        let few =
            if asked { format!("there are too few {what}s") } else { "nothing is held out".into() };
        match (self.validation.is_empty(), self.test.is_empty()) {
            (true, true) => {
                self.validation.clone_from(&self.train);
                self.test.clone_from(&self.train);
                self.warnings.push(format!("{few}: scores are of what is trained on"));
            }
            (true, false) => {
                self.validation.clone_from(&self.train);
                let text = format!("{few}: the scores of validation are of what is trained on");
                self.warnings.push(text);
            }
            _ => {
                self.test.clone_from(&self.validation);
                let text = format!("{few}: what is for validation is for tests as well");
                self.warnings.push(text);
            }
        }
    }
}

/// Two counts that leave something of so many and one more: the larger one gives way, of equal ones the second.
fn fitted(mut counts: [usize; 2], most: usize) -> [usize; 2] {
    while counts[0] + counts[1] > most {
        let larger = usize::from(counts[1] >= counts[0]);
        counts[larger] -= 1;
    }
    counts
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    fn entry(name: &str, subset: Option<Subset>) -> Entry {
        Entry { category: "car".into(), name: name.into(), views: 1, subset }
    }

    fn objects(count: usize) -> Vec<Entry> {
        (0..count).map(|i| entry(&format!("{i:04}"), None)).collect()
    }

    fn sizes(parts: &Subsets) -> [usize; 3] {
        [&parts.train, &parts.validation, &parts.test].map(Vec::len)
    }

    #[test]
    fn without_lists_a_hash_deals() {
        let parts = Subsets::of(&objects(2000), Some(5)).unwrap();
        let [train, validation, test] = sizes(&parts);
        assert_eq!(train + validation + test, 2000);
        assert!((160..240).contains(&validation) && (160..240).contains(&test), "{parts:?}");
        assert!(parts.warnings.is_empty());
        // Others that come or go move nobody.
        let fewer = Subsets::of(&objects(2000)[..1500], Some(5)).unwrap();
        for (_, subset) in Subset::NAMES {
            let there: Vec<usize> =
                parts.get(subset).iter().copied().filter(|&i| i < 1500).collect();
            assert_eq!(fewer.get(subset), there);
        }
        let half = sizes(&Subsets::of(&objects(2000), Some(2)).unwrap());
        assert!((900..1100).contains(&half[0]), "{half:?}");
    }

    #[test]
    fn few_objects_are_parted_as_far_as_they_go() {
        let of = |count: usize, hold_out| Subsets::of(&objects(count), hold_out).unwrap();
        for count in 3..12 {
            let parts = of(count, Some(5));
            assert!(sizes(&parts).iter().all(|&size| size > 0) && parts.warnings.is_empty());
            assert_eq!(sizes(&parts).iter().sum::<usize>(), count);
        }
        let two = of(2, Some(5));
        assert_eq!((sizes(&two), &two.validation), ([1, 1, 1], &two.test));
        assert!(two.train != two.test && two.warnings[0].contains("tests as well"), "{two:?}");
        let one = of(1, Some(5));
        assert_eq!((sizes(&one), one.warnings.len()), ([1; 3], 1));
        let all = of(7, None);
        assert_eq!((sizes(&all), all.warnings.len()), ([7; 3], 1));
        assert!(all.warnings[0].contains("trained on"));
    }

    #[test]
    fn lists_of_a_layout_stand() {
        let [train, validation, test] = Subset::NAMES.map(|(_, subset)| Some(subset));
        let all = [train, test, validation, None, test].into_iter().enumerate();
        let all: Vec<Entry> = all.map(|(i, s)| entry(&i.to_string(), s)).collect();
        let parts = Subsets::of(&all, Some(5)).unwrap();
        assert_eq!(
            (&*parts.train, &*parts.validation, &*parts.test),
            (&[0, 3][..], &[2][..], &[1, 4][..])
        );
        // What is missing is dealt out of training; tests are never chosen by, nor trained on.
        let mut more: Vec<Entry> = objects(400);
        more.iter_mut().enumerate().for_each(|(i, e)| e.subset = if i < 40 { test } else { train });
        let parts = Subsets::of(&more, Some(5)).unwrap();
        assert_eq!(parts.test, (0..40).collect::<Vec<_>>());
        assert!((20..55).contains(&parts.validation.len()), "{parts:?}");
        for (list, given) in [(test, [1, 1, 1]), (validation, [1, 1, 1])] {
            let two = [entry("a", train), entry("b", list)];
            let parts = Subsets::of(&two, Some(5)).unwrap();
            assert_eq!((sizes(&parts), parts.train[0], parts.warnings.len()), (given, 0, 1));
        }
        // Nothing to train on: nothing is made up.
        let only = Subsets::of(&[entry("a", test), entry("b", test)], Some(5)).unwrap();
        assert_eq!(sizes(&only), [0, 0, 2]);
        // An object without views is nobody's.
        let blind = Entry { views: 0, ..entry("c", train) };
        assert_eq!(sizes(&Subsets::of(&[blind], Some(5)).unwrap()), [0; 3]);
    }

    #[test]
    fn leaks_are_found_by_name() {
        let [train, validation, test] = Subset::NAMES.map(|(_, subset)| Some(subset));
        let of = |all: &[Entry]| Subsets::of(all, Some(5));
        let leak = of(&[entry("b", train), entry("a/00", train), entry("a/07", test)]).unwrap_err();
        assert_eq!((&*leak.object, leak.subsets), ("car/a", [Subset::Train, Subset::Test]));
        let text = leak.to_string();
        assert!(["car/a", "train", "test"].iter().all(|word| text.contains(word)), "{text}");
        let twice = of(&[entry("a", validation), entry("a", test)]).unwrap_err();
        assert_eq!(twice.subsets, [Subset::Validation, Subset::Test]);
        // Views of one object are dealt together; the same name in another category is another object.
        let views: Vec<Entry> =
            (0..60).map(|i| entry(&format!("{}/{}", i % 20, i / 20), None)).collect();
        let parts = of(&views).unwrap();
        assert!(sizes(&parts).iter().all(|size| size % 3 == 0 && *size > 0));
        let other = Entry { category: "bus".into(), ..entry("a", test) };
        assert!(of(&[entry("a", train), other]).is_ok());
        // Planted by hand.
        let mut parts = of(&objects(30)).unwrap();
        let planted = parts.test[0];
        parts.train.push(planted);
        let leak = parts.check(&objects(30)).unwrap_err();
        assert_eq!(leak.object, format!("car/{planted:04}"));
    }

    #[test]
    fn held_out_views_are_for_validation_and_test_by_turns() {
        let parts = Subsets::of_views(100, &[], Some(5));
        assert_eq!((sizes(&parts), parts.validation[1], parts.test[0]), ([80, 10, 10], 14, 9));
        let few = Subsets::of_views(6, &[], Some(5));
        assert_eq!((&*few.validation, &*few.test, few.warnings.len()), (&[4][..], &[4][..], 1));
        let kept = Subsets::of_views(8, &[1, 6], Some(3));
        assert_eq!((&*kept.train, &*kept.validation), (&[0, 2, 4, 5][..], &[3, 7][..]));
        assert_eq!(kept.test, [1, 6]);
        let none = Subsets::of_views(6, &[], None);
        assert_eq!((sizes(&none), none.warnings.len()), ([6; 3], 1));
    }
}
