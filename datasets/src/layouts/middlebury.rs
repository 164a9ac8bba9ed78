//! Multi-view stereo in Middlebury's form: photographs, and a `<name>_par.txt` with the camera of each.
//!
//! ```text
//! 312
//! temple0001.png k11 k12 k13 k21 k22 k23 k31 k32 k33 r11 r12 .. r33 t1 t2 t3
//! ```
//!
//! A pixel is `K (R x + t)` of a point `x` of the world, from the middle of the first pixel on, x right and y down.
//!
//! # References
//! Seitz, Curless, Diebel, Scharstein, Szeliski 2006, *A Comparison and Evaluation of Multi-View Stereo Reconstruction
//! Algorithms*, and the readme of its data.

use std::path::Path;

use mesh_core::{Camera, Distortion};

use crate::assemble::{assemble, read_image_file, without_extension};
use crate::error::ReadViewsError;
use crate::mask_file::{mask_file, mask_names};
use crate::options::ReadOptions;
use crate::read::Reading;
use crate::source::{Opened, Source};
use crate::undistort::{Lenses, SKEW, straightened};
use crate::view::{Layout, View};

/// How names of parameter files end.
const END: &str = "_par.txt";
/// Hundreds of thousands of views fit.
const BYTES: u64 = 1 << 26;
/// Numbers of a camera.
const NUMBERS: usize = 21;

/// The parameter file, where there is one and no other.
pub(crate) fn parameters(names: &[String]) -> Option<String> {
    let mut found = names.iter().filter(|name| name.ends_with(END) && !name.contains('/'));
    found.next().filter(|_| found.next().is_none()).cloned()
}

/// A line of the file.
struct Shot {
    image: String,
    numbers: [f64; NUMBERS],
    /// The line's place in the file.
    field: String,
}

/// The views in the order of the file.
pub(crate) fn list<'a>(
    source: &'a Source,
    options: &'a ReadOptions,
    file: &str,
) -> Result<Reading<'a>, ReadViewsError> {
    let path = source.locate(file);
    let content = source.open()?.read(file, "cameras", BYTES)?;
    let text = String::from_utf8_lossy(&content);
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
    let wrong = |field: &str, found: &str, expected: &str| {
        ReadViewsError::field(&path, field, found.to_owned(), expected)
    };
    let (_, first) = lines.next().unwrap_or_default();
    let count = first.trim().parse::<usize>();
    let count = count.map_err(|_| wrong("line 1", first, "the number of images"))?;
    let mut reading = Reading::new(Layout::Middlebury, "r, t");
    let (mut listed, mut lenses) = (0, Lenses::default());
    for (index, line) in lines {
        listed += 1;
        let shot = Shot::new(line, index + 1, &path)?;
        let found =
            source.need(&shot.image, || format!("{} of {} names it", shot.field, path.display()));
        // Whether there is skew does not depend on the size of the image.
        let skewed = Camera::from_projection_matrix(shot.projection(), 1, 1);
        if found.is_ok() && skewed.is_ok_and(|(_, skew)| skew.is_some()) {
            lenses.count(SKEW.to_owned());
        }
        let (name, path) = (without_extension(&shot.image).to_owned(), path.clone());
        reading.add(&name, found, options, move |(), opened| shot.read(opened, &path, options))?;
    }
    reading.warnings.extend(lenses.sentence(options));
    if listed != count {
        let found = format!("{listed} lines with cameras");
        return Err(wrong("line 1", &found, &format!("{count}, as it says")));
    }
    Ok(reading)
}

impl Shot {
    fn new(line: &str, number: usize, file: &Path) -> Result<Self, ReadViewsError> {
        let field = format!("line {number}");
        let wrong = |found: String| {
            let expected = "a name and 21 numbers: K and R by rows, then t";
            ReadViewsError::field(file, &field, found, expected)
        };
        let mut words = line.split_whitespace();
        let image = words.next().unwrap_or_default().to_owned();
        let words: Vec<&str> = words.collect();
        let words = <[&str; NUMBERS]>::try_from(words)
            .map_err(|words| wrong(format!("{} words behind the name", words.len())))?;
        let mut numbers = [0.0; NUMBERS];
        for (number, word) in numbers.iter_mut().zip(words) {
            let read = word.parse().ok().filter(|number: &f64| number.is_finite());
            *number = read.ok_or_else(|| wrong(format!("the word {word:?}")))?;
        }
        Ok(Self { image, numbers, field })
    }

