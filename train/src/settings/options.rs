//! An option said once: its name, type, default, range and meaning.

use std::collections::BTreeMap;

use serde::Serialize;
use serde::de::DeserializeOwned;
use toml::Value;

use super::{Reads, Tabular, reads, settings_of};

/// A configuration that [`options!`](crate::options) declared.
pub trait Options: Default + Tabular + Serialize + DeserializeOwned {
    /// Keys, meanings and ranges in their order, those of the base first.
    fn declared() -> Vec<Declared>;

    /// Keys that were options before and say nothing any more: configurations that have them are read, and lose them.
    fn retired() -> Vec<&'static str> {
        Vec::new()
    }

    /// What is out of its range, one sentence each; what several options must agree on is the configuration's own affair.
    fn out_of_range(&self) -> Vec<String>;

    /// All there is to say about the options: what `--help`, the pages of documentation and `check` are made from.
    fn describe() -> Vec<OptionInfo> {
        let defaults = settings_of(&Self::default().to_table().to_string());
        Self::declared()
            .into_iter()
            .map(|declared| info(declared, &defaults, &reads::<Self>))
            .collect()
    }
}

/// What a declaration says of an option.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Declared {
    /// Its key in TOML.
    pub key: String,
    /// What it means.
    pub meaning: String,
    /// Its range in words, if it is a number with one.
    pub range: Option<String>,
}

impl Declared {
    /// From the name of a field, the lines of its documentation, and its range if it has one.
    #[must_use]
    pub fn new(field: &str, documentation: &str, range: &[String]) -> Self {
        let lines: Vec<&str> = documentation.lines().map(str::trim).collect();
        let meaning = lines.join(" ").trim().to_owned();
        Self { key: field.replace('_', "-"), meaning, range: range.first().cloned() }
    }
}

/// An option, for people.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct OptionInfo {
    /// Its key in TOML and behind `--set`.
    pub key: String,
    /// What it may be: a range or a list.
    pub expected: String,
    /// The value that it has if nothing is said, as TOML.
    pub default: String,
    /// What it means.
    pub meaning: String,
}

fn info(declared: Declared, defaults: &BTreeMap<String, String>, reads: Reads<'_>) -> OptionInfo {
    let Declared { key, meaning, range } = declared;
    let expected = range.unwrap_or_else(|| expected(&key, reads));
    let default = defaults.get(&key).map(|text| short(text)).unwrap_or_default();
    let none = Value::String(super::optional::NONE.to_owned());
    let optional = reads([(key.clone(), none)].into_iter().collect()).is_ok();
    let expected = if optional && !expected.contains("none") {
        format!("{expected}, or \"none\"")
    } else {
        expected
    };
    OptionInfo { key, expected, default, meaning }
}

/// A number in single precision with the digits that it was written with.
fn short(text: &str) -> String {
    let single = text.parse::<f64>().ok().filter(|number| f64::from(*number as f32) == *number);
    single
        .filter(|_| text.contains('.'))
        .map_or_else(|| text.to_owned(), |x| format!("{:?}", x as f32))
}

/// A date, which no option holds: given one, a type says what it expects.
pub(crate) fn date() -> Value {
    Value::Datetime(toml::value::Datetime {
        date: Some(toml::value::Date { year: 1970, month: 1, day: 1 }),
        time: None,
        offset: None,
    })
}

/// What the type of an option says when it is given what it cannot hold.
fn expected(key: &str, reads: Reads<'_>) -> String {
    let text = |value: Value| {
        let error = reads([(key.to_owned(), value)].into_iter().collect());
        let message = error.err().map(|error| error.message().to_owned())?;
        message.rsplit_once("expected ").map(|(_, what)| what.trim_end().to_owned())
    };
    // Of choices a text that is none of them tells all.
    let choices = text(Value::String(String::from("?"))).filter(|what| what.contains('`'));
    let what = choices.or_else(|| text(date())).or_else(|| text(Value::Boolean(true)));
    let what = what.unwrap_or_default();
    let what = what.split(", or \"").next().unwrap_or_default();
    let what = what.strip_prefix("one of ").unwrap_or(what);
    match what {
        "a boolean" => "true or false".to_owned(),
        "a string" | "a string or map" => "text".to_owned(),
        "a sequence" => "a list".to_owned(),
        "usize" | "u64" | "u32" => "an integer".to_owned(),
        "f64" | "f32" => "a number".to_owned(),
        what => what.replace('`', ""),
    }
}

