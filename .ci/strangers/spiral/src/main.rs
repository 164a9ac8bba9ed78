//! A spiral, learned from its points by a neural ODE whose gradient takes as much memory for 400 steps as for 40.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use ode_deform::autodiff_lite::{Activation, Tape, Var, optim::Adam};
use ode_deform::ndarray::Array2;
use ode_deform::nets::{Init, Mlp};
use ode_deform::solve::{DOPRI5, Problem, RK4, SolveError, StepController, solve};
use ode_deform::{Adjoint, field_fn};

static HELD: [AtomicUsize; 2] = [AtomicUsize::new(0), AtomicUsize::new(0)]; // now, and at most
struct Counting;
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        HELD[1].fetch_max(HELD[0].fetch_add(layout.size(), Relaxed) + layout.size(), Relaxed);
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, at: *mut u8, layout: Layout) {
        HELD[0].fetch_sub(layout.size(), Relaxed);
        unsafe { System.dealloc(at, layout) }
    }
}
#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn main() -> Result<(), SolveError> {
    // 64 points of the curve dy/dt = A y³, and where they are a tenth of a second later.
    let truth = |_: f64, y: &[f64; 2]| {
        let [x, y] = y.map(|v| v.powi(3));
        [-0.1 * x - 2.0 * y, 2.0 * x - 0.1 * y]
    };
    let problem = Problem::new([0.0, 6.5], &DOPRI5, StepController::adaptive(1e-9, 1e-9));
    let problem = problem.save_at((0..65).map(|i| 0.1 * f64::from(i)));
    let curve = solve(truth, [2.0, 0.0], &problem)?.states;
    let at = |first: usize| Array2::from_shape_fn((64, 2), |(i, k)| curve[first + i][k] as f32);

    let mlp = Mlp::new(&Init::new(0), &[2, 32, 2], Activation::Tanh);
    let mut field = field_fn(mlp, |mlp: &Mlp, _, y: Var<'_>, _| mlp.forward(y * y * y));
    let (mut adam, mut losses, mut peaks) = (Adam::new(0.01), Vec::new(), Vec::new());
    for (steps, rounds) in [(40.0, 1), (400.0, 1), (4.0, 600)] {
        let problem = Problem::new([0.0, 0.1], &RK4, StepController::Fixed { step: 0.1 / steps });
        let (mut tape, before) = (Tape::train(0), HELD[0].load(Relaxed));
        HELD[1].store(before, Relaxed);
        for _ in 0..rounds {
            let flow = Adjoint::Backsolve.integrate(&field, tape.constant(at(0)), &[], &problem)?;
            let loss = (flow.end - tape.constant(at(1))).square().mean();
            losses.push(loss.item());
            let gradients = loss.backward();
            tape.reset();
            adam.step(field.module_mut(), &gradients);
        }
        peaks.push(HELD[1].load(Relaxed) - before);
    }
    println!("loss {:?} -> {:?}", losses[0], losses[601]);
    eprintln!("at most {} bytes for 40 steps, {} for 400", peaks[0], peaks[1]);
    assert!(losses[601] < 0.02 * losses[0] && peaks[1] < peaks[0] + peaks[0] / 8);
    Ok(())
}
