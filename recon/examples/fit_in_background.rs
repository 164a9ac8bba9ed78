//! A fit as a program with a window would run it: in a thread of its own, heard through a channel, and ended by a button.
//!
//! `cargo run -p unsphere-recon --example fit_in_background -- [events.jsonl]`; the events also go into the file, as lines of JSON.

use std::fs::File;
use std::io::Write;
use std::sync::mpsc::channel;

use datasets::Views;
use recon::fit::{FitConfig, fit};
use recon::progress::{Cancel, Event, JsonLines, Watch};
use synth::shapes::AlarmClock;
use synth::{Orbit, RenderOptions, render_views};

/// How long whoever sits at the window has patience, in steps.
const PATIENCE: u64 = 60;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut out = std::io::stdout();
    let cameras = Orbit { count: 24, width: 128, height: 128, ..Orbit::default() }.cameras();
    let clock = AlarmClock::default().build();
    let views = render_views(&clock, &cameras, &RenderOptions::default(), &|_, _| {})?;
    let views = Views::in_memory(views);

    let (tell, events) = channel();
    let button = Cancel::default();
    let mut watch = Watch::new(move |event: &Event| {
        // The window may be closed already.
        let _ = tell.send(event.clone());
    })
    .until(button.clone());
    if let Some(path) = std::env::args().nth(1) {
        watch = watch.and(JsonLines::new(File::create(path)?));
    }
    let fitted = std::thread::scope(|scope| {
        let worker = scope.spawn(move || fit(&views, &FitConfig::default(), &mut watch));
        for event in events {
            match event {
                Event::Step(step) if step.step == PATIENCE => button.cancel(),
                Event::Evaluated { step, metrics, .. } => {
                    writeln!(out, "after {step} steps: mask IoU {:.3}", metrics[0].value)?;
                }
                Event::Finished { ended, seconds, .. } => {
                    writeln!(out, "{ended:?} in {seconds:.1} s")?;
                }
                _ => {}
            }
        }
        let fitted = worker.join().map_err(|_| std::io::Error::other("the fit panicked"))?;
        fitted.map_err(std::io::Error::other)
    })?;
    writeln!(out, "{} steps; {}", fitted.history.len(), fitted.health)?;
    Ok(())
}
