//! The module `unsphere._unsphere`: the libraries' functions on NumPy arrays. What users see of it is in `python/unsphere`.

#![allow(rustdoc::broken_intra_doc_links, reason = "docstrings, in which [N, 3] is a shape")]

use pyo3::prelude::*;

mod arrays;
mod camera;
mod drawn;
mod error;
mod fit;
mod frame;
mod grid;
mod image_losses;
mod interrupt;
mod mesh;
mod metrics;
mod neighbors;
mod ode;
mod point_losses;
mod precision;
mod recorded;
mod sample;
mod shade;
mod surface_losses;
mod topology;
mod views;
mod wanted;

#[pymodule]
mod _unsphere {
    #[pymodule_export]
    use super::camera::{Camera, matrices, of_parts, project};
    #[pymodule_export]
    use super::fit::{Fitted, fit};
    #[pymodule_export]
    use super::frame::{Frame, rasterize};
    #[pymodule_export]
    use super::grid::{cubify, marching_cubes};
    #[pymodule_export]
    use super::image_losses::{
        l1, l2, log_depth, mask_bce, mask_iou, scale_shift_invariant, ssim_loss,
    };
    #[pymodule_export]
    use super::mesh::{
        Mesh, cuboid, icosphere, lathe, read_image, read_mesh, torus, write_mesh, write_png,
    };
    #[pymodule_export]
    use super::metrics::{evaluate, iou, point_distances, psnr, ssim, voxel_iou};
    #[pymodule_export]
    use super::neighbors::{knn_points, neighbors};
    #[pymodule_export]
    use super::ode::{Solution, odeint};
    #[pymodule_export]
    use super::point_losses::{
        chamfer, chamfer_l1, chamfer_normals, earth_mover, face_point_distance,
        point_face_distance, point_mesh_face_distance,
    };
    #[pymodule_export]
    use super::recorded::Recorded;
    #[pymodule_export]
    use super::sample::{SurfaceSamples, sample_surface};
    #[pymodule_export]
    use super::shade::{
        antialiased_silhouette, depth, interpolate, interpolate_corners, soft_silhouette, texture,
    };
    #[pymodule_export]
    use super::surface_losses::{
        deformation_norm, edge_length, edge_length_sum, face_angle, face_normals,
        laplacian_cotangent, laplacian_cotcurv, laplacian_norm, laplacian_squared,
        normal_consistency, surface_normals, surface_points, vertex_normals,
    };
    #[pymodule_export]
    use super::topology::Topology;
    #[pymodule_export]
    use super::views::{Views, read_views};

    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
