//! Views through a lens that bends rays, as a pinhole would have seen them.

use std::collections::BTreeMap;
use std::path::Path;

use mesh_core::{ByteImage, Camera, DepthMap, Distortion, Lens, Mask, counted};

use crate::error::{ReadViewsError, ViewsProblem};
use crate::options::ReadOptions;
use crate::view::View;

/// What is kept free around the object, as a share of the frame's longer side.
const MARGIN: f64 = 0.02;
/// How many times longer than the image's longer side that of the new one may be.
const LONGEST: f64 = 2.0;

/// The object reaches too far off the camera's axis to be on a pinhole's image.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
#[error(
    "the object is seen at column {column:.0}, row {row:.0}, farther off the axis than this lens shows things at \
     places of their own, or than a pinhole can: expected at most {degrees:.0} degrees"
)]
pub struct OffAxisError {
    /// Where in the image.
    pub column: f64,
    /// Where in the image.
    pub row: f64,
    /// How far off the axis the lens can be followed, at most 85.
    pub degrees: f64,
}

impl View {
    /// The view as a pinhole in the same place sees it, where `camera` is the pinhole that the
    /// distortion is stated for, as files have it.
    ///
    /// Colour, mask and depth are resampled together (colour and mask bilinearly, depth to the
    /// nearest pixel, because averages across an edge lie in the air). The new frame holds the old one
    /// and, with a margin, the whole mask, at the focal length of the old; it is at most twice as
    /// long, and coarser where that is not enough. Where the lens showed nothing there is no object,
    /// and the colour of the nearest pixel.
    ///
    /// # Errors
    /// If the object reaches farther off the axis than 85 degrees, or than the lens can be followed.
    ///
    /// # Panics
    /// If the camera has parallel rays.
    pub fn undistorted(self, distortion: &Distortion) -> Result<Self, OffAxisError> {
        self.straight(distortion, true)
    }

    /// The same. Where the mask is no object's, what of it the lens cannot be followed to is left out.
    fn straight(self, distortion: &Distortion, mask_is_object: bool) -> Result<Self, OffAxisError> {
        let Lens::Perspective { fx, fy, cx, cy } = self.camera.lens else {
            panic!("View::undistorted: parallel rays have no such distortion")
        };
        let pinhole = Pinhole { fx, fy, cx, cy };
        let [left, top, right, bottom] = self.frame(&pinhole, distortion, mask_is_object)?;
        let longest = LONGEST * self.color.width.max(self.color.height) as f64;
        let scale = (longest / (right - left).max(bottom - top)).min(1.0);
        let size = |length: f64| (length * scale).ceil().max(1.0) as usize;
        let (width, height) = (size(right - left), size(bottom - top));
        let to = Pinhole {
            fx: fx * scale,
            fy: fy * scale,
            cx: (cx - left) * scale,
            cy: (cy - top) * scale,
        };
        let mut straight = Self {
            crop: None,
            color: ByteImage::new(height, width, self.color.channels),
            mask: ByteImage::new(height, width, 1),
            depth: self.depth.as_ref().map(|_| DepthMap {
                height,
                width,
                data: vec![f32::INFINITY; height * width],
            }),
            camera: Camera {
                lens: Lens::Perspective { fx: to.fx, fy: to.fy, cx: to.cx, cy: to.cy },
                width,
                height,
                ..self.camera
            },
            name: self.name.clone(),
        };
        let reach = distortion.reach();
        for k in 0..height * width {
            let ray = to.ray([(k % width) as f64 + 0.5, (k / width) as f64 + 0.5]);
            if ray[0].hypot(ray[1]) <= reach {
                self.copy_pixel(pinhole.pixel(distortion.distort(ray)), &mut straight, k);
            }
        }
        Ok(straight)
    }

    /// Makes pixel `k` of another view from what lies at a place of this one.
    fn copy_pixel(&self, at: [f64; 2], to: &mut Self, k: usize) {
        let (width, height) = (self.color.width, self.color.height);
        let taps = around(at, width, height);
        let channels = self.color.channels;
        for (c, value) in to.color.data[k * channels..][..channels].iter_mut().enumerate() {
            let value_of =
                |&(k, w): &(usize, f64)| w * f64::from(self.color.data[k * channels + c]);
            *value = (taps.iter().map(value_of).sum::<f64>() + 0.5) as u8;
        }
        let [x, y] = at;
        if !(0.0..=width as f64).contains(&x) || !(0.0..=height as f64).contains(&y) {
            return;
        }
        let object: f64 = taps.iter().map(|&(k, w)| w * f64::from(self.mask.data[k])).sum();
        to.mask.data[k] = if object >= 127.5 { 255 } else { 0 };
        if let (Some(from), Some(to)) = (&self.depth, &mut to.depth) {
            let (row, column) = ((y as usize).min(height - 1), (x as usize).min(width - 1));
            to.data[k] = from.data[row * width + column];
        }
    }

