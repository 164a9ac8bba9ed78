//! Views that judge a mesh, and those among them that it was made of.

use datasets::View;
use mesh_core::Camera;
use mesh_core::nalgebra::Vector3;

/// What rounding in a file that was written by another program leaves of a pose: the turn in radians, and the place as a share of the
/// distances between cameras.
const SAME: f64 = 1e-4;
/// The same for numbers that were 32 bits long, as a share of the place's distance from the origin.
const ROUNDED: f64 = 4.0 * f32::EPSILON as f64;

/// Those of the views whose cameras stand elsewhere than all of `known`, or look elsewhere: what is scored where the mesh was made
/// to agree says nothing of other places. The lens is not looked at, since views that were averaged down or cropped have another.
/// Roundings are no other place, so that a dataset that was converted to another layout knows its views.
pub fn apart_from(views: Vec<View>, known: &[View]) -> Vec<View> {
    let centers: Vec<Vector3<f64>> = known.iter().map(|view| view.camera.center()).collect();
    let middle = centers.iter().sum::<Vector3<f64>>() / centers.len().max(1) as f64;
    let spread = centers.iter().map(|center| (center - middle).norm()).fold(0.0, f64::max);
    let is_same = |a: &Camera, b: &Camera, center: &Vector3<f64>| {
        // The norm is 2 sqrt(2) sin(angle / 2), which is sqrt(2) angle for small ones.
        let turned = (a.rotation - b.rotation).norm() / std::f64::consts::SQRT_2;
        let moved = (a.center() - center).norm();
        let apart = if spread > 0.0 { spread } else { center.norm() };
        turned <= SAME && moved <= SAME * apart + ROUNDED * center.norm()
    };
    let is_known = |view: &View| {
        let mut others = known.iter().zip(&centers);
        others.any(|(other, center)| is_same(&view.camera, &other.camera, center))
    };
    views.into_iter().filter(|view| !is_known(view)).collect()
}

#[cfg(test)]
mod tests {
    use mesh_core::ByteImage;
    use mesh_core::nalgebra::Rotation3;

    use super::*;

    fn view(azimuth: f64, side: usize) -> View {
        View {
            name: format!("{azimuth} {side}"),
            color: ByteImage::new(side, side, 3),
            mask: ByteImage::new(side, side, 1),
            camera: Camera::from_r2n2(azimuth, 30.0, 1.0, side, side),
            depth: None,
            crop: None,
        }
    }

    /// Six decimals, as many programs write them; in a world of any unit, anywhere.
    #[test]
    fn roundings_are_no_other_camera() {
        for (unit, aside) in [(1.0, 0.0), (1e-4, 0.0), (1.0, 50.0)] {
            let placed = |azimuth: f64| {
                let mut view = view(azimuth, 8);
                let moved = Vector3::new(aside, 0.0, -aside);
                let Camera { rotation, translation, .. } = &mut view.camera;
                *translation = unit * *translation - *rotation * moved;
                view
            };
            let known: Vec<View> = (0..6).map(|k| placed(10.0 * f64::from(k))).collect();
            let mut copies = known.clone();
            for Camera { rotation, translation, .. } in copies.iter_mut().map(|v| &mut v.camera) {
                *rotation = rotation.map(|v| (1e6 * v).round() / 1e6);
                *translation = translation.map(|v| f64::from(v as f32));
            }
            assert_eq!(apart_from(copies, &known).len(), 0, "{unit} {aside}");
            assert_eq!(apart_from(vec![placed(10.1)], &known).len(), 1, "{unit} {aside}");
            assert_eq!(apart_from(vec![placed(0.0)], &known[..1]).len(), 0);
            assert_eq!(apart_from(vec![placed(0.1)], &known[..1]).len(), 1);
        }
    }

    /// By whatever axis.
    #[test]
    fn turns_are_compared_by_their_angle() {
        for (angle, apart) in [(0.9 * SAME, 0), (1.1 * SAME, 1)] {
            let mut turned = view(0.0, 8);
            let turn = Rotation3::new(angle * Vector3::new(0.6, 0.0, 0.8)).into_inner();
            let Camera { rotation, translation, .. } = &mut turned.camera;
            (*rotation, *translation) = (turn * *rotation, turn * *translation);
            assert_eq!(apart_from(vec![turned], &[view(0.0, 8)]).len(), apart, "{angle}");
        }
    }

    #[test]
    fn a_camera_that_is_known_is_known_at_any_size() {
        let known = [view(0.0, 8), view(10.0, 8)];
        let left = apart_from(vec![view(10.0, 4), view(20.0, 8)], &known);
        assert_eq!(left.iter().map(|view| view.name.as_str()).collect::<Vec<_>>(), ["20 8"]);
    }
}
