//! One photograph, and the crops that the network sees of it.

use datasets::{ReadOptions, View, clean_mask};
use mesh_core::{ByteImage, Camera, Lens};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use synth::PoseNoise;
use train::{DataError, Subset};

use super::config::McmrConfig;
use super::pose::{CommonLens, Pose};
use crate::view_cache::Stored;

/// A photograph as it was read.
#[derive(Debug)]
pub struct Photo {
    /// What it is called in messages.
    pub name: String,
    color: ByteImage,
    mask: ByteImage,
    /// The camera that took it, as far as anybody knows.
    camera: Camera,
    /// The camera as training knows it.
    rough: Camera,
    /// The object's box: left, top, right, bottom, pixels.
    bounds: [f64; 4],
}

impl Stored for Photo {
    fn bytes(&self) -> usize {
        self.color.data.len() + self.mask.data.len()
    }
}

/// What is made of a photograph's mask.
#[derive(Clone, Copy, Debug)]
pub(super) struct Masking {
    /// What is not the object is black.
    pub(super) cut_out: bool,
    /// What the object surrounds is object.
    pub(super) fill_holes: bool,
}

impl Masking {
    pub(super) fn of(config: &McmrConfig) -> Self {
        Self { cut_out: config.cut_out, fill_holes: config.fill_holes }
    }
}

/// What a camera is known as in training.
#[derive(Clone, Debug)]
pub(super) enum Rough {
    /// As it is.
    Exact,
    /// Disturbed by noise of this size, drawn by a seed and a number of the object's own.
    Noisy(PoseNoise, u64),
    /// As the data says.
    Known(Camera),
}

impl Photo {
    /// A view, cut out along the mask that it has; then that mask's holes are filled.
    ///
    /// # Errors
    /// If the mask is empty.
    pub(super) fn new(
        view: &View,
        rough: &Rough,
        object: u64,
        masking: Masking,
    ) -> Result<Self, DataError> {
        let Some([top, left, height, width]) = view.mask_bounds() else {
            return Err(DataError::Unfit(format!("{}: its mask is empty", view.name)));
        };
        let mut mask = view.mask.clone();
        let filling = ReadOptions { fill_holes: masking.fill_holes, ..ReadOptions::default() };
        clean_mask(&mut mask, &filling);
        let camera = view.camera.clone();
        let rough = match rough {
            Rough::Exact => camera.clone(),
            Rough::Noisy(noise, seed) => noise.drawn(&camera, *seed, object),
            Rough::Known(rough) => rough.clone(),
        };
        Ok(Self {
            name: view.name.clone(),
            color: if masking.cut_out { cut_out_of(view) } else { view.color.clone() },
            mask,
            camera,
            rough,
            bounds: [left, top, left + width, top + height].map(|x| x as f64),
        })
    }

    /// The square around the object's box: left, top, side.
    pub(super) fn square(&self, margin: f64) -> [f64; 3] {
        let [left, top, right, bottom] = self.bounds;
        let side = (right - left).max(bottom - top) * (1.0 + 2.0 * margin);
        [0.5 * (left + right - side), 0.5 * (top + bottom - side), side]
    }

    /// The crop of a subset that is scored and predicted from.
    pub(super) fn plain(&self, subset: Subset, config: &McmrConfig) -> Sample {
        self.cut(self.square(config.margin_in(subset)), [false; 2], config)
    }

    /// A random crop.
    pub(super) fn random(&self, config: &McmrConfig, rng: &mut ChaCha8Rng) -> Sample {
        let [left, top, side] = self.square(config.margin);
        let mut draw = || config.jitter * (2.0 * rng.random::<f64>() - 1.0);
        let larger = side * (1.0 + draw());
        let [x, y] = [left, top].map(|edge| edge - 0.5 * (larger - side) + side * draw());
        let flips = [config.flip, config.prediction_flip].map(|p| rng.random::<f64>() < p);
        self.cut([x, y, larger], flips, config)
    }

