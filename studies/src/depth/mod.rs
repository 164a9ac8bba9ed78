//! The poster's table, with the column that its authors could not finish.

mod retrieval;

use self::retrieval::retrieved;
use crate::effort::{ABOUT, with_effort};
use crate::gallery::predicted;
use crate::preset::{Change, Planned, open, plan, planned, preset, scaled, train_job};
use crate::progress::Watch;
use crate::{Cell, Claim, Floor, Plan, PlannedJob, Row, Scale, Study, StudyError, Work};
use models::depth::{
    DepthKind, DepthPixel2Mesh, MeshInit, MeshRcnn, RefineConfig, Refined, Scenes, Score, Scored,
    Sphere, Voxels,
};
use train::Subset;

/// The studies of this module, in the order of lists.
pub const STUDIES: &[&dyn Study] = &[&DepthStudy];

/// The names of the tables.
const TRUE: &str = "With true depth";
const ESTIMATED: &str = "With estimated depth";
const WRONG: &str = "With estimated depth that is wrong in relief";

/// What the quick ones were found to have, by the column and its best value; of Mesh R-CNN the branch that reads the image, since
/// after so few steps the mesh of one that sees nothing is no worse.
const QUICK_FOUND: [(&str, f64, f64); 2] = [("CD", 0.0, 2.92), ("voxel IoU", 1.0, 0.30)];
/// The rows that are scored in them, by their place among [`VARIANTS`].
const QUICK_VARIANTS: [usize; 3] = [0, 2, BLIND];
/// What depth should leave of Pixel2Mesh's Chamfer distance, and the rendered-depth loss of the depth error.
const GAIN: (f64, &str) =
    (0.85, "stated before the first run: 15 % at least; the poster's gain is 24.6 %");
const DEPTH_GAIN: (f64, &str) =
    (0.75, "stated before the first run: 25 % at least; the poster has no figure");

/// A row: what is given, and what of the rendered depth is in the loss.
#[derive(Clone, Copy)]
struct Variant {
    /// The end of the job's name.
    id: &'static str,
    depth: DepthKind,
    loss: Rendered,
    /// Whether nothing is seen.
    blind: bool,
    /// Whether an estimate is wrong within the object too.
    relief: bool,
}

/// The parts of the rendered-depth loss.
#[derive(Clone, Copy, PartialEq)]
enum Rendered {
    None,
    Both,
    /// That the true mask is covered.
    Coverage,
    /// The depth of what covers it.
    Depth,
}

impl Variant {
    const fn new(id: &'static str, depth: DepthKind, loss: Rendered) -> Self {
        Self { id, depth, loss, blind: false, relief: false }
    }
}

const VARIANTS: [Variant; 10] = [
    Variant::new("rgb", DepthKind::None, Rendered::None),
    Variant::new("rgbd", DepthKind::True, Rendered::None),
    Variant::new("rgbd-loss", DepthKind::True, Rendered::Both),
    Variant::new("estimate", DepthKind::Estimated, Rendered::None),
    Variant::new("estimate-loss", DepthKind::Estimated, Rendered::Both),
    Variant::new("rgbd-coverage", DepthKind::True, Rendered::Coverage),
    Variant::new("rgbd-depth", DepthKind::True, Rendered::Depth),
    Variant { blind: true, ..Variant::new("blind", DepthKind::None, Rendered::None) },
    Variant { relief: true, ..Variant::new("relief", DepthKind::Estimated, Rendered::None) },
    Variant { relief: true, ..Variant::new("relief-loss", DepthKind::Estimated, Rendered::Both) },
];
/// The place of the one that sees nothing.
const BLIND: usize = 7;
/// And of the first of those whose estimates are wrong in relief.
const RELIEF: usize = 8;
/// The job and the row of what is looked up.
const RETRIEVED: &str = "retrieval";
const RETRIEVAL: &str = "the nearest training image's object";

/// The systems of the poster's rows, with its Chamfer distances for RGB and RGB-D.
const SYSTEMS: [(&str, &str, [f64; 2]); 2] =
    [("pixel2mesh", "Pixel2Mesh", [4.915, 3.707]), ("rcnn", "Mesh R-CNN", [4.729, 4.791])];

