//! The wire format of protocol buffers, as far as ONNX files need it: fields and their lengths.

/// The fields of a message that lie in its bytes one after another.
pub(super) struct Fields<'a> {
    rest: &'a [u8],
}

/// The value of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Value<'a> {
    /// A number of any width.
    Number(u64),
    /// Text, bytes or a message.
    Bytes(&'a [u8]),
}

impl<'a> Fields<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes }
    }

    /// The next field, with its number.
    ///
    /// # Errors
    /// A length that reaches beyond the message, or something that no field begins with.
    pub(super) fn next(&mut self) -> Result<Option<(u64, Value<'a>)>, String> {
        if self.rest.is_empty() {
            return Ok(None);
        }
        let tag = self.varint()?;
        let value = match tag & 7 {
            0 => Value::Number(self.varint()?),
            1 => Value::Number(self.fixed::<8>().map(u64::from_le_bytes)?),
            5 => Value::Number(self.fixed::<4>().map(u32::from_le_bytes)?.into()),
            2 => {
                let length = self.varint()?;
                let Some(bytes) = usize::try_from(length).ok().and_then(|n| self.rest.get(..n))
                else {
                    let left = self.rest.len();
                    return Err(format!("a field claims {length} bytes where {left} are left"));
                };
                self.rest = &self.rest[bytes.len()..];
                Value::Bytes(bytes)
            }
            other => return Err(format!("a field is of wire type {other}, which ONNX has not")),
        };
        Ok(Some((tag >> 3, value)))
    }

    fn varint(&mut self) -> Result<u64, String> {
        let mut value = 0_u64;
        for (k, &byte) in self.rest.iter().take(10).enumerate() {
            if k == 9 && byte > 1 {
                break;
            }
            value |= u64::from(byte & 0x7f) << (7 * k);
            if byte < 0x80 {
                self.rest = &self.rest[k + 1..];
                return Ok(value);
            }
        }
        Err("a number does not end".to_owned())
    }

    fn fixed<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let (first, rest) = self.rest.split_first_chunk().ok_or("a number does not end")?;
        self.rest = rest;
        Ok(*first)
    }
}

/// The whole numbers of a repeated field: one, or many that are packed.
pub(super) fn numbers(value: Value<'_>) -> impl Iterator<Item = u64> {
    let (one, packed) = match value {
        Value::Number(number) => (Some(number), Fields::new(&[])),
        Value::Bytes(bytes) => (None, Fields::new(bytes)),
    };
    let mut packed = packed;
    one.into_iter().chain(std::iter::from_fn(move || packed.varint().ok()))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn fields_of_every_kind() {
        let bytes =
            [8, 0x96, 1, 0x12, 2, b'h', b'i', 0x1d, 1, 0, 0, 0, 0x21, 2, 0, 0, 0, 0, 0, 0, 0];
        let mut fields = Fields::new(&bytes);
        assert_eq!(fields.next().unwrap(), Some((1, Value::Number(150))));
        assert_eq!(fields.next().unwrap(), Some((2, Value::Bytes(b"hi"))));
        assert_eq!(fields.next().unwrap(), Some((3, Value::Number(1))));
        assert_eq!(fields.next().unwrap(), Some((4, Value::Number(2))));
        assert_eq!(fields.next().unwrap(), None);
        for end in 1..bytes.len() {
            let mut fields = Fields::new(&bytes[..end]);
            while let Ok(Some(_)) = fields.next() {}
        }
        let packed: Vec<u64> = numbers(Value::Bytes(&[1, 0x96, 1, 3])).collect();
        assert_eq!(packed, [1, 150, 3]);
    }

    #[test]
    fn lengths_that_lead_back_are_refused() {
        // -3, 0 - 1, and the longest number: none of them is a length.
        for length in [[0xfd, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 0xff, 1], [0xff; 10]] {
            assert!(Fields::new(&[&[0x12], &length[..]].concat()).next().is_err());
        }
        assert!(Fields::new(&[0x12, 2, 0]).next().is_err());
        assert!(Fields::new(&[0x0b]).next().is_err());
    }
}
