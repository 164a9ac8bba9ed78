//! The lower edge of cars and buses: sills with wheel arches cut out.

use std::f64::consts::PI;

use super::solid::on_ellipse;

/// Adds the lower edge `[z, y]` from rear to front to a side view: along the sill, and over each
/// axle (rear first) in an arch of this radius around a wheel of that one.
pub(super) fn cut_arches(
    outline: &mut Vec<[f64; 2]>,
    sill: f64,
    axles: &[f64],
    wheel: f64,
    arch: f64,
) {
    // The arch meets the sill below its middle or above, as the ground clearance is.
    let rise = ((sill - wheel) / arch).clamp(-0.9, 0.9).asin();
    for &axle in axles {
        outline.push([axle - arch * rise.cos() - 0.02, sill]);
        let angle = |k| PI - rise - (PI - 2.0 * rise) * f64::from(k) / 9.0;
        outline.extend((0..=9).map(|k| on_ellipse([axle, wheel], [arch; 2], angle(k))));
        outline.push([axle + arch * rise.cos() + 0.02, sill]);
    }
}
