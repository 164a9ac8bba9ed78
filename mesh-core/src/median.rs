//! The middle of a list of numbers.

use crate::Scalar;

/// What the median of an even number of values is: definitions differ, and with them results.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MedianOfEven {
    /// The lower of the two in the middle, as PyTorch's `median` has it: one of the values.
    Lower,
    /// The upper of the two: one of the values.
    Upper,
    /// The mean of the two, the statistician's and NumPy's `median`.
    Mean,
}

/// The median: the value that is in the middle once all are sorted. `None` if there are none.
///
/// Values are ordered as `total_cmp` does it: `-NaN, -∞, .., ∞, NaN`, so that NaNs count as the largest (or smallest).
///
/// ```
/// use mesh_core::{MedianOfEven, median};
///
/// let values = [4.0, 1.0, 3.0, 2.0];
/// assert_eq!(median(values, MedianOfEven::Lower), Some(2.0));
/// assert_eq!(median(values, MedianOfEven::Upper), Some(3.0));
/// assert_eq!(median(values, MedianOfEven::Mean), Some(2.5));
/// assert_eq!(median([0.5_f32; 0], MedianOfEven::Mean), None);
/// ```
///
/// # Cost
/// `O(n)` time and memory.
pub fn median<T: Scalar>(values: impl IntoIterator<Item = T>, of_even: MedianOfEven) -> Option<T> {
    let mut values: Vec<T> = values.into_iter().collect();
    // Widening keeps the order, that of NaNs and zeros included.
    let order = |a: &T, b: &T| a.widened().total_cmp(&b.widened());
    let (lower, upper) = (values.len().checked_sub(1)? / 2, values.len() / 2);
    let mut at = |place: usize| *values.select_nth_unstable_by(place, order).1;
    Some(match of_even {
        MedianOfEven::Lower => at(lower),
        MedianOfEven::Upper => at(upper),
        MedianOfEven::Mean if lower == upper => at(upper),
        MedianOfEven::Mean => {
            let (low, high) = (at(lower).widened(), at(upper).widened());
            T::narrowed(f64::midpoint(low, high))
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_odd_number_of_values_has_one_in_the_middle() {
        for of_even in [MedianOfEven::Lower, MedianOfEven::Upper, MedianOfEven::Mean] {
            assert_eq!(median([9.0_f32, -1.0, 2.0], of_even), Some(2.0));
            assert_eq!(median([7.0], of_even), Some(7.0));
            assert_eq!(median([f64::NAN, 1.0, 5.0], of_even), Some(5.0));
        }
    }

    #[test]
    fn medians_are_those_of_the_sorted_values() {
        let values: Vec<f64> = (0..40).map(|k| ((k * 7 % 11) as f64).sin()).collect();
        let mut sorted = values.clone();
        sorted.sort_by(f64::total_cmp);
        let of = |of_even| median(values.iter().copied(), of_even);
        assert_eq!(of(MedianOfEven::Lower), Some(sorted[19]));
        assert_eq!(of(MedianOfEven::Upper), Some(sorted[20]));
        assert_eq!(of(MedianOfEven::Mean), Some(0.5 * (sorted[19] + sorted[20])));
    }
}
