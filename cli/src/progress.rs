//! Progress bars on stderr: hidden where stderr is no terminal, and with `--quiet`.

use std::time::Duration;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::console::Console;

/// A bar with count, rate and the time that is left.
#[derive(Debug)]
pub(crate) struct Progress(ProgressBar);

impl Progress {
    /// A bar named after what is counted.
    pub(crate) fn new(console: Console, name: &str) -> Self {
        let target =
            if console.quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
        let style = ProgressStyle::with_template(
            "{prefix:>10} [{bar:30}] {pos}/{len} {elapsed} (left {eta}) {msg}",
        )
        .expect("a template that is correct")
        .progress_chars("=> ");
        let bar = ProgressBar::with_draw_target(Some(0), target).with_style(style);
        bar.set_prefix(name.to_owned());
        Self(bar)
    }

    /// So many of so many are done.
    pub(crate) fn set(&self, done: usize, total: usize) {
        if self.0.length() != Some(total as u64) {
            self.0.set_length(total as u64);
            self.0.enable_steady_tick(Duration::from_millis(250));
        }
        // Threads report out of order; the bar only grows.
        if done as u64 > self.0.position() {
            self.0.set_position(done as u64);
        }
    }

    /// So many were done before: they say nothing about the time that is left.
    pub(crate) fn begin(&self, done: usize, total: usize) {
        self.set(done, total);
        self.0.reset_eta();
    }

    /// What is going on, behind the bar.
    pub(crate) fn say(&self, text: String) {
        self.0.set_message(text);
    }

    /// Takes the bar away.
    pub(crate) fn finish(&self) {
        self.0.finish_and_clear();
    }
}

impl Drop for Progress {
    fn drop(&mut self) {
        self.finish();
    }
}
