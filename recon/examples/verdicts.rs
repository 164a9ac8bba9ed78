//! How often a verdict is right: fits of procedural objects, good views and spoilt ones, against their true shapes.
//!
//! `cargo run -p unsphere-recon --example verdicts -- choose|score FILE.json` fits,
//! `cargo run -p unsphere-recon --example verdicts -- table FILE.json [TABLE.md]` judges what was fitted.
//!
//! `choose` and `score` are the same 62 cases with other objects: bounds were chosen on the first and the table in `docs/verdict.md`
//! is of the second. Each case is 24 views, 192 pixels wide, and a fit of normal quality. What counts as right: no fit whose 3D IoU
//! with the truth (64 cells, as it lies) is below 0.9 is called good, and of the others at least 85 % are. It takes ten minutes
//! of one core.

use std::fmt::Write as _;
use std::path::Path;

use datasets::{View, Views};
use losses::metrics::voxel_iou;
use mesh_core::primitives::{capsule, cuboid, extrude, icosphere, rounded_cuboid, torus};
use mesh_core::{TriMesh, bounds, voxelize_solid};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use recon::fit::{Quality, fit};
use recon::progress::Watch;
use recon::verdict::{Evidence, Grade, Verdict, judge};
use serde::{Deserialize, Serialize};
use synth::shapes::Family;
use synth::{Lighting, Orbit, Planted, RenderOptions, render_views};

type Failure = Box<dyn std::error::Error>;

/// A mesh of this 3D IoU is the object.
const RIGHT: f64 = 0.9;
/// Cells along each side of the grid on which volumes are measured.
const CELLS: usize = 128;

/// Pixels of an image's side, and how well is fitted: as somebody has it who gave it little thought.
const WIDTH: usize = 192;
const QUALITY: Quality = Quality::Normal;

/// An object and what is done to its views.
struct Case {
    name: String,
    mesh: TriMesh,
    mistake: Option<Planted>,
    seed: u64,
}

/// What became of it.
#[derive(Serialize, Deserialize)]
struct Outcome {
    name: String,
    /// None where it was refused.
    fit: Option<Fit>,
}

#[derive(Serialize, Deserialize)]
struct Fit {
    /// 3D IoU with the truth, as the mesh lies.
    iou: f64,
    /// The same, moved and scaled onto the truth.
    aligned: f64,
    /// What it is judged by.
    evidence: Evidence,
}

impl Outcome {
    fn verdict(&self) -> Option<Verdict> {
        self.fit.as_ref().map(|fit| judge(&fit.evidence))
    }
}

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [mode, file, ..] = &arguments[..] else {
        return Err("choose, score or table, and a file".into());
    };
    let first = match mode.as_str() {
        "choose" => 100,
        "score" => 200,
        _ => {
            let outcomes: Vec<Outcome> = serde_json::from_slice(&std::fs::read(file)?)?;
            let table = table(&outcomes);
            say(&table)?;
            return match arguments.get(2) {
                Some(path) => Ok(mesh_core::io::write_atomic(Path::new(path), |w| {
                    w.write_all(table.as_bytes())
                })?),
                None => Ok(()),
            };
        }
    };
    let mut outcomes = Vec::new();
    for case in cases(first) {
        outcomes.push(tried(case)?);
        let json = serde_json::to_vec(&outcomes)?;
        mesh_core::io::write_atomic(Path::new(file), |w| w.write_all(&json))?;
    }
    say(&format!("\n{}", table(&outcomes)))
}

fn say(text: &str) -> Result<(), Failure> {
    std::io::Write::write_all(&mut std::io::stdout().lock(), text.as_bytes())?;
    Ok(())
}

