//! A ground plane beneath an object, where the image has none.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{ByteImage, DisparityMap};

/// Candidates looked at; more do not make the plane any better.
const MOST: usize = 4096;
/// Fewer tell nothing.
const LEAST: usize = 48;
/// Triples drawn. With half of the candidates on the plane all fail once in 10^14.
const DRAWS: usize = 240;
/// Pixels around the silhouette that are neither: estimates have soft edges.
const MARGIN: usize = 2;
/// The share of the candidates that must lie on the plane.
const SUPPORT: f64 = 0.6;
/// How far from the plane still counts, and how far the plane must at least rise over the height of the
/// object, both in terms of the disparities that object and surroundings span.
const TOLERANCE: f64 = 0.05;
const RISE: f64 = 0.12;
/// The share of the object that must stand in front of the plane, or on it.
const IN_FRONT: f64 = 0.9;

/// A plane on which the object of a disparity map seems to stand.
///
/// Estimators put a floor under an object that was rendered before an empty background. Through a pinhole the
/// disparity of a plane is linear in row and column, and it stays so under any scale and shift: the floor is
/// found without knowing either, nor the camera. (It is looked for here and not among the losses because it
/// needs no gradient, and those who clean estimates, in `datasets`, know no tape.)
///
/// ```
/// use mesh_core::{ByteImage, DisparityMap, GroundPlane};
///
/// // A square that stands upright, with nothing around it, and with a floor that comes nearer downwards.
/// let inside = |i: usize, j: usize| (8..24).contains(&i) && (8..24).contains(&j);
/// let map = |floor: fn(usize) -> f32| {
///     let mut map = DisparityMap { height: 32, width: 32, data: vec![0.0; 1024] };
///     let mut mask = ByteImage::new(32, 32, 1);
///     for (p, value) in map.data.iter_mut().enumerate() {
///         let (i, j) = (p / 32, p % 32);
///         *value = if inside(i, j) { 24.0 } else { floor(i) };
///         mask.data[p] = u8::from(inside(i, j)) * 255;
///     }
///     GroundPlane::find(&map, &mask)
/// };
/// assert_eq!(map(|_| 0.0), None);
/// let plane = map(|i| i as f32).unwrap();
/// assert!((plane.disparity(20, 3) - 20.0).abs() < 1e-3);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundPlane {
    /// What disparity gains per row.
    pub per_row: f64,
    /// What disparity gains per column.
    pub per_column: f64,
    /// The disparity at row 0, column 0.
    pub offset: f64,
    /// How far from the plane a disparity may be and still count as on it.
    pub tolerance: f64,
    /// The share of the pixels looked at that lie on the plane, 0.6 to 1.
    pub support: f64,
}

impl GroundPlane {
    /// Looks for the plane in the pixels outside the silhouette and no higher than its middle.
    ///
    /// `mask` has one channel, object above 127. A plane is reported if
    ///
    /// - at least 60 % of those pixels lie on it (the best of 240 drawn planes, then least squares over
    ///   those it holds),
    /// - it comes nearer towards the bottom of the image, as a floor does and neither a wall nor an empty
    ///   background,
    /// - and nine tenths of the object stand in front of it.
    ///
    /// Scaling the map by a positive number, or shifting it, changes nothing but the units. The draws are
    /// always the same.
    ///
    /// # Cost
    /// At most 4096 pixels are looked at, a million comparisons.
    /// # Panics
    /// If the mask is of another size or has more than one channel.
    pub fn find(disparity: &DisparityMap, mask: &ByteImage) -> Option<Self> {
        let (height, width) = (disparity.height, disparity.width);
        assert!(
            mask.channels == 1 && (mask.height, mask.width) == (height, width),
            "GroundPlane: a map of {height} x {width} and a mask of {} x {}, {} channels",
            mask.height,
            mask.width,
            mask.channels
        );
        let at = |p: usize| Sample::new(disparity, p);
        let object: Vec<Sample> =
            (0..mask.data.len()).filter(|&p| mask.data[p] > 127).filter_map(at).collect();
        let (top, bottom) = (object.first()?.row, object.last()?.row);
        let around: Vec<Sample> =
            outside(mask, (0.5 * (top + bottom)) as usize).into_iter().filter_map(at).collect();
        let around = thinned(&around);
        if around.len() < LEAST {
            return None;
        }
        let span = spread(object.iter().chain(&around).map(|s| s.value).collect());
        let plane = Self { tolerance: TOLERANCE * span, ..Self::drawn(&around, TOLERANCE * span)? };
        let plane = (0..3).fold(plane, |plane, _| plane.refined(&around));
        let support = share(&around, |s| plane.holds(s));
        // At least a few rows: of a flat object the height says nothing.
        let rise = plane.per_row * (bottom - top).max(0.25 * height as f64);
        let in_front = share(&object, |s| s.value >= plane.at(s) - plane.tolerance);
        let found = span > 0.0 && support >= SUPPORT && rise >= RISE * span && in_front >= IN_FRONT;
        found.then_some(Self { support, ..plane })
    }

