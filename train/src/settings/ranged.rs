//! Values that have a range, and what it is called.

use std::fmt::Display;
use std::ops::{Bound, RangeBounds};

/// A value of an option that can be held to a range, number by number.
///
/// Of an optional value that is absent nothing is asked; of a list, the same of each.
pub trait Ranged {
    /// What it is made of.
    type Number: PartialOrd + Display + Copy;
    /// Whether errors show it as a list.
    const LIST: bool = false;

    /// The numbers that it is made of.
    fn numbers(&self) -> &[Self::Number];
}

macro_rules! numbers {
    ($($number:ty),+) => {
        $(impl Ranged for $number {
            type Number = Self;

            fn numbers(&self) -> &[Self] {
                std::slice::from_ref(self)
            }
        })+
    };
}
numbers!(u8, u32, u64, usize, f32, f64);

impl<T: PartialOrd + Display + Copy> Ranged for Option<T> {
    type Number = T;

    fn numbers(&self) -> &[T] {
        self.as_slice()
    }
}

impl<T: PartialOrd + Display + Copy, const N: usize> Ranged for [T; N] {
    type Number = T;
    const LIST: bool = true;

    fn numbers(&self) -> &[T] {
        self
    }
}

impl<T: PartialOrd + Display + Copy> Ranged for Vec<T> {
    type Number = T;
    const LIST: bool = true;

    fn numbers(&self) -> &[T] {
        self
    }
}

/// The largest integer that TOML can say.
pub const LARGEST: u64 = i64::MAX as u64;

/// The numbers above one and up to another.
pub fn above_to<T>(least: T, most: T) -> (Bound<T>, Bound<T>) {
    (Bound::Excluded(least), Bound::Included(most))
}

/// A range in words, of the type that a value has: `1 to 64`, `above 0 to 1000`, `0 to less than 1`, `at least 2`.
pub fn range_of<T: Ranged>(_: &T, range: &impl RangeBounds<T::Number>) -> String {
    words(range.start_bound().map(ToString::to_string), range.end_bound().map(ToString::to_string))
}

/// A sentence if a value is not within its range; dashes of the key may be underscores.
pub fn out_of_range<T: Ranged>(
    key: &str,
    value: &T,
    range: &impl RangeBounds<T::Number>,
) -> Option<String> {
    let numbers = value.numbers();
    if numbers.iter().all(|number| range.contains(number)) {
        return None;
    }
    let found: Vec<String> = numbers.iter().map(ToString::to_string).collect();
    Some(sentence(key, &found, T::LIST, &range_of(value, range)))
}

/// What is wrong with numbers.
fn sentence(key: &str, found: &[String], is_list: bool, expected: &str) -> String {
    let key = key.replace('_', "-");
    let found = found.join(", ");
    let found = if is_list { format!("[{found}]") } else { found };
    format!("`{key}` is {found}, expected {expected}")
}

/// A range by its bounds in digits.
fn words(start: Bound<String>, end: Bound<String>) -> String {
    let end = match end {
        // Any number, but for infinity.
        Bound::Included(end) if end == f64::MAX.to_string() => None,
        // As it is written.
        Bound::Included(end) if end == LARGEST.to_string() => Some("2^63 - 1".to_owned()),
        Bound::Included(end) => Some(end),
        Bound::Excluded(end) => Some(format!("less than {end}")),
        Bound::Unbounded => None,
    };
    match (start, end) {
        (Bound::Included(start), Some(end)) => format!("{start} to {end}"),
        (Bound::Excluded(start), Some(end)) => format!("above {start} to {end}"),
        (Bound::Included(start), None) => format!("at least {start}"),
        (Bound::Excluded(start), None) => format!("above {start}"),
        (Bound::Unbounded, Some(end)) => format!("at most {end}").replace("at most less", "less"),
        (Bound::Unbounded, None) => "any".to_owned(),
    }
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
