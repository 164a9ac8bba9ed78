//! The order in which people number files: 2 before 10.

use std::cmp::Ordering;

/// What names are sorted by: texts as they are, numbers by their value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Part<'a> {
    /// How many digits without leading zeros, those digits, and how many zeros led them.
    Number(usize, &'a str, usize),
    Text(&'a str),
}

/// Compares names naturally; different names are never equal. Nothing is allocated for it, since
/// names of files' own choosing may have very many parts.
pub(crate) fn compare(a: &str, b: &str) -> Ordering {
    parts(a).cmp(parts(b))
}

fn parts(name: &str) -> impl Iterator<Item = Part<'_>> {
    let mut rest = name;
    std::iter::from_fn(move || {
        if rest.is_empty() {
            return None;
        }
        let digits = rest.bytes().take_while(u8::is_ascii_digit).count();
        if digits > 0 {
            let number = rest[..digits].trim_start_matches('0');
            rest = &rest[digits..];
            return Some(Part::Number(number.len(), number, digits - number.len()));
        }
        let end = rest.find(|c: char| c.is_ascii_digit()).unwrap_or(rest.len());
        let (text, behind) = rest.split_at(end);
        rest = behind;
        Some(Part::Text(text))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_count_by_their_value() {
        let mut names = vec!["b", "a10", "a2", "a02", "a", "10", "9", "a2b", "2/1", "10/1"];
        names.sort_by(|a, b| compare(a, b));
        assert_eq!(names, ["2/1", "9", "10", "10/1", "a", "a2", "a2b", "a02", "a10", "b"]);
        let nines = "9".repeat(26);
        assert_eq!(parts(&nines).next(), Some(Part::Number(26, nines.as_str(), 0)));
    }
}