    /// The disparity of the plane at the middle of a pixel.
    pub fn disparity(&self, row: usize, column: usize) -> f64 {
        self.offset + self.per_row * row as f64 + self.per_column * column as f64
    }

    /// The pixels that lie on the plane, wherever they are: 255 there, 0 elsewhere.
    ///
    /// Take them out of a mask that is too generous. Where the object touches the ground both are on it.
    pub fn pixels(&self, disparity: &DisparityMap) -> ByteImage {
        let mut mask = ByteImage::new(disparity.height, disparity.width, 1);
        for (p, out) in mask.data.iter_mut().enumerate() {
            let on = Sample::new(disparity, p).is_some_and(|sample| self.holds(&sample));
            *out = if on { 255 } else { 0 };
        }
        mask
    }

    /// The drawn plane that holds most samples.
    fn drawn(samples: &[Sample], tolerance: f64) -> Option<Self> {
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let mut best: Option<(usize, Self)> = None;
        for _ in 0..DRAWS {
            let three = std::array::from_fn(|_| samples[rng.random_range(0..samples.len())]);
            let Some(plane) = Self::through(three) else { continue };
            let plane = Self { tolerance, ..plane };
            let held = samples.iter().filter(|s| plane.holds(s)).count();
            if best.is_none_or(|(most, _)| held > most) {
                best = Some((held, plane));
            }
        }
        best.map(|(_, plane)| plane)
    }

    /// The plane through three samples; `None` if they are (nearly) in a row.
    fn through([a, b, c]: [Sample; 3]) -> Option<Self> {
        let (b_row, b_column, b) = (b.row - a.row, b.column - a.column, b.value - a.value);
        let (c_row, c_column, c) = (c.row - a.row, c.column - a.column, c.value - a.value);
        let area = b_row * c_column - b_column * c_row;
        let per_row = (b * c_column - c * b_column) / area;
        let per_column = (c * b_row - b * c_row) / area;
        let offset = a.value - per_row * a.row - per_column * a.column;
        let plane = Self { per_row, per_column, offset, tolerance: 0.0, support: 0.0 };
        (area.abs() >= 8.0).then_some(plane)
    }

    /// Least squares over the samples that the plane holds.
    fn refined(self, samples: &[Sample]) -> Self {
        let held = || samples.iter().filter(|s| self.holds(s));
        let count = held().count() as f64;
        let mean = |f: fn(&Sample) -> f64| held().map(f).sum::<f64>() / count;
        let (row, column, value) = (mean(|s| s.row), mean(|s| s.column), mean(|s| s.value));
        let (mut rr, mut rc, mut cc, mut rv, mut cv) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for s in held() {
            let (r, c, v) = (s.row - row, s.column - column, s.value - value);
            rr += r * r;
            rc += r * c;
            cc += c * c;
            rv += r * v;
            cv += c * v;
        }
        let det = rr * cc - rc * rc;
        // All in one line: the plane stays as it is.
        if det <= 1e-9 * rr * cc || count < 3.0 {
            return self;
        }
        let (per_row, per_column) = ((rv * cc - cv * rc) / det, (cv * rr - rv * rc) / det);
        let offset = value - per_row * row - per_column * column;
        Self { per_row, per_column, offset, ..self }
    }

