//! JSON that can be read and compared line by line: what is flat stands on one line.

use serde_json::Value;

/// What is nested no deeper stands on one line, unless it is a list of entries: a row of numbers, an entry with one.
const FLAT: usize = 2;

/// A value as text, with an end of line.
pub(crate) fn laid_out(value: &Value) -> String {
    let mut text = String::new();
    write(value, 0, &mut text);
    text.push('\n');
    text
}

fn write(value: &Value, indent: usize, text: &mut String) {
    let entries: Vec<(Option<&String>, &Value)> = match value {
        Value::Array(items) if !is_flat(value) => items.iter().map(|item| (None, item)).collect(),
        Value::Object(fields) if !is_flat(value) => {
            fields.iter().map(|(name, field)| (Some(name), field)).collect()
        }
        flat => {
            text.push_str(&flat.to_string());
            return;
        }
    };
    let brackets = if value.is_array() { ['[', ']'] } else { ['{', '}'] };
    text.push(brackets[0]);
    for (k, (name, entry)) in entries.into_iter().enumerate() {
        text.push_str(if k == 0 { "\n" } else { ",\n" });
        text.extend(std::iter::repeat_n(' ', indent + 1));
        if let Some(name) = name {
            text.push_str(&Value::from(name.as_str()).to_string());
            text.push_str(": ");
        }
        write(entry, indent + 1, text);
    }
    text.push('\n');
    text.extend(std::iter::repeat_n(' ', indent));
    text.push(brackets[1]);
}

fn is_flat(value: &Value) -> bool {
    let entries = value.as_array().is_some_and(|items| items.iter().any(Value::is_object));
    !entries && depth(value) <= FLAT
}

/// Levels of nesting: none for a number, one for a list of numbers.
fn depth(value: &Value) -> usize {
    match value {
        Value::Array(items) => 1 + items.iter().map(depth).max().unwrap_or(0),
        Value::Object(fields) => 1 + fields.values().map(depth).max().unwrap_or(0),
        _ => 0,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn what_is_flat_stands_on_one_line() {
        let text = r#"{"a":[1,2],"b":[{"c":[0.5,null],"d":"x\"y"},{"c":[],"d":""}]}"#;
        let value: Value = serde_json::from_str(text).unwrap();
        let laid = laid_out(&value);
        assert_eq!(
            laid,
            "{\n \"a\": [1,2],\n \"b\": [\n  {\"c\":[0.5,null],\"d\":\"x\\\"y\"},\n  {\"c\":[],\"d\":\"\"}\n ]\n}\n"
        );
        let entries: Value = serde_json::from_str(r#"[{"a":1},{"a":2}]"#).unwrap();
        assert_eq!(laid_out(&entries), "[\n {\"a\":1},\n {\"a\":2}\n]\n");
        assert_eq!(serde_json::from_str::<Value>(&laid).unwrap(), value);
    }
}
