//! Geometry without gradients: nearest neighbours, diffusion, topology, health.

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use mesh_core::{
    DiffusionSolver, EmptyGrid, ImproveOptions, NearestScratch, Topology, VoxelGrid, cubify,
    improve, nearest_both_into, primitives, sample_points, simplify,
};

/// Both directions of a Chamfer distance, sizes of Pixel2Mesh's last level and its ground truth.
fn nearest(c: &mut Criterion) {
    let mesh = primitives::pixel2mesh_ellipsoid(2);
    let mut group = c.benchmark_group("mesh/nearest");
    for (n, m) in [(2466, 2466), (2466, 9000), (10_000, 10_000)] {
        let (a, b) = (sample_points(&mesh, n, 1).0, sample_points(&mesh, m, 2).0);
        let mut scratch = NearestScratch::default();
        let (mut a_to_b, mut b_to_a) = (Vec::new(), Vec::new());
        group.bench_function(format!("{n}x{m}"), |bench| {
            bench.iter(|| {
                nearest_both_into(&a, &b, &mut scratch, &mut a_to_b, &mut b_to_a);
                black_box((&a_to_b, &b_to_a));
            });
        });
    }
    group.finish();
}

/// One preconditioned step: a rough right-hand side from nothing, and a small change from a guess.
fn diffusion(c: &mut Criterion) {
    let mut group = c.benchmark_group("mesh/diffusion");
    for level in [4, 5] {
        let mesh = primitives::icosphere(level);
        let topology = Topology::new(mesh.positions.len(), &mesh.faces);
        group.bench_function(format!("icosphere{level}/factor"), |bench| {
            bench.iter(|| black_box(DiffusionSolver::factored(&topology, 20.0)));
        });
        let rough: Vec<[f32; 3]> = (0..mesh.positions.len())
            .map(|i| {
                std::array::from_fn(|k| ((i * 7919 + k * 104_729) % 1009) as f32 / 500.0 - 1.0)
            })
            .collect();
        let mut u = mesh.positions.clone();
        DiffusionSolver::new(&topology, 20.0).apply(&mesh.positions, &mut u);
        for (u, r) in u.iter_mut().zip(&rough) {
            for k in 0..3 {
                u[k] += 0.003 * r[k];
            }
        }
        let mut x = rough.clone();
        for (kind, mut solver) in [
            ("diagonal", DiffusionSolver::new(&topology, 20.0)),
            ("factored", DiffusionSolver::factored(&topology, 20.0)),
        ] {
            group.bench_function(format!("icosphere{level}/{kind}/cold"), |bench| {
                bench.iter(|| {
                    x.fill([0.0; 3]);
                    black_box(solver.solve(&rough, &mut x, 1e-4, 500))
                });
            });
            group.bench_function(format!("icosphere{level}/{kind}/warm"), |bench| {
                bench.iter(|| {
                    x.copy_from_slice(&mesh.positions);
                    black_box(solver.solve(&u, &mut x, 1e-5, 500))
                });
            });
        }
    }
    group.finish();
}

fn topology(c: &mut Criterion) {
    let mut group = c.benchmark_group("mesh");
    for level in [4, 5] {
        let mesh = primitives::icosphere(level);
        group.bench_function(format!("topology/icosphere{level}"), |bench| {
            bench.iter(|| black_box(Topology::new(mesh.positions.len(), &mesh.faces)));
        });
        group.bench_function(format!("health/icosphere{level}"), |bench| {
            bench.iter(|| black_box(mesh.health()));
        });
        group.bench_function(format!("self_intersections/icosphere{level}"), |bench| {
            bench.iter(|| black_box(mesh.self_intersections()));
        });
    }
    let pressed = primitives::icosphere(4).scaled([0.2, 1.0, 1.0]);
    group.bench_function("improve/icosphere4", |bench| {
        bench.iter(|| {
            let mut mesh = pressed.clone();
            black_box(improve(&mut mesh, &ImproveOptions::default()))
        });
    });
    let fine = primitives::icosphere(5);
    group.bench_function("simplify/icosphere5", |bench| {
        bench.iter(|| black_box(simplify(&fine, fine.faces.len() / 10)));
    });
    group.finish();
}

/// The grids that PyTorch3D's cubify was measured on: a ball, and cells at random, three tenths of them.
fn voxels(c: &mut Criterion) {
    let mut group = c.benchmark_group("mesh/cubify");
    let mut ball = VoxelGrid::new([48; 3], ([-1.0; 3], [1.0; 3]));
    for i in 0..ball.bits.len() {
        let middle = ball.center([i % 48, i / 48 % 48, i / (48 * 48)]);
        ball.bits[i] = middle.iter().map(|x| x * x).sum::<f32>() < 0.81;
    }
    let mut random = ball.clone();
    for (i, bit) in random.bits.iter_mut().enumerate() {
        *bit = (i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15).rotate_left(23) % 10 < 3;
    }
    for (name, grid) in [("ball48", ball), ("random48", random)] {
        group.bench_function(name, |bench| {
            bench.iter(|| black_box(cubify(black_box(&grid), EmptyGrid::Nothing)));
        });
    }
    group.finish();
}

criterion_group! {
    name = mesh;
    config = Criterion::default().sample_size(20);
    targets = nearest, diffusion, topology, voxels
}
criterion_main!(mesh);
