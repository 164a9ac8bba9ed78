//! Views of one object: images, masks and cameras.

use std::path::PathBuf;

use datasets::{ReadOptions, View};
use mesh_core::ByteImage;
use numpy::{IntoPyArray, PyArrayDyn, PyArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;

use crate::arrays::{self, Floats};
use crate::camera::Camera;
use crate::error;
use crate::mesh::{byte_image, image};

/// Views(colors, masks, cameras)
///
/// Images of one object, which of their pixels are the object, and where they were taken from.
///
/// colors: uint8, or floating-point in [0, 1], [N, H, W, 3], sRGB, or a list of [H, W, 3]. masks: uint8 or bool [N, H, W] (or a list), not 0
/// where the object is, or floating-point in [0, 1], 1/2 or more there. cameras: N of the images' sizes.
///
/// Raises ValueError where sizes or numbers do not fit.
#[pyclass(frozen, module = "unsphere")]
pub(crate) struct Views(pub(crate) datasets::Views);

/// An image of bytes, or of floating-point numbers in [0, 1].
fn bytes(name: &str, array: &Bound<'_, PyAny>) -> PyResult<ByteImage> {
    if let Ok(array) = array.cast::<PyArrayDyn<u8>>() {
        return byte_image(name, &array.try_readonly().map_err(error::value)?);
    }
    let Ok(floats) = array.extract::<Floats<'_>>() else {
        let found = arrays::found(array)?;
        let text =
            format!("{name}: arrays of uint8, or of floats in [0, 1], expected, found {found}");
        return Err(PyTypeError::new_err(text));
    };
    floats.check_unit(name)?;
    Ok(image(name, &floats)?.to_bytes())
}

/// A mask of bytes, of truth values as NumPy has them, or of shares of a pixel.
fn mask(name: &str, array: &Bound<'_, PyAny>) -> PyResult<ByteImage> {
    let whole = match array.cast::<PyArrayDyn<bool>>() {
        Ok(_) => array.call_method1("view", ("uint8",))?,
        Err(_) => array.clone(),
    };
    let least = if whole.cast::<PyArrayDyn<u8>>().is_ok() { 1 } else { 128 };
    let mut image = bytes(name, &whole)?;
    image.data.iter_mut().for_each(|m| *m = if *m < least { 0 } else { 255 });
    Ok(image)
}

#[pymethods]
impl Views {
    #[new]
    fn new(
        colors: &Bound<'_, PyAny>,
        masks: &Bound<'_, PyAny>,
        cameras: Vec<Camera>,
    ) -> PyResult<Self> {
        let (n, m) = (colors.len()?, masks.len()?);
        if n != m || n != cameras.len() {
            let c = cameras.len();
            return Err(error::value(format!("Views: {n} images, {m} masks and {c} cameras")));
        }
        let views = cameras.into_iter().enumerate().map(|(i, Camera(camera))| {
            let color = colors.get_item(i)?;
            let color = bytes("Views: colors", &color)?;
            let mask = mask("Views: masks", &masks.get_item(i)?)?;
            let size = [camera.height, camera.width];
            let of = |image: &ByteImage| [image.height, image.width];
            if of(&color) != size || of(&mask) != size || [color.channels, mask.channels] != [3, 1] {
                let [height, width] = size;
                let swapped = height != width && of(&color) == [width, height] && of(&mask) == [width, height];
                let remedy = if swapped { "; are the camera's height and width swapped?" } else { "" };
                let text = format!(
                    "Views: view {i}: image {:?} of {} channels, mask {:?}, camera {size:?} (height, width): \
                     one size, three channels and one mask expected{remedy}",
                    of(&color), color.channels, of(&mask)
                );
                return Err(error::value(text));
            }
            Ok(View { name: i.to_string(), color, mask, camera, depth: None, crop: None })
        });
        let views = views.collect::<PyResult<Vec<_>>>()?;
        Ok(Self(datasets::Views::in_memory(views)))
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    /// The cameras, in the world of their source.
    #[getter]
    fn cameras(&self) -> Vec<Camera> {
        self.0.views.iter().map(|view| Camera(view.camera.clone())).collect()
    }

    /// What each view is called in its source.
    #[getter]
    fn names(&self) -> Vec<String> {
        self.0.views.iter().map(|view| view.name.clone()).collect()
    }

    /// What a user should know although it stopped nothing.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.0.warnings.clone()
    }

    /// The image of a view, uint8 [H, W, 3].
    fn color<'py>(&self, py: Python<'py>, index: usize) -> PyResult<Bound<'py, PyAny>> {
        pixels(py, &self.view(index)?.color)
    }

    /// The mask of a view, uint8 [H, W, 1]: 255 where the object is, else 0.
    fn mask<'py>(&self, py: Python<'py>, index: usize) -> PyResult<Bound<'py, PyAny>> {
        pixels(py, &self.view(index)?.mask)
    }

    /// Writes them as transforms.json with images, which NeRF and nerfstudio read as well.
    fn write(&self, py: Python<'_>, folder: PathBuf) -> PyResult<()> {
        py.detach(|| datasets::write_transforms(&self.0.views, &folder)).map_err(error::file)
    }

    fn __repr__(&self) -> String {
        format!("Views: {} of one object, {}", self.0.len(), self.0.layout)
    }
}

impl Views {
    fn view(&self, index: usize) -> PyResult<&View> {
        let count = self.0.len();
        let outside =
            || pyo3::exceptions::PyIndexError::new_err(format!("view {index} of {count}"));
        self.0.views.get(index).ok_or_else(outside)
    }
}

fn pixels<'py>(py: Python<'py>, image: &ByteImage) -> PyResult<Bound<'py, PyAny>> {
    let shape = (image.height, image.width, image.channels);
    let array = ndarray::Array3::from_shape_vec(shape, image.data.clone());
    Ok(array.map_err(error::value)?.into_pyarray(py).into_any())
}

/// Reads views of whatever layout is at a path. options: JSON.
#[pyfunction]
pub(crate) fn read_views(py: Python<'_>, path: PathBuf, options: &str) -> PyResult<Views> {
    let options: ReadOptions = serde_json::from_str(options).map_err(error::value)?;
    let views = py.detach(|| datasets::read_views(&path, &options, &|_, _| {}));
    views.map(Views).map_err(error::file)
}
