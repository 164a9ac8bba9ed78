use crate::solve::Tableau;

/// Bogacki and Shampine's pair of orders 3 and 2: three evaluations a step, for loose tolerances.
pub const BOSH3: Tableau = Tableau {
    name: "bosh3",
    order: 3,
    a: &[&[], &[1.0 / 2.0], &[0.0, 3.0 / 4.0], &[2.0 / 9.0, 1.0 / 3.0, 4.0 / 9.0]],
    b: &[2.0 / 9.0, 1.0 / 3.0, 4.0 / 9.0, 0.0],
    c: &[0.0, 1.0 / 2.0, 3.0 / 4.0, 1.0],
    error: Some(&[
        2.0 / 9.0 - 7.0 / 24.0,
        1.0 / 3.0 - 1.0 / 4.0,
        4.0 / 9.0 - 1.0 / 3.0,
        -1.0 / 8.0,
    ]),
    dense: None,
    carries_last: false,
    reference: "Bogacki, Shampine 1989, A 3(2) pair of Runge-Kutta formulas",
}
.checked();
