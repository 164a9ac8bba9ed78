//! Depth as a network guesses it from one image: inverse, of unknown scale, blurred, with a floor.
//!
//! Networks such as MiDaS answer with inverse depth (disparity) up to a scale and a shift that
//! differ from image to image, with soft outlines, and they see a ground plane under objects
//! that stand on nothing (issues of "depth-aware" Pixel2Mesh and Mesh R-CNN). This makes such a
//! channel from true depth, so that a system can be trained and tested on it:
//!
//! ```text
//! d(p)  = m / z(p)                     on the object, z planar depth, m its median over the object
//! g(p)  = ground · m / z_plane(p)      behind it, where the ray meets the plane under the object
//! out   = scale · blur(max(d, g)) + shift
//! ```
//!
//! Estimates are also wrong within the object ([`Monocular::with_relief_errors`]). With `σ` the standard deviation of `d`
//! over the object and `q` the place in its box, from -1 to 1, before the blur
//!
//! ```text
//! d'(q) = (1 - flat) d + flat · plane(d) + σ · (tilt · u·q + warp · Σᵢ cos(wᵢ·q + φᵢ) / √2)       i = 1 to 4
//! ```
//!
//! where `plane(d)` is the affine function of `q` nearest to `d`, and the direction `u`, the slow waves `wᵢ` and their phases
//! `φᵢ` are drawn. Inverse depth of a wrong shift bends planes (Yin et al. 2021, *Learning to Recover 3D Scene Shape from a
//! Single Image*); that what is lower in an image is taken for nearer is a bias that MiDaS' authors name (Ranftl et al. 2020,
//! *Towards Robust Monocular Depth Estimation*); that outlines and detail are lost at the resolution of the network is the subject
//! of Miangoleh et al. 2021, *Boosting Monocular Depth Estimation Models to High-Resolution*.
//!
//! Larger is nearer, as in MiDaS. Without blur, `out` on the object is an affine function of `1/z`
//! exactly; dividing by the median makes the ranges of scale and shift mean the same for any unit.
//!
//! ```
//! use mesh_core::primitives;
//! use synth::{Monocular, R2n2Cameras, RenderOptions, render_views};
//!
//! let mesh = primitives::cuboid([0.5; 3]);
//! let cameras = R2n2Cameras { count: 1, ..R2n2Cameras::default() }.cameras();
//! let options = RenderOptions { depth: true, ..RenderOptions::default() };
//! let view = render_views(&mesh, &cameras, &options, &|_, _| {})?.remove(0);
//! let guess = Monocular::default().guess(&view, Some(-0.25), 7).expect("the view has depth");
//! assert_eq!((guess.image.height, guess.image.channels), (137, 1));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

use datasets::View;
use mesh_core::{Camera, Image, MedianOfEven};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use crate::relief_errors::ReliefErrors;

/// How depth is guessed; ranges are drawn from evenly, anew for each view.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Monocular {
    /// Range of the factor; above 0.
    pub scale: [f64; 2],
    /// Range of what is added after it.
    pub shift: [f64; 2],
    /// Range of the Gaussian blur's deviation, in hundredths of the image's width; 0 is sharp.
    pub blur: [f64; 2],
    /// Range of how much of the floor's disparity is seen: 1 a floor where the object stands, 0
    /// none.
    pub ground: [f64; 2],
    /// Range of how far the object leans at the rim of its box, in deviations of its disparity; which way is drawn too.
    pub tilt: [f64; 2],
    /// Range of how far it is bent smoothly: a deviation, in those of its disparity.
    pub warp: [f64; 2],
    /// Range of how much of its relief is lost: 1 leaves a plane.
    pub flat: [f64; 2],
}

/// A guess, and what was drawn for it.
#[derive(Clone, Debug, PartialEq)]
pub struct Guess {
    /// Disparity up to scale and shift, `[H, W, 1]`; every value is finite.
    pub image: Image,
    /// The factor that was drawn.
    pub scale: f64,
    /// The shift that was drawn.
    pub shift: f64,
    /// The deviation of the blur, pixels.
    pub blur: f64,
    /// The strength of the floor.
    pub ground: f64,
}

