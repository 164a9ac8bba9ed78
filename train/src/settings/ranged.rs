//! Values that have a range, and what it is called.

use std::fmt::Display;
use std::ops::{Bound, RangeBounds};

/// A value of an option that can be held to a range, number by number.
///
/// Of an optional value that is absent nothing is asked; of a list, the same of each.
pub trait Ranged {
    /// The numbers that it is made of.
    type Number: PartialOrd + Display + Copy;

    /// Whether all of it is within a range.
    fn is_within(&self, range: &impl RangeBounds<Self::Number>) -> bool;

    /// The value as an error shows it.
    fn shown(&self) -> String;
}

macro_rules! numbers {
    ($($number:ty),+) => {
        $(impl Ranged for $number {
            type Number = Self;

            fn is_within(&self, range: &impl RangeBounds<Self>) -> bool {
                range.contains(self)
            }

            fn shown(&self) -> String {
                self.to_string()
            }
        })+
    };
}
numbers!(u8, u32, u64, usize, f32, f64);

impl<T: Ranged> Ranged for Option<T> {
    type Number = T::Number;

    fn is_within(&self, range: &impl RangeBounds<T::Number>) -> bool {
        self.as_ref().is_none_or(|value| value.is_within(range))
    }

    fn shown(&self) -> String {
        self.as_ref().map_or_else(|| super::optional::NONE.to_owned(), Ranged::shown)
    }
}

impl<T: Ranged, const N: usize> Ranged for [T; N] {
    type Number = T::Number;

    fn is_within(&self, range: &impl RangeBounds<T::Number>) -> bool {
        self.iter().all(|value| value.is_within(range))
    }

    fn shown(&self) -> String {
        listed(self)
    }
}

impl<T: Ranged> Ranged for Vec<T> {
    type Number = T::Number;

    fn is_within(&self, range: &impl RangeBounds<T::Number>) -> bool {
        self.iter().all(|value| value.is_within(range))
    }

    fn shown(&self) -> String {
        listed(self)
    }
}

fn listed<T: Ranged>(values: &[T]) -> String {
    format!("[{}]", values.iter().map(Ranged::shown).collect::<Vec<_>>().join(", "))
}

/// The largest integer that TOML can say.
pub const LARGEST: u64 = i64::MAX as u64;

/// The numbers above one and up to another.
pub fn above_to<T>(least: T, most: T) -> (Bound<T>, Bound<T>) {
    (Bound::Excluded(least), Bound::Included(most))
}

/// A range in words, of the type that a value has: `1 to 64`, `above 0 to 1000`, `0 to less than 1`, `at least 2`.
pub fn range_of<T: Ranged>(_: &T, range: &impl RangeBounds<T::Number>) -> String {
    let end = match range.end_bound() {
        // Any number, but for infinity.
        Bound::Included(end) if end.to_string() == f64::MAX.to_string() => None,
        Bound::Included(end) => Some(shown(end)),
        Bound::Excluded(end) => Some(format!("less than {end}")),
        Bound::Unbounded => None,
    };
    match (range.start_bound(), end) {
        (Bound::Included(start), Some(end)) => format!("{start} to {end}"),
        (Bound::Excluded(start), Some(end)) => format!("above {start} to {end}"),
        (Bound::Included(start), None) => format!("at least {start}"),
        (Bound::Excluded(start), None) => format!("above {start}"),
        (Bound::Unbounded, Some(end)) => format!("at most {end}").replace("at most less", "less"),
        (Bound::Unbounded, None) => "any".to_owned(),
    }
}

/// A number; the largest as it is written.
fn shown(number: &impl Display) -> String {
    let text = number.to_string();
    if text == LARGEST.to_string() { "2^63 - 1".to_owned() } else { text }
}

/// A sentence if a value is not within its range.
pub fn out_of_range<T: Ranged>(
    key: &str,
    value: &T,
    range: &impl RangeBounds<T::Number>,
) -> Option<String> {
    (!value.is_within(range))
        .then(|| format!("`{key}` is {}, expected {}", value.shown(), range_of(value, range)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use Bound::{Excluded, Included};

    #[test]
    fn ranges_have_names_and_hold_lists_and_options() {
        let of = |range: (Bound<f64>, Bound<f64>)| range_of(&0.5, &range);
        assert_eq!(of((Included(0.0), Excluded(1.0))), "0 to less than 1");
        assert_eq!(of(above_to(0.0, 1e3)), "above 0 to 1000");
        assert_eq!(of(above_to(0.0, f64::MAX)), "above 0");
        assert_eq!(range_of(&1_u64, &(2..=LARGEST)), "2 to 2^63 - 1");
        assert_eq!(of((Excluded(0.0), Bound::Unbounded)), "above 0");
        assert_eq!(range_of(&Some(3_usize), &(2..)), "at least 2");
        assert_eq!(out_of_range("a", &None::<u64>, &(2..=5)), None);
        let found = out_of_range("channels", &[1_usize, 9], &(2..=5));
        assert_eq!(found.as_deref(), Some("`channels` is [1, 9], expected 2 to 5"));
        // What is not a number is in no range.
        assert!(out_of_range("x", &f64::NAN, &(0.0..)).is_some());
    }
}
