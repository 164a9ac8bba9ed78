//! How real lenses bend rays away from a pinhole's, and back.

use super::CameraError;

/// The farthest off the axis that a pinhole image is made of, as the tangent of 85 degrees: there
/// one degree already takes as many pixels as twenty do in the middle.
const FARTHEST: f64 = 11.430_052_302_761_343;

/// The distortion of a lens, on the plane at depth 1: `x` right, `y` down, the axis at 0.
///
/// [`distort`](Self::distort) takes the point where a pinhole's ray meets that plane to the one that
/// the lens shows it at; `fx x + cx` is then the pixel. The formulas are OpenCV's (its manual,
/// "Camera Calibration and 3D Reconstruction" and "Fisheye camera model"), which COLMAP, nerfstudio
/// and instant-ngp share; those of [`FieldOfView`](Self::FieldOfView) and of the thin prism are COLMAP's
/// (`src/colmap/sensor/models.h`).
///
/// ```
/// use mesh_core::Distortion;
///
/// let barrel = Distortion::brown_conrady([-0.2, 0.0, 0.0], [0.001, 0.0]);
/// let seen = barrel.distort([0.5, 0.3]);
/// let back = barrel.undistort(seen).unwrap();
/// assert!((back[0] - 0.5).abs() < 1e-12 && (back[1] - 0.3).abs() < 1e-12);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Distortion {
    /// Brown and Conrady's, with a quotient of polynomials in `q = x^2 + y^2`:
    ///
    /// ```text
    /// s = (1 + n1 q + n2 q^2 + n3 q^3 + n4 q^4) / (1 + d1 q + d2 q^2 + d3 q^3)
    /// x' = x s + 2 p1 x y + p2 (q + 2 x^2)
    /// y' = y s + p1 (q + 2 y^2) + 2 p2 x y
    /// ```
    BrownConrady {
        /// `n1 .. n4`: OpenCV's `k1, k2, k3`, and nerfstudio's `k4`.
        numerator: [f64; 4],
        /// `d1 .. d3`: OpenCV's `k4, k5, k6`.
        denominator: [f64; 3],
        /// `p1, p2`.
        tangential: [f64; 2],
    },
    /// Kannala and Brandt's for fisheyes: a ray at the angle `a` off the axis is seen at the
    /// distance `a (1 + k1 a^2 + k2 a^4 + k3 a^6 + k4 a^8)`.
    KannalaBrandt {
        /// `k1 .. k4`.
        k: [f64; 4],
    },
    /// That of fisheyes with decentering and a thin prism, COLMAP's `THIN_PRISM_FISHEYE`: where the fisheye without
    /// coefficients shows `(u, v)`, at the angle `a = |(u, v)|`,
    ///
    /// ```text
    /// x' = u (1 + k1 a^2 + .. + k4 a^8) + 2 p1 u v + p2 (a^2 + 2 u^2) + s1 a^2
    /// y' = v (1 + k1 a^2 + .. + k4 a^8) + p1 (a^2 + 2 v^2) + 2 p2 u v + s2 a^2
    /// ```
    ThinPrismFisheye {
        /// `k1 .. k4`.
        k: [f64; 4],
        /// `p1, p2`.
        tangential: [f64; 2],
        /// `s1, s2`: COLMAP's `sx1, sy1`.
        prism: [f64; 2],
    },
    /// Devernay and Faugeras's for fisheyes, COLMAP's `FOV`: a ray that meets the plane at the distance `r` is seen at
    /// `atan(2 r tan(w / 2)) / w`. Towards `w = 0` it is a pinhole.
    FieldOfView {
        /// `w`, radians, the angle of view of the ideal lens.
        omega: f64,
    },
    /// Axes of the pixels that are not at right angles, as projection matrices may have them: `x' = x + shear y`.
    Skew {
        /// The skew of the intrinsics over the focal length along x.
        shear: f64,
    },
}

impl Distortion {
    /// OpenCV's five coefficients: `k1, k2, k3` and `p1, p2`.
    pub fn brown_conrady(k: [f64; 3], p: [f64; 2]) -> Self {
        let numerator = [k[0], k[1], k[2], 0.0];
        Self::BrownConrady { numerator, denominator: [0.0; 3], tangential: p }
    }

    /// Whether it leaves every ray where it is.
    pub fn is_none(&self) -> bool {
        match self {
            Self::BrownConrady { numerator, denominator, tangential } => {
                [&numerator[..], denominator, tangential].concat().iter().all(|&c| c == 0.0)
            }
            Self::KannalaBrandt { .. } | Self::ThinPrismFisheye { .. } => false,
            Self::FieldOfView { omega } => *omega == 0.0,
            Self::Skew { shear } => *shear == 0.0,
        }
    }

