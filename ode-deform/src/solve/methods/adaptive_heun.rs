use crate::solve::Tableau;

/// [`HEUN`](super::HEUN) whose last stage is used again as the first of the next step: one evaluation a step instead of
/// two. What torchdiffeq calls `adaptive_heun`.
///
/// The derivative that is carried on is that at the end of Euler's step, not of Heun's: the order is still 2, the
/// error of a step somewhat larger.
pub const ADAPTIVE_HEUN: Tableau = Tableau {
    name: "adaptive-heun",
    carries_last: true,
    reference: "Heun 1900, Zeitschrift für Mathematik und Physik 45; as torchdiffeq continues its steps",
    ..super::HEUN
}
.checked();