    fn at(&self, sample: &Sample) -> f64 {
        self.offset + self.per_row * sample.row + self.per_column * sample.column
    }

    fn holds(&self, sample: &Sample) -> bool {
        (sample.value - self.at(sample)).abs() <= self.tolerance
    }
}

/// A pixel and its disparity.
#[derive(Clone, Copy)]
struct Sample {
    row: f64,
    column: f64,
    value: f64,
}

impl Sample {
    /// `None` where the map knows nothing.
    fn new(map: &DisparityMap, p: usize) -> Option<Self> {
        let value = f64::from(map.data[p]);
        let (row, column) = ((p / map.width) as f64, (p % map.width) as f64);
        value.is_finite().then_some(Self { row, column, value })
    }
}

/// The pixels from row `first` on that are further than the margin from the silhouette.
fn outside(mask: &ByteImage, first: usize) -> Vec<usize> {
    let (height, width) = (mask.height, mask.width);
    let near = |i: usize, j: usize| {
        let rows = i.saturating_sub(MARGIN)..(i + MARGIN + 1).min(height);
        let columns = j.saturating_sub(MARGIN)..(j + MARGIN + 1).min(width);
        rows.into_iter().any(|i| columns.clone().any(|j| mask.data[i * width + j] > 127))
    };
    let pixels = (first.min(height)..height).flat_map(|i| (0..width).map(move |j| (i, j)));
    pixels.filter(|&(i, j)| !near(i, j)).map(|(i, j)| i * width + j).collect()
}

/// At most [`MOST`] of the samples, evenly spread.
fn thinned(samples: &[Sample]) -> Vec<Sample> {
    let count = samples.len().min(MOST);
    (0..count).map(|k| samples[k * samples.len() / count]).collect()
}

/// What the middle three fifths of the values span: estimates have outliers, near edges most of all.
fn spread(mut values: Vec<f64>) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let at = |share: f64| values[((values.len() - 1) as f64 * share) as usize];
    at(0.8) - at(0.2)
}