    /// Focal lengths and principal point `fx, fy, cx, cy` of a COLMAP camera, and its distortion:
    /// `SIMPLE_PINHOLE`, `PINHOLE`, `SIMPLE_RADIAL`, `RADIAL`, `OPENCV`, `FULL_OPENCV`,
    /// `SIMPLE_RADIAL_FISHEYE`, `RADIAL_FISHEYE`, `OPENCV_FISHEYE`, `FOV`, `THIN_PRISM_FISHEYE`.
    ///
    /// # Errors
    /// `Model` for another model, `ParameterCount` for too few or too many numbers, `NotFinite`.
    pub fn from_colmap(
        model: &str,
        params: &[f64],
    ) -> Result<([f64; 4], Option<Self>), CameraError> {
        // The model, how many focal lengths it has, and its coefficients in COLMAP's order.
        const MODELS: [(&str, usize, usize); 11] = [
            ("SIMPLE_PINHOLE", 1, 0),
            ("PINHOLE", 2, 0),
            ("SIMPLE_RADIAL", 1, 1),
            ("RADIAL", 1, 2),
            ("OPENCV", 2, 4),
            ("FULL_OPENCV", 2, 8),
            ("SIMPLE_RADIAL_FISHEYE", 1, 1),
            ("RADIAL_FISHEYE", 1, 2),
            ("OPENCV_FISHEYE", 2, 4),
            ("FOV", 2, 1),
            ("THIN_PRISM_FISHEYE", 2, 8),
        ];
        let Some(&(model, focals, count)) = MODELS.iter().find(|known| known.0 == model) else {
            return Err(CameraError::Model { found: model.to_owned() });
        };
        let expected = focals + 2 + count;
        if params.len() != expected {
            return Err(CameraError::ParameterCount { model, expected, found: params.len() });
        }
        if let Some(&found) = params.iter().find(|x| !x.is_finite()) {
            return Err(CameraError::NotFinite { field: "params", found });
        }
        let pinhole = [params[0], params[focals - 1], params[focals], params[focals + 1]];
        let c = |k: usize| params[focals + 2..].get(k).copied().unwrap_or(0.0);
        let distortion = if model == "FOV" {
            Self::FieldOfView { omega: c(0) }
        } else if model == "THIN_PRISM_FISHEYE" {
            Self::ThinPrismFisheye {
                k: [c(0), c(1), c(4), c(5)],
                tangential: [c(2), c(3)],
                prism: [c(6), c(7)],
            }
        } else if model.ends_with("FISHEYE") {
            Self::KannalaBrandt { k: [c(0), c(1), c(2), c(3)] }
        } else {
            let radial = model.ends_with("RADIAL");
            Self::BrownConrady {
                numerator: [c(0), c(1), c(4), 0.0],
                denominator: [c(5), c(6), c(7)],
                tangential: if radial { [0.0; 2] } else { [c(2), c(3)] },
            }
        };
        Ok((pinhole, (!distortion.is_none()).then_some(distortion)))
    }

    /// Where the lens shows what a pinhole shows at `point`.
    pub fn distort(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let q = x * x + y * y;
        match self {
            Self::BrownConrady { tangential: [p1, p2], .. } => {
                let s = self.scale(q);
                [
                    x * s + 2.0 * p1 * x * y + p2 * (q + 2.0 * x * x),
                    y * s + p1 * (q + 2.0 * y * y) + 2.0 * p2 * x * y,
                ]
            }
            Self::KannalaBrandt { .. } | Self::FieldOfView { .. } => {
                let s = self.scale(q);
                [x * s, y * s]
            }
            Self::ThinPrismFisheye { tangential: [p1, p2], prism: [s1, s2], .. } => {
                let s = self.scale(q);
                // The angle off the axis by the distance from it; decentering acts on angles.
                let narrow = angle_by_distance(q);
                let (u, v, a) = (x * narrow, y * narrow, q * narrow * narrow);
                [
                    x * s + 2.0 * p1 * u * v + p2 * (a + 2.0 * u * u) + s1 * a,
                    y * s + p1 * (a + 2.0 * v * v) + 2.0 * p2 * u * v + s2 * a,
                ]
            }
            Self::Skew { shear } => [x + shear * y, y],
        }
    }

    /// Where a pinhole shows what the lens shows at `point`; none where nothing within
    /// [`reach`](Self::reach) is shown there.
    ///
    /// Newton's method on [`distort`](Self::distort), to a relative error of 1e-12. Takes as long as
    /// 2,000 evaluations: for many points see [`undistorter`](Self::undistorter).
    pub fn undistort(&self, point: [f64; 2]) -> Option<[f64; 2]> {
        self.undistort_within(self.reach(), point)
    }

    /// [`undistort`](Self::undistort) for many points, which finds the reach once.
    pub fn undistorter(self) -> impl Fn([f64; 2]) -> Option<[f64; 2]> {
        let reach = self.reach();
        move |point| self.undistort_within(reach, point)
    }

