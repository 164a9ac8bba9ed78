//! Turntables: a mesh seen from all around, as an animated GIF.

use diff_raster::FacesError;
use gif::{Encoder, Frame, Repeat};
use mesh_core::bounds::{self, Bounds};
use mesh_core::vector::widen;
use mesh_core::{ByteImage, Camera, TriMesh};
use rayon::prelude::*;
use synth::{Lighting, RenderOptions, render_view, render_views};

/// Quality of the palette, 1 (best) to 30 (fastest); 10 is indistinguishable here at half the time of 5.
const PALETTE_SPEED: i32 = 10;

/// Frames of the turntable, a full turn.
const FRAMES: usize = 36;
/// Behind the turning mesh: light, so that dark objects stand out.
pub const BACKDROP: [f32; 3] = [0.93, 0.94, 0.96];
/// Side of an [`animation`], pixels.
const SIDE: usize = 256;

/// Cameras on a circle around the axis-aligned box, looking at its centre, +Y up.
///
/// `elevation` is in radians; the first camera stands at +Z and the circle goes counter-clockwise
/// seen from above. The whole bounding sphere is in view.
pub fn orbit(around: Bounds, count: usize, elevation: f64, size: usize) -> Vec<Camera> {
    const FOV: f64 = 0.6;
    let center = widen(bounds::center(around));
    let radius = 0.5 * bounds::diagonal::<f64>(around);
    let distance = 1.05 * radius.max(1e-9) / (0.5 * FOV).sin();
    (0..count)
        .map(|k| {
            let azimuth = std::f64::consts::TAU * k as f64 / count as f64;
            let toward =
                [elevation.cos() * azimuth.sin(), elevation.sin(), elevation.cos() * azimuth.cos()];
            let eye = std::array::from_fn(|k| center[k] + distance * toward[k]);
            Camera::look_at(eye, center, [0.0, 1.0, 0.0], FOV, size, size)
        })
        .collect()
}

/// The mesh turning once, as a GIF `side` pixels wide.
///
/// # Errors
/// If a face names a vertex that is not there.
pub fn turntable(mesh: &TriMesh, side: usize) -> Result<Vec<u8>, FacesError> {
    let Some(bounds) = mesh.bounds() else { return Ok(Vec::new()) };
    let lighting = Lighting::for_mesh(mesh);
    let options = RenderOptions { background: BACKDROP, lighting, ..RenderOptions::default() };
    let cameras = orbit(bounds, FRAMES, 0.35, side);
    let frames: Vec<ByteImage> = render_views(mesh, &cameras, &options, &|_, _| ())?
        .into_iter()
        .map(|view| view.color)
        .collect();
    Ok(encode_gif(&frames, 8))
}

/// Meshes one after another from one camera that sees all of them, as a GIF whose last frame stays for a while.
///
/// # Errors
/// If a face names a vertex that is not there.
pub fn animation(meshes: &[TriMesh]) -> Result<Vec<u8>, FacesError> {
    /// How often the last frame is shown.
    const STAYS: usize = 8;
    let union = |(a, b): ([f32; 3], [f32; 3]), (c, d): ([f32; 3], [f32; 3])| {
        (std::array::from_fn(|k| a[k].min(c[k])), std::array::from_fn(|k| b[k].max(d[k])))
    };
    let Some(bounds) = meshes.iter().filter_map(TriMesh::bounds).reduce(union) else {
        return Ok(Vec::new());
    };
    // What has no colours shows its shape by the light alone.
    let lighting = Lighting::shape();
    let options = RenderOptions { background: BACKDROP, lighting, ..RenderOptions::default() };
    // From the side and above: the second of eight around.
    let camera = orbit(bounds, 8, 0.35, SIDE).swap_remove(1);
    let mut frames = Vec::with_capacity(meshes.len() + STAYS);
    for mesh in meshes {
        frames.push(render_view(mesh, &camera, &options)?.color);
    }
    let last = frames.last().cloned();
    frames.extend(last.into_iter().flat_map(|frame| std::iter::repeat_n(frame, STAYS)));
    Ok(encode_gif(&frames, 8))
}

/// The frames as a GIF that loops, `delay` hundredths of a second each.
///
/// Frames are RGB of one size; each gets its own palette of 256 colours. No frames: no bytes.
///
/// # Panics
/// If a frame is not of three channels or not of the first frame's size.
pub fn encode_gif(frames: &[ByteImage], delay: u16) -> Vec<u8> {
    let Some(first) = frames.first() else { return Vec::new() };
    let (width, height) = (first.width as u16, first.height as u16);
    let encoded: Vec<Frame<'static>> = frames
        .par_iter()
        .map(|image| {
            assert_eq!((image.width, image.height, image.channels), (first.width, first.height, 3));
            let mut frame = Frame::from_rgb_speed(width, height, &image.data, PALETTE_SPEED);
            frame.delay = delay;
            frame.make_lzw_pre_encoded();
            frame
        })
        .collect();
    let mut encoder =
        Encoder::new(Vec::new(), width, height, &[]).expect("writing to memory cannot fail");
    encoder.set_repeat(Repeat::Infinite).expect("writing to memory cannot fail");
    for frame in &encoded {
        encoder.write_lzw_pre_encoded_frame(frame).expect("writing to memory cannot fail");
    }
    encoder.into_inner().expect("writing to memory cannot fail")
}

#[cfg(test)]
mod tests {
    use mesh_core::vector::affine;

    use super::*;

    #[test]
    fn a_gif_reads_back_with_its_frames() {
        let frames: Vec<ByteImage> = (0..3)
            .map(|k| ByteImage {
                height: 6,
                width: 9,
                channels: 3,
                data: (0..162).map(|i| ((i * 7 + k * 40) % 256) as u8).collect(),
            })
            .collect();
        let bytes = encode_gif(&frames, 8);
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut reader = options.read_info(bytes.as_slice()).expect("a GIF");
        let mut count = 0;
        while let Some(frame) = reader.read_next_frame().expect("a frame") {
            assert_eq!((frame.width, frame.height, frame.delay), (9, 6, 8));
            count += 1;
        }
        assert_eq!(count, 3);
    }

    #[test]
    fn the_orbit_keeps_the_box_in_view() {
        let bounds = ([-1.0, 0.0, -3.0], [2.0, 5.0, 1.0]);
        for camera in orbit(bounds, 7, 0.3, 64) {
            for corner in 0..8 {
                let p: [f64; 3] = std::array::from_fn(|k| {
                    f64::from(if corner >> k & 1 == 0 { bounds.0[k] } else { bounds.1[k] })
                });
                let [x, y, w] = affine(&camera.projection(), p);
                assert!(w > 0.0 && (x / w).abs() < 1.0 && (y / w).abs() < 1.0);
            }
        }
    }
}
