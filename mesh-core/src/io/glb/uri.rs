//! What stands in a URI.

/// The bytes of a `data:` URI in base 64; `None` where it is none.
pub(super) fn data(uri: &str) -> Option<Vec<u8>> {
    let (kind, text) = uri.strip_prefix("data:")?.split_once(',')?;
    kind.strip_suffix(";base64")?;
    let mut bytes = Vec::with_capacity(text.len() / 4 * 3 + 3);
    let (mut bits, mut count) = (0_u32, 0);
    for digit in text.trim_end_matches('=').bytes() {
        let value = match digit {
            b'A'..=b'Z' => digit - b'A',
            b'a'..=b'z' => digit - b'a' + 26,
            b'0'..=b'9' => digit - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        };
        (bits, count) = (bits << 6 | u32::from(value), count + 6);
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count) as u8);
        }
    }
    Some(bytes)
}

/// A name without its `%20` and the like; `None` where it has none, or they stand for no text.
pub(super) fn decoded(name: &str) -> Option<String> {
    let mut parts = name.split('%');
    let mut bytes = parts.next()?.as_bytes().to_vec();
    for part in parts {
        let digits = part.get(..2).filter(|d| d.bytes().all(|b| b.is_ascii_hexdigit()))?;
        bytes.push(u8::from_str_radix(digits, 16).ok()?);
        bytes.extend_from_slice(&part.as_bytes()[2..]);
    }
    String::from_utf8(bytes).ok().filter(|decoded| decoded != name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base_64() {
        for (text, bytes) in
            [("", &b""[..]), ("Zg==", b"f"), ("Zm8", b"fo"), ("+/8A", b"\xfb\xff\0")]
        {
            assert_eq!(data(&format!("data:image/png;base64,{text}")).as_deref(), Some(bytes));
        }
        for uri in ["a.png", "data:", "data:text/plain,abcd", "data:image/png;base64,a b"] {
            assert_eq!(data(uri), None, "{uri}");
        }
    }

    #[test]
    fn names_with_percent_signs() {
        assert_eq!(decoded("a%20b%2Fc.png").as_deref(), Some("a b/c.png"));
        assert_eq!(decoded("%C3%A9%20").as_deref(), Some("\u{e9} "));
        for name in ["a.png", "100%", "%zz", "%2", "%\u{e9}", "%ff"] {
            assert_eq!(decoded(name), None, "{name}");
        }
    }
}
