//! The optimisers behind one type, and their moments at the door of a system.

use std::collections::BTreeMap;

use autodiff_lite::optim::{Adam, AdamMethod, AdamW, AdamWMethod, Group, Method, Optimizer, Sgd};
use autodiff_lite::state::{Mismatch, State};
use autodiff_lite::{Gradients, Module, Param};

use super::config::{OptimizerKind, TrainConfig};

/// One of the optimisers that a configuration can name.
#[derive(Clone, Debug)]
pub(super) enum AnyOptimizer {
    Adam(Adam),
    AdamW(AdamW),
    Sgd(Sgd),
}

macro_rules! each {
    ($any:expr, $optimizer:ident => $body:expr) => {
        match $any {
            AnyOptimizer::Adam($optimizer) => $body,
            AnyOptimizer::AdamW($optimizer) => $body,
            AnyOptimizer::Sgd($optimizer) => $body,
        }
    };
}

impl AnyOptimizer {
    /// The optimiser of a configuration; `rates` are factors by path.
    pub(super) fn new(config: &TrainConfig, rates: &[(String, f64)]) -> Self {
        let TrainConfig { learning_rate: lr, beta1, beta2, momentum, weight_decay, .. } = *config;
        match config.optimizer {
            OptimizerKind::Adam => Self::Adam(grouped(
                Adam::new(lr).with(|m| {
                    *m = AdamMethod { beta1, beta2, weight_decay, ..AdamMethod::default() };
                }),
                rates,
            )),
            OptimizerKind::AdamW => Self::AdamW(grouped(
                AdamW::new(lr).with(|m| {
                    *m = AdamWMethod { beta1, beta2, weight_decay, ..AdamWMethod::default() };
                }),
                rates,
            )),
            OptimizerKind::Sgd => Self::Sgd(grouped(
                Sgd::new(lr).with(|m| (m.momentum, m.weight_decay) = (momentum, weight_decay)),
                rates,
            )),
        }
    }

    pub(super) fn step(
        &mut self,
        module: &mut impl Module<f32>,
        gradients: &Gradients,
        factor: f64,
    ) {
        each!(self, optimizer => {
            optimizer.set_factor(factor);
            optimizer.step(module, gradients);
        });
    }

    pub(super) fn save(&self, state: &mut State) {
        each!(self, optimizer => state.add_optimizer(optimizer));
    }

    /// The first parameter whose moments have a length that is not its own.
    pub(super) fn misfit(&self, module: &impl Module<f32>) -> Option<(String, usize, usize)> {
        let mut lengths = BTreeMap::new();
        module.visit("", &mut |path: &str, param: &Param| {
            lengths.insert(path.to_owned(), param.len());
        });
        each!(self, optimizer => {
            optimizer.lengths().find_map(|(path, found)| {
                let expected = lengths.get(path).copied().unwrap_or(0);
                (found != expected).then(|| (path.to_owned(), found, expected))
            })
        })
    }

    pub(super) fn load(&mut self, state: &State) -> Result<(), Mismatch> {
        each!(self, optimizer => state.load_optimizer(optimizer))
    }
}

fn grouped<M: Method>(optimizer: Optimizer<M>, rates: &[(String, f64)]) -> Optimizer<M> {
    rates.iter().fold(optimizer, |optimizer, (prefix, factor)| {
        optimizer.group(prefix, |group: &mut Group<M>| group.lr *= factor)
    })
}

/// The optimiser's memory of each parameter, for a system that changes its parameters in between.
#[derive(Debug)]
pub struct OptimizerState<'a>(pub(super) &'a mut AnyOptimizer);

impl OptimizerState<'_> {
    /// Replaces each array that is kept for the parameter at `path` (means of gradients and of
    /// squared gradients), all of the parameter's length, by what `f` makes of it: new vertices
    /// get the mean of their edge's ends, say. Does nothing before the parameter's first step.
    pub fn carry(&mut self, path: &str, f: impl Fn(&[f32]) -> Vec<f32>) {
        each!(&mut *self.0, optimizer => optimizer.map_moments(path, f));
    }

    /// Forgets what is kept for the parameters below `prefix`.
    pub fn forget(&mut self, prefix: &str) {
        each!(&mut *self.0, optimizer => optimizer.reset_below(prefix));
    }
}
