use crate::solve::Tableau;

/// Kutta's 3/8 rule of order 4: the four stages are a third of a step apart. What torchdiffeq calls `rk4`.
pub const THREE_EIGHTHS: Tableau = Tableau {
    name: "three-eighths",
    order: 4,
    a: &[&[], &[1.0 / 3.0], &[-1.0 / 3.0, 1.0], &[1.0, -1.0, 1.0]],
    b: &[1.0 / 8.0, 3.0 / 8.0, 3.0 / 8.0, 1.0 / 8.0],
    c: &[0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0],
    error: None,
    dense: None,
    carries_last: false,
    reference: "Kutta 1901, Beitrag zur näherungsweisen Integration totaler Differentialgleichungen",
}
.checked();
