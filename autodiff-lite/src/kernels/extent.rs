//! How many elements sizes and steps span: products that never wrap.
//!
//! A slice whose length was compared with a wrapped product is shorter than what a kernel goes
//! through, and the pointers behind vector loads ask nobody. So every length that a kernel
//! checks, and every `SAFETY` that rests on one, goes through here, whatever the build's
//! overflow checks are.

/// The elements of an array of these sizes; none if one of them is 0, however large the others.
///
/// # Panics
/// If they are more than a slice can have.
#[track_caller]
pub(crate) fn elements(sizes: &[usize]) -> usize {
    if sizes.contains(&0) {
        return 0;
    }
    let product = sizes.iter().try_fold(1, |product: usize, &size| product.checked_mul(size));
    match product {
        Some(product) if isize::try_from(product).is_ok() => product,
        _ => panic!("{sizes:?} are more elements than a slice can have"),
    }
}

/// The elements that an array of these sizes reaches over, where one step along an axis is
/// `steps` elements; none if one of the sizes is 0.
///
/// # Panics
/// If they are more than a slice can have.
#[track_caller]
pub(crate) fn reach<const N: usize>(sizes: [usize; N], steps: [usize; N]) -> usize {
    if sizes.contains(&0) {
        return 0;
    }
    let furthest = sizes
        .iter()
        .zip(steps)
        .try_fold(0, |sum: usize, (&size, step)| sum.checked_add((size - 1).checked_mul(step)?));
    match furthest {
        Some(furthest) if furthest < isize::MAX as usize => furthest + 1,
        _ => panic!("{sizes:?} by steps of {steps:?} are more elements than a slice can have"),
    }
}

/// How much work a product of sizes is, to compare with a threshold: as much as there is where
/// the number would wrap.
pub(crate) fn work(sizes: &[usize]) -> usize {
    sizes.iter().fold(1, |product: usize, &size| product.saturating_mul(size))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn products_and_reaches() {
        assert_eq!(elements(&[3, 4, 5]), 60);
        assert_eq!(elements(&[]), 1);
        assert_eq!(elements(&[usize::MAX, 2, 0]), 0);
        assert_eq!(reach([3, 4], [10, 2]), 27);
        assert_eq!(reach([1, 0], [usize::MAX, 2]), 0);
        assert_eq!(reach([1, 1], [usize::MAX, usize::MAX]), 1);
        assert_eq!(work(&[usize::MAX, 2]), usize::MAX);
    }

    #[test]
    #[should_panic(expected = "more elements than a slice can have")]
    fn a_product_that_wraps() {
        elements(&[1 << 32, 1 << 32, 1]);
    }

    #[test]
    #[should_panic(expected = "more elements than a slice can have")]
    fn a_product_that_no_slice_has() {
        elements(&[1 << 63]);
    }

    #[test]
    #[should_panic(expected = "more elements than a slice can have")]
    fn a_reach_that_wraps() {
        reach([4, 2], [usize::MAX / 3 + 1, 1]);
    }
}
