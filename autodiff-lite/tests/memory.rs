//! The steady state of a training loop takes no fresh block of 4 KiB or more.
#![allow(clippy::unwrap_used, reason = "tests")]

use autodiff_lite::optim::{AdamW, clip_grad_norm};
use autodiff_lite::testkit::CountingAllocator;
use autodiff_lite::{
    Activation, Backward, BufferUpdate, ConvGeometry, Param, PoolGeometry, Tape, Var, impl_module,
};
use ndarray::{Array1, Array2, ArrayD};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator::new();

const ROWS: usize = 600;
const WIDTH: usize = 16;

struct Model {
    weights: Vec<Param>,
    mean: Param,
}
impl_module!(Model: f32 { weights, mean });

impl Model {
    fn loss<'t>(&self, tape: &'t Tape, x: Var<'t>, faces: &[u32]) -> Var<'t> {
        let mut y = x;
        for (k, weight) in self.weights.iter().enumerate() {
            let w = tape.param(weight);
            y = match k % 3 {
                0 => (y * w).tanh(),
                1 => (y + w).sigmoid() - y,
                _ => (w.exp() * y).maximum(x),
            };
        }
        let mut seen = tape.buffer(self.mean.len());
        seen.copy_from_slice(y.value().as_slice());
        tape.push_update(BufferUpdate::new(&self.mean, seen, 0.1));
        let y = y.dropout(0.1);
        let picked = y.gather_rows(faces).scatter_add_rows(faces, ROWS);
        let joined = tape.concat(&[picked, y.slice_axis(1, 0..WIDTH)], 1);
        let turned = joined.permute(&[1, 0]).reshape(&[2 * WIDTH * ROWS]);
        let far = tape.lincomb(&[(0.5, turned), (0.25, turned)]).square();
        let own = tape.record_fn(
            "twice",
            &[far],
            {
                let mut out = tape.pool().copy(&far.value());
                out.as_slice_mut().iter_mut().for_each(|x| *x *= 2.0);
                out
            },
            |cx: &mut Backward<'_, f32>| {
                let scratch = cx.scratch(cx.output().len());
                drop(scratch);
                let mut g = cx.take_grad_out();
                g.as_slice_mut().iter_mut().for_each(|g| *g *= 2.0);
                cx.give(0, g);
            },
        );
        let tables = y.reshape(&[ROWS / 2, 2, WIDTH]);
        let part = tables.max_axis(1).sum() + tables.mean_axis(0).sum() + tables.sum_axis(2).mean();
        own.mean() + part
    }
}

struct Network {
    conv: [Param; 2],
    norm: [Param; 2],
    head: [Param; 2],
    mean: Param,
}
impl_module!(Network: f32 { conv, norm, head, mean });

impl Network {
    fn new() -> Self {
        let wave = |shape: &[usize]| {
            let n = shape.iter().product::<usize>();
            let values = (0..n).map(|k| (k as f32 * 0.7).sin() * 0.1).collect();
            Param::new(ArrayD::from_shape_vec(shape, values).unwrap())
        };
        Self {
            conv: [wave(&[32, 16, 3, 3]), wave(&[32, 32, 3, 3])],
            norm: [wave(&[32]), wave(&[32])],
            head: [wave(&[300, 32]), wave(&[300])],
            mean: Param::buffer(Array1::zeros(32)),
        }
    }

    fn loss<'t>(&self, tape: &'t Tape, x: Var<'t>, with_head: bool) -> Var<'t> {
        let (same, half) = (ConvGeometry::new().padding(1), ConvGeometry::new().stride(2));
        let x = x.conv2d(tape.param(&self.conv[0]), None, same, Activation::Relu);
        let [w, b] = self.norm.each_ref().map(|p| tape.param(p));
        let (x, statistics) = x.batch_norm(w, b, 1e-5, Activation::Relu);
        tape.push_update(BufferUpdate::new(&self.mean, statistics.mean, 0.1));
        let x = x.max_pool2d(PoolGeometry::square(2));
        let x = x.conv2d(tape.param(&self.conv[1]), Some(b), half, Activation::LeakyRelu(0.1));
        let x = x.resize_bilinear(9, 9, false).layer_norm(w, b, 1e-5, Activation::None);
        let x = x.mean_axis(1).mean_axis(1);
        if !with_head {
            return x.softmax().square().mean();
        }
        let [w, b] = self.head.each_ref().map(|p| tape.param(p));
        let y = x.linear(w, Some(b), Activation::Sigmoid).log_softmax();
        y.matmul_transposed(y, [true, false]).square().mean()
    }
}