/// The cases whose seeds begin with `first`.
fn cases(first: u64) -> Vec<Case> {
    let mut cases = Vec::new();
    let mut seed = first;
    let mut add = |name: String, mesh: TriMesh, mistake| {
        cases.push(Case { name, mesh, mistake, seed });
        seed += 1;
    };
    let more = ["block", "capsule", "blob", "clock"];
    for (k, name) in SOLIDS.into_iter().chain(SOLIDS).chain(more).enumerate() {
        add(name.to_owned(), solid(name, first + k as u64), None);
    }
    for name in HOLLOW {
        add(name.to_owned(), solid(name, first), None);
    }
    for family in FAMILIES {
        add(family.to_string(), family.draw(first).mesh(), None);
    }
    for (k, mistake) in mistakes().into_iter().enumerate() {
        let name = SOLIDS[k % SOLIDS.len()];
        add(format!("{name}, {mistake:?}"), solid(name, first + 50 + k as u64), Some(mistake));
    }
    cases
}

/// Bodies whose outlines tell their shape.
const SOLIDS: [&str; 8] =
    ["ellipsoid", "block", "capsule", "blob", "angle", "snowman", "clock", "bus"];
/// Shapes with holes, and walls with windows.
const HOLLOW: [&str; 4] = ["ring", "thick ring", "frame", "shell with windows"];
/// Objects of thin parts.
const FAMILIES: [Family; 6] = [
    Family::Airplane,
    Family::Chair,
    Family::Table,
    Family::Bicycle,
    Family::Motorbike,
    Family::AlarmClock,
];

fn mistakes() -> Vec<Planted> {
    let mut all: Vec<Planted> =
        [0.8, 0.9, 0.95, 1.05, 1.1, 1.25].into_iter().map(Planted::Focal).collect();
    all.extend([5, 8, 12].map(Planted::Few));
    all.extend([0.3, 1.0, 2.0, 4.0].map(Planted::Poses));
    all.extend([2.0, 5.0].map(|x| Planted::PrincipalPoint([x, -0.5 * x])));
    all.extend([10.0, 40.0].map(Planted::OneView));
    let spoilt = [(0.5, 0.05), (1.0, 0.1), (0.25, 0.3)];
    all.extend(spoilt.map(|(views, area)| Planted::Blobs { views, area }));
    all.extend(spoilt[..2].iter().map(|&(views, area)| Planted::Bites { views, area }));
    all.extend([1, 3].map(Planted::Dilated));
    all.extend([1, 3].map(Planted::Eroded));
    all.extend([40.0, 60.0, 90.0].map(Planted::OneSided));
    all.extend([Planted::Axes, Planted::InversePoses, Planted::FlippedX]);
    all
}

/// A body whose box has the diagonal 1.
fn solid(name: &str, seed: u64) -> TriMesh {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut size = || rng.random_range(0.5f32..1.0);
    let mesh = match name {
        "ellipsoid" => icosphere(4).scaled([size(), size(), size()]),
        "block" => rounded_cuboid([size(), size(), size()], 0.05, 4),
        "capsule" => capsule(0.25 + 0.2 * size(), 0.6 * size(), 8, 32),
        "blob" => {
            let [a, b, c] = [(); 3].map(|()| 4.0 * size());
            let mut ball = icosphere(4);
            for p in &mut ball.positions {
                let r = 0.8 + 0.2 * (a * p[0]).sin() * (b * p[1]).cos() + 0.15 * (c * p[2]).sin();
                *p = p.map(|v| v * r);
            }
            ball
        }
        "angle" => {
            let (wide, high) = (size(), 0.3 + 0.2 * size());
            let outline =
                [[0.0, 0.0], [1.0, 0.0], [1.0, high], [high, high], [high, wide], [0.0, wide]];
            extrude(&outline, 0.4 * size()).expect("the outline does not cross itself")
        }
        "snowman" => {
            let mut body = icosphere(4).scaled([0.5; 3]);
            let head = icosphere(4).scaled([0.25 + 0.1 * size(); 3]);
            body.append(&head.translated([0.0, 0.65, 0.0])).expect("neither has a texture");
            body
        }
        "clock" => Family::AlarmClock.draw(seed).mesh(),
        "bus" => Family::Bus.draw(seed).mesh(),
        "thick ring" => torus(0.6, 0.3, 48, 24),
        "ring" => torus(0.7, 0.2 * size(), 48, 24),
        "frame" => bars([1.0, 0.7, 0.15 * size()], 0.1, &[2]),
        "shell with windows" => {
            let mut shell = bars([1.0, 0.6 + 0.2 * size(), 0.7], 0.08, &[0, 1, 2]);
            // A floor and half-high walls.
            for (sides, at) in [
                ([1.0, 0.04, 0.7], [0.0, -0.3, 0.0]),
                ([1.0, 0.3, 0.04], [0.0, -0.2, 0.33]),
                ([1.0, 0.3, 0.04], [0.0, -0.2, -0.33]),
                ([0.04, 0.3, 0.7], [0.48, -0.2, 0.0]),
            ] {
                shell.append(&cuboid(sides).translated(at)).expect("neither has a texture");
            }
            shell
        }
        other => unreachable!("{other}"),
    };
    let around = mesh.bounds().expect("it has vertices");
    let (middle, diagonal) = (bounds::center(around), bounds::diagonal::<f32>(around));
    let mesh = mesh.translated(middle.map(|x| -x)).scaled([1.0 / diagonal; 3]);
    if mesh.colors.is_some() {
        return mesh;
    }
    let colors = mesh.positions.iter().map(|p| p.map(|x| (0.5 + x).clamp(0.0, 1.0))).collect();
    TriMesh { colors: Some(colors), ..mesh }
}

