//! What is found for a query.

/// The point nearest to a query.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Nearest {
    /// Its index; the lowest one where several are equally near.
    pub index: u32,
    /// The squared distance to it.
    pub squared: f32,
}