/// What makes the quick ones quick.
const QUICK: &[Change] = &[
    ("max-steps", "100"),
    ("warmup", "5"),
    ("batch", "4"),
    ("image-size", "32"),
    ("width", "8"),
    ("hidden", "16"),
    ("points", "300"),
    ("objects", "6"),
    ("test-objects", "2"),
    ("synthetic-views", "4"),
    ("families", "[\"airplane\", \"car\"]"),
];
const QUICK_CELLS: &[Change] = &[("cells", "12"), ("voxel-hidden", "16")];
const QUICK_SPHERE: &[Change] = &[("level", "0")];

/// An estimate's relief says less of where a surface is than measured depth, so that other weights serve where it is in
/// the loss.
const GUESSED_SPHERE: &[Change] = &[("depth-weight", "0.2"), ("coverage", "0.1")];
const GUESSED_CELLS: &[Change] = &[("coverage", "1.0")];

/// Pixel2Mesh and Mesh R-CNN from colours, from colours and depth, and with rendered depth in the loss; with true depth and
/// with depth as an estimator guesses it.
#[derive(Clone, Copy, Debug)]
pub struct DepthStudy;

fn label(system: &str, variant: &Variant) -> String {
    if variant.blind {
        return format!("{system}, no image read");
    }
    let given = if variant.depth == DepthKind::None { "RGB" } else { "RGB-D" };
    let loss = match variant.loss {
        Rendered::None => "",
        Rendered::Both => " + rendered-depth loss",
        Rendered::Coverage => " + rendered-depth loss, its coverage alone",
        Rendered::Depth => " + rendered-depth loss, its depth alone",
    };
    format!("{system}, {given}{loss}")
}

/// Which variants are made; quick ones are the first and the third.
fn variants(scale: Scale) -> impl Iterator<Item = &'static Variant> {
    let quick = scale == Scale::Quick;
    VARIANTS
        .iter()
        .enumerate()
        .filter(move |(i, _)| !quick || QUICK_VARIANTS.contains(i))
        .map(|(_, v)| v)
}

fn changed<B: MeshInit>(
    scale: Scale,
    variant: &Variant,
    [quick, guessed]: [&[Change]; 2],
) -> Configured<B> {
    let depth = match variant.depth {
        DepthKind::None => "none",
        DepthKind::True => "true",
        DepthKind::Estimated => "estimated",
    };
    let mut changes = vec![("depth", depth)];
    match variant.loss {
        Rendered::None => changes.extend([("depth-weight", "0"), ("coverage", "0")]),
        Rendered::Both if variant.depth == DepthKind::Estimated => changes.extend(guessed),
        Rendered::Both => {}
        Rendered::Coverage => changes.push(("coverage-alone", "true")),
        Rendered::Depth => changes.push(("coverage", "0")),
    }
    if variant.blind {
        changes.push(("blind", "true"));
    }
    if variant.relief {
        changes.push(("estimate-errors", "nonlinear"));
    }
    if scale == Scale::Quick {
        changes.extend(QUICK);
        changes.extend(quick);
    }
    preset::<Refined<B>>("table", &changes)
}

type Configured<B> = train::Configuration<<B as MeshInit>::Config>;

/// The jobs of one of the systems, with what it has beside the common changes for quick ones, and for estimates in the
/// loss.
fn jobs<B: MeshInit>(scale: Scale, system: usize, own: [&[Change]; 2]) -> Vec<Planned<Refined<B>>> {
    let id = |variant: &Variant| format!("{}-{}", SYSTEMS[system].0, variant.id);
    let job = |v: &'static Variant| (id(v), v.id, changed::<B>(scale, v, own));
    scaled::<Refined<B>>(scale, variants(scale).map(job).collect())
}

fn spheres(scale: Scale) -> Vec<Planned<DepthPixel2Mesh>> {
    jobs::<Sphere>(scale, 0, [QUICK_SPHERE, GUESSED_SPHERE])
}

fn voxels(scale: Scale) -> Vec<Planned<MeshRcnn>> {
    jobs::<Voxels>(scale, 1, [QUICK_CELLS, GUESSED_CELLS])
}

