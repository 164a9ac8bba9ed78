//! From a fit to the folder that a user keeps: meshes, turntable, report and figures.

mod refinement;

pub use refinement::Refinement;

use std::collections::BTreeMap;
use std::sync::Mutex;

use datasets::{View, Views};
use diff_raster::FacesError;
use losses::metrics::{CompareError, Preset, Report as Comparison, evaluate};
use mesh_core::io::{glb, write_mesh};
use mesh_core::{ByteImage, Examination, Health, TriMesh, UpAxis, WriteError};
use serde::Serialize;
use synth::{Lighting, RenderOptions, render_views};
use train::output::{OutputError, OutputFolder};
use train::report::{Chart, Figure, Report, Series, Table, ViewPair};

use crate::evaluate::{ViewScores, masked, score_views, seen_from};
use crate::fit::{FitConfig, Fitted, PhotoConsistency};
use crate::scene::scene_of;
use crate::turntable::{encode_gif, orbit};
use crate::verdict::{Assessment, Evidence, Verdict};

/// Views shown in the report; more make it long, not clearer.
const MOST_VIEWS: usize = 15;
/// Side of the report's images and of the turntable where nothing else is wished, pixels.
pub const PICTURE: usize = 256;
/// Frames of the turntable, a full turn.
const FRAMES: usize = 36;
/// Behind the turning mesh: light, so that dark objects stand out.
const BACKDROP: [f32; 3] = [0.93, 0.94, 0.96];

/// A finished fit and what it came from.
#[derive(Debug)]
pub struct Delivery<'a> {
    /// Heading of the report.
    pub title: &'a str,
    /// The command as it was typed.
    pub command: &'a str,
    /// The views that the mesh was fitted to and scored on.
    pub views: &'a Views,
    /// The options of the fit.
    pub config: &'a FitConfig,
    /// The fit.
    pub fitted: &'a Fitted,
    /// What is said of it.
    pub assessment: &'a Assessment,
    /// The object's true mesh, where it is known.
    pub truth: Option<&'a TriMesh>,
    /// Which way is up in the world of the cameras: turntable, page and GLB stand upright.
    pub up: UpAxis,
    /// More rows for the report's table: machine, threads, dates.
    pub provenance: Vec<(String, String)>,
}

/// What `metrics.json` holds: figures that depend on the input and the options alone.
///
/// Times are in the report, so that this file is the same byte for byte on every machine and for
/// every number of threads.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Metrics {
    /// Version of this layout.
    pub schema_version: u32,
    /// Steps that were taken.
    pub steps: usize,
    /// Whether the fit was stopped before its end.
    pub interrupted: bool,
    /// The axis that is up in the coordinates of the mesh: `y` for most, `z` for NeRF's. `mesh.glb` is turned so that it is +Y
    /// there, as in viewers; `mesh.ply` and `mesh.obj` are not.
    pub up: &'static str,
    /// How far the mesh can be trusted, and why.
    pub verdict: Verdict,
    /// What the verdict is made of.
    pub evidence: Evidence,
    /// What the cameras were refined by; none where they are those of the input.
    pub cameras: Option<Refinement>,
    /// The darkest and the brightest channel of a photograph beside the mesh's colours, in sRGB; none where photographs do not
    /// differ in exposure or white balance.
    pub exposure: Option<[f32; 2]>,
    /// Whether the surface was moved to where photographs agree, where that was asked for.
    pub photo_consistency: Option<PhotoConsistency>,
    /// Which views the scores are of: `held-out`, or `fitted` where none was held out.
    pub scored_on: &'static str,
    /// The scores on those views.
    pub views: ViewScores,
    /// Whether the mesh is whole.
    pub health: Health,
    /// Its holes, as in a ring, which has one; null where it is not closed.
    pub genus: Option<usize>,
    /// The same in words: `genus 3: three holes`.
    pub holes: Option<String>,
    /// Pairs of faces that run through each other.
    pub self_intersections: usize,
    /// Against the true mesh, one entry for each protocol; empty where it is not known.
    pub truth: Vec<Comparison>,
}

impl Metrics {
    /// What they say of the mesh by itself, for words.
    pub fn examination(&self) -> Examination {
        let self_intersections = self.self_intersections;
        Examination { health: self.health.clone(), self_intersections }
    }
}

