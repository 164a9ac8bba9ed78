//! JSON within a budget: a byte or two of text can ask for hundreds in memory.

use std::borrow::Cow;
use std::fmt;

use mesh_core::{Budget, OverLimit};
use serde::de::{DeserializeSeed, Error, MapAccess, SeqAccess, Visitor};
use serde_json::{Map, Number, Value};

/// What a reader makes of an element or a member: a [`super::Node`] with the name of its place.
const NODE: usize = 100;
/// A node of the map that an object is, which has room for eleven members.
const FIRST_MEMBER: usize = 640;
/// What each further member takes of such nodes, which are half full where keys come sorted.
const MEMBER: usize = 128;

/// Why text did not become a value.
#[derive(Debug)]
pub(super) enum Failure {
    Json(serde_json::Error),
    OverLimit(OverLimit),
}

/// Parses a text, taking from the budget what its value takes.
pub(super) fn parse(bytes: &[u8], budget: &mut Budget) -> Result<Value, Failure> {
    let mut state = State { budget, over: None };
    let mut text = serde_json::Deserializer::from_slice(bytes);
    let result = Seed(&mut state).deserialize(&mut text);
    if let Some(over) = state.over {
        return Err(Failure::OverLimit(over));
    }
    result.and_then(|value| text.end().map(|()| value)).map_err(Failure::Json)
}

struct State<'b> {
    budget: &'b mut Budget,
    /// Set where the budget ended the parsing.
    over: Option<OverLimit>,
}

impl State<'_> {
    fn held<E: Error>(&mut self, taken: Result<(), OverLimit>) -> Result<(), E> {
        taken.map_err(|over| {
            self.over = Some(over);
            E::custom("too large")
        })
    }

    fn take<E: Error>(&mut self, bytes: usize) -> Result<(), E> {
        let taken = self.budget.take(bytes as u64);
        self.held(taken)
    }
}

/// One value, whatever it is.
struct Seed<'s, 'b>(&'s mut State<'b>);

impl<'de> DeserializeSeed<'de> for Seed<'_, '_> {
    type Value = Value;

    fn deserialize<D: serde::Deserializer<'de>>(self, text: D) -> Result<Value, D::Error> {
        text.deserialize_any(self)
    }
}

impl<'de> Visitor<'de> for Seed<'_, '_> {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("any valid JSON value")
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(Value::Bool(value))
    }

    fn visit_u64<E>(self, value: u64) -> Result<Value, E> {
        Ok(Value::Number(value.into()))
    }

    fn visit_i64<E>(self, value: i64) -> Result<Value, E> {
        Ok(Value::Number(value.into()))
    }

    fn visit_f64<E>(self, value: f64) -> Result<Value, E> {
        Ok(Number::from_f64(value).map_or(Value::Null, Value::Number))
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<Value, E> {
        self.0.take(text.len())?;
        Ok(Value::String(text.to_owned()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        let mut list = Vec::new();
        while let Some(value) = items.next_element_seed(Seed(self.0))? {
            let room = self.0.budget.reserve(&mut list, 1);
            self.0.held(room)?;
            self.0.take(NODE)?;
            list.push(value);
        }
        Ok(Value::Array(list))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut members: A) -> Result<Value, A::Error> {
        let mut map = Map::new();
        while let Some(key) = members.next_key::<Key<'de>>()? {
            let node = if map.is_empty() { FIRST_MEMBER } else { MEMBER };
            self.0.take(node + NODE + key.0.len())?;
            let value = members.next_value_seed(Seed(self.0))?;
            map.insert(key.0.into_owned(), value);
        }
        Ok(Value::Object(map))
    }
}

/// A key, borrowed from the text where it has no escapes.
#[derive(serde::Deserialize)]
#[serde(transparent)]
struct Key<'a>(#[serde(borrow)] Cow<'a, str>);
