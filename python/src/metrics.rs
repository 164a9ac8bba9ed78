//! Figures: how good images, masks, points and meshes are.

use losses::metrics::{self, Preset};
use mesh_core::Image;
use numpy::IntoPyArray;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{Floats, whole};
use crate::error;
use crate::mesh::{self, Mesh};

/// Two images of one size.
fn pair(op: &str, image: &Floats<'_>, target: &Floats<'_>) -> PyResult<[Image; 2]> {
    if image.shape() != target.shape() {
        let (a, b) = (image.shape(), target.shape());
        return Err(error::value(format!(
            "{op}: images of one shape expected, found {a:?} and {b:?}"
        )));
    }
    Ok([mesh::image(op, image)?, mesh::image(op, target)?])
}

/// Peak signal-to-noise ratio in decibels, of images [H, W, C] in [0, 1]; inf where they are equal.
#[pyfunction]
pub(crate) fn psnr(py: Python<'_>, image: Floats<'_>, target: Floats<'_>) -> PyResult<f64> {
    let [image, target] = pair("psnr", &image, &target)?;
    Ok(py.detach(|| metrics::psnr(&image, &target)))
}

/// Structural similarity of images [H, W, C] in [0, 1], 1 where they are equal: Gaussian window of 11 x 11, standard deviation 1.5.
///
/// valid: only pixels whose window lies within the image count (scikit-image's), NaN where there are none; else borders are padded with 0.
#[pyfunction]
#[pyo3(signature = (image, target, *, valid=false))]
pub(crate) fn ssim(
    py: Python<'_>,
    image: Floats<'_>,
    target: Floats<'_>,
    valid: bool,
) -> PyResult<f64> {
    let [image, target] = pair("ssim", &image, &target)?;
    py.detach(|| {
        error::caught(|| {
            let of = if valid { metrics::ssim_valid } else { metrics::ssim };
            of(&image, &target)
        })
    })
}

/// Masks [H, W], or as many as there are of [N, H, W]; one channel may be said.
fn masks(array: &Floats<'_>) -> PyResult<Vec<Image>> {
    let (count, height, width) = match *array.shape() {
        [height, width] | [height, width, 1] => (1, height, width),
        [count, height, width] | [count, height, width, 1] if count > 0 => (count, height, width),
        ref found => {
            return Err(error::value(format!(
                "iou: masks [H, W] or [N, H, W] expected, found {found:?}"
            )));
        }
    };
    let (data, size) = (array.singles(), height * width);
    let mask = |k: usize| data[k * size..(k + 1) * size].to_vec();
    Ok((0..count).map(|k| Image { height, width, channels: 1, data: mask(k) }).collect())
}

/// Intersection over union of two masks, object above 1/2; 1 where both are empty.
///
/// prediction, target: [H, W], or [N, H, W] of which the mean is taken; alike.
#[pyfunction]
pub(crate) fn iou(prediction: Floats<'_>, target: Floats<'_>) -> PyResult<f64> {
    if prediction.shape() != target.shape() {
        let (a, b) = (prediction.shape(), target.shape());
        return Err(error::value(format!(
            "iou: masks of one shape expected, found {a:?} and {b:?}"
        )));
    }
    let (prediction, target) = (masks(&prediction)?, masks(&target)?);
    let sum: f64 = prediction.iter().zip(&target).map(|(a, b)| metrics::mask_iou(a, b)).sum();
    Ok(sum / prediction.len() as f64)
}

/// Distances between two sets of points, [P, 3] and [Q, 3]; never squared.
///
/// Result: a dict of `accuracy` [P] (to the nearest true point) and `completeness` [Q] (to the nearest predicted one), `chamfer` (their means,
/// added), and, for each of `thresholds`, an entry of `f_scores`: threshold, precision, recall, f_score.
#[pyfunction]
#[pyo3(
    signature = (prediction, truth, thresholds=vec![]),
    text_signature = "(prediction, truth, thresholds=())"
)]
pub(crate) fn point_distances<'py>(
    py: Python<'py>,
    prediction: Floats<'_>,
    truth: Floats<'_>,
    thresholds: Vec<f64>,
) -> PyResult<Bound<'py, PyDict>> {
    let prediction = prediction.rows("point_distances: prediction")?;
    let truth = truth.rows("point_distances: truth")?;
    if prediction.is_empty() || truth.is_empty() {
        return Err(error::value("point_distances: both sets need points"));
    }
    let found = py.detach(|| metrics::point_distances(&prediction, &truth));
    let scores = thresholds.iter().map(|&threshold| {
        let score = found.f_score(threshold);
        let entry = PyDict::new(py);
        entry.set_item("threshold", score.threshold)?;
        entry.set_item("precision", score.precision)?;
        entry.set_item("recall", score.recall)?;
        entry.set_item("f_score", score.f_score)?;
        Ok(entry)
    });
    let scores = scores.collect::<PyResult<Vec<_>>>()?;
    let (there, back) = found.chamfer(false);
    let result = PyDict::new(py);
    result.set_item("chamfer", there + back)?;
    result.set_item("f_scores", scores)?;
    result.set_item("accuracy", found.accuracy.into_pyarray(py))?;
    result.set_item("completeness", found.completeness.into_pyarray(py))?;
    Ok(result)
}

/// Compares two meshes under a published protocol, which is part of the answer.
///
/// protocol: "p2m" (Pixel2Mesh), "meshrcnn" (Mesh R-CNN), "occnet" (Occupancy Networks) or "mcmr" (3D IoU). seed: of the points that are drawn.
/// Result: JSON of figures and protocol.
#[pyfunction]
pub(crate) fn evaluate(
    py: Python<'_>,
    prediction: &Mesh,
    truth: &Mesh,
    protocol: &str,
    #[pyo3(from_py_with = whole)] seed: u64,
) -> PyResult<String> {
    let preset: Preset = protocol.parse().map_err(error::value)?;
    let (prediction, truth) = (prediction.checked(py)?, truth.checked(py)?);
    let report = py.detach(|| metrics::evaluate(&prediction, &truth, &preset.protocol(seed)));
    serde_json::to_string(&report.map_err(error::value)?).map_err(error::value)
}

/// Intersection over union of two closed meshes as they lie. resolution: cells along the longest edge of their common box, 1 to 1024.
#[pyfunction]
#[pyo3(signature = (prediction, truth, resolution=64))]
pub(crate) fn voxel_iou(
    py: Python<'_>,
    prediction: &Mesh,
    truth: &Mesh,
    #[pyo3(from_py_with = whole)] resolution: usize,
) -> PyResult<f64> {
    if !(1..=1024).contains(&resolution) {
        return Err(error::value(format!(
            "voxel_iou: resolution {resolution}, expected 1 to 1024"
        )));
    }
    let (prediction, truth) = (prediction.checked(py)?, truth.checked(py)?);
    Ok(py.detach(|| metrics::voxel_iou(&prediction, &truth, resolution)))
}