/// Why a fit could not be delivered.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DeliverError {
    /// The folder could not be written.
    #[error(transparent)]
    Output(#[from] OutputError),
    /// A mesh could not be written.
    #[error(transparent)]
    Mesh(#[from] WriteError),
    /// The mesh is not one.
    #[error(transparent)]
    Faces(#[from] FacesError),
    /// The mesh cannot be compared with the true one.
    #[error(transparent)]
    Compare(#[from] CompareError),
}

/// Scores a fit and writes everything that a user keeps of it into the folder.
///
/// The files are `mesh.glb`, `mesh.obj` (with `mesh.mtl` and its image where there is a texture),
/// `mesh.ply`, `turntable.gif`, `report.html`, `metrics.json` and `config.toml`.
///
/// # Errors
/// If the folder cannot be written or the mesh cannot be scored.
pub fn deliver(delivery: &Delivery<'_>, folder: &OutputFolder) -> Result<Metrics, DeliverError> {
    let (metrics, pairs) = score(delivery)?;
    let options = train::settings::to_toml(delivery.config);
    folder.write("config.toml", options.as_bytes())?;
    let report = report(delivery, &metrics, pairs);
    let side = delivery.config.picture_size;
    write_results(&delivery.fitted.mesh, (delivery.up, side), &metrics, report, folder)?;
    Ok(metrics)
}

/// Writes `mesh.glb`, `mesh.obj`, `mesh.ply`, `turntable.gif`, `metrics.json` and `report.html`, which shows the
/// turntable too, `side` pixels wide. The GLB and the turntable stand upright; OBJ and PLY are in the world of the cameras.
///
/// # Errors
/// If a file cannot be written, or a face names a vertex that is not there.
///
/// # Panics
/// If the metrics cannot be JSON.
pub fn write_results(
    mesh: &TriMesh,
    (up, side): (UpAxis, usize),
    metrics: &impl Serialize,
    report: Report,
    folder: &OutputFolder,
) -> Result<(), DeliverError> {
    glb::write_upright(folder.path().join("mesh.glb"), mesh, up)?;
    for name in ["mesh.obj", "mesh.ply"] {
        write_mesh(folder.path().join(name), mesh)?;
    }
    let turntable = turntable(&mesh.clone().upright(up), side)?;
    folder.write("turntable.gif", &turntable)?;
    let json = serde_json::to_string_pretty(metrics).expect("plain figures serialise");
    folder.write("metrics.json", (json + "\n").as_bytes())?;
    let page = Report { turntable: Some(turntable), ..report }.to_html();
    folder.write("report.html", page.as_bytes())?;
    Ok(())
}

/// The mesh turning once, as a GIF `side` pixels wide.
///
/// # Errors
/// If a face names a vertex that is not there.
pub fn turntable(mesh: &TriMesh, side: usize) -> Result<Vec<u8>, FacesError> {
    let Some(bounds) = mesh.bounds() else { return Ok(Vec::new()) };
    let lighting = Lighting::for_mesh(mesh);
    let options = RenderOptions { background: BACKDROP, lighting, ..RenderOptions::default() };
    let cameras = orbit(bounds, FRAMES, 0.35, side);
    let frames: Vec<ByteImage> = render_views(mesh, &cameras, &options, &|_, _| ())?
        .into_iter()
        .map(|view| view.color)
        .collect();
    Ok(encode_gif(&frames, 8))
}

/// Meshes one after another from one camera that sees all of them, as a GIF whose last frame stays for a while.
///
/// # Errors
/// If a face names a vertex that is not there.
pub fn animation(meshes: &[TriMesh]) -> Result<Vec<u8>, FacesError> {
    /// How often the last frame is shown.
    const STAYS: usize = 8;
    let all: Vec<[f32; 3]> = meshes.iter().flat_map(|mesh| mesh.positions.clone()).collect();
    let Some(bounds) = TriMesh::new(all, Vec::new()).bounds() else { return Ok(Vec::new()) };
    // What has no colours shows its shape by the light alone.
    let lighting = Lighting::shape();
    let options = RenderOptions { background: BACKDROP, lighting, ..RenderOptions::default() };
    // From the side and above: the second of eight around.
    let camera = orbit(bounds, 8, 0.35, PICTURE).swap_remove(1);
    let mut frames = Vec::with_capacity(meshes.len() + STAYS);
    for mesh in meshes {
        frames.push(seen_from(mesh, &camera, &options)?.color);
    }
    let last = frames.last().cloned();
    frames.extend(last.into_iter().flat_map(|frame| std::iter::repeat_n(frame, STAYS)));
    Ok(encode_gif(&frames, 8))
}

fn score(delivery: &Delivery<'_>) -> Result<(Metrics, Vec<ViewPair>), DeliverError> {
    let fitted = delivery.fitted;
    let (scored_on, indices) = if fitted.held_out_views.is_empty() {
        ("fitted", &fitted.train_views)
    } else {
        ("held-out", &fitted.held_out_views)
    };
    let mut refined = Vec::new();
    if let Some(found) = &fitted.cameras {
        for &i in indices {
            let camera = found.cameras[i].clone();
            refined.push(View { camera, ..delivery.views.views[i].clone() });
        }
    }
    let views: Vec<&View> = match &fitted.cameras {
        Some(_) => refined.iter().collect(),
        None => indices.iter().map(|&i| &delivery.views.views[i]).collect(),
    };
    let (scores, pairs) = compare(&fitted.mesh, &views, delivery.config.picture_size)?;
    let against = |truth| {
        let protocols = Preset::ALL.map(|preset| preset.protocol(delivery.config.seed));
        protocols.iter().map(|p| evaluate(&fitted.mesh, truth, p)).collect::<Result<_, _>>()
    };
    let truth = delivery.truth.map(against).transpose()?.unwrap_or_default();
    let metrics = Metrics {
        schema_version: 1,
        steps: fitted.history.len(),
        interrupted: fitted.ended.is_cancelled(),
        up: delivery.up.name(),
        verdict: delivery.assessment.verdict.clone(),
        evidence: delivery.assessment.evidence.clone(),
        cameras: Refinement::of(fitted, &delivery.views.views)?,
        exposure: fitted.exposure_range(),
        photo_consistency: fitted.photo_consistency,
        scored_on,
        views: scores,
        health: fitted.health.clone(),
        genus: fitted.health.genus(),
        holes: holes(&fitted.health),
        self_intersections: fitted.self_intersections,
        truth,
    };
    Ok((metrics, pairs))
}

/// Scores a mesh on views, and shows it above them, at most `side` pixels wide: every so many where there are more than a
/// report has room for.
///
/// # Errors
/// If the mesh's faces cannot be drawn.
pub fn compare(
    mesh: &TriMesh,
    views: &[&View],
    side: usize,
) -> Result<(ViewScores, Vec<ViewPair>), FacesError> {
    let stride = views.len().div_ceil(MOST_VIEWS);
    // Renders arrive from any thread; a map keeps their order that of the views.
    let renders = Mutex::new(BTreeMap::new());
    let scores = score_views(mesh, views, &|index, render| {
        if index % stride == 0 {
            let picture = close_up(views[index], &shown_from(mesh, views[index], render), side);
            renders.lock().expect("no thread panicked").insert(index, picture);
        }
    })?;
    let pairs = renders.into_inner().expect("no thread panicked");
    let pairs = pairs.into_iter().map(|(index, (model, truth))| {
        let s = &scores.views[index];
        let psnr = s.psnr.map_or_else(String::new, |p| format!(", {p:.1} dB"));
        ViewPair { caption: format!("view {}: IoU {:.3}{psnr}", s.name, s.mask_iou), model, truth }
    });
    let pairs = pairs.collect();
    Ok((scores, pairs))
}

/// What the report shows of the mesh from a view. Scores are of what was rendered for them; what has no colours would be
/// a flat blob there, and shows its shape by light here.
fn shown_from(mesh: &TriMesh, view: &View, scored: ByteImage) -> ByteImage {
    let lighting = Lighting::for_mesh(mesh);
    if lighting.is_flat() {
        return scored;
    }
    let options = RenderOptions { lighting, ..RenderOptions::default() };
    seen_from(mesh, &view.camera, &options).map_or(scored, |view| view.color)
}

/// Render and photograph around the object: a square with a margin, at most so wide.
fn close_up(view: &View, render: &ByteImage, most: usize) -> (ByteImage, ByteImage) {
    let truth = masked(view);
    let Some([top, left, height, width]) = view.mask_bounds() else {
        return (render.clone(), truth);
    };
    let side = (height.max(width) * 5 / 4 + 4).min(view.color.width).min(view.color.height);
    let start = |low: usize, length: usize, limit: usize| {
        (low + length / 2).saturating_sub(side / 2).min(limit - side)
    };
    let x = start(left, width, view.color.width);
    let y = start(top, height, view.color.height);
    let picture = |image: &ByteImage| {
        let part = image.cropped(x, y, side, side);
        if side <= most { part } else { part.resized(most, most) }
    };
    (picture(render), picture(&truth))
}

fn report(delivery: &Delivery<'_>, metrics: &Metrics, views: Vec<ViewPair>) -> Report {
    let fitted = delivery.fitted;
    let source = delivery.views.source.display();
    let Assessment { verdict, pictures, .. } = delivery.assessment;
    let reason = |reason: &String| format!("{}: {reason}", verdict.grade);
    let mut warnings: Vec<String> = verdict.reasons.iter().map(reason).collect();
    warnings.extend(delivery.views.warnings.iter().cloned());
    warnings.extend(fitted.warnings.iter().cloned());
    if metrics.interrupted {
        warnings.push("The fit was interrupted: this is what it had by then.".into());
    }
    // Where it is worst, the difference stands above the photograph.
    let worst = pictures.iter().map(|view| ViewPair {
        caption: view.caption.clone(),
        model: view.difference.clone(),
        truth: view.photograph.clone(),
    });
    let views = worst.chain(views).collect();
    Report {
        title: delivery.title.into(),
        summary: format!(
            "Verdict: {}. A mesh deformed to agree with {} views of {source}; the figures are means over the {} {} views.",
            verdict.grade,
            fitted.train_views.len(),
            metrics.views.views.len(),
            metrics.scored_on,
        ),
        command: delivery.command.into(),
        scene: scene_of(&fitted.mesh.clone().upright(delivery.up)),
        figures: figures(metrics),
        warnings,
        views,
        charts: charts(delivery),
        tables: tables(delivery, metrics),
        turntable: None,
    }
}

/// The cards of mean scores over views; those of colours where the mesh has some.
pub fn score_figures(scores: &ViewScores) -> Vec<Figure> {
    let mut figures = vec![Figure::new("mask IoU", format!("{:.4}", scores.mask_iou))];
    if let Some(psnr) = scores.psnr {
        figures.extend([
            Figure::new("PSNR inside the mask", format!("{psnr:.1} dB")),
            Figure::new("image L1", format!("{:.4}", scores.image_l1)),
            Figure::new("SSIM", format!("{:.3}", scores.ssim)),
        ]);
    }
    figures
}

fn figures(metrics: &Metrics) -> Vec<Figure> {
    let mut figures = vec![Figure::new("verdict", metrics.verdict.grade.name())];
    figures.extend(score_figures(&metrics.views));
    // One protocol is enough for the cards, the one whose unit is the object itself; the tables have all.
    let occnet = metrics.truth.iter().find(|c| c.protocol.name == Preset::OccNet.name());
    if let Some(comparison) = occnet {
        let score = comparison.f_scores.first();
        let cards = [
            ("Chamfer, of the longest side", comparison.chamfer.map(|v| format!("{v:.5}"))),
            ("F-score at 1 % of that", score.map(|f| format!("{:.3}", f.f_score))),
            ("3D IoU, as they lie", comparison.iou.map(|v| format!("{v:.3}"))),
        ];
        figures.extend(cards.into_iter().filter_map(|(name, v)| Some(Figure::new(name, v?))));
    }
    figures
}

fn charts(delivery: &Delivery<'_>) -> Vec<Chart> {
    let fitted = delivery.fitted;
    let mut losses: BTreeMap<&str, Vec<(f64, f64)>> = BTreeMap::new();
    for step in &fitted.history {
        for (name, value) in &step.terms {
            losses.entry(name).or_default().push((step.step as f64, *value));
        }
    }
    let losses = losses.into_iter().map(|(name, points)| Series::new(name, points)).collect();
    let scores = fitted.evaluations.iter().map(|&(step, iou)| (step as f64, iou)).collect();
    let scores = vec![Series::new("mask IoU", scores)];
    vec![
        Chart::new("Losses, each as weighted", "step", losses).logarithmic(),
        Chart::new("Mask IoU on the scored views", "step", scores),
    ]
}

fn tables(delivery: &Delivery<'_>, metrics: &Metrics) -> Vec<Table> {
    let mut tables = vec![mesh_table(&metrics.examination())];
    for comparison in &metrics.truth {
        let mut rows = vec![("formula".to_owned(), comparison.protocol.formula.clone())];
        rows.extend(comparison_rows(comparison));
        let title = format!("Against the true mesh: {}", comparison.protocol.name);
        tables.push(Table { title, rows });
    }
    let (fitted, views) = (delivery.fitted, delivery.views);
    let mut rows = vec![
        ("input".to_owned(), format!("{} ({})", views.source.display(), views.layout)),
        ("steps".to_owned(), fitted.history.len().to_string()),
    ];
    let seconds = fitted.seconds.iter();
    rows.extend(seconds.map(|(name, s)| (name.clone(), format!("{s:.2} s"))));
    rows.extend(delivery.provenance.iter().cloned());
    tables.push(Table::new("The run", rows));
    tables
}

/// The figures of a comparison by name, each with its protocol's unit: the one list for every printout and page, so
/// that a figure has one name and no two figures look alike that are not.
pub fn comparison_rows(comparison: &Comparison) -> Vec<(String, String)> {
    let protocol = &comparison.protocol;
    let unit = protocol.distance_unit();
    let mut rows = Vec::new();
    for (name, value) in [
        ("Chamfer", comparison.chamfer),
        ("prediction to truth", comparison.accuracy),
        ("truth to prediction", comparison.completeness),
    ] {
        rows.extend(value.map(|value| (name.to_owned(), format!("{value:.6}  ({unit})"))));
    }
    for score in &comparison.f_scores {
        let name = format!("F-score at {:.4}", score.threshold);
        rows.push((name, format!("{:.4}  (share of points, 0 to 1)", score.f_score)));
    }
    let normals = comparison.normal_consistency;
    rows.extend(normals.map(|v| ("normals".to_owned(), format!("{v:.4}  (mean |cos|, 0 to 1)"))));
    rows.extend(protocol.volume_unit().map(|what| {
        let value = comparison.iou.map_or_else(
            || "none: a mesh that is flat has no volume".to_owned(),
            |iou| format!("{iou:.4}  ({what})"),
        );
        ("3D IoU".to_owned(), value)
    }));
    rows
}

/// The genus of a mesh in words, as in `genus 3: three holes`; with several parts, how many there are. `None` of one that is
/// not closed.
///
/// ```
/// use mesh_core::primitives::{icosphere, torus};
/// use recon::delivery::holes;
///
/// assert_eq!(holes(&icosphere(1).health()).as_deref(), Some("genus 0: no holes"));
/// assert_eq!(holes(&torus(1.0, 0.3, 16, 8).health()).as_deref(), Some("genus 1: one hole"));
/// ```
pub fn holes(health: &Health) -> Option<String> {
    const WORDS: [&str; 10] =
        ["no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine"];
    let counted = |count: usize, what: &str| {
        let number = WORDS.get(count).map_or_else(|| count.to_string(), |word| (*word).to_owned());
        format!("{number} {what}{}", if count == 1 { "" } else { "s" })
    };
    let genus = health.genus()?;
    let parts = match health.components {
        0 | 1 => String::new(),
        count => format!(", in {}", counted(count, "part")),
    };
    Some(format!("genus {genus}: {}{parts}", counted(genus, "hole")))
}

/// What there is to say about a mesh by itself.
pub fn mesh_table(found: &Examination) -> Table {
    let health = &found.health;
    let well_shaped = 100.0 * (1.0 - health.angles_below_5_fraction);
    let rows = [
        ("vertices, faces", format!("{}, {}", health.vertices, health.faces)),
        ("it is", found.to_string()),
        (
            "holes",
            holes(health).unwrap_or_else(|| format!("not known: Euler number {}", health.euler)),
        ),
        ("pairs of faces that run through each other", found.self_intersections.to_string()),
        ("sharpest fold between faces", format!("{:.1}°", health.largest_dihedral_degrees)),
        ("smallest angle", format!("{:.2}°", health.smallest_angle_degrees)),
        ("angles of at least 5°", format!("{well_shaped:.3} %")),
    ];
    Table::new("The mesh", rows)
}
