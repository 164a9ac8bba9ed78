//! Fitting a mesh to views.

use std::fmt::Display;
use std::sync::Mutex;

use numpy::IntoPyArray;
use pyo3::prelude::*;
use recon::fit::FitConfig;
use recon::progress::{Event, Watch};

use crate::camera::Camera;
use crate::error;
use crate::interrupt::Interrupt;
use crate::mesh::Mesh;
use crate::views::Views;

/// What a fit found: a mesh, and how it came about.
#[pyclass(frozen, module = "unsphere")]
pub(crate) struct Fitted {
    fitted: recon::fit::Fitted,
}

#[pymethods]
impl Fitted {
    /// The mesh, in the world of the cameras: closed, with colours.
    #[getter]
    fn mesh(&self, py: Python<'_>) -> PyResult<Mesh> {
        Mesh::of(py, self.fitted.mesh.clone())
    }

    /// The loss of each step, float64 [steps].
    #[getter]
    fn losses<'py>(&self, py: Python<'py>) -> Bound<'py, PyAny> {
        let losses: Vec<f64> = self.fitted.history.iter().map(|step| step.loss).collect();
        losses.into_pyarray(py).into_any()
    }

    /// Mean mask IoU of the views that were held out, as pairs of steps done and score.
    #[getter]
    fn evaluations(&self) -> Vec<(usize, f64)> {
        self.fitted.evaluations.clone()
    }

    /// Indices of the views that were held out.
    #[getter]
    fn held_out_views(&self) -> Vec<usize> {
        self.fitted.held_out_views.clone()
    }

    /// The cameras that the mesh agrees with, where they were refined; else None.
    #[getter]
    fn cameras(&self) -> Option<Vec<Camera>> {
        let refined = self.fitted.cameras.as_ref()?;
        Some(refined.cameras.iter().cloned().map(Camera).collect())
    }

    /// Pairs of faces that run through each other.
    #[getter]
    fn self_intersections(&self) -> usize {
        self.fitted.self_intersections
    }

    /// What a user should know.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.fitted.warnings.clone()
    }

    /// Whether it came to its end; False where the callback ended it.
    #[getter]
    fn completed(&self) -> bool {
        !self.fitted.ended.is_cancelled()
    }

    fn __repr__(&self) -> String {
        let (steps, mesh) = (self.fitted.history.len(), &self.fitted.mesh);
        format!("Fitted after {steps} steps: {} vertices", mesh.positions.len())
    }
}

/// Fits a mesh to views. options: names and values as TOML has them. callback: hears of each step.
#[pyfunction]
pub(crate) fn fit(
    py: Python<'_>,
    views: &Views,
    options: Vec<(String, String)>,
    callback: Option<Py<PyAny>>,
) -> PyResult<Fitted> {
    let config: FitConfig = train::settings::read(None, &options).map_err(with_underscores)?;
    let views = &views.0;
    let interrupt = Mutex::new(Interrupt::default());
    let found = py.detach(|| {
        let mut watch = Watch::default().until_event(|event: &Event| {
            let step = match event {
                Event::Step(step) => Some((step.step, step.total, step.loss)),
                _ => None,
            };
            let mut interrupt = interrupt.lock().expect("one event at a time");
            interrupt.is_due(callback.as_ref(), step)
        });
        error::caught(|| recon::fit::fit(views, &config, &mut watch))
    })?;
    interrupt.into_inner().expect("the fit is over").raised()?;
    Ok(Fitted { fitted: found.map_err(with_underscores)? })
}

/// An error that names options: Python writes them with underscores, files of settings with hyphens.
fn with_underscores(error: impl Display) -> PyErr {
    let text = error.to_string();
    // Values keep their hyphens, and so do other errors, which may quote files.
    if !["unknown field", "fit configuration"].iter().any(|kind| text.contains(kind)) {
        return error::value(text);
    }
    let named = |(i, part): (usize, &str)| {
        let is_name = i % 2 == 1 && part.starts_with(|c: char| c.is_ascii_lowercase());
        if is_name { part.replace('-', "_") } else { part.to_owned() }
    };
    error::value(text.split('`').enumerate().map(named).collect::<Vec<_>>().join("`"))
}
