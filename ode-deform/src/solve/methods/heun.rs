use crate::solve::Tableau;

/// Heun's method of order 2: `y + h/2 (k1 + k2)`. Its error estimate is the difference to Euler's.
pub const HEUN: Tableau = Tableau {
    name: "heun",
    order: 2,
    a: &[&[], &[1.0]],
    b: &[0.5, 0.5],
    c: &[0.0, 1.0],
    error: Some(&[-0.5, 0.5]),
    dense: None,
    carries_last: false,
    reference: "Heun 1900, Zeitschrift für Mathematik und Physik 45",
}
.checked();
