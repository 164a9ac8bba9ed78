//! The depth of an image, from a file of its own.

use std::path::Path;

use datasets::{View, read_depth_file, read_disparity_file};
use mesh_core::{DepthMap, DisparityMap};
use train::DataError;

use super::DepthKind;

/// The least disparity that stands for an estimate's farthest pixel; the nearest is 1.
const FARTHEST: f32 = 0.1;
/// Share of the object's pixels whose depth must be known: cameras leave holes, but not everywhere.
const LEAST_KNOWN: f64 = 0.1;
/// How much the ratio of width and height may differ: networks round the sizes of images to multiples of 32.
const RATIO: f64 = 0.05;

/// What a file says of an image.
pub(super) struct GivenDepth {
    /// In the size of the image.
    pub(super) map: DepthMap,
    /// What a user should know.
    pub(super) warning: Option<String>,
}

impl GivenDepth {
    /// Planar depth, or, for networks that learned from estimates, disparity.
    pub(super) fn read(path: &Path, view: &View, kind: DepthKind) -> Result<Self, DataError> {
        let map = if kind == DepthKind::Estimated { guessed(path)? } else { measured(path)? };
        let warning = compare_sizes(path, &map, view)?;
        let map = map.resized(view.color.height, view.color.width);
        check_known(path, &map, view)?;
        Ok(Self { map, warning })
    }
}

fn measured(path: &Path) -> Result<DepthMap, DataError> {
    read_depth_file(path, 1.0).map_err(DataError::read)
}

/// An estimate as a depth: one over a disparity that was brought to 0.1 to 1. Scale and shift mean nothing to the network.
fn guessed(path: &Path) -> Result<DepthMap, DataError> {
    let DisparityMap { height, width, data } =
        read_disparity_file(path).map_err(DataError::read)?;
    let finite = || data.iter().copied().filter(|d| d.is_finite());
    let low = finite().fold(f32::INFINITY, f32::min);
    let span = finite().fold(f32::NEG_INFINITY, f32::max) - low;
    // An empty file; any other number everywhere may be a wall.
    let nothing = span == 0.0 && low == 0.0;
    let depth = |&d: &f32| {
        let share = if span > 0.0 { (d - low) / span } else { 0.5 };
        let known = d.is_finite() && !nothing;
        if known { (FARTHEST + (1.0 - FARTHEST) * share).recip() } else { f32::INFINITY }
    };
    Ok(DepthMap { height, width, data: data.iter().map(depth).collect() })
}

/// What there is to say where depth has another size than its image.
fn compare_sizes(path: &Path, map: &DepthMap, view: &View) -> Result<Option<String>, DataError> {
    let ([height, width], [rows, columns]) =
        ([map.height, map.width], [view.color.height, view.color.width]);
    if [height, width] == [rows, columns] {
        return Ok(None);
    }
    let sizes = format!(
        "{}: the depth has {width} x {height} pixels, the image {columns} x {rows}",
        path.display()
    );
    let ratio = (width * rows) as f64 / (height * columns).max(1) as f64;
    if (ratio.ln()).abs() > RATIO {
        let text = format!(
            "{sizes}, expected the same ratio of width and height: is it of this image, uncropped and unturned?"
        );
        return Err(DataError::Unfit(text));
    }
    Ok(Some(format!("{sizes}: each pixel takes the nearest depth")))
}

/// Refuses depth that says nothing of the object.
fn check_known(path: &Path, map: &DepthMap, view: &View) -> Result<(), DataError> {
    let object = || map.data.iter().zip(&view.mask.data).filter(|(_, mask)| **mask > 127);
    let all = object().count();
    let known = object().filter(|(z, _)| z.is_finite()).count();
    let share = known as f64 / all.max(1) as f64;
    if all == 0 || share >= LEAST_KNOWN {
        return Ok(());
    }
    let text = format!(
        "{}: the depth is known at {:.1} % of the object's pixels, expected at least {:.0} %: 0, what is not finite and 1e9 and \
         more are holes; is it of this image, with the object in it?",
        path.display(),
        100.0 * share,
        100.0 * LEAST_KNOWN
    );
    Err(DataError::Unfit(text))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::{ByteImage, Camera, Image, write_pfm};

    use super::*;

    fn view() -> View {
        let camera = Camera::from_r2n2(0.0, 27.5, 0.8, 8, 8);
        let mask = ByteImage { data: vec![255; 64], ..ByteImage::new(8, 8, 1) };
        View {
            name: "a".into(),
            color: ByteImage::new(8, 8, 3),
            mask,
            camera,
            depth: None,
            crop: None,
        }
    }

    /// What a file of so many numbers gives.
    fn given(
        [height, width]: [usize; 2],
        kind: DepthKind,
        value: impl Fn(usize) -> f32,
    ) -> Result<GivenDepth, DataError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("depth.pfm");
        let data = (0..height * width).map(value).collect();
        write_pfm(&path, &Image { height, width, channels: 1, data }).unwrap();
        GivenDepth::read(&path, &view(), kind)
    }

    /// Depth comes in the size of the image; an estimate means the same in any scale and with any shift.
    #[test]
    fn depth_is_fitted_and_estimates_have_no_unit() {
        let square = |kind, value: &dyn Fn(usize) -> f32| given([4, 4], kind, value).unwrap().map;
        let depth = square(DepthKind::True, &|p| if p == 5 { 0.0 } else { p as f32 });
        assert_eq!((depth.height, depth.width), (8, 8));
        assert_eq!((depth.data[63], depth.data[2 * 8 + 2]), (15.0, f32::INFINITY));
        let one = square(DepthKind::Estimated, &|p| p as f32);
        let other = square(DepthKind::Estimated, &|p| 7.5 * p as f32 - 30.0);
        assert!(one.data.iter().zip(&other.data).all(|(a, b)| (a - b).abs() < 1e-4));
        // Nearer is less deep, and the nearest is at 1.
        assert!((one.data[63] - 1.0).abs() < 1e-6 && (one.data[0] - 10.0).abs() < 1e-4);
        let flat = square(DepthKind::Estimated, &|_| 3.0);
        assert!(flat.data.iter().all(|z| z.is_finite() && *z > 0.0));
    }

    #[test]
    fn another_size_is_said_and_another_ratio_refused() {
        assert_eq!(given([8, 8], DepthKind::True, |_| 1.0).unwrap().warning, None);
        let warning = given([40, 41], DepthKind::True, |_| 1.0).unwrap().warning.unwrap();
        assert!(warning.contains("41 x 40 pixels, the image 8 x 8"), "{warning}");
        let error = given([6, 8], DepthKind::True, |_| 1.0).err().unwrap().to_string();
        assert!(error.contains("depth.pfm") && error.contains("ratio"), "{error}");
    }

    #[test]
    fn depth_of_hardly_any_pixel_is_refused() {
        let six = |p: usize| if p < 6 { 1.5 } else { 0.0 };
        let error = given([8, 8], DepthKind::True, six).err().unwrap().to_string();
        assert!(error.contains("depth.pfm") && error.contains("9.4 %"), "{error}");
        given([8, 8], DepthKind::True, |p| if p < 7 { 1.5 } else { 0.0 }).unwrap();
        for kind in [DepthKind::True, DepthKind::Estimated] {
            let error = given([8, 8], kind, |_| 0.0).err().unwrap().to_string();
            assert!(error.contains("0.0 %"), "{error}");
        }
    }
}
