//! The lines of OBJ and MTL files as people have them.

use std::borrow::Cow;

use crate::{Budget, OverLimit};

/// Lines that end in LF, CR LF or CR, joined where one ends in a backslash.
pub(super) struct Lines<'a> {
    rest: &'a [u8],
    number: usize,
    /// What backslashes have joined so far.
    joined: Vec<u8>,
    /// What the line that was given last takes beside the file; until the next is asked for.
    lent: u64,
}

impl<'a> Lines<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Self {
        // Some editors of Windows begin every file with this mark.
        let rest = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        Self { rest, number: 0, joined: Vec::new(), lent: 0 }
    }

    /// The next line and its number, that of its end; names that are not UTF-8 have replacement
    /// characters.
    pub(super) fn next(
        &mut self,
        budget: &mut Budget,
    ) -> Result<Option<(usize, Cow<'a, str>)>, OverLimit> {
        budget.give_back(std::mem::take(&mut self.lent));
        while !self.rest.is_empty() {
            let line = self.cut();
            // A comment may end in the backslash of a path; it ends there all the same.
            let part = line
                .trim_ascii_end()
                .strip_suffix(b"\\")
                .filter(|_| !self.joined.is_empty() || !line.trim_ascii_start().starts_with(b"#"));
            match part {
                Some(part) => {
                    budget.reserve(&mut self.joined, part.len() + 1)?;
                    self.joined.extend_from_slice(part);
                    self.joined.push(b' ');
                }
                None if self.joined.is_empty() => {
                    let text = match std::str::from_utf8(line) {
                        Ok(text) => Cow::Borrowed(text),
                        Err(_) => Cow::Owned(self.replaced(line, budget)?),
                    };
                    return Ok(Some((self.number, text)));
                }
                None => {
                    budget.reserve(&mut self.joined, line.len())?;
                    self.joined.extend_from_slice(line);
                    return self.flush(budget);
                }
            }
        }
        if self.joined.is_empty() { Ok(None) } else { self.flush(budget) }
    }

    /// The line that backslashes have joined.
    fn flush(&mut self, budget: &mut Budget) -> Result<Option<(usize, Cow<'a, str>)>, OverLimit> {
        let joined = std::mem::take(&mut self.joined);
        self.lent = joined.capacity() as u64;
        let text = match String::from_utf8(joined) {
            Ok(text) => text,
            Err(error) => self.replaced(error.as_bytes(), budget)?,
        };
        Ok(Some((self.number, Cow::Owned(text))))
    }

    /// A copy with replacement characters, which take three bytes, in a text that grows by doubling.
    fn replaced(&mut self, line: &[u8], budget: &mut Budget) -> Result<String, OverLimit> {
        let most = 9 * line.len() as u64;
        budget.take(most)?;
        self.lent += most;
        Ok(String::from_utf8_lossy(line).into_owned())
    }

    /// Takes the next line off the rest, without its end.
    fn cut(&mut self) -> &'a [u8] {
        self.number += 1;
        let rest = self.rest;
        let end = rest.iter().position(|b| matches!(b, b'\n' | b'\r')).unwrap_or(rest.len());
        let ending = if rest[end..].starts_with(b"\r\n") { 2 } else { 1 };
        self.rest = rest.get(end + ending..).unwrap_or_default();
        &rest[..end]
    }
}

/// The first word of a line and what follows it, both trimmed, without the comment. A comment
/// begins at the start of a word: names of materials and files may have a `#` inside.
pub(super) fn split_word(line: &str) -> (&str, &str) {
    let line = without_comment(line).trim();
    match line.split_once(char::is_whitespace) {
        Some((word, rest)) => (word, rest.trim()),
        None => (line, ""),
    }
}

fn without_comment(line: &str) -> &str {
    let starts = |at: usize| line[..at].chars().next_back().is_none_or(char::is_whitespace);
    let comment = line.match_indices('#').map(|(at, _)| at).find(|&at| starts(at));
    &line[..comment.unwrap_or(line.len())]
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::Limits;

    fn lines(bytes: &[u8]) -> Vec<(usize, String)> {
        let mut budget = Limits::default().budget(0);
        let mut lines = Lines::new(bytes);
        std::iter::from_fn(|| lines.next(&mut budget).unwrap())
            .map(|(number, line)| (number, line.into_owned()))
            .collect()
    }

    #[test]
    fn endings_marks_and_backslashes_of_every_system() {
        let of = |text: &str| lines(text.as_bytes());
        let two = [(1, "a".to_owned()), (2, "b".to_owned())];
        for text in ["a\nb", "a\r\nb\r\n", "a\rb\r", "\u{feff}a\nb\n"] {
            assert_eq!(of(text), two, "{text:?}");
        }
        assert_eq!(of("f 1 \\\r\n2 \\ \n3\nx"), [(3, "f 1  2  3".into()), (4, "x".into())]);
        assert_eq!(of("f 1 2 \\"), [(1, "f 1 2  ".into())], "a backslash at the end of the file");
        assert_eq!(of("# C:\\\nv"), [(1, "# C:\\".into()), (2, "v".into())]);
        assert_eq!(lines(b"usemtl M\xe9tal\n"), [(1, "usemtl M\u{fffd}tal".into())]);
    }

    #[test]
    fn a_hash_inside_a_word_is_no_comment() {
        assert_eq!(split_word("usemtl wood#2 # the table"), ("usemtl", "wood#2"));
        assert_eq!(split_word(" # f 1 2 3"), ("", ""));
        assert_eq!(split_word("f\t1 2\t3"), ("f", "1 2\t3"));
    }
}
