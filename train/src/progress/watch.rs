//! Who hears of a job, and what ends it.

use std::fmt;

use super::{Cancel, Event};

/// Who hears of events: a bar, a log, a closure `|event: &Event| ..`.
pub trait Observer {
    /// Hears of an event. The job waits meanwhile.
    fn event(&mut self, event: &Event);
}

impl<F: FnMut(&Event)> Observer for F {
    fn event(&mut self, event: &Event) {
        self(event);
    }
}

/// Who hears of a job's events, in their order, and what ends it early. The default is nobody and nothing.
#[derive(Default)]
pub struct Watch<'a> {
    observers: Vec<Box<dyn Observer + Send + 'a>>,
    cancel: Cancel,
}

impl<'a> Watch<'a> {
    /// One who hears, and a token that nobody has yet.
    pub fn new(observer: impl Observer + Send + 'a) -> Self {
        Self::default().and(observer)
    }

    /// One more, who hears after the others.
    #[must_use]
    pub fn and(mut self, observer: impl Observer + Send + 'a) -> Self {
        self.observers.push(Box::new(observer));
        self
    }

    /// With this token instead of its own; before [`until_event`](Self::until_event), which takes the one there is.
    #[must_use]
    pub fn until(self, cancel: Cancel) -> Self {
        Self { cancel, ..self }
    }

    /// Cancels it by itself, at the first event of which this holds.
    #[must_use]
    pub fn until_event(self, mut enough: impl FnMut(&Event) -> bool + Send + 'a) -> Self {
        let cancel = self.cancel();
        self.and(move |event: &Event| {
            if enough(event) {
                cancel.cancel();
            }
        })
    }

    /// The token that ends the job.
    pub fn cancel(&self) -> Cancel {
        self.cancel.clone()
    }

    /// Whether the job is to end: asked by it where what it has is whole.
    pub fn is_cancelled(&self) -> bool {
        self.cancel.is_cancelled()
    }

    /// Tells of an event.
    pub fn tell(&mut self, event: &Event) {
        self.observers.iter_mut().for_each(|observer| observer.event(event));
    }

    /// For a job that is a part of this one: what it tells arrives here as [`Event::Within`], and what ends this one ends it.
    pub fn within<'b>(&'b mut self, job: &str, seed: Option<u64>) -> Watch<'b> {
        let (job, cancel) = (job.to_owned(), self.cancel());
        let pass_on = move |event: &Event| {
            let (job, told) = (job.clone(), Box::new(event.clone()));
            self.tell(&Event::Within { job, seed, told });
        };
        Watch::new(pass_on).until(cancel)
    }
}

impl fmt::Debug for Watch<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { observers, cancel } = self;
        f.debug_struct("Watch")
            .field("observers", &observers.len())
            .field("cancel", cancel)
            .finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_tells_through_the_whole_and_ends_with_it() {
        let mut heard = Vec::new();
        let mut watch = Watch::new(|event: &Event| heard.push(event.clone()));
        let cancel = watch.cancel();
        let mut part = watch.within("leaf", Some(3));
        let told = Event::Progress { done: 1, total: 2, text: String::new() };
        part.tell(&told);
        assert!(!part.is_cancelled());
        std::thread::scope(|scope| {
            scope.spawn(|| cancel.cancel());
        });
        assert!(part.is_cancelled());
        drop(part);
        assert!(watch.is_cancelled());
        drop(watch);
        let told = Box::new(told);
        assert_eq!(heard, [Event::Within { job: "leaf".to_owned(), seed: Some(3), told }]);
    }
}
