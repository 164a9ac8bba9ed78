//! Mistakes that people and programs make with views, planted on purpose and by size.

use datasets::View;
use mesh_core::nalgebra::{Matrix3, Rotation3, Vector3};
use mesh_core::{ByteImage, Lens};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use crate::collection::normal;

/// A mistake in the views of one object, so that what looks for mistakes can be tried on known ones.
///
/// ```
/// use mesh_core::primitives;
/// use synth::{Orbit, Planted, RenderOptions, render_views};
///
/// let cameras = Orbit { count: 4, width: 32, height: 32, ..Orbit::default() }.cameras();
/// let good = render_views(&primitives::icosphere(2), &cameras, &RenderOptions::default(), &|_, _| {})?;
/// let bad = Planted::Dilated(2).plant(good.clone(), [0.0; 3], 0);
/// assert!(bad[0].mask_pixels() > good[0].mask_pixels());
/// assert_eq!(bad[0].color, good[0].color);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Planted {
    /// The cameras' y points down and z forward.
    Axes,
    /// World to camera where camera to world is meant.
    InversePoses,
    /// Images and masks are upside down.
    FlippedY,
    /// Images and masks are mirrored.
    FlippedX,
    /// Every camera is turned, and moved as seen from the object, by so many degrees (deviation about each axis).
    Poses(f64),
    /// All focal lengths are so many times what they were.
    Focal(f64),
    /// The point where the axis meets the image is so many pixels aside, in all views.
    PrincipalPoint([f64; 2]),
    /// One view is said to be taken so many degrees further around the object.
    OneView(f64),
    /// One camera is said to stand aside by so many times its distance from the object.
    OneAside(f64),
    /// All masks are larger by so many pixels.
    Dilated(usize),
    /// All masks are smaller by so many pixels.
    Eroded(usize),
    /// Masks show what is not the object.
    Inverted,
    /// In so large a share of the views a disc belongs to the mask that is none of the object; its area in shares of the mask's.
    Blobs {
        /// Share of the views, 0 to 1.
        views: f64,
        /// Area of the disc.
        area: f64,
    },
    /// The same with a disc that is missing.
    Bites {
        /// Share of the views, 0 to 1.
        views: f64,
        /// Area of the disc.
        area: f64,
    },
    /// Only the views within so many degrees of the middle one's direction are there.
    OneSided(f64),
    /// Only so many of the views are there, evenly chosen.
    Few(usize),
}

impl Planted {
    /// The views with the mistake; `around` is the middle of the object. The same seed plants the same.
    ///
    /// # Panics
    /// If there are no views.
    pub fn plant(self, mut views: Vec<View>, around: [f64; 3], seed: u64) -> Vec<View> {
        assert!(!views.is_empty(), "plant: no views");
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let around = Vector3::from(around);
        match self {
            Self::Axes => views.iter_mut().for_each(opencv_axes),
            Self::InversePoses => views.iter_mut().for_each(inverse),
            Self::FlippedY | Self::FlippedX => {
                for view in &mut views {
                    flip(&mut view.color, self == Self::FlippedY);
                    flip(&mut view.mask, self == Self::FlippedY);
                }
            }
            Self::Poses(degrees) => {
                for view in &mut views {
                    shake(view, around, degrees.to_radians(), &mut rng);
                }
            }
            Self::Focal(factor) => views.iter_mut().for_each(|view| scale_lens(view, factor)),
            Self::PrincipalPoint([dx, dy]) => {
                for view in &mut views {
                    let [sx, sy, cx, cy] = view.camera.lens.numbers();
                    view.camera.lens = view.camera.lens.with([sx, sy, cx + dx, cy + dy]);
                }
            }
            Self::OneView(degrees) => {
                let count = views.len();
                let axis = direction(&mut rng);
                orbit(&mut views[count / 3], around, axis * degrees.to_radians());
            }
            Self::OneAside(distances) => {
                let count = views.len();
                let camera = &mut views[count / 3].camera;
                let depth = camera.project(around.into()).depth;
                camera.translation += distances * depth * direction(&mut rng);
            }
            Self::Dilated(pixels) => grow(&mut views, pixels, 255),
            Self::Eroded(pixels) => grow(&mut views, pixels, 0),
            Self::Inverted => {
                for m in views.iter_mut().flat_map(|view| &mut view.mask.data) {
                    *m = 255 - *m;
                }
            }
            Self::Blobs { views: share, area } => spoil(&mut views, share, area, 255, &mut rng),
            Self::Bites { views: share, area } => spoil(&mut views, share, area, 0, &mut rng),
            Self::OneSided(degrees) => {
                let toward = |view: &View| (view.camera.center() - around).normalize();
                let middle = toward(&views[views.len() / 2]);
                views.retain(|view| toward(view).dot(&middle) >= degrees.to_radians().cos());
            }
            Self::Few(count) => {
                let all = views.len();
                let mut index = 0;
                let kept: Vec<usize> = (0..count).map(|k| k * all / count.max(1)).collect();
                views.retain(|_| {
                    index += 1;
                    kept.contains(&(index - 1))
                });
            }
        }
        views
    }
}

