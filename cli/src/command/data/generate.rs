//! `unsphere data generate`: a dataset of our own making.

use std::path::Path;
use std::time::Instant;

use serde::Serialize;
use synth::generate::{
    CameraSet, GenerateConfig, GenerateError, Generated, Model, ModelFolder, OutputLayout,
    SplitList, UNFINISHED, generate_shard,
};
use synth::progress::Event;
use synth::shapes::Family;
use train::report::counted;
use train::settings::{SettingsError, read_text, settings_of, toml};

use crate::args::{DepthKind, Generate, Global};
use crate::console::{Console, table};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::progress::Progress;

/// What is printed with `--json`.
#[derive(Debug, Serialize)]
struct Summary<'a> {
    #[serde(serialize_with = "train::path_text::serialize")]
    output: &'a Path,
    shard: String,
    /// Whether the objects of all shares are there.
    complete: bool,
    objects: usize,
    made: usize,
    skipped: usize,
    views: usize,
    faces: [usize; 2],
    seconds: f64,
}

pub(crate) fn run(console: Console, global: Global, arguments: &Generate) -> Result<(), Failure> {
    let start = Instant::now();
    let config = configuration(arguments, global)?;
    let models = models(console, arguments)?;
    let output = &arguments.output;
    let interrupt = Interrupt::listen(Some(&output.join(UNFINISHED)))?;
    // Every object that is complete is worth keeping, so the first press lets them be completed.
    interrupt.worthwhile();
    let progress = Progress::new(console.unlogged(), "generate");
    let bar = |event: &Event| {
        if let Event::Progress { done, total, .. } = event {
            progress.set(*done as usize, *total as usize);
        }
    };
    let mut watch = console.watch(&interrupt, bar);
    let shard = arguments.shard.unwrap_or_default();
    let generated = generate_shard(&config, &models, shard, output, &mut watch);
    let generated = generated.map_err(failure)?;
    drop(watch);
    progress.finish();
    if generated.ended.is_cancelled() {
        let Generated { objects, total, .. } = &generated;
        return Err(Failure::Interrupted(format!(
            "{} of {} complete in {}; the same command again goes on from there",
            objects.len(),
            counted(*total, "object"),
            output.display()
        )));
    }
    let faces = generated.objects.iter().map(|object| object.faces);
    let summary = Summary {
        output,
        shard: shard.to_string(),
        complete: generated.complete,
        objects: generated.objects.len(),
        made: generated.made,
        skipped: generated.skipped,
        views: generated.objects.iter().map(|object| object.views).sum(),
        faces: [faces.clone().min().unwrap_or(0), faces.max().unwrap_or(0)],
        seconds: start.elapsed().as_secs_f64(),
    };
    console.result(&summary, |s| {
        let objects = match s.skipped {
            0 => s.objects.to_string(),
            skipped => format!("{}, of which {skipped} were there already", s.objects),
        };
        let mut rows = vec![
            ("dataset", s.output.display().to_string()),
            ("objects", objects),
            ("views", s.views.to_string()),
            ("faces", format!("{} to {} an object", s.faces[0], s.faces[1])),
        ];
        rows.push(if s.complete {
            ("sheet", s.output.join("contact_sheet.png").display().to_string())
        } else {
            ("share", format!("{}, whose others are not done yet", s.shard))
        });
        rows.push(("time", format!("{:.1} s", s.seconds)));
        table(rows)
    })
}

/// The meshes that the objects are; none where they are drawn.
fn models(console: Console, arguments: &Generate) -> Result<Vec<Model>, Failure> {
    let Some(path) = &arguments.from else { return Ok(Vec::new()) };
    let list = arguments.splits.as_deref().map(SplitList::read).transpose();
    let list = list.map_err(Failure::input)?;
    if !path.is_dir() {
        if list.is_some() {
            return Err(Failure::Usage("--splits is for a folder of meshes".to_owned()));
        }
        return Ok(vec![Model::read(path, arguments.normalize).map_err(Failure::input)?]);
    }
    let found = ModelFolder::read(path, arguments.normalize, list.as_ref());
    let found = found.map_err(Failure::input)?;
    found.refused.iter().for_each(|error| console.warn(format_args!("{error}; left out")));
    if found.unlisted > 0 {
        let count = found.unlisted;
        let meshes = if count == 1 { "1 mesh is" } else { &format!("{count} meshes are") };
        console.remark(format_args!("{meshes} left out, without a subset in the list"));
    }
    if let Some(first) = found.absent.first() {
        let rows = counted(found.absent.len(), "row");
        console.warn(format_args!(
            "--splits: {rows} without a mesh in {}, the first of which names {first:?}: files are KIND/NAME.obj and the like, as the \
             folder has them",
            path.display()
        ));
    }
    Ok(found.models)
}

