//! The part of YAML that programs write for numbers and names: mappings, sequences, plain and
//! quoted scalars, in block and in `[flow]` style, over as many lines as they take.
//!
//! What people write beyond that (anchors and aliases, tags, `{flow}` mappings, block scalars,
//! several documents) is refused by name. So nothing is ever copied or called into being by a
//! file: what comes out is no larger than what came in. The result is JSON's tree, so that
//! [`crate::formats::json::Node`] reads it and names the place of what is wrong.

use std::path::Path;

use serde_json::{Map, Number, Value};

use crate::content::cut;
use crate::error::ReadViewsError;

/// How deep mappings and sequences may nest.
const DEPTH: usize = 16;

/// Parses a document.
///
/// # Errors
/// Text that is not UTF-8, or a line that is not of the part that is read.
pub(crate) fn parse(bytes: &[u8], file: &Path) -> Result<Value, ReadViewsError> {
    let text = std::str::from_utf8(bytes).map_err(|error| {
        let found = format!("byte {} is none", error.valid_up_to());
        ReadViewsError::field(file, "text", found, "UTF-8")
    })?;
    let mut lines = Vec::new();
    for (k, line) in text.lines().enumerate() {
        let line = without_comment(line).trim_end();
        let text = line.trim_start_matches(' ');
        if text.is_empty() || (lines.is_empty() && (text == "---" || text.starts_with('%'))) {
            continue;
        }
        if text == "..." {
            break;
        }
        lines.push(Line { number: k + 1, indent: line.len() - text.len(), text });
    }
    let mut parser = Parser { file, lines, at: 0 };
    let value = match parser.lines.first() {
        None => Value::Null,
        Some(first) => parser.block(first.indent, 0)?,
    };
    match parser.lines.get(parser.at) {
        None => Ok(value),
        Some(line) => Err(parser.wrong(line, "a line that belongs to what is above")),
    }
}

/// A line without its comment, and what stands in front of it.
#[derive(Clone, Copy)]
struct Line<'a> {
    number: usize,
    indent: usize,
    text: &'a str,
}

struct Parser<'a> {
    file: &'a Path,
    lines: Vec<Line<'a>>,
    at: usize,
}

/// Cuts what follows a `#` that is not part of a word or of a quoted text.
fn without_comment(line: &str) -> &str {
    let mut quote = None;
    let mut before = ' ';
    for (at, c) in line.char_indices() {
        match quote {
            Some(open) if c == open && before != '\\' => quote = None,
            None if c == '#' && before == ' ' => return &line[..at],
            // A quote within a word is an apostrophe, a doubled one goes on with the text.
            None if (c == '"' || c == '\'') && matches!(before, ' ' | '[' | ',' | '\'') => {
                quote = Some(c);
            }
            Some(_) | None => {}
        }
        before = c;
    }
    line
}

/// The key and what follows it, where the text is an entry of a mapping.
fn entry(text: &str) -> Option<(&str, &str)> {
    let (key, rest) = match text.find(": ") {
        Some(at) => (&text[..at], text[at + 2..].trim_start()),
        None => (text.strip_suffix(':')?, ""),
    };
    let plain = |c: char| c.is_alphanumeric() || "_-. /".contains(c);
    (!key.is_empty() && key.chars().all(plain)).then_some((key, rest))
}

fn item(text: &str) -> Option<&str> {
    if text == "-" { Some("") } else { text.strip_prefix("- ") }
}

impl<'a> Parser<'a> {
    fn wrong(&self, line: &Line<'_>, expected: &str) -> ReadViewsError {
        let (place, found) = (format!("line {}", line.number), cut(line.text));
        ReadViewsError::field(self.file, place, format!("{found:?}"), expected)
    }

    /// What stands at this indent, from the current line on.
    fn block(&mut self, indent: usize, depth: usize) -> Result<Value, ReadViewsError> {
        let line = self.lines[self.at];
        if depth > DEPTH {
            return Err(self.wrong(&line, &format!("at most {DEPTH} levels")));
        }
        if item(line.text).is_some() {
            return self.sequence(indent, depth);
        }
        if entry(line.text).is_some() && !line.text.starts_with(['"', '\'', '[', '{']) {
            return self.mapping(indent, depth);
        }
        self.at += 1;
        self.inline(line, line.text, depth)
    }

