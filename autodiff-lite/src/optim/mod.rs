//! Optimisers: PyTorch's formulas, state by parameter path, in-place updates.
//!
//! ```
//! use autodiff_lite::optim::{Adam, Schedule, clip_grad_norm};
//! use autodiff_lite::{Param, Tape};
//!
//! let mut w = Param::new(ndarray::arr1(&[0.0_f32]));
//! let mut adam = Adam::new(0.1);
//! let schedule = Schedule::cosine(10, 200);
//! let mut tape = Tape::train(0);
//! for step in 0..200 {
//!     tape.reseed(step as u64); // for dropout, where there is one
//!     let mut gradients = tape.param(&w).add_scalar(-3.0).square().sum().backward();
//!     tape.reset(); // from here on the parameter is unique and is written in place
//!     clip_grad_norm(&mut gradients, 10.0);
//!     adam.set_factor(schedule.factor(step));
//!     adam.step(&mut w, &gradients);
//! }
//! assert!((w.value[0] - 3.0).abs() < 1e-2);
//! ```

mod adam;
mod clip;
mod rmsprop;
mod schedule;
mod sgd;

use std::collections::BTreeMap;
use std::fmt;

use crate::module::has_prefix;
use crate::param::Shared;
use crate::{Gradients, Module, Param, ParamId, Real};

pub use adam::{Adam, AdamMethod, AdamUniform, AdamUniformMethod, AdamW, AdamWMethod};
pub use clip::{clip_grad_norm, clip_value};
pub use rmsprop::{RmsProp, RmsPropMethod};
pub use schedule::{Plateau, Schedule};
pub use sgd::{Sgd, SgdMethod};

/// How one tensor is updated. Everything else (paths, groups, state, saving) is the
/// [`Optimizer`]'s.
pub trait Method: Clone + fmt::Debug {
    /// The names of the arrays that are kept for each parameter, all of its length: `["m", "v"]`.
    const MOMENTS: &'static [&'static str];

    /// Updates one tensor in place. `moments` holds the arrays of [`MOMENTS`](Self::MOMENTS), zero
    /// before the first step; `step` counts this tensor's updates from 1.
    fn update<F: Real>(
        &self,
        lr: f64,
        step: u64,
        weights: &mut [F],
        gradient: &[F],
        moments: &mut [Vec<F>],
    );
}

/// What differs for parameters below a path.
#[derive(Clone, Debug)]
pub struct Group<M> {
    /// Learning rate before the factor of the schedule.
    pub lr: f64,
    /// Whether these parameters are left alone.
    pub frozen: bool,
    /// The other numbers of the method.
    pub method: M,
}

/// A method with its state, for all parameters of a module.
///
/// State is kept by parameter path, so it can be saved with the module and a stopped run resumes
/// bit for bit. One optimiser therefore serves one module: two that are trained together are stepped as one, a tuple of both.
/// Parameters that are not trainable, or that the loss does not depend on, are left
/// alone, as PyTorch leaves those without `.grad`.
#[derive(Clone, Debug)]
pub struct Optimizer<M, F: Real = f32> {
    base: Group<M>,
    groups: Vec<(String, Group<M>)>,
    factor: f64,
    pub(crate) states: BTreeMap<String, State<F>>,
}

/// What is kept for one parameter.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct State<F> {
    pub(crate) steps: u64,
    pub(crate) moments: Vec<Vec<F>>,
    /// The parameter they are of, if a [`step`](Optimizer::step) made them: files do not know it.
    pub(crate) owner: Option<ParamId>,
}

impl<M: Method, F: Real> Optimizer<M, F> {
    /// An optimiser that uses `method` with learning rate `lr`.
    pub fn with_method(method: M, lr: f64) -> Self {
        let base = Group { lr, frozen: false, method };
        Self { base, groups: Vec::new(), factor: 1.0, states: BTreeMap::new() }
    }

    /// Changes the numbers of the method; before [`group`](Self::group), which copies what they are by then.
    #[must_use]
    pub fn with(mut self, change: impl FnOnce(&mut M)) -> Self {
        change(&mut self.base.method);
        self
    }

    /// Gives the parameters below `prefix` numbers of their own, beginning with a copy of those of
    /// the others: what [`with`](Self::with) changes later it does not change here. Of several groups that cover a path the last counts.
    #[must_use]
    pub fn group(mut self, prefix: &str, change: impl FnOnce(&mut Group<M>)) -> Self {
        let mut group = self.base.clone();
        change(&mut group);
        self.groups.push((prefix.to_owned(), group));
        self
    }