/// The options, over the settings, over the configuration file, over the defaults.
fn configuration(arguments: &Generate, global: Global) -> Result<GenerateConfig, Failure> {
    let given = &arguments.configuration;
    let text = given.config.as_deref().map(config_text).transpose()?.unwrap_or_default();
    let name = given.config.as_deref().unwrap_or_else(|| Path::new("configuration"));
    let mut config: GenerateConfig = read_text(name, &text, &given.set)?;
    if !arguments.families.is_empty() {
        config.families = families(&arguments.families)?;
    }
    // Of a photograph there is one, unless somebody says otherwise.
    let names_views =
        given.set.iter().any(|(key, _)| key == "views") || settings_of(&text).contains_key("views");
    if arguments.cameras == Some(CameraSet::Collection) && !names_views {
        config.views = 1;
    }
    config.layout = arguments.layout.unwrap_or(config.layout);
    config.cameras = arguments.cameras.unwrap_or(config.cameras);
    let of_r2n2 = [("--points", arguments.points), ("--voxels", arguments.voxels)];
    if config.layout != OutputLayout::R2n2
        && let Some((option, _)) = of_r2n2.into_iter().find(|(_, number)| number.is_some())
    {
        let text = format!("{option} is of the layout r2n2 (--layout r2n2)");
        return Err(Failure::Usage(text));
    }
    config.objects = arguments.objects.unwrap_or(config.objects);
    config.views = arguments.views.unwrap_or(config.views);
    config.points = arguments.points.unwrap_or(config.points);
    config.voxels = arguments.voxels.unwrap_or(config.voxels);
    config.normals = arguments.normals.or(config.normals);
    let [width, height] = arguments.size.unwrap_or([config.width, config.height]);
    (config.width, config.height) = (width, height);
    if !arguments.depth.is_empty() {
        config.depth = arguments.depth.contains(&DepthKind::True);
        let monocular = arguments.depth.contains(&DepthKind::Monocular);
        config.monocular = monocular.then(|| config.monocular.take().unwrap_or_default());
    }
    if let Some(color) = arguments.background {
        config.background = color.map(|byte| f32::from(byte) / 255.0);
    }
    if let Some(light) = arguments.light {
        config.lighting = light();
    }
    config.seed = global.seed.unwrap_or(config.seed);
    Ok(config)
}

/// The text of a configuration file. A dataset keeps its own in a table, beside what it was made by.
fn config_text(path: &Path) -> Result<String, SettingsError> {
    let text = std::fs::read_to_string(path)
        .map_err(|source| SettingsError::Io { path: path.to_owned(), source })?;
    let kept = text.parse::<toml::Table>().ok().and_then(|mut table| table.remove("dataset"));
    Ok(kept.and_then(|dataset| toml::to_string(&dataset).ok()).unwrap_or(text))
}

/// The families of these names; `all` stands for every one.
fn families(names: &[String]) -> Result<Vec<Family>, Failure> {
    if names.iter().any(|name| name == "all") {
        return Ok(Family::ALL.to_vec());
    }
    let named = names.iter().map(|name| name.trim().parse::<Family>());
    named.collect::<Result<_, _>>().map_err(|e| Failure::Usage(format!("--families: {e}")))
}

fn failure(error: GenerateError) -> Failure {
    match error {
        GenerateError::Config(_)
        | GenerateError::Different { .. }
        | GenerateError::Reach { .. } => Failure::Usage(error.to_string()),
        GenerateError::Model(_) => Failure::input(error),
        other => Failure::other(other),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::args::{Arguments, Command, DataVerb};
    use clap::Parser;
    use synth::Monocular;

    #[allow(irrefutable_let_patterns, reason = "other verbs are to come")]
    fn config(line: &str) -> Result<GenerateConfig, String> {
        let words = ["unsphere", "data", "generate", "-o", "x"].into_iter();
        let line = words.chain(line.split(' ').filter(|word| !word.is_empty()));
        let arguments = Arguments::try_parse_from(line).map_err(|e| e.to_string())?;
        let Command::Data(data) = arguments.command else { unreachable!() };
        let DataVerb::Generate(generate) = data.verb else { unreachable!() };
        configuration(&generate, arguments.global).map_err(|failure| format!("{failure:?}"))
    }

    #[test]
    fn options_say_what_they_mean() {
        assert_eq!(config("").unwrap(), GenerateConfig::default());
        let plain = config("--families plane,car --objects 200 --layout r2n2 --seed 7").unwrap();
        assert_eq!(plain.families, [Family::Airplane, Family::Car]);
        assert_eq!((plain.objects, plain.seed, plain.layout), (200, 7, OutputLayout::R2n2));
        let photos = config("--cameras collection --size 64x48 --depth monocular").unwrap();
        assert_eq!((photos.views, photos.width, photos.height), (1, 64, 48));
        assert_eq!((photos.depth, photos.monocular), (false, Some(Monocular::default())));
        assert_eq!(config("--layout r2n2 --points 9").unwrap().points, 9);
        assert!(config("--points 9").unwrap_err().contains("--layout r2n2"));
        assert_eq!(config("--cameras collection --views 3").unwrap().views, 3);
        assert_eq!(config("--cameras collection --set views=4").unwrap().views, 4);
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("c.toml");
        for (text, views) in
            [("views = 5", 5), ("objects = 2", 1), ("version = \"1\"\n[dataset]\nviews = 6", 6)]
        {
            std::fs::write(&file, text).unwrap();
            let line = format!("--cameras collection --config {}", file.display());
            assert_eq!(config(&line).unwrap().views, views);
        }
        assert_eq!(config("--families all").unwrap().families, Family::ALL);
        let set = config("--depth true,monocular --set monocular={blur=[0,0]}").unwrap();
        assert_eq!((set.depth, set.monocular.unwrap().blur), (true, [0.0, 0.0]));
        assert!(config("--families dog").unwrap_err().contains("alarm_clock"));
        assert!(config("--from a.obj --families car").is_err());
        assert!(config("--normalize none").is_err());
        assert!(config("--set vieuws=3").unwrap_err().contains("vieuws=3"));
    }
}
