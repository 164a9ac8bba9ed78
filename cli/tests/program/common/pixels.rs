//! Images as they were delivered, and what is to be seen on them.

use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use mesh_core::{ByteImage, TriMesh};

/// How far a colour may be from what is behind the object, to be the object's.
const APART: i32 = 24;

/// How much brightness varies over what is lit, at least; over what is not it varies by the steps of a palette.
const SHADED: f64 = 3.0;

/// The frames of an animation.
pub(crate) fn frames(bytes: &[u8]) -> Vec<ByteImage> {
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let mut reader = options.read_info(bytes).expect("a GIF");
    let (width, height) = (usize::from(reader.width()), usize::from(reader.height()));
    let mut frames = Vec::new();
    while let Some(frame) = reader.read_next_frame().expect("a frame") {
        let whole = (frame.left, frame.top, frame.width.into(), frame.height.into());
        assert_eq!(whole, (0, 0, width, height));
        let data = frame.buffer.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
        frames.push(ByteImage { height, width, channels: 3, data });
    }
    frames
}

/// The frames of an animation in a file.
pub(crate) fn frames_in(path: &Path) -> Vec<ByteImage> {
    frames(&std::fs::read(path).unwrap())
}

/// An image in a file.
pub(crate) fn picture(path: &Path) -> ByteImage {
    mesh_core::read_image(path).unwrap()
}

/// What a page carries of this kind, `image/png` for example, in its order.
pub(crate) fn carried(page: &str, kind: &str) -> Vec<Vec<u8>> {
    let mark = format!("data:{kind};base64,");
    let part = |part: &str| BASE64.decode(part.split('"').next().unwrap()).unwrap();
    page.split(mark.as_str()).skip(1).map(part).collect()
}

/// The images that a page carries.
pub(crate) fn pictures_on(page: &str) -> Vec<ByteImage> {
    let carried = carried(page, "image/png");
    carried.iter().map(|png| mesh_core::decode_image(png, "page").unwrap()).collect()
}

/// The mesh of a page's viewer: how many vertices it has, and the mean of their colours, bytes.
pub(crate) fn scene(page: &str) -> (usize, Option<[f64; 3]>) {
    let text = page.split("id=\"scene\">").nth(1).unwrap().split("</script>").next().unwrap();
    let scene: serde_json::Value = serde_json::from_str(text).unwrap();
    let bytes = |name: &str| scene[name].as_str().map(|text| BASE64.decode(text).unwrap());
    let colors = bytes("colors").map(|bytes| mean(bytes.chunks_exact(3)));
    (bytes("positions").unwrap().len() / 12, colors)
}

/// The mean of pixels of three channels.
pub(crate) fn mean<'a>(pixels: impl Iterator<Item = &'a [u8]>) -> [f64; 3] {
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for pixel in pixels {
        (0..3).for_each(|k| sum[k] += f64::from(pixel[k]));
        count += 1.0;
    }
    sum.map(|sum| sum / f64::max(count, 1.0))
}

/// What is to be seen on an image before what is behind it. Colours are those within the object: at its rim both mix.
#[derive(Debug)]
pub(crate) struct Look {
    /// The share of pixels that are not of the background's colour.
    pub(crate) share: f64,
    /// The mean colour, bytes.
    pub(crate) mean: [f64; 3],
    /// How much the brightness varies: the deviation, bytes. A flat blob has none.
    pub(crate) spread: f64,
}

impl Look {
    /// Looks at an image of three channels before this colour.
    pub(crate) fn at(image: &ByteImage, background: [u8; 3]) -> Self {
        assert_eq!(image.channels, 3);
        let [height, width] = [image.height, image.width];
        let apart = |(&a, b): (&u8, u8)| (i32::from(a) - i32::from(b)).abs() > APART;
        let pixels: Vec<&[u8]> = image.data.chunks_exact(3).collect();
        let object: Vec<bool> =
            pixels.iter().map(|p| p.iter().zip(background).any(apart)).collect();
        let on = |i: usize, j: usize| i < height && j < width && object[i * width + j];
        let within = |&k: &usize| {
            let (i, j) = (k / width, k % width);
            (0..3).all(|a| (0..3).all(|b| on((i + a).wrapping_sub(1), (j + b).wrapping_sub(1))))
        };
        let inner: Vec<&[u8]> = (0..pixels.len()).filter(within).map(|k| pixels[k]).collect();
        let n = inner.len().max(1) as f64;
        let gray = |p: &&[u8]| p.iter().map(|&v| f64::from(v)).sum::<f64>() / 3.0;
        let (sum, squared) =
            inner.iter().map(gray).fold((0.0, 0.0), |(s, q), v| (s + v, q + v * v));
        Self {
            share: object.iter().filter(|o| **o).count() as f64 / pixels.len() as f64,
            mean: mean(inner.iter().copied()),
            spread: (squared / n - (sum / n).powi(2)).max(0.0).sqrt(),
        }
    }

    /// An object is there, neither a speck nor all there is, of this mean colour.
    #[track_caller]
    pub(crate) fn has(&self, color: [f64; 3], tolerance: f64) {
        assert!((0.03..0.97).contains(&self.share), "{self:?}");
        let near = self.mean.iter().zip(color).all(|(a, b)| (a - b).abs() <= tolerance);
        assert!(near, "{self:?}, expected {color:?}");
    }

    /// The same for an object of this colour: none of its channels is brighter than in full light.
    #[track_caller]
    pub(crate) fn is_shaded_in(&self, color: [f64; 3]) {
        assert!((0.03..0.97).contains(&self.share) && self.spread > SHADED, "{self:?}");
        let lit = self.mean.iter().zip(color).all(|(a, b)| (0.6 * b..1.15 * b).contains(a));
        assert!(lit, "{self:?}, expected {color:?} in some light");
    }

    /// Its shape is to be seen: light varies over it.
    #[track_caller]
    pub(crate) fn is_shaded(&self) {
        assert!((0.03..0.97).contains(&self.share) && self.spread > SHADED, "{self:?}");
        assert!(self.mean.iter().all(|v| *v > 60.0), "{self:?} is dark");
    }
}

/// The corner of an image.
pub(crate) fn corner(image: &ByteImage) -> [u8; 3] {
    [image.data[0], image.data[1], image.data[2]]
}

/// A part of an image.
pub(crate) fn part(
    image: &ByteImage,
    [top, left]: [usize; 2],
    [height, width]: [usize; 2],
) -> ByteImage {
    image.cropped(left, top, width, height)
}

/// The mean of a mesh's colours, bytes.
pub(crate) fn color_of(mesh: &TriMesh) -> [f64; 3] {
    let colors = mesh.colors.as_ref().expect("colours");
    let n = colors.len() as f64;
    std::array::from_fn(|k| colors.iter().map(|c| 255.0 * f64::from(c[k])).sum::<f64>() / n)
}
