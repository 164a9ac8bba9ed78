//! Named numbers.

use serde::{Serialize, Serializer};

/// Named numbers, in an order that is kept; an object in JSON.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Facts(pub Vec<(&'static str, f64)>);

impl Facts {
    /// The number of a name.
    pub fn get(&self, name: &str) -> Option<f64> {
        self.0.iter().find(|(other, _)| *other == name).map(|(_, value)| *value)
    }
}

impl<const N: usize> From<[(&'static str, f64); N]> for Facts {
    fn from(facts: [(&'static str, f64); N]) -> Self {
        Self(facts.to_vec())
    }
}

impl Serialize for Facts {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(name, value)| (name, Number(*value))))
    }
}

/// Counts are written as such: 80 and not 80.0.
struct Number(f64);

/// Up to here every whole number is a double.
const EXACT: f64 = 9_007_199_254_740_992.0;

impl Serialize for Number {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        if self.0.fract() == 0.0 && self.0.abs() < EXACT {
            serializer.serialize_i64(self.0 as i64)
        } else {
            serializer.serialize_f64(self.0)
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn counts_are_whole_numbers() {
        let facts = Facts::from([("views", 80.0), ("radius", 0.5), ("lost", f64::NAN)]);
        let text = serde_json::to_string(&facts).unwrap();
        assert_eq!(text, r#"{"views":80,"radius":0.5,"lost":null}"#);
        assert_eq!((facts.get("radius"), facts.get("width")), (Some(0.5), None));
    }
}
