//! Views that look along one line from both of its ends: their axes do not fix a point, but their cones do.

use mesh_core::{Camera, Ray};

/// How far from the line axes may be turned: the cosine of 15 degrees.
const ALONG: f64 = 0.966;

/// What a view with perspective sees of an object: a ray through its middle, and how wide that is at a distance of 1.
#[derive(Clone, Copy, Debug)]
struct Cone {
    axis: Ray,
    spread: f64,
}

impl Cone {
    /// Of the box of a mask: left, top, right, bottom. `None` where rays are parallel: they say nothing of distances.
    fn of(camera: &Camera, [left, top, right, bottom]: [f64; 4]) -> Option<Self> {
        let axis = camera.ray(left.midpoint(right), top.midpoint(bottom));
        let rim = [[left, top], [left, bottom], [right, top], [right, bottom]];
        let rim = rim.map(|[column, row]| camera.ray(column, row));
        camera.is_perspective().then(|| Self::around(axis, rim))
    }

    /// The cone around a ray that reaches to others from the same place.
    fn around(axis: Ray, rim: impl IntoIterator<Item = Ray>) -> Self {
        let spread = |ray: Ray| {
            let cosine: f64 = (0..3).map(|k| ray.direction[k] * axis.direction[k]).sum();
            (1.0 / (cosine * cosine) - 1.0).max(0.0).sqrt()
        };
        Self { axis, spread: rim.into_iter().map(spread).fold(0.0, f64::max) }
    }

    /// How far along the axis a point is.
    fn along(&self, point: [f64; 3]) -> f64 {
        let Ray { origin, direction, .. } = self.axis;
        (0..3).map(|k| (point[k] - origin[k]) * direction[k]).sum()
    }
}

/// The point nearest to all axes, or, of views along one line from both of its ends, where their cones are equally wide. Each box is
/// that of a mask, as in [`Cone::of`].
pub(crate) fn center_of_masks<'a>(
    axes: impl IntoIterator<Item = Ray>,
    boxes: impl IntoIterator<Item = (&'a Camera, [f64; 4])>,
) -> Option<[f64; 3]> {
    let seen: Option<Vec<Cone>> =
        boxes.into_iter().map(|(camera, bounds)| Cone::of(camera, bounds)).collect();
    seen.and_then(|seen| middle_between(&seen)).or_else(|| Ray::nearest_point(axes))
}

/// Where the cones from either end are equally wide in the mean; `None` unless all look along one line, from both of its ends.
///
/// The nearest point of nearly parallel axes is off by the many times by which each of them misses the object's middle.
fn middle_between(views: &[Cone]) -> Option<[f64; 3]> {
    let line = views.first()?.axis.direction;
    let turned = |cone: &Cone| (0..3).map(|k| cone.axis.direction[k] * line[k]).sum::<f64>();
    if views.iter().any(|cone| turned(cone).abs() < ALONG) {
        return None;
    }
    let count = views.len() as f64;
    let start: [f64; 3] =
        std::array::from_fn(|k| views.iter().map(|cone| cone.axis.origin[k]).sum::<f64>() / count);
    // Widths there and how they grow along the line, each the mean of one end's.
    let of_end = |sign: f64| {
        let end = views.iter().filter(|cone| sign * turned(cone) > 0.0);
        let sums = end.fold([0.0; 3], |[n, width, growth], cone| {
            let along = cone.spread * cone.along(start);
            [n + 1.0, width + along, growth + cone.spread * turned(cone)]
        });
        (sums[0] > 0.0).then(|| [sums[1] / sums[0], sums[2] / sums[0]])
    };
    let ([near, opens], [far, closes]) = (of_end(1.0)?, of_end(-1.0)?);
    let t = (far - near) / (opens - closes);
    let on_line: [f64; 3] = std::array::from_fn(|k| start[k] + t * line[k]);
    let seen =
        |cone: &Cone, k: usize| cone.axis.origin[k] + cone.along(on_line) * cone.axis.direction[k];
    let middle =
        std::array::from_fn(|k| views.iter().map(|cone| seen(cone, k)).sum::<f64>() / count);
    middle.iter().all(|x: &f64| x.is_finite()).then_some(middle)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    /// A ball of radius 0.2 around (0.1, 0.2, 0), seen from places.
    fn looking_from(eyes: &[[f64; 3]]) -> Vec<Cone> {
        let cone = |&eye: &[f64; 3]| {
            let camera = Camera::look_at(eye, [0.1, 0.2, 0.0], [0.0, 1.0, 0.0], 0.8, 64, 64);
            let distance = (eye[0] - 0.1).hypot(eye[1] - 0.2).hypot(eye[2]);
            let wide = 0.2 / distance * camera.lens.numbers()[0];
            Cone::around(camera.ray(32.0, 32.0), [camera.ray(32.0 + wide, 32.0)])
        };
        eyes.iter().map(cone).collect()
    }

    #[test]
    fn the_middle_is_where_both_ends_see_it_equally_wide() {
        for eyes in [
            &[[0.1, 0.2, 3.0], [0.1, 0.2, -5.0]][..],
            &[[0.1, 0.2, 3.0], [0.2, 0.1, -5.0]],
            &[[0.1, 0.2, 3.0], [0.3, 0.2, 4.0], [0.2, 0.1, -5.0]],
        ] {
            let found = middle_between(&looking_from(eyes)).unwrap();
            let off = (found[0] - 0.1).hypot(found[1] - 0.2).hypot(found[2]);
            assert!(off < 0.01, "{found:?}");
        }
    }

    #[test]
    fn views_from_one_end_or_from_around_have_none() {
        for eyes in [
            &[][..],
            &[[0.1, 0.2, 3.0]],
            &[[0.1, 0.2, 3.0], [0.2, 0.2, 4.0]],
            &[[0.1, 0.2, 3.0], [0.1, 0.2, -5.0], [4.0, 0.2, 0.0]],
        ] {
            assert_eq!(middle_between(&looking_from(eyes)), None);
        }
    }
}
