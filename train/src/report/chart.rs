//! Line charts as inline SVG: what a page can carry without a plotting library.

use std::fmt::Write as _;

/// Colours that stay apart for most kinds of colour vision (Okabe and Ito's set).
const COLORS: [&str; 6] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9"];
const WIDTH: f64 = 520.0;
const HEIGHT: f64 = 260.0;
const LEFT: f64 = 62.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 34.0;
const BOTTOM: f64 = 34.0;
/// More points than this add bytes but nothing to see at the chart's width.
const MOST_POINTS: usize = 400;
/// The width of a range between larger numbers need not be one.
const LARGEST: f64 = 1e300;

/// One named line of a [`Chart`].
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// The name in the legend.
    pub name: String,
    /// The points `(x, y)`, in rising order of x. Those that are not finite, or beyond 1e300, are left out.
    pub points: Vec<(f64, f64)>,
}

/// A line chart.
///
/// ```
/// use train::report::{Chart, Series};
/// let halving = Series::new("loss", (0..8).map(|k| (k as f64, 0.5f64.powi(k))).collect());
/// let svg = Chart::new("Loss", "step", vec![halving]).logarithmic().to_svg();
/// assert!(svg.starts_with("<svg") && svg.contains("polyline"));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// The title above the chart.
    pub title: String,
    /// What the horizontal axis counts.
    pub x_label: String,
    /// Whether the vertical axis is logarithmic; values at or below zero are then left out.
    pub logarithmic: bool,
    /// The lines.
    pub series: Vec<Series>,
}

impl Series {
    /// Points under a name.
    pub fn new(name: impl Into<String>, points: Vec<(f64, f64)>) -> Self {
        Self { name: name.into(), points }
    }
}

impl Chart {
    /// Lines over an axis that counts `x_label`.
    pub fn new(title: impl Into<String>, x_label: impl Into<String>, series: Vec<Series>) -> Self {
        Self { title: title.into(), x_label: x_label.into(), logarithmic: false, series }
    }

    /// The same with a logarithmic vertical axis.
    #[must_use]
    pub fn logarithmic(self) -> Self {
        Self { logarithmic: true, ..self }
    }

    /// The chart as an `<svg>` element that follows the page's colours and width.
    ///
    /// A chart without a single drawable point says so in its place.
    pub fn to_svg(&self) -> String {
        let lines: Vec<Vec<(f64, f64)>> =
            self.series.iter().map(|s| thin(&self.drawable(&s.points))).collect();
        let mut svg = format!(
            "<svg class=\"chart\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{title}\">\
             <text class=\"title\" x=\"{LEFT}\" y=\"16\">{title}</text>",
            title = super::escape(&self.title)
        );
        let Some(frame) = Frame::around(lines.iter().flatten().copied()) else {
            svg.push_str("<text x=\"62\" y=\"120\">nothing to draw</text></svg>");
            return svg;
        };
        self.axes(&frame, &mut svg);
        // Few names may be long.
        let apart = ((WIDTH - LEFT - RIGHT) / lines.len().max(1) as f64).max(92.0);
        for (k, (line, series)) in lines.iter().zip(&self.series).enumerate() {
            let color = COLORS[k % COLORS.len()];
            let mut path = String::new();
            for &(x, y) in line {
                let _ = write!(path, "{:.1},{:.1} ", frame.x(x), frame.y(y));
            }
            let _ = write!(
                svg,
                "<polyline fill=\"none\" stroke=\"{color}\" stroke-width=\"1.6\" points=\"{}\"/>\
                 <rect x=\"{:.0}\" y=\"22\" width=\"10\" height=\"3\" fill=\"{color}\"/>\
                 <text x=\"{:.0}\" y=\"28\">{}</text>",
                path.trim_end(),
                LEFT + apart * k as f64,
                LEFT + apart * k as f64 + 14.0,
                super::escape(&series.name)
            );
        }
        svg.push_str("</svg>");
        svg
    }

    fn drawable(&self, points: &[(f64, f64)]) -> Vec<(f64, f64)> {
        let within = |v: f64| v.abs() <= LARGEST;
        points
            .iter()
            .filter(|(x, y)| within(*x) && within(*y) && (!self.logarithmic || *y > 0.0))
            .map(|&(x, y)| (x, if self.logarithmic { y.log10() } else { y }))
            .collect()
    }

    fn axes(&self, frame: &Frame, svg: &mut String) {
        for value in ticks(frame.low.1, frame.high.1) {
            let y = frame.y(value);
            let label = if self.logarithmic { short(10f64.powf(value)) } else { short(value) };
            let _ = write!(
                svg,
                "<line class=\"grid\" x1=\"{LEFT}\" x2=\"{}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>\
                 <text x=\"{}\" y=\"{:.1}\" text-anchor=\"end\">{label}</text>",
                WIDTH - RIGHT,
                LEFT - 6.0,
                y + 4.0
            );
        }
        for value in ticks(frame.low.0, frame.high.0) {
            let x = frame.x(value);
            let _ = write!(
                svg,
                "<text x=\"{x:.1}\" y=\"{:.1}\" text-anchor=\"middle\">{}</text>",
                HEIGHT - BOTTOM + 16.0,
                short(value)
            );
        }
        let _ = write!(
            svg,
            "<text x=\"{}\" y=\"{}\" text-anchor=\"end\">{}</text>",
            WIDTH - RIGHT,
            HEIGHT - 3.0,
            super::escape(&self.x_label)
        );
    }
}

