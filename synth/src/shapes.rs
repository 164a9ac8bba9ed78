//! Procedural objects: parametric, coloured, made of watertight parts.
//!
//! Nine families, each a function of a seed. Two draws differ in topology and silhouette, not only
//! in scale.
//!
//! ```
//! use synth::shapes::Family;
//!
//! let clock = Family::AlarmClock.draw(7);
//! assert_eq!(clock.mesh(), Family::AlarmClock.draw(7).mesh());
//! assert!(clock.parts.iter().all(|part| part.mesh.health().is_watertight()));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod airplane;
mod alarm_clock;
mod assembly;
mod bicycle;
mod bus;
mod car;
mod chair;
mod coachwork;
mod draw;
mod joinery;
mod lamp;
mod motorbike;
mod paint;
mod solid;
mod table;
#[cfg(test)]
mod testing;
#[cfg(test)]
mod tests;
mod wheel;
mod workpiece;

use std::fmt;
use std::str::FromStr;

use mesh_core::TriMesh;

pub use alarm_clock::{AlarmClock, ClockColors};

/// A kind of thing whose instances are drawn from seeds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Family {
    /// Fuselage, wings, tail, engines.
    Airplane,
    /// A passenger car.
    Car,
    /// A bus.
    Bus,
    /// A chair.
    Chair,
    /// A table.
    Table,
    /// A lamp that stands.
    Lamp,
    /// A bicycle.
    Bicycle,
    /// A motorbike.
    Motorbike,
    /// An alarm clock with bells.
    AlarmClock,
}

/// One instance of a family.
///
/// Upright (+Y), its front towards +Z, in units of its own; [`Shape::mesh`] is centred on its box
/// and has a box whose diagonal is 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Shape {
    /// What it is an instance of.
    pub family: Family,
    /// What it was drawn from.
    pub seed: u64,
    /// Closed, outward-oriented, coloured parts; they may touch and sink into each other.
    pub parts: Vec<Part>,
    /// What was drawn, in words: `("legs", "3")`. The same names for all instances of a family.
    pub traits: Vec<(&'static str, String)>,
}

/// One closed part of a [`Shape`].
#[derive(Clone, Debug, PartialEq)]
pub struct Part {
    /// What it is; several parts may share a name.
    pub name: &'static str,
    /// Its surface, with one colour a vertex.
    pub mesh: TriMesh,
}

impl Family {
    /// All families.
    pub const ALL: [Self; 9] = [
        Self::Airplane,
        Self::Car,
        Self::Bus,
        Self::Chair,
        Self::Table,
        Self::Lamp,
        Self::Bicycle,
        Self::Motorbike,
        Self::AlarmClock,
    ];

    /// The name on command lines and in folders.
    pub fn name(self) -> &'static str {
        match self {
            Self::Airplane => "airplane",
            Self::Car => "car",
            Self::Bus => "bus",
            Self::Chair => "chair",
            Self::Table => "table",
            Self::Lamp => "lamp",
            Self::Bicycle => "bicycle",
            Self::Motorbike => "motorbike",
            Self::AlarmClock => "alarm_clock",
        }
    }

    /// The synset that ShapeNet files such things under.
    pub fn synset(self) -> &'static str {
        match self {
            Self::Airplane => "02691156",
            Self::Car => "02958343",
            Self::Bus => "02924116",
            Self::Chair => "03001627",
            Self::Table => "04379243",
            Self::Lamp => "03636649",
            Self::Bicycle => "02834778",
            Self::Motorbike => "03790512",
            Self::AlarmClock => "03046257",
        }
    }

    /// The instance of a seed: the same for the same seed, on every machine.
    pub fn draw(self, seed: u64) -> Shape {
        match self {
            Self::Airplane => airplane::draw(seed),
            Self::Car => car::draw(seed),
            Self::Bus => bus::draw(seed),
            Self::Chair => chair::draw(seed),
            Self::Table => table::draw(seed),
            Self::Lamp => lamp::draw(seed),
            Self::Bicycle => bicycle::draw(seed),
            Self::Motorbike => motorbike::draw(seed),
            Self::AlarmClock => alarm_clock::draw(seed),
        }
    }
}

impl Shape {
    /// All parts as one coloured mesh, centred on its box, whose diagonal is 1.
    pub fn mesh(&self) -> TriMesh {
        let mut all = TriMesh::default();
        for part in &self.parts {
            all.append(&part.mesh).expect("parts are small and all coloured");
        }
        let (low, high) = all.bounds().expect("a shape has vertices");
        let diagonal = (0..3).map(|k| (high[k] - low[k]).powi(2)).sum::<f32>().sqrt();
        let middle: [f32; 3] = std::array::from_fn(|k| 0.5 * (low[k] + high[k]));
        for p in &mut all.positions {
            *p = std::array::from_fn(|k| (p[k] - middle[k]) / diagonal);
        }
        all
    }
}

impl fmt::Display for Family {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// No family has this name.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "no family `{0}`; there are airplane (plane), car, bus, chair, table, lamp, bicycle (bike), \
     motorbike (motorcycle) and alarm_clock (clock), or all"
)]
pub struct UnknownFamily(pub String);

impl FromStr for Family {
    type Err = UnknownFamily;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        let wanted = match name {
            "plane" | "aeroplane" => "airplane",
            "bike" => "bicycle",
            "motorcycle" => "motorbike",
            "clock" | "alarm-clock" => "alarm_clock",
            other => other,
        };
        let mut all = Self::ALL.into_iter();
        all.find(|family| family.name() == wanted || family.synset() == wanted)
            .ok_or_else(|| UnknownFamily(name.to_owned()))
    }
}
