//! What is fuzzed: every reader of bytes, each one function of bytes, with seeds that the program makes.
//!
//! The same functions run under libFuzzer (`fuzz/src/main.rs`) and for a moment each in `cargo test`
//! (`benches/tests/fuzz.rs`).

mod arrays;
mod folders;
mod meshes;
mod onnx;
mod pictures;
mod scratch;
mod training;
mod weights;

/// A reader and what it is tried with first.
pub(crate) struct Target {
    /// What it is called on the command line.
    pub(crate) name: &'static str,
    /// Reads; an error is fine, a panic or much memory is not.
    pub(crate) run: fn(&[u8]),
    /// Small files that can be read.
    pub(crate) seeds: fn() -> Vec<Vec<u8>>,
    /// Whether images are among what it reads, which take memory by their pixels and not by their bytes.
    #[allow(dead_code, reason = "for the test that counts memory")]
    pub(crate) images: bool,
}

pub(crate) static TARGETS: &[Target] = &[
    Target { name: "obj", run: meshes::obj, seeds: meshes::obj_seeds, images: true },
    Target { name: "ply", run: meshes::ply, seeds: meshes::ply_seeds, images: false },
    Target { name: "glb", run: meshes::glb, seeds: meshes::glb_seeds, images: true },
    Target { name: "off", run: meshes::off, seeds: meshes::off_seeds, images: false },
    Target { name: "stl", run: meshes::stl, seeds: meshes::stl_seeds, images: false },
    Target { name: "binvox", run: meshes::binvox, seeds: meshes::binvox_seeds, images: false },
    Target { name: "png", run: pictures::picture, seeds: pictures::png_seeds, images: true },
    Target { name: "jpeg", run: pictures::picture, seeds: pictures::jpeg_seeds, images: true },
    Target { name: "exr", run: pictures::exr, seeds: pictures::exr_seeds, images: true },
    Target { name: "pfm", run: pictures::pfm, seeds: pictures::pfm_seeds, images: true },
    Target { name: "npy", run: arrays::npy, seeds: arrays::npy_seeds, images: false },
    Target { name: "pickle", run: arrays::pickle, seeds: arrays::pickle_seeds, images: false },
    Target {
        name: "ellipsoid",
        run: arrays::ellipsoid,
        seeds: arrays::ellipsoid_seeds,
        images: false,
    },
    Target { name: "pth", run: weights::weights, seeds: weights::pth_seeds, images: false },
    Target {
        name: "safetensors",
        run: weights::weights,
        seeds: weights::safetensors_seeds,
        images: false,
    },
    Target { name: "onnx", run: onnx::model, seeds: onnx::seeds, images: false },
    Target { name: "toml", run: training::toml, seeds: training::toml_seeds, images: false },
    Target {
        name: "checkpoint",
        run: training::checkpoint,
        seeds: training::checkpoint_seeds,
        images: false,
    },
    Target { name: "mat", run: folders::mat, seeds: folders::mat_seeds, images: false },
    Target { name: "yaml", run: folders::yaml, seeds: folders::yaml_seeds, images: false },
    Target {
        name: "transforms",
        run: folders::transforms,
        seeds: folders::transforms_seeds,
        images: false,
    },
    Target { name: "cameras", run: folders::cameras, seeds: folders::cameras_seeds, images: false },
    Target { name: "pix3d", run: folders::pix3d, seeds: folders::pix3d_seeds, images: false },
    Target {
        name: "colmap_text",
        run: folders::colmap_text,
        seeds: folders::colmap_text_seeds,
        images: true,
    },
    Target {
        name: "colmap_binary",
        run: folders::colmap_binary,
        seeds: folders::colmap_binary_seeds,
        images: true,
    },
    Target { name: "bop", run: folders::bop, seeds: folders::bop_seeds, images: true },
    Target { name: "r2n2", run: folders::r2n2, seeds: folders::r2n2_seeds, images: true },
    Target { name: "zip", run: folders::zip, seeds: folders::zip_seeds, images: true },
    Target { name: "folder", run: folders::folder, seeds: folders::folder_seeds, images: true },
];
