//! From a prediction to the folder that a user keeps.

use std::collections::BTreeMap;

use datasets::View;
use mesh_core::io::write_mesh;
use mesh_core::{Examination, Health, TriMesh, UpAxis};
use recon::delivery::{
    DeliverError, PICTURE, animation, compare, mesh_table, score_figures, write_results,
};
use recon::evaluate::ViewScores;
use recon::scene::scene_of;
use serde::Serialize;
use train::output::{OutputError, OutputFolder};
use train::report::{Figure, Report, Table, ViewPair, counted};

use super::input::PredictInput;
use super::judgement::Judgement;
use super::one_pass::OnePass;
use super::predictor::Prediction;

/// Of a lower IoU than this with the masks that it was given, a mesh is not of that object.
const MISSED: f64 = 0.3;

/// A prediction with all that its report says.
#[derive(Clone, Debug)]
pub struct Delivery<'a> {
    /// The name of the system.
    pub system: &'a str,
    /// The checkpoint's file.
    pub checkpoint: String,
    /// Steps that the checkpoint was trained for.
    pub steps: u64,
    /// What the prediction was made from.
    pub input: &'a PredictInput,
    /// The prediction.
    pub prediction: &'a Prediction,
    /// How far the input is from what the system was trained on, where its weights know.
    pub familiarity: Option<Judgement>,
    /// How long it took, where that was measured; see [`milliseconds`](super::milliseconds).
    pub milliseconds: Option<f64>,
    /// The command as it was typed.
    pub command: String,
    /// More rows for the report's table: machine, threads, dates.
    pub provenance: Vec<(String, String)>,
}

impl<'a> Delivery<'a> {
    /// A delivery that says nothing of checkpoint, command and machine.
    pub fn new(system: &'a str, input: &'a PredictInput, prediction: &'a Prediction) -> Self {
        Self {
            system,
            checkpoint: String::new(),
            steps: 0,
            input,
            prediction,
            familiarity: None,
            milliseconds: None,
            command: String::new(),
            provenance: Vec::new(),
        }
    }
}

/// What `metrics.json` holds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Metrics {
    /// Version of this layout.
    pub schema_version: u32,
    /// The name of the system.
    pub system: String,
    /// The checkpoint's file.
    pub checkpoint: String,
    /// Steps that the checkpoint was trained for.
    pub steps: u64,
    /// How far the input is from what the system was trained on; absent where its weights do not know.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub familiarity: Option<Judgement>,
    /// How the mesh scored before it was refined; absent where it was not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub one_pass: Option<OnePass>,
    /// The scores at the cameras that were given.
    pub given: ViewScores,
    /// The scores at cameras that were not; none where there are no others.
    pub held_out: Option<ViewScores>,
    /// Whether the mesh is whole.
    pub health: Health,
    /// Pairs of faces that run through each other.
    pub self_intersections: usize,
    /// From decoded images to the mesh. Absent where it was not measured: all else is the same each time.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub milliseconds: Option<f64>,
    /// What else the system knows of its prediction, by name; empty for most.
    pub details: BTreeMap<String, Vec<f64>>,
    /// What a user should know, one sentence each.
    pub warnings: Vec<String>,
}

impl Metrics {
    /// What they say of the mesh by itself, for words.
    pub fn examination(&self) -> Examination {
        let self_intersections = self.self_intersections;
        Examination { health: self.health.clone(), self_intersections }
    }
}

/// Scores a prediction and writes everything that a user keeps of it into the folder: `mesh.glb`,
/// `mesh.obj`, `mesh.ply`, `turntable.gif`, `report.html` and `metrics.json`; where it was refined `one-pass.glb`, the mesh as
/// the network made it; where the system deforms through time `deformation.gif` and the meshes of its frames in `sequence`.
///
/// # Errors
/// If the folder cannot be written or the mesh cannot be scored.
pub fn deliver(delivery: &Delivery<'_>, folder: &OutputFolder) -> Result<Metrics, DeliverError> {
    let (input, mesh) = (delivery.input, &delivery.prediction.mesh);
    let judge = |views: &[View], kind: &str| -> Result<(ViewScores, Vec<ViewPair>), DeliverError> {
        let (scores, mut pairs) = compare(mesh, &views.iter().collect::<Vec<_>>(), PICTURE)?;
        for pair in &mut pairs {
            pair.caption = format!("{kind} {}", pair.caption);
        }
        Ok((scores, pairs))
    };
    let (given, shown) = judge(&input.given, "given")?;
    let (held_out, mut pairs) = match input.others.as_slice() {
        [] => (None, Vec::new()),
        others => {
            let (scores, pairs) = judge(others, "other")?;
            (Some(scores), pairs)
        }
    };
    pairs.extend(shown);
    let found = mesh.examined();
    let before = delivery.prediction.before.as_ref();
    let mut warnings = input.warnings.clone();
    warnings.extend(delivery.prediction.warnings.iter().cloned());
    warnings.extend(missed(&given, held_out.as_ref()));
    warnings.extend(delivery.familiarity.and_then(|judgement| judgement.warning()));
    let metrics = Metrics {
        schema_version: 1,
        system: delivery.system.to_owned(),
        checkpoint: delivery.checkpoint.clone(),
        steps: delivery.steps,
        familiarity: delivery.familiarity,
        one_pass: before.map(|mesh| OnePass::of(mesh, input)).transpose()?,
        given,
        held_out,
        health: found.health,
        self_intersections: found.self_intersections,
        milliseconds: delivery.milliseconds,
        details: delivery
            .prediction
            .details
            .iter()
            .map(|(name, values)| ((*name).to_owned(), values.clone()))
            .collect(),
        warnings,
    };
    if let Some(mesh) = before {
        write_mesh(folder.path().join("one-pass.glb"), mesh)?;
    }
    write_sequence(&delivery.prediction.sequence, folder)?;
    write_results(mesh, (UpAxis::Y, PICTURE), &metrics, report(delivery, &metrics, pairs), folder)?;
    Ok(metrics)
}

