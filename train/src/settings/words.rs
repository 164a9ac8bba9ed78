//! What `serde` says of a value that does not fit, in the words of those who write configurations.

/// A message in which `invalid type: string "x", expected u32` became `found "x", expected a whole number from 0`.
pub(super) fn plain(message: &str) -> String {
    let message = message.trim_end();
    let (before, rest) = match ["invalid type: ", "invalid value: ", "invalid length "]
        .into_iter()
        .find_map(|kind| message.split_once(kind).map(|(before, rest)| (before, kind, rest)))
    {
        Some((before, "invalid length ", rest)) => (before, format!("length {rest}")),
        Some((before, _, rest)) => (before, rest.to_owned()),
        None => return message.to_owned(),
    };
    let Some((found, expected)) = rest.split_once(", expected ") else {
        return message.to_owned();
    };
    // What may be absent says so behind its type.
    let (expected, or_none) = match expected.find(", or \"") {
        Some(at) => expected.split_at(at),
        None => (expected, ""),
    };
    format!("{before}found {}, expected {}{or_none}", self::found(found), self::expected(expected))
}

/// A value as it was written.
fn found(text: &str) -> String {
    let quoted = |text: &str| text.trim_matches('`').to_owned();
    for kind in ["integer ", "boolean ", "floating point "] {
        if let Some(value) = text.strip_prefix(kind) {
            return quoted(value);
        }
    }
    match text {
        "sequence" => "a list".to_owned(),
        "map" => "a table".to_owned(),
        "unit variant" => "something else".to_owned(),
        _ => match text.strip_prefix("length ") {
            Some(count) => format!("a list of {count}"),
            None => text.strip_prefix("string ").unwrap_or(text).to_owned(),
        },
    }
}

/// What a type takes.
fn expected(text: &str) -> String {
    match text {
        "u8" | "u16" | "u32" | "u64" | "usize" => "a whole number from 0".to_owned(),
        "i8" | "i16" | "i32" | "i64" | "isize" => "a whole number".to_owned(),
        "f32" | "f64" => "a number".to_owned(),
        "a boolean" => "true or false".to_owned(),
        "a string" | "a string or map" | "string only" | "a character" => {
            "text in quotes".to_owned()
        }
        "a sequence" => "a list, as [1, 2]".to_owned(),
        "a map" => "a table".to_owned(),
        _ => {
            let of = |before: &str| text.strip_prefix(before);
            if let Some(count) = of("an array of length ").or_else(|| of("a tuple of size ")) {
                return format!("a list of {count}");
            }
            if of("struct ").is_some() { "a table".to_owned() } else { text.to_owned() }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::plain;

    #[test]
    fn types_have_plain_names() {
        for (said, expected) in [
            (
                "`a`: invalid type: string \"x\", expected u32",
                "`a`: found \"x\", expected a whole number from 0",
            ),
            (
                "invalid value: integer `-5`, expected usize\n",
                "found -5, expected a whole number from 0",
            ),
            ("invalid type: boolean `true`, expected f64", "found true, expected a number"),
            (
                "invalid type: floating point `2.5`, expected a boolean",
                "found 2.5, expected true or false",
            ),
            ("invalid type: integer `2`, expected a string", "found 2, expected text in quotes"),
            ("invalid type: map, expected a sequence", "found a table, expected a list, as [1, 2]"),
            (
                "invalid length 2, expected an array of length 3",
                "found a list of 2, expected a list of 3",
            ),
            (
                "`a`: invalid type: sequence, expected u64, or \"none\"",
                "`a`: found a list, expected a whole number from 0, or \"none\"",
            ),
            ("unknown field `levle`, expected `level`", "unknown field `levle`, expected `level`"),
        ] {
            assert_eq!(plain(said), expected);
        }
    }
}
