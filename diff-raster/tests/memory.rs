//! A step in the steady state takes no fresh memory worth a page.
#![allow(clippy::unwrap_used, reason = "tests")]

use std::sync::Arc;

use autodiff_lite::testkit::CountingAllocator;
use autodiff_lite::{Tape, Tensor};
use diff_raster::{Faces, Fragments, Renderer, Scratch, Settings, rasterize_into};
use mesh_core::primitives::icosphere;
use ndarray::{Array2, Array3};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator::new();

#[test]
fn steps_recycle_their_memory() {
    let mesh = icosphere(3);
    let faces = Arc::new(Faces::of(&mesh).unwrap());
    let (images, size, vertices) = (2, 96, mesh.positions.len());
    let renderer = Renderer::new(faces, Settings::new(size, size));
    let positions = |turn: f32| -> Tensor<f32> {
        let corner = |(n, v, k): (usize, usize, usize)| {
            let ([x, y, z], (sin, cos)) = (mesh.positions[v], (turn + n as f32).sin_cos());
            let depth = 4.0 - z * cos + x * sin;
            [(x * cos + z * sin) * 3.0 / depth, y * 3.0 / depth, depth][k]
        };
        Array3::from_shape_fn((images, vertices, 3), corner).into()
    };
    let colors: Tensor<f32> =
        Array2::from_shape_fn((vertices, 3), |(v, k)| mesh.positions[v][k]).into();
    let image: Tensor<f32> = Array3::from_elem((32, 32, 3), 0.5).into();

    // One thread: which task finds spare scratch is then the same in every step.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        let mut tape = Tape::<f32>::train(0);
        // The positions turn back and forth, so that sizes do not stay the same.
        let turns = [0.0, 0.1, 0.2].map(positions);
        for step in 0..40 {
            let before = ALLOCATOR.blocks();
            let values = &turns[step % 3];
            let projected = tape.leaf(values.clone());
            let attributes = tape.leaf(colors.clone());
            let frame = renderer.frame(projected);
            let color = frame.interpolate(attributes);
            let uv = frame.interpolate(attributes.slice_axis(1, 0..2));
            let texels = tape.leaf(image.clone());
            let loss = color.square().mean()
                + frame.soft_silhouette().square().mean()
                + frame.antialiased_silhouette().square().mean()
                + frame.depth(0.0).square().mean()
                + frame.texture(uv, texels).square().mean();
            let gradients = loss.backward();
            assert!(gradients.wrt(projected).is_some() && gradients.wrt(texels).is_some());
            drop((gradients, frame));
            tape.reset();
            let fresh = ALLOCATOR.blocks() - before;
            assert!(step < 9 || fresh == 0, "step {step} took {fresh} large blocks");
        }
        // And without a tape.
        let (scratch, mut fragments) = (Scratch::default(), Fragments::default());
        for step in 0..9 {
            let before = ALLOCATOR.blocks();
            let view = turns[step % 3].view().into_dimensionality().unwrap();
            let (faces, settings) = (renderer.faces(), renderer.settings());
            rasterize_into(view, faces, settings, &scratch, &mut fragments);
            let fresh = ALLOCATOR.blocks() - before;
            assert!(step < 6 || fresh == 0, "drawing {step} took {fresh} large blocks");
        }
    });
}
