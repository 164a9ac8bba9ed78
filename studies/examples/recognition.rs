//! A sheet of predicted meshes for somebody to name who has not seen the objects, or beside the objects.
//!
//! `cargo run --release -p unsphere-studies --example recognition -- SYSTEM WEIGHTS OUT data=FOLDER[,FOLDER ..] [KEY=VALUE ..]`:
//! `count` test objects (24), as many of each folder, families in turn, drawn by `seed` (0); `views=N` are given (1), `refine=N`
//! steps are taken on them (as `predict` does), `families=a,b` leaves others out. OUT gets `sheet.png`, four objects a row in reading
//! order, each from three sides, and `key.csv`, which says what they are: look at it when the answers stand.
//!
//! With `beside=true` each has the first image that is given, then the mesh and the truth from a camera, drawn too, whose image is not
//! given; and `key.csv` has the mask IoU at all such cameras.

use std::error::Error;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use datasets::{Dataset, ReadOptions, Subsets, View};
use mesh_core::vector::widen;
use mesh_core::{ByteImage, Camera, TriMesh, bounds, encode_png};
use models::predict::{Choice, PredictInput, Predictor, refined};
use models::{Registry, register};
use rand::SeedableRng;
use rand::seq::{IndexedRandom, SliceRandom};
use rand_chacha::ChaCha8Rng;
use recon::evaluate::score_views;
use synth::{RenderOptions, render_view};
use train::Checkpoint;

/// Objects in a row of the sheet.
const ACROSS: usize = 4;
/// Sides that an object is shown from, degrees around it, and how far from above.
const SIDES: [f64; 3] = [35.0, 125.0, 250.0];
const ABOVE: f64 = 25.0;
/// Side of a picture, and the white between objects, pixels.
const SIDE: usize = 150;
const GAP: usize = 12;

type Failure = Box<dyn Error>;

/// What is asked for.
#[derive(Debug)]
struct Order {
    system: String,
    weights: PathBuf,
    out: PathBuf,
    data: Vec<PathBuf>,
    count: usize,
    seed: u64,
    views: usize,
    refine: Option<usize>,
    families: Vec<String>,
    beside: bool,
}

fn order(arguments: &[String]) -> Result<Order, Failure> {
    let [system, weights, out, rest @ ..] = arguments else {
        return Err("SYSTEM WEIGHTS OUT data=FOLDER are expected".into());
    };
    let mut order = Order {
        system: system.clone(),
        weights: weights.into(),
        out: out.into(),
        data: Vec::new(),
        count: 24,
        seed: 0,
        views: 1,
        refine: None,
        families: Vec::new(),
        beside: false,
    };
    for argument in rest {
        let (key, value) = argument.split_once('=').ok_or("KEY=VALUE is expected")?;
        match key {
            "data" => order.data = value.split(',').map(PathBuf::from).collect(),
            "count" => order.count = value.parse()?,
            "seed" => order.seed = value.parse()?,
            "views" => order.views = value.parse()?,
            "refine" => order.refine = Some(value.parse()?),
            "families" => order.families = value.split(',').map(str::to_owned).collect(),
            "beside" => order.beside = value.parse()?,
            _ => return Err(format!("no option called {key}").into()),
        }
    }
    if order.data.is_empty() {
        return Err("data=FOLDER is expected".into());
    }
    Ok(order)
}

/// Test objects of a dataset, one of each family in turn, drawn.
fn drawn(
    dataset: &dyn Dataset,
    order: &Order,
    count: usize,
    rng: &mut ChaCha8Rng,
) -> Result<Vec<usize>, Failure> {
    let entries = dataset.entries();
    let mut test = Subsets::of(entries, Some(5))?.test;
    let wanted = |object: &usize| {
        order.families.is_empty() || order.families.contains(&entries[*object].category)
    };
    test.retain(wanted);
    test.shuffle(rng);
    let earlier = |at: usize| {
        test[..at].iter().filter(|&&o| entries[o].category == entries[test[at]].category).count()
    };
    let mut turns: Vec<(usize, usize)> = (0..test.len()).map(|at| (earlier(at), at)).collect();
    turns.sort_unstable();
    Ok(turns.into_iter().take(count).map(|(_, at)| test[at]).collect())
}

/// One object of the sheet.
struct Shown {
    family: String,
    name: String,
    images: Vec<ByteImage>,
    /// At cameras whose images were not given, where there are some.
    mask_iou: Option<f64>,
}