/// Runs `step` 40 times and counts the large blocks of the last 25.
fn large_blocks(mut step: impl FnMut(u64)) -> (usize, usize) {
    let mut before = (0, 0);
    for k in 0..40 {
        if k == 15 {
            before = (ALLOCATOR.blocks(), ALLOCATOR.bytes());
        }
        step(k);
    }
    (ALLOCATOR.blocks() - before.0, ALLOCATOR.bytes() - before.1)
}

/// One test, because the counters are those of the whole program.
#[test]
fn the_steady_state_allocates_no_large_block() {
    elementwise_and_layout();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    pool.install(|| {
        assert_eq!(wide_norms(), (0, 0), "large blocks and bytes of norms, in 25 steps");
        let (taken, bytes) = network(false);
        assert_eq!(taken, 0, "large blocks of a convolutional network ({bytes} bytes in 25 steps)");
        // For each matrix product the gemm crate takes a packing buffer of its own (some 270 KB)
        // and gives it back; nothing else may be taken.
        let (taken, bytes) = network(true);
        assert!(taken <= 3 * 25, "{taken} large blocks, {bytes} bytes in 25 steps");
    });
}

fn network(with_head: bool) -> (usize, usize) {
    let mut network = Network::new();
    let mut adam = AdamW::new(1e-3);
    let mut tape = Tape::train(0);
    let input = ArrayD::<f32>::from_elem(vec![2, 24, 24, 16], 0.5).into_shared();
    large_blocks(|_| {
        let loss = network.loss(&tape, tape.constant(input.clone()), with_head);
        assert!(loss.item().is_finite());
        let gradients = loss.backward();
        let updates = tape.take_updates();
        tape.reset();
        updates.apply(&mut network);
        adam.step(&mut network, &gradients);
    })
}

/// Channels of which a number each is more than a page.
fn wide_norms() -> (usize, usize) {
    const CHANNELS: usize = 2048;
    let operands = [1.0, 0.0].map(|x| Param::new(Array1::<f32>::from_elem(CHANNELS, x)));
    let x = Array2::from_shape_fn((40, CHANNELS), |(i, j)| ((i * 7 + j) as f32).sin());
    let (mut tape, x) = (Tape::train(0), x.into_shared());
    large_blocks(|_| {
        let [w, b] = operands.each_ref().map(|p| tape.param(p));
        let x = tape.leaf(x.clone());
        let (y, statistics) = x.batch_norm(w, b, 1e-5, Activation::Relu);
        let y = y.layer_norm(w, b, 1e-5, Activation::None);
        let y = y.group_norm(4, w, b, 1e-5, Activation::Tanh);
        drop((y.square().mean().backward(), statistics));
        tape.reset();
    })
}

fn elementwise_and_layout() {
    // Many parameters: vectors of nodes, slots and gradients are pages themselves.
    let weights: Vec<_> = (0..120)
        .map(|k| Param::new(Array2::from_elem((ROWS, WIDTH), (k as f32).sin() * 0.1)))
        .collect();
    let addresses: Vec<_> = weights.iter().map(|w| w.value.as_ptr()).collect();
    let mean = Param::buffer(Array1::zeros(ROWS * WIDTH));
    let mut model = Model { weights, mean };
    let mut adam = AdamW::new(1e-3);
    let mut tape = Tape::train(0);
    let input = Array2::<f32>::from_elem((ROWS, WIDTH), 0.5).into_shared();
    let faces: Vec<u32> = (0..2000).map(|k| (k * 7 % ROWS) as u32).collect();
    let taken = large_blocks(|step| {
        tape.reseed(step);
        let loss = model.loss(&tape, tape.constant(input.clone()), &faces);
        assert!(loss.item().is_finite());
        let mut gradients = loss.backward();
        let updates = tape.take_updates();
        tape.reset();
        updates.apply(&mut model);
        clip_grad_norm(&mut gradients, 10.0);
        adam.step(&mut model, &gradients);
    });
    assert_eq!(taken, (0, 0), "large blocks and bytes, in 25 steps");
    for (weight, address) in model.weights.iter().zip(addresses) {
        assert_eq!(weight.value.as_ptr(), address, "parameters are written in place");
    }
}
