//! Texts as protocol 0 writes them, and bytes that are written as texts.

use crate::value::Value;

/// A line of protocol 0, Unicode: Latin-1 with `\uXXXX` for the rest.
pub(crate) fn unicode(line: &[u8]) -> String {
    let (mut out, mut rest) = (String::with_capacity(line.len()), line);
    while let Some((&b, after)) = rest.split_first() {
        let digits = rest.strip_prefix(b"\\u").and_then(|d| d.get(..4));
        let code = digits.and_then(|d| u32::from_str_radix(std::str::from_utf8(d).ok()?, 16).ok());
        if let Some(c) = code.and_then(char::from_u32) {
            out.push(c);
            rest = &rest[6..];
        } else {
            out.push(char::from(b));
            rest = after;
        }
    }
    out
}

/// A line of protocol 0, quoted, with the escapes of Python's literals.
pub(crate) fn quoted<'a>(line: &[u8]) -> Value<'a> {
    let inner = if line.len() >= 2 { &line[1..line.len() - 1] } else { line };
    let (mut out, mut rest) = (Vec::with_capacity(inner.len()), inner);
    while let Some((&b, after)) = rest.split_first() {
        rest = after;
        if b != b'\\' {
            out.push(b);
            continue;
        }
        let Some((&escape, after)) = rest.split_first() else { break };
        rest = after;
        let hex = |d: &[u8]| u8::from_str_radix(std::str::from_utf8(d).ok()?, 16).ok();
        match escape {
            b'n' => out.push(b'\n'),
            b'r' => out.push(b'\r'),
            b't' => out.push(b'\t'),
            b'x' if rest.len() >= 2 => {
                out.extend(hex(&rest[..2]));
                rest = &rest[2..];
            }
            other => out.push(other),
        }
    }
    match String::from_utf8(out) {
        Ok(text) => Value::Text(text.into()),
        Err(error) => Value::Bytes(error.into_bytes().into()),
    }
}

/// The bytes that a text's characters stand for.
pub(crate) fn latin(text: &str) -> Option<Vec<u8>> {
    text.chars().map(|c| u8::try_from(u32::from(c)).ok()).collect()
}