impl Study for DepthStudy {
    fn name(&self) -> &'static str {
        "depth-table"
    }

    fn about(&self) -> &'static str {
        "Pixel2Mesh and Mesh R-CNN with depth given and rendered depth in the loss"
    }

    fn plan(&self, scale: Scale) -> Plan {
        let [sphere, voxel] =
            [plan::<DepthPixel2Mesh>(&spheres(scale)), plan::<MeshRcnn>(&voxels(scale))];
        let mut plan = sphere.and(voxel);
        let labels =
            SYSTEMS.iter().flat_map(|(_, name, _)| variants(scale).map(|v| label(name, v)));
        plan.jobs.iter_mut().zip(labels).for_each(|(job, label)| job.label = label);
        if scale != Scale::Quick {
            let (id, label) = (RETRIEVED.to_owned(), RETRIEVAL.to_owned());
            plan.jobs.push(PlannedJob { id, label, length: 0 });
        }
        plan
    }

    fn run(&self, work: &Work<'_>, watch: &mut Watch<'_>) -> Result<Vec<Row>, StudyError> {
        if work.id == RETRIEVED {
            let (.., config) = &spheres(work.scale)[0];
            let data = open::<DepthPixel2Mesh>(work, config)?;
            work.tell(watch, 0.5, "looking through the training's images")?;
            let scored = retrieved(&data, config.system.refine.pairs.scored_views)?;
            let row = Row::new(TRUE, RETRIEVAL);
            Ok(vec![with_scores(row, &data, &scored, None)])
        } else if work.id.starts_with("pixel2mesh") {
            rows::<Sphere>(0, planned::<DepthPixel2Mesh>(spheres(work.scale), work), work, watch)
        } else {
            rows::<Voxels>(1, planned::<MeshRcnn>(voxels(work.scale), work), work, watch)
        }
    }

    fn claims(&self) -> Vec<Claim> {
        let [sphere, voxel] = [0, 1].map(|k| Rows { system: SYSTEMS[k].1, table: TRUE });
        let guessed = [0, 1].map(|k| Rows { system: SYSTEMS[k].1, table: ESTIMATED });
        let mut claims = vec![
            Claim::new(
                "Pixel2Mesh: depth lowers the Chamfer distance by 15 % at least (poster: 24.6 %)",
                [sphere.score(1, "CD").at_most(GAIN.0, sphere.score(0, "CD"), 0.0, GAIN.1)],
            ),
            Claim::new(
                "Mesh R-CNN: depth lowers the Chamfer distance (poster: it rose by 1.3 %)",
                [voxel.score(1, "CD").below(voxel.score(0, "CD"))],
            ),
        ];
        claims.extend(sphere.loss_helps(1));
        claims.extend(voxel.loss_helps(1));
        claims.extend(guessed.iter().flat_map(|rows| rows.loss_helps(3)));
        for k in [0, 1] {
            let rows = Rows { system: SYSTEMS[k].1, table: WRONG };
            let text = format!(
                "{}: an estimate that is wrong in relief still lowers the Chamfer distance",
                rows.system
            );
            let colors = crate::Score::new(TRUE, label(rows.system, &VARIANTS[0]), "CD");
            claims.push(Claim::new(text, [rows.score(RELIEF, "CD").below(colors)]));
            claims.extend(rows.loss_helps(RELIEF));
        }
        for rows in [&sphere, &voxel] {
            let text = format!("{} reads its image: it beats what sees nothing", rows.system);
            claims.push(Claim::new(text, [rows.score(0, "CD").below(rows.score(BLIND, "CD"))]));
            let nearest = crate::Score::new(TRUE, RETRIEVAL, "CD");
            let text = format!("{} beats what looks its object up", rows.system);
            claims.push(Claim::new(text, [rows.score(0, "CD").below(nearest)]));
        }
        claims.push(Claim::new(
            "the voxel branch from colours alone beats the mean shape",
            [voxel.score(0, "voxel IoU").above(voxel.score(0, "mean shape"))],
        ));
        claims
    }

    fn floors(&self) -> Vec<Floor> {
        let floor = |(k, (column, best, found)): (usize, (&str, f64, f64))| {
            let system = SYSTEMS[k].1;
            let row = label(system, &VARIANTS[QUICK_VARIANTS[1]]);
            let floor = Floor::new(crate::Score::new(TRUE, row.clone(), column), best, found);
            floor.missed_by(untrained(&row)).missed_by(label(system, &VARIANTS[BLIND]))
        };
        QUICK_FOUND.into_iter().enumerate().map(floor).collect()
    }

    fn caption(&self, table: &str, _: Scale) -> String {
        let depth = match table {
            TRUE => "Depth is that of the true surface.",
            ESTIMATED => {
                "Depth as MiDaS would guess it, made from the true one: inverse, of random scale and shift, blurred, a floor \
                 under the object."
            }
            _ => {
                "The same, but objects lean, are bent, flattened and soft at their outlines as well: of the variance of inverse \
                 depth the best scale and shift of such an estimate explain about three quarters."
            }
        };
        format!(
            "Procedural objects as 3D-R2N2 renders them. {depth} CD: mean squared distances of both ways between 10,000 points \
             of each surface, the truth's longest edge 10; F-scores at 0.1, 0.3, 0.5 there, per cent; CD, P2M: lengths times \
             0.57 instead, times 1000, with F at squared distances of 1e-4 and 2e-4. Depth: mean absolute error over the true \
             mask at the picture's camera, a pixel that is not covered counting 0.5; and over the pixels that are covered. Colour: mean absolute difference of vertex \
             colours. Self-intersecting: faces that run through another one; folded: edges at which the surface turns by more than \
             120 degrees. {ABOUT} The poster has a Chamfer distance of no stated unit; what can be compared is its change from RGB to RGB-D."
        )
    }
}