    /// A square of the image, mirrored or not before the network sees it, and once more or not before its
    /// prediction is compared.
    fn cut(&self, square: [f64; 3], [flip, turned]: [bool; 2], config: &McmrConfig) -> Sample {
        let side = config.image_size;
        let mut image = cut(&self.color, square, side);
        let mut mask = cut(&self.mask, square, side);
        let of = |camera: &Camera| {
            let camera = cropped(camera, square, side);
            let pose = Pose::of(&camera, lens_of(config));
            if flip { pose.flipped() } else { pose }
        };
        let (pose, true_pose) = (of(&self.rough), of(&self.camera));
        if flip {
            mirror(&mut image, side);
            mirror(&mut mask, side);
        }
        let mut target = image.clone();
        if turned {
            mirror(&mut target, side);
            mirror(&mut mask, side);
        }
        let name = self.name.clone();
        Sample { name, image, target, mask, pose, turned, true_pose }
    }
}

/// The lens that a configuration thinks all images are taken with.
pub(super) fn lens_of(config: &McmrConfig) -> CommonLens {
    CommonLens { focal: config.focal, distance: config.distance }
}

/// A crop, ready for the tape.
#[derive(Clone, Debug)]
pub struct Sample {
    /// What it is called in messages.
    pub(super) name: String,
    /// What the network sees, `[S, S, 3]`.
    pub(super) image: Vec<u8>,
    /// What its prediction is compared with, `[S, S, 3]`.
    pub(super) target: Vec<u8>,
    /// The object in `target`, `[S, S]`: the share of each pixel.
    pub(super) mask: Vec<u8>,
    /// The rough pose in `image`, which the camera's prediction is compared with.
    pub(super) pose: Pose,
    /// Whether `target` and its mask are `image` mirrored.
    pub(super) turned: bool,
    /// The true pose in `image`; the rough one where nothing better is known.
    pub(super) true_pose: Pose,
}

impl Sample {
    /// A pose in `image` as it is in `target`.
    pub(super) fn in_target(&self, pose: Pose) -> Pose {
        if self.turned { pose.flipped() } else { pose }
    }

    /// The box of the mask in an image of this side: left, right, lowest, highest, NDC; none where nothing is an object's.
    pub(super) fn bounds(&self, side: usize) -> Option<[f64; 4]> {
        let on: Vec<usize> = (0..self.mask.len()).filter(|&k| self.mask[k] >= 128).collect();
        let ends = |of: fn(usize, usize) -> usize| {
            let all = || on.iter().map(|&k| of(k, side));
            Some((all().min()?, all().max()? + 1))
        };
        let ((left, right), (top, bottom)) = (ends(|k, side| k % side)?, ends(|k, side| k / side)?);
        let ndc = |edge: usize| 2.0 * edge as f64 / side as f64 - 1.0;
        Some([ndc(left), ndc(right), -ndc(bottom), -ndc(top)])
    }
}

/// The camera of a square of its image, resized to `side`.
pub(super) fn cropped(camera: &Camera, [left, top, square]: [f64; 3], side: usize) -> Camera {
    let k = side as f64 / square;
    let at = |cx: f64, cy: f64| [(cx - left) * k, (cy - top) * k];
    let lens = match camera.lens {
        Lens::Perspective { fx, fy, cx, cy } => {
            let [cx, cy] = at(cx, cy);
            Lens::Perspective { fx: fx * k, fy: fy * k, cx, cy }
        }
        Lens::Orthographic { sx, sy, cx, cy } => {
            let [cx, cy] = at(cx, cy);
            Lens::Orthographic { sx: sx * k, sy: sy * k, cx, cy }
        }
    };
    Camera { lens, width: side, height: side, ..camera.clone() }
}

