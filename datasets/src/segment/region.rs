//! Where in the world the object may be.

use mesh_core::nalgebra::Vector3;
use mesh_core::{Camera, Ray, bounds};

/// How many in a hundred cameras may show less of the ball than all of it.
const CUT: usize = 20;

/// A rough body that holds the object: a box along the world's axes, or the ellipsoid in it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Region {
    /// Its middle.
    pub center: [f64; 3],
    /// Half of its lengths, above 0.
    pub half: [f64; 3],
    /// Whether it is the ellipsoid.
    pub round: bool,
}

impl Region {
    /// The box between two corners.
    pub fn cuboid(low: [f64; 3], high: [f64; 3]) -> Self {
        let center = bounds::center((low, high));
        let half = std::array::from_fn(|k| 0.5 * (high[k] - low[k]));
        Self { center, half, round: false }
    }

    /// The ball around the point that all cameras look at, as large as the images show it whole; one in five may cut it.
    ///
    /// `None` where no point is fixed: a single camera, parallel ones, or one that most have behind them.
    pub fn in_sight(cameras: &[&Camera]) -> Option<Self> {
        let axes = cameras
            .iter()
            .map(|camera| camera.ray(camera.width as f64 / 2.0, camera.height as f64 / 2.0));
        let center = Ray::nearest_point(axes)?;
        let mut radii: Vec<f64> =
            cameras.iter().filter_map(|camera| room(camera, center)).collect();
        if 2 * radii.len() <= cameras.len() {
            return None;
        }
        radii.sort_by(f64::total_cmp);
        let radius = radii[(radii.len() - 1) * CUT / 100];
        (radius.is_finite() && radius > 0.0).then_some(Self {
            center,
            half: [radius; 3],
            round: true,
        })
    }

    /// The ball around the point where the masks' middles meet, as wide as the widest of them.
    pub(super) fn around_masks(seen: &[(&Camera, [usize; 4])]) -> Option<Self> {
        let middle = |[top, left, height, width]: [usize; 4]| {
            [left as f64 + 0.5 * width as f64, top as f64 + 0.5 * height as f64]
        };
        let axes = seen.iter().map(|(camera, bounds)| {
            let [column, row] = middle(*bounds);
            camera.ray(column, row)
        });
        let center = Ray::nearest_point(axes)?;
        let mut radii = Vec::new();
        for (camera, bounds) in seen {
            if camera.is_perspective() && camera.project(center).depth <= 0.0 {
                continue;
            }
            let [column, row] = middle(*bounds);
            let reach = 0.5 * (bounds[2] as f64).hypot(bounds[3] as f64);
            let depth = camera.project(center).depth;
            let ends = [column, column + reach]
                .map(|column| Vector3::from(camera.unproject(column, row, depth)));
            radii.push((ends[1] - ends[0]).norm());
        }
        if 2 * radii.len() <= seen.len() {
            return None;
        }
        radii.sort_by(f64::total_cmp);
        let radius = 1.15 * radii[(radii.len() - 1) * 9 / 10];
        (radius.is_finite() && radius > 0.0).then_some(Self {
            center,
            half: [radius; 3],
            round: true,
        })
    }

    /// Whether it holds a point.
    pub(super) fn holds(&self, p: [f64; 3]) -> bool {
        let (mut square, mut within) = (0.0, true);
        for k in 0..3 {
            let x = (p[k] - self.center[k]) / self.half[k];
            square += x * x;
            within &= x.abs() <= 1.0;
        }
        if self.round { square <= 1.0 } else { within }
    }
}

/// The radius of the largest ball around a point that an image shows whole; nothing where the point is not in it.
fn room(camera: &Camera, center: [f64; 3]) -> Option<f64> {
    let seen = camera.project(center);
    let (width, height) = (camera.width as f64, camera.height as f64);
    let inside = (0.0..width).contains(&seen.column) && (0.0..height).contains(&seen.row);
    if !inside || camera.is_perspective() && seen.depth <= 0.0 {
        return None;
    }
    let edges = [[0.0, seen.row], [width, seen.row], [seen.column, 0.0], [seen.column, height]];
    let away = edges.map(|[column, row]| camera.ray(column, row).distance(center));
    Some(away.into_iter().fold(f64::INFINITY, f64::min))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    fn ring(count: usize) -> Vec<Camera> {
        (0..count)
            .map(|i| {
                let (sin, cos) = (i as f64 * std::f64::consts::TAU / count as f64).sin_cos();
                let eye = [1.0 + 4.0 * sin, 3.0, 4.0 * cos];
                Camera::look_at(eye, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 0.6, 64, 48)
            })
            .collect()
    }

    #[test]
    fn the_ball_fills_the_frame() {
        let cameras = ring(8);
        let ball = Region::in_sight(&cameras.iter().collect::<Vec<_>>()).unwrap();
        assert!((0..3).all(|k| (ball.center[k] - [1.0, 0.0, 0.0][k]).abs() < 1e-9));
        // Half of the vertical angle, five away.
        assert!((ball.half[0] - 5.0 * 0.3_f64.sin()).abs() < 1e-6, "{ball:?}");
        assert!(ball.holds([1.0, 1.4, 0.0]) && !ball.holds([2.2, 1.2, 0.0]));
        assert_eq!(Region::in_sight(&[&cameras[0], &cameras[0]]), None);
        let cuboid = Region::cuboid([0.0; 3], [2.0, 4.0, 6.0]);
        assert!(cuboid.holds([1.9, 3.9, 0.1]) && !cuboid.holds([2.1, 1.0, 1.0]));
    }

    #[test]
    fn masks_say_how_large_it_is() {
        let cameras = ring(6);
        let seen: Vec<(&Camera, [usize; 4])> =
            cameras.iter().map(|c| (c, [18, 26, 12, 12])).collect();
        let ball = Region::around_masks(&seen).unwrap();
        // A box of 12 pixels, as wide as its diagonal.
        let pixel = 5.0 * 2.0 * 0.3_f64.tan() / 48.0;
        let wanted = 1.15 * 6.0 * 2.0_f64.sqrt() * pixel;
        assert!((ball.half[0] - wanted).abs() < 1e-6, "{ball:?}, {wanted}");
    }
}
