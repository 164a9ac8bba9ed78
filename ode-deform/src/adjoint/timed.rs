//! Time as a variable: fields that see it on the tape, and gradients with respect to the first and the last time.

use autodiff_lite::{Module, Real, Var, Visitor, VisitorMut};

use super::{Adjoint, Flow, VectorField};
use crate::solve::{Pid, Problem, SolveError, StepController};

/// `dy/dt = f(t, y; inputs)` on a tape, the time being a variable like the others.
///
/// What [`VectorField`] says of parameters and inputs holds here too.
pub trait TimedField<F: Real = f32>: Module<F> + Clone + Send + 'static {
    /// The derivative, on the tape of `y`.
    ///
    /// # Shapes
    /// `t []`, the time; `y`: any, `inputs`: those of the field → that of `y`.
    fn eval<'t>(&self, t: Var<'t, F>, y: Var<'t, F>, inputs: &[Var<'t, F>]) -> Var<'t, F>;
}

/// A module and a function as a field of time; see [`timed_field_fn`].
#[derive(Clone, Debug)]
pub struct TimedFieldFn<M, C> {
    module: M,
    function: C,
}

/// A field from a module and a function of it, to which time is a variable.
///
/// ```
/// use autodiff_lite::{Activation, Tape, Var};
/// use nets::{Init, Mlp};
/// use ode_deform::solve::{Problem, StepController, TSIT5};
/// use ode_deform::{Adjoint, timed_field_fn};
///
/// // y' = -y: when should it have ended?
/// let none = Mlp::<f64>::new(&Init::new(0), &[1, 1], Activation::Tanh);
/// let field = timed_field_fn(none, |_: &Mlp<f64>, _t: Var<'_, f64>, y: Var<'_, f64>, _| y.neg());
/// let tape = Tape::<f64>::train(0);
/// let (first, last) = (tape.constant(ndarray::arr0(0.0)), tape.leaf(ndarray::arr0(1.0)));
/// let y = tape.constant(ndarray::arr1(&[1.0]));
/// let problem = Problem::new([0.0, 1.0], &TSIT5, StepController::adaptive(1e-9, 1e-9));
/// let flow = Adjoint::default().integrate_between(&field, [first, last], y, &[], &problem)?;
/// let gradients = flow.end.sum().backward();
/// assert!((gradients.wrt(last).unwrap().sum() + (-1.0_f64).exp()).abs() < 1e-8); // the field at the end
/// # Ok::<(), ode_deform::solve::SolveError>(())
/// ```
///
/// # Shapes
/// Those of [`TimedField::eval`]: the function gives the shape of `y`.
pub fn timed_field_fn<F, M, C>(module: M, function: C) -> TimedFieldFn<M, C>
where
    F: Real,
    M: Module<F>,
    C: for<'t> Fn(&M, Var<'t, F>, Var<'t, F>, &[Var<'t, F>]) -> Var<'t, F>,
{
    TimedFieldFn { module, function }
}

impl<M, C> TimedFieldFn<M, C> {
    /// The module.
    pub fn module(&self) -> &M {
        &self.module
    }

    /// The module, to be trained.
    pub fn module_mut(&mut self) -> &mut M {
        &mut self.module
    }
}

impl<F: Real, M: Module<F>, C> Module<F> for TimedFieldFn<M, C> {
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<F>) {
        self.module.visit(path, visitor);
    }

    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<F>) {
        self.module.visit_mut(path, visitor);
    }
}

impl<F, M, C> TimedField<F> for TimedFieldFn<M, C>
where
    F: Real,
    M: Module<F> + Clone + Send + 'static,
    C: for<'t> Fn(&M, Var<'t, F>, Var<'t, F>, &[Var<'t, F>]) -> Var<'t, F> + Clone + Send + 'static,
{
    fn eval<'t>(&self, t: Var<'t, F>, y: Var<'t, F>, inputs: &[Var<'t, F>]) -> Var<'t, F> {
        (self.function)(&self.module, t, y, inputs)
    }
}

