//! The lens and the distance at which objects were learned, found for an image of any other camera.
//!
//! A network that was shown 3D-R2N2's renderings knows objects about 1 unit large, 1.3 away, in the middle of a lens of 49 degrees.
//! Measured depth of another camera has another unit, another lens, and the object somewhere in the image. The part of the image
//! around the object is taken as if that lens had taken it: depth is moved and scaled so that what is as wide in the image is as
//! wide in space, and each vertex that is predicted is brought back along the ray of its pixel, its depth moved back. So the mesh
//! agrees with the user's image and depth exactly as far as it agrees with the network's.

use datasets::View;
use mesh_core::nalgebra::{Matrix3, Vector3};
use mesh_core::{Camera, DepthMap, Lens, TriMesh};

use super::guide::median_depth;
use crate::predict::Detail;
use crate::square::square;

/// Focal length of 3D-R2N2's lens over half of the image's side: 35 mm before a sensor of 32 mm.
const FOCAL: f64 = 35.0 / 16.0;
/// How much another focal length may differ.
const NEAR_FOCAL: f64 = 0.1;
/// Where the seen surface of an object is that was learned, and between which depths.
const MIDDLE: f64 = 1.2;
const DEPTHS: [f64; 2] = [0.8, 1.7];
/// How much wider than the object the square is that is cut around it: learned images show objects about so.
const MARGIN: f64 = 1.5;
/// Objects are as large as those that were learned if the longer side of their box is so large a share of the image's.
const SHARES: [f64; 2] = [0.3, 1.0];
/// And in the middle if theirs is as near to the image's, in halves of its side.
const BESIDE: f64 = 0.35;

/// By how much the unit of measured depth may differ from the learned one: millimetres of a car, or kilometres, are far within.
const UNITS: [f64; 2] = [1e-4, 1e4];

/// How an image was brought to the learned lens.
#[derive(Clone, Debug)]
pub(super) struct Canonical {
    /// The user's camera, cut to the square.
    given: Camera,
    /// The learned one, in the same pixels.
    learned: Camera,
    /// The user's depth is `offset + depth / scale` of the learned one.
    offset: f64,
    scale: f64,
}

impl Canonical {
    /// A view as the learned lens would have taken it; nothing where the view is as those that were learned from, or says too little.
    /// `unit` is what the system multiplies lengths by.
    pub(super) fn of(view: &View, unit: f64) -> Option<(View, Self)> {
        let [top, left, rows, columns] = view.mask_bounds()?.map(|n| n as f64);
        let Lens::Perspective { fx, .. } = view.camera.lens else { return None };
        let object = view.mask.data.iter().map(|&m| m > 127);
        let middle = f64::from(median_depth(&view.depth.as_ref()?.data, object)?);
        let [width, height] = [view.color.width as f64, view.color.height as f64];
        let share = rows.max(columns) / width.max(height);
        let off = |low: f64, size: f64, all: f64| ((2.0 * low + size) / all - 1.0).abs();
        let beside = off(left, columns, width).max(off(top, rows, height));
        let within = |[low, high]: [f64; 2], x: f64| (low..=high).contains(&x);
        let learned = (2.0 * fx / width / FOCAL - 1.0).abs() < NEAR_FOCAL
            && (width - height).abs() < 0.5
            && within(DEPTHS, middle * unit)
            && within(SHARES, share)
            && beside < BESIDE;
        if learned {
            return None;
        }
        let cut = square(view.clone(), [left, top, left + columns, top + rows], MARGIN);
        let given = cut.camera.clone();
        let side = given.width as f64;
        let Lens::Perspective { fx, fy, .. } = given.lens else { return None };
        let focal = 0.5 * FOCAL * side;
        let learned = Camera {
            rotation: Matrix3::identity(),
            translation: Vector3::zeros(),
            lens: Lens::Perspective { fx: focal, fy: focal, cx: 0.5 * side, cy: 0.5 * side },
            ..given.clone()
        };
        // A pixel is as wide at the learned middle as it was at the given one, in its unit.
        let scale = (MIDDLE / unit / focal) / (middle / (fx * fy).sqrt());
        let offset = middle - MIDDLE / unit / scale;
        let brought = |&z: &f32| {
            let z = (f64::from(z) - offset) * scale;
            if z.is_finite() { z.max(0.1 * MIDDLE / unit) as f32 } else { f32::INFINITY }
        };
        let depth = cut.depth.as_ref().map(|depth| DepthMap {
            data: depth.data.iter().map(brought).collect(),
            ..depth.clone()
        });
        let view = View { depth, camera: learned.clone(), ..cut };
        Some((view, Self { given, learned, offset, scale }))
    }

    /// A mesh of the learned camera's world in the user's.
    pub(super) fn back(&self, mesh: TriMesh) -> TriMesh {
        mesh.map_positions(|p| {
            let seen = self.learned.project(p.map(f64::from));
            let depth = self.offset + seen.depth / self.scale;
            self.given.unproject(seen.column, seen.row, depth).map(|x| x as f32)
        })
    }

