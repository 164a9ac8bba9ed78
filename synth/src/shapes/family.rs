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

/// Name and synset of every family, in the order of [`Family`].
const NAMES: [(&str, &str); 9] = [
    ("airplane", "02691156"),
    ("car", "02958343"),
    ("bus", "02924116"),
    ("chair", "03001627"),
    ("table", "04379243"),
    ("lamp", "03636649"),
    ("bicycle", "02834778"),
    ("motorbike", "03790512"),
    ("alarm_clock", "03046257"),
];

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
        NAMES[self as usize].0
    }

    /// The synset that ShapeNet files such things under.
    pub fn synset(self) -> &'static str {
        NAMES[self as usize].1
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
