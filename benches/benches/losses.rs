//! Chamfer distance with normals between a mesh's vertices and a cloud of points.

use std::hint::black_box;

use autodiff_lite::{Tape, Tensor};
use benches::{criterion, pool, sphere_points, yardsticks};
use losses::{Directions, Matches, chamfer_distance, chamfer_normals};

fn main() {
    let mut criterion = criterion();
    yardsticks(&mut criterion, "chamfer");
    let mut group = criterion.benchmark_group("chamfer");
    let (p, q) = (2466, 9000);
    let [x, y] = [(p, 1), (q, 2)].map(|(n, seed)| Tensor::from(sphere_points(n, seed)));
    let pool = pool(2);

    group.bench_function(format!("{p}x{q}/nearest/2t"), |bencher| {
        pool.install(|| {
            // A tape stays on its thread, so it is made here.
            let tape = Tape::<f32>::eval();
            let (x, y) = (tape.constant(x.clone()), tape.constant(y.clone()));
            let mut matches = Matches::default();
            bencher.iter(|| matches.find(black_box(x), black_box(y)));
        });
    });

    group.bench_function(format!("{p}x{q}/forward-backward/2t"), |bencher| {
        pool.install(|| {
            let mut tape = Tape::<f32>::train(0);
            let mut matches = Matches::default();
            bencher.iter(|| {
                {
                    // On a unit sphere a point is its own normal.
                    let (a, normals_a) = (tape.leaf(x.clone()), tape.leaf(x.clone()));
                    let (b, normals_b) = (tape.constant(y.clone()), tape.constant(y.clone()));
                    matches.find(a, b);
                    let both = Directions::default();
                    let loss = chamfer_distance(a, b, &matches, both)
                        .add(chamfer_normals(normals_a, normals_b, &matches, both));
                    black_box(loss.backward().wrt(a));
                }
                tape.reset();
            });
        });
    });
    group.finish();
    criterion.final_summary();
}
