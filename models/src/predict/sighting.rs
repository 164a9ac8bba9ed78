//! What a network's encoder says of an object.

use autodiff_lite::{Tensor, Var};

/// What a system's encoder says of an object's images: a vector for each, all of the same length.
pub type Features = Vec<Vec<f32>>;

/// The strongest answer of each filter anywhere in an image, map after map: what it shows, wherever and however large.
///
/// # Shapes
/// `maps [N, H, W, C]` each, of any sizes; `N` vectors of as many numbers as there are channels in all maps.
pub(crate) fn strongest(maps: &[Var<'_>]) -> Features {
    let Some(images) = maps.first().map(|map| map.shape()[0]) else { return Features::new() };
    let rows: Vec<_> = maps.iter().map(|map| map.max_axis(1).max_axis(1).value()).collect();
    let of = |image: usize| {
        let row = |row: &Tensor<f32>| {
            row.as_slice().chunks(row.shape()[1]).nth(image).map(<[f32]>::to_vec)
        };
        rows.iter().filter_map(row).flatten().collect()
    };
    (0..images).map(of).collect()
}

/// Features of an object of a dataset.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sighting {
    /// The name of the object's family, as the dataset has it.
    pub family: String,
    /// Those of its images.
    pub features: Features,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_strongest_answer_is_taken_of_each_filter() {
        let tape = autodiff_lite::Tape::eval();
        let map = |side: usize| {
            tape.constant(ndarray::Array4::from_shape_fn((2, side, 1, 2), |(n, i, _, c)| {
                (100 * n + 10 * c + i) as f32
            }))
        };
        let found = strongest(&[map(3), map(1)]);
        assert_eq!(found, [[2.0, 12.0, 0.0, 10.0], [102.0, 112.0, 100.0, 110.0]]);
        assert_eq!(strongest(&[]), Features::new());
    }
}
