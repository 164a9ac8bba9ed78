//! Views that judge a mesh, and those among them that it was made of.

use datasets::View;

/// Those of the views whose cameras stand elsewhere than all of `known`, or look elsewhere: what is scored where the mesh was made
/// to agree says nothing of other places. The lens is not looked at, since views that were averaged down or cropped have another.
pub fn apart_from(views: Vec<View>, known: &[View]) -> Vec<View> {
    let is_known = |view: &View| {
        known.iter().any(|other| {
            view.camera.rotation == other.camera.rotation
                && view.camera.translation == other.camera.translation
        })
    };
    views.into_iter().filter(|view| !is_known(view)).collect()
}

#[cfg(test)]
mod tests {
    use mesh_core::{ByteImage, Camera};

    use super::*;

    #[test]
    fn a_camera_that_is_known_is_known_at_any_size() {
        let view = |azimuth: f64, side: usize| View {
            name: format!("{azimuth} {side}"),
            color: ByteImage::new(side, side, 3),
            mask: ByteImage::new(side, side, 1),
            camera: Camera::from_r2n2(azimuth, 30.0, 1.0, side, side),
            depth: None,
            crop: None,
        };
        let known = [view(0.0, 8), view(10.0, 8)];
        let left = apart_from(vec![view(10.0, 4), view(20.0, 8)], &known);
        assert_eq!(left.iter().map(|view| view.name.as_str()).collect::<Vec<_>>(), ["20 8"]);
    }
}