    /// Left, top, right and bottom of the frame that holds the image's own and the object's, in the
    /// pixels of the pinhole.
    fn frame(
        &self,
        pinhole: &Pinhole,
        distortion: &Distortion,
        mask_is_object: bool,
    ) -> Result<[f64; 4], OffAxisError> {
        let (width, height) = (self.mask.width, self.mask.height);
        let mut object = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        let undistort = distortion.undistorter();
        let mask = Mask::at_least(&self.mask, 1);
        for i in 0..height {
            for j in 0..width {
                // What lies inside is not farther out than the outline.
                if !mask.is_outline(i, j) {
                    continue;
                }
                let seen = [j as f64 + 0.5, i as f64 + 0.5];
                let ray = match undistort(pinhole.ray(seen)) {
                    Some(ray) => ray,
                    None if !mask_is_object => continue,
                    None => {
                        let degrees = distortion.reach().atan().to_degrees();
                        return Err(OffAxisError { column: seen[0], row: seen[1], degrees });
                    }
                };
                let at = pinhole.pixel(ray);
                object = [
                    object[0].min(at[0]),
                    object[1].min(at[1]),
                    object[2].max(at[0]),
                    object[3].max(at[1]),
                ];
            }
        }
        let margin = MARGIN * width.max(height) as f64;
        Ok([
            (object[0] - margin).floor().min(0.0),
            (object[1] - margin).floor().min(0.0),
            (object[2] + margin).ceil().max(width as f64),
            (object[3] + margin).ceil().max(height as f64),
        ])
    }
}

struct Pinhole {
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
}

impl Pinhole {
    /// From a pixel to the plane at depth 1.
    fn ray(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [(x - self.cx) / self.fx, (y - self.cy) / self.fy]
    }

    fn pixel(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        [self.fx * x + self.cx, self.fy * y + self.cy]
    }
}

/// The four pixels around a place, as indices, and how much each counts; those outside are the
/// nearest ones inside.
fn around([x, y]: [f64; 2], width: usize, height: usize) -> [(usize, f64); 4] {
    let (x, y) = (x - 0.5, y - 0.5);
    let (s, t) = (x - x.floor(), y - y.floor());
    let inside = |at: f64, size: usize| at.clamp(0.0, (size - 1) as f64) as usize;
    let columns = [(inside(x.floor(), width), 1.0 - s), (inside(x.floor() + 1.0, width), s)];
    let rows = [(inside(y.floor(), height), 1.0 - t), (inside(y.floor() + 1.0, height), t)];
    std::array::from_fn(|k| {
        let ((row, a), (column, b)) = (rows[k / 2], columns[k % 2]);
        (row * width + column, a * b)
    })
}

/// The view without its distortion, if there is one and that is wanted; `field` of `file` says what lens it is.
pub(crate) fn straightened(
    view: View,
    distortion: Option<&Distortion>,
    options: &ReadOptions,
    (file, field): (&Path, &str),
) -> Result<View, ReadViewsError> {
    let Some(distortion) = distortion.filter(|_| options.undistort) else { return Ok(view) };
    // A mask of all pixels ends where the image does, which says nothing of where the object is.
    let straight = view.straight(distortion, !options.takes_all_pixels()).map_err(|source| {
        ReadViewsError::new(file, ViewsProblem::OffAxis { field: field.to_owned(), source })
    })?;
    // The frame around what bends outwards is larger than the image was.
    Ok(match options.max_size {
        Some(longest) => straight.at_most(longest),
        None => straight,
    })
}

/// What cameras of matrices have instead of a bent lens.
pub(crate) const SKEW: &str = "skew of the pixels' axes";

/// The lenses whose distortion is undone, for one sentence to the user.
#[derive(Default)]
pub(crate) struct Lenses(BTreeMap<String, usize>);

impl Lenses {
    /// Counts a view through the lens that is described.
    pub(crate) fn count(&mut self, description: String) {
        *self.0.entry(description).or_default() += 1;
    }

    /// What is done about them; none where there is no such lens.
    pub(crate) fn sentence(&self, options: &ReadOptions) -> Option<String> {
        const MOST: usize = 3;
        let named =
            |(lens, &views): (&String, &usize)| format!("{lens} ({})", counted(views, "view"));
        let mut lenses: Vec<String> = self.0.iter().take(MOST).map(named).collect();
        if self.0.len() > MOST {
            lenses.push(format!("{} other lenses", self.0.len() - MOST));
        }
        (!lenses.is_empty()).then(|| {
            let done = if options.undistort {
                "undone, images and masks are resampled"
            } else {
                "left as it is, cameras are the pinholes that it is stated for"
            };
            format!("lens distortion is {done}: {}", lenses.join(", "))
        })
    }
}
