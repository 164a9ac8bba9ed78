//! Text as a terminal may have it: names from files cannot steer it, and do not fill it.

use std::fmt::Write as _;

/// Characters of a line that are printed; what is longer loses its middle.
const LONGEST: usize = 1000;
/// Characters of a line that was too long, before and behind the gap.
const KEPT: [usize; 2] = [600, 300];

/// The text with everything escaped that a terminal would obey instead of showing it, and long lines cut.
///
/// Escaped are control characters but the line break, and those that reorder a line, since an error that reads
/// backwards can name another file. Lines after the first are indented, so that a name with a line break in it cannot
/// look like a line of this program's.
pub(crate) fn message(text: &str) -> String {
    lines(text).collect::<Vec<_>>().join("\n  ")
}

/// The same for results, whose lines are all the program's own.
pub(crate) fn result(text: &str) -> String {
    lines(text).fold(String::with_capacity(text.len()), |all, line| all + &line + "\n")
}

/// The same for one line: a line break is a control character then.
pub(crate) fn line(text: &str) -> String {
    cut(&escaped(text))
}

/// JSON in which no control character stands as itself. Outside of texts JSON has none but line breaks, and within
/// them an escape means the same.
pub(crate) fn json(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '\n' => out.push(c),
            c if steers(c) => {
                // All that steers is within the first plane: one unit of UTF-16.
                let _ = write!(out, "\\u{:04x}", u32::from(c));
            }
            c => out.push(c),
        }
    }
    out
}

/// Whether it is printed as it is.
pub(crate) fn is_plain(text: &str) -> bool {
    text.len() <= LONGEST && !text.chars().any(steers)
}

fn lines(text: &str) -> impl Iterator<Item = String> + '_ {
    text.trim_end_matches('\n').split('\n').map(line)
}

fn escaped(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        if steers(c) { out.extend(c.escape_default()) } else { out.push(c) }
    }
    out
}

fn cut(line: &str) -> String {
    let count = line.chars().count();
    if count <= LONGEST {
        return line.to_owned();
    }
    let [before, behind] = KEPT;
    let head: String = line.chars().take(before).collect();
    let tail: String = line.chars().skip(count - behind).collect();
    format!("{head} .. ({} characters are left out) .. {tail}", count - before - behind)
}

/// Whether a terminal obeys the character: controls, and what turns the direction of writing.
fn steers(c: char) -> bool {
    c.is_control()
        || matches!(c, '\u{61c}' | '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_steers_a_terminal_is_shown_instead() {
        assert_eq!(message("a\u{1b}[2Jb.ply: bad"), "a\\u{1b}[2Jb.ply: bad");
        assert_eq!(message("\u{9b}2J\r\u{202e}x"), "\\u{9b}2J\\r\\u{202e}x");
        assert_eq!(message("Gl\u{e4}ser \u{1f600} 10 \u{b0}"), "Gl\u{e4}ser \u{1f600} 10 \u{b0}");
        assert_eq!(message("x\nerror: forged\n"), "x\n  error: forged");
        assert_eq!(result("a\nb\u{7}\n"), "a\nb\\u{7}\n");
        assert_eq!(line("a\nb"), "a\\nb");
    }

    #[test]
    fn what_would_fill_a_terminal_is_cut() {
        let text = format!("{}.ply: is bad", "n".repeat(65_000));
        let shown = message(&text);
        assert!(shown.chars().count() < 1000 && shown.ends_with(".ply: is bad"), "{shown}");
        assert!(shown.contains("64112 characters are left out"), "{shown}");
        assert_eq!(message(&"n".repeat(LONGEST)).len(), LONGEST);
    }

    #[test]
    fn json_stays_json() {
        let name = "a\u{1b}\u{7f}\u{9b}\u{202e}\"b";
        let text = serde_json::to_string_pretty(&[name]).expect("a text");
        let shown = json(&text);
        assert!(!shown.chars().any(|c| c != '\n' && steers(c)), "{shown:?}");
        let read: Vec<String> = serde_json::from_str(&shown).expect("JSON");
        assert_eq!(read, [name]);
    }
}