    /// `K [R | t]`, from the corner of the first pixel instead of its middle.
    fn projection(&self) -> [[f64; 4]; 3] {
        let number = |row: usize, column: usize| self.numbers[3 * row + column];
        let pose = |k: usize, c: usize| if c < 3 { number(3 + k, c) } else { number(6, k) };
        let intrinsic =
            |i: usize, k: usize| number(i, k) + if i < 2 { 0.5 * number(2, k) } else { 0.0 };
        std::array::from_fn(|i| {
            std::array::from_fn(|c| (0..3).map(|k| intrinsic(i, k) * pose(k, c)).sum())
        })
    }

    /// The camera, and the skew of its pixels where they have one.
    fn camera(
        &self,
        width: usize,
        height: usize,
        file: &Path,
    ) -> Result<(Camera, Option<Distortion>), ReadViewsError> {
        let camera = Camera::from_projection_matrix(self.projection(), width, height);
        let valid = |(camera, skew): (Camera, _)| camera.validate().map(|()| (camera, skew));
        camera
            .and_then(valid)
            .map_err(ReadViewsError::camera(file, format!("{}, camera", self.field)))
    }

    fn read(
        &self,
        opened: &mut Opened<'_>,
        file: &Path,
        options: &ReadOptions,
    ) -> Result<View, ReadViewsError> {
        let image = read_image_file(opened, &self.image, "image")?;
        let (camera, skew) = self.camera(image.pixels.width, image.pixels.height, file)?;
        let stem = without_extension(&self.image);
        let masks = mask_names("masks", &self.image);
        let mask = mask_file(opened, &masks, options)?;
        let view = assemble(stem.to_owned(), image, mask, camera, None, options)?;
        straightened(view, skew.as_ref(), options, (file, &format!("{}, camera", self.field)))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::{ByteImage, encode_png};

    use crate::{Layout, ReadOptions, read_views};

    /// A camera 4 in front of the origin, which looks along the world's z: focal length 20, the middle of an image of
    /// 16 x 12 at pixel (7.5, 5.5).
    const LINE: &str = "a.png 20 0 7.5 0 20 5.5 0 0 1  1 0 0 0 1 0 0 0 1  0 0 4";

    fn folder(text: &str) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        std::fs::write(folder.path().join("ball_par.txt"), text).unwrap();
        let mut image = ByteImage::new(12, 16, 4);
        image.data.chunks_exact_mut(4).take(40).for_each(|pixel| pixel.fill(255));
        for name in ["a.png", "b.png"] {
            std::fs::write(folder.path().join(name), encode_png(&image)).unwrap();
        }
        folder
    }

    #[test]
    fn cameras_are_those_of_the_file() {
        let text = format!("2\n{LINE}\n{}\n", LINE.replace("a.png", "b.png"));
        let folder = folder(&text);
        let views = read_views(folder.path(), &ReadOptions::default(), &|_, _| ()).unwrap();
        assert_eq!((views.layout, views.len()), (Layout::Middlebury, 2));
        let camera = &views.views[0].camera;
        // A point right of and below the axis (y is down here), 4 away: 20 x 0.5 / 4 = 2.5 pixels from the middle.
        let at = camera.project([0.5, 0.25, 0.0]);
        let expected = [8.0 + 2.5, 6.0 + 1.25, 4.0];
        let found = [at.column, at.row, at.depth];
        assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?}");
    }

    #[test]
    fn skew_is_said_to_be_undone() {
        let skewed = LINE.replacen("20 0 7.5", "20 0.4 7.5", 1);
        let folder = folder(&format!("1\n{skewed}\n"));
        let read = |undistort: bool| {
            let mask = crate::MaskSource::Whole;
            let options = ReadOptions { mask, undistort, ..ReadOptions::default() };
            read_views(folder.path(), &options, &|_, _| ()).unwrap().warnings.join(" ")
        };
        assert!(read(true).contains("undone") && read(true).contains("skew"), "{}", read(true));
        assert!(read(false).contains("left as it is"), "{}", read(false));
    }

    #[test]
    fn what_is_wrong_is_named_by_its_line() {
        let skewed = LINE.replacen("20 0 7.5", "20 4 7.5", 1);
        for (text, words) in [
            ("many\n".to_owned(), "line 1"),
            (format!("2\n{LINE}\n"), "1 lines with cameras"),
            ("1\na.png 20 0\n".to_owned(), "line 2"),
            (format!("1\n{}\n", LINE.replace("0 0 4", "0 0 x")), "line 2`: found the word \"x\""),
            (format!("1\n{skewed}\n"), "skew"),
            (format!("1\n{}\n", LINE.replace("a.png", "c.png")), "c.png"),
        ] {
            let folder = folder(&text);
            let error = read_views(folder.path(), &ReadOptions::default(), &|_, _| ()).unwrap_err();
            assert!(error.to_string().contains(words), "{words}: {error}");
        }
    }
}