    fn undistort_within(&self, reach: f64, point: [f64; 2]) -> Option<[f64; 2]> {
        let seen = point[0].hypot(point[1]);
        if seen == 0.0 {
            return Some([0.0; 2]);
        }
        // The radius alone comes first, by bisection: it has one solution within reach. Newton's
        // method then adds what decentering does to it.
        let (mut low, mut high) = (0.0, reach);
        if self.radial(reach) * 1.05 < seen {
            return None;
        }
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if self.radial(middle) < seen { low = middle } else { high = middle }
        }
        let [mut x, mut y] = point.map(|p| p * low / seen);
        for _ in 0..50 {
            let at = self.distort([x, y]);
            let (ex, ey) = (at[0] - point[0], at[1] - point[1]);
            if ex.hypot(ey) <= 1e-12 * (1.0 + seen) {
                return (x.hypot(y) <= reach * (1.0 + 1e-9)).then_some([x, y]);
            }
            let step = 1e-7 * (1.0 + x.hypot(y));
            let [dx, dy] = [[x + step, y], [x, y + step]].map(|near| self.distort(near));
            let (a, c) = ((dx[0] - at[0]) / step, (dx[1] - at[1]) / step);
            let (b, d) = ((dy[0] - at[0]) / step, (dy[1] - at[1]) / step);
            let determinant = a * d - b * c;
            x -= (d * ex - b * ey) / determinant;
            y -= (a * ey - c * ex) / determinant;
            if !(x.is_finite() && y.is_finite()) {
                return None;
            }
        }
        None
    }

    /// The distance from the axis, on the plane at depth 1, up to which the lens shows every point
    /// at a place of its own: where it ends, the polynomial turns back. At most 85 degrees.
    pub fn reach(&self) -> f64 {
        const STEPS: usize = 2048;
        // Evenly over angles: the plane is infinite.
        let radius = |k: usize| (k as f64 / STEPS as f64 * FARTHEST.atan()).tan();
        let grows = |k: &usize| self.radial(radius(*k)) > self.radial(radius(k - 1));
        let last = (1..=STEPS).take_while(grows).last().unwrap_or(0);
        radius(last)
    }

    /// The distance from the axis at which the lens shows what a pinhole shows at distance `r`,
    /// without decentering.
    fn radial(&self, r: f64) -> f64 {
        r * self.scale(r * r)
    }

    /// Seen distance by true distance, without decentering, at the squared distance `q`.
    fn scale(&self, q: f64) -> f64 {
        match self {
            Self::BrownConrady { numerator: n, denominator: d, .. } => {
                let above = 1.0 + q * (n[0] + q * (n[1] + q * (n[2] + q * n[3])));
                above / (1.0 + q * (d[0] + q * (d[1] + q * d[2])))
            }
            Self::KannalaBrandt { k } | Self::ThinPrismFisheye { k, .. } => {
                let narrow = angle_by_distance(q);
                let t = q * narrow * narrow;
                narrow * (1.0 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3]))))
            }
            Self::FieldOfView { omega } => {
                // The limit of the formula below, which is even in omega; the next term is of its fourth power.
                if omega.abs() < 1e-4 {
                    return 1.0 + omega * omega * (1.0 / 12.0 - q / 3.0);
                }
                let wide = 2.0 * (0.5 * omega).tan();
                wide * angle_by_distance(q * wide * wide) / omega
            }
            Self::Skew { .. } => 1.0,
        }
    }
}

/// `atan(r) / r` at the squared distance `q = r^2`.
fn angle_by_distance(q: f64) -> f64 {
    let r = q.sqrt();
    if r < 1e-12 { 1.0 } else { r.atan() / r }
}

impl std::fmt::Display for Distortion {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let named = |name: &'static str, values: &[f64]| {
            let each = values.iter().enumerate();
            each.map(|(k, &v)| (format!("{name}{}", k + 1), v)).collect::<Vec<_>>()
        };
        let (name, terms): (&str, Vec<(String, f64)>) = match self {
            Self::BrownConrady { numerator, denominator, tangential } => {
                let terms =
                    [named("n", numerator), named("d", denominator), named("p", tangential)];
                ("Brown-Conrady", terms.concat())
            }
            Self::KannalaBrandt { k } => ("fisheye", named("k", k)),
            Self::ThinPrismFisheye { k, tangential, prism } => {
                let terms = [named("k", k), named("p", tangential), named("s", prism)];
                ("thin prism fisheye", terms.concat())
            }
            Self::FieldOfView { omega } => ("field of view", vec![("omega".to_owned(), *omega)]),
            Self::Skew { shear } => ("skew", vec![("shear".to_owned(), *shear)]),
        };
        f.write_str(name)?;
        let terms = terms.iter().filter(|(_, value)| *value != 0.0);
        terms.into_iter().try_for_each(|(name, value)| write!(f, " {name}={value}"))
    }
}
