//! What refinement on the given views brings to predictions of img2mesh, beside `fit` with the same views, and to those of
//! pixel2mesh, ode-pixel2mesh and mcmr on the one image; and what `predict --solid` makes of them.
//!
//! `cargo run --release -p unsphere-studies --example refinement -- weights/img2mesh.safetensors [KEY=VALUE ..]`: one line for
//! each way to a mesh, of the objects for validation that the weights' configuration makes. `data=FOLDER` scores objects of a
//! dataset, `split=test` those to test on, `views=N` gives so many views (5); `learning-rate`, `smoothness`, `bending`,
//! `tolerance`, `vertices`, `symmetry` and `thin-parts` are tried instead of img2mesh's own, `steps=50,150` one after the other; `fit=false` leaves `fit` out.
//! The other systems are refined as any system is, by `steps`; they have no use for the rest but `data` and `split`. mcmr's
//! objects are those of a folder, which `data` names, scored at the cameras of the other views as img2mesh's are.

use std::error::Error;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

use datasets::{ReadOptions, View, Views};
use mesh_core::TriMesh;
use models::img2mesh::{Data, Group, Img2Mesh, Img2MeshConfig, evaluate_meshes};
use models::mcmr::Mcmr;
use models::paired::{Pair, Pairs};
use models::pixel2mesh::{
    Continuous, Deformer, OdePixel2Mesh, Pixel2Mesh, Scored, SingleView, Staged,
};
use models::predict::Predictor;
use recon::fit::{FitConfig, FitError, RefineConfig, fit, refine, solidify};
use recon::progress::Watch;
use studies::pixel2mesh::changed;
use train::{Checkpoint, DataError, Source, Subset, System};

/// What is asked for.
struct Order {
    data: Option<PathBuf>,
    reading: ReadOptions,
    subset: Subset,
    views: usize,
    steps: Vec<usize>,
    refine: RefineConfig,
    fit: bool,
}

impl Order {
    fn source(&self, seed: u64) -> Source<'_, ReadOptions> {
        let path = self.data.as_deref();
        Source { path, options: &self.reading, seed, progress: &|_, _| () }
    }
}

fn order(arguments: &[String]) -> Result<Order, Box<dyn Error>> {
    let mut order = Order {
        data: None,
        reading: ReadOptions::default(),
        subset: Subset::Validation,
        views: 5,
        steps: vec![Img2Mesh::REFINE],
        refine: Img2Mesh::refinement(Img2Mesh::REFINE),
        fit: true,
    };
    for argument in arguments {
        let (key, value) = argument.split_once('=').ok_or("KEY=VALUE is expected")?;
        match key {
            "data" => order.data = Some(value.into()),
            "split" => {
                order.subset = match value {
                    "test" => Subset::Test,
                    "validation" => Subset::Validation,
                    _ => return Err("split is test or validation".into()),
                }
            }
            "views" => order.views = value.parse()?,
            "steps" => order.steps = value.split(',').map(str::parse).collect::<Result<_, _>>()?,
            "learning-rate" => order.refine.learning_rate = value.parse()?,
            "smoothness" => order.refine.smoothness = value.parse()?,
            "bending" => order.refine.bending = value.parse()?,
            "tolerance" => order.refine.tolerance = value.parse()?,
            "thin-parts" => order.refine.thin_parts = value.parse()?,
            "symmetry" => order.refine.symmetry = value.parse()?,
            "vertices" => order.refine.vertices = value.parse()?,
            "fit" => order.fit = value.parse()?,
            _ => return Err(format!("no option called {key}").into()),
        }
    }
    Ok(order)
}

/// A line of the table: what the meshes score, and the seconds of one.
fn line(
    name: &str,
    (data, config): (&Data, &Img2MeshConfig),
    order: &Order,
    mesh_of: impl Fn(&Group) -> Result<TriMesh, DataError> + Sync,
) -> Result<(), Box<dyn Error>> {
    let start = Instant::now();
    let metrics = evaluate_meshes(data, config, (order.subset, order.views), mesh_of)?;
    let seconds = start.elapsed().as_secs_f64() / data.trials(order.subset, order.views)? as f64;
    let mut out = std::io::stdout().lock();
    write!(out, "{name:>24} {seconds:5.2} s")?;
    for metric in metrics {
        write!(out, "  {} {:.4}", metric.name, metric.value)?;
    }
    writeln!(out)?;
    Ok(())
}

