//! `unsphere demo`: the whole way, on an object whose true shape is known.

use std::path::PathBuf;
use std::time::Instant;

use datasets::{Layout, Views};
use synth::shapes::AlarmClock;
use synth::{Lighting, Orbit, RenderOptions, render_views, write_dataset};
use train::output::OutputFolder;

use crate::args::{Demo, Global};
use crate::command::fit::{Job, configuration};
use crate::console::Console;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::progress::Progress;

/// Where the results go when nothing is said.
const FOLDER: &str = "unsphere-demo";

pub(crate) fn run(console: Console, global: Global, arguments: &Demo) -> Result<(), Failure> {
    let start = Instant::now();
    let config = configuration(&arguments.configuration, global)?;
    let target = arguments.output.folder.clone().unwrap_or_else(|| PathBuf::from(FOLDER));
    // Refusals come before the work.
    let folder = OutputFolder::create(&target, arguments.output.force)?;
    let interrupt = Interrupt::listen(Some(folder.unfinished()))?;

    let clock = global.seed.map_or_else(AlarmClock::default, AlarmClock::sample).build();
    let size = arguments.size as usize;
    let orbit = Orbit {
        count: arguments.views as usize,
        width: size,
        height: size,
        seed: global.seed.unwrap_or(0),
        ..Orbit::default()
    };
    let options = RenderOptions {
        lighting: Lighting::studio(),
        depth: arguments.keep_views,
        ..RenderOptions::default()
    };
    let progress = Progress::new(console, "render");
    let views = render_views(&clock, &orbit.cameras(), &options, &|done, all| {
        progress.set(done, all);
    })
    .map_err(Failure::other)?;
    progress.finish();
    if arguments.keep_views {
        write_dataset(&views, &clock, &folder.path().join("views"))?;
    }
    let source = PathBuf::from("an alarm clock that was made for it");
    let views = Views { views, source, layout: Layout::Memory, warnings: Vec::new() };
    let title = "Alarm clock";
    Job { title, views, config: &config, truth: Some(&clock), folder, interrupt, start }
        .run(console)
}
