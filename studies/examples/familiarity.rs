//! How well the familiarity that weights carry tells objects of families that were trained on from others.
//!
//! `cargo run --release -p unsphere-studies --example familiarity -- weights/img2mesh.safetensors [KEY=VALUE ..]`: the area under
//! the receiver operating characteristic, that is the probability that an object of another family is judged farther than one of a
//! trained family. The former are the procedural test objects of `families=bus,alarm_clock`, the latter those of the system's own
//! data; of a dataset, `data=FOLDER`, its test objects are either, by the name of their family. Both can be given several times.
//! `write=FILE` first has the familiarity learned anew from the system's own data, and writes the weights with it and with the card
//! that they have.

use std::error::Error;
use std::io::Write;
use std::path::Path;

use datasets::ReadOptions;
use models::depth::{DepthPixel2Mesh, MeshRcnn};
use models::img2mesh::Img2Mesh;
use models::mcmr::Mcmr;
use models::pixel2mesh::{OdePixel2Mesh, Pixel2Mesh};
use models::predict::{Familiarity, Predictor};
use train::settings::{read_text, to_toml};
use train::{Checkpoint, Configuration, Source, Subset, System};

/// Objects of a source that are judged at most.
const MOST: usize = 1000;

/// A source of objects: its name, its path where it is on disk, and what the configuration says otherwise for it.
type Place<'a> = (&'a str, Option<&'a Path>, Vec<(String, String)>);

/// A judged object.
struct Judged {
    source: String,
    family: String,
    distance: f64,
    quantile: f64,
}

/// The probability that one of `far` is larger than one of `near`; of equal ones half.
fn auroc(near: &[f64], far: &[f64]) -> f64 {
    let above = |f: &f64| -> f64 {
        near.iter()
            .map(|n| f64::from(u8::from(f > n)) / 2.0 + f64::from(u8::from(f >= n)) / 2.0)
            .sum()
    };
    far.iter().map(above).sum::<f64>() / (near.len() * far.len()) as f64
}

fn judged<S: Predictor>(
    (system, config, familiarity): (&S, &Configuration<S::Config>, &Familiarity),
    (name, path, settings): Place<'_>,
) -> Result<Vec<Judged>, Box<dyn Error>> {
    let config: Configuration<S::Config> =
        read_text("weights".as_ref(), &to_toml(config), &settings)?;
    let options = ReadOptions::default();
    let seed = config.train.seed;
    let data =
        S::open(&config.system, &Source { path, options: &options, seed, progress: &|_, _| () })?;
    let seen = system.features_of(&data, Subset::Test, MOST)?;
    let judged = seen.into_iter().map(|object| {
        let judgement = familiarity.judge(&object.features)?;
        let (distance, quantile) = (judgement.distance, judgement.quantile);
        Ok(Judged { source: name.to_owned(), family: object.family, distance, quantile })
    });
    judged.collect()
}

/// The familiarity with the system's own data; written with the weights to a file.
fn learned<S: Predictor>(
    checkpoint: &Checkpoint<'_>,
    (system, config): (&S, &Configuration<S::Config>),
    file: &Path,
) -> Result<Option<Familiarity>, Box<dyn Error>> {
    let options = ReadOptions::default();
    let seed = config.train.seed;
    let source = Source { path: None, options: &options, seed, progress: &|_, _| () };
    let familiarity = Familiarity::of_data(system, &S::open(&config.system, &source)?)?;
    if let Some(familiarity) = &familiarity {
        let card = checkpoint.card().unwrap_or_default();
        std::fs::write(file, checkpoint.weights_beside(card, &familiarity.to_state()))?;
    }
    Ok(familiarity)
}

fn study<S: Predictor>(
    checkpoint: &Checkpoint<'_>,
    settings: &[String],
) -> Result<(), Box<dyn Error>> {
    let (system, config) = checkpoint.load::<S>()?;
    let known = match settings.iter().find_map(|setting| setting.strip_prefix("write=")) {
        Some(file) => learned(checkpoint, (&system, &config), file.as_ref())?,
        None => Familiarity::of(checkpoint)?,
    };
    let familiarity = known.ok_or("these weights do not know what they were trained on")?;
    let asked = (&system, &config, &familiarity);
    let mut all = judged(asked, ("own", None, Vec::new()))?;
    let mut known: Vec<String> = all.iter().map(|object| object.family.clone()).collect();
    known.sort();
    known.dedup();
    for setting in settings {
        let place: Place<'_> = match setting.split_once('=') {
            Some(("data", folder)) => (folder, Some(Path::new(folder)), Vec::new()),
            Some(("families", names)) => {
                let names: Vec<String> = names.split(',').map(|name| format!("{name:?}")).collect();
                (
                    "procedural",
                    None,
                    vec![("families".to_owned(), format!("[{}]", names.join(",")))],
                )
            }
            Some(("write", _)) => continue,
            _ => return Err("data=FOLDER, families=NAMES or write=FILE is expected".into()),
        };
        all.extend(judged(asked, place)?);
    }
    let is_known = |object: &&Judged| known.contains(&object.family);
    let distances = |which: &dyn Fn(&&Judged) -> bool| -> Vec<f64> {
        all.iter().filter(which).map(|object| object.distance).collect()
    };
    let (near, far) = (distances(&is_known), distances(&|object| !is_known(object)));
    let mut out = std::io::stdout().lock();
    let mut kinds: Vec<(bool, &str, &str)> =
        all.iter().map(|o| (!is_known(&o), o.source.as_str(), o.family.as_str())).collect();
    kinds.sort_unstable();
    kinds.dedup();
    for (other, source, family) in kinds {
        let here = |object: &&Judged| object.source == source && object.family == family;
        let beyond = all.iter().filter(here).filter(|object| object.quantile >= 1.0).count();
        let these = distances(&here);
        let area = if other { auroc(&near, &these) } else { auroc(&these, &far) };
        let kind = if other { "other" } else { "trained" };
        writeln!(
            out,
            "{kind:>8} {family:<12} {:4} objects, beyond all of validation {:3.0} %, AUROC {area:.3}  {source}",
            these.len(),
            100.0 * beyond as f64 / these.len() as f64,
        )?;
    }
    let own: Vec<f64> = distances(&|object| is_known(object) && object.source == "own");
    let people = distances(&|object| is_known(object) && object.source != "own");
    for (name, near) in [("all", &near), ("own test objects", &own), ("those of datasets", &people)]
    {
        let count = near.len();
        writeln!(
            out,
            "AUROC {:.3}: {} others and {count} trained, {name}",
            auroc(near, &far),
            far.len()
        )?;
    }
    Ok(())
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [weights, settings @ ..] = &arguments[..] else {
        return Err("the weights' file is missing".into());
    };
    let checkpoint = Checkpoint::read(Path::new(weights))?;
    match checkpoint.system()? {
        Img2Mesh::NAME => study::<Img2Mesh>(&checkpoint, settings),
        MeshRcnn::NAME => study::<MeshRcnn>(&checkpoint, settings),
        Pixel2Mesh::NAME => study::<Pixel2Mesh>(&checkpoint, settings),
        OdePixel2Mesh::NAME => study::<OdePixel2Mesh>(&checkpoint, settings),
        DepthPixel2Mesh::NAME => study::<DepthPixel2Mesh>(&checkpoint, settings),
        Mcmr::NAME => study::<Mcmr>(&checkpoint, settings),
        other => Err(format!("no weights of {other} are shipped").into()),
    }
}
