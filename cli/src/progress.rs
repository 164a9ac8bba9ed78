//! How far the work is, on stderr: one line that is drawn over on a terminal, a line every half minute where there is
//! none, nothing with `--quiet`.

use std::io::Write;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use train::progress::{Event, Facts};

use crate::console::Console;
use crate::printable;
use crate::terminal::{DRAWN, locked};

/// Between two looks on a terminal.
const BLINK: Duration = Duration::from_millis(250);
/// Between two lines where there is none: a log that stays short and still shows that the work goes on.
const HEARTBEAT: Duration = Duration::from_secs(30);
/// What went on for less says nothing about the time that is left.
const KNOWN_AFTER: Duration = Duration::from_secs(2);
/// Characters of the bar between its brackets.
const BAR: usize = 12;

/// A stretch of work that somebody may watch. Its end is when it is dropped.
#[derive(Debug)]
pub(crate) struct Progress {
    state: Arc<Mutex<State>>,
    watch: Option<Watch>,
    console: Console,
}

impl Progress {
    /// Work named after what is done.
    pub(crate) fn new(console: Console, name: &str) -> Self {
        Self::of(console, State::new(name, false))
    }

    /// Work whose steps mean nothing to a reader, but their share of the whole.
    pub(crate) fn in_shares(console: Console, name: &str) -> Self {
        Self::of(console, State::new(name, true))
    }

    fn of(console: Console, state: State) -> Self {
        let state = Arc::new(Mutex::new(state));
        let watch = (!console.quiet).then(|| Watch::on_stderr(Arc::clone(&state)));
        let name = || locked(&state).name.clone();
        console.log(|| Event::Stage { name: name(), facts: Facts::default() });
        Self { state, watch, console }
    }

    /// So many of so many are done. The first call says what was done before: it tells nothing of the time that is left.
    pub(crate) fn set(&self, done: usize, total: usize) {
        let mut state = locked(&self.state);
        state.set(done, total, Instant::now());
        // Under the lock, so that the log hears it in order.
        self.console.log(|| state.event());
    }

    /// What is going on, behind the count.
    pub(crate) fn say(&self, text: &str) {
        let mut state = locked(&self.state);
        state.message = printable::line(text);
        self.console.log(|| state.event());
    }

    /// Takes the line away.
    pub(crate) fn finish(mut self) {
        self.watch = None;
    }
}

/// What there is to tell.
#[derive(Debug)]
struct State {
    name: String,
    in_shares: bool,
    done: usize,
    total: usize,
    begun: Instant,
    /// When counting began, and at what.
    counted: Option<(Instant, usize)>,
    message: String,
}

impl State {
    fn new(name: &str, in_shares: bool) -> Self {
        let (begun, message) = (Instant::now(), String::new());
        let name = printable::line(name);
        Self { name, in_shares, done: 0, total: 0, begun, counted: None, message }
    }

    fn set(&mut self, done: usize, total: usize, now: Instant) {
        self.total = total;
        self.counted.get_or_insert((now, done));
        // Threads report out of order; it only grows.
        self.done = self.done.max(done);
    }

    fn event(&self) -> Event {
        let (done, total) = (self.done as u64, self.total as u64);
        Event::Progress { done, total, text: self.message.clone() }
    }

    /// None until it is known.
    fn left(&self, now: Instant) -> Option<Duration> {
        let (since, from) = self.counted?;
        let spent = now.saturating_duration_since(since);
        if self.done <= from || self.done >= self.total || spent < KNOWN_AFTER {
            return None;
        }
        let each = spent.as_secs_f64() / (self.done - from) as f64;
        Duration::try_from_secs_f64(each * (self.total - self.done) as f64).ok()
    }

    /// The count and the times, without the name.
    fn facts(&self, now: Instant) -> String {
        let mut facts = Vec::new();
        if let Some(percent) = (100 * self.done).checked_div(self.total) {
            facts.push(if self.in_shares {
                format!("{percent} %")
            } else {
                format!("{} of {}", self.done, self.total)
            });
        }
        facts.push(spoken(now.saturating_duration_since(self.begun)));
        facts.extend(self.left(now).map(|left| format!("{} left", spoken(left))));
        let message = if self.message.is_empty() { "" } else { "; " };
        format!("{}{message}{}", facts.join(", "), self.message)
    }

    /// For a terminal.
    fn drawn(&self, now: Instant) -> String {
        if self.total == 0 {
            return format!("{}: {}", self.name, self.facts(now));
        }
        let full = (BAR * self.done / self.total).min(BAR);
        let tip = if full < BAR { ">" } else { "" };
        let bar = format!("{}{tip}", "=".repeat(full));
        format!("{} [{bar:BAR$}] {}", self.name, self.facts(now))
    }

    /// For a log.
    fn logged(&self, now: Instant) -> String {
        format!("{}: {}", self.name, self.facts(now))
    }
}

