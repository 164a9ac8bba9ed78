//! The order in which people number files: 2 before 10.

/// What names are sorted by: texts as they are, numbers by their value.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Part {
    /// How many digits without leading zeros, those digits, and how many zeros led them.
    Number(usize, String, usize),
    Text(String),
}

/// The key that sorts names naturally; different names have different keys.
pub(crate) fn key(name: &str) -> Vec<Part> {
    let mut parts = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let digits = rest.bytes().take_while(u8::is_ascii_digit).count();
        if digits > 0 {
            let number = rest[..digits].trim_start_matches('0');
            parts.push(Part::Number(number.len(), number.to_owned(), digits - number.len()));
            rest = &rest[digits..];
        } else {
            let end = rest.find(|c: char| c.is_ascii_digit()).unwrap_or(rest.len());
            parts.push(Part::Text(rest[..end].to_owned()));
            rest = &rest[end..];
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_count_by_their_value() {
        let mut names = vec!["b", "a10", "a2", "a02", "a", "10", "9", "a2b", "2/1", "10/1"];
        names.sort_by_key(|name| key(name));
        assert_eq!(names, ["2/1", "9", "10", "10/1", "a", "a2", "a2b", "a02", "a10", "b"]);
        assert_eq!(key("99999999999999999999999999")[0], Part::Number(26, "9".repeat(26), 0));
    }
}