/// An image with black around its object. As it is where it has black there, soft edges included: pixels that the edge of the mask
/// touches may be both.
fn cut_out_of(view: &View) -> ByteImage {
    /// Of 255: what a JPEG makes of black.
    const BLACK: u8 = 8;
    /// Of twenty pixels around the object so many are black: what is thinner than half a pixel is in no mask.
    const IN_TWENTY: usize = 19;
    let (mut color, mask) = (view.color.clone(), &view.mask);
    let is_object = |i: usize, j: usize| mask.data[i * mask.width + j] >= 128;
    let is_near = |i: usize, j: usize| {
        let rows = i.saturating_sub(1)..(i + 2).min(mask.height);
        let columns = j.saturating_sub(1)..(j + 2).min(mask.width);
        rows.into_iter().any(|i| columns.clone().any(|j| is_object(i, j)))
    };
    let around = || (0..mask.height).flat_map(|i| (0..mask.width).map(move |j| (i, j)));
    let is_black = |&(i, j): &(usize, usize)| {
        let k = (i * mask.width + j) * color.channels;
        color.data[k..k + color.channels].iter().all(|&c| c <= BLACK)
    };
    let (mut all, mut black) = (0, 0);
    for at in around().filter(|&(i, j)| !is_near(i, j)) {
        all += 1;
        black += usize::from(is_black(&at));
    }
    if IN_TWENTY * all <= 20 * black {
        return color;
    }
    let channels = color.channels;
    for (pixel, &mask) in color.data.chunks_exact_mut(channels).zip(&mask.data) {
        if mask < 128 {
            pixel.fill(0);
        }
    }
    color
}

/// A square of an image as `[side, side, C]`: means of bilinear samples, black beyond the border.
fn cut(image: &ByteImage, [left, top, square]: [f64; 3], side: usize) -> Vec<u8> {
    let step = square / side as f64;
    // As many samples a pixel and axis as there are pixels under it, up to four.
    let samples = (step.ceil() as usize).clamp(1, 4);
    let offsets: Vec<f64> = (0..samples).map(|i| (i as f64 + 0.5) / samples as f64).collect();
    let c = image.channels;
    let mut out = Vec::with_capacity(side * side * c);
    let mut sum = vec![0.0; c];
    for (i, j) in (0..side).flat_map(|i| (0..side).map(move |j| (i, j))) {
        sum.fill(0.0);
        for (v, u) in offsets.iter().flat_map(|v| offsets.iter().map(move |u| (v, u))) {
            let (x, y) = (left + (j as f64 + u) * step - 0.5, top + (i as f64 + v) * step - 0.5);
            add_sample(image, [x, y], &mut sum);
        }
        let scale = 1.0 / (samples * samples) as f64;
        out.extend(sum.iter().map(|s| (s * scale + 0.5) as u8));
    }
    out
}

/// Adds a bilinear sample at pixel centres' coordinates.
fn add_sample(image: &ByteImage, [x, y]: [f64; 2], sum: &mut [f64]) {
    let (left, top) = (x.floor(), y.floor());
    let (across, down) = (x - left, y - top);
    let c = image.channels;
    if left >= 0.0
        && top >= 0.0
        && left + 1.0 < image.width as f64
        && top + 1.0 < image.height as f64
    {
        // The same sum of four pixels that all exist, as most do.
        let upper = &image.data[(top as usize * image.width + left as usize) * c..];
        let lower = &upper[image.width * c..][..2 * c];
        for (k, s) in sum.iter_mut().enumerate() {
            *s += (1.0 - down) * (1.0 - across) * f64::from(upper[k]);
            *s += (1.0 - down) * across * f64::from(upper[k + c]);
            *s += down * (1.0 - across) * f64::from(lower[k]);
            *s += down * across * f64::from(lower[k + c]);
        }
        return;
    }
    for (row, share) in [(top, 1.0 - down), (top + 1.0, down)] {
        for (column, weight) in [(left, 1.0 - across), (left + 1.0, across)] {
            let inside = row >= 0.0
                && column >= 0.0
                && row < image.height as f64
                && column < image.width as f64;
            if inside {
                let at = (row as usize * image.width + column as usize) * c;
                let pixel = &image.data[at..at + c];
                sum.iter_mut().zip(pixel).for_each(|(s, &p)| *s += share * weight * f64::from(p));
            }
        }
    }
}

