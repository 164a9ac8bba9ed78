//! The kinds of things that are drawn.

use std::fmt;
use std::str::FromStr;

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
