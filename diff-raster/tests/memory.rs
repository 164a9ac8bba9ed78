//! A step in the steady state takes no fresh memory worth a page.
#![allow(clippy::unwrap_used, reason = "tests")]

use std::sync::Arc;

use autodiff_lite::testkit::CountingAllocator;
use autodiff_lite::{Tape, Tensor};
use diff_raster::{
    Faces, Fragments, Settings, antialiased_silhouette, depth, interpolate, rasterize_into,
    soft_silhouette, texture,
};
use mesh_core::primitives::icosphere;
use ndarray::{Array2, Array3};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator::new();

#[test]
fn steps_recycle_their_memory() {
    let mesh = icosphere(3);
    let faces = Arc::new(Faces::of(&mesh).unwrap());
    let (images, size, vertices) = (2, 96, mesh.positions.len());
    let settings = Settings::new(size, size);
    let positions = |turn: f32| -> Tensor<f32> {
        let corner = |(n, v, k): (usize, usize, usize)| {
            let ([x, y, z], (sin, cos)) = (mesh.positions[v], (turn + n as f32).sin_cos());
            let depth = 4.0 - z * cos + x * sin;
            [(x * cos + z * sin) * 3.0 / depth, y * 3.0 / depth, depth][k]
        };
        Array3::from_shape_fn((images, vertices, 3), corner).into()
    };
    let colours: Tensor<f32> =
        Array2::from_shape_fn((vertices, 3), |(v, k)| mesh.positions[v][k]).into();
    let image: Tensor<f32> = Array3::from_elem((32, 32, 3), 0.5).into();

    // One thread: which task finds spare scratch is then the same in every step.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        let mut tape = Tape::<f32>::train(0);
        let mut fragments = Arc::<Fragments>::default();
        // The positions turn back and forth, so that sizes do not stay the same.
        let turns = [0.0, 0.1, 0.2].map(positions);
        for step in 0..40 {
            let before = ALLOCATOR.blocks();
            let values = &turns[step % 3];
            let view = values.view().into_dimensionality().unwrap();
            rasterize_into(view, &faces, &settings, &mut fragments);
            let projected = tape.leaf(values.clone());
            let attributes = tape.leaf(colours.clone());
            let colour = interpolate(projected, attributes, &fragments);
            let uv = interpolate(projected, attributes.slice_axis(1, 0..2), &fragments);
            let texels = tape.leaf(image.clone());
            let loss = colour.square().mean()
                + soft_silhouette(projected, &fragments).square().mean()
                + antialiased_silhouette(projected, &fragments).square().mean()
                + depth(projected, &fragments, 0.0).square().mean()
                + texture(uv, texels, &fragments).square().mean();
            let gradients = loss.backward();
            assert!(gradients.wrt(projected).is_some() && gradients.wrt(texels).is_some());
            drop(gradients);
            tape.reset();
            let fresh = ALLOCATOR.blocks() - before;
            assert!(step < 9 || fresh == 0, "step {step} took {fresh} large blocks");
        }
    });
}
