//! Views of which only the part around the object is kept.

use std::borrow::Cow;

use mesh_core::{ByteImage, Camera, DepthMap};

use crate::view::{View, Views};

/// What is kept around the object at least, as a share of the image's longer side: colours a few pixels beside the edge are looked at.
const LEAST: f64 = 1.0 / 16.0;

/// Where the part of an image that a [`View`] holds lies in it, pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crop {
    /// The image's row that is the view's first.
    pub top: usize,
    /// The image's column that is the view's first.
    pub left: usize,
    /// Rows of the image.
    pub height: usize,
    /// Columns of the image.
    pub width: usize,
}

impl Crop {
    /// The camera of the whole image, from that of its part.
    #[must_use]
    pub fn whole_camera(&self, part: &Camera) -> Camera {
        let [sx, sy, cx, cy] = part.lens.numbers();
        let lens = part.lens.with([sx, sy, cx + self.left as f64, cy + self.top as f64]);
        Camera { lens, width: self.width, height: self.height, ..part.clone() }
    }

    fn whole_image(&self, part: &ByteImage) -> ByteImage {
        let mut image = ByteImage::new(self.height, self.width, part.channels);
        image.paste(part, [self.top, self.left]);
        image
    }

    fn whole_depth(&self, part: &DepthMap) -> DepthMap {
        let mut data = vec![f32::INFINITY; self.height * self.width];
        for (row, line) in part.data.chunks_exact(part.width.max(1)).enumerate() {
            let from = (self.top + row) * self.width + self.left;
            data[from..from + line.len()].copy_from_slice(line);
        }
        DepthMap { height: self.height, width: self.width, data }
    }
}

impl View {
    /// The view without what lies further from the object than `margin` times the longer side of its box, and a sixteenth of the
    /// image: the same camera's view of less, so that memory follows the object's size in the image. An empty mask leaves the view as it is.
    ///
    /// ```
    /// use datasets::View;
    /// use mesh_core::{ByteImage, Camera};
    ///
    /// let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 0.6, 64, 64);
    /// let (color, mut mask) = (ByteImage::new(64, 64, 3), ByteImage::new(64, 64, 1));
    /// mask.data[64 * 30 + 20..64 * 30 + 30].fill(255);
    /// let view = View { name: "left".into(), color, mask, camera, depth: None, crop: None };
    /// let part = view.clone().cropped_to_object(0.5);
    /// assert_eq!([part.color.height, part.color.width], [11, 20]);
    /// assert_eq!(part.whole().mask, view.mask);
    /// assert_eq!(part.whole().camera, view.camera);
    /// ```
    #[must_use]
    pub fn cropped_to_object(self, margin: f64) -> Self {
        let Some([top, left, rows, columns]) = self.mask_bounds() else { return self };
        let [height, width] = [self.mask.height, self.mask.width];
        let share = (margin * rows.max(columns) as f64).max(LEAST * height.max(width) as f64);
        let pad = share.ceil() as usize;
        let (bottom, right) = ((top + rows + pad).min(height), (left + columns + pad).min(width));
        let (top, left) = (top.saturating_sub(pad), left.saturating_sub(pad));
        let size = [right - left, bottom - top];
        if size == [width, height] || self.crop.is_some() {
            return self;
        }
        let image = |image: &ByteImage| image.cropped(left, top, size[0], size[1]);
        let depth = self.depth.as_ref().map(|depth| {
            let row = |i: usize| &depth.data[i * width + left..i * width + right];
            let data = (top..bottom).flat_map(row).copied().collect();
            DepthMap { height: size[1], width: size[0], data }
        });
        Self {
            color: image(&self.color),
            mask: image(&self.mask),
            camera: self.camera.cropped(left, top, size[0], size[1]),
            depth,
            crop: Some(Crop { top, left, height, width }),
            name: self.name,
        }
    }

    /// The view of the whole image; where it is not held black, no object, and infinitely deep.
    pub fn whole(&self) -> Cow<'_, Self> {
        let Some(crop) = self.crop else { return Cow::Borrowed(self) };
        Cow::Owned(Self {
            name: self.name.clone(),
            color: crop.whole_image(&self.color),
            mask: crop.whole_image(&self.mask),
            camera: crop.whole_camera(&self.camera),
            depth: self.depth.as_ref().map(|depth| crop.whole_depth(depth)),
            crop: None,
        })
    }

    /// The mask of the whole image.
    pub fn whole_mask(&self) -> Cow<'_, ByteImage> {
        match self.crop {
            Some(crop) => Cow::Owned(crop.whole_image(&self.mask)),
            None => Cow::Borrowed(&self.mask),
        }
    }

    /// A camera of the view's size, as one of the whole image's.
    pub fn whole_camera<'a>(&self, camera: &'a Camera) -> Cow<'a, Camera> {
        match self.crop {
            Some(crop) => Cow::Owned(crop.whole_camera(camera)),
            None => Cow::Borrowed(camera),
        }
    }

    /// Bytes of pixels of the whole image.
    fn whole_bytes(&self) -> f64 {
        let [height, width] = self.whole_size();
        let each = self.bytes() as f64 / self.mask.data.len().max(1) as f64;
        each * height as f64 * width as f64
    }

    /// Rows and columns of the whole image.
    pub fn whole_size(&self) -> [usize; 2] {
        self.crop.map_or([self.mask.height, self.mask.width], |crop| [crop.height, crop.width])
    }
}