/// What is to be said of a mesh that is elsewhere than the object it was made for, or of another shape.
fn missed(given: &ViewScores, others: Option<&ViewScores>) -> Option<String> {
    let why = "these weights know other objects, or objects of another size, place or pose in the world of the cameras, or the \
               masks are wrong";
    let hardly = |scores: &ViewScores, where_| {
        let iou = scores.mask_iou;
        (iou < MISSED).then(|| {
            format!("the mesh hardly covers the object {where_} (mask IoU {iou:.2}): {why}")
        })
    };
    hardly(given, "in the given views")
        .or_else(|| others.and_then(|scores| hardly(scores, "at the cameras that were not given")))
}

/// The deformation as it goes: `deformation.gif`, and each mesh as `sequence/00.ply`, `01.ply` and so on.
fn write_sequence(meshes: &[TriMesh], folder: &OutputFolder) -> Result<(), DeliverError> {
    if meshes.is_empty() {
        return Ok(());
    }
    folder.write("deformation.gif", &animation(meshes)?)?;
    let below = folder.path().join("sequence");
    std::fs::create_dir(&below)
        .map_err(|source| OutputError::Io { path: below.clone(), source })?;
    for (i, mesh) in meshes.iter().enumerate() {
        write_mesh(below.join(format!("{i:02}.ply")), mesh)?;
    }
    Ok(())
}

fn report(delivery: &Delivery<'_>, metrics: &Metrics, views: Vec<ViewPair>) -> Report {
    let input = delivery.input;
    let given = counted(input.given.len(), "view");
    let source = input.source.display();
    let (scores, judged) = match &metrics.held_out {
        Some(scores) => {
            (scores, format!("{} that were not given", counted(scores.views.len(), "camera")))
        }
        None if metrics.one_pass.is_some() => {
            (&metrics.given, "the very views that the mesh was moved to".to_owned())
        }
        None => (&metrics.given, "the cameras that were given, for want of others".to_owned()),
    };
    let mut figures = score_figures(scores);
    let time = metrics.milliseconds.map(|milliseconds| format!("{milliseconds:.1} ms"));
    figures.extend(time.map(|time| Figure::new("for the prediction", time)));
    let how = match metrics.one_pass {
        Some(_) => "by a trained model, and then moved until its outlines agree with those views",
        None => "by a trained model and without fitting",
    };
    Report {
        title: format!("{}: a prediction", delivery.system),
        summary: format!(
            "One mesh from {given} of {source}, {how}; the figures are means over {judged}."
        ),
        command: delivery.command.clone(),
        scene: scene_of(&delivery.prediction.mesh),
        figures,
        warnings: metrics.warnings.clone(),
        views,
        tables: tables(delivery, metrics),
        ..Report::default()
    }
}

fn tables(delivery: &Delivery<'_>, metrics: &Metrics) -> Vec<Table> {
    let held_out = metrics.held_out.as_ref();
    let mut tables = Vec::new();
    tables.extend(held_out.map(|scores| score_table("At cameras that were not given", scores)));
    tables.push(score_table("At the given cameras", &metrics.given));
    if let Some(before) = &metrics.one_pass {
        let held_out = before.held_out.as_ref();
        let title = "At cameras that were not given, before refinement";
        tables.extend(held_out.map(|scores| score_table(title, scores)));
        tables.push(score_table("At the given cameras, before refinement", &before.given));
    }
    tables.push(mesh_table(&metrics.examination()));
    let input = delivery.input;
    let names: Vec<&str> = input.given.iter().map(|view| view.name.as_str()).collect();
    let row = |name: &str, value: String| (name.to_owned(), value);
    let mut rows = vec![
        row("input", format!("{} ({})", input.source.display(), layout_words(input))),
        row("given views", names.join(", ")),
        row("checkpoint", format!("{} (step {})", delivery.checkpoint, delivery.steps)),
    ];
    rows.extend(metrics.familiarity.map(|known| row("does it know this?", known.to_string())));
    let measured = metrics.milliseconds.map(|milliseconds| format!("{milliseconds:.2} ms"));
    rows.extend(measured.map(|value| row("prediction", value)));
    for (name, values) in &delivery.prediction.details {
        let values: Vec<String> = values.iter().map(|value| format!("{value:.3}")).collect();
        rows.push(row(name, values.join(", ")));
    }
    rows.extend(delivery.provenance.iter().cloned());
    tables.push(Table::new("The run", rows));
    tables
}

/// The layout; an image alone has none.
fn layout_words(input: &PredictInput) -> String {
    if input.camera_assumed { "one image".to_owned() } else { input.layout.to_string() }
}

fn score_table(title: &str, scores: &ViewScores) -> Table {
    let mut rows = vec![
        ("views", scores.views.len().to_string()),
        ("mask IoU", format!("{:.4}", scores.mask_iou)),
    ];
    if let Some(psnr) = scores.psnr {
        rows.extend([
            ("image L1", format!("{:.4}", scores.image_l1)),
            ("PSNR inside the mask", format!("{psnr:.2} dB")),
            ("SSIM", format!("{:.4}", scores.ssim)),
        ]);
    }
    Table::new(title, rows)
}