/// The edges of a box as bars; without those along `axes` that are not listed the box is a frame.
fn bars(sides: [f32; 3], thick: f32, axes: &[usize]) -> TriMesh {
    let mut mesh = TriMesh::default();
    for along in 0..3 {
        if axes == [2] && along == 2 {
            continue;
        }
        let [a, b] = [(along + 1) % 3, (along + 2) % 3];
        for (s, t) in [(-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)] {
            let (mut bar, mut at) = ([thick; 3], [0.0; 3]);
            bar[along] = sides[along];
            at[a] = s * (sides[a] - thick);
            at[b] = t * (sides[b] - thick);
            if axes == [2] {
                // A flat frame is as deep as it is.
                (bar[2], at[2]) = (sides[2], 0.0);
            }
            mesh.append(&cuboid(bar).translated(at)).expect("neither has a texture");
        }
    }
    mesh
}

fn views_of(mesh: &TriMesh) -> Result<Vec<View>, Failure> {
    let orbit = Orbit {
        count: 24,
        target: [0.0; 3],
        distance: [1.6, 1.8],
        width: WIDTH,
        height: WIDTH,
        ..Orbit::default()
    };
    let look = RenderOptions {
        lighting: Lighting::studio(),
        background: [0.55, 0.6, 0.5],
        ..RenderOptions::default()
    };
    Ok(render_views(mesh, &orbit.cameras(), &look, &|_, _| {})?)
}

fn tried(case: Case) -> Result<Outcome, Failure> {
    let Case { name, mesh, mistake, seed } = case;
    let mut views = views_of(&mesh)?;
    if let Some(mistake) = mistake {
        views = mistake.plant(views, [0.0; 3], seed);
    }
    let views = Views::in_memory(views);
    let Ok(fitted) = fit(&views, &QUALITY.config(), &mut Watch::default()) else {
        say(&format!("{name}: refused\n"))?;
        return Ok(Outcome { name, fit: None });
    };
    let evidence = Evidence::of(&views, &fitted)?;
    let verdict = judge(&evidence);
    let iou = voxel_iou(&fitted.mesh, &mesh, 64);
    let aligned = voxel_iou(&brought_onto(fitted.mesh.clone(), &mesh), &mesh, 64);
    let coherence = evidence.coherence.unwrap_or_default();
    let most = |value: fn(&recon::verdict::Disagreement) -> f64| {
        evidence.views.iter().map(value).fold(0.0, f64::max)
    };
    let holes = evidence.views.iter().filter(|view| view.holes > 0).count();
    say(&format!(
        "{name} ({seed}): 3d {iou:.3} aligned {aligned:.3}; iou {:.4} fitted {:.4} worst {:.3}; largest {:.3} missing {:.4} excess \
         {:.4} holes {holes}; c.missing {:.4} c.excess {:.4} c.gap {:.3}; unseen {:.2} motion {:.2} focal {:.3} lens {:.3} edge {:.2} \
         views {} crossings {}: {}: {}\n",
        evidence.mask_iou,
        evidence.fitted_iou,
        evidence.views[0].mask_iou,
        most(|v| v.largest),
        most(|v| v.missing),
        most(|v| v.excess),
        coherence.missing,
        coherence.excess,
        coherence.gap,
        evidence.unseen.0,
        evidence.motion,
        fitted.cameras.as_ref().map_or(1.0, |c| c.focal),
        evidence.lens.map_or(1.0, |lens| lens.focal),
        evidence.mask_edge.unwrap_or(f64::NAN),
        evidence.fitted_views,
        evidence.self_intersections,
        verdict.grade,
        verdict.reasons.join("; "),
    ))?;
    Ok(Outcome { name, fit: Some(Fit { iou, aligned, evidence }) })
}

