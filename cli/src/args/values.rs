//! Values that several commands take.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use mesh_core::{UpAxis, UpAxisError};
use synth::Lighting;
use train::Subset;

/// Words, what the help says of each, and what they stand for.
pub(super) type Choices<T> = [(&'static str, &'static str, T)];

/// One of these words.
pub(super) fn one_of<T>(choices: &'static Choices<T>) -> impl TypedValueParser<Value = T>
where
    T: Copy + Send + Sync,
{
    let values = choices.iter().map(|(word, help, _)| PossibleValue::new(*word).help(*help));
    PossibleValuesParser::new(values).map(|word| {
        let found = choices.iter().find(|(other, ..)| *other == word);
        found.expect("the parser takes no other word").2
    })
}

/// What data are for.
pub(super) const SUBSETS: &Choices<Subset> = &[
    ("train", "What is trained on", Subset::Train),
    ("validation", "What the best checkpoint is chosen by, and settings are", Subset::Validation),
    ("test", "What is scored once, at the end", Subset::Test),
];

/// Makes the light for a rendering.
pub(crate) type Light = fn() -> Lighting;

pub(super) const LIGHTS: &Choices<Light> = &[
    ("flat", "Colours as they are", Lighting::flat),
    ("studio", "A bright room with a key light", Lighting::studio),
    ("shape", "Strong light from two sides: shows the shape from all around", Lighting::shape),
];

pub(crate) fn degrees(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|angle| (-90.0..=90.0).contains(angle))
        .ok_or_else(|| "expected -90 to 90".to_owned())
}

/// Which axis is up; none where the cameras say it.
pub(crate) type UpOrAuto = Option<UpAxis>;

pub(crate) fn up_axis(text: &str) -> Result<UpOrAuto, String> {
    match text {
        "auto" => Ok(None),
        _ => text.parse().map(Some).map_err(|error: UpAxisError| format!("{error}, or auto")),
    }
}

/// What coordinates, in single precision, can be multiplied by.
pub(crate) fn factor(text: &str) -> Result<f64, String> {
    let factor = text.parse().ok().filter(|&x: &f64| x > 0.0 && (x as f32).is_normal());
    factor.ok_or_else(|| "expected a number above 0, from 1.2e-38 to 3.4e38".to_owned())
}

/// Bytes, of a number and its unit.
pub(crate) fn memory(text: &str) -> Result<u64, String> {
    let number = text.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let unit = match text[number.len()..].to_ascii_uppercase().as_str() {
        "MB" | "M" => 1e6,
        "GB" | "G" => 1e9,
        _ => return Err("a number with its unit expected, 2GB or 500MB for example".to_owned()),
    };
    let bytes = number.trim().parse::<f64>().map_err(|error| error.to_string())? * unit;
    if !(1e8..=1e15).contains(&bytes) {
        return Err("100MB to 1000000GB expected".to_owned());
    }
    Ok(bytes as u64)
}

pub(crate) fn hex_color(text: &str) -> Result<[u8; 3], String> {
    let digits = text.strip_prefix('#').unwrap_or(text);
    let byte = |k: usize| digits.get(2 * k..2 * k + 2).and_then(|d| u8::from_str_radix(d, 16).ok());
    // A number may begin with a plus; a colour has digits alone.
    let plain = digits.len() == 6 && digits.bytes().all(|digit| digit.is_ascii_hexdigit());
    match (plain, byte(0), byte(1), byte(2)) {
        (true, Some(r), Some(g), Some(b)) => Ok([r, g, b]),
        _ => Err("expected six hexadecimal digits, for example ffffff".to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colors_are_six_digits() {
        for text in ["00ff10", "#00FF10"] {
            assert_eq!(hex_color(text), Ok([0, 255, 16]));
        }
        for text in ["", "fff", "+f+f+f", "##00ff1", "00ff1g", "00ff100", "\u{e9}\u{e9}\u{e9}"] {
            assert!(hex_color(text).is_err(), "{text}");
        }
    }

    #[test]
    fn memory_has_a_unit_and_is_neither_too_little_nor_absurd() {
        assert_eq!(memory("1.5gb"), Ok(1_500_000_000));
        assert_eq!(memory("500 MB"), Ok(500_000_000));
        for text in ["500", "2TB", "50MB", "-1GB", "nanGB", "1e9GB"] {
            assert!(memory(text).is_err(), "{text}");
        }
    }
}
