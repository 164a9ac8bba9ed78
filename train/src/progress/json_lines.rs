//! Events as lines of JSON.

use std::io::{self, Write};
use std::time::Instant;

use serde::Serialize;

use super::{Event, Observer};

/// Writes events as JSON, one object a line, each as soon as it comes.
///
/// A job does not end because its log cannot be written: what failed first is kept, and nothing is written behind it.
#[derive(Debug)]
pub struct JsonLines<W> {
    out: W,
    begun: Instant,
    failed: Option<io::Error>,
}

/// What stands in a line.
#[derive(Serialize)]
struct Line<'a, T> {
    /// Seconds since the log began.
    time: f64,
    #[serde(flatten)]
    told: &'a T,
}

impl<W: Write> JsonLines<W> {
    /// A log that begins now.
    pub fn new(out: W) -> Self {
        Self { out, begun: Instant::now(), failed: None }
    }

    /// Adds a line: the time, and what the value, which must be an object, has.
    pub fn add(&mut self, told: &impl Serialize) {
        if self.failed.is_none() {
            let time = self.begun.elapsed().as_secs_f64();
            let line = serde_json::to_string(&Line { time, told }).map_err(io::Error::from);
            // In one piece, so that who reads along meets whole lines.
            let written = line
                .and_then(|line| self.out.write_all((line + "\n").as_bytes()))
                .and_then(|()| self.out.flush());
            self.failed = written.err();
        }
    }

    /// Why lines are missing, if some are: what the first write that failed said.
    pub fn failure(&self) -> Option<&io::Error> {
        self.failed.as_ref()
    }
}

impl<W: Write> Observer for JsonLines<W> {
    fn event(&mut self, event: &Event) {
        self.add(event);
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    /// A disk with room for so many bytes.
    struct Disk(Vec<u8>, usize);

    impl Write for Disk {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            if self.0.len() + bytes.len() > self.1 {
                return Err(io::Error::other("full"));
            }
            self.0.extend_from_slice(bytes);
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn lines_end_where_the_disk_is_full() {
        let mut lines = JsonLines::new(Disk(Vec::new(), 150));
        for k in 0..5 {
            lines.event(&Event::Warned { text: format!("no\nnew line {k}") });
        }
        assert_eq!(lines.failure().unwrap().to_string(), "full");
        let text = String::from_utf8(std::mem::take(&mut lines.out.0)).unwrap();
        assert!(text.ends_with('\n') && text.lines().count() < 5, "{text}");
        for line in text.lines() {
            let line: serde_json::Value = serde_json::from_str(line).unwrap();
            assert!(line["time"].as_f64().unwrap() >= 0.0 && line["event"] == "warned");
        }
    }
}