/// The field over `s` from 0 to 1, `t = t0 + (t1 - t0) s`: both times are inputs, the first two.
#[derive(Clone)]
struct Stretched<V>(V);

impl<F: Real, V: Module<F>> Module<F> for Stretched<V> {
    fn visit(&self, path: &str, visitor: &mut dyn Visitor<F>) {
        self.0.visit(path, visitor);
    }

    fn visit_mut(&mut self, path: &str, visitor: &mut dyn VisitorMut<F>) {
        self.0.visit_mut(path, visitor);
    }
}

impl<F: Real, V: TimedField<F>> VectorField<F> for Stretched<V> {
    fn eval<'t>(&self, s: f64, y: Var<'t, F>, inputs: &[Var<'t, F>]) -> Var<'t, F> {
        let (first, length) = (inputs[0], inputs[1].sub(inputs[0]));
        let time = first.add(length.scale(F::from_f64(s)));
        self.0.eval(time, y, &inputs[2..]).mul(length)
    }
}

impl Adjoint {
    /// Integrates a field of time from one variable time to another.
    ///
    /// The problem says how: its method, and its steps and asked times on the scale of its span, which is stretched onto
    /// the two times. With the span that the times have at present, a step of 0.1 is one of 0.1. Gradients reach both times
    /// beside all that they reach in [`integrate`](Self::integrate): the steps move along with the times, each keeping its
    /// share of the whole, so that the gradient is exact for the numbers computed.
    ///
    /// # Shapes
    /// `times`: one element each, in the units of the field's time; else as [`integrate`](Self::integrate).
    ///
    /// # Errors
    /// As [`integrate`](Self::integrate), and if the two times, or both ends of the span, are one or not finite.
    ///
    /// # Panics
    /// As [`integrate`](Self::integrate), and if a time has more than one element.
    ///
    /// # References
    /// torchdiffeq and diffrax differentiate the times of the ends alone and hold those of the steps; the two agree for
    /// one step, and as steps become small.
    #[track_caller]
    pub fn integrate_between<'t, F: Real, V: TimedField<F>>(
        self,
        field: &V,
        times: [Var<'t, F>; 2],
        start: Var<'t, F>,
        inputs: &[Var<'t, F>],
        problem: &Problem,
    ) -> Result<Flow<'t, F>, SolveError> {
        let [first, last] = times.map(|time| time.item().to_f64());
        apart([first, last])?;
        let unit = unit_problem(problem)?;
        let mut all: Vec<_> = times.map(|time| time.reshape(&[])).into();
        all.extend(inputs);
        let mut flow = self.integrate(&Stretched(field.clone()), start, &all, &unit)?;
        for time in &mut flow.times {
            // Exactly at both ends.
            *time = if *time == 1.0 { last } else { first + (last - first) * *time };
        }
        Ok(flow)
    }
}

fn apart([first, last]: [f64; 2]) -> Result<(), SolveError> {
    let length = last - first;
    if length == 0.0 || !length.is_finite() {
        let (what, expected) = ("the last time", "a finite number apart from the first expected");
        return Err(SolveError::Problem { what, found: last, expected });
    }
    Ok(())
}

/// The problem with its span on `[0, 1]`.
fn unit_problem(problem: &Problem) -> Result<Problem, SolveError> {
    problem.check()?;
    apart(problem.span)?;
    let [first, last] = problem.span;
    let length = (last - first).abs();
    let control = match problem.control {
        StepController::Fixed { step } => StepController::Fixed { step: step / length },
        StepController::Random { low, high, seed, sample } => {
            StepController::Random { low: low / length, high: high / length, seed, sample }
        }
        StepController::Pid(pid) => {
            StepController::Pid(Pid { first: pid.first.map(|step| step / length), ..pid })
        }
    };
    let place = |&time: &f64| if time == last { 1.0 } else { (time - first) / (last - first) };
    let mut unit = Problem { span: [0.0, 1.0], control, ..problem.clone() };
    unit.limits.least_step /= length;
    unit.save_at = problem.save_at.iter().map(place).collect();
    Ok(unit)
}
