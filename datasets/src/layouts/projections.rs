//! Photographs with a projection matrix each: `P` takes a point of the world to a pixel.
//!
//! | file | matrices | middle of the first pixel |
//! |---|---|---|
//! | `cameras_sphere.npz`, `cameras.npz` (IDR, NeuS) | `world_mat_0`, `world_mat_1`, ..; the world is the matrices' own, not the unit sphere of `scale_mat` | 0 |
//! | `projections.txt` | twelve numbers each, by rows, over any number of lines; `#` begins a comment | 0 |
//! | `txt/<stem>.txt` (PMVS) | `CONTOUR`, then twelve numbers | 0 |
//! | one `.mat` file (Oxford's dinosaur) | the cells `P` | 1, as MATLAB counts |
//!
//! The matrices are those of the images in the natural order of their names, in `image/`, `images/`,
//! `visualize/` or beside the file. Masks are those of `mask/` or `masks/` with the images' stems or, where
//! there are as many as images, in the same order.

use std::collections::BTreeMap;
use std::io::{Cursor, Read};
use std::path::Path;

use mesh_core::Camera;
use zip::ZipArchive;

use crate::assemble::{assemble, images_in, plain_stem, read_image_file};
use crate::content::Content;
use crate::error::ReadViewsError;
use crate::formats::mat::Mat;
use crate::formats::npy;
use crate::mask_file::mask_file;
use crate::options::ReadOptions;
use crate::read::{Pending, Reading};
use crate::source::Source;
use crate::undistort::{Lenses, SKEW, straightened};
use crate::view::Layout;

/// Hundreds of thousands of matrices fit.
const BYTES: u64 = 1 << 26;
/// A matrix in an archive, with its header.
const ENTRY_BYTES: u64 = 4096;
/// Where images are looked for.
const IMAGES: [&str; 4] = ["image", "images", "visualize", ""];
/// Where masks are looked for.
const MASKS: [&str; 2] = ["mask", "masks"];

/// Where the matrices are.
#[derive(Clone, Debug)]
pub(crate) enum Matrices {
    Npz(String),
    Text(String),
    Mat(String),
    /// One text an image, in `txt/`.
    Pmvs,
}

type Matrix = [[f64; 4]; 3];

/// What is there, where it is of this layout.
pub(crate) fn recognises(
    source: &Source,
    names: &[String],
) -> Result<Option<Matrices>, ReadViewsError> {
    let has = |name: &&str| names.iter().any(|found| found == *name);
    if let Some(name) = ["cameras_sphere.npz", "cameras.npz"].into_iter().find(|name| has(name)) {
        return Ok(Some(Matrices::Npz(name.to_owned())));
    }
    if has(&"projections.txt") {
        return Ok(Some(Matrices::Text("projections.txt".to_owned())));
    }
    let images = first_images(source, &IMAGES)?;
    let Some(first) = images.first() else { return Ok(None) };
    let stem = plain_stem(first);
    if source.has(&format!("txt/{stem}.txt")) {
        return Ok(Some(Matrices::Pmvs));
    }
    let mut variables =
        names.iter().filter(|name| Path::new(name).extension().is_some_and(|end| end == "mat"));
    let only = variables.next().filter(|_| variables.next().is_none());
    Ok(only.cloned().map(Matrices::Mat))
}

