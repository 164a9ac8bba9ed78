//! Memory of the mesh deformation fields: what an evaluation takes comes from the tape's pool.
#![allow(clippy::unwrap_used, reason = "tests")]

use autodiff_lite::testkit::CountingAllocator;
use autodiff_lite::{Activation, Module, SparseMatrix, Tape, Tensor, Var};
use ndarray::{Array3, Array4};
use nets::{Init, MapSampling};
use ode_deform::deform::{DeformationField, FieldConfig, StackedConfig, StackedField};
use ode_deform::solve::{EULER, Problem, StepController};
use ode_deform::{Adjoint, VectorField};

#[global_allocator]
static ALLOCATOR: CountingAllocator = CountingAllocator::new();

/// More than a page of numbers for each column of a state.
const VERTICES: usize = 1500;
const CHANNELS: usize = 4;

fn ring() -> SparseMatrix {
    let entries: Vec<_> = (0..VERTICES).map(|i| (i, (i + 1) % VERTICES, 0.5)).collect();
    SparseMatrix::from_triplets(VERTICES, VERTICES, &entries).unwrap()
}

/// Large blocks that the third training step on a tape takes.
fn third_step<V: VectorField>(
    field: &V,
    augment_dim: usize,
    steps: usize,
    read: impl for<'t> Fn(&V, Var<'t>) -> Var<'t>,
) -> usize {
    let problem =
        Problem::new([0.0, 1.0], &EULER, StepController::Fixed { step: 1.0 / steps as f64 });
    let at = |(_, i, k): (usize, usize, usize)| ((i * 7 + k) as f32 * 0.37).sin() * 0.3;
    let start = Tensor::from(Array3::from_shape_fn((1, VERTICES, 3 + augment_dim), at));
    let rows = [[2.0, 0.0, 0.0, 0.0], [0.0, 2.0, 0.0, 0.0], [0.0, 0.0, -1.0, 2.5]];
    let camera = Tensor::from(Array3::from_shape_fn((1, 3, 4), |(_, i, j)| rows[i][j]));
    let map = Tensor::from(Array4::from_shape_fn((1, 8, 8, CHANNELS), |(_, i, j, c)| {
        ((i * 5 + j * 3 + c) as f32).cos()
    }));
    let mut tape = Tape::train(0);
    let mut blocks = 0;
    for _ in 0..3 {
        let before = ALLOCATOR.blocks();
        let inputs = [tape.constant(camera.clone()), read(field, tape.constant(map.clone()))];
        let flow =
            Adjoint::Checkpointed.integrate(field, tape.leaf(start.clone()), &inputs, &problem);
        drop(flow.unwrap().end.square().sum().backward());
        tape.reset();
        blocks = ALLOCATOR.blocks() - before;
    }
    blocks
}

/// One test, because the counter is that of the whole program.
#[test]
fn evaluations_take_no_fresh_memory() {
    let config = FieldConfig { time: 3, hidden: 8, ..FieldConfig::published(CHANNELS) };
    let mut field = DeformationField::new(&Init::new(0), config, ring());
    // The gradient of a weight is a product that the gemm crate packs, in memory of its own.
    field.set_trainable("", false);
    let counts = [2, 6].map(|steps| third_step(&field, 0, steps, |_, map| map));
    let config = StackedConfig {
        features: CHANNELS,
        feature_dim: 3,
        segments: 2,
        hidden: 8,
        augment_dim: 2,
        output_scale: 1.0,
        activation: Activation::Relu,
        sampling: MapSampling::Bilinear,
    };
    let mut field = StackedField::new(&Init::new(0), config, ring());
    field.set_trainable("", false);
    let stacked =
        [2, 6].map(|steps| third_step(&field, 2, steps, |field, map| field.read(&[map])[0]));
    assert_eq!((counts, stacked), ([0; 2], [0; 2]), "large blocks of two steps and of six");
}
