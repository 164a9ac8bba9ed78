//! What the benches share: thread pools, plain data, and how long to measure.
//!
//! Ids end with the number of threads (`1t`, `2t`) and are the same as those of `peers/peers.py`, so
//! that `peers/run.sh` can put the two side by side. Run one with
//! `cargo bench -p unsphere-benches --bench raster`.

pub mod gate;
mod training_step;
pub mod workspace;
mod yardstick;

use std::time::Duration;

use criterion::Criterion;
use rayon::{ThreadPool, ThreadPoolBuilder};

pub use training_step::TrainingStep;
pub use yardstick::yardsticks;

/// Short runs: medians of twenty samples over two seconds.
pub fn criterion() -> Criterion {
    Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_millis(500))
        .measurement_time(Duration::from_secs(2))
        .configure_from_args()
}

/// A pool of this many threads; `install` in it once around the whole measurement.
pub fn pool(threads: usize) -> ThreadPool {
    ThreadPoolBuilder::new().num_threads(threads).build().expect("the system has threads to give")
}

/// Numbers in `[-1, 1)` that look random and are the same every time.
pub fn numbers(count: usize, seed: u32) -> Vec<f32> {
    let mut state = seed.wrapping_mul(2_654_435_769) | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        (state >> 8) as f32 / (1 << 23) as f32 - 1.0
    };
    (0..count).map(|_| next()).collect()
}

/// Points on the unit sphere, `[count, 3]`.
pub fn sphere_points(count: usize, seed: u32) -> ndarray::Array2<f32> {
    let mut points = ndarray::Array2::from_shape_vec((count, 3), numbers(3 * count, seed))
        .expect("three numbers for each point");
    for mut p in points.rows_mut() {
        let length = p.dot(&p).sqrt().max(1e-6);
        p /= length;
    }
    points
}
