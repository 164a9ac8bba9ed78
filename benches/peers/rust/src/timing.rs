//! How long a piece of work takes.

use std::time::{Duration, Instant};

use serde_json::json;

/// Time for each case, and runs at the least.
const SECONDS: f64 = 1.0;
const RUNS: usize = 7;

/// Times `work` after two runs that do not count, and prints the median.
pub fn report(id: &str, peer: &str, mut work: impl FnMut()) {
    (0..2).for_each(|_| work());
    let mut durations: Vec<Duration> = Vec::new();
    let start = Instant::now();
    while durations.len() < RUNS || start.elapsed().as_secs_f64() < SECONDS {
        let before = Instant::now();
        work();
        durations.push(before.elapsed());
    }
    durations.sort_unstable();
    let milliseconds = |duration: Duration| duration.as_secs_f64() * 1e3;
    let row = json!({
        "id": id,
        "peer": peer,
        "median_ms": milliseconds(durations[durations.len() / 2]),
        "min_ms": milliseconds(durations[0]),
        "runs": durations.len(),
    });
    println!("{row}");
}
