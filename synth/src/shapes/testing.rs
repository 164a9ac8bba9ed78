//! What every family is held to.

use std::collections::{BTreeMap, BTreeSet};

use super::Family;

/// Thirty draws: closed, coloured, finite parts, faces within bounds, the same traits, no two alike.
#[track_caller]
pub(super) fn assert_family(family: Family) {
    let names: Vec<&str> = family.draw(0).traits.iter().map(|(name, _)| *name).collect();
    let mut volumes = BTreeSet::new();
    for seed in 0..30 {
        let shape = family.draw(seed);
        assert_eq!((shape.family, shape.seed), (family, seed));
        for part in &shape.parts {
            let (name, health) = (part.name, part.mesh.health());
            assert!(health.is_watertight(), "seed {seed}: {name}: {health}");
            assert_eq!(health.isolated_vertices, 0, "seed {seed}: {name}");
            assert_eq!(health.degenerate_faces, 0, "seed {seed}: {name}: {health}");
            let colors = part.mesh.colors.as_ref().expect("parts are coloured");
            assert_eq!(colors.len(), part.mesh.positions.len());
            let valid = colors.iter().flatten().all(|c| (0.0..=1.0).contains(c));
            assert!(valid, "seed {seed}: {name}: a colour outside of 0 to 1");
        }
        let faces: usize = shape.parts.iter().map(|part| part.mesh.faces.len()).sum();
        assert!((2_000..=20_000).contains(&faces), "seed {seed}: {faces} faces");
        let found: Vec<&str> = shape.traits.iter().map(|(name, _)| *name).collect();
        assert_eq!(found, names, "seed {seed}");
        volumes.insert(shape.mesh().volume().to_bits());
    }
    assert_eq!(volumes.len(), 30, "two draws are alike");
    assert_eq!(family.draw(7), family.draw(7));
}

/// Over 200 draws every trait takes every one of its values and no other.
#[track_caller]
pub(super) fn assert_values(family: Family, values: impl Fn(&str) -> Vec<&'static str>) {
    let mut found: BTreeMap<&str, BTreeSet<String>> = BTreeMap::new();
    for seed in 0..200 {
        for (name, value) in family.draw(seed).traits {
            found.entry(name).or_default().insert(value);
        }
    }
    for (name, found) in found {
        let wanted: BTreeSet<String> = values(name).into_iter().map(str::to_owned).collect();
        assert_eq!(found, wanted, "{family}: {name}");
    }
}
