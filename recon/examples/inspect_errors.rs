//! Which mistakes `inspect` finds, of which size, and whether it is silent where there is none.
//!
//! `cargo run -p unsphere-recon --example inspect_errors -- all|mistakes|good [file]`
//!
//! Objects of the procedural families are seen by 24 cameras from all around, 128 pixels wide. Each mistake is planted into the
//! views of two of them; good views are those of all families, under four ways of taking images. The table goes to the file
//! named, the figures behind it to standard output; it takes two minutes on two cores.

use std::fmt::Write as _;
use std::path::Path;

use datasets::{Truth, View, Views};
use recon::inspect::{ObjectInspection, inspect_views};
use synth::shapes::Family;
use synth::{Lighting, Orbit, Planted, RenderOptions, render_views};

type Failure = Box<dyn std::error::Error>;

/// Objects into whose views mistakes are planted.
const OBJECTS: [(Family, u64); 2] = [(Family::Car, 11), (Family::Chair, 12)];
/// Seed of the objects whose good views are looked at.
const GOOD: u64 = 21;

fn orbit() -> Orbit {
    Orbit {
        count: 24,
        target: [0.0; 3],
        distance: [1.7, 1.9],
        width: 128,
        height: 128,
        ..Orbit::default()
    }
}

/// What is planted: its name, and each size in words.
fn mistakes() -> Vec<(&'static str, Vec<(String, Planted)>)> {
    let sized = |values: &[f64], unit: &str, make: &dyn Fn(f64) -> Planted| -> Vec<_> {
        values.iter().map(|&v| (format!("{v}{unit}"), make(v))).collect()
    };
    let pixels = |make: fn(usize) -> Planted| -> Vec<_> {
        [1, 2, 4].map(|n| (format!("{n} px"), make(n))).into()
    };
    let factors = [0.7, 0.9, 0.95, 0.98, 1.02, 1.05, 1.1, 1.4];
    let areas = [0.01, 0.03, 0.1];
    vec![
        ("axes of OpenCV for OpenGL's", vec![(String::new(), Planted::Axes)]),
        ("inverted poses", vec![(String::new(), Planted::InversePoses)]),
        ("upside down", vec![(String::new(), Planted::FlippedY)]),
        ("mirrored", vec![(String::new(), Planted::FlippedX)]),
        ("noise of all poses", sized(&[0.1, 0.3, 0.6, 1.0, 3.0], "°", &Planted::Poses)),
        ("focal length", sized(&factors, "", &Planted::Focal)),
        (
            "principal point",
            sized(&[1.0, 2.0, 4.0, 8.0], " px", &|v| Planted::PrincipalPoint([v, -0.5 * v])),
        ),
        ("one view of 24", sized(&[1.0, 2.0, 5.0, 15.0, 45.0], "°", &Planted::OneView)),
        ("one camera of 24 aside", sized(&[0.1, 1.0, 100.0], " distances", &Planted::OneAside)),
        ("masks too large", pixels(Planted::Dilated)),
        ("masks too small", pixels(Planted::Eroded)),
        ("inverted masks", vec![(String::new(), Planted::Inverted)]),
        (
            "a blob in a quarter of the masks",
            sized(&areas, " of the area", &|area| Planted::Blobs { views: 0.25, area }),
        ),
        (
            "a blob in one mask",
            sized(&areas, " of the area", &|area| Planted::Blobs { views: 0.0, area }),
        ),
        (
            "a bite out of a quarter of the masks",
            sized(&areas, " of the area", &|area| Planted::Bites { views: 0.25, area }),
        ),
        (
            "views of one side alone",
            sized(&[90.0, 60.0, 40.0], "° from the middle view", &Planted::OneSided),
        ),
    ]
}

fn views_of(family: Family, seed: u64, orbit: &Orbit) -> Result<Vec<View>, Failure> {
    let look = RenderOptions {
        lighting: Lighting::studio(),
        background: [0.55, 0.6, 0.5],
        ..RenderOptions::default()
    };
    Ok(render_views(&family.draw(seed).mesh(), &orbit.cameras(), &look, &|_, _| {})?)
}

fn look(views: Vec<View>) -> ObjectInspection {
    inspect_views(&Views::in_memory(views), &Truth::default())
}