/// The views in the natural order of the images.
pub(crate) fn list<'a>(
    source: &'a Source,
    options: &'a ReadOptions,
    matrices: &Matrices,
) -> Result<Reading<'a>, ReadViewsError> {
    let images = first_images(source, &IMAGES)?;
    let masks = masks(source, &images)?;
    let (matrices, first_pixel, places) = read(source, matrices, &images)?;
    if matrices.len() != images.len() {
        let found = format!("{} matrices", matrices.len());
        let expected = format!("{}, as many as there are images", images.len());
        return Err(ReadViewsError::field(&places[0].0, "matrices", found, expected));
    }
    // Whether a matrix is a camera's does not depend on the size of its image.
    let mut lenses = Lenses::default();
    for (p, (file, field)) in matrices.iter().zip(&places) {
        let (_, skew) = Camera::from_projection_matrix(*p, 1, 1)
            .map_err(ReadViewsError::camera(file, field.clone()))?;
        if skew.is_some() {
            lenses.count(SKEW.to_owned());
        }
    }
    let mut reading = Reading::new(Layout::Projections, "projection matrices");
    reading.warnings.extend(lenses.sentence(options));
    let views = images.into_iter().zip(masks).zip(matrices).zip(places);
    for (((name, masks), p), (file, field)) in views {
        let p = from_corner(p, 0.5 - first_pixel);
        let stem = plain_stem(&name).to_owned();
        reading.pending.push(Pending::new(stem, move |opened| {
            let image = read_image_file(opened, &name, "image")?;
            let (width, height) = (image.pixels.width, image.pixels.height);
            let (camera, skew) = Camera::from_projection_matrix(p, width, height)
                .and_then(|(camera, skew)| camera.validate().map(|()| (camera, skew)))
                .map_err(ReadViewsError::camera(&file, field.clone()))?;
            let mask = mask_file(opened, &masks, options)?;
            let view = assemble(plain_stem(&name).to_owned(), image, mask, camera, None, options)?;
            straightened(view, skew.as_ref(), options, (&file, &field))
        }));
    }
    Ok(reading)
}

/// The matrix for pixels that are all moved by `offset` along both axes.
fn from_corner(mut p: Matrix, offset: f64) -> Matrix {
    for k in 0..4 {
        p[0][k] += offset * p[2][k];
        p[1][k] += offset * p[2][k];
    }
    p
}

/// The images of the first of these folders that has any.
fn first_images(source: &Source, folders: &[&str]) -> Result<Vec<String>, ReadViewsError> {
    for folder in folders {
        let found = images_in(source, folder)?;
        if !found.is_empty() {
            return Ok(found);
        }
    }
    Ok(Vec::new())
}

/// For each image the masks that may be its own.
fn masks(source: &Source, images: &[String]) -> Result<Vec<Vec<String>>, ReadViewsError> {
    let found = first_images(source, &MASKS)?;
    // The first of a name is taken: the last that is put in.
    let by_stem: BTreeMap<&str, &String> =
        found.iter().rev().map(|mask| (plain_stem(mask), mask)).collect();
    let by_name: Vec<Option<&String>> =
        images.iter().map(|image| by_stem.get(plain_stem(image)).copied()).collect();
    let in_order = by_name.iter().all(Option::is_none) && found.len() == images.len();
    let of = |k: usize| if in_order { found.get(k) } else { by_name[k] };
    Ok((0..images.len()).map(|k| of(k).into_iter().cloned().collect()).collect())
}

/// A file, and where in it a matrix stands.
type Place = (std::path::PathBuf, String);

/// The matrices, the coordinate of the middle of the first pixel, and where each was found.
fn read(
    source: &Source,
    matrices: &Matrices,
    images: &[String],
) -> Result<(Vec<Matrix>, f64, Vec<Place>), ReadViewsError> {
    let mut opened = source.open()?;
    let (first_pixel, found) = match matrices {
        Matrices::Npz(name) => {
            let path = source.locate(name);
            (0.0, world_matrices(&opened.read(name, "cameras", BYTES)?, &path)?)
        }
        Matrices::Text(name) => {
            let path = source.locate(name);
            (0.0, text(&opened.read(name, "cameras", BYTES)?, &path)?)
        }
        Matrices::Mat(name) => {
            let path = source.locate(name);
            (1.0, cells(&opened.read(name, "cameras", BYTES)?, &path)?)
        }
        Matrices::Pmvs => {
            let mut all = Vec::with_capacity(images.len());
            for image in images {
                let name = format!("txt/{}.txt", plain_stem(image));
                let path = source.locate(&name);
                match text(&opened.read(&name, "camera", ENTRY_BYTES)?, &path)?.as_slice() {
                    [one] => all.push(one.clone()),
                    many => {
                        let found = format!("{} matrices", many.len());
                        return Err(ReadViewsError::field(path, "matrix", found, "one"));
                    }
                }
            }
            (0.0, all)
        }
    };
    if found.is_empty() {
        let expected = "at least one matrix";
        return Err(ReadViewsError::field(&source.path, "matrices", "none", expected));
    }
    let (matrices, places) = found.into_iter().unzip();
    Ok((matrices, first_pixel, places))
}