fn opencv_axes(view: &mut View) {
    let axes = Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
    view.camera.rotation = axes * view.camera.rotation;
    view.camera.translation = axes * view.camera.translation;
}

fn inverse(view: &mut View) {
    let turned = view.camera.rotation.transpose();
    view.camera.translation = -(turned * view.camera.translation);
    view.camera.rotation = turned;
}

fn flip(image: &mut ByteImage, upside_down: bool) {
    let row = image.width * image.channels;
    if upside_down {
        image.data = image.data.chunks_exact(row).rev().flatten().copied().collect();
        return;
    }
    let channels = image.channels;
    for row in image.data.chunks_exact_mut(row) {
        let mirrored: Vec<u8> = row.chunks_exact(channels).rev().flatten().copied().collect();
        row.copy_from_slice(&mirrored);
    }
}

fn scale_lens(view: &mut View, factor: f64) {
    if let Lens::Perspective { fx, fy, .. } = &mut view.camera.lens {
        (*fx, *fy) = (factor * *fx, factor * *fy);
    }
}

/// Turns the camera in its place, and moves it by as much as the same angle is at the object's distance.
fn shake(view: &mut View, around: Vector3<f64>, deviation: f64, rng: &mut ChaCha8Rng) {
    let center = view.camera.center();
    let far = (center - around).norm();
    let turn = Vector3::from_fn(|_, _| deviation * normal(rng));
    let shift = Vector3::from_fn(|_, _| deviation * far * normal(rng));
    view.camera.rotation = *Rotation3::new(turn).matrix() * view.camera.rotation;
    view.camera.translation = -(view.camera.rotation * (center + shift));
}

/// Moves the camera around a point, looking at it as before.
fn orbit(view: &mut View, around: Vector3<f64>, turn: Vector3<f64>) {
    let center = view.camera.center();
    let turn = *Rotation3::new(turn).matrix();
    view.camera.rotation *= turn.transpose();
    view.camera.translation = -(view.camera.rotation * (around + turn * (center - around)));
}

fn direction(rng: &mut ChaCha8Rng) -> Vector3<f64> {
    Vector3::from_fn(|_, _| normal(rng)).normalize()
}

/// Lets what has this value grow by so many pixels, square by square and cross by cross, so that corners stay round.
fn grow(views: &mut [View], pixels: usize, value: u8) {
    for mask in views.iter_mut().map(|view| &mut view.mask) {
        let (h, w) = (mask.height, mask.width);
        for round in 0..pixels {
            let before = mask.data.clone();
            let reach = |i: usize, n: usize| i.saturating_sub(1)..(i + 2).min(n);
            for i in 0..h {
                for j in 0..w {
                    let near = reach(i, h).any(|a| {
                        reach(j, w).any(|b| {
                            (round % 2 == 1 || a == i || b == j) && before[a * w + b] == value
                        })
                    });
                    if near {
                        mask.data[i * w + j] = value;
                    }
                }
            }
        }
    }
}