fn share(samples: &[Sample], f: impl Fn(&Sample) -> bool) -> f64 {
    samples.iter().filter(|s| f(s)).count() as f64 / samples.len().max(1) as f64
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::Camera;

    const SIZE: usize = 64;
    const RADIUS: f64 = 0.5;

    /// What stands behind a ball.
    #[derive(Clone, Copy, Debug, PartialEq)]
    enum Behind {
        Nothing,
        /// A floor that touches the ball from beneath.
        Floor,
        /// A wall that faces the camera.
        Wall,
        /// A wall that runs away to the left.
        SideWall,
    }

    /// The disparity of a ball at the origin seen from above, and its silhouette.
    fn scene(behind: Behind, height: f64, noise: f64, seed: u64) -> (DisparityMap, ByteImage) {
        let camera =
            Camera::look_at([0.6, height, 2.2], [0.0; 3], [0.0, 1.0, 0.0], 0.8, SIZE, SIZE);
        let forward = camera.forward();
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut map = DisparityMap { height: SIZE, width: SIZE, data: vec![0.0; SIZE * SIZE] };
        let mut mask = ByteImage::new(SIZE, SIZE, 1);
        for p in 0..SIZE * SIZE {
            let ray = camera.ray((p % SIZE) as f64 + 0.5, (p / SIZE) as f64 + 0.5);
            let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
            let along = |t: f64| t * dot(ray.direction, [forward.x, forward.y, forward.z]);
            let (middle, size) = (dot(ray.origin, ray.direction), dot(ray.origin, ray.origin));
            let root = middle * middle - size + RADIUS * RADIUS;
            let plane = |normal: [f64; 3], at: f64| {
                let t = (at - dot(normal, ray.origin)) / dot(normal, ray.direction);
                if t > 0.0 { 1.0 / along(t) } else { 0.0 }
            };
            let value = if root >= 0.0 {
                mask.data[p] = 255;
                1.0 / along(-middle - root.sqrt())
            } else {
                match behind {
                    Behind::Nothing => 0.0,
                    Behind::Floor => plane([0.0, 1.0, 0.0], -RADIUS),
                    Behind::Wall => plane([forward.x, forward.y, forward.z], 1.0),
                    Behind::SideWall => plane([0.8, 0.0, 0.6], -1.0),
                }
            };
            map.data[p] = (value + noise * (rng.random::<f64>() - 0.5)) as f32;
        }
        (map, mask)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        /// A floor is found in any units, other things are not; what is found does not depend on the units.
        #[test]
        fn floors_and_nothing_else(height in 0.5f64..1.6, noise in 0.0f64..0.01, s in 0.01f32..100.0, t in -50.0f32..50.0, seed: u64) {
            for behind in [Behind::Nothing, Behind::Floor, Behind::Wall, Behind::SideWall] {
                let (map, mask) = scene(behind, height, noise, seed);
                let found = GroundPlane::find(&map, &mask);
                prop_assert_eq!(found.is_some(), behind == Behind::Floor, "{:?}: {:?}", behind, found);
                let mut other = map.clone();
                other.data.iter_mut().for_each(|v| *v = s * (*v + t));
                let moved = GroundPlane::find(&other, &mask);
                prop_assert_eq!(moved.is_some(), found.is_some());
                if let (Some(a), Some(b)) = (found, moved) {
                    let expected = f64::from(s) * (a.disparity(50, 9) + f64::from(t));
                    prop_assert!((b.disparity(50, 9) - expected).abs() < 0.01 * f64::from(s));
                }
            }
        }
    }

    #[test]
    fn the_floor_is_where_it_is_and_the_ball_is_not_on_it() {
        let (map, mask) = scene(Behind::Floor, 1.0, 0.0, 0);
        let plane = GroundPlane::find(&map, &mask).unwrap();
        for p in (0..SIZE * SIZE).filter(|&p| mask.data[p] == 0 && map.data[p] > 0.0) {
            let away = plane.disparity(p / SIZE, p % SIZE) - f64::from(map.data[p]);
            assert!(away.abs() < 1e-4);
        }
        // Every floor pixel is marked; of the ball only a patch around where it touches.
        let on = plane.pixels(&map);
        let marked = |inside: bool| {
            let own =
                (0..SIZE * SIZE).filter(|&p| (mask.data[p] > 127) == inside && map.data[p] > 0.0);
            let all = own.clone().count();
            own.filter(|&p| on.data[p] == 255).count() as f64 / all as f64
        };
        assert!(marked(false) > 0.999, "{}", marked(false));
        assert!(marked(true) < 0.15, "{}", marked(true));
    }

    #[test]
    fn a_third_of_the_surroundings_may_be_wrong() {
        let (mut map, mask) = scene(Behind::Floor, 1.0, 0.0, 0);
        let clean = GroundPlane::find(&map, &mask).unwrap();
        for p in (0..SIZE * SIZE).filter(|&p| mask.data[p] == 0 && p * 7919 % 100 < 33) {
            map.data[p] = [3.0, f32::INFINITY, -1.0][p % 3];
        }
        let spoilt = GroundPlane::find(&map, &mask).unwrap();
        assert!((spoilt.disparity(50, 9) - clean.disparity(50, 9)).abs() < 1e-3);
        assert!(spoilt.support < 0.9 && spoilt.support > 0.6, "{}", spoilt.support);
    }

    #[test]
    fn nothing_to_look_at() {
        let (map, mut mask) = scene(Behind::Floor, 1.0, 0.0, 0);
        mask.data.fill(0);
        assert_eq!(GroundPlane::find(&map, &mask), None);
        mask.data.fill(255);
        assert_eq!(GroundPlane::find(&map, &mask), None);
        let flat = DisparityMap { data: vec![1.0; SIZE * SIZE], ..map };
        let (_, mask) = scene(Behind::Floor, 1.0, 0.0, 0);
        assert_eq!(GroundPlane::find(&flat, &mask), None);
        let unknown = DisparityMap { data: vec![f32::INFINITY; SIZE * SIZE], ..flat };
        assert_eq!(GroundPlane::find(&unknown, &mask), None);
    }
}