impl Default for Monocular {
    fn default() -> Self {
        Self {
            scale: [0.5, 2.0],
            shift: [-0.5, 0.5],
            blur: [0.4, 1.2],
            ground: [0.7, 1.0],
            tilt: [0.0; 2],
            warp: [0.0; 2],
            flat: [0.0; 2],
        }
    }
}

impl Monocular {
    /// Wrong within the object too: leaning, bent, flattened and soft. Of the variance of a cuboid's inverse depth the best scale
    /// and shift of such an estimate explain about three quarters.
    pub fn with_relief_errors() -> Self {
        Self {
            blur: [1.2, 3.0],
            tilt: [0.2, 1.0],
            warp: [0.2, 0.6],
            flat: [0.0, 0.5],
            ..Self::default()
        }
    }

    /// What is wrong with the ranges, one sentence each.
    pub fn check(&self) -> Vec<String> {
        let named = [
            ("scale", self.scale, f64::MIN_POSITIVE, 1e6),
            ("shift", self.shift, -1e6, 1e6),
            ("blur", self.blur, 0.0, 100.0),
            ("ground", self.ground, 0.0, 1.0),
            ("tilt", self.tilt, 0.0, 100.0),
            ("warp", self.warp, 0.0, 100.0),
            ("flat", self.flat, 0.0, 1.0),
        ];
        named
            .into_iter()
            .filter(|&(_, [low, high], least, most)| !(least <= low && low <= high && high <= most))
            .map(|(name, [low, high], least, most)| {
                let least = if least == f64::MIN_POSITIVE { 0.0 } else { least };
                format!("{name}: found [{low}, {high}], expected a range within {least} to {most}")
            })
            .collect()
    }

    /// Guesses the depth of a view; the same for the same seed.
    ///
    /// `floor` is the height (y) of the plane that the object stands on, usually its lowest
    /// point; `None` where there is nothing to stand on. Returns `None` where the view has no
    /// depth.
    ///
    /// # Cost
    /// `O(H W)` with the blur's width as factor; under a millisecond at 137 x 137.
    pub fn guess(&self, view: &View, floor: Option<f32>, seed: u64) -> Option<Guess> {
        let depth = view.depth.as_ref()?;
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut draw = |[low, high]: [f64; 2]| low + (high - low) * rng.random::<f64>();
        let (scale, shift) = (draw(self.scale), draw(self.shift));
        let blur = draw(self.blur) / 100.0 * depth.width as f64;
        let ground = draw(self.ground);
        let [tilt, warp, flat] = [self.tilt, self.warp, self.flat].map(draw);
        let relief = ReliefErrors::drawn(tilt, warp, flat, &mut rng);
        let seen = depth.data.iter().copied().filter(|z| z.is_finite());
        let unit = median(seen).unwrap_or(1.0);
        let floor = floor.filter(|_| ground > 0.0);
        let plane = floor.and_then(|height| plane(&view.camera, f64::from(height)));
        let mut data = Vec::with_capacity(depth.data.len());
        for (k, &z) in depth.data.iter().enumerate() {
            // The floor is behind the object wherever both are seen.
            let disparity = if z.is_finite() {
                1.0 / f64::from(z)
            } else {
                let (row, column) = (k / depth.width, k % depth.width);
                let [row, column] = [row, column].map(|k| k as f64 + 0.5);
                let met = |[corner, across, down]: [f64; 3]| corner + across * column + down * row;
                plane.map_or(0.0, |plane| ground * met(plane).max(0.0))
            };
            data.push((unit * disparity) as f32);
        }
        let object: Vec<bool> = depth.data.iter().map(|z| z.is_finite()).collect();
        relief.apply(&mut data, depth.width, &object);
        gaussian(&mut data, depth.width, blur);
        for value in &mut data {
            *value = (scale * f64::from(*value) + shift) as f32;
        }
        let image = Image { height: depth.height, width: depth.width, channels: 1, data };
        Some(Guess { image, scale, shift, blur, ground })
    }
}

