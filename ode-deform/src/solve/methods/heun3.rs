use crate::solve::Tableau;

/// Heun's method of three stages and order 3. What torchdiffeq calls `heun3`.
pub const HEUN3: Tableau = Tableau {
    name: "heun3",
    order: 3,
    a: &[&[], &[1.0 / 3.0], &[0.0, 2.0 / 3.0]],
    b: &[1.0 / 4.0, 0.0, 3.0 / 4.0],
    c: &[0.0, 1.0 / 3.0, 2.0 / 3.0],
    error: None,
    dense: None,
    carries_last: false,
    reference: "Heun 1900, Zeitschrift für Mathematik und Physik 45",
}
.checked();
