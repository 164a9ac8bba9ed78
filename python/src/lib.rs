//! The module `unsphere._unsphere`: the libraries' functions on NumPy arrays. What users see of it is in `python/unsphere`.

use pyo3::prelude::*;

mod arrays;
mod error;
mod frame;
mod precision;
mod recorded;
mod shade;
mod topology;
mod wanted;

#[pymodule]
mod _unsphere {
    #[pymodule_export]
    use super::frame::{Frame, rasterize};
    #[pymodule_export]
    use super::recorded::Recorded;
    #[pymodule_export]
    use super::shade::{
        antialiased_silhouette, depth, interpolate, interpolate_corners, soft_silhouette, texture,
    };
    #[pymodule_export]
    use super::topology::Topology;
}
