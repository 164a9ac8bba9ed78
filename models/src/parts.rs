//! What the data of all systems are parted into, and scores as means over its objects.

use std::collections::HashMap;

use datasets::{Entry, Subsets, mix64};
use mesh_core::TriMesh;
use rayon::prelude::*;
use train::{Better, DataError, DataSummary, Metric, Subset};

/// The same three in the words of the readers.
fn named(subset: Subset) -> datasets::Subset {
    match subset {
        Subset::Train => datasets::Subset::Train,
        Subset::Validation => datasets::Subset::Validation,
        Subset::Test => datasets::Subset::Test,
    }
}

/// The indices for this; none where there is nothing.
pub(crate) fn listed(parts: &Subsets, subset: Subset) -> &[usize] {
    parts.get(named(subset))
}

/// The indices for this, at least one.
///
/// # Errors
/// If there is none.
pub(crate) fn wanted(parts: &Subsets, subset: Subset) -> Result<&[usize], DataError> {
    let found = listed(parts, subset);
    if found.is_empty() {
        let there = Subset::ALL.into_iter().filter(|&other| !listed(parts, other).is_empty());
        let there: Vec<&str> = there.map(Subset::name).collect();
        let text =
            format!("none of the data is for {subset}: all of it is for {}", there.join(", "));
        return Err(DataError::Unfit(text));
    }
    Ok(found)
}

/// Procedural objects of a family for training, validation and test. Validation is scored again and again: without a number
/// of its own it has half of the tests'.
pub(crate) fn counts(train: usize, validation: Option<usize>, test: usize) -> [usize; 3] {
    [train, validation.unwrap_or_else(|| test.div_ceil(2)), test]
}

/// The mesh of a network as it is scored and delivered: moved apart, if that is wanted, where it passes through itself.
pub(crate) fn finished(mut mesh: TriMesh, untangle: bool) -> TriMesh {
    if untangle && mesh.positions.as_flattened().iter().all(|x| x.is_finite()) {
        // What cannot be mended stays: whoever asks for the mesh's health hears of it.
        let _ = mesh.untangle();
    }
    mesh
}

/// What `of` says of at most `most` of `count` objects, spread over all of them; in their order.
///
/// # Errors
/// The first of `of`.
pub(crate) fn of_each<T: Send>(
    count: usize,
    most: usize,
    of: impl Fn(usize) -> Result<T, DataError> + Sync,
) -> Result<Vec<T>, DataError> {
    let chosen = count.min(most);
    of_all(chosen, |i| of(i * count / chosen))
}

/// What `of` says of all `count` objects, in their order; asked on all threads.
///
/// # Errors
/// The first of `of` in that order, whatever the threads.
pub(crate) fn of_all<T: Send>(
    count: usize,
    of: impl Fn(usize) -> Result<T, DataError> + Sync,
) -> Result<Vec<T>, DataError> {
    let all: Vec<Result<T, DataError>> = (0..count).into_par_iter().map(&of).collect();
    all.into_iter().collect()
}

/// What there is to say of them.
pub(crate) fn summary(parts: &Subsets, unit: &'static str) -> DataSummary {
    let sizes = Subset::ALL.map(|subset| listed(parts, subset).len());
    DataSummary { unit, sizes, warnings: parts.warnings.clone() }
}

/// A number that an object's identity alone decides: what is drawn for it, the views that it is scored in for example,
/// is the same whatever stands beside it.
pub(crate) fn identity(entry: &Entry) -> u64 {
    let words = [entry.category.as_bytes(), entry.name.as_bytes()];
    let hash = words.iter().fold(train::Fingerprint::new(), |hash, word| hash.with(word)).value();
    // The last words alone would move only some of the bits.
    mix64(hash)
}

