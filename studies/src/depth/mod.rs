//! The poster's table, with the column that its authors could not finish.

mod curves;

use models::depth::{
    DepthKind, DepthPixel2Mesh, MeshInit, MeshRcnn, RefineConfig, Refined, Score, Sphere, Voxels,
};

use crate::preset::{Change, Planned, plan, planned, preset, train_job};
use crate::{Cell, Claim, Picture, Plan, Row, Scale, Study, StudyError, Tables, Watch, Work};

/// The studies of this module, in the order of lists.
pub const STUDIES: &[&dyn Study] = &[&DepthStudy];

/// The names of the tables.
const TRUE: &str = "With true depth";
const ESTIMATED: &str = "With estimated depth";

/// Most Chamfer distance of the quick ones.
const QUICK_MOST: [f64; 2] = [6.0, 10.0];
/// What depth should gain for Pixel2Mesh, and its loss in depth error.
const LEAST_GAIN: f64 = 0.15;
const LEAST_DEPTH_GAIN: f64 = 0.25;
/// What "does not worsen" leaves to chance where there is one seed.
const SAME: f64 = 1.02;

/// A row: what is given, and whether depth is in the loss.
struct Variant {
    /// The end of the job's name.
    id: &'static str,
    depth: DepthKind,
    loss: bool,
}

const VARIANTS: [Variant; 5] = [
    Variant { id: "rgb", depth: DepthKind::None, loss: false },
    Variant { id: "rgbd", depth: DepthKind::True, loss: false },
    Variant { id: "rgbd-loss", depth: DepthKind::True, loss: true },
    Variant { id: "estimate", depth: DepthKind::Estimated, loss: false },
    Variant { id: "estimate-loss", depth: DepthKind::Estimated, loss: true },
];

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
    let given = if variant.depth == DepthKind::None { "RGB" } else { "RGB-D" };
    let loss = if variant.loss { " + rendered-depth loss" } else { "" };
    format!("{system}, {given}{loss}")
}

/// Which variants are made; quick ones are the first and the third.
fn variants(scale: Scale) -> impl Iterator<Item = &'static Variant> {
    let quick = scale == Scale::Quick;
    VARIANTS.iter().enumerate().filter(move |(i, _)| !quick || [0, 2].contains(i)).map(|(_, v)| v)
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
    if !variant.loss {
        changes.extend([("depth-weight", "0"), ("coverage", "0")]);
    } else if variant.depth == DepthKind::Estimated {
        changes.extend(guessed);
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
    variants(scale).map(|v| (id(v), v.id, changed::<B>(scale, v, own))).collect()
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
        plan::<DepthPixel2Mesh>(&spheres(scale)).and(plan::<MeshRcnn>(&voxels(scale)))
    }

    fn run(&self, work: &Work<'_>, watch: Watch<'_>) -> Result<Vec<Row>, StudyError> {
        if work.id.starts_with("pixel2mesh") {
            rows::<Sphere>(0, planned::<DepthPixel2Mesh>(spheres(work.scale), work), work, watch)
        } else {
            rows::<Voxels>(1, planned::<MeshRcnn>(voxels(work.scale), work), work, watch)
        }
    }

    fn claims(&self, tables: &Tables, scale: Scale) -> Vec<Claim> {
        let [sphere, voxel] = [0, 1].map(|k| Figures { tables, system: SYSTEMS[k].1, table: TRUE });
        if scale == Scale::Quick {
            let quick = |figures: &Figures<'_>, most: f64| {
                let what = format!("{}: the Chamfer distance is", figures.system);
                Claim::at_most(&what, figures.of(&VARIANTS[2], "CD"), most)
            };
            return vec![quick(&sphere, QUICK_MOST[0]), quick(&voxel, QUICK_MOST[1])];
        }
        let guessed = [0, 1].map(|k| Figures { tables, system: SYSTEMS[k].1, table: ESTIMATED });
        let mut claims = vec![sphere.depth_helps(LEAST_GAIN), voxel.depth_helps(0.0)];
        claims.extend(sphere.loss_helps(1));
        claims.extend(voxel.loss_helps(1));
        claims.extend(guessed.iter().flat_map(|figures| figures.loss_helps(3)));
        claims.push(voxel.beats_the_mean_shape());
        claims
    }

    fn caption(&self, table: &str, _: Scale) -> String {
        let depth = if table == TRUE {
            "Depth is that of the true surface."
        } else {
            "Depth as MiDaS would guess it, made from the true one: inverse, of random scale and shift, blurred, a floor \
             under the object."
        };
        format!(
            "Procedural objects as 3D-R2N2 renders them. {depth} CD: mean squared distances of both ways between 10,000 points \
             of each surface, the truth's longest edge 10; F-scores at 0.1, 0.3, 0.5 there, per cent; CD, P2M: lengths times \
             0.57 instead, times 1000, with F at squared distances of 1e-4 and 2e-4. Depth: mean absolute error over the true \
             mask at the picture's camera, a pixel that is not covered counting 0.5. Colour: mean absolute difference of vertex \
             colours. The poster has a Chamfer distance of no stated unit; what can be compared is its change from RGB to RGB-D."
        )
    }
}

/// The figures of one system's rows.
struct Figures<'a> {
    tables: &'a Tables,
    system: &'a str,
    table: &'a str,
}

