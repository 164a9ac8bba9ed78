//! Scores of each category, where what is scored has several.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use serde::Serialize;
use train::Metric;

/// Scores shown in the table on the screen; all of them are in the JSON.
const SHOWN: usize = 5;
/// The category of objects that have none.
const NONE: &str = "";

/// Scores of a category's objects.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct Category {
    /// How many were scored.
    pub(crate) objects: usize,
    /// Means over them, by the score's name.
    pub(crate) metrics: BTreeMap<String, f64>,
}

/// Scores by category, and the means over categories, in which each counts the same however many objects it has.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub(crate) struct ByCategory {
    pub(crate) by_category: BTreeMap<String, Category>,
    pub(crate) mean_over_categories: BTreeMap<String, f64>,
}

impl ByCategory {
    /// Of scores that are means over objects, whose names are `CATEGORY/NAME`; none where no object has a category. What is not a
    /// number says nothing of its category.
    pub(crate) fn of(metrics: &[Metric]) -> Option<Self> {
        let category =
            |name: &str| name.split_once('/').map_or(NONE, |(first, _)| first).to_owned();
        let mut found = Self::default();
        for metric in metrics {
            let mut sums: BTreeMap<String, (f64, usize, usize)> = BTreeMap::new();
            for (name, value) in &metric.by_object {
                let (sum, counted, all) = sums.entry(category(name)).or_default();
                *all += 1;
                if !value.is_nan() {
                    *sum += value;
                    *counted += 1;
                }
            }
            let mut means = Vec::new();
            for (name, (sum, counted, all)) in sums {
                let category = found.by_category.entry(name).or_default();
                category.objects = category.objects.max(all);
                if counted > 0 {
                    let mean = sum / counted as f64;
                    category.metrics.insert(metric.name.clone(), mean);
                    means.push(mean);
                }
            }
            if !means.is_empty() {
                let mean = means.iter().sum::<f64>() / means.len() as f64;
                found.mean_over_categories.insert(metric.name.clone(), mean);
            }
        }
        found.by_category.keys().any(|name| name != NONE).then_some(found)
    }

    /// A line a category and one of the means, for the first scores in this order; nothing where there is one category alone.
    pub(crate) fn text(&self, metrics: &[&str]) -> String {
        if self.by_category.len() < 2 {
            return String::new();
        }
        let has = |name: &&&str| self.mean_over_categories.contains_key(**name);
        let shown: Vec<&str> = metrics.iter().filter(has).take(SHOWN).copied().collect();
        let row = |name: &str, objects: String, of: &BTreeMap<String, f64>| {
            let mut row = vec![name.to_owned(), objects];
            row.extend(shown.iter().map(|metric| {
                of.get(*metric).map_or_else(|| "-".to_owned(), |value| format!("{value:.4}"))
            }));
            row
        };
        let head = ["", "objects"].iter().chain(&shown).map(|word| (*word).to_owned()).collect();
        let mut rows: Vec<Vec<String>> = vec![head];
        rows.extend(
            self.by_category
                .iter()
                .map(|(name, category)| row(name, category.objects.to_string(), &category.metrics)),
        );
        rows.push(row("mean of these", String::new(), &self.mean_over_categories));
        let widths: Vec<usize> = (0..rows[0].len())
            .map(|k| rows.iter().map(|row| row[k].chars().count()).max().unwrap_or(0))
            .collect();
        let mut text = "\nBy category:\n".to_owned();
        for row in rows {
            let _ = write!(text, "{:1$}", row[0], widths[0]);
            for (cell, width) in row.iter().zip(&widths).skip(1) {
                let _ = write!(text, "  {cell:>width$}");
            }
            text.push('\n');
        }
        text
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    fn metric(name: &str, values: &[(&str, f64)]) -> Metric {
        let each = values.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect();
        Metric::larger(name, 0.0).of_objects(each)
    }

    #[test]
    fn each_category_counts_the_same_in_the_mean() {
        let metrics = [
            metric(
                "iou",
                &[("chair/1", 0.25), ("bus/1", 1.0), ("chair/2", 0.75), ("bus/2", f64::NAN)],
            ),
            metric("hits", &[("chair/1", f64::NAN), ("bus/1", 3.0), ("chair/2", f64::NAN)]),
            Metric::larger("lonely", 7.0),
        ];
        let found = ByCategory::of(&metrics).unwrap();
        assert_eq!(found.by_category["chair"].metrics["iou"], 0.5);
        assert_eq!(found.by_category["bus"].metrics["iou"], 1.0);
        assert_eq!([found.by_category["chair"].objects, found.by_category["bus"].objects], [2, 2]);
        assert_eq!(found.mean_over_categories["iou"], 0.75);
        assert_eq!(found.mean_over_categories["hits"], 3.0);
        let expected = "\nBy category:\n\
                        \x20              objects     iou    hits\n\
                        bus                  2  1.0000  3.0000\n\
                        chair                2  0.5000       -\n\
                        mean of these           0.7500  3.0000\n";
        assert_eq!(found.text(&["iou", "hits", "lonely"]), expected);
    }

    #[test]
    fn without_categories_there_are_none() {
        assert_eq!(ByCategory::of(&[metric("iou", &[("a", 1.0)]), Metric::larger("x", 1.0)]), None);
        let one = ByCategory::of(&[metric("iou", &[("bus/a", 1.0)])]).unwrap();
        assert_eq!(one.text(&["iou"]), "");
    }
}
