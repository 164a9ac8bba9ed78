//! Being written.

use mesh_core::primitives;

use super::{Family, Part, Shape};

pub(super) fn draw(seed: u64) -> Shape {
    let mesh = primitives::cuboid([1.0, 2.0, 3.0]).colored([0.5; 3]);
    Shape {
        family: Family::Bicycle,
        seed,
        parts: vec![Part { name: "body", mesh }],
        traits: vec![],
    }
}
