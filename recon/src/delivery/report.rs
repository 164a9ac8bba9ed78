//! What the page says of a fit: figures, curves and tables.

use std::collections::BTreeMap;

use losses::metrics::{Preset, Report as Comparison};
use mesh_core::{Examination, Health};
use train::report::{Chart, Figure, Report, Series, Table, ViewPair, counted};

use super::Delivery;
use super::metrics::Metrics;
use crate::evaluate::ViewScores;
use crate::scene::scene_of;
use crate::verdict::Assessment;

/// What the steps' terms are. A longer title is cut.
const LOSSES: &str = "Outlines to masks (pixels, RMS), bending energy";

pub(super) fn report(delivery: &Delivery<'_>, metrics: &Metrics, views: Vec<ViewPair>) -> Report {
    let fitted = delivery.fitted;
    let source = delivery.views.source.display();
    let Assessment { verdict, pictures, .. } = delivery.assessment;
    let reason = |reason: &String| format!("{}: {reason}", verdict.grade);
    let mut warnings: Vec<String> = verdict.reasons.iter().map(reason).collect();
    warnings.extend(delivery.views.warnings.iter().cloned());
    warnings.extend(fitted.warnings.iter().cloned());
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
            "Verdict: {}. A mesh deformed to agree with {} of {source}; the figures are means over {}.",
            verdict.grade,
            counted(fitted.train_views.len(), "view"),
            counted(metrics.views.views.len(), &format!("{} view", metrics.scored_on)),
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
        Chart::new(LOSSES, "step", losses).logarithmic(),
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