    fn sequence(&mut self, indent: usize, depth: usize) -> Result<Value, ReadViewsError> {
        let mut out = Vec::new();
        while let Some(&line) = self.lines.get(self.at).filter(|line| line.indent == indent) {
            let Some(rest) = item(line.text) else { break };
            let rest = rest.trim_start();
            if rest.is_empty() {
                self.at += 1;
                out.push(self.below(indent, depth, false)?);
            } else {
                // What follows the dash is a block of its own, at its own indent.
                let inner = indent + line.text.len() - rest.len();
                self.lines[self.at] = Line { indent: inner, text: rest, ..line };
                out.push(self.block(inner, depth + 1)?);
            }
        }
        Ok(Value::Array(out))
    }

    fn mapping(&mut self, indent: usize, depth: usize) -> Result<Value, ReadViewsError> {
        let mut out = Map::new();
        while let Some(&line) = self.lines.get(self.at).filter(|line| line.indent == indent) {
            let Some((key, rest)) = entry(line.text) else { break };
            self.at += 1;
            let value = if rest.is_empty() {
                self.below(indent, depth, true)?
            } else {
                self.inline(line, rest, depth)?
            };
            if out.insert(key.to_owned(), value).is_some() {
                return Err(self.wrong(&line, "a key that is not there yet"));
            }
        }
        Ok(Value::Object(out))
    }

    /// What stands below a key or a dash that has nothing behind it. The dashes of a key's
    /// sequence may stand right under the key.
    fn below(&mut self, indent: usize, depth: usize, key: bool) -> Result<Value, ReadViewsError> {
        match self.lines.get(self.at) {
            Some(next) if next.indent > indent => self.block(next.indent, depth + 1),
            Some(next) if key && next.indent == indent && item(next.text).is_some() => {
                self.block(indent, depth + 1)
            }
            _ => Ok(Value::Null),
        }
    }

    /// A value on the line itself, which a flow sequence may leave for those that follow.
    fn inline(
        &mut self,
        line: Line<'a>,
        text: &str,
        depth: usize,
    ) -> Result<Value, ReadViewsError> {
        if !text.starts_with('[') {
            return scalar(text).ok_or_else(|| {
                self.wrong(&line, "a number, a word or a list (no tags, anchors or block texts)")
            });
        }
        let mut whole = text.to_owned();
        // Line by line: to look at all of it again with each would take a file of many lines the square of them.
        let mut brackets = Brackets::default();
        brackets.read(text);
        while !brackets.are_closed() {
            let Some(next) = self.lines.get(self.at) else { break };
            self.at += 1;
            whole.push(' ');
            whole.push_str(next.text);
            brackets.read(next.text);
        }
        let mut rest = whole.as_str();
        let value = flow(&mut rest, depth + 1);
        value.filter(|_| rest.trim().is_empty()).ok_or_else(|| {
            self.wrong(&line, "a list in brackets that are closed, of numbers, words or lists")
        })
    }
}

/// How many brackets outside quotes are open, and the quote that is.
#[derive(Default)]
struct Brackets {
    open: i64,
    quote: Option<char>,
}

impl Brackets {
    /// Goes on over the text that follows.
    fn read(&mut self, text: &str) {
        for c in text.chars() {
            match (self.quote, c) {
                (Some(quote), _) if c == quote => self.quote = None,
                (None, '"' | '\'') => self.quote = Some(c),
                (None, '[') => self.open += 1,
                (None, ']') => self.open -= 1,
                (Some(_) | None, _) => {}
            }
        }
    }

    fn are_closed(&self) -> bool {
        self.open <= 0
    }
}

/// A flow sequence or a scalar in one, at the start of the text, which is moved behind it.
fn flow(text: &mut &str, depth: usize) -> Option<Value> {
    *text = text.trim_start();
    let Some(inside) = text.strip_prefix('[') else {
        let end = match text.chars().next()? {
            quote @ ('"' | '\'') => text[1..].find(quote)? + 2,
            _ => text.find([',', ']'])?,
        };
        let (word, rest) = text.split_at(end);
        *text = rest;
        return scalar(word.trim());
    };
    if depth > DEPTH {
        return None;
    }
    *text = inside.trim_start();
    let mut out = Vec::new();
    loop {
        if let Some(rest) = text.strip_prefix(']') {
            *text = rest;
            return Some(Value::Array(out));
        }
        out.push(flow(text, depth + 1)?);
        *text = text.trim_start();
        match text.strip_prefix(',') {
            Some(rest) => *text = rest.trim_start(),
            None if text.starts_with(']') => {}
            None => return None,
        }
    }
}

