//! The rasteriser: visibility, three interpolated channels and the soft silhouette, forward and
//! backward, on two threads inside one pool.

use std::hint::black_box;
use std::sync::Arc;

use autodiff_lite::{Tape, Tensor};
use benches::{criterion, pool, yardsticks};
use criterion::BenchmarkId;
use diff_raster::{
    Faces, Fragments, Frame, Paint, Renderer, Scratch, Settings, SoftRas, SoftRasSettings, softras,
};
use mesh_core::primitives::icosphere;
use ndarray::Array3;

/// A sphere that covers about 60 % of the image, seen by a perspective camera, with its normals as
/// colours.
struct Scene {
    positions: Tensor<f32>,
    colors: Tensor<f32>,
    renderer: Renderer,
    grads: [Tensor<f32>; 2],
}

impl Scene {
    fn new(level: u32, size: usize, images: usize) -> Self {
        let mesh = icosphere(level);
        let count = mesh.positions.len();
        let (distance, focal) = (4.0, 3.4);
        let positions = Array3::from_shape_fn((images, count, 3), |(n, v, k)| {
            // Each image from another side, so that no two are the same work.
            let [x, y, z] = mesh.positions[v];
            let (sin, cos) = (0.3 + n as f32).sin_cos();
            let depth = distance - (z * cos - x * sin);
            [(x * cos + z * sin) * focal / depth, y * focal / depth, depth][k]
        });
        let colors = ndarray::Array2::from_shape_fn((count, 3), |(v, k)| mesh.positions[v][k]);
        let faces = Faces::of(&mesh).expect("an icosphere is sound");
        let color_grad = ndarray::Array4::from_elem((images, size, size, 3), 0.01_f32);
        let mask_grad = Array3::from_elem((images, size, size), 0.02_f32);
        Self {
            positions: positions.into(),
            colors: colors.into(),
            renderer: Renderer::new(Arc::new(faces), Settings::new(size, size)),
            grads: [color_grad.into(), mask_grad.into()],
        }
    }

    fn step(&self, tape: &mut Tape<f32>, backward: bool) {
        let frame = self.renderer.frame(tape.leaf(self.positions.clone()));
        let image = frame.interpolate(tape.leaf(self.colors.clone()));
        let mask = frame.soft_silhouette();
        if backward {
            black_box(image.backward_with(self.grads[0].clone()));
            black_box(mask.backward_with(self.grads[1].clone()));
        }
        tape.reset();
    }

    fn clouds(&self, tape: &mut Tape<f32>, renderer: &Arc<SoftRas>) {
        let projected = tape.leaf(self.positions.clone());
        let ones = tape.constant(Array3::ones((projected.shape()[0], 1, 1)));
        let colors = tape.leaf(self.colors.clone()).insert_axis(0).mul(ones);
        let image = softras(projected, Some(Paint::Vertices(colors)), renderer);
        black_box(image.backward_with(image.value()));
        tape.reset();
    }

    fn border(&self, tape: &mut Tape<f32>, fragments: &Arc<Fragments>, scratch: &Scratch) {
        let projected = tape.leaf(self.positions.clone());
        let frame = Frame::new(projected, Arc::clone(fragments), scratch.clone());
        let mask = frame.antialiased_silhouette();
        black_box(mask.backward_with(self.grads[1].clone()));
        tape.reset();
    }
}

fn main() {
    let mut criterion = criterion();
    yardsticks(&mut criterion, "raster");
    let pool = pool(2);
    let mut group = criterion.benchmark_group("raster");
    for (level, size, images) in [(4, 256, 1), (5, 512, 1), (4, 256, 4)] {
        let scene = Scene::new(level, size, images);
        let name = format!("icosphere-{level}-{size}-batch-{images}");
        for (what, backward) in [("forward", false), ("forward-backward", true)] {
            group.bench_function(BenchmarkId::new(what, &name), |bencher| {
                pool.install(|| {
                    let mut tape = Tape::train(0);
                    bencher.iter(|| scene.step(&mut tape, backward));
                });
            });
        }
        group.bench_function(BenchmarkId::new("antialiased-silhouette", &name), |bencher| {
            pool.install(|| {
                let (mut tape, scratch) = (Tape::train(0), Scratch::default());
                let frame = scene.renderer.frame(tape.constant(scene.positions.clone()));
                let fragments = Arc::clone(frame.fragments());
                tape.reset();
                bencher.iter(|| scene.border(&mut tape, &fragments, &scratch));
            });
        });
        group.bench_function(BenchmarkId::new("softras-forward-backward", &name), |bencher| {
            pool.install(|| {
                let settings = SoftRasSettings::published(size, size);
                let renderer = SoftRas::new(scene.renderer.faces(), &settings);
                let mut tape = Tape::train(0);
                bencher.iter(|| scene.clouds(&mut tape, &renderer));
            });
        });
    }
    group.finish();
    criterion.final_summary();
}
