use crate::solve::Tableau;

/// The classical method of order 4, without error estimate. (torchdiffeq's `rk4` is Kutta's other one, the 3/8 rule.)
pub const RK4: Tableau = Tableau {
    name: "rk4",
    order: 4,
    a: &[&[], &[0.5], &[0.0, 0.5], &[0.0, 0.0, 1.0]],
    b: &[1.0 / 6.0, 1.0 / 3.0, 1.0 / 3.0, 1.0 / 6.0],
    c: &[0.0, 0.5, 0.5, 1.0],
    error: None,
    dense: None,
    carries_last: false,
    reference: "Kutta 1901, Zeitschrift für Mathematik und Physik 46",
}
.checked();