/// `world_mat_0` and those that follow.
fn world_matrices(content: &Content, path: &Path) -> Result<Vec<(Matrix, Place)>, ReadViewsError> {
    let fails = |error: zip::result::ZipError| ReadViewsError::new(path, error);
    let mut archive = ZipArchive::new(Cursor::new(&content[..])).map_err(fails)?;
    let mut all = Vec::new();
    loop {
        let field = format!("world_mat_{}", all.len());
        let entry = match archive.by_name(&format!("{field}.npy")) {
            Ok(entry) => entry,
            Err(zip::result::ZipError::FileNotFound) => break,
            Err(error) => return Err(fails(error)),
        };
        let mut bytes = Vec::new();
        let read = entry.take(ENTRY_BYTES).read_to_end(&mut bytes);
        read.map_err(|error| ReadViewsError::new(path, error))?;
        let p = npy::read_matrix(&bytes).map_err(|error| {
            ReadViewsError::field(
                path,
                format!("{field}, {}", error.field),
                error.found,
                error.expected,
            )
        })?;
        all.push((p, (path.to_owned(), field)));
    }
    Ok(all)
}

/// Twelve numbers each.
fn text(content: &Content, path: &Path) -> Result<Vec<(Matrix, Place)>, ReadViewsError> {
    let text = content.text(64, path)?;
    let lines = text.lines().enumerate().map(|(k, line)| (k, line.split('#').next().unwrap_or("")));
    let (mut all, mut numbers, mut begun) = (Vec::new(), Vec::with_capacity(12), 0);
    for (index, line) in lines {
        for word in line.split_whitespace().filter(|word| *word != "CONTOUR") {
            if numbers.is_empty() {
                begun = index + 1;
            }
            let Ok(number) = word.parse::<f64>() else {
                let field = format!("line {}", index + 1);
                let expected = "numbers: twelve for each matrix, by rows";
                return Err(ReadViewsError::field(path, field, word, expected));
            };
            numbers.push(number);
            if numbers.len() == 12 {
                let p = std::array::from_fn(|i| std::array::from_fn(|k| numbers[4 * i + k]));
                all.push((p, (path.to_owned(), format!("matrix of line {begun}"))));
                numbers.clear();
            }
        }
    }
    if !numbers.is_empty() {
        let found = format!("{} numbers", numbers.len());
        return Err(ReadViewsError::field(
            path,
            format!("matrix of line {begun}"),
            found,
            "twelve",
        ));
    }
    Ok(all)
}

/// The cells of the variable `P`.
fn cells(content: &Content, path: &Path) -> Result<Vec<(Matrix, Place)>, ReadViewsError> {
    let mat = Mat::read(content, path)?;
    let cells = mat.need("P", path)?.elements()?;
    let matrix = |(k, cell): (usize, crate::formats::mat::Node<'_>)| {
        let (array, rows, columns) = cell.table()?;
        if (rows, columns) != (3, 4) {
            return Err(cell.found(format!("{rows}x{columns}"), "3x4 numbers"));
        }
        let p = std::array::from_fn(|i| std::array::from_fn(|k| array.at(3 * k + i)));
        Ok((p, (path.to_owned(), format!("P{{{}}}", k + 1))))
    };
    cells.into_iter().enumerate().map(matrix).collect()
}
