//! One photograph, and the crops that the network sees of it.

use datasets::View;
use mesh_core::{ByteImage, Camera, Lens};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::config::McmrConfig;
use super::pose::{CommonLens, Pose};
use crate::shelf::Stored;
use crate::synthetic::PoseNoise;
use crate::train::DataError;

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

/// What a camera is known as in training.
#[derive(Clone, Debug)]
pub(super) enum Rough {
    /// As it is.
    Exact,
    /// Disturbed by noise of this size, drawn by a seed and the object's number.
    Noisy(PoseNoise, u64),
    /// As the data says.
    Known(Camera),
}

impl Photo {
    /// # Errors
    /// If the mask is empty.
    pub(super) fn new(view: &View, rough: &Rough, object: usize) -> Result<Self, DataError> {
        let Some([top, left, height, width]) = view.mask_bounds() else {
            return Err(DataError::Unfit(format!("{}: its mask is empty", view.name)));
        };
        let camera = view.camera.clone();
        let rough = match rough {
            Rough::Exact => camera.clone(),
            Rough::Noisy(noise, seed) => noise.drawn(&camera, *seed, object as u64),
            Rough::Known(rough) => rough.clone(),
        };
        Ok(Self {
            name: view.name.clone(),
            color: view.color.clone(),
            mask: view.mask.clone(),
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

    /// The crop that is scored and predicted from.
    pub(super) fn plain(&self, config: &McmrConfig) -> Sample {
        self.cut(self.square(config.margin), [false; 2], config)
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

    /// A square of the picture, mirrored or not before the network sees it, and once more or not before its
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
        let (mut target, mut view) = (image.clone(), pose);
        if turned {
            mirror(&mut target, side);
            mirror(&mut mask, side);
            view = view.flipped();
        }
        let name = self.name.clone();
        Sample { name, image, target, mask, pose, view, true_pose }
    }
}

/// The lens that a configuration thinks all pictures are taken with.
pub(super) fn lens_of(config: &McmrConfig) -> CommonLens {
    CommonLens { focal: config.focal, distance: config.distance }
}

/// A crop, ready for the tape.
#[derive(Clone, Debug)]
pub struct Sample {
    /// What it is called in messages.
    pub(super) name: String,
    /// What the network sees, `[S, S, 3]`, background and all.
    pub(super) image: Vec<u8>,
    /// What its prediction is compared with, `[S, S, 3]`.
    pub(super) target: Vec<u8>,
    /// The object in `target`, `[S, S]`: the share of each pixel.
    pub(super) mask: Vec<u8>,
    /// The rough pose in `image`, which the camera's prediction is compared with.
    pub(super) pose: Pose,
    /// The rough pose in `target`, which the prediction is drawn with.
    pub(super) view: Pose,
    /// The true pose in `image`; the rough one where nothing better is known.
    pub(super) true_pose: Pose,
}

/// The camera of a square of its picture, resized to `side`.
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

/// A square of a picture as `[side, side, C]`: means of bilinear samples, black beyond the border.
fn cut(picture: &ByteImage, [left, top, square]: [f64; 3], side: usize) -> Vec<u8> {
    let step = square / side as f64;
    // As many samples a pixel and axis as there are pixels under it, up to four.
    let samples = (step.ceil() as usize).clamp(1, 4);
    let offsets: Vec<f64> = (0..samples).map(|i| (i as f64 + 0.5) / samples as f64).collect();
    let c = picture.channels;
    let mut out = Vec::with_capacity(side * side * c);
    let mut sum = vec![0.0; c];
    for (i, j) in (0..side).flat_map(|i| (0..side).map(move |j| (i, j))) {
        sum.fill(0.0);
        for (v, u) in offsets.iter().flat_map(|v| offsets.iter().map(move |u| (v, u))) {
            let (x, y) = (left + (j as f64 + u) * step - 0.5, top + (i as f64 + v) * step - 0.5);
            add_sample(picture, [x, y], &mut sum);
        }
        let scale = 1.0 / (samples * samples) as f64;
        out.extend(sum.iter().map(|s| (s * scale + 0.5) as u8));
    }
    out
}

/// Adds a bilinear sample at pixel centres' coordinates.
fn add_sample(picture: &ByteImage, [x, y]: [f64; 2], sum: &mut [f64]) {
    let (left, top) = (x.floor(), y.floor());
    let (across, down) = (x - left, y - top);
    for (row, share) in [(top, 1.0 - down), (top + 1.0, down)] {
        for (column, weight) in [(left, 1.0 - across), (left + 1.0, across)] {
            let inside = row >= 0.0
                && column >= 0.0
                && row < picture.height as f64
                && column < picture.width as f64;
            if inside {
                let at = (row as usize * picture.width + column as usize) * picture.channels;
                let pixel = &picture.data[at..at + picture.channels];
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