/// The figures of an inspection in one line.
fn figures(name: &str, found: &ObjectInspection) -> String {
    let agreement = &found.agreement;
    let mut line = format!("{name}: agreement {:.4}", agreement.hull_iou.unwrap_or(f64::NAN));
    if let Some(c) = agreement.coherence {
        let most = |value: fn(&recon::inspect::Coherence) -> f64| {
            agreement.coherence_by_view.iter().flatten().map(value).fold(0.0, f64::max)
        };
        let _ = write!(
            line,
            "; missing {:.4} (most {:.4}), excess {:.4} (most {:.4}), gap {:.3} (most {:.3})",
            c.missing,
            most(|c| c.missing),
            c.excess,
            most(|c| c.excess),
            c.gap,
            most(|c| c.gap),
        );
    }
    if let Some(lens) = agreement.lens {
        let [right, down] = lens.shift;
        let _ = write!(
            line,
            "; lens {:.3} ({right:.2}, {down:.2}) {:.3} to {:.3}",
            lens.focal, lens.given, lens.gap
        );
    }
    let kinds: Vec<&str> = found.problems.iter().map(|p| p.kind).collect();
    let _ = writeln!(
        line,
        "; edge {:.2}, unseen {:.2}: {}",
        agreement.mask_edge.unwrap_or(f64::NAN),
        agreement.unseen.unwrap_or(f64::NAN),
        kinds.join(", ")
    );
    line
}

fn say(text: &str) -> Result<(), Failure> {
    std::io::Write::write_all(&mut std::io::stdout().lock(), text.as_bytes())?;
    Ok(())
}

/// Counts how often each kind was named, the most frequent first.
fn kinds(found: &[ObjectInspection]) -> String {
    let mut counts: Vec<(usize, &str)> = Vec::new();
    for kind in found.iter().flat_map(|object| &object.problems).map(|p| p.kind) {
        match counts.iter_mut().find(|(_, name)| *name == kind) {
            Some((count, _)) => *count += 1,
            None => counts.push((1, kind)),
        }
    }
    counts.sort_by(|a, b| b.cmp(a));
    counts.iter().map(|(n, kind)| format!("`{kind}` {n}")).collect::<Vec<_>>().join(", ")
}

fn main() -> Result<(), Failure> {
    let mut arguments = std::env::args().skip(1);
    let what = arguments.next().unwrap_or_else(|| "all".to_owned());
    let mut table = String::new();
    if what != "good" {
        table += &spoilt()?;
    }
    if what != "mistakes" {
        table += &unspoilt()?;
    }
    say(&format!("\n{table}"))?;
    if let Some(path) = arguments.next() {
        mesh_core::io::write_atomic(Path::new(&path), |w| w.write_all(table.as_bytes()))?;
    }
    Ok(())
}

/// Plants every mistake, and tabulates what is found.
fn spoilt() -> Result<String, Failure> {
    let mut objects = Vec::new();
    for (family, seed) in OBJECTS {
        objects.push((family, seed, views_of(family, seed, &orbit())?));
    }
    let mut table = String::from("| mistake | size | found | named |\n|---|---|--:|---|\n");
    let mut planted = 0;
    for (name, sizes) in mistakes() {
        for (size, mistake) in sizes {
            let mut found = Vec::new();
            for (family, seed, good) in &objects {
                let bad = mistake.plant(good.clone(), [0.0; 3], *seed);
                let object = look(bad);
                say(&figures(&format!("{name} {size}, {family} {seed}"), &object))?;
                found.push(object);
            }
            planted += found.len();
            let count = found.iter().filter(|object| !object.problems.is_empty()).count();
            let of = found.len();
            let _ = writeln!(table, "| {name} | {size} | {count} of {of} | {} |", kinds(&found));
        }
    }
    let _ = writeln!(table, "\n{planted} sets of views with a mistake in them.\n");
    Ok(table)
}

/// Looks at good views, taken in several ways, and tabulates where nothing is said.
fn unspoilt() -> Result<String, Failure> {
    let mut table = String::from("| good views | silent | named |\n|---|--:|---|\n");
    let small = Orbit { count: 12, width: 96, height: 96, ..orbit() };
    let turntable = Orbit { count: 30, width: 64, height: 64, elevation: [24.0, 26.0], ..orbit() };
    let above = Orbit { count: 16, width: 256, height: 256, elevation: [0.0, 60.0], ..orbit() };
    for (name, orbit) in [
        ("24 of 128 px, from all around", orbit()),
        ("12 of 96 px, from all around", small),
        ("30 of 64 px, a turntable from 25 degrees above", turntable),
        ("16 of 256 px, from above the ground", above),
    ] {
        let mut found = Vec::new();
        for family in Family::ALL {
            let object = look(views_of(family, GOOD, &orbit)?);
            say(&figures(&format!("good, {name}, {family} {GOOD}"), &object))?;
            found.push(object);
        }
        let silent = found.iter().filter(|object| object.problems.is_empty()).count();
        let _ = writeln!(table, "| {name} | {silent} of {} | {} |", found.len(), kinds(&found));
    }
    Ok(table)
}
