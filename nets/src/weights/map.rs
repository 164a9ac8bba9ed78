//! Renaming of what a file holds.

use std::str::FromStr;

/// Rules `old=new` for the beginnings of names, as in `module.=,encoder.=backbone.`.
///
/// Each rule that matches replaces the beginning, in the order in which they stand, so
/// `module.encoder.conv1.weight` becomes `backbone.conv1.weight`. An empty `old` puts `new` in
/// front of every name.
///
/// ```
/// use nets::NameMap;
///
/// let map: NameMap = "module.=,encoder.=backbone.".parse()?;
/// assert_eq!(map.apply("module.encoder.conv1.weight"), "backbone.conv1.weight");
/// assert_eq!(map.apply("head.weight"), "head.weight");
/// # Ok::<(), nets::MapError>(())
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct NameMap(Vec<(String, String)>);

/// A rule without its equals sign.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("`{rule}` is no rule for names: expected old=new, as in module.=,encoder.=backbone.")]
#[non_exhaustive]
pub struct MapError {
    /// As it was given.
    pub rule: String,
}

impl NameMap {
    /// The name after all rules.
    pub fn apply(&self, name: &str) -> String {
        self.0.iter().fold(name.to_owned(), |name, (old, new)| match name.strip_prefix(old) {
            Some(rest) => format!("{new}{rest}"),
            None => name,
        })
    }

    /// Whether a rule is for names that begin so.
    pub(super) fn expects(&self, beginning: &str) -> bool {
        self.0.iter().any(|(old, _)| old.starts_with(beginning))
    }
}

impl FromStr for NameMap {
    type Err = MapError;

    fn from_str(rules: &str) -> Result<Self, MapError> {
        let rules = rules.split(',').map(str::trim).filter(|rule| !rule.is_empty());
        let pairs = rules.map(|rule| match rule.split_once('=') {
            Some((old, new)) => Ok((old.trim().to_owned(), new.trim().to_owned())),
            None => Err(MapError { rule: rule.to_owned() }),
        });
        pairs.collect::<Result<_, _>>().map(Self)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn rules_apply_in_order() {
        let map: NameMap = " module.= , a.=b., b.=c.,".parse().unwrap();
        assert_eq!(map.apply("module.a.x"), "c.x");
        assert_eq!(map.apply("ab.x"), "ab.x");
        let map: NameMap = "=encoder.".parse().unwrap();
        assert_eq!(map.apply("x"), "encoder.x");
        assert_eq!("".parse::<NameMap>().unwrap().apply("x"), "x");
        let error = "a.=b,oops".parse::<NameMap>().unwrap_err();
        assert!(error.to_string().contains("`oops` is no rule"), "{error}");
    }
}