/// Left and right change places; rows of `side` pixels.
fn mirror(data: &mut [u8], side: usize) {
    let channels = data.len() / (side * side);
    for row in data.chunks_exact_mut(side * channels) {
        for j in 0..side / 2 {
            for k in 0..channels {
                row.swap(j * channels + k, (side - 1 - j) * channels + k);
            }
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::primitives::{icosphere, torus};
    use rand::SeedableRng;
    use synth::{RenderOptions, render_views};

    use super::*;

    const CUT_OUT: Masking = Masking { cut_out: true, fill_holes: false };

    /// An ellipsoid, symmetric in x, beside the middle of the image.
    fn photo() -> Photo {
        let mesh = icosphere(3).scaled([0.3, 0.2, 0.5]).colored([0.9, 0.3, 0.1]);
        let camera =
            Camera::look_at([1.2, 0.6, 1.4], [0.1, 0.05, 0.0], [0.0, 1.0, 0.0], 0.7, 200, 160);
        let views = render_views(&mesh, &[camera], &RenderOptions::default(), &|_, _| ()).unwrap();
        Photo::new(&views[0], &Rough::Exact, 0, CUT_OUT).unwrap()
    }

    /// The outline of the ellipsoid's points under a pose: lowest and highest x and y.
    fn outline(pose: Pose, lens: CommonLens) -> [f64; 4] {
        let m = pose.projection(lens).map(f64::from);
        let mut found = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
        for p in icosphere(3).scaled([0.3, 0.2, 0.5]).positions {
            let row = |k: usize| {
                (0..3).map(|j| m[4 * k + j] * f64::from(p[j])).sum::<f64>() + m[4 * k + 3]
            };
            let (x, y) = (row(0) / row(2), row(1) / row(2));
            found = [found[0].min(x), found[1].max(x), found[2].min(y), found[3].max(y)];
        }
        found
    }

    /// However a crop is jittered and mirrored, the ellipsoid under its pose lies where its mask does.
    #[test]
    fn poses_go_with_their_crops() {
        let photo = photo();
        let config =
            McmrConfig { jitter: 0.2, focal: 3.84, distance: 2.0, ..McmrConfig::default() };
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut mirrored = 0;
        for _ in 0..24 {
            let sample = photo.random(&config, &mut rng);
            mirrored += usize::from(sample.turned);
            // What the jitter cuts off ends at the border.
            let found = outline(sample.in_target(sample.pose), lens_of(&config))
                .map(|x| x.clamp(-1.0, 1.0));
            let expected = sample.bounds(64).unwrap();
            for (f, e) in found.iter().zip(expected) {
                // The common lens bends a little otherwise than the camera.
                assert!((f - e).abs() < 0.1, "{found:?} {expected:?}");
            }
            assert_eq!(sample.true_pose, sample.pose);
        }
        assert!(mirrored > 4 && mirrored < 20);
    }

    #[test]
    fn a_crop_is_the_part_of_the_image() {
        let image =
            ByteImage { height: 4, width: 6, channels: 1, data: (0..24).map(|v| 10 * v).collect() };
        assert_eq!(cut(&image, [1.0, 1.0, 2.0], 2), [70, 80, 130, 140]);
        // Half of the size: means of four. Beyond the border it is black.
        assert_eq!(cut(&image, [0.0, 0.0, 4.0], 2)[0], 35);
        assert_eq!(cut(&image, [-2.0, 0.0, 2.0], 2), [0; 4]);
        let mut row = vec![1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12];
        mirror(&mut row, 2);
        assert_eq!(row, [4, 5, 6, 1, 2, 3, 10, 11, 12, 7, 8, 9]);
    }

    /// Whatever an object stands before, the network sees the same.
    #[test]
    fn backgrounds_do_not_matter() {
        let mesh = icosphere(3).scaled([0.3, 0.2, 0.5]).colored([0.9, 0.3, 0.1]);
        let camera =
            Camera::look_at([1.2, 0.6, 1.4], [0.1, 0.05, 0.0], [0.0, 1.0, 0.0], 0.7, 200, 160);
        let before = |background: [f32; 3]| {
            let look = RenderOptions { background, ..RenderOptions::default() };
            let camera = camera.clone();
            render_views(&mesh, &[camera], &look, &|_, _| ()).unwrap().remove(0)
        };
        let image = |view: &View, cut_out: bool| {
            let photo = Photo::new(view, &Rough::Exact, 0, Masking { cut_out, ..CUT_OUT }).unwrap();
            photo.plain(Subset::Test, &McmrConfig::default()).image
        };
        let difference = |a: &[u8], b: &[u8]| {
            let all = a.iter().zip(b).map(|(&a, &b)| f64::from(a.abs_diff(b)));
            all.sum::<f64>() / a.len() as f64
        };
        let (black, white) = (before([0.0; 3]), before([1.0; 3]));
        assert_eq!(image(&black, true), image(&black, false), "was black before");
        assert!(difference(&image(&black, true), &image(&white, true)) < 2.0);
        assert!(difference(&image(&black, true), &image(&white, false)) > 50.0);
    }

    /// A ring seen from above: its middle is object if holes are filled, and the network sees the same.
    #[test]
    fn what_a_mask_surrounds_is_object_where_asked() {
        let mesh = torus(0.4, 0.1, 32, 16);
        let camera = Camera::look_at([0.0, 2.0, 0.3], [0.0; 3], [0.0, 1.0, 0.0], 0.7, 200, 160);
        let views = render_views(&mesh, &[camera], &RenderOptions::default(), &|_, _| ()).unwrap();
        let [open, filled] = [false, true].map(|fill_holes| {
            let masking = Masking { fill_holes, ..CUT_OUT };
            let photo = Photo::new(&views[0], &Rough::Exact, 0, masking).unwrap();
            photo.plain(Subset::Test, &McmrConfig::default())
        });
        let middle = 32 * 64 + 32;
        assert_eq!([open.mask[middle], filled.mask[middle]], [0, 255]);
        assert!(open.mask.iter().zip(&filled.mask).all(|(open, filled)| open <= filled));
        assert_eq!(open.mask[..64 * 8], filled.mask[..64 * 8], "outside nothing changes");
        assert_eq!(open.image, filled.image);
    }

    #[test]
    fn margins_of_tests_are_their_own() {
        let photo = photo();
        let config = McmrConfig { test_margin: Some(0.0), ..McmrConfig::default() };
        let width = |subset| {
            let [left, right, ..] = photo.plain(subset, &config).bounds(64).unwrap();
            right - left
        };
        assert!(width(Subset::Test) > 1.9 && width(Subset::Validation) < 1.8);
    }

    #[test]
    fn noise_is_of_the_object_and_not_of_the_crop() {
        let photo = photo();
        let view = View {
            crop: None,
            name: "a".into(),
            color: photo.color.clone(),
            mask: photo.mask.clone(),
            camera: photo.camera.clone(),
            depth: None,
        };
        let noise = Rough::Noisy(PoseNoise::default(), 3);
        let [a, b, c] =
            [(0, 7), (1, 7), (2, 8)].map(|(_, k)| Photo::new(&view, &noise, k, CUT_OUT).unwrap());
        assert_eq!(a.rough, b.rough);
        assert_ne!(a.rough, c.rough);
        assert_ne!(a.rough, a.camera);
        let blank =
            View { mask: ByteImage { data: vec![0; 200 * 160], ..view.mask.clone() }, ..view };
        let error = Photo::new(&blank, &noise, 0, CUT_OUT).unwrap_err().to_string();
        assert!(error.contains("mask"), "{error}");
    }
}