fn predictions<S: Predictor>(order: &Order) -> Result<Vec<Shown>, Failure> {
    let (system, _) = Checkpoint::read(&order.weights)?.load::<S>()?;
    let steps = order.refine.unwrap_or(S::REFINE);
    let mut rng = ChaCha8Rng::seed_from_u64(order.seed);
    let options = ReadOptions { depth: true, ..ReadOptions::default() };
    let mut shown = Vec::new();
    for folder in &order.data {
        let dataset = datasets::open(folder)?;
        let count = order.count / order.data.len();
        for object in drawn(&*dataset, order, count, &mut rng)? {
            let entry = &dataset.entries()[object];
            let views = dataset.views(object, None, &options, &|_, _| ())?;
            let given = Choice::First(order.views.min(views.len()));
            let input = PredictInput::part(views, given)?;
            let mesh = refined(system.apply(&input)?, &input, &S::refinement(steps))?.mesh;
            let images =
                if order.beside { beside(&mesh, &input, &mut rng)? } else { sides(&mesh)? };
            let others: Vec<&View> = input.others.iter().collect();
            let mask_iou = if others.is_empty() {
                None
            } else {
                Some(score_views(&mesh, &others, &|_, _| ())?.mask_iou)
            };
            let (family, name) = (entry.category.clone(), entry.object_name());
            shown.push(Shown { family, name, images, mask_iou });
        }
    }
    shown.shuffle(&mut rng);
    Ok(shown)
}

/// A mesh from its sides, one beside the other.
fn sides(mesh: &TriMesh) -> Result<Vec<ByteImage>, Failure> {
    let around = mesh.bounds().ok_or("an empty mesh")?;
    let middle = widen(bounds::center(around));
    let radius = 0.5 * bounds::diagonal::<f64>(around);
    let options = RenderOptions::studio();
    let side = |degrees: &f64| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let (up, flat) = ABOVE.to_radians().sin_cos();
        let away = 3.2 * radius;
        let eye = [flat * sin, up, flat * cos].map(|x| away * x);
        let eye: [f64; 3] = std::array::from_fn(|k| middle[k] + eye[k]);
        let camera = Camera::look_at(eye, middle, [0.0, 1.0, 0.0], 0.62, SIDE, SIDE);
        Ok(render_view(mesh, &camera, &options)?.color)
    };
    SIDES.iter().map(side).collect()
}

/// The image, the mesh from elsewhere, and what is there.
fn beside(
    mesh: &TriMesh,
    input: &PredictInput,
    rng: &mut ChaCha8Rng,
) -> Result<Vec<ByteImage>, Failure> {
    let elsewhere = input.others.choose(rng).ok_or("no view is left that is not given")?;
    let predicted = render_view(mesh, &elsewhere.camera, &RenderOptions::studio())?.color;
    Ok(vec![input.given[0].over([255; 3]), predicted, elsewhere.over([255; 3])])
}

fn sheet(shown: &[Shown]) -> Result<ByteImage, Failure> {
    let first = &shown.first().ok_or("no object to show")?.images;
    let [height, width] = [first[0].height, first[0].width];
    let cell = [height + GAP, first.len() * width + GAP];
    let rows = shown.len().div_ceil(ACROSS);
    let mut sheet = ByteImage::new(rows * cell[0], ACROSS * cell[1], 3);
    sheet.data.fill(255);
    for (i, one) in shown.iter().enumerate() {
        for (k, image) in one.images.iter().enumerate() {
            let corner = [i / ACROSS * cell[0], i % ACROSS * cell[1] + k * width];
            sheet.paste(image, corner);
        }
    }
    Ok(sheet)
}

/// The system that is asked for, when it comes by.
struct Asked<'a> {
    order: &'a Order,
    found: Option<Result<Vec<Shown>, Failure>>,
}

impl Registry for Asked<'_> {
    fn register<S: Predictor>(&mut self) {
        if S::NAME == self.order.system {
            self.found = Some(predictions::<S>(self.order));
        }
    }
}

fn write(shown: &[Shown], out: &Path) -> Result<(), Failure> {
    std::fs::create_dir_all(out)?;
    std::fs::write(out.join("sheet.png"), encode_png(&sheet(shown)?))?;
    let mut key = String::from("row,column,family,object,mask_iou\n");
    for (i, one) in shown.iter().enumerate() {
        let iou = one.mask_iou.map_or(String::new(), |iou| format!("{iou:.3}"));
        writeln!(key, "{},{},{},{},{iou}", 1 + i / ACROSS, 1 + i % ACROSS, one.family, one.name)?;
    }
    Ok(std::fs::write(out.join("key.csv"), key)?)
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let order = order(&arguments)?;
    let mut asked = Asked { order: &order, found: None };
    register(&mut asked);
    let shown = asked.found.ok_or_else(|| format!("no system called {}", order.system))??;
    write(&shown, &order.out)
}
