//! Trains the small encoder from scratch to tell where a disc lies and how large it is.
//!
//! `cargo run --release -p unsphere-nets --example 01_train_encoder`

#![allow(clippy::print_stdout, reason = "an example")]

use autodiff_lite::optim::Adam;
use autodiff_lite::{Activation, Tape, Var, impl_module};
use ndarray::{ArcArray, Array2, Array4, Ix2, Ix4};
use nets::{Init, Mlp, SmallCnn};

struct Model {
    encoder: SmallCnn,
    head: Mlp,
}
impl_module!(Model: f32 { encoder, head });

impl Model {
    fn new(seed: u64) -> Self {
        let init = Init::new(seed);
        Self {
            encoder: SmallCnn::new(&init.at("encoder"), 1, 64),
            head: Mlp::new(&init.at("head"), &[64, 64, 3], Activation::Relu),
        }
    }

    fn forward<'t>(&self, images: Var<'t>) -> Var<'t> {
        self.head.forward(self.encoder.forward(images))
    }
}

const SIZE: usize = 32;

/// Discs on a grid of centres and radii: images, and (x, y, radius) of each.
fn discs(count: usize, offset: f32) -> (ArcArray<f32, Ix4>, ArcArray<f32, Ix2>) {
    let truth = Array2::from_shape_fn((count, 3), |(n, k)| {
        let part = ((n as f32 + offset) * [0.618, 0.414, 0.732][k]).fract();
        if k == 2 { 0.1 + 0.2 * part } else { 0.3 + 0.4 * part }
    });
    let images = Array4::from_shape_fn((count, SIZE, SIZE, 1), |(n, i, j, _)| {
        let at = |k: usize| (k as f32 + 0.5) / SIZE as f32;
        let distance = (at(j) - truth[[n, 0]]).hypot(at(i) - truth[[n, 1]]);
        f32::from(distance < truth[[n, 2]])
    });
    (images.into_shared(), truth.into_shared())
}

fn main() {
    let mut model = Model::new(0);
    let mut adam = Adam::new(2e-3);
    let mut tape = Tape::train(0);
    for step in 0..200 {
        let (images, truth) = discs(16, (16 * step) as f32);
        let error = model.forward(tape.constant(images)) - tape.constant(truth);
        let loss = error.square().mean();
        if step % 40 == 0 {
            println!("step {step:3}  loss {:.5}", loss.item());
        }
        let gradients = loss.backward();
        tape.reset();
        adam.step(&mut model, &gradients);
    }
    let (images, truth) = discs(64, 0.5);
    let tape = Tape::eval();
    let error = (model.forward(tape.constant(images)) - tape.constant(truth)).abs().mean();
    println!("unseen discs: mean error {:.4} of the image's side", error.item());
}
