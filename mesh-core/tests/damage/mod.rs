//! Small changes to sound files, as accidents and attackers make them.

use proptest::prelude::*;
use proptest::sample::Index;

/// One change.
#[derive(Clone, Debug)]
pub(crate) enum Change {
    Set(Index, u8),
    Insert(Index, Vec<u8>),
    Remove(Index, usize),
    Cut(Index),
    /// Replaces a decimal digit: counts, indices and offsets of text headers.
    Digit(Index, u8),
    /// Four bytes that claim much.
    Huge(Index),
}

/// Any change; `words` are what a format trips over.
pub(crate) fn change(words: &[&str]) -> impl Strategy<Value = Change> + use<> {
    let at = any::<Index>;
    let words: Vec<Vec<u8>> = words.iter().map(|s| s.as_bytes().to_vec()).collect();
    prop_oneof![
        (at(), any::<u8>()).prop_map(|(i, v)| Change::Set(i, v)),
        (at(), prop::sample::select(words)).prop_map(|(i, v)| Change::Insert(i, v)),
        (at(), 1..9_usize).prop_map(|(i, n)| Change::Remove(i, n)),
        at().prop_map(Change::Cut),
        (at(), b'0'..=b'9').prop_map(|(i, v)| Change::Digit(i, v)),
        at().prop_map(Change::Huge),
    ]
}

/// The bytes after these changes.
pub(crate) fn damaged(mut bytes: Vec<u8>, changes: &[Change]) -> Vec<u8> {
    for change in changes {
        let n = bytes.len();
        if n == 0 {
            break;
        }
        match change {
            Change::Set(i, v) => bytes[i.index(n)] = *v,
            Change::Insert(i, v) => {
                let i = i.index(n);
                bytes.splice(i..i, v.iter().copied());
            }
            Change::Remove(i, k) => {
                let i = i.index(n);
                bytes.drain(i..(i + k).min(n));
            }
            Change::Cut(i) => bytes.truncate(i.index(n)),
            Change::Digit(i, v) => {
                let digits: Vec<usize> = (0..n).filter(|&k| bytes[k].is_ascii_digit()).collect();
                if !digits.is_empty() {
                    bytes[digits[i.index(digits.len())]] = *v;
                }
            }
            Change::Huge(i) => {
                let i = i.index(n);
                bytes[i..(i + 4).min(n)].fill(0x7f);
            }
        }
    }
    bytes
}
