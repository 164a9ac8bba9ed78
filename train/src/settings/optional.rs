//! What may be absent: `"none"` in TOML, which has no word for it.
//!
//! ```
//! use serde::{Deserialize, Serialize};
//!
//! #[derive(Serialize, Deserialize)]
//! struct Limits {
//!     #[serde(with = "train::settings::optional")]
//!     steps: Option<u64>,
//! }
//!
//! let limits: Limits = toml::from_str("steps = \"none\"").unwrap();
//! assert_eq!(limits.steps, None);
//! assert_eq!(toml::from_str::<Limits>("steps = 7").unwrap().steps, Some(7));
//! assert_eq!(toml::to_string(&limits).unwrap(), "steps = \"none\"\n");
//! ```
//!
//! Configurations and checkpoints of before said 0 or an empty text for what is absent: they are read so still, and no
//! option that may be absent has 0 for a value, but for those that could not be absent then ([`or_zero`]).

use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use toml::Value;

/// The word.
pub const NONE: &str = "none";

/// Writes the value, or the word.
///
/// # Errors
/// Those of the format.
pub fn serialize<T: Serialize, S: Serializer>(value: &Option<T>, to: S) -> Result<S::Ok, S::Error> {
    match value {
        Some(value) => value.serialize(to),
        None => NONE.serialize(to),
    }
}

/// Reads a value of which 0 is one, or the word: for options that could not be absent before.
///
/// # Errors
/// If it is neither.
pub fn or_zero<'de, T: DeserializeOwned, D: Deserializer<'de>>(
    from: D,
) -> Result<Option<T>, D::Error> {
    read(Value::deserialize(from)?, |value| value.as_str() == Some(NONE))
}

/// Reads a value, or what says that there is none.
///
/// # Errors
/// If it is neither.
pub fn deserialize<'de, T: DeserializeOwned, D: Deserializer<'de>>(
    from: D,
) -> Result<Option<T>, D::Error> {
    read(Value::deserialize(from)?, |value| match value {
        Value::String(text) => text.is_empty() || text == NONE,
        Value::Integer(number) => *number == 0,
        Value::Float(number) => *number == 0.0,
        _ => false,
    })
}

fn read<T: DeserializeOwned, E: serde::de::Error>(
    value: Value,
    is_absent: impl Fn(&Value) -> bool,
) -> Result<Option<T>, E> {
    if is_absent(&value) {
        return Ok(None);
    }
    T::deserialize(value)
        .map(Some)
        .map_err(|error| E::custom(format!("{}, or \"{NONE}\"", error.message().trim_end())))
}
