//! Absurd values in every number of every configuration: an error that names the field, before any array is made.

use std::path::Path;

use autodiff_lite::state::State;
use models::depth::DepthPixel2Mesh;
use models::predict::Predictor;
use models::{Registry, register};
use recon::fit::FitConfig;
use serde::Serialize;
use serde::de::DeserializeOwned;
use synth::Monocular;
use synth::generate::GenerateConfig;
use toml::{Table, Value};
use train::settings::{Options, optional, read_text};
use train::{Checkpoint, Configuration, System, TrainConfig};

/// Numbers of which each is as good as another, up to the largest of TOML: seeds, and counts after which something
/// happens, which may be never.
const ANY: &[&str] = &[
    "seed",
    "data-seed",
    "max-steps",
    "drop-every",
    "milestones",
    "warmup",
    "validation-every",
    "samples-every",
    "checkpoint-steps",
    "hold-out",
    "refine-every",
    "subdivide-at",
    "own-cameras-at",
    "voxel-only-steps",
    "views-per-step",
    "relax-every",
];
/// Limits that may be so large that they are none, and vectors of any length.
const UNLIMITED: &[&str] = &["clip-norm", "skip-spikes", "direction"];
/// Where -1 has a meaning.
const SIGNED: &[&str] = &["test-start", "shift", "direction"];

/// A place in a configuration: names of tables and places in lists.
type Place = Vec<String>;

/// The places of all numbers below a value.
fn numbers(value: &Value, place: &Place, found: &mut Vec<Place>) {
    let below = |name: String| [place.clone(), vec![name]].concat();
    match value {
        Value::Integer(_) | Value::Float(_) => found.push(place.clone()),
        Value::Array(all) => {
            all.iter().enumerate().for_each(|(i, one)| numbers(one, &below(i.to_string()), found));
        }
        Value::Table(table) => {
            table.iter().for_each(|(name, one)| numbers(one, &below(name.clone()), found));
        }
        _ => {}
    }
}

fn replaced(table: &Table, place: &Place, value: Value) -> Table {
    let mut root = Value::Table(table.clone());
    let mut at = &mut root;
    for name in place {
        at = match at {
            Value::Array(all) => &mut all[name.parse::<usize>().unwrap()],
            other => other.get_mut(name.as_str()).unwrap(),
        };
    }
    *at = value;
    root.try_into().unwrap()
}

/// The name that a user knows.
fn name(place: &Place) -> &str {
    place.iter().rev().find(|part| part.parse::<usize>().is_err()).unwrap()
}

/// What is wrong with a configuration in TOML; nothing where it is sound.
type Check<'a> = &'a dyn Fn(&str) -> Option<String>;

fn written(value: &impl Serialize) -> String {
    toml::to_string_pretty(value).unwrap()
}

/// Every number of a default in turn. How many there were.
fn assert_ranges<C: Serialize>(what: &str, default: &C, check: Check<'_>) -> usize {
    let table: Table = toml::from_str(&written(default)).unwrap();
    assert_eq!(check(&written(default)), None, "{what}");
    let mut places = Vec::new();
    numbers(&Value::Table(table.clone()), &Vec::new(), &mut places);
    // What is absent and would be a number if it were there.
    for (field, _) in table.iter().filter(|(_, value)| value.as_str() == Some(optional::NONE)) {
        let one = written(&replaced(&table, &vec![field.clone()], Value::Integer(1)));
        if check(&one).is_none_or(|text| !text.contains("found ")) {
            places.push(vec![field.clone()]);
        }
    }
    let (large, none) = (1_000_000_000_000, f64::NAN);
    for place in &places {
        let field = name(place);
        let tried = |value: Value| check(&written(&replaced(&table, place, value)));
        let named = |value: Value, text: &str| {
            assert!(text.contains(field), "{what}: {field} = {value}: {text}");
        };
        for value in [Value::Integer(0), Value::Float(0.0), Value::Integer(1), Value::Float(1e-300)]
        {
            // It may have a meaning.
            if let Some(text) = tried(value.clone()) {
                // 1 hidden column, say, is sound by itself, and not with as many heads.
                assert!(text.contains(field) || text.contains('`'), "{what}: {field}: {text}");
            }
        }
        for value in [Value::Integer(-1), Value::Float(-1.0), Value::Float(-1e300)] {
            match tried(value.clone()) {
                Some(text) => named(value, &text),
                None => assert!(SIGNED.contains(&field), "{what}: {field} = {value} passes"),
            }
        }
        for value in [none, f64::INFINITY, f64::NEG_INFINITY].map(Value::Float) {
            let text = tried(value.clone());
            named(value, &text.unwrap_or_else(|| panic!("{what}: {field} may be no number")));
        }
        let huge = [Value::Integer(large), Value::Integer(i64::MAX), Value::Float(1e300)];
        for value in huge {
            if let Some(text) = tried(value.clone()) {
                named(value, &text);
            } else {
                let known = ANY.contains(&field) || UNLIMITED.contains(&field);
                assert!(known, "{what}: {field} = {value} passes");
            }
        }
    }
    places.len()
}

