//! Scores, samples and the page, which the first process makes while the others wait.

use super::{Trainer, in_pool};
use crate::error::TrainError;
use crate::progress::Event;
use crate::subset::Subset;
use crate::system::{System, best_of};

impl<S: System> Trainer<'_, '_, '_, S> {
    /// [`end_epoch`](Self::end_epoch), and where it fails a checkpoint: the steps are good, and who goes on makes up for the
    /// scores.
    pub(super) fn score_epoch(&mut self) -> Result<bool, TrainError> {
        let best = self.state.best;
        let scored = if self.ranks.is_first() { self.end_epoch() } else { Ok(false) };
        let scored = self.ranks.together(scored).inspect_err(|_| {
            self.state.best = best;
            // What has failed is told, not what is made of it.
            let _ = self.save();
        })?;
        let bits = self.state.best.map(|(value, step)| (value.to_bits(), step));
        let (scored, bits) = self.ranks.first(&(scored, bits));
        self.state.best = bits.map(|(bits, step)| (f64::from_bits(bits), step));
        Ok(scored)
    }

    /// Scores and samples of validation, and the best checkpoint; whether it was the turn of scores.
    fn end_epoch(&mut self) -> Result<bool, TrainError> {
        let train = &self.job.config.train;
        let step = self.state.step;
        let epoch = step.div_ceil(self.steps_per_epoch);
        let last = step >= self.total;
        let turn =
            |every: Option<u64>| last || every.is_some_and(|every| epoch.is_multiple_of(every));
        let place = [step, epoch];
        if turn(train.validation_every) {
            let data = self.job.data;
            self.metrics =
                self.averaged(|system| in_pool(|| system.evaluate(data, Subset::Validation)))?;
            let best = self.is_best()?;
            if let Some(record) = &mut self.record {
                record.validation(place, &self.metrics, best);
            }
            if best {
                let path = self.job.run.best();
                self.write(&path)?;
            }
            let metrics = self.metrics.clone();
            let (epoch, best) = (Some(epoch), Some(best));
            self.tell(&Event::Evaluated { step, epoch, metrics, best });
        }
        // A run that ends early ends here, too.
        if turn(train.samples_every) || self.is_stale() {
            let data = self.job.data;
            let shown =
                self.averaged(|system| in_pool(|| system.show(data, Subset::Validation)))?;
            if let Some(record) = &mut self.record {
                record.samples(place, shown);
            }
        }
        let evaluated = turn(train.validation_every);
        if evaluated {
            self.digest()?;
        }
        self.warn();
        Ok(evaluated)
    }

    /// Writes the table and the page, if something is to be added.
    pub(super) fn digest(&mut self) -> Result<(), TrainError> {
        self.exchange();
        let (system, data) = (&self.system, self.job.data);
        let show = || in_pool(|| system.show(data, Subset::Validation));
        let digested =
            self.record.as_mut().map_or(Ok(()), |record| record.digest::<S>(self.job.config, show));
        self.exchange();
        digested
    }

    /// What `f` makes of the system that predicts: with averaged weights, where there are any.
    fn averaged<R>(&mut self, f: impl FnOnce(&S) -> R) -> R {
        self.exchange();
        let made = f(&self.system);
        self.exchange();
        made
    }

    /// Puts averaged weights in the place of the trained ones, or these back.
    pub(super) fn exchange(&mut self) {
        if let Some(average) = &mut self.average {
            average.swap(&mut self.system);
        }
    }

    fn is_best(&mut self) -> Result<bool, TrainError> {
        let name = best_of::<S>(&self.job.config.train);
        let Some(metric) = self.metrics.iter().find(|metric| metric.name == name) else {
            let metrics = self.metrics.iter().map(|metric| metric.name.clone()).collect();
            return Err(TrainError::NoSuchMetric { name: name.to_owned(), metrics });
        };
        let best = match self.state.best {
            _ if metric.value.is_nan() => false,
            None => true,
            Some((value, _)) => metric.better.improves(metric.value, value),
        };
        if best {
            self.state.best = Some((metric.value, self.state.step));
        }
        Ok(best)
    }
}