    /// The learning rate, before the factor.
    pub fn lr(&self) -> f64 {
        self.base.lr
    }

    /// Sets the learning rate of all parameters outside of groups.
    pub fn set_lr(&mut self, lr: f64) {
        self.base.lr = lr;
    }

    /// Sets what all learning rates are multiplied by, groups included; a [`Schedule`]
    /// says it.
    pub fn set_factor(&mut self, factor: f64) {
        self.factor = factor;
    }

    /// Forgets all moments.
    pub fn reset(&mut self) {
        self.states.clear();
    }

    /// Forgets the moments of the parameters below `prefix`: after a mesh was subdivided, say.
    pub fn reset_below(&mut self, prefix: &str) {
        self.states.retain(|path, _| !has_prefix(path, prefix));
    }

    /// The parameters that were updated so far: path and number of elements.
    pub fn lengths(&self) -> impl Iterator<Item = (&str, usize)> {
        let length = |state: &State<F>| state.moments.first().map_or(0, Vec::len);
        self.states.iter().map(move |(path, state)| (path.as_str(), length(state)))
    }

    /// Replaces each moment of the parameter at `path` by what `f` makes of it, when the parameter
    /// is about to change its shape, or another is to go on in its place. Does nothing for a parameter that was never updated.
    pub fn map_moments(&mut self, path: &str, f: impl Fn(&[F]) -> Vec<F>) {
        if let Some(state) = self.states.get_mut(path) {
            state.owner = None;
            for moment in &mut state.moments {
                *moment = f(moment);
            }
        }
    }

    /// Updates each trainable parameter of `module` that has a gradient.
    ///
    /// Reset the tape first: then nobody else holds the values and they are written in place. A parameter that stands in the
    /// module twice, as a clone, is updated once, under the first of its paths.
    ///
    /// # Panics
    /// If a parameter has another length than when it was updated last, or at its path another parameter was updated before:
    /// call [`reset_below`](Self::reset_below) when it changes, and step two modules as one tuple.
    pub fn step(&mut self, module: &mut (impl Module<F> + ?Sized), gradients: &Gradients<F>) {
        let mut shared = Shared::new();
        module.visit_mut("", &mut |path: &str, param: &mut Param<F>| {
            if param.trainable
                && let Some(gradient) = gradients.slice_of(param)
            {
                shared.change(param, |param| {
                    self.assert_owner(path, param.id());
                    self.update(path, param.as_slice_mut(), gradient);
                    if let Some(state) = self.states.get_mut(path) {
                        state.owner = Some(param.id());
                    }
                });
            }
        });
    }

    fn assert_owner(&self, path: &str, param: ParamId) {
        let owner = self.states.get(path).and_then(|state| state.owner);
        assert!(
            owner.is_none_or(|owner| owner == param),
            "the state of `{path}` is that of another parameter: step modules together, as a tuple, or reset it when one takes \
             the place of another"
        );
    }

    /// Updates one array that is no module's parameter, under a path of its own.
    ///
    /// # Panics
    /// As [`step`](Self::step).
    #[inline(never)]
    pub fn update(&mut self, path: &str, weights: &mut [F], gradient: &[F]) {
        let covering = self.groups.iter().rev().find(|(prefix, _)| has_prefix(path, prefix));
        let group = covering.map_or(&self.base, |(_, group)| group);
        if group.frozen {
            return;
        }
        if !self.states.contains_key(path) {
            let moments = M::MOMENTS.iter().map(|_| vec![F::zero(); weights.len()]).collect();
            self.states.insert(path.to_owned(), State { steps: 0, moments, owner: None });
        }
        let state = self.states.get_mut(path).expect("inserted above if it was missing");
        assert!(
            weights.len() == gradient.len()
                && state.moments.iter().all(|moment| moment.len() == weights.len()),
            "the state of `{path}` has another length: reset it when a parameter changes its shape"
        );
        state.steps += 1;
        let lr = group.lr * self.factor;
        group.method.update(lr, state.steps, weights, gradient, &mut state.moments);
    }
}

#[cfg(test)]
mod tests {
    use ndarray::arr1;

    use super::*;
    use crate::{Tape, impl_module};

    struct Pair {
        a: Param<f64>,
        b: Param<f64>,
    }
    impl_module!(Pair: f64 { a, b });