/// Inverse depth of the horizontal plane at a height below a perspective camera: at the image's corner, and how it grows
/// by a column and by a row.
fn plane(camera: &Camera, height: f64) -> Option<[f64; 3]> {
    // With eye `e` and rays `e + z r(p)` of planar depth z, the plane y = h is met at
    // 1/z = r_y(p) / (h - e_y), and r is affine in the pixel. Parallel rays have no such form.
    let below = height - camera.center().y;
    let derivative =
        |column: f64, row: f64| (camera.unproject(column, row, 1.0)[1] - camera.center().y) / below;
    (camera.is_perspective() && below < 0.0).then(|| {
        let corner = derivative(0.0, 0.0);
        [corner, derivative(1.0, 0.0) - corner, derivative(0.0, 1.0) - corner]
    })
}

/// The upper median.
fn median(values: impl Iterator<Item = f32>) -> Option<f64> {
    mesh_core::median(values, MedianOfEven::Upper).map(f64::from)
}

/// Blurs rows, then columns, with the border's value continued outside.
fn gaussian(data: &mut [f32], width: usize, deviation: f64) {
    if deviation <= 0.0 || data.is_empty() {
        return;
    }
    let reach = (3.0 * deviation).ceil() as usize;
    let weight = |k: usize| (-0.5 * (k as f64 / deviation).powi(2)).exp();
    let total = (1..=reach).fold(weight(0), |sum, k| sum + 2.0 * weight(k));
    let weights: Vec<f32> = (0..=reach).map(|k| (weight(k) / total) as f32).collect();
    let height = data.len() / width;
    let mut line = Vec::new();
    for row in data.chunks_exact_mut(width) {
        line.clear();
        line.extend_from_slice(row);
        blur_line(&line, &weights, |j, value| row[j] = value);
    }
    for j in 0..width {
        line.clear();
        line.extend((0..height).map(|i| data[i * width + j]));
        blur_line(&line, &weights, |i, value| data[i * width + j] = value);
    }
}

