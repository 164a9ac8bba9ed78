//! Which lens the renderings are said to have been taken with.

use mesh_core::{Camera, Lens};

use super::metadata::Line;

/// Intrinsics for 3D-R2N2's renderings: the true ones, and those that others computed with.
///
/// All are for images of any size `W` x `H`; published numbers for 224 pixels are scaled by
/// `W / 224`. Pixel2Mesh's principal points are indices of pixels, whose centres are at +0.5 here.
///
/// | lens | focal length | principal point | by whom |
/// |---|---|---|---|
/// | `True` | 35/32 W: 149.84 at 137, 245 at 224 | centre | Blender's lens of 35 mm on a sensor of 32 mm |
/// | `Pixel2Mesh248` | 248 of 224 | index 111.5: the centre | the PyTorch ports |
/// | `Pixel2Mesh250` | 250 of 224 | index 112: half a pixel off it | the original in TensorFlow |
/// | `Metadata` | W/2 / tan(fov/2) | centre | the last column of the metadata, 25 in the originals, which is wrong |
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum R2n2Lens {
    /// What the images were rendered with.
    #[default]
    True,
    /// 248 pixels at 224, centred.
    Pixel2Mesh248,
    /// 250 pixels at 224, half a pixel off the centre.
    Pixel2Mesh250,
    /// What the metadata says, for showing that it is wrong.
    Metadata,
}

impl R2n2Lens {
    /// The lens for an image of this size; `fov` is the metadata's own, degrees.
    pub(crate) fn intrinsics(self, fov: f64, width: usize, height: usize) -> Lens {
        let (w, h) = (width as f64, height as f64);
        // Multiplied first: what was published comes out to the last bit.
        let (f, cx, cy) = match self {
            Self::True => (w * 35.0 / 32.0, w / 2.0, h / 2.0),
            Self::Pixel2Mesh248 => (w * 248.0 / 224.0, w / 2.0, h / 2.0),
            Self::Pixel2Mesh250 => (w * 250.0 / 224.0, w * 112.5 / 224.0, h * 112.5 / 224.0),
            Self::Metadata => (0.5 * w / (0.5 * fov.to_radians()).tan(), w / 2.0, h / 2.0),
        };
        Lens::Perspective { fx: f, fy: f, cx, cy }
    }

    /// The camera that took an image.
    pub(super) fn camera(self, line: &Line, width: usize, height: usize) -> Camera {
        let view = line.view;
        let pose =
            Camera::from_r2n2(view.azimuth, view.elevation, view.distance_ratio, width, height);
        Camera { lens: self.intrinsics(line.fov, width, height), ..pose }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    #[test]
    fn lenses_are_the_published_numbers() {
        let at = |lens: R2n2Lens, size| match lens.intrinsics(25.0, size, size) {
            Lens::Perspective { fx, fy, cx, cy } => {
                assert_eq!((fx, cx), (fy, cy));
                [fx, cx]
            }
            Lens::Orthographic { .. } => unreachable!(),
        };
        assert_eq!(at(R2n2Lens::True, 137), [149.84375, 68.5]);
        assert_eq!(at(R2n2Lens::True, 224), [245.0, 112.0]);
        assert_eq!(at(R2n2Lens::Pixel2Mesh248, 224), [248.0, 112.0]);
        assert_eq!(at(R2n2Lens::Pixel2Mesh250, 224), [250.0, 112.5]);
        // tan(12.5 degrees) = 0.22169
        assert_relative_eq!(
            at(R2n2Lens::Metadata, 137)[0],
            68.5 / 0.221_694_66,
            max_relative = 1e-6
        );
    }
}