/// The row of a model that was not trained.
fn untrained(label: &str) -> String {
    format!("{label}, not trained")
}

/// The rows of one system in one table.
struct Rows {
    system: &'static str,
    table: &'static str,
}

impl Rows {
    fn score(&self, variant: usize, column: &str) -> crate::Score {
        crate::Score::new(self.table, label(self.system, &VARIANTS[variant]), column)
    }

    /// The loss against the variant at `base`, which the next one adds it to.
    fn loss_helps(&self, base: usize) -> [Claim; 2] {
        let given = match self.table {
            TRUE => "true",
            ESTIMATED => "estimated",
            _ => "wrongly estimated",
        };
        let [without, with] = [base, base + 1].map(|k| move |column: &str| self.score(k, column));
        let percent = 100.0 * (1.0 - DEPTH_GAIN.0);
        let text = format!(
            "{}, {given} depth: its loss lowers the depth error by {percent} % at least",
            self.system
        );
        let lower = with("depth").at_most(DEPTH_GAIN.0, without("depth"), 0.0, DEPTH_GAIN.1);
        [
            Claim::new(text, [lower]),
            Claim::new(
                format!("{}, {given} depth: and does not worsen the Chamfer distance", self.system),
                [with("CD").not_behind(without("CD"), 0.0)],
            ),
        ]
    }
}

fn rows<B: MeshInit>(
    system: usize,
    (_, variant, config): Planned<Refined<B>>,
    work: &Work<'_>,
    watch: &mut Watch<'_>,
) -> Result<Vec<Row>, StudyError> {
    let variant = VARIANTS.iter().find(|other| other.id == variant).expect("one of them");
    let (data, trained) = train_job::<Refined<B>>(&config, work, watch)?;
    let scored = trained.system.scored(&data, Subset::Test)?;
    let (_, name, published) = SYSTEMS[system];
    let refine: &RefineConfig = B::refine(&config.system);
    let estimated = refine.depth == DepthKind::Estimated;
    let poster = match (refine.depth, variant.loss) {
        _ if variant.blind || variant.relief => None,
        (DepthKind::None, _) => Some(published[0]),
        (DepthKind::Estimated, Rendered::None) => Some(published[1]),
        _ => None,
    };
    let table = match (estimated, variant.relief) {
        (false, _) => TRUE,
        (true, false) => ESTIMATED,
        (true, true) => WRONG,
    };
    let row = Row::new(table, label(name, variant));
    let (_, scene) = data.trial(Subset::Test, 1, 0)?;
    let predict = || drop(std::hint::black_box(trained.system.mesh_of(&scene)));
    let row = with_scores(row, &data, &scored, poster);
    let row = with_effort(row, &trained, (&config, &data), predict)?
        .took(trained.seconds)
        .showing("", &trained.system.gallery(&data, Subset::Test)?)
        .with_objects(&predicted(&trained.system, &data, work.seed)?);
    let mut rows = vec![row];
    if work.scale == Scale::Quick && !variant.blind {
        let scored = work.untrained::<Refined<B>>(&config, &data)?.scored(&data, Subset::Test)?;
        let row = Row::new(TRUE, untrained(&label(name, variant)));
        rows.push(with_scores(row, &data, &scored, None));
    }
    Ok(rows)
}

