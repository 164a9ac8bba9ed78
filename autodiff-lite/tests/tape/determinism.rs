//! The same seed gives the same bits on one, two and three threads.

use autodiff_lite::optim::Adam;
use autodiff_lite::state::State;
use autodiff_lite::{Param, Tape, impl_module};
use ndarray::{Array1, Array2};

struct Model {
    positions: Param,
    scale: Param,
}
impl_module!(Model: f32 { positions, scale });

/// Arrays above the sizes from which threads are used.
fn train(threads: usize) -> Vec<u8> {
    let rows = 70_000;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let mut tape = Tape::train(0);
    let mut model = Model {
        positions: Param::new(Array2::from_shape_fn((rows, 3), |(i, k)| {
            ((i * 3 + k) as f32 * 0.001).sin()
        })),
        scale: Param::new(Array1::ones(3)),
    };
    let mut adam = Adam::new(0.01);
    let indices: Vec<u32> = (0..rows as u32).map(|k| k * 7919 % rows as u32).collect();
    pool.install(|| {
        for step in 0..3 {
            tape.reseed(step);
            let x = tape.param(&model.positions);
            let s = tape.param(&model.scale);
            let length = (x * x).sum_axis(1).add_scalar(1e-3).sqrt().reshape(&[rows, 1]);
            let y = (x / length * s).gather_rows(&indices).exp().dropout(0.1);
            let y = tape.concat(&[y, x.tanh()], 1).permute(&[1, 0]);
            let loss = y.mean() + y.mean_axis(1).square().sum() + y.max_axis(0).mean();
            let gradients = loss.backward();
            tape.reset();
            adam.step(&mut model, &gradients);
        }
    });
    let mut state = State::new();
    state.add_module("", &model);
    state.add_optimizer(&adam);
    state.to_bytes()
}

#[test]
fn threads_do_not_change_results() {
    let one = train(1);
    for threads in [2, 3] {
        assert!(train(threads) == one, "{threads} threads give other bits than one");
    }
}