/// A number, a word, a quoted text; nothing for what only YAML's other parts begin with.
fn scalar(text: &str) -> Option<Value> {
    match text.chars().next()? {
        '&' | '*' | '!' | '|' | '>' | '{' | '}' | '[' | ']' | '%' | '@' | '`' | '?' => return None,
        '"' => return serde_json::from_str::<String>(text).ok().map(Value::String),
        '\'' => {
            let inner = text.strip_prefix('\'')?.strip_suffix('\'')?;
            return Some(Value::String(inner.replace("''", "'")));
        }
        _ => {}
    }
    Some(match text {
        "null" | "~" => Value::Null,
        "true" | "True" => Value::Bool(true),
        "false" | "False" => Value::Bool(false),
        _ => match text.parse::<f64>().ok().and_then(Number::from_f64) {
            Some(number) => Value::Number(number),
            None => Value::String(text.to_owned()),
        },
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use serde_json::json;

    fn read(text: &str) -> Value {
        parse(text.as_bytes(), Path::new("a.yaml")).unwrap()
    }

    fn message(text: &str) -> String {
        parse(text.as_bytes(), Path::new("a.yaml")).unwrap_err().to_string()
    }

    #[test]
    fn block_and_flow_say_the_same() {
        let block =
            "---\nname: a b.jpg\nsize:\n- 64\n- 96\nrows:\n- - 1.0\n  - -2\n- - 3e-05\n  - x\n";
        let indented = "name: a b.jpg # here\nsize:\n  - 64\n  - 96\n\nrows:\n  -\n    - 1.0\n    - -2\n  - - 3e-05\n    - x\n";
        let flow = "name: \"a b.jpg\"\nsize: [64, 96]\nrows: [[1.0, -2], [3e-05,\n    'x']]\n";
        let nested = "name: 'a b.jpg'\nsize: [64,\n  96]\nrows:\n- [1.0, -2]\n- [3e-05, x]\n...\n";
        let expected =
            json!({"name": "a b.jpg", "size": [64.0, 96.0], "rows": [[1.0, -2.0], [3e-05, "x"]]});
        for text in [block, indented, flow, nested] {
            assert_eq!(read(text), expected, "{text}");
        }
    }

    #[test]
    fn scalars_are_what_they_look_like() {
        let text = "a: ~\nb: true\nc: it's\nd: 'it''s # it'\ne: 2008_000021.jpg\nf: .nan\ng:\nh: a#b\ni: []\n";
        let expected = json!({"a": null, "b": true, "c": "it's", "d": "it's # it",
            "e": "2008_000021.jpg", "f": ".nan", "g": null, "h": "a#b", "i": []});
        assert_eq!(read(text), expected);
        assert_eq!(read(""), Value::Null);
        assert_eq!(read("- a: 1\n  b: 2\n- a: 3\n"), json!([{"a": 1.0, "b": 2.0}, {"a": 3.0}]));
    }

    #[test]
    fn what_is_not_read_is_named_by_its_line() {
        assert!(message("a: 1\nb: &x [1]\nc: *x\n").contains("`line 2`"));
        assert!(message("a: *x\n").contains("anchors"));
        assert!(message("a: !!python/object:numpy\n").contains("`line 1`"));
        assert!(message("a: {b: 1}\n").contains("`line 1`"));
        assert!(message("a: |\n  text\n").contains("`line 1`"));
        assert!(message("a: 1\n   b: 2\n").contains("`line 2`"));
        assert!(message("a: [1, 2\nb: 3\n").contains("closed"));
        assert!(message("a: 1\na: 2\n").contains("not there yet"));
        assert!(message(&("- ".repeat(5000) + "1")).contains("levels"));
        assert!(message(&format!("a: {}", "[".repeat(5000))).contains("closed"));
        assert!(parse(b"a: \xff", Path::new("a.yaml")).unwrap_err().to_string().contains("UTF-8"));
    }

    /// A megabyte of lines within one bracket: the square of them would take minutes.
    #[test]
    fn a_list_over_many_lines_is_read_line_by_line() {
        let count = 350_000;
        let open = format!("a: [\n{}", "1,\n".repeat(count));
        assert!(message(&open).contains("closed"));
        let read = read(&format!("{open}'[\n]', x]\nb: 2\n"));
        let list = read["a"].as_array().unwrap();
        assert_eq!((list.len(), &list[count], &read["b"]), (count + 2, &json!("[ ]"), &json!(2.0)));
    }

    proptest! {
        #[test]
        fn no_text_makes_it_panic(text in "[-a0:, \\[\\]'\"#\n&*{}.\u{e9}]{0,120}") {
            let _ = parse(text.as_bytes(), Path::new("a.yaml"));
        }
    }
}