fn with_scores(row: Row, data: &Scenes, scored: &Scored, poster: Option<f64>) -> Row {
    let mean = scored.mean();
    let name = |object: usize| data.pairs().name(object).join("/");
    let over = |cell: Cell, of: &dyn Fn(&Score) -> Option<f64>| {
        cell.over(
            scored.each.iter().filter_map(|(object, score)| Some((name(*object), of(score)?))),
        )
    };
    let percent = |share: f64| 100.0 * share;
    let mut row = row.with(over(Cell::smaller("CD", mean.chamfer, 3), &|s| Some(s.chamfer)));
    for (k, name) in ["F(0.1)", "F(0.3)", "F(0.5)"].into_iter().enumerate() {
        let cell = Cell::larger(name, percent(mean.f_scores[k]), 1);
        row = row.with(over(cell, &|s| Some(percent(s.f_scores[k]))));
    }
    row = row
        .with(over(Cell::larger("normals", mean.normals, 3), &|s| Some(s.normals)))
        .with(over(Cell::smaller("CD, P2M", mean.chamfer_p2m, 3), &|s| Some(s.chamfer_p2m)));
    for (k, name) in ["F(τ)", "F(2τ)"].into_iter().enumerate() {
        let cell = Cell::larger(name, percent(mean.f_scores_p2m[k]), 1);
        row = row.with(over(cell, &|s| Some(percent(s.f_scores_p2m[k]))));
    }
    let seen = Cell::smaller("depth where covered", mean.depth_covered, 4);
    let covered = Cell::smaller("not covered, %", percent(mean.uncovered), 1);
    row = row
        .with(over(Cell::smaller("depth", mean.depth, 4), &|s| Some(s.depth)))
        .with(over(seen, &|s| Some(s.depth_covered)))
        .with(over(covered, &|s| Some(percent(s.uncovered))));
    let [through, folded] = [mean.quality.self_intersecting, mean.quality.folded].map(percent);
    row = row
        .with(over(Cell::smaller("self-intersecting, %", through, 2), &|s| {
            Some(percent(s.quality.self_intersecting))
        }))
        .with(over(Cell::smaller("folded, %", folded, 2), &|s| Some(percent(s.quality.folded))));
    if let Some(color) = mean.color {
        row = row.with(over(Cell::smaller("colour", color, 3), &|s| s.color));
    }
    if let Some([own, shape]) = mean.iou {
        let cells = [Cell::larger("voxel IoU", own, 3), Cell::plain("mean shape", shape, 3)];
        for (k, cell) in cells.into_iter().enumerate() {
            row = row.with(over(cell, &|s| s.iou.map(|iou| iou[k])));
        }
    }
    match poster {
        Some(poster) => row.with(Cell::plain("poster's CD", poster, 3)),
        None => row,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jobs_are_named_once_and_labels_are_their_own() {
        for (scale, count) in [(Scale::Full, 21), (Scale::Quick, 6)] {
            let plan = DepthStudy.plan(scale);
            let jobs: Vec<&str> = plan.ids().collect();
            let mut sorted = jobs.clone();
            sorted.sort_unstable();
            sorted.dedup();
            assert_eq!((jobs.len(), sorted.len()), (count, count));
            assert!(!DepthStudy.plan(scale).settings.is_empty());
        }
        let labels: Vec<String> = VARIANTS[..3].iter().map(|v| label("X", v)).collect();
        assert_eq!(labels, ["X, RGB", "X, RGB-D", "X, RGB-D + rendered-depth loss"]);
    }
}
