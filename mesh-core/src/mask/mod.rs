//! Masks: which pixels of an image are of an object.

mod components;
mod signed_distance;

pub use components::Components;

use crate::ByteImage;

/// Pixels of an image that are of an object.
///
/// ```
/// use mesh_core::Mask;
/// let text = ["......", ".####.", ".#..#.", ".####."];
/// let mask = Mask::from_fn(4, 6, |i, j| text[i].as_bytes()[j] == b'#');
/// assert_eq!(mask.count(), 10);
/// assert_eq!(mask.components().sizes, [10]);
/// assert_eq!(mask.inverted().components().sizes, [12, 2]); // the second is a hole
/// assert!(mask.touches_border());
/// ```
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Mask {
    /// Number of rows.
    pub height: usize,
    /// Number of columns.
    pub width: usize,
    /// Whether a pixel is of the object, `height * width` of them, row by row from the top.
    pub data: Vec<bool>,
}

impl Mask {
    /// The pixels, by row and column, of which something is true.
    pub fn from_fn(height: usize, width: usize, of: impl Fn(usize, usize) -> bool) -> Self {
        let data = (0..height).flat_map(|i| (0..width).map(move |j| (i, j)));
        Self { height, width, data: data.map(|(i, j)| of(i, j)).collect() }
    }

    /// The pixels whose first channel has at least this value.
    pub fn at_least(image: &ByteImage, value: u8) -> Self {
        let data = image.data.iter().step_by(image.channels.max(1)).map(|&v| v >= value).collect();
        Self { height: image.height, width: image.width, data }
    }

    /// How many pixels are of the object.
    pub fn count(&self) -> usize {
        self.data.iter().filter(|pixel| **pixel).count()
    }

    /// The background for the object, and the object for the background.
    #[must_use]
    pub fn inverted(&self) -> Self {
        let data = self.data.iter().map(|pixel| !pixel).collect();
        Self { data, ..*self }
    }

    /// The pixels that are of the object or touch one that is, by a side or a corner: dilation by a square of three pixels a side.
    #[must_use]
    pub fn dilated(&self) -> Self {
        let width = self.width.max(1);
        let mut wider = self.data.clone();
        for (wide, line) in wider.chunks_exact_mut(width).zip(self.data.chunks_exact(width)) {
            for (wide, pair) in wide.iter_mut().zip(line.windows(2)) {
                *wide |= pair[1];
            }
            for (wide, pair) in wide[1..].iter_mut().zip(line.windows(2)) {
                *wide |= pair[0];
            }
        }
        let mut data = wider.clone();
        for (grown, below) in data.iter_mut().zip(wider.iter().skip(width)) {
            *grown |= below;
        }
        for (grown, above) in data.iter_mut().skip(width).zip(&wider) {
            *grown |= above;
        }
        Self { data, ..*self }
    }

    /// The outermost pixels of the object: those on the border of the image, or beside the background by one of their sides.
    #[must_use]
    pub fn outline(&self) -> Self {
        Self::from_fn(self.height, self.width, |i, j| self.is_outline(i, j))
    }

    /// Whether a pixel is of the [outline](Self::outline).
    ///
    /// # Panics
    /// If there is no such pixel.
    pub fn is_outline(&self, i: usize, j: usize) -> bool {
        let at = i * self.width + j;
        let beside = || [at - 1, at + 1, at - self.width, at + self.width];
        self.data[at] && (self.is_border(at) || beside().iter().any(|&k| !self.data[k]))
    }

    /// Whether a pixel, counted row by row, is on the border of the image.
    pub fn is_border(&self, pixel: usize) -> bool {
        let (i, j) = (pixel / self.width, pixel % self.width);
        i == 0 || j == 0 || i + 1 == self.height || j + 1 == self.width
    }

    /// Whether the object reaches the border of the image.
    pub fn touches_border(&self) -> bool {
        let (height, width) = (self.height, self.width);
        let on = |i: usize, j: usize| self.data[i * width + j];
        (0..width).any(|j| height > 0 && (on(0, j) || on(height - 1, j)))
            || (0..height).any(|i| width > 0 && (on(i, 0) || on(i, width - 1)))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn any_mask() -> impl Strategy<Value = Mask> {
        (1..8_usize, 1..8_usize).prop_flat_map(|(height, width)| {
            let data = prop::collection::vec(any::<bool>(), height * width);
            data.prop_map(move |data| Mask { height, width, data })
        })
    }

    /// Whether something is true of a pixel that is at most so far away in rows and columns, and in their sum.
    fn near(mask: &Mask, at: [usize; 2], sum: usize, of: impl Fn(bool) -> bool) -> bool {
        (0..mask.data.len()).any(|k| {
            let apart = [(k / mask.width).abs_diff(at[0]), (k % mask.width).abs_diff(at[1])];
            apart.iter().all(|&d| d <= 1) && apart[0] + apart[1] <= sum && of(mask.data[k])
        })
    }

    proptest! {
        #[test]
        fn what_is_dilated_and_what_is_outline_is_as_defined(mask in any_mask()) {
            let (height, width) = (mask.height, mask.width);
            prop_assert_eq!(mask.dilated(), Mask::from_fn(height, width, |i, j| near(&mask, [i, j], 2, |on| on)));
            let border = |i: usize, j: usize| i == 0 || j == 0 || i + 1 == height || j + 1 == width;
            let outermost = |i: usize, j: usize| {
                mask.data[i * width + j] && (border(i, j) || near(&mask, [i, j], 1, |on| !on))
            };
            prop_assert_eq!(mask.outline(), Mask::from_fn(height, width, outermost));
            let near_edge = mask.signed_distance(0.0).data.into_iter().map(|d| d <= 1.0);
            // Where there is no object, or nothing else, all is far from its edge.
            if mask.count() > 0 {
                prop_assert_eq!(mask.dilated().data, near_edge.collect::<Vec<_>>());
            }
            let touches = (0..mask.data.len()).any(|k| mask.data[k] && mask.is_border(k));
            prop_assert_eq!(mask.touches_border(), touches);
        }
    }

    #[test]
    fn nothing_is_a_mask_too() {
        let none = Mask::default();
        assert_eq!((none.count(), none.touches_border()), (0, false));
        assert_eq!(
            [none.dilated(), none.outline(), none.inverted()],
            [(); 3].map(|()| none.clone())
        );
        assert!(none.components().sizes.is_empty() && none.signed_distance(1.0).data.is_empty());
    }

    #[test]
    fn a_threshold_takes_the_first_channel() {
        let image =
            ByteImage { height: 1, width: 2, channels: 3, data: vec![128, 0, 0, 127, 255, 255] };
        assert_eq!(Mask::at_least(&image, 128).data, [true, false]);
    }
}
