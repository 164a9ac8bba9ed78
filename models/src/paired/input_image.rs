//! One image as a network takes it, and what its camera says.

use datasets::View;
use mesh_core::{ByteImage, Camera};
use train::DataError;

use super::frame::{Frame, FrameKind};
use crate::view_cache::Stored;

/// An image of `[S, S, 3]`, white outside of the object, with what its camera says.
#[derive(Clone, Debug)]
pub struct InputImage {
    /// What it is called in messages.
    pub name: String,
    /// `[S, S, 3]`, sRGB.
    pub pixels: Vec<u8>,
    /// `[S, S]`, the share of the object in each pixel.
    pub mask: Vec<u8>,
    /// Planar depth `[S, S]` in the world's unit, `+∞` where nothing is seen; where the view has depth.
    pub depth: Option<Vec<f32>>,
    /// From the frame to the image plane, `[3, 4]` in a row: normalised device coordinates, y up, then depth.
    pub lens: [f32; 12],
    /// Where the camera stands, with the size of the image.
    pub camera: Camera,
    /// Where truth and prediction live: the camera's frame, unless another was [asked for](Self::with_frame).
    pub frame: Frame,
}

impl InputImage {
    /// Resizes a view to `side` pixels; one that is not square is squeezed, and its lens with it. In the camera's frame.
    ///
    /// # Errors
    /// If the camera is orthographic.
    pub fn new(view: &View, side: usize, scale: f64) -> Result<Self, DataError> {
        if !view.camera.is_perspective() {
            let text =
                format!("view {}: its camera is orthographic, expected a pinhole", view.name);
            return Err(DataError::Unfit(text));
        }
        let mask = view.mask.resized(side, side);
        let camera = view.camera.resized(side, side);
        Ok(Self {
            name: view.name.clone(),
            pixels: view.over([255; 3]).resized(side, side).data,
            mask: mask.data,
            depth: view.depth.as_ref().map(|depth| depth.resized(side, side).data),
            lens: FrameKind::Camera.lens(&camera, scale),
            frame: Frame::of(&camera, scale),
            camera,
        })
    }

    /// The image with its mask and its camera.
    pub fn view(&self) -> View {
        let bytes = |channels: usize, data: &[u8]| ByteImage {
            height: self.camera.height,
            width: self.camera.width,
            channels,
            data: data.to_vec(),
        };
        let (color, mask) = (bytes(3, &self.pixels), bytes(1, &self.mask));
        View {
            name: self.name.clone(),
            color,
            mask,
            camera: self.camera.clone(),
            depth: None,
            crop: None,
        }
    }

    /// The same in the object's frame, seen by another camera of the same size.
    #[must_use]
    pub fn seen_by(&self, camera: Camera) -> Self {
        Self { camera, ..self.clone() }.with_frame(FrameKind::Object)
    }

    /// The same in another frame.
    #[must_use]
    pub fn with_frame(self, kind: FrameKind) -> Self {
        let scale = self.frame.scale();
        let (lens, frame) = (kind.lens(&self.camera, scale), kind.of(&self.camera, scale));
        Self { lens, frame, ..self }
    }
}

impl Stored for InputImage {
    fn bytes(&self) -> usize {
        self.pixels.len() + self.mask.len() + 4 * self.depth.as_ref().map_or(0, Vec::len)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::DepthMap;

    use super::*;

    fn view() -> View {
        let camera = Camera::from_r2n2(40.0, 27.0, 0.8, 40, 30);
        let mut mask = ByteImage { height: 30, width: 40, channels: 1, data: vec![0; 1200] };
        mask.data[15 * 40 + 20] = 255;
        let color = ByteImage { height: 30, width: 40, channels: 3, data: vec![9; 3600] };
        View { name: "7".into(), color, mask, camera, depth: None, crop: None }
    }

    #[test]
    fn depth_keeps_its_edges() {
        let mut view = view();
        let data = (0..1200).map(|k| if k % 40 < 20 { 1.5 } else { f32::INFINITY }).collect();
        view.depth = Some(DepthMap { height: 30, width: 40, data });
        let depth = InputImage::new(&view, 32, 0.57).unwrap().depth.unwrap();
        assert_eq!((depth[15], depth[16]), (1.5, f32::INFINITY));
    }

    /// The lens is that of the resized camera, whose image is no longer 4 to 3.
    #[test]
    fn a_frame_is_asked_for() {
        let camera = InputImage::new(&view(), 32, 0.57).unwrap();
        let object = camera.clone().with_frame(FrameKind::Object);
        assert_eq!(
            (camera.frame, object.frame),
            (Frame::of(&view().camera, 0.57), Frame::object(0.57))
        );
        assert_eq!(object.lens, FrameKind::Object.lens(&view().camera.resized(32, 32), 0.57));
        let back = object.with_frame(FrameKind::Camera);
        assert_eq!((back.lens, back.frame), (camera.lens, camera.frame));
    }

    #[test]
    fn it_is_white_around_the_object() {
        let image = InputImage::new(&view(), 40, 1.0).unwrap();
        assert_eq!(&image.pixels[..3], &[255; 3]);
        assert!(image.pixels.iter().any(|&x| x < 128), "the object is dark");
    }
}
