//! CIE Lab of a colour, and the gradient of that.
//!
//! ```text
//! linear = ((v + 0.055) / 1.055)^2.4, or v / 12.92 up to 0.04045        v of sRGB, clamped to [0, 1]
//! XYZ    = M linear, each over that of white (D65)
//! f(t)   = t^(1/3), or t / (3 (6/29)²) + 4/29 up to (6/29)³
//! L = 116 f(Y) - 16      a = 500 (f(X) - f(Y))      b = 200 (f(Y) - f(Z))
//! ```

use autodiff_lite::Real;

/// From linear RGB to X, Y, Z (ITU-R BT.709 primaries, white D65).
const TO_XYZ: [[f64; 3]; 3] = [
    [0.412453, 0.357580, 0.180423],
    [0.212671, 0.715160, 0.072169],
    [0.019334, 0.119193, 0.950227],
];
/// X, Y, Z of white: the sums of the rows.
const WHITE: [f64; 3] = [0.950456, 1.0, 1.088754];
/// Where the cube root takes over: 6/29.
const KNEE: f64 = 6.0 / 29.0;

/// Linear light of an sRGB value, and its derivative; none outside `[0, 1]`.
#[inline]
fn linear<F: Real>(v: F) -> (F, F) {
    let c = F::from_f64;
    if v < F::zero() || v > F::one() {
        let end = if v < F::zero() { F::zero() } else { F::one() };
        (end, F::zero())
    } else if v <= c(0.04045) {
        (v / c(12.92), c(1.0 / 12.92))
    } else {
        let base = (v + c(0.055)) / c(1.055);
        let power = base.powf(c(1.4));
        (power * base, c(2.4 / 1.055) * power)
    }
}

/// `f(t)` and its derivative.
#[inline]
fn compressed<F: Real>(t: F) -> (F, F) {
    let c = F::from_f64;
    if t > c(KNEE * KNEE * KNEE) {
        let root = t.cbrt();
        (root, c(1.0 / 3.0) / (root * root))
    } else {
        let derivative = 1.0 / (3.0 * KNEE * KNEE);
        (t * c(derivative) + c(4.0 / 29.0), c(derivative))
    }
}

/// `f` of X, Y, Z over white with their derivatives, and the derivatives of linear light.
#[inline]
fn stages<F: Real>(rgb: [F; 3]) -> ([(F, F); 3], [F; 3]) {
    let light = rgb.map(linear);
    let f = [0, 1, 2].map(|k| {
        let weight = |c: usize| F::from_f64(TO_XYZ[k][c] / WHITE[k]);
        compressed(weight(0) * light[0].0 + weight(1) * light[1].0 + weight(2) * light[2].0)
    });
    (f, light.map(|l| l.1))
}

/// L in `[0, 100]`, a and b of an sRGB colour.
#[inline]
pub fn lab<F: Real>(rgb: [F; 3]) -> [F; 3] {
    let ([(x, _), (y, _), (z, _)], _) = stages(rgb);
    let c = F::from_f64;
    [c(116.0) * y - c(16.0), c(500.0) * (x - y), c(200.0) * (y - z)]
}

/// The gradient of the colour from that of its [`lab`].
#[inline]
pub fn lab_grad<F: Real>(rgb: [F; 3], g: [F; 3]) -> [F; 3] {
    let (f, light) = stages(rgb);
    let c = F::from_f64;
    let of_f =
        [c(500.0) * g[1], c(116.0) * g[0] - c(500.0) * g[1] + c(200.0) * g[2], -(c(200.0) * g[2])];
    let mut out = [F::zero(); 3];
    for k in 0..3 {
        let of_xyz = of_f[k] * f[k].1;
        for (channel, out) in out.iter_mut().enumerate() {
            *out += of_xyz * c(TO_XYZ[k][channel] / WHITE[k]) * light[channel];
        }
    }
    out
}