    /// Why no depth can have such a scale, where that is so.
    pub(super) fn absurd(&self) -> Option<String> {
        let [least, most] = UNITS;
        (!(least..=most).contains(&self.scale)).then(|| {
            format!(
                "the depth would be scaled by {:.1e} to that of learned objects, expected {least:e} to {most:e}: is it depth, in \
                 some unit of length, of this image?",
                self.scale
            )
        })
    }

    /// What was done, in words.
    pub(super) fn remark(&self) -> String {
        format!(
            "these weights know objects about one unit large through a lens of 49 degrees: the part of the image around the \
             object was taken for such a picture, its depth scaled by {:.4}, and the mesh was moved back",
            self.scale
        )
    }

    /// The same as numbers with names.
    pub(super) fn details(&self) -> Vec<Detail> {
        vec![("the learned unit over the given one", vec![self.scale])]
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::ByteImage;
    use mesh_core::nalgebra::Translation3;
    use mesh_core::primitives::icosphere;
    use synth::{RenderOptions, render_view};

    use super::*;

    /// A ball as a camera of this focal length sees it at a distance, both in units of its diameter.
    fn seen(focal: f64, distance: f64, unit: f64, [width, height]: [usize; 2]) -> View {
        let fx = 0.5 * focal * width as f64;
        let camera = Camera {
            rotation: Matrix3::identity(),
            translation: Translation3::new(0.3 * unit, 0.1 * unit, -distance * unit).vector,
            lens: Lens::Perspective {
                fx,
                fy: fx,
                cx: 0.5 * width as f64,
                cy: 0.45 * height as f64,
            },
            width,
            height,
        };
        let ball = icosphere(3).scaled([0.5 * unit as f32; 3]);
        let options = RenderOptions { depth: true, ..RenderOptions::default() };
        render_view(&ball, &camera, &options).unwrap()
    }

    /// Each pixel's measured point is where it was after both ways, in any unit, lens and format.
    #[test]
    fn what_is_measured_comes_back() {
        for (focal, distance, unit, size) in
            [(2.19, 1.4, 100.0, [64, 64]), (5.0, 6.0, 0.02, [96, 64]), (1.2, 1.5, 1.0, [64, 80])]
        {
            let view = seen(focal, distance, unit, size);
            let (brought, canonical) = Canonical::of(&view, 1.0).unwrap();
            let side = brought.color.width;
            assert_eq!((brought.color.height, brought.camera.width), (side, side));
            let [depth, cut] = [&brought, &square_of(&view)].map(|v| v.depth.clone().unwrap());
            let mut learned = Vec::new();
            for p in (0..side * side).filter(|&p| brought.mask.data[p] > 127) {
                let (column, row) = ((p % side) as f64 + 0.5, (p / side) as f64 + 0.5);
                let z = f64::from(depth.data[p]);
                assert!((0.6..2.2).contains(&z), "{z}");
                let there = brought.camera.unproject(column, row, z).map(|x| x as f32);
                let back = canonical.back(TriMesh::new(vec![there], Vec::new())).positions[0];
                let truth = canonical.given.unproject(column, row, f64::from(cut.data[p]));
                for k in 0..3 {
                    let error = (f64::from(back[k]) - truth[k]).abs();
                    assert!(error < 1e-4 * unit, "{back:?} instead of {truth:?}");
                }
                learned.push(there);
            }
            // As wide as those that were learned: 1/1.5 of what the lens sees at the middle, or a little more before it.
            let width = learned.iter().map(|p| p[0]).fold(f32::MIN, f32::max)
                - learned.iter().map(|p| p[0]).fold(f32::MAX, f32::min);
            assert!((0.6..0.95).contains(&width), "{width}");
        }
    }

    fn square_of(view: &View) -> View {
        let [top, left, rows, columns] = view.mask_bounds().unwrap().map(|n| n as f64);
        square(view.clone(), [left, top, left + columns, top + rows], MARGIN)
    }

    /// The renderings that it learned from stay as they are, and so does what says too little.
    #[test]
    fn learned_images_are_left_alone() {
        let camera = Camera::from_r2n2(30.0, 27.5, 0.8, 64, 64);
        let options = RenderOptions { depth: true, ..RenderOptions::default() };
        let ball = icosphere(3).scaled([0.4; 3]);
        let view = render_view(&ball, &camera, &options).unwrap();
        assert!(Canonical::of(&view, 1.0).is_none());
        // The same objects in other units are others.
        assert!(Canonical::of(&view, 0.01).is_some());
        let empty = View { mask: ByteImage::new(64, 64, 1), ..view.clone() };
        assert!(Canonical::of(&empty, 0.01).is_none());
        assert!(Canonical::of(&View { depth: None, ..view }, 0.01).is_none());
    }
}