/// As `predict --solid` leaves a mesh.
fn solid(mesh: &TriMesh) -> Result<TriMesh, FitError> {
    if mesh.self_intersections().is_empty() { Ok(mesh.clone()) } else { solidify(mesh) }
}

/// The lines of pixel2mesh and ode-pixel2mesh: as the network made it, as a solid, and moved by the image's mask.
fn of_one_image<D: Deformer>(
    checkpoint: &Checkpoint<'_>,
    order: &Order,
) -> Result<(), Box<dyn Error>>
where
    SingleView<D>: System<ReadOptions = ReadOptions, Data = Pairs>,
{
    let (system, config) = checkpoint.load::<SingleView<D>>()?;
    let data = SingleView::<D>::open(&config.system, &order.source(config.train.seed))?;
    let mut out = std::io::stdout().lock();
    let mut line = |name: &str, scored: Scored| -> Result<(), Box<dyn Error>> {
        write!(out, "{name:>24}")?;
        for metric in scored.metrics() {
            write!(out, "  {} {:.4}", metric.name, metric.value)?;
        }
        Ok(writeln!(out)?)
    };
    line("one pass", system.scored(&data, order.subset)?)?;
    let views = (order.subset, system.shared().pairs.scored_views);
    let solid = |pair: &Pair| changed(&system, pair, |mesh, _| solid(mesh));
    line("as a solid", Scored::of(&data, views, solid)?)?;
    for &steps in &order.steps {
        let options = RefineConfig { steps, ..RefineConfig::default() };
        let moved =
            |mesh: &TriMesh, view: &View| refine(mesh, std::slice::from_ref(view), &options);
        let scored = Scored::of(&data, views, |pair| changed(&system, pair, moved))?;
        line(&format!("refined, {steps} steps"), scored)?;
    }
    Ok(())
}

/// The lines of mcmr, at the cameras of the views that it is not given.
fn of_photographs(checkpoint: &Checkpoint<'_>, order: &Order) -> Result<(), Box<dyn Error>> {
    order.data.as_ref().ok_or("mcmr's objects are those of data=FOLDER")?;
    let (system, config) = checkpoint.load::<Mcmr>()?;
    let cameras = Img2MeshConfig::default();
    let data = Img2Mesh::open(&cameras, &order.source(config.train.seed))?;
    let predict = |group: &Group| {
        let seen = system.predict(&group.given[..1]).map_err(DataError::unfit)?;
        Ok(seen.mesh_in_world())
    };
    line("one pass", (&data, &cameras), order, predict)?;
    for &steps in &order.steps {
        let options = RefineConfig { steps, ..RefineConfig::default() };
        line(&format!("refined, {steps} steps"), (&data, &cameras), order, |group| {
            refine(&predict(group)?, &group.given[..1], &options).map_err(DataError::unfit)
        })?;
    }
    Ok(())
}

fn fitted(group: &Group) -> TriMesh {
    let config = FitConfig { hold_out: None, level: 4, ..FitConfig::default() };
    let fitted = fit(&Views::in_memory(group.given.clone()), &config, &mut Watch::default());
    fitted.map(|fitted| fitted.mesh).unwrap_or_default()
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [weights, rest @ ..] = &arguments[..] else {
        return Err("the weights' file is missing".into());
    };
    let order = order(rest)?;
    let checkpoint = Checkpoint::read(Path::new(weights))?;
    match checkpoint.system()? {
        Pixel2Mesh::NAME => return of_one_image::<Staged>(&checkpoint, &order),
        OdePixel2Mesh::NAME => return of_one_image::<Continuous>(&checkpoint, &order),
        Mcmr::NAME => return of_photographs(&checkpoint, &order),
        _ => {}
    }
    let (system, config) = checkpoint.load::<Img2Mesh>()?;
    let data = Img2Mesh::open(&config.system, &order.source(config.train.seed))?;
    let scored = (&data, &config.system);
    let predict = |group: &Group| system.predict(&group.given).map_err(DataError::unfit);
    line("one pass", scored, &order, predict)?;
    line("as a solid", scored, &order, |group| solid(&predict(group)?).map_err(DataError::unfit))?;
    for &steps in &order.steps {
        let options = RefineConfig { steps, ..order.refine.clone() };
        line(&format!("refined, {steps} steps"), scored, &order, |group| {
            refine(&predict(group)?, &group.given, &options).map_err(DataError::unfit)
        })?;
    }
    if order.fit {
        line("fit", scored, &order, |group| Ok(fitted(group)))?;
    }
    Ok(())
}
