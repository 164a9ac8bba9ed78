//! The part of an image that a view is judged by: all of it, or what is around an object that is small in it.

use std::borrow::Cow;

use datasets::{Crop, View};
use mesh_core::{ByteImage, Camera, Mask};

/// Longer sides are averaged down to this.
const LONGEST: usize = 320;
/// The object's longer side keeps at least so many pixels, if it has them.
const OBJECT: usize = 80;

/// A rectangle of a view's whole image, which is to be averaged down to [`LONGEST`] pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Window {
    /// The image's row that is the first.
    pub(crate) top: usize,
    /// The image's column that is the first.
    pub(crate) left: usize,
    pub(crate) height: usize,
    pub(crate) width: usize,
    /// Pixels of the longer side of the image.
    whole: usize,
    /// Which part of the image the view holds.
    crop: Option<Crop>,
}

impl Window {
    /// The whole image, unless averaging that down left less than 80 pixels of an object that has more: then as much around it as
    /// keeps these, or 320 pixels.
    pub(crate) fn of(view: &View) -> Self {
        let [height, width] = view.whole_size();
        let crop = view.crop;
        let whole = Self { top: 0, left: 0, height, width, whole: height.max(width), crop };
        let Some([top, left, rows, columns]) = view.mask_bounds() else { return whole };
        let side = LONGEST * rows.max(columns).max(OBJECT) / OBJECT;
        if side >= whole.whole {
            return whole;
        }
        let [above, before] = crop.map_or([0, 0], |crop| [crop.top, crop.left]);
        let around = |from: usize, count: usize, all: usize| {
            let side = side.min(all);
            ((from + count / 2).saturating_sub(side / 2).min(all - side), side)
        };
        let (top, height) = around(above + top, rows, height);
        let (left, width) = around(before + left, columns, width);
        Self { top, left, height, width, ..whole }
    }

    /// Whether it is all of the image.
    pub(crate) fn is_whole(&self) -> bool {
        self.height.max(self.width) == self.whole
    }

    /// Pixels of the image to one of what is judged.
    pub(crate) fn scale(&self) -> f64 {
        let side = self.height.max(self.width);
        side as f64 / side.min(LONGEST) as f64
    }

    /// Pixels of what is judged to one of the whole image averaged down: 1 where that is what is judged.
    pub(crate) fn enlarged(&self) -> f64 {
        self.whole as f64 / self.whole.min(LONGEST) as f64 / self.scale()
    }

    /// The mask in it, averaged down, object where at least half of it was.
    pub(crate) fn mask(&self, view: &View) -> Mask {
        let mask = view.whole_mask();
        let mask = if self.is_whole() { mask } else { Cow::Owned(self.cut(&mask)) };
        let [height, width] = self.size();
        if [height, width] == [mask.height, mask.width] {
            return Mask::at_least(&mask, 128);
        }
        Mask::at_least(&mask.resized(height, width), 128)
    }

    /// The camera of what is judged, from one of the view's size.
    pub(crate) fn camera(&self, camera: &Camera) -> Camera {
        let whole = self.crop.map(|crop| crop.whole_camera(camera));
        let cut =
            whole.as_ref().unwrap_or(camera).cropped(self.left, self.top, self.width, self.height);
        let [height, width] = self.size();
        cut.resized(width, height)
    }

    /// What of the view is judged, as a view by itself, which another camera sees.
    pub(crate) fn view(&self, view: &View, camera: &Camera) -> View {
        if self.is_whole() {
            let small = view.clone().at_most(LONGEST);
            let camera = camera.resized(small.mask.width, small.mask.height);
            return View { camera, ..small };
        }
        let whole = view.whole();
        let [height, width] = self.size();
        let part = |image: &ByteImage| self.cut(image).resized(height, width);
        let mut mask = part(&whole.mask);
        mask.data.iter_mut().for_each(|m| *m = if *m >= 128 { 255 } else { 0 });
        let (name, camera) = (view.name.clone(), self.camera(camera));
        View { name, color: part(&whole.color), mask, camera, depth: None, crop: None }
    }

    /// Column and row of it at which the view's pixels begin, pixels of the image.
    pub(crate) fn begin_of_view(&self) -> [f64; 2] {
        let [left, top] = self.crop.map_or([0, 0], |crop| [crop.left, crop.top]);
        [left as f64 - self.left as f64, top as f64 - self.top as f64]
    }

    /// The part of an image of the whole's size.
    fn cut(&self, image: &ByteImage) -> ByteImage {
        image.cropped(self.left, self.top, self.width, self.height)
    }

    /// Rows and columns of what is judged.
    fn size(&self) -> [usize; 2] {
        ByteImage { height: self.height, width: self.width, channels: 0, data: Vec::new() }
            .size_within(LONGEST)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn view([height, width]: [usize; 2], [top, left, rows, columns]: [usize; 4]) -> View {
        let camera =
            Camera::look_at([0.0, 0.0, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 0.6, width, height);
        let mut mask = ByteImage::new(height, width, 1);
        for row in top..top + rows {
            mask.data[row * width + left..][..columns].fill(255);
        }
        let color = ByteImage::new(height, width, 3);
        View { name: "a".into(), color, mask, camera, depth: None, crop: None }
    }

    #[test]
    fn what_is_large_enough_is_judged_in_the_whole_image() {
        for (size, object) in [
            ([100, 200], [0, 0, 1, 1]),
            ([640, 320], [10, 10, 160, 40]),
            ([2000, 1000], [10, 10, 40, 500]),
            ([2000, 1000], [0; 4]),
        ] {
            let view = view(size, object);
            let window = Window::of(&view);
            assert!(window.is_whole(), "{size:?}, {object:?}");
            assert!((window.enlarged() - 1.0).abs() < 1e-12);
            let (mask, camera) = view.mask_within(LONGEST, &view.camera);
            assert_eq!((window.mask(&view).data, window.camera(&view.camera)), (mask.data, camera));
        }
    }

    #[test]
    fn what_is_small_keeps_its_pixels() {
        // 40 pixels keep them all, 120 of them 80; at the corner, and of a view that is a part of its image already.
        for (object, scale) in [([500, 900, 20, 40], 1.0), ([1380, 0, 120, 30], 1.5)] {
            let whole = view([1500, 2000], object);
            for view in [whole.clone(), whole.cropped_to_object(0.5)] {
                let window = Window::of(&view);
                assert!((window.scale() - scale).abs() < 1e-12);
                assert!((window.enlarged() * scale - 6.25).abs() < 1e-12);
                let (mask, camera) = (window.mask(&view), window.camera(&view.camera));
                assert_eq!((mask.height, mask.width), (320, 320));
                let pixels = (object[2] * object[3]) as f64 / (scale * scale);
                assert!((mask.count() as f64 - pixels).abs() < 1.0);
                let small = window.view(&view, &view.camera);
                assert_eq!(Mask::at_least(&small.mask, 128).data, mask.data);
                assert_eq!(small.camera, camera);
                // The middle of the object is seen where the mask is.
                let bounds = view.mask_bounds().map(|b| b.map(|n| n as f64));
                let [top, left, rows, columns] = bounds.unwrap_or_default();
                let ray = view.camera.ray(left + columns / 2.0, top + rows / 2.0);
                let p = std::array::from_fn(|k| ray.origin[k] + 4.0 * ray.direction[k]);
                let seen = camera.project(p);
                assert!(mask.data[seen.row as usize * mask.width + seen.column as usize]);
            }
        }
    }
}
