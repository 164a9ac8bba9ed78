//! Boxes along the axes, as [`TriMesh::bounds`](crate::TriMesh::bounds) gives them.
//!
//! ```
//! use mesh_core::{bounds, primitives};
//!
//! let around = primitives::cuboid([1.0, 2.0, 2.0]).translated([5.0, 0.0, 0.0]).bounds().unwrap();
//! assert_eq!(bounds::center(around), [5.0, 0.0, 0.0]);
//! assert_eq!(bounds::sides(around), [1.0, 2.0, 2.0]);
//! assert_eq!(bounds::longest_side(around), 2.0);
//! assert_eq!(bounds::diagonal::<f64>(around), 3.0);
//! ```

use crate::Scalar;
use crate::vector::{norm, sub};

/// The lower and the upper corner of a box.
pub type Bounds = ([f32; 3], [f32; 3]);

/// The middle of a box between two corners.
#[inline]
pub fn center<T: Scalar>((low, high): ([T; 3], [T; 3])) -> [T; 3] {
    std::array::from_fn(|k| T::narrowed(0.5) * (low[k] + high[k]))
}

/// The lengths of a box, from its lower corner to its upper one.
#[inline]
pub fn sides<T: Scalar>((low, high): ([T; 3], [T; 3])) -> [T; 3] {
    sub(high, low)
}

/// The largest of the lengths of a box; 0 if none is above 0.
pub fn longest_side<T: Scalar>(bounds: ([T; 3], [T; 3])) -> T {
    let longer = |longest: T, side: T| if side > longest { side } else { longest };
    sides(bounds).into_iter().fold(T::default(), longer)
}

/// The length of a box's diagonal. Its sides are rounded to `f32`, as its corners are, and squared and added in the
/// precision that is asked for.
pub fn diagonal<T: Scalar>(bounds: Bounds) -> T {
    norm(sides(bounds).map(|side| T::narrowed(f64::from(side))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn precision_is_the_one_asked_for() {
        let bounds = ([-0.1, 0.3, 0.0], [0.7, 0.4, 0.9]);
        let [x, y, z] = sides(bounds);
        assert_eq!(diagonal::<f32>(bounds), (x * x + y * y + z * z).sqrt());
        let [x, y, z] = [x, y, z].map(f64::from);
        assert_eq!(diagonal::<f64>(bounds), (x * x + y * y + z * z).sqrt());
    }

    #[test]
    fn a_box_upside_down_has_no_longest_side() {
        assert_eq!(longest_side(([1.0; 3], [0.0, f64::NAN, -1.0])), 0.0);
    }
}
