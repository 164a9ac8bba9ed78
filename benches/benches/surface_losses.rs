//! Regularisers of a mesh and losses of images, forward and backward.
//!
//! What the peers need for the same, two threads: PyTorch3D 0.7.9 on icosphere 4 with its topology cached,
//! edge length 0.8 ms, Laplacian 1.5 ms, normal consistency 5 ms; scikit-image 10 ms for the structural
//! similarity of one image of 256 x 256, forward only.

use std::hint::black_box;

use autodiff_lite::{Tape, Tensor, Var};
use benches::{criterion, numbers, pool};
use criterion::{BenchmarkGroup, measurement::WallTime};
use mesh_core::{Topology, primitives};
use ndarray::{Array2, Array4};

/// Times one step: inputs on the tape, the loss, its gradient, the tape emptied.
fn step(
    group: &mut BenchmarkGroup<'_, WallTime>,
    name: &str,
    values: &[Tensor],
    loss: impl for<'t> Fn(&[Var<'t>]) -> Var<'t> + Sync,
) {
    group.bench_function(format!("{name}/forward-backward/2t"), |bencher| {
        pool(2).install(|| {
            let mut tape = Tape::<f32>::train(0);
            bencher.iter(|| {
                {
                    let vars: Vec<_> = values.iter().map(|v| tape.leaf(v.clone())).collect();
                    black_box(loss(&vars).backward().wrt(vars[0]));
                }
                tape.reset();
            });
        });
    });
}

fn main() {
    let mut criterion = criterion();

    let ball = primitives::icosphere(4);
    let topology = Topology::new(ball.positions.len(), &ball.faces);
    let flat = ball.positions.as_flattened().to_vec();
    let positions = Array2::from_shape_vec((ball.positions.len(), 3), flat).expect("three each");
    let mesh = [positions.into()];
    let rings = &topology.vertex_vertices;
    let mut group = criterion.benchmark_group("surface/icosphere4");
    step(&mut group, "edge_length", &mesh, |x| losses::edge_length(x[0], &topology.edges, 0.0));
    step(&mut group, "laplacian_squared", &mesh, |x| losses::laplacian_squared(x[0], rings));
    step(&mut group, "laplacian_norm", &mesh, |x| losses::laplacian_norm(x[0], rings));
    step(&mut group, "face_angle", &mesh, |x| losses::face_angle(x[0], &topology));
    step(&mut group, "normal_consistency", &mesh, |x| losses::normal_consistency(x[0], &topology));
    step(&mut group, "vertex_normals", &mesh, |x| losses::vertex_normals(x[0], &ball.faces).sum());
    group.finish();

    let image = |seed| {
        let values =
            numbers(4 * 256 * 256 * 3, seed).into_iter().map(|v| 0.5 * (v + 1.0)).collect();
        let image = Array4::from_shape_vec((4, 256, 256, 3), values).expect("as many as that");
        image.into()
    };
    let images = [image(1), image(2)];
    let mut group = criterion.benchmark_group("images/4x256x256x3");
    step(&mut group, "l1", &images, |x| losses::l1(x[0], x[1].detach(), None));
    step(&mut group, "l2", &images, |x| losses::l2(x[0], x[1].detach(), None));
    step(&mut group, "ssim", &images, |x| losses::ssim_loss(x[0], x[1].detach()));
    step(&mut group, "mask_iou", &images, |x| losses::mask_iou(x[0], x[1].detach()));
    step(&mut group, "lab", &images, |x| {
        let [lab, target] = [x[0], x[1].detach()].map(losses::rgb_to_lab);
        losses::lab_lightness(lab, target, None) + losses::lab_color(lab, target, None)
    });
    step(&mut group, "pyramid", &images, |x| losses::pyramid(x[0], x[1].detach(), None, 4));
    group.finish();

    criterion.final_summary();
}