impl Figures<'_> {
    fn of(&self, variant: &Variant, column: &str) -> f64 {
        self.tables.figure(self.table, &label(self.system, variant), column)
    }

    fn depth_helps(&self, least: f64) -> Claim {
        let [without, with] = [0, 1].map(|k| self.of(&VARIANTS[k], "CD"));
        let gain = 1.0 - with / without;
        let text = if least > 0.0 {
            let percent = 100.0 * least;
            format!(
                "{}: depth lowers the Chamfer distance by {percent} % at least (poster: 24.6 %)",
                self.system
            )
        } else {
            format!("{}: depth lowers the Chamfer distance (poster: it rose by 1.3 %)", self.system)
        };
        let found = format!("{without:.3} to {with:.3}: {:.1} %", 100.0 * gain);
        Claim::new(text, found, gain > 0.0 && gain >= least)
    }

    /// The loss against the variant at `base`, which the next one adds it to.
    fn loss_helps(&self, base: usize) -> [Claim; 2] {
        let both = |column: &str| [base, base + 1].map(|k| self.of(&VARIANTS[k], column));
        let given = if self.table == TRUE { "true" } else { "estimated" };
        let [without, with] = both("depth");
        let gain = 1.0 - with / without;
        let percent = 100.0 * LEAST_DEPTH_GAIN;
        let depth = Claim::new(
            format!(
                "{}, {given} depth: its loss lowers the depth error by {percent} % at least",
                self.system
            ),
            format!("{without:.4} to {with:.4}: {:.1} %", 100.0 * gain),
            gain >= LEAST_DEPTH_GAIN,
        );
        let [without, with] = both("CD");
        let chamfer = Claim::new(
            format!("{}, {given} depth: and does not worsen the Chamfer distance", self.system),
            format!("{without:.3} to {with:.3}"),
            with <= SAME * without,
        );
        [depth, chamfer]
    }

    fn beats_the_mean_shape(&self) -> Claim {
        let row = label(self.system, &VARIANTS[0]);
        let [own, shape] = ["voxel IoU", "mean shape"].map(|c| self.of(&VARIANTS[0], c));
        let spread = self.tables.spread(self.table, &row, "voxel IoU").unwrap_or(0.0);
        Claim::new(
            "the voxel branch from colours alone beats the mean shape by more than the spread",
            format!("{own:.3}, {shape:.3}, spread {spread:.3}"),
            own - shape > spread,
        )
    }
}

fn rows<B: MeshInit>(
    system: usize,
    (_, variant, config): Planned<Refined<B>>,
    work: &Work<'_>,
    watch: Watch<'_>,
) -> Result<Vec<Row>, StudyError> {
    let variant = VARIANTS.iter().find(|other| other.id == variant).expect("one of them");
    let (data, trained) = train_job::<Refined<B>>(&config, work, watch)?;
    let mean = trained.system.scored(&data, train::Subset::Test)?.mean();
    let (prefix, name, published) = SYSTEMS[system];
    let refine: &RefineConfig = B::refine(&config.system);
    let estimated = refine.depth == DepthKind::Estimated;
    let poster = match (refine.depth, variant.loss) {
        (DepthKind::None, _) => Some(published[0]),
        (DepthKind::Estimated, false) => Some(published[1]),
        _ => None,
    };
    let row = Row::new(if estimated { ESTIMATED } else { TRUE }, label(name, variant));
    let mut row = with_scores(row, &mean, poster)
        .took(trained.seconds)
        .showing("", &trained.system.gallery(&data, train::Subset::Test)?);
    if variant.id == "rgbd" {
        let other = work.folder.with_file_name(format!("{prefix}-rgb-seed-{}", work.seed));
        let curves = [curves::curve(&other, "chamfer"), curves::curve(work.folder, "chamfer")];
        if let [Some(colors), Some(depth)] = curves {
            row.pictures.push(Picture {
                caption:
                    "Chamfer loss over the training, RGB (blue) and RGB-D (orange), logarithmic."
                        .into(),
                image: curves::overlaid([&colors, &depth]),
            });
        }
    }
    Ok(vec![row])
}

fn with_scores(row: Row, mean: &Score, poster: Option<f64>) -> Row {
    let percent = |share: f64| 100.0 * share;
    let mut row = row.with(Cell::smaller("CD", mean.chamfer, 3));
    for (k, name) in ["F(0.1)", "F(0.3)", "F(0.5)"].into_iter().enumerate() {
        row = row.with(Cell::larger(name, percent(mean.f_scores[k]), 1));
    }
    row = row
        .with(Cell::larger("normals", mean.normals, 3))
        .with(Cell::smaller("CD, P2M", mean.chamfer_p2m, 3))
        .with(Cell::larger("F(τ)", percent(mean.f_scores_p2m[0]), 1))
        .with(Cell::larger("F(2τ)", percent(mean.f_scores_p2m[1]), 1))
        .with(Cell::smaller("depth", mean.depth, 4))
        .with(Cell::smaller("not covered, %", percent(mean.uncovered), 1));
    if let Some(color) = mean.color {
        row = row.with(Cell::smaller("colour", color, 3));
    }
    if let Some([own, shape]) = mean.iou {
        row = row.with(Cell::larger("voxel IoU", own, 3)).with(Cell::plain("mean shape", shape, 3));
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
        for (scale, count) in [(Scale::Full, 10), (Scale::Quick, 4)] {
            let jobs = DepthStudy.plan(scale).jobs;
            let mut sorted = jobs.clone();
            sorted.sort();
            sorted.dedup();
            assert_eq!((jobs.len(), sorted.len()), (count, count));
            assert!(!DepthStudy.plan(scale).settings.is_empty());
        }
        let labels: Vec<String> = VARIANTS[..3].iter().map(|v| label("X", v)).collect();
        assert_eq!(labels, ["X, RGB", "X, RGB-D", "X, RGB-D + rendered-depth loss"]);
    }
}
