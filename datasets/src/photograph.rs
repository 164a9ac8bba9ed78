//! One image by itself, with the mask that it comes with or that is made of it.

use std::path::Path;

use mesh_core::{Camera, read_image_with};

use crate::assemble::{ImageFile, assemble};
use crate::error::{ReadViewsError, ViewsProblem};
use crate::mask::mask_from_alpha;
use crate::mask_file::{MaskFile, mask_of_folder};
use crate::options::{MaskSource, ReadOptions};
use crate::view::View;

/// How far a channel may differ from a backdrop that nobody described.
const TOLERANCE: u8 = 24;

/// A single image of an object.
#[derive(Clone, Debug, PartialEq)]
pub struct Photograph {
    /// The image, its mask and the camera that it was given.
    pub view: View,
    /// Whether nothing said what the object is, so that all is taken for it that differs from an even backdrop.
    pub guessed: bool,
}

impl Photograph {
    /// Reads an image. `camera` is asked for one of its width and height.
    ///
    /// Of the options those that speak of masks, colours and sizes count. Masks of files lie in the folder that is named, else in
    /// `masks/` beside the image. [`MaskSource::Auto`] takes these, else alpha, else whatever differs from an even backdrop.
    ///
    /// ```
    /// use datasets::{Photograph, ReadOptions};
    /// use mesh_core::{ByteImage, Camera, write_png};
    ///
    /// let folder = tempfile::tempdir()?;
    /// let path = folder.path().join("ball.png");
    /// let mut image = ByteImage { height: 8, width: 8, channels: 3, data: vec![250; 192] };
    /// image.data[81..87].fill(9); // two dark pixels in row 3
    /// write_png(&path, &image)?;
    /// let camera = |width, height| Camera::from_r2n2(0.0, 30.0, 0.8, width, height);
    /// let found = Photograph::read(&path, &camera, &ReadOptions::default())?;
    /// assert!(found.guessed);
    /// assert_eq!(found.view.mask_pixels(), 2);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    ///
    /// # Errors
    /// If image or mask cannot be read, or the object is nowhere in it; if the backdrop is not even; for
    /// [`MaskSource::ColorModel`], which takes several views.
    pub fn read(
        path: &Path,
        camera: &dyn Fn(usize, usize) -> Camera,
        options: &ReadOptions,
    ) -> Result<Self, ReadViewsError> {
        if options.mask == MaskSource::ColorModel && options.masks.is_none() {
            let (found, expected) =
                ("a single image", "several views: a color model compares them");
            return Err(ReadViewsError::field(path, "mask", found, expected));
        }
        let image = read_image_with(path, &options.limits)
            .map_err(|error| ReadViewsError::new(path, error))?;
        let file = mask_beside(path, options)?;
        let guessed = options.mask == MaskSource::Auto
            && options.masks.is_none()
            && !options.invert
            && file.found.is_none()
            && mask_from_alpha(&image).is_none();
        let backdrop = MaskSource::Backdrop { color: None, tolerance: TOLERANCE };
        let mask = if guessed { backdrop } else { options.mask };
        let name = path.file_name().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        let camera = camera(image.width, image.height);
        let image = ImageFile::new(path.to_owned(), image);
        let options = ReadOptions { mask, ..options.clone() };
        let view = assemble(name, image, file, camera, None, &options)?;
        if view.mask_pixels() == 0 {
            return Err(ReadViewsError::new(path, ViewsProblem::NoMask { looked_for: None }));
        }
        Ok(Self { view, guessed })
    }
}

/// The mask in the folder `masks` beside an image, where masks of files are wanted and there is one.
fn mask_beside(path: &Path, options: &ReadOptions) -> Result<MaskFile, ReadViewsError> {
    let folder = path.parent().unwrap_or_else(|| Path::new("")).join("masks");
    if !options.reads_mask_files() || !folder.is_dir() {
        return Ok(MaskFile::default());
    }
    mask_of_folder(
        &folder,
        &ImageFile::new(path.to_owned(), mesh_core::ByteImage::default()),
        options,
    )
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::{ByteImage, write_png};

    use super::*;

    fn camera(width: usize, height: usize) -> Camera {
        Camera::from_r2n2(0.0, 30.0, 0.8, width, height)
    }

    /// A bright image with a dark square of 4 x 4, and the mask of its left half.
    fn folder() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let dark = |k: usize| (4..8).contains(&(k / 12)) && (4..8).contains(&(k % 12));
        let data = (0..144).flat_map(|k| [if dark(k) { 10 } else { 240 }; 3]).collect();
        let picture = ByteImage { height: 12, width: 12, channels: 3, data };
        write_png(folder.path().join("cup.png"), &picture).unwrap();
        let half = |k: usize| if dark(k) && k % 12 < 6 { 255 } else { 0 };
        let mask =
            ByteImage { height: 12, width: 12, channels: 1, data: (0..144).map(half).collect() };
        std::fs::create_dir(folder.path().join("hand-made")).unwrap();
        write_png(folder.path().join("hand-made/cup_mask.png"), &mask).unwrap();
        folder
    }

    fn area(folder: &tempfile::TempDir, options: &ReadOptions) -> Result<(usize, bool), String> {
        let found = Photograph::read(&folder.path().join("cup.png"), &camera, options);
        found.map(|p| (p.view.mask_pixels(), p.guessed)).map_err(|error| error.to_string())
    }

    #[test]
    fn a_mask_comes_from_where_it_is_asked_for() {
        let folder = folder();
        let all = ReadOptions::default();
        assert_eq!(area(&folder, &all), Ok((16, true)));
        let named = Some(folder.path().join("hand-made"));
        assert_eq!(
            area(&folder, &ReadOptions { masks: named.clone(), ..all.clone() }),
            Ok((8, false))
        );
        let wide = ReadOptions { masks: named, dilate: 1, ..all.clone() };
        assert!(area(&folder, &wide).unwrap().0 > 8);
        let dark = MaskSource::Backdrop { color: Some([10; 3]), tolerance: 4 };
        let refused = area(&folder, &ReadOptions { mask: dark, ..all.clone() }).unwrap_err();
        assert!(refused.contains("plain backdrop"), "{refused}");
        // `masks` beside it goes before the backdrop.
        std::fs::rename(folder.path().join("hand-made"), folder.path().join("masks")).unwrap();
        assert_eq!(area(&folder, &all), Ok((8, false)));
    }

    #[test]
    fn what_says_nothing_of_the_object_is_refused() {
        let folder = folder();
        let all = ReadOptions::default();
        for mask in [MaskSource::Alpha, MaskSource::Files, MaskSource::ColorModel] {
            let error = area(&folder, &ReadOptions { mask, ..all.clone() }).unwrap_err();
            assert!(error.contains("cup.png") && error.contains("field `mask`"), "{error}");
        }
        // Nothing to invert.
        assert!(area(&folder, &ReadOptions { invert: true, ..all.clone() }).is_err());
        let noise = (0..12 * 12 * 3).map(|k: u32| (k.wrapping_mul(2_654_435_761) >> 13) as u8);
        let noise = ByteImage { height: 12, width: 12, channels: 3, data: noise.collect() };
        write_png(folder.path().join("cup.png"), &noise).unwrap();
        let error = area(&folder, &all).unwrap_err();
        assert!(error.contains("plain backdrop"), "{error}");
    }
}
