use crate::solve::Tableau;

/// Euler's method: order 1, one evaluation a step.
pub const EULER: Tableau = Tableau {
    name: "euler",
    order: 1,
    a: &[&[]],
    b: &[1.0],
    c: &[0.0],
    error: None,
    dense: None,
    carries_last: false,
    reference: "Euler 1768, Institutiones calculi integralis",
}
.checked();
