//! A row's values on a line as long as the range of its column.

use std::fmt::Write as _;

use crate::table::{Line, Table};

const WIDTH: f64 = 96.0;
const HEIGHT: f64 = 10.0;
const MARGIN: f64 = 4.0;

/// Dots for the seeds over a bar for the interval, as inline SVG; nothing where the column does not vary.
pub(crate) fn strip(table: &Table, row: &Line, column: usize) -> String {
    let all = table.rows.iter().flat_map(|row| {
        let ends = row.intervals[column].map(|interval| [interval.low, interval.high]);
        row.values[column].iter().copied().chain(ends.into_iter().flatten())
    });
    let range = all.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| {
        [low.min(value), high.max(value)]
    });
    let [low, high] = range;
    let values = &row.values[column];
    if values.is_empty() || !(high - low).is_normal() || table.columns[column].better.is_none() {
        return String::new();
    }
    let x = |value: f64| MARGIN + (WIDTH - 2.0 * MARGIN) * (value - low) / (high - low);
    let middle = 0.5 * HEIGHT;
    let mut svg = format!(
        "<svg class=\"strip\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" width=\"{WIDTH}\" height=\"{HEIGHT}\" aria-hidden=\"true\">\
         <line x1=\"{MARGIN}\" x2=\"{}\" y1=\"{middle}\" y2=\"{middle}\" stroke=\"currentColor\" stroke-width=\"0.4\"/>",
        WIDTH - MARGIN
    );
    if let Some(interval) = row.intervals[column] {
        let _ = write!(
            svg,
            "<line x1=\"{:.1}\" x2=\"{:.1}\" y1=\"{middle}\" y2=\"{middle}\" stroke=\"#0072b2\" stroke-width=\"3\" opacity=\"0.45\"/>",
            x(interval.low),
            x(interval.high)
        );
    }
    for &value in values {
        let _ = write!(
            svg,
            "<circle cx=\"{:.1}\" cy=\"{middle}\" r=\"2\" fill=\"#0072b2\"/>",
            x(value)
        );
    }
    svg + "</svg>"
}
