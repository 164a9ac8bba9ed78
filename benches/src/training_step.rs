//! A step of training, as the benches of whole systems measure it.

use autodiff_lite::Tape;
use autodiff_lite::optim::Adam;
use datasets::ReadOptions;
use train::{Draw, Source, StepInfo, System};

/// A system and one batch of its own data, seen again at every step: losses, backward, Adam.
#[derive(Debug)]
pub struct TrainingStep<S: System> {
    system: S,
    batch: Vec<S::Sample>,
    tape: Tape,
    adam: Adam,
    at: u64,
}

impl<S: System<ReadOptions = ReadOptions>> TrainingStep<S> {
    /// On the first samples of what the system makes itself.
    ///
    /// # Panics
    /// If it cannot make data, or fewer samples than a batch.
    pub fn new(config: &S::Config, batch: usize) -> Self {
        let source =
            Source { path: None, options: &ReadOptions::default(), seed: 0, progress: &|_, _| {} };
        let data = S::open(config, &source).expect("it makes its own data");
        let mut system = S::new(config, 0);
        system.init_from_data(&data, None).expect("data to learn from");
        let draw = |item| {
            let draw = Draw { seed: 0, epoch: 0, index: item as u64, item };
            system.draw(&data, &draw).expect("samples are in memory")
        };
        let batch = (0..batch).map(draw).collect();
        Self { system, batch, tape: Tape::train(0), adam: Adam::new(1e-4), at: 0 }
    }

    /// The next step.
    ///
    /// # Panics
    /// If no term counts, or the loss has no value.
    pub fn run(&mut self) {
        self.tape.reseed(self.at);
        let moment = StepInfo { step: self.at, epoch: 0 };
        let terms = self.system.loss(&self.tape, &self.batch, moment);
        let terms = terms.expect("fixed steps come to their end");
        let counted = terms.0.iter().filter(|term| term.weight != 0.0);
        let weighted = counted.map(|term| term.value.reshape(&[]).scale(term.weight as f32));
        let gradients = weighted.reduce(|a, b| a + b).expect("a term that counts").backward();
        drop(terms);
        self.tape.reset();
        self.adam.step(&mut self.system, &gradients);
        self.at += 1;
    }
}
