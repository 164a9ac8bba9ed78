//! The steady state of a training step takes no fresh block of 4 KiB or more, and its bits do not
//! depend on the number of threads.
#![allow(clippy::unwrap_used, reason = "tests")]

use autodiff_lite::optim::Adam;
use autodiff_lite::state::State;
use autodiff_lite::testkit::CountingAllocator;
use autodiff_lite::{Tape, Tensor, impl_module};
use ndarray::ArrayD;
use nets::{Init, Linear, TransformerConfig, TransformerEncoderLayer, Vgg16};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator::new();

/// The first blocks of VGG16, and attention over its pixels.
struct Model {
    vgg: Vgg16,
    inner: Linear,
    encoder: TransformerEncoderLayer,
}
impl_module!(Model: f32 { vgg, inner, encoder });

const STEPS: u64 = 12;

/// Trains a few steps; the bits of all weights and moments, and the large blocks of the last steps.
fn train(threads: usize) -> (Vec<u8>, usize) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    let init = Init::new(5);
    let config = TransformerConfig { hidden: 96, ..TransformerConfig::new(64, 4) };
    let mut model = Model {
        vgg: Vgg16::features_until_pool(&init.at("vgg"), 2),
        inner: Linear::new(&init.at("inner"), 128, 64),
        encoder: TransformerEncoderLayer::new(&init.at("encoder"), &config),
    };
    let image: Tensor = ArrayD::from_shape_fn(vec![3, 32, 32, 3], |at| {
        ((at[0] * 31 + at[1] * 7 + at[2] * 13 + at[3]) as f32 * 0.1).sin()
    })
    .into();
    let (mut tape, mut adam) = (Tape::train(0), Adam::new(1e-3));
    let mut before = 0;
    pool.install(|| {
        for step in 0..STEPS {
            if step == STEPS / 2 {
                before = ALLOCATOR.blocks();
            }
            tape.reseed(step);
            let maps = model.vgg.forward_features(tape.constant(image.clone()));
            let tokens = model.inner.forward(maps.reshape(&[3, 64, 128]));
            let loss = model.encoder.forward(tokens, None).square().mean();
            let gradients = loss.backward();
            tape.reset();
            adam.step(&mut model, &gradients);
        }
    });
    let fresh = ALLOCATOR.blocks() - before;
    let mut state = State::new();
    state.add_module("", &model);
    state.add_optimizer(&adam);
    (state.to_bytes(), fresh)
}

/// One test, because the counter is that of the whole program.
#[test]
fn steps_recycle_their_memory_and_threads_change_no_bit() {
    let (one, fresh) = train(1);
    // Each matrix product of the gemm crate takes a packing buffer and gives it back: 19 linear
    // products, and those of four heads.
    let products = (6 * 3 + 6 * 12) * (STEPS as usize / 2);
    assert!(fresh <= products, "{fresh} large blocks in {} steps", STEPS / 2);
    for threads in [2, 3] {
        assert!(train(threads).0 == one, "{threads} threads give other bits than one");
    }
}