impl Views {
    /// The views of the whole images.
    ///
    /// # Cost
    /// Where parts are held, the memory of all that is not.
    pub fn whole(&self) -> Cow<'_, Self> {
        if self.views.iter().all(|view| view.crop.is_none()) {
            return Cow::Borrowed(self);
        }
        let views = self.views.iter().map(|view| view.whole().into_owned()).collect();
        Cow::Owned(self.with(views))
    }

    /// The same, averaged down by one factor as far as their pixels must be to take no more than so many bytes: of large images of small
    /// objects the parts fit where all of it does not. `bytes` is at least one pixel's a view, or else it is exceeded by that.
    ///
    /// # Cost
    /// As [`whole`](Self::whole), and of a single view all of it beside.
    pub fn whole_within(&self, bytes: u64) -> Cow<'_, Self> {
        let needed: f64 = self.views.iter().map(View::whole_bytes).sum();
        let scale = (bytes as f64 / needed).sqrt();
        if scale >= 1.0 || needed == 0.0 {
            return self.whole();
        }
        let smaller = |view: &View| {
            let longest = view.whole_size().into_iter().max().unwrap_or(0) as f64;
            // One less, since sides are rounded.
            let longest = ((longest * scale) as usize).saturating_sub(1).max(1);
            view.whole().into_owned().at_most(longest)
        };
        Cow::Owned(self.with(self.views.iter().map(smaller).collect()))
    }

    /// Other views of the same.
    fn with(&self, views: Vec<View>) -> Self {
        let Self { source, layout, warnings, test, .. } = self;
        let (source, warnings, test) = (source.clone(), warnings.clone(), test.clone());
        Self { views, source, layout: *layout, warnings, test }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn what_is_kept_is_where_it_was(
            size in [1..40_usize, 1..40_usize], at in [0.0..1.0_f64, 0.0..1.0], margin in 0.0..2.0_f64,
        ) {
            let [height, width] = size;
            let camera =
                Camera::look_at([0.0, 1.0, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 0.6, width, height);
            let pixel = (at[0] * height as f64) as usize * width + (at[1] * width as f64) as usize;
            let mut mask = ByteImage::new(height, width, 1);
            mask.data[pixel] = 255;
            let mut color = ByteImage::new(height, width, 3);
            color.data.iter_mut().enumerate().for_each(|(k, v)| *v = (k % 251) as u8);
            let data = (0..height * width).map(|k| k as f32 + 1.0).collect();
            let depth = Some(DepthMap { height, width, data });
            let view = View { name: "a".into(), color, mask, camera, depth, crop: None };
            let part = view.clone().cropped_to_object(margin);
            prop_assert_eq!(part.validate(), Ok(()));
            prop_assert_eq!(part.whole_size(), [height, width]);
            prop_assert_eq!(part.mask_pixels(), 1);
            let whole = part.whole();
            prop_assert_eq!(&whole.mask, &view.mask);
            let mask = part.whole_mask();
            prop_assert_eq!(mask.as_ref(), &view.mask);
            let seen = |view: &View| view.camera.project([0.1, 0.2, 0.3]);
            let (from, to) = (seen(&view), seen(&whole));
            prop_assert!((from.column - to.column).abs() < 1e-9 && (from.row - to.row).abs() < 1e-9);
            // Of the rest that is held which is near; black is what is not.
            prop_assert_eq!(&whole.color.data[3 * pixel..3 * pixel + 3], &view.color.data[3 * pixel..3 * pixel + 3]);
            let depth = |view: &View| view.depth.as_ref().map(|depth| depth.data[pixel]);
            prop_assert_eq!(depth(&whole), depth(&view));
            let held = whole.depth.iter().flat_map(|depth| &depth.data).filter(|z| z.is_finite());
            prop_assert_eq!(held.count(), part.mask.data.len());
        }
    }

    #[test]
    fn whole_images_come_down_to_what_they_may_take() {
        let view = |row: usize| {
            let camera = Camera::look_at([0.0, 1.0, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 0.6, 200, 100);
            let (color, mut mask) = (ByteImage::new(100, 200, 3), ByteImage::new(100, 200, 1));
            mask.data[200 * row + 90..200 * row + 110].fill(255);
            View { name: row.to_string(), color, mask, camera, depth: None, crop: None }
        };
        let parts = Views::in_memory([20, 50].map(|row| view(row).cropped_to_object(0.1)).into());
        let all = 2 * 4 * 100 * 200;
        assert!(parts.whole_within(all) == parts.whole());
        let small = parts.whole_within(all / 3);
        assert!(
            small.bytes() as u64 <= all / 3 && 4 * small.bytes() as u64 > all,
            "{}",
            small.bytes()
        );
        assert!(small.views.iter().all(|view| view.crop.is_none() && view.validate().is_ok()));
        assert_eq!(parts.whole_within(0).views[0].mask.data.len(), 1);
    }
}
