//! What makes a view unusable.

use crate::view::View;

/// What is wrong with a [`View`]: see [`View::validate`].
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ViewError {
    /// Image or mask has another size than the camera's image.
    #[error(
        "view {view}: {field} is {found:?} (height, width), but the camera's image is {expected:?}"
    )]
    Size {
        /// Name of the view.
        view: String,
        /// `color` or `mask`.
        field: &'static str,
        /// Its height and width.
        found: [usize; 2],
        /// The camera's height and width.
        expected: [usize; 2],
    },
    /// Image or mask has another number of channels than a view has.
    #[error(
        "view {view}: {field} has {found} channels, expected {expected}: an image has red, green and blue, a mask one channel"
    )]
    Channels {
        /// Name of the view.
        view: String,
        /// `color` or `mask`.
        field: &'static str,
        /// Its channels.
        found: usize,
        /// Those that it should have.
        expected: usize,
    },
    /// A mask that is not sure of a pixel.
    #[error(
        "view {view}: the mask has the value {found} in row {row}, column {column}, expected 0 or 255: decide by a threshold, 128 for most"
    )]
    Undecided {
        /// Name of the view.
        view: String,
        /// The value.
        found: u8,
        /// Row of the first such pixel.
        row: usize,
        /// Its column.
        column: usize,
    },
    /// A camera that cannot be used.
    #[error("view {view}: camera: {problem}")]
    Camera {
        /// Name of the view.
        view: String,
        /// What is wrong with it.
        problem: String,
    },
}

impl View {
    /// Whether image, mask and camera are what [`View`] says that they are; those of every reader are.
    ///
    /// ```
    /// use datasets::{View, ViewError};
    /// use mesh_core::{ByteImage, Camera};
    ///
    /// let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 0.6, 8, 6);
    /// let (color, mask) = (ByteImage::new(6, 8, 3), ByteImage::new(6, 8, 1));
    /// let mut view = View { name: "left".into(), color, mask, camera, depth: None, crop: None };
    /// assert_eq!(view.validate(), Ok(()));
    /// view.mask.data[9] = 77;
    /// assert!(matches!(view.validate(), Err(ViewError::Undecided { row: 1, column: 1, .. })));
    /// ```
    ///
    /// # Errors
    /// What of it is not so, by name.
    pub fn validate(&self) -> Result<(), ViewError> {
        let view = || self.name.clone();
        let expected = [self.camera.height, self.camera.width];
        for (field, image, channels) in [("color", &self.color, 3), ("mask", &self.mask, 1)] {
            let (found, size) = (image.channels, [image.height, image.width]);
            if found != channels {
                return Err(ViewError::Channels { view: view(), field, found, expected: channels });
            }
            if size != expected || image.data.len() != channels * size[0] * size[1] {
                return Err(ViewError::Size { view: view(), field, found: size, expected });
            }
        }
        if let Some(at) = self.mask.data.iter().position(|m| !matches!(m, 0 | 255)) {
            let (row, column) = (at / self.mask.width, at % self.mask.width);
            return Err(ViewError::Undecided {
                view: view(),
                found: self.mask.data[at],
                row,
                column,
            });
        }
        let problem = |error: mesh_core::CameraError| error.to_string();
        let camera = self.camera.validate().map_err(problem);
        camera.map_err(|problem| ViewError::Camera { view: view(), problem })
    }
}