/// Declares a configuration: each option once, with its meaning, type, default and range.
///
/// What follows from it: the struct with its documentation, `Default`, serde in TOML's keys with dashes,
/// [`Options::out_of_range`], and [`Options::describe`] for `--help` and tables. `extends` names a configuration whose
/// options stand in the same table, and `retires` names keys that earlier versions wrote and that say nothing any more.
///
/// ```
/// use train::settings::Options;
///
/// train::options! {
///     /// How a sphere is made.
///     pub struct SphereConfig {
///         /// Subdivision level.
///         pub level: u32 = 3, in 0..=6;
///         /// Radius, in lengths of an object.
///         pub radius: f64 = 0.5, in 1e-3..=1e3;
///         /// Colours are left out.
///         pub plain: bool = false;
///     }
/// }
///
/// assert_eq!(SphereConfig::default().level, 3);
/// let wrong = SphereConfig { level: 7, ..SphereConfig::default() };
/// assert_eq!(wrong.out_of_range(), ["`level` is 7, expected 0 to 6"]);
/// let [level, radius, plain] = &SphereConfig::describe()[..] else { unreachable!() };
/// assert_eq!((&*level.key, &*level.expected, &*level.default), ("level", "0 to 6", "3"));
/// assert_eq!((&*plain.expected, &*radius.meaning), ("true or false", "Radius, in lengths of an object."));
/// ```
#[macro_export]
macro_rules! options {
    (
        $(#[$container:meta])*
        $public:vis struct $name:ident $(retires [$($gone:literal),+])? $(extends $base:ident: $base_type:ty = $base_default:expr =>)? {
            $(
                $(#[doc = $doc:literal])+
                $(#[serde($($serde:tt)+)])*
                $field_public:vis $field:ident: $type:ty = $default:expr $(, in $range:expr)?;
            )*
        }
    ) => {
        #[derive(Clone, Debug, PartialEq, ::serde::Serialize, ::serde::Deserialize)]
        $(#[$container])*
        #[serde(default, rename_all = "kebab-case")]
        $public struct $name {
            $(
                #[doc = concat!("The options of [`", stringify!($base_type), "`], in the same table.")]
                #[serde(flatten)]
                pub $base: $base_type,
            )?
            $(
                $(#[doc = $doc])+
                #[doc = concat!("\n\nDefault `", stringify!($default), "`", $("; range `", stringify!($range), "`",)? ".")]
                $(#[serde($($serde)+)])*
                $field_public $field: $type,
            )*
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $($base: $base_default,)? $($field: $default,)* }
            }
        }

        impl $crate::settings::Tabular for $name {
            #[inline(never)]
            fn from_table(
                table: $crate::settings::toml::Table,
            ) -> Result<Self, $crate::settings::toml::de::Error> {
                $crate::settings::or_named(table, &|table| table.try_into())
            }

            #[inline(never)]
            fn to_text(&self) -> String {
                $crate::settings::toml::to_string_pretty(self).expect("options are a plain table")
            }
        }

        impl $crate::settings::Options for $name {
            fn declared() -> Vec<$crate::settings::Declared> {
                #[allow(unused_variables, reason = "where no option has a range")]
                let defaults = Self::default();
                #[allow(unused_mut, reason = "where nothing is extended")]
                let mut declared = Vec::new();
                $(declared.extend(<$base_type as $crate::settings::Options>::declared());)?
                $(
                    let range: &[String] = &[$($crate::settings::range_of(&defaults.$field, &$range))?];
                    let meaning = concat!($($doc, "\n"),+);
                    declared.push($crate::settings::Declared::new(stringify!($field), meaning, range));
                )*
                declared
            }

            fn retired() -> Vec<&'static str> {
                #[allow(unused_mut, reason = "where nothing is extended, nor retired")]
                let mut retired: Vec<&'static str> = Vec::new();
                $(retired.extend(<$base_type as $crate::settings::Options>::retired());)?
                $(retired.extend([$($gone),+]);)?
                retired
            }

            fn out_of_range(&self) -> Vec<String> {
                #[allow(unused_mut, reason = "where nothing is extended")]
                let mut problems: Vec<String> = Vec::new();
                $(problems.extend($crate::settings::Options::out_of_range(&self.$base));)?
                $($(
                    problems.extend($crate::settings::out_of_range(stringify!($field), &self.$field, &$range));
                )?)*
                problems
            }
        }
    };
}

#[cfg(test)]
mod tests {
    use super::Options as _;

    crate::options! {
        /// One of each kind.
        struct Kinds {
            /// A text that may be absent.
            #[serde(with = "crate::settings::optional")]
            file: Option<String> = None;
            /// A count that may be absent.
            #[serde(with = "crate::settings::optional")]
            every: Option<usize> = Some(5), in 2..;
            /// A number without a range, in single precision.
            share: f32 = 0.1;
            /// A list.
            names: Vec<String> = Vec::new();
        }
    }

    #[test]
    fn types_have_words() {
        let described = Kinds::describe();
        let all: Vec<[&str; 3]> =
            described.iter().map(|o| [&*o.key, &*o.expected, &*o.default]).collect();
        let expected = [
            ["file", "text, or \"none\"", "\"none\""],
            ["every", "at least 2, or \"none\"", "5"],
            ["share", "a number", "0.1"],
            ["names", "a list", "[]"],
        ];
        assert_eq!(all, expected);
    }
}