/// The mesh moved and scaled so that it fills as much room as the other, around the same centre of mass.
fn brought_onto(mesh: TriMesh, other: &TriMesh) -> TriMesh {
    let (Some((from, size)), Some((to, wanted))) = (mass(&mesh), mass(other)) else { return mesh };
    let scale = (wanted / size).cbrt() as f32;
    mesh.translated(from.map(|x| -x)).scaled([scale; 3]).translated(to)
}

/// Centre and volume of a solid; none where nothing is inside.
fn mass(mesh: &TriMesh) -> Option<([f32; 3], f64)> {
    let grid = voxelize_solid(mesh, [CELLS; 3], mesh.bounds()?);
    let mut sum = [0.0f64; 3];
    for (k, _) in grid.bits.iter().enumerate().filter(|(_, inside)| **inside) {
        let at = grid.center([k % CELLS, k / CELLS % CELLS, k / CELLS / CELLS]);
        sum = std::array::from_fn(|k| sum[k] + f64::from(at[k]));
    }
    let count = grid.count();
    (count > 0).then(|| (sum.map(|x| (x / count as f64) as f32), grid.volume()))
}

fn table(outcomes: &[Outcome]) -> String {
    let mut text = String::from(
        "| case | 3D IoU | moved and scaled | verdict | first reason |\n|---|--:|--:|---|---|\n",
    );
    for outcome in outcomes {
        let verdict = outcome.verdict();
        let ious = outcome.fit.as_ref().map_or_else(
            || "none | none".to_owned(),
            |fit| format!("{:.3} | {:.3}", fit.iou, fit.aligned),
        );
        let (grade, reason) = verdict.as_ref().map_or(("refused", ""), |verdict| {
            (verdict.grade.name(), verdict.reasons.first().map_or("", String::as_str))
        });
        let _ = writeln!(text, "| {} | {ious} | {grade} | {reason} |", outcome.name);
    }
    counted(&mut text, "3D IoU", outcomes, |fit| fit.iou);
    counted(&mut text, "or moved and scaled", outcomes, |fit| fit.iou.max(fit.aligned));
    let refused = outcomes.iter().filter(|o| o.fit.is_none()).count();
    let _ = writeln!(text, "\nRefused before any fit: {refused}.");
    text
}

/// Adds how many right and wrong meshes got each grade.
fn counted(text: &mut String, name: &str, outcomes: &[Outcome], iou: fn(&Fit) -> f64) {
    let _ = writeln!(text, "\n| {name} | fits | good | doubtful | failed |\n|---|--:|--:|--:|--:|");
    for (words, right) in [("0.9 or more", true), ("below 0.9", false)] {
        let of = |o: &&Outcome| o.fit.as_ref().is_some_and(|fit| (iou(fit) >= RIGHT) == right);
        let graded = |grade: Grade| {
            let all = outcomes.iter().filter(of);
            all.filter(|o| o.verdict().is_some_and(|verdict| verdict.grade == grade)).count()
        };
        let [good, doubtful, failed] = [Grade::Good, Grade::Doubtful, Grade::Failed].map(graded);
        let all = outcomes.iter().filter(of).count();
        let _ = writeln!(text, "| {words} | {all} | {good} | {doubtful} | {failed} |");
    }
}
