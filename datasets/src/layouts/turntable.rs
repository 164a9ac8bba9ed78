//! Photographs of an object on a turntable, whose cameras follow from how they were taken.

use mesh_core::{Camera, counted};

use crate::assemble::{assemble, images_in, read_image_file, without_extension};
use crate::error::ReadViewsError;
use crate::mask_file::{mask_file, mask_names};
use crate::options::{ReadOptions, Turntable};
use crate::read::{Pending, Reading};
use crate::source::Source;
use crate::view::Layout;

/// The photographs of a source in their natural order: those in `images/`, or beside each other.
pub(crate) fn photographs(source: &Source) -> Result<Vec<String>, ReadViewsError> {
    let inside = images_in(source, "images")?;
    if inside.is_empty() { images_in(source, "") } else { Ok(inside) }
}

/// The views, in the natural order of the photographs' names.
pub(crate) fn list<'a>(
    source: &'a Source,
    options: &'a ReadOptions,
    table: Turntable,
) -> Result<Reading<'a>, ReadViewsError> {
    table.check(source)?;
    let names = photographs(source)?;
    // Fewer are a turn that was broken off, and say where each stands all the same.
    let complete = names.len() == table.count;
    if names.len() > table.count || (!complete && !options.allow_missing) {
        let expected = format!(
            "{} of them, one for each step of a full turn{}",
            table.count,
            if names.len() < table.count { " (or allow missing views at its end)" } else { "" }
        );
        let found = counted(names.len(), "photograph");
        return Err(ReadViewsError::field(&source.path, "turntable count", found, expected));
    }
    let mut warnings = Vec::new();
    if !complete {
        warnings.push(format!("the turn ends after {} of {} steps", names.len(), table.count));
    }
    let pending = names
        .into_iter()
        .enumerate()
        .map(|(index, name)| -> Pending<'a> {
            Pending::new(without_extension(&name).to_owned(), move |opened| {
                let image = read_image_file(opened, &name, "image")?;
                let (width, height) = (image.pixels.width, image.pixels.height);
                let camera = table.camera(index, width, height);
                let stem = without_extension(&name);
                let masks = mask_names("masks", &name);
                let mask = mask_file(opened, &masks, options)?;
                assemble(stem.to_owned(), image, mask, camera, None, options)
            })
        })
        .collect();
    Ok(Reading { pending, warnings, ..Reading::new(Layout::Turntable, "turntable") })
}

impl Turntable {
    /// The camera of one photograph, for images of this size.
    pub fn camera(&self, index: usize, width: usize, height: usize) -> Camera {
        let turn = std::f64::consts::TAU * index as f64 / self.count.max(1) as f64;
        let (sin, cos) = if self.reverse { -turn } else { turn }.sin_cos();
        let (up, along) = self.elevation.to_radians().sin_cos();
        let d = self.distance;
        let eye = [d * along * sin, d * up, d * along * cos];
        // Straight from above the image's top still points away from the first camera.
        let up = if along.abs() < 1e-9 { [-sin, 0.0, -cos] } else { [0.0, 1.0, 0.0] };
        Camera::look_at(eye, [0.0; 3], up, self.fov.to_radians(), width, height)
    }

    fn check(&self, source: &Source) -> Result<(), ReadViewsError> {
        let faults = [
            ("count", self.count > 0, self.count as f64, "at least 1"),
            (
                "elevation",
                (-90.0..=90.0).contains(&self.elevation),
                self.elevation,
                "-90 to 90 degrees",
            ),
            (
                "distance",
                self.distance > 0.0 && self.distance.is_finite(),
                self.distance,
                "a distance above 0",
            ),
            ("fov", self.fov > 0.0 && self.fov < 180.0, self.fov, "an angle above 0, below 180"),
        ];
        match faults.into_iter().find(|(_, good, ..)| !good) {
            None => Ok(()),
            Some((name, _, found, expected)) => {
                let field = format!("turntable {name}");
                Err(ReadViewsError::field(&source.path, field, found.to_string(), expected))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_camera_goes_round_once() {
        let table =
            Turntable { count: 4, elevation: 30.0, distance: 2.0, fov: 40.0, reverse: false };
        let eye = |table: Turntable, k| -> [f64; 3] { table.camera(k, 40, 30).center().into() };
        let close = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
        let far = 2.0 * 30f64.to_radians().cos();
        assert!(close(eye(table, 0), [0.0, 1.0, far]));
        assert!(close(eye(table, 1), [far, 1.0, 0.0]));
        assert!(close(eye(Turntable { reverse: true, ..table }, 1), [-far, 1.0, 0.0]));
        let seen = table.camera(3, 40, 30).project([0.0; 3]);
        assert!((seen.column - 20.0).abs() + (seen.row - 15.0).abs() < 1e-9);
        let above = Turntable { elevation: 90.0, ..table };
        // From straight above, +X is at the image's right in the first photograph, and at its
        // bottom after a quarter of a turn.
        let p = above.camera(0, 40, 30).project([0.1, 0.0, 0.0]);
        assert!(p.column > 20.0 && (p.row - 15.0).abs() < 1e-9);
        let p = above.camera(1, 40, 30).project([0.1, 0.0, 0.0]);
        assert!(p.row > 15.0 && (p.column - 20.0).abs() < 1e-9);
    }
}
