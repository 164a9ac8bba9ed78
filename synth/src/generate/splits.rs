//! Which objects are for training, validation and test.

use std::collections::BTreeMap;

use datasets::Subset;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::config::GenerateConfig;
use super::object::ObjectInfo;

/// The subset of each object, in their order: drawn anew in each category, so that every one has
/// its shares.
pub(super) fn of(config: &GenerateConfig, objects: &[ObjectInfo]) -> Vec<Subset> {
    let mut categories: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
    for (i, object) in objects.iter().enumerate() {
        categories.entry(&object.category).or_default().push(i);
    }
    let mut subsets = vec![Subset::Train; objects.len()];
    for members in categories.values_mut() {
        let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
        // Apart from the streams of the objects, and the same for every category.
        rng.set_stream(u64::MAX);
        for k in (1..members.len()).rev() {
            members.swap(k, rng.random_range(0..=k));
        }
        let share = |share: f64| (share * members.len() as f64).round() as usize;
        let validation = share(config.split[1]);
        let test = share(config.split[2]).min(members.len() - validation.min(members.len()));
        for (k, &i) in members.iter().enumerate() {
            subsets[i] = match k {
                k if k < validation => Subset::Validation,
                k if k < validation + test => Subset::Test,
                _ => Subset::Train,
            };
        }
    }
    subsets
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_category_has_its_shares() {
        let object = |category: &str, i: usize| ObjectInfo {
            category: category.into(),
            synset: String::new(),
            name: i.to_string(),
            seed: 0,
            view_seed: 0,
            views: 1,
            vertices: 0,
            faces: 0,
            traits: vec![],
        };
        let cars = (0..20).map(|i| object("car", i));
        let objects: Vec<_> = cars.chain((0..10).map(|i| object("bus", i))).collect();
        let config = GenerateConfig::default();
        let subsets = of(&config, &objects);
        let count = |range: std::ops::Range<usize>, wanted: Subset| {
            subsets[range].iter().filter(|&&s| s == wanted).count()
        };
        let counts = |r: std::ops::Range<usize>| {
            [Subset::Train, Subset::Validation, Subset::Test].map(|s| count(r.clone(), s))
        };
        assert_eq!((counts(0..20), counts(20..30)), ([14, 2, 4], [7, 1, 2]));
        assert_eq!(of(&config, &objects), subsets);
        assert_ne!(of(&GenerateConfig { seed: 1, ..config.clone() }, &objects), subsets);
        // All for one, and nobody left over where the shares of few objects round up.
        let all = of(&GenerateConfig { split: [0.0, 0.5, 0.5], ..config }, &objects[..1]);
        assert_eq!(all, [Subset::Validation]);
    }
}
