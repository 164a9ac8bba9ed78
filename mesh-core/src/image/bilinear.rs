//! Values between the centres of pixels.

/// Bilinear interpolation at a place of a grid of `[columns, rows]` values; beyond its border that of the border.
///
/// A place is a column and a row, fractions allowed, that counts from the first value: where those stand for pixels, from the centre of the
/// first pixel, half a pixel inside of the image's border. `value` takes row and column.
///
/// ```
/// let values = [[0.0, 1.0], [2.0, 3.0]];
/// let at = |place| mesh_core::bilinear([2, 2], place, |row, column| [values[row][column]]);
/// assert_eq!(at([0.5, 0.5]), [1.5]);
/// assert_eq!(at([9.0, 0.0]), [1.0]);
/// ```
///
/// # Panics
/// If there are no values.
#[inline]
pub fn bilinear<const K: usize>(
    [columns, rows]: [usize; 2],
    [column, row]: [f32; 2],
    value: impl Fn(usize, usize) -> [f32; K],
) -> [f32; K] {
    let (left, right, s) = between(column, columns);
    let (top, bottom, t) = between(row, rows);
    let [a, b] = [value(top, left), value(top, right)];
    let [c, d] = [value(bottom, left), value(bottom, right)];
    std::array::from_fn(|k| {
        let upper = a[k] + s * (b[k] - a[k]);
        let lower = c[k] + s * (d[k] - c[k]);
        upper + t * (lower - upper)
    })
}

/// As [`bilinear`], outside of the image what it shows when it is repeated: what OBJ and, by default, glTF say of texture
/// coordinates beyond 0 to 1.
///
/// ```
/// let values = [[0.0, 1.0], [2.0, 3.0]];
/// let at = |place| mesh_core::bilinear_repeat([2, 2], place, |row, column| [values[row][column]]);
/// assert_eq!(at([1.0, 0.0]), [1.0]);
/// assert_eq!(at([2.0, 0.0]), [0.0]);
/// assert_eq!(at([-1.0, 3.0]), [3.0]);
/// ```
///
/// # Panics
/// If there are no values.
#[inline]
pub fn bilinear_repeat<const K: usize>(
    size: [usize; 2],
    place: [f32; 2],
    value: impl Fn(usize, usize) -> [f32; K],
) -> [f32; K] {
    let inside = std::array::from_fn(|axis| {
        let (x, length) = (place[axis], size[axis] as f32);
        // The image reaches half a pixel beyond the centres of its outer pixels.
        if x < -0.5 || x > length - 0.5 { (x + 0.5).rem_euclid(length) - 0.5 } else { x }
    });
    bilinear(size, inside, value)
}

/// The values before and after a place, and how far it is from the first to the second.
#[inline]
fn between(place: f32, count: usize) -> (usize, usize, f32) {
    let place = place.clamp(0.0, (count - 1) as f32);
    // Thirty-two bits become a float in one instruction.
    let low = place as i32;
    (low as usize, (low as usize + 1).min(count - 1), place - low as f32)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_plane_is_met_inside_and_held_beyond(
            columns in 1..9_usize, rows in 1..9_usize, x in -2.0..10.0_f32, y in -2.0..10.0_f32,
        ) {
            let plane = |row: f32, column: f32| 0.5 + 2.0 * column - 3.0 * row;
            let found = bilinear([columns, rows], [x, y], |i, j| [plane(i as f32, j as f32), 1.0]);
            let inside = |place: f32, count: usize| place.clamp(0.0, (count - 1) as f32);
            let expected = plane(inside(y, rows), inside(x, columns));
            prop_assert!((found[0] - expected).abs() < 1e-4, "{found:?} for {expected}");
            prop_assert_eq!(found[1], 1.0);
        }
    }
}