fn blur_line(line: &[f32], weights: &[f32], mut put: impl FnMut(usize, f32)) {
    let last = line.len() - 1;
    for i in 0..line.len() {
        let pairs = weights.iter().enumerate().skip(1);
        let value = pairs.fold(weights[0] * line[i], |sum, (k, w)| {
            sum + w * (line[i.saturating_sub(k)] + line[(i + k).min(last)])
        });
        put(i, value);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::{R2n2Cameras, RenderOptions, render_views};
    use mesh_core::primitives;

    fn view() -> View {
        let mesh = primitives::cuboid([0.5, 0.4, 0.3]);
        let cameras = R2n2Cameras { count: 1, width: 90, height: 70, ..R2n2Cameras::default() };
        let options = RenderOptions { depth: true, ..RenderOptions::default() };
        render_views(&mesh, &cameras.cameras(), &options, &|_, _| {}).unwrap().remove(0)
    }

    const SHARP: Monocular = Monocular {
        scale: [2.0, 3.0],
        shift: [0.5, 1.0],
        blur: [0.0, 0.0],
        ground: [1.0, 1.0],
        tilt: [0.0; 2],
        warp: [0.0; 2],
        flat: [0.0; 2],
    };

    #[test]
    fn without_blur_it_is_affine_in_the_inverse_of_depth() {
        let view = view();
        let guess = SHARP.guess(&view, None, 3).unwrap();
        let depth = &view.depth.as_ref().unwrap().data;
        let unit = median(depth.iter().copied().filter(|z| z.is_finite())).unwrap();
        for (&z, &value) in depth.iter().zip(&guess.image.data) {
            let expected = guess.scale * unit / f64::from(z) + guess.shift;
            assert!((f64::from(value) - expected).abs() < 1e-5);
        }
        assert!((2.0..=3.0).contains(&guess.scale) && (0.5..=1.0).contains(&guess.shift));
        assert_eq!(guess, SHARP.guess(&view, None, 3).unwrap());
        assert_ne!(guess.scale, SHARP.guess(&view, None, 4).unwrap().scale);
    }

    /// How much of the variance of inverse depth the best scale and shift of a guess explain: almost all without errors in
    /// relief, about three quarters with them.
    #[test]
    fn an_estimate_with_relief_errors_is_no_affine_function_of_the_truth() {
        let view = view();
        let depth = &view.depth.as_ref().unwrap().data;
        let explained = |monocular: &Monocular, seed: u64| {
            let guess = monocular.guess(&view, None, seed).unwrap().image.data;
            let pairs: Vec<[f64; 2]> = (depth.iter().zip(&guess))
                .filter(|(z, _)| z.is_finite())
                .map(|(&z, &g)| [1.0 / f64::from(z), f64::from(g)])
                .collect();
            let mean = |k: usize| pairs.iter().map(|p| p[k]).sum::<f64>() / pairs.len() as f64;
            let means = [mean(0), mean(1)];
            let product = |i: usize, j: usize| -> f64 {
                pairs.iter().map(|p| (p[i] - means[i]) * (p[j] - means[j])).sum()
            };
            product(0, 1).powi(2) / (product(0, 0) * product(1, 1))
        };
        let mean = |monocular: &Monocular| {
            (0..40).map(|seed| explained(monocular, seed)).sum::<f64>() / 40.0
        };
        assert!((0..9).all(|seed| explained(&SHARP, seed) > 0.999));
        let wrong = mean(&Monocular { blur: [0.0; 2], ..Monocular::with_relief_errors() });
        assert!((0.65..0.82).contains(&wrong), "{wrong}");
    }

    /// The floor is where rays meet it, and never in front of the object.
    #[test]
    fn the_floor_lies_under_the_object() {
        let view = view();
        let guess = SHARP.guess(&view, Some(-0.2), 3).unwrap();
        let depth = &view.depth.as_ref().unwrap().data;
        let unit = median(depth.iter().copied().filter(|z| z.is_finite())).unwrap();
        let mut met = 0;
        for (k, &z) in depth.iter().enumerate() {
            let ray = view.camera.ray((k % 90) as f64 + 0.5, (k / 90) as f64 + 0.5);
            let t = (-0.2 - ray.origin[1]) / ray.direction[1];
            if t <= 0.0 {
                continue;
            }
            let point = std::array::from_fn(|a| ray.origin[a] + t * ray.direction[a]);
            let floor = view.camera.project(point).depth;
            let nearest = if z.is_finite() {
                assert!(f64::from(z) < floor + 1e-4, "the floor covers the object");
                f64::from(z)
            } else {
                met += 1;
                floor
            };
            let expected = guess.scale * unit / nearest + guess.shift;
            assert!((f64::from(guess.image.data[k]) - expected).abs() < 1e-4);
        }
        assert!(met > 2000, "{met}");
    }

    #[test]
    fn blur_softens_and_keeps_the_mean_of_what_is_inside() {
        let mut data = vec![0.0; 41 * 31];
        data[15 * 41 + 20] = 1.0;
        gaussian(&mut data, 41, 2.0);
        assert!((data.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        // The peak of a Gaussian of deviation 2 in two dimensions: 1 / (2 π 4).
        assert!((data[15 * 41 + 20] - 0.0398).abs() < 1e-3);
        assert_eq!(data[15 * 41 + 17], data[15 * 41 + 23]);
        let mut flat = vec![3.0; 35];
        gaussian(&mut flat, 7, 20.0);
        assert!(flat.iter().all(|v| (v - 3.0).abs() < 1e-5));
    }

    #[test]
    fn ranges_that_make_no_sense_are_named() {
        assert!(Monocular::default().check().is_empty());
        let wrong = Monocular { scale: [0.0, 1.0], blur: [2.0, 1.0], ..Monocular::default() };
        let wrong = wrong.check();
        assert_eq!(wrong.len(), 2);
        assert!(wrong[0].starts_with("scale") && wrong[1].starts_with("blur"));
    }
}
