use crate::solve::Tableau;

/// The explicit midpoint rule, order 2: `y + h f(t + h/2, y + h/2 k1)`. Its error estimate is the difference to
/// Euler's.
pub const MIDPOINT: Tableau = Tableau {
    name: "midpoint",
    order: 2,
    a: &[&[], &[0.5]],
    b: &[0.0, 1.0],
    c: &[0.0, 0.5],
    error: Some(&[-1.0, 1.0]),
    dense: None,
    carries_last: false,
    reference: "Runge 1895, Mathematische Annalen 46",
}
.checked();