/// Looks at the state from time to time, until it is dropped.
#[derive(Debug)]
struct Watch {
    end: Option<Sender<()>>,
    thread: Option<JoinHandle<()>>,
    bar: Option<ProgressBar>,
}

impl Watch {
    fn on_stderr(state: Arc<Mutex<State>>) -> Self {
        let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
        if bar.is_hidden() {
            // A closed stderr is no reason to stop the work.
            return Self::start(HEARTBEAT, move || {
                let line = locked(&state).logged(Instant::now());
                let _ = writeln!(std::io::stderr(), "{line}");
            });
        }
        // Of all that is shown this alone is cut to the width of the terminal.
        bar.set_style(ProgressStyle::with_template("{wide_msg}").expect("a correct template"));
        *locked(&DRAWN) = Some(bar.clone());
        let drawn = bar.clone();
        let mut watch = Self::start(BLINK, move || {
            let line = locked(&state).drawn(Instant::now());
            drawn.set_message(line);
        });
        watch.bar = Some(bar);
        watch
    }

    fn start(every: Duration, mut look: impl FnMut() + Send + 'static) -> Self {
        let (end, ended) = channel::<()>();
        let thread = std::thread::Builder::new().name("progress".to_owned()).spawn(move || {
            while ended.recv_timeout(every) == Err(RecvTimeoutError::Timeout) {
                look();
            }
        });
        // A machine that cannot start one more thread can do the work unwatched.
        Self { end: Some(end), thread: thread.ok(), bar: None }
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        self.end = None;
        if let Some(thread) = self.thread.take() {
            // If it panicked, there is nothing to look at any more.
            let _ = thread.join();
        }
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
            *locked(&DRAWN) = None;
        }
    }
}

/// A duration as one says it, to two figures.
pub(crate) fn spoken(time: Duration) -> String {
    let seconds = time.as_secs();
    let [hours, minutes] = [seconds / 3600, seconds / 60 % 60];
    match (hours, minutes) {
        (0, 0) => format!("{seconds} s"),
        (0, 1..10) if !seconds.is_multiple_of(60) => format!("{minutes} min {} s", seconds % 60),
        (0, _) => format!("{minutes} min"),
        _ => format!("{hours} h {minutes} min"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(done: usize, seconds: u64) -> (State, Instant) {
        let mut state = State::new("train", false);
        let start = state.begun;
        state.set(100, 500, start);
        state.set(done, 500, start);
        (state, start + Duration::from_secs(seconds))
    }

    #[test]
    fn the_time_left_is_said_once_it_is_known() {
        let (state, now) = at(100, 9);
        assert_eq!(state.drawn(now), "train [==>         ] 100 of 500, 9 s");
        let (state, now) = at(101, 1);
        assert!(!state.drawn(now).contains("left"), "{}", state.drawn(now));
        // What was done before the first report costs nothing: 100 steps in 50 s, so 300 take 150 s.
        let (mut state, now) = at(200, 50);
        state.message = "loss 0.5".to_owned();
        assert_eq!(state.logged(now), "train: 200 of 500, 50 s, 2 min 30 s left; loss 0.5");
        let (state, now) = at(500, 50);
        assert_eq!(state.drawn(now), "train [============] 500 of 500, 50 s");
    }

    #[test]
    fn work_without_a_count_and_in_shares() {
        let mut state = State::new("write", false);
        state.message = "scores".to_owned();
        let now = state.begun + Duration::from_secs(3);
        assert_eq!(state.drawn(now), "write: 3 s; scores");
        let mut state = State::new("study", true);
        state.set(0, 16_000, state.begun);
        state.set(4_000, 16_000, state.begun);
        assert!(state.logged(state.begun).starts_with("study: 25 %, 0 s"));
        // Reports out of order do not take it back.
        state.set(2_000, 16_000, state.begun);
        assert_eq!(state.done, 4_000);
    }

    #[test]
    fn durations_are_said_to_two_figures() {
        let said = |seconds| spoken(Duration::from_secs(seconds));
        assert_eq!([said(0), said(59), said(61), said(120)], ["0 s", "59 s", "1 min 1 s", "2 min"]);
        assert_eq!([said(11 * 60 + 20), said(7_500)], ["11 min", "2 h 5 min"]);
    }

    #[test]
    fn a_watch_looks_until_it_is_dropped() {
        let (send, looks) = channel();
        let watch = Watch::start(Duration::from_millis(2), move || {
            // The receiver is gone when the test has failed.
            let _ = send.send(());
        });
        for _ in 0..3 {
            assert!(looks.recv_timeout(Duration::from_secs(20)).is_ok());
        }
        drop(watch);
        while looks.try_recv().is_ok() {}
        assert!(looks.recv_timeout(Duration::from_millis(20)).is_err());
    }
}