/// Values of objects: of each the mean over its groups or views, in the order in which they first appear.
pub(crate) fn by_object<'a>(
    values: impl IntoIterator<Item = (&'a str, f64)>,
) -> Vec<(String, f64)> {
    let mut places: HashMap<&str, usize> = HashMap::new();
    let mut sums: Vec<(String, f64, usize)> = Vec::new();
    for (name, value) in values {
        let place = *places.entry(name).or_insert(sums.len());
        if place == sums.len() {
            sums.push((name.to_owned(), 0.0, 0));
        }
        sums[place].1 += value;
        sums[place].2 += 1;
    }
    sums.into_iter().map(|(name, sum, count)| (name, sum / count as f64)).collect()
}

/// A score that is the mean over objects of what [`by_object`] gives each; not a number where there is none.
pub(crate) fn mean_metric<'a>(
    name: &str,
    better: Better,
    values: impl IntoIterator<Item = (&'a str, f64)>,
) -> Metric {
    let each = by_object(values);
    let value = each.iter().map(|(_, value)| value).sum::<f64>() / each.len() as f64;
    let metric = match better {
        Better::Larger => Metric::larger(name, value),
        Better::Smaller => Metric::smaller(name, value),
    };
    metric.of_objects(each)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
pub(crate) mod tests {
    use super::*;

    /// Every score that names objects is the mean of their values, each object once.
    pub(crate) fn assert_means(metrics: &[Metric], objects: usize) {
        assert!(metrics.iter().any(|metric| !metric.by_object.is_empty()));
        for metric in metrics.iter().filter(|metric| !metric.by_object.is_empty()) {
            let each = &metric.by_object;
            let mean = each.iter().map(|(_, value)| value).sum::<f64>() / each.len() as f64;
            assert!(mean == metric.value || mean.is_nan() && metric.value.is_nan(), "{metric:?}");
            let names: std::collections::BTreeSet<&String> = each.iter().map(|(n, _)| n).collect();
            assert_eq!((names.len(), each.len()), (objects, objects), "{metric:?}");
        }
    }

    #[test]
    fn an_object_counts_once_however_often_it_is_scored() {
        let values = [("a", 1.0), ("b", 4.0), ("a", 3.0), ("a", 2.0)];
        let metric = mean_metric("error", Better::Smaller, values);
        assert_eq!(metric.by_object, [("a".to_owned(), 2.0), ("b".to_owned(), 4.0)]);
        assert_eq!((metric.value, metric.better), (3.0, Better::Smaller));
        assert_means(&[metric], 2);
        assert!(mean_metric("error", Better::Smaller, []).value.is_nan());
    }

    #[test]
    fn what_is_not_there_is_an_error() {
        let parts = Subsets { test: vec![3], ..Subsets::default() };
        assert_eq!(wanted(&parts, Subset::Test).unwrap(), [3]);
        let error = wanted(&parts, Subset::Validation).unwrap_err().to_string();
        assert!(error.contains("for validation") && error.contains("for test"), "{error}");
    }

    #[test]
    fn identities_do_not_depend_on_the_place() {
        let entry = |category: &str, name: &str| Entry {
            category: category.into(),
            name: name.into(),
            ..Entry::default()
        };
        assert_eq!(identity(&entry("a", "b")), identity(&entry("a", "b")));
        assert_ne!(identity(&entry("a", "bc")), identity(&entry("ab", "c")));
        let low: Vec<u64> = (0..24).map(|i| identity(&entry("a", &i.to_string())) % 24).collect();
        assert!(low.iter().collect::<std::collections::BTreeSet<_>>().len() > 10, "{low:?}");
    }

    #[test]
    fn what_passes_through_itself_is_moved_apart_where_that_is_wanted() {
        let mut spiked = mesh_core::primitives::icosphere(3);
        spiked.positions[5] = spiked.positions[5].map(|x| -1.5 * x);
        assert!(finished(spiked.clone(), true).self_intersections().is_empty());
        assert_eq!(finished(spiked.clone(), false), spiked);
        // What is no mesh is not mended, for ever or at all.
        spiked.positions[7][1] = f32::NAN;
        let kept = finished(spiked.clone(), true).positions;
        assert_eq!(kept[5], spiked.positions[5]);
    }
}