/// The ranges of both axes.
struct Frame {
    low: (f64, f64),
    high: (f64, f64),
}

impl Frame {
    fn around(points: impl Iterator<Item = (f64, f64)>) -> Option<Self> {
        let mut frame: Option<Self> = None;
        for (x, y) in points {
            let f = frame.get_or_insert(Self { low: (x, y), high: (x, y) });
            f.low = (f.low.0.min(x), f.low.1.min(y));
            f.high = (f.high.0.max(x), f.high.1.max(y));
        }
        let mut frame = frame?;
        // A level line still needs a height to be drawn in, and a single point a width.
        let (low, high) = (&mut frame.low, &mut frame.high);
        if is_level(low.1, high.1) {
            (low.1, high.1) = (low.1 - room(low.1, 0.5), high.1 + room(high.1, 0.5));
        }
        if is_level(low.0, high.0) {
            high.0 += room(high.0, 1.0);
        }
        Some(frame)
    }

    fn x(&self, v: f64) -> f64 {
        LEFT + (v - self.low.0) / (self.high.0 - self.low.0) * (WIDTH - LEFT - RIGHT)
    }

    fn y(&self, v: f64) -> f64 {
        HEIGHT - BOTTOM - (v - self.low.1) / (self.high.1 - self.low.1) * (HEIGHT - TOP - BOTTOM)
    }
}

/// Whether a range is too narrow to be divided by.
fn is_level(low: f64, high: f64) -> bool {
    high - low < 1e-12 || high - low < 1e-12 * low.abs().max(high.abs())
}

/// So much beside a value, or more where that is less than the value's own precision.
fn room(value: f64, least: f64) -> f64 {
    least.max(1e-9 * value.abs())
}

/// Round values of 1, 2 or 5 times a power of ten that fall into the range; four to nine of them.
fn ticks(low: f64, high: f64) -> Vec<f64> {
    let raw = (high - low) / 5.0;
    let power = 10f64.powf(raw.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= raw * 0.999);
    let step = step.unwrap_or(raw);
    let first = (low / step).ceil() as i64;
    let last = (high / step).floor() as i64;
    (first..=last.min(first.saturating_add(20))).map(|k| k as f64 * step).collect()
}

/// A number in at most five characters or so.
fn short(v: f64) -> String {
    let a = v.abs();
    if a == 0.0 {
        "0".into()
    } else if !(1e-3..1e5).contains(&a) {
        format!("{v:.0e}")
    } else {
        let text = format!(
            "{v:.*}",
            if a >= 100.0 {
                0
            } else if a >= 1.0 {
                2
            } else {
                4
            }
        );
        if text.contains('.') {
            text.trim_end_matches('0').trim_end_matches('.').into()
        } else {
            text
        }
    }
}

/// Averages runs of points until there are few enough.
fn thin(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let run = points.len().div_ceil(MOST_POINTS).max(1);
    points
        .chunks(run)
        .map(|c| {
            let n = c.len() as f64;
            (c.iter().map(|p| p.0).sum::<f64>() / n, c.iter().map(|p| p.1).sum::<f64>() / n)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chart(points: Vec<(f64, f64)>, logarithmic: bool) -> String {
        let series = vec![Series { name: "a<b".into(), points }];
        Chart { title: "T&C".into(), x_label: "step".into(), logarithmic, series }.to_svg()
    }

    #[test]
    fn names_are_escaped() {
        let svg = chart(vec![(0.0, 1.0), (1.0, 2.0)], false);
        assert!(svg.contains("a&lt;b") && svg.contains("T&amp;C"));
    }

    #[test]
    fn what_cannot_be_drawn_is_left_out() {
        let svg = chart(vec![(0.0, 0.0), (1.0, f64::NAN), (2.0, -3.0)], true);
        assert!(svg.contains("nothing to draw"));
        assert!(!chart(vec![(0.0, f64::INFINITY), (1.0, 2.0)], false).contains("inf"));
    }

    /// Half a unit beside 1e16 is nothing.
    #[test]
    fn large_numbers_have_room_around_them() {
        for y in [1e15, 1e16, -1e17, 1e300, f64::MAX] {
            for x in [0.0, 1.0, 1e16, 1e300] {
                for points in [vec![(x, y)], vec![(0.0, y), (x, y)], vec![(-x, y), (x, -y)]] {
                    let svg = chart(points, false);
                    assert!(!svg.contains("NaN") && !svg.contains("inf"), "{x} {y}: {svg}");
                    assert_eq!(svg.contains("polyline"), y < f64::MAX);
                }
            }
        }
        assert!(ticks(1e17, 1e17).len() < 2);
    }

    #[test]
    fn long_series_are_thinned() {
        let svg = chart((0..100_000).map(|k| (k as f64, 1.0 + k as f64)).collect(), true);
        assert!(svg.len() < 20_000, "{} bytes", svg.len());
    }

    #[test]
    fn ticks_are_round_and_inside() {
        assert_eq!(ticks(0.0, 10.0), vec![0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert!(ticks(-2.31, -1.02).iter().all(|t| (-2.31..=-1.02).contains(t)));
    }
}
