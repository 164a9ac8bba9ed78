//! One image as a network takes it, and the frame of its camera.

use datasets::View;
use mesh_core::nalgebra::{Matrix3, Vector3};
use mesh_core::{ByteImage, Camera, DepthMap, TriMesh};
use train::DataError;

use crate::view_cache::Stored;

/// An image of `[S, S, 3]`, white outside of the object, with what its camera says.
#[derive(Clone, Debug)]
pub struct Picture {
    /// What it is called in messages.
    pub name: String,
    /// `[S, S, 3]`, sRGB.
    pub image: Vec<u8>,
    /// `[S, S]`, the share of the object in each pixel.
    pub mask: Vec<u8>,
    /// Planar depth `[S, S]` in the world's unit, `+∞` where nothing is seen; where the view has depth.
    pub depth: Option<Vec<f32>>,
    /// From the camera's frame to the image plane, `[3, 4]` in a row: normalised device coordinates, y up, then depth.
    pub lens: [f32; 12],
    /// Where the camera stands, with the size of the image.
    pub camera: Camera,
    /// The camera's frame.
    pub frame: Frame,
}

/// The frame of a camera: from the world by a rotation, a translation and a factor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    rotation: Matrix3<f64>,
    translation: Vector3<f64>,
    scale: f64,
}

impl Frame {
    /// That of a camera, lengths multiplied by `scale`.
    pub fn of(camera: &Camera, scale: f64) -> Self {
        Self { rotation: camera.rotation, translation: camera.translation, scale }
    }

    /// What lengths are multiplied by.
    pub fn scale(&self) -> f64 {
        self.scale
    }

    /// A point of the world.
    pub fn place(&self, p: [f32; 3]) -> [f32; 3] {
        let p = self.rotation * Vector3::from(p.map(f64::from)) + self.translation;
        (p * self.scale).map(|x| x as f32).into()
    }

    /// A direction of the world.
    pub fn turn(&self, n: [f32; 3]) -> [f32; 3] {
        (self.rotation * Vector3::from(n.map(f64::from))).map(|x| x as f32).into()
    }

    /// A point of the frame in the world.
    pub fn world(&self, p: [f32; 3]) -> [f32; 3] {
        let p = Vector3::from(p.map(f64::from)) / self.scale - self.translation;
        (self.rotation.transpose() * p).map(|x| x as f32).into()
    }

    /// A mesh of the world in the frame.
    #[must_use]
    pub fn mesh_placed(&self, mesh: &TriMesh) -> TriMesh {
        mesh.clone().map_positions(|p| self.place(p))
    }

    /// A mesh of the frame in the world.
    #[must_use]
    pub fn mesh_in_world(&self, mut mesh: TriMesh) -> TriMesh {
        mesh.positions.iter_mut().for_each(|p| *p = self.world(*p));
        mesh
    }
}

impl Picture {
    /// Resizes a view to `side` pixels; one that is not square is squeezed, and its lens with it.
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
        let (rotation, translation) = (Matrix3::identity(), Vector3::zeros());
        let here = Camera { rotation, translation, ..camera.clone() };
        let rows = here.projection();
        Ok(Self {
            name: view.name.clone(),
            image: on_white(view).resized(side, side).data,
            mask: mask.data,
            depth: view.depth.as_ref().map(|depth| nearest(depth, side)),
            lens: std::array::from_fn(|k| rows[k / 4][k % 4] as f32),
            frame: Frame::of(&camera, scale),
            camera,
        })
    }
}

/// The nearest pixels: means over an edge lie in the air.
fn nearest(depth: &DepthMap, side: usize) -> Vec<f32> {
    let at = |k: usize, length: usize| (2 * k + 1) * length / (2 * side);
    let pixel = |k: usize| {
        let (row, column) = (at(k / side, depth.height), at(k % side, depth.width));
        depth.data[row * depth.width + column]
    };
    (0..side * side).map(pixel).collect()
}

/// Colours with white outside of the mask, as Pixel2Mesh composites them.
fn on_white(view: &View) -> ByteImage {
    let mut color = view.color.clone();
    for (pixel, &m) in color.data.chunks_exact_mut(3).zip(&view.mask.data) {
        if m == 0 {
            pixel.fill(255);
        }
    }
    color
}

impl Stored for Picture {
    fn bytes(&self) -> usize {
        self.image.len() + self.mask.len() + 4 * self.depth.as_ref().map_or(0, Vec::len)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    fn view() -> View {
        let camera = Camera::from_r2n2(40.0, 27.0, 0.8, 40, 30);
        let mut mask = ByteImage { height: 30, width: 40, channels: 1, data: vec![0; 1200] };
        mask.data[15 * 40 + 20] = 255;
        let color = ByteImage { height: 30, width: 40, channels: 3, data: vec![9; 3600] };
        View { name: "7".into(), color, mask, camera, depth: None::<DepthMap> }
    }

    /// A point goes the same way through the world's camera and through the frame and its lens.
    #[test]
    fn frame_and_lens_are_the_camera() {
        let view = view();
        let picture = Picture::new(&view, 32, 0.57).unwrap();
        let point = [0.1_f32, -0.2, 0.15];
        let seen = view.camera.project(point.map(f64::from));
        let p = picture.frame.place(point);
        let row = |k: usize| -> f64 {
            let m = &picture.lens[4 * k..4 * k + 4];
            (0..3).map(|j| f64::from(m[j]) * f64::from(p[j])).sum::<f64>() + f64::from(m[3])
        };
        let (x, y, depth) = (row(0) / row(2), row(1) / row(2), row(2));
        assert!((x - (2.0 * seen.column / 40.0 - 1.0)).abs() < 1e-5);
        assert!((y - (1.0 - 2.0 * seen.row / 30.0)).abs() < 1e-5);
        assert!((depth - 0.57 * seen.depth).abs() < 1e-5 && p[2] < 0.0);
        let back = picture.frame.world(p);
        (0..3).for_each(|k| assert!((back[k] - point[k]).abs() < 1e-5));
        let n = picture.frame.turn([0.0, 1.0, 0.0]);
        assert!((n.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn depth_keeps_its_edges() {
        let mut view = view();
        let data = (0..1200).map(|k| if k % 40 < 20 { 1.5 } else { f32::INFINITY }).collect();
        view.depth = Some(DepthMap { height: 30, width: 40, data });
        let depth = Picture::new(&view, 32, 0.57).unwrap().depth.unwrap();
        assert_eq!((depth[15], depth[16]), (1.5, f32::INFINITY));
        let frame = Frame::of(&view.camera, 0.5);
        let mesh = mesh_core::primitives::cuboid([0.2; 3]);
        let there = frame.mesh_placed(&mesh);
        let back = frame.mesh_in_world(there.clone());
        assert!((there.volume() - 0.125 * mesh.volume()).abs() < 1e-7 && frame.scale() == 0.5);
        let pairs = back.positions.as_flattened().iter().zip(mesh.positions.as_flattened());
        assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-6));
    }

    #[test]
    fn it_is_white_around_the_object() {
        let picture = Picture::new(&view(), 40, 1.0).unwrap();
        assert_eq!(&picture.image[..3], &[255; 3]);
        assert!(picture.image.iter().any(|&x| x < 128), "the object is dark");
    }
}
