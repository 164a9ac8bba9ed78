//! `unsphere demo`: the whole way, on an object whose true shape is known.

use std::path::PathBuf;
use std::time::Instant;

use datasets::{ReadOptions, Views};
use mesh_core::UpAxis;
use synth::shapes::AlarmClock;
use synth::{Lighting, Orbit, RenderOptions, render_views, write_dataset};

use crate::args::{Demo, Global};
use crate::command::fit::{Job, configuration};
use crate::console::Console;
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::progress::Progress;
use crate::truth::Truth;

/// Where the results go when nothing is said.
const FOLDER: &str = "unsphere-demo";

pub(crate) fn run(console: Console, global: Global, arguments: &Demo) -> Result<(), Failure> {
    let start = Instant::now();
    let config = configuration(&arguments.configuration, global)?;
    let folder = arguments.output.create(FOLDER)?;
    let interrupt = Interrupt::listen(Some(folder.unfinished()))?;

    let clock = global.seed.map_or_else(AlarmClock::default, AlarmClock::sample).build();
    let (count, size) = (arguments.views as usize, arguments.size as usize);
    let seed = global.seed.unwrap_or(0);
    let orbit = Orbit { count, width: size, height: size, seed, ..Orbit::default() };
    let (lighting, depth) = (Lighting::studio(), arguments.keep_views);
    let options = RenderOptions { lighting, depth, ..RenderOptions::default() };
    let progress = Progress::new(console, "render");
    let told = |done, all| progress.set(done, all);
    let views = render_views(&clock, &orbit.cameras(), &options, &told).map_err(Failure::other)?;
    progress.finish();
    if arguments.keep_views {
        let place = folder.path().join("views");
        write_dataset(&views, &clock, &place).map_err(Failure::other)?;
    }
    let source = PathBuf::from("an alarm clock that was made for it");
    let views = Views { source, ..Views::in_memory(views) };
    let title = "Alarm clock";
    let truth = Truth::known(clock);
    let (truth, up) = (Some(&truth), UpAxis::Y);
    let (config, listed, strict) = (&config, None, false);
    let reading = &ReadOptions::default();
    Job { title, views, reading, config, truth, up, folder, interrupt, listed, strict, start }
        .run(console)
}