/// The largest count of all, which TOML cannot say but a program can.
fn assert_largest<C: Serialize + DeserializeOwned + Default>(
    what: &str,
    check: &dyn Fn(&C) -> Option<String>,
) {
    let serde_json::Value::Object(fields) = serde_json::to_value(C::default()).unwrap() else {
        panic!("{what}: no table")
    };
    for (field, value) in &fields {
        if !value.is_u64() {
            continue;
        }
        let mut fields = fields.clone();
        fields.insert(field.clone(), u64::MAX.into());
        // Smaller counts cannot hold it.
        let Ok(config) = serde_json::from_value::<C>(fields.into()) else { continue };
        let text = check(&config).unwrap_or_else(|| panic!("{what}: {field} may be 2^64 - 1"));
        assert!(text.contains(field.as_str()), "{what}: {field}: {text}");
    }
}

fn joined(problems: &[String]) -> Option<String> {
    (!problems.is_empty()).then(|| problems.join("; "))
}

fn assert_system<S: System>() {
    let default = Configuration::<S::Config>::default();
    let count = assert_ranges(S::NAME, &default, &|text| {
        let config = read_text::<Configuration<S::Config>>(Path::new("test"), text, &[]);
        match config {
            Err(error) => Some(error.to_string()),
            Ok(config) => joined(&S::problems(&config)),
        }
    });
    assert!(count > 30, "{}: {count}", S::NAME);
    assert_largest::<S::Config>(S::NAME, &|config| joined(&S::check(config)));
}

/// Asserts the same of every system.
struct All;

impl Registry for All {
    fn register<S: Predictor>(&mut self) {
        assert_system::<S>();
    }
}

#[test]
fn of_systems() {
    register(&mut All);
    assert_largest::<TrainConfig>("train", &|config| joined(&config.check()));
}

fn assert_plain<C: Options>(what: &str, default: &C, check: &dyn Fn(&C) -> Vec<String>) {
    assert_ranges(what, default, &|text| match read_text::<C>(Path::new("test"), text, &[]) {
        Err(error) => Some(error.to_string()),
        Ok(config) => joined(&check(&config)),
    });
    assert_largest::<C>(what, &|config| joined(&check(config)));
}

#[test]
fn of_fits_and_of_datasets_that_are_made() {
    assert_plain("fit", &FitConfig::default(), &FitConfig::check);
    let monocular = Some(Monocular::default());
    let default = GenerateConfig { monocular, ..GenerateConfig::default() };
    assert_plain("generate", &default, &GenerateConfig::check);
}

/// Four terabytes were asked for before the range was looked at.
#[test]
fn of_a_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("c.safetensors");
    let mut state = State::new();
    for (field, value) in [
        ("format", "1"),
        ("system", "depth-pixel2mesh"),
        ("step", "1"),
        ("config", "stages = 1000000000000"),
    ] {
        state.metadata.insert(field.into(), value.into());
    }
    state.write(&path).unwrap();
    let checkpoint = Checkpoint::read(&path).unwrap();
    let error = checkpoint.config::<DepthPixel2Mesh>().unwrap_err().to_string();
    assert!(error.contains("c.safetensors") && error.contains("`stages`"), "{error}");
}