    fn pair() -> Pair {
        Pair { a: Param::new(arr1(&[1.0])), b: Param::new(arr1(&[1.0])) }
    }

    fn derivative_of_one(pair: &Pair) -> Gradients<f64> {
        let tape = Tape::train(0);
        (tape.param(&pair.a) + tape.param(&pair.b)).sum().backward()
    }

    #[test]
    fn groups_have_their_own_numbers() {
        let mut pair = pair();
        let mut sgd = Sgd::new(0.1).group("b", |group| group.lr = 0.5);
        let gradients = derivative_of_one(&pair);
        sgd.step(&mut pair, &gradients);
        assert_eq!([pair.a.value[0], pair.b.value[0]], [0.9, 0.5]);
        sgd.set_factor(0.0);
        sgd.step(&mut pair, &gradients);
        assert_eq!([pair.a.value[0], pair.b.value[0]], [0.9, 0.5]);
    }

    #[test]
    fn what_is_not_trainable_stays() {
        let mut pair = pair();
        pair.set_trainable("a", false);
        let gradients = derivative_of_one(&pair);
        assert!(gradients.of(&pair.a).is_none());
        Sgd::new(0.1).step(&mut pair, &gradients);
        assert_eq!([pair.a.value[0], pair.b.value[0]], [1.0, 0.9]);
    }

    #[test]
    fn moments_follow_a_parameter_that_grows() {
        let (mut grown, mut fresh) = (Adam::<f64>::new(0.1), Adam::<f64>::new(0.1));
        grown.update("x", &mut [0.0], &[1.0]);
        grown.map_moments("x", |moment| vec![moment[0]; 2]);
        grown.map_moments("y", |_| unreachable!("never updated"));
        fresh.update("x", &mut [0.0, 0.0], &[1.0, 1.0]);
        let (mut a, mut b) = ([0.0; 2], [0.0; 2]);
        grown.update("x", &mut a, &[2.0, 3.0]);
        fresh.update("x", &mut b, &[2.0, 3.0]);
        assert_eq!(a, b);
    }

    #[test]
    #[should_panic(expected = "the state of `` is that of another parameter")]
    fn parameters_do_not_share_a_state_unnoticed() {
        let mut pair = pair();
        let gradients = derivative_of_one(&pair);
        let mut adam = Adam::new(0.1);
        adam.step(&mut pair.a, &gradients);
        adam.step(&mut pair.b, &gradients);
    }

    #[test]
    fn a_parameter_may_take_the_place_of_another() {
        let mut pair = pair();
        let gradients = derivative_of_one(&pair);
        let mut sgd = Sgd::new(0.1).with(|m| m.momentum = 0.5);
        sgd.step(&mut pair.a, &gradients);
        sgd.map_moments("", <[f64]>::to_vec);
        sgd.step(&mut pair.b, &gradients);
        assert_eq!([pair.a.value[0], pair.b.value[0]], [0.9, 0.85]);
        sgd.reset_below("");
        sgd.step(&mut pair.a, &gradients);
        assert_eq!(pair.a.value[0], 0.9 - 0.1);
    }

    /// Two places of one parameter: the gradients of both are one, and so is the step.
    #[test]
    fn a_parameter_may_stand_in_two_places() {
        let a = Param::new(arr1(&[1.0]));
        let mut tied = Pair { b: a.clone(), a };
        let (mut sgd, mut tape) = (Sgd::new(0.1), Tape::train(0));
        for expected in [0.7, 0.4] {
            let (a, b) = (tape.param(&tied.a), tape.param(&tied.b));
            let gradients = (a.scale(2.0) + b).sum().backward();
            tape.reset();
            sgd.step(&mut tied, &gradients);
            assert!((tied.a.value[0] - expected).abs() < 1e-15);
            assert_eq!(tied.a.value.as_ptr(), tied.b.value.as_ptr(), "they share their values");
        }
        let mut state = crate::state::State::new();
        state.add_module("", &tied);
        state.load_module("", &mut tied).expect("it is its own");
        assert_eq!(tied.a.value.as_ptr(), tied.b.value.as_ptr(), "when they were read, too");
    }

    #[test]
    #[should_panic(expected = "the state of `x` has another length")]
    fn a_changed_shape_is_noticed() {
        let mut adam = Adam::<f64>::new(0.1);
        adam.update("x", &mut [0.0], &[1.0]);
        adam.update("x", &mut [0.0, 0.0], &[1.0, 1.0]);
    }
}
