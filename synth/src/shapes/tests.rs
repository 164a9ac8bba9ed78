//! What holds for every family.

use std::collections::BTreeSet;

use super::family::Family;
use super::shape::Shape;

/// Draws of a family are sound; `styles` are traits with all values that must occur in 200 draws.
#[track_caller]
pub(super) fn check(family: Family, styles: &[(&str, &[&str])]) {
    let shapes: Vec<Shape> = (0..30).map(|seed| family.draw(seed)).collect();
    let names = |shape: &Shape| shape.traits.iter().map(|t| t.0).collect::<Vec<_>>();
    let mut outlines = BTreeSet::new();
    for shape in &shapes {
        let seed = shape.seed;
        assert_eq!(shape, &family.draw(seed), "{family} {seed} differs when drawn again");
        assert_eq!(names(shape), names(&shapes[0]), "{family} {seed}");
        for part in &shape.parts {
            let health = part.mesh.health();
            assert!(health.is_watertight(), "{family} {seed}, {}: {health}", part.name);
            assert_eq!(health.degenerate_faces, 0, "{family} {seed}, {}: {health}", part.name);
        }
        let mesh = shape.mesh();
        assert_eq!(mesh.validate(), Ok(()));
        let colors = mesh.colors.as_ref().map_or(0, Vec::len);
        assert_eq!(colors, mesh.positions.len(), "{family} {seed}");
        let colored = mesh.colors.iter().flatten().flatten().all(|v| (0.0..=1.0).contains(v));
        assert!(colored, "{family} {seed}: a colour is out of range");
        let faces = mesh.faces.len();
        assert!((2000..=20_000).contains(&faces), "{family} {seed}: {faces} faces");
        let (low, high) = mesh.bounds().expect("it has vertices");
        // Proportions to a part in 250: two draws that agree in all three are alike.
        outlines.insert([0, 1, 2].map(|k| (250.0 * (high[k] - low[k])) as i32));
    }
    assert!(outlines.len() >= 25, "{family}: only {} different boxes of 30", outlines.len());
    let drawn: BTreeSet<(&str, String)> =
        (0..200).flat_map(|seed| family.draw(seed).traits).collect();
    for (name, values) in styles {
        let found: BTreeSet<&str> =
            drawn.iter().filter(|t| t.0 == *name).map(|t| t.1.as_str()).collect();
        let expected: BTreeSet<&str> = values.iter().copied().collect();
        assert_eq!(found, expected, "{family}: what `{name}` can be");
    }
}