/// Paints a disc into some of the masks, its middle near their edge.
fn spoil(views: &mut [View], share: f64, area: f64, value: u8, rng: &mut ChaCha8Rng) {
    let count = views.len();
    let spoilt = ((share * count as f64).round() as usize).clamp(1, count);
    for k in 0..spoilt {
        let mask = &mut views[(2 * k + 1) * count / (2 * spoilt)].mask;
        let (h, w) = (mask.height, mask.width);
        let on = |i: usize, j: usize| mask.data[i * w + j] != 0;
        let edge: Vec<[usize; 2]> = (0..h * w)
            .map(|p| [p / w, p % w])
            .filter(|&[i, j]| on(i, j) && (j + 1 == w || !on(i, j + 1)))
            .collect();
        let pixels = mask.data.iter().filter(|m| **m != 0).count();
        let Some(&[i, j]) = edge.get(rng.random_range(0..edge.len().max(1))) else { continue };
        let square = area * pixels as f64 / std::f64::consts::PI;
        for (p, m) in mask.data.iter_mut().enumerate() {
            let far = (p / w).abs_diff(i).pow(2) + (p % w).abs_diff(j).pow(2);
            if far as f64 <= square {
                *m = value;
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::{Orbit, RenderOptions, render_views};
    use mesh_core::primitives;

    fn views() -> Vec<View> {
        let orbit = Orbit { count: 12, width: 48, height: 40, ..Orbit::default() };
        let mesh = primitives::cuboid([1.0, 0.6, 0.8]).colored([0.9, 0.3, 0.2]);
        render_views(&mesh, &orbit.cameras(), &RenderOptions::default(), &|_, _| {}).unwrap()
    }

    #[test]
    fn sizes_are_what_they_say() {
        let good = views();
        // A camera that is moved around the object looks at it as before.
        let bad = Planted::OneView(20.0).plant(good.clone(), [0.0, 0.08, 0.0], 3);
        let (a, b) = (good[4].camera.center(), bad[4].camera.center());
        let middle = Vector3::new(0.0, 0.08, 0.0);
        let angle = (a - middle).angle(&(b - middle)).to_degrees();
        assert!(angle > 1.0 && angle < 20.001, "{angle}");
        let [before, after] =
            [&good[4], &bad[4]].map(|view| view.camera.project([0.0, 0.08, 0.0]).column);
        assert!((before - after).abs() < 1e-9);
        assert_eq!(good[3], bad[3]);

        // Half a degree: cameras move by about a hundredth of their distance, a little more with the turns.
        let bad = Planted::Poses(0.5).plant(good.clone(), [0.0; 3], 0);
        let moved = |k: usize| {
            let (a, b) = (good[k].camera.center(), bad[k].camera.center());
            (a - b).norm_squared() / a.norm_squared() / 3.0
        };
        let deviation = ((0..12).map(moved).sum::<f64>() / 12.0).sqrt().to_degrees();
        assert!((0.3..0.7).contains(&deviation), "{deviation}");

        let area = |views: &[View], k: usize| views[k].mask_pixels() as f64;
        let blobs = Planted::Blobs { views: 0.25, area: 0.2 }.plant(good.clone(), [0.0; 3], 0);
        let changed: Vec<usize> = (0..12).filter(|&k| blobs[k] != good[k]).collect();
        assert_eq!(changed, [2, 6, 10]);
        let grown = area(&blobs, 2) / area(&good, 2);
        assert!((1.04..1.2).contains(&grown), "{grown}");
    }

    #[test]
    fn what_is_turned_twice_is_as_before() {
        let good = views();
        for mistake in [Planted::Axes, Planted::FlippedX, Planted::FlippedY, Planted::Inverted] {
            let bad = mistake.plant(good.clone(), [0.0; 3], 0);
            assert_ne!(bad, good, "{mistake:?}");
            assert_eq!(mistake.plant(bad, [0.0; 3], 0), good, "{mistake:?}");
        }
    }

    #[test]
    fn views_that_are_left_are_those_of_one_side() {
        let good = views();
        let half = Planted::OneSided(90.0).plant(good.clone(), [0.0; 3], 0);
        assert!(half.len() > 3 && half.len() < 10, "{}", half.len());
        assert_eq!(Planted::Few(4).plant(good, [0.0; 3], 0).len(), 4);
    }
}
