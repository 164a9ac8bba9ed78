//! Views of an object as its mirror image would show it.

use datasets::View;
use mesh_core::nalgebra::{Matrix3, Vector3};
use mesh_core::{ByteImage, Camera, DepthMap};

/// Cosine of the largest angle to a plane of coordinates, and the largest distance from it in radii, of one that may be it.
const NEARLY: f64 = 0.997;
const BESIDE: f64 = 0.05;

/// A plane: all points whose product with the normal is the offset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mirror {
    /// Of length one.
    pub(super) normal: Vector3<f64>,
    pub(super) offset: f64,
}

impl Mirror {
    /// The view, left and right changed, from a camera on the other side: what the view would be, were the object its own mirror image.
    pub(super) fn view(&self, view: &View) -> View {
        let flipped = |image: &ByteImage| ByteImage {
            data: flipped(&image.data, image.width, image.channels),
            ..*image
        };
        View {
            crop: None,
            name: view.name.clone(),
            color: flipped(&view.color),
            mask: flipped(&view.mask),
            camera: self.camera(&view.camera),
            depth: view.depth.as_ref().map(|depth| DepthMap {
                data: self::flipped(&depth.data, depth.width, 1),
                ..*depth
            }),
        }
    }

    /// The plane of two axes that this one nearly is: objects that were learned in one frame are mostly placed so in it.
    pub(super) fn of_coordinates(&self, radius: f64) -> Option<Self> {
        let axis = self.normal.iamax();
        let sign = self.normal[axis].signum();
        let near = self.normal[axis].abs() > NEARLY && self.offset.abs() < BESIDE * radius;
        near.then(|| Self { normal: sign * Vector3::ith(axis, 1.0), offset: 0.0 })
    }

    /// Where a point is seen in the mirror.
    pub(super) fn point(&self, p: Vector3<f64>) -> Vector3<f64> {
        p - 2.0 * (self.normal.dot(&p) - self.offset) * self.normal
    }

    /// A camera that sees a mirrored point where `camera` sees the point, left and right changed.
    fn camera(&self, camera: &Camera) -> Camera {
        // A point p is mirrored to H p + 2 d n, and the camera's x axis is turned.
        let turned = Matrix3::from_diagonal(&Vector3::new(-1.0, 1.0, 1.0));
        let householder = Matrix3::identity() - 2.0 * self.normal * self.normal.transpose();
        let shift = 2.0 * self.offset * self.normal;
        let [sx, sy, cx, cy] = camera.lens.numbers();
        Camera {
            rotation: turned * camera.rotation * householder,
            translation: turned * (camera.rotation * shift + camera.translation),
            lens: camera.lens.with([sx, sy, camera.width as f64 - cx, cy]),
            ..*camera
        }
    }
}

/// Each row from its end to its beginning.
fn flipped<T: Copy>(data: &[T], width: usize, channels: usize) -> Vec<T> {
    let rows = data.chunks_exact(width * channels);
    rows.flat_map(|row| row.chunks_exact(channels).rev().flatten().copied()).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::{Lens, TriMesh, primitives};
    use synth::{RenderOptions, render_views};

    use super::*;

    /// Its mirror image, drawn from the mirrored camera, is the view with left and right changed: seen at a slant, off the middle, by a
    /// lens whose axes differ.
    #[test]
    fn a_mirrored_view_is_one_of_the_mirrored_object() {
        let mut object = primitives::cuboid([1.0, 0.3, 0.5]).colored([0.8, 0.2, 0.1]);
        object.append(&primitives::icosphere(3).scaled([0.3; 3]).colored([0.1, 0.4, 0.9])).unwrap();
        let object = object.translated([0.2, 0.1, 0.0]);
        let mut camera =
            Camera::look_at([1.5, 1.0, 2.5], [0.1, 0.0, 0.0], [0.1, 1.0, 0.0], 0.7, 90, 70);
        camera.lens = Lens::Perspective { fx: 100.0, fy: 90.0, cx: 40.0, cy: 37.0 };
        let normal = Vector3::new(0.8, 0.1, -0.3).normalize();
        let mirror = Mirror { normal, offset: 0.15 };
        let reflected = object.clone().map_positions(|p| {
            let p = mirror.point(Vector3::from(p.map(f64::from)));
            [p[0] as f32, p[1] as f32, p[2] as f32]
        });
        let reflected = TriMesh {
            faces: reflected.faces.iter().map(|&[a, b, c]| [a, c, b]).collect(),
            ..reflected
        };
        let drawn = |object: &TriMesh, camera: &Camera| {
            let cameras = [camera.clone()];
            render_views(object, &cameras, &RenderOptions::default(), &|_, _| {}).unwrap().remove(0)
        };
        let expected = mirror.view(&drawn(&object, &camera));
        expected.camera.validate().unwrap();
        let found = drawn(&reflected, &expected.camera);
        let masks = found.mask.data.iter().zip(&expected.mask.data);
        let differ = masks.filter(|(a, b)| a != b).count();
        assert!(expected.mask_pixels() > 500 && differ < 5, "{differ}");
        let inside = |k: usize| found.mask.data[k / 3] == 255 && expected.mask.data[k / 3] == 255;
        let pixels = found.color.data.iter().zip(&expected.color.data).enumerate();
        let wrong = pixels.filter(|&(k, (a, b))| inside(k) && a.abs_diff(*b) > 40).count();
        assert!(wrong < 30, "{wrong}");
    }

    #[test]
    fn planes_of_two_axes_are_taken_for_what_they_are() {
        let nearly = Mirror { normal: Vector3::new(-1.0, 0.02, 0.01).normalize(), offset: 0.01 };
        let exact = Mirror { normal: -Vector3::x(), offset: 0.0 };
        assert_eq!(nearly.of_coordinates(1.0), Some(exact));
        assert_eq!(nearly.of_coordinates(0.1), None);
        let aslant = Mirror { normal: Vector3::new(1.0, 0.2, 0.0).normalize(), offset: 0.0 };
        assert_eq!(aslant.of_coordinates(1.0), None);
    }
}
