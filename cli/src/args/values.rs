//! Values that several commands take.

use clap::ValueEnum;

/// Light for a rendering.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Light {
    /// Colours as they are.
    Flat,
    /// A bright room with a key light.
    Studio,
    /// Strong light from two sides: shows the shape from all around.
    Shape,
}

pub(crate) fn degrees(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|angle| (-90.0..=90.0).contains(angle))
        .ok_or_else(|| "expected -90 to 90".to_owned())
}

pub(crate) fn hex_color(text: &str) -> Result<[u8; 3], String> {
    let digits = text.trim_start_matches('#');
    let byte = |k: usize| digits.get(2 * k..2 * k + 2).and_then(|d| u8::from_str_radix(d, 16).ok());
    match (digits.len(), byte(0), byte(1), byte(2)) {
        (6, Some(r), Some(g), Some(b)) => Ok([r, g, b]),
        _ => Err("expected six hexadecimal digits, for example ffffff".to_owned()),
    }
}
