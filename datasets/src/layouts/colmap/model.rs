//! What a COLMAP model says, whichever of its two forms it was read from.

use std::collections::BTreeMap;

use mesh_core::{Camera, Distortion};

use crate::error::ReadViewsError;

/// The cameras and images of a model, images in the natural order of their names.
#[derive(Clone, Debug, Default)]
pub(crate) struct Model {
    pub(crate) cameras: BTreeMap<u32, ModelCamera>,
    pub(crate) images: Vec<ModelImage>,
}

/// One line of `cameras.txt`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ModelCamera {
    /// The name of the camera model.
    pub(crate) model: String,
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) params: Vec<f64>,
}

/// One image of `images.txt`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct ModelImage {
    pub(crate) id: u32,
    /// World to camera, `[w, x, y, z]`.
    pub(crate) quaternion: [f64; 4],
    /// World to camera.
    pub(crate) translation: [f64; 3],
    pub(crate) camera: u32,
    /// Relative to the folder of images.
    pub(crate) name: String,
}

/// A point of a sparse model, in the world of its cameras. COLMAP's points have no normals.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColmapPoint {
    /// Where it is.
    pub position: [f64; 3],
    /// Its colour, sRGB.
    pub color: [u8; 3],
    /// Mean reprojection error, pixels; negative where COLMAP did not compute it.
    pub error: f64,
    /// In how many images it was found.
    pub observations: usize,
}

/// Names and parameter counts of the camera models, by their number in binary files.
pub(crate) const CAMERA_MODELS: [(&str, usize); 18] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    // What follows is refused, but by its name.
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    ("SIMPLE_DIVISION", 4),
    ("DIVISION", 5),
    ("SIMPLE_FISHEYE", 3),
    ("FISHEYE", 4),
    ("EUCM", 6),
    ("EQUIRECTANGULAR", 2),
];

impl Model {
    /// The lens of an image where it bends rays, in words.
    pub(crate) fn distorted(&self, image: &ModelImage) -> Option<String> {
        let camera = self.cameras.get(&image.camera)?;
        let (_, distortion) = Distortion::from_colmap(&camera.model, &camera.params).ok()?;
        distortion.map(|_| format!("camera {}, {}", image.camera, camera.model))
    }

    /// The camera of an image, for the size that the model knows, and how its lens bends rays.
    ///
    /// `files` are where cameras and images are written, for messages.
    pub(crate) fn camera(
        &self,
        image: &ModelImage,
        files: [&std::path::Path; 2],
    ) -> Result<(Camera, Option<Distortion>), ReadViewsError> {
        let [cameras_file, images_file] = files;
        let field = |what: &str| format!("image {} ({}) {what}", image.id, image.name);
        let Some(camera) = self.cameras.get(&image.camera) else {
            let found = image.camera.to_string();
            let expected = format!("one of the {} cameras of the model", self.cameras.len());
            return Err(ReadViewsError::field(images_file, field("CAMERA_ID"), found, expected));
        };
        let (whole, distortion) = Camera::from_colmap_distorted(
            image.quaternion,
            image.translation,
            &camera.model,
            &camera.params,
            camera.width,
            camera.height,
        )
        .map_err(ReadViewsError::camera(cameras_file, format!("camera {} PARAMS", image.camera)))?;
        let field = field("QW to TZ, camera");
        whole.validate().map_err(ReadViewsError::camera(images_file, field))?;
        Ok((whole, distortion))
    }
}

/// The box that holds the middle of the points along each axis; `None` without a finite point.
///
/// Points found in fewer than three images are left out where enough others remain, then one
/// percent at either end: COLMAP's models have strays far from everything.
pub(crate) fn robust_bounds(points: &[ColmapPoint]) -> Option<[[f64; 3]; 2]> {
    let finite = |p: &&ColmapPoint| p.position.iter().all(|x| x.is_finite());
    let mut kept: Vec<&ColmapPoint> = points.iter().filter(finite).collect();
    let sure: Vec<&ColmapPoint> = kept.iter().copied().filter(|p| p.observations >= 3).collect();
    if 2 * sure.len() >= kept.len() {
        kept = sure;
    }
    let last = kept.len().checked_sub(1)?;
    let trim = kept.len() / 100;
    let mut bounds = [[0.0; 3]; 2];
    for axis in 0..3 {
        let mut values: Vec<f64> = kept.iter().map(|p| p.position[axis]).collect();
        values.sort_by(f64::total_cmp);
        (bounds[0][axis], bounds[1][axis]) = (values[trim], values[last - trim]);
    }
    Some(bounds)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn strays_do_not_move_the_box() {
        let point = |x: f64, observations| ColmapPoint {
            position: [x, 2.0 * x, -x],
            color: [0; 3],
            error: 0.5,
            observations,
        };
        let mut points: Vec<_> = (0..=1000).map(|k| point(f64::from(k) / 1000.0, 4)).collect();
        points.extend([point(1e6, 9), point(-1e6, 5), point(40.0, 2), point(f64::NAN, 4)]);
        let [low, high] = robust_bounds(&points).unwrap();
        for (axis, (from, to)) in [(0.0, 1.0), (0.0, 2.0), (-1.0, 0.0)].into_iter().enumerate() {
            assert!((low[axis] - from).abs() < 0.05 && (high[axis] - to).abs() < 0.05);
        }
        assert_eq!(robust_bounds(&points[1004..]), None);
        assert_eq!(robust_bounds(&[point(1.0, 2)]).unwrap()[0], [1.0, 2.0, -1.0]);
    }
}
