//! How many mean shapes, of how many categories; trained together or one by one; what the selection finds.

use models::mcmr::{Data, Mcmr, Replaced, Scored, Selection};
use train::Subset;

use super::{
    ABOUT, ABOUT_HISTOGRAM, ABOUT_RULE, HISTOGRAM, IOU_3D, IOU_3D_STRICT, MASK, Published, QUICK,
    QUICK_TIMES, RULE, animate, at_scale, by_published_rule, histogram, untrained, with_camera,
    with_figures,
};
use crate::effort::{ABOUT as ABOUT_EFFORT, samples, with_effort};
use crate::gallery::predicted;
use crate::preset::{Change, Listed, Planned, over, plan, planned, train_job};
use crate::progress::Watch;
use crate::{Cell, Claim, Floor, Plan, Row, Scale, Score, Study, StudyError, Work};

/// The names of the tables.
const TABLE: &str = "Mean shapes";
const ALONE: &str = "Trained together and one by one";
const FOUND: &str = "What the selection finds";
const REPLACED: &str = "The same models with something else in the place of a part";
const VARIED: &str = "Two categories, otherwise";

/// The mask IoU with the true camera that the quick ones were found to have; spheres have 0.26 to 0.29.
const QUICK_FOUND: [f64; 2] = [0.43, 0.42];

/// By how much the mean 3D IoU of a joint training may fall behind those of two: the talk's own distance.
const BEHIND: (f64, &str) = (0.005, "the talk's own distance in 3D IoU");

/// The talk's ablation of mean shapes on procedural photo collections, its comparison of joint with independent training,
/// and what it does not measure: whether the selection finds the categories.
#[derive(Clone, Copy, Debug)]
pub struct MeanShapesStudy;

/// Some categories with one and with as many mean shapes.
struct Set {
    /// Jobs and labels with one mean shape and with several.
    jobs: [(&'static str, &'static str); 2],
    shapes: &'static str,
    families: &'static str,
    /// Photographs of each, so that all sets have as many together.
    objects: &'static str,
    /// Objects of each that are scored: about 400 in every set, since the error of a camera is often all or nothing, and the
    /// mean of a hundred such scores differs by hundredths from one training to the next.
    tested: &'static str,
    published: [Published; 2],
}

const SETS: [Set; 3] = [
    Set {
        jobs: [("two-1", "airplane, car: 1 mean shape"), ("two-n", "airplane, car: 2 mean shapes")],
        shapes: "2",
        families: r#"["airplane", "car"]"#,
        objects: "720",
        tested: "200",
        published: [
            [0.532, 0.592, 0.689, 0.736, 0.066, 365.01],
            [0.552, 0.671, 0.702, 0.737, 0.062, 344.80],
        ],
    },
    Set {
        jobs: [
            ("four-1", "bicycle, bus, car, motorbike: 1 mean shape"),
            ("four-n", "bicycle, bus, car, motorbike: 4 mean shapes"),
        ],
        shapes: "4",
        families: r#"["bicycle", "bus", "car", "motorbike"]"#,
        objects: "360",
        tested: "100",
        published: [
            [0.517, 0.665, 0.751, 0.601, 0.100, 390.41],
            [0.543, 0.711, 0.759, 0.607, 0.094, 380.15],
        ],
    },
    Set {
        jobs: [
            ("nine-1", "nine families: 1 mean shape"),
            ("nine-n", "nine families: 9 mean shapes"),
        ],
        shapes: "9",
        families: "[]",
        objects: "160",
        tested: "45",
        published: [
            [0.409, 0.602, 0.670, 0.660, 0.088, 357.51],
            [0.425, 0.620, 0.685, 0.665, 0.086, 345.90],
        ],
    },
];

/// Jobs of a single category: the job, the category, the talk's 3D IoU alone and trained together.
/// Jobs like that of two categories with two mean shapes, but for one thing.
const VARIATIONS: [(&str, &str, &[Change]); 9] = [
    ("two-blind", BLIND, &[("blind", "true")]),
    ("two-equal", "spheres that are equal at first", &[("perturb", "0")]),
    ("two-unbalanced", "no balance", &[("balance-weight", "0")]),
    ("two-plain", PLAIN, &[("perturb", "0"), ("balance-weight", "0")]),
    ("two-many", "4 mean shapes", &[("shapes", "4")]),
    ("two-softras", "SoftRas", &[("renderer", "softras"), ("closed-texture", "false")]),
    ("two-exact", EXACT, &[("pose-noise", "[0.0, 0.0, 0.0]")]),
    ("two-rough", ROUGH, &[("pose-noise", "[30.0, 10.0, 3.0]")]),
    ("four-few", "bicycle, bus, car, motorbike: 2 mean shapes", FEW),
];
const BLIND: &str = "no image read";
const PLAIN: &str = "equal spheres, no balance";
const EXACT: &str = "exact poses";
const ROUGH: &str = "poses that are rough by 30 degrees";
/// Fewer mean shapes than categories.
const FEW: &[Change] = &[
    ("families", SETS[1].families),
    ("objects", SETS[1].objects),
    ("test-objects", SETS[1].tested),
];

const SINGLE: [(&str, &str, &str, [f64; 2]); 2] = [
    ("airplane", "airplane", r#"["airplane"]"#, [0.460, 0.448]),
    ("car", "car", r#"["car"]"#, [0.684, 0.686]),
];

fn jobs(scale: Scale) -> Vec<Planned<Mcmr>> {
    let quick = scale == Scale::Quick;
    let listed = |set: &Set, (id, label), shapes, families| -> Listed {
        let (objects, tested) = (("objects", set.objects), ("test-objects", set.tested));
        (id, label, vec![("shapes", shapes), ("families", families), objects, tested])
    };
    let mut all = Vec::new();
    for set in SETS.iter().take(if quick { 1 } else { SETS.len() }) {
        let [one, several] = set.jobs;
        all.push(listed(set, one, "1", set.families));
        all.push(listed(set, several, set.shapes, set.families));
    }
    if !quick {
        all.extend(SINGLE.map(|(id, label, family, _)| listed(&SETS[0], (id, label), "1", family)));
        all.extend(VARIATIONS.map(|(id, label, changes)| {
            let (.., base) = listed(&SETS[0], (id, label), SETS[0].shapes, SETS[0].families);
            (id, label, [&base, changes].concat())
        }));
    }
    at_scale(scale, over::<Mcmr>("table", all, if quick { QUICK } else { &[] }))
}

impl Study for MeanShapesStudy {
    fn name(&self) -> &'static str {
        "mcmr-meanshapes"
    }

    fn about(&self) -> &'static str {
        "MCMR: one mean shape and several, of two, four and nine categories; does the selection find them?"
    }

    fn plan(&self, scale: Scale) -> Plan {
        plan::<Mcmr>(&jobs(scale))
    }

    fn run(&self, work: &Work<'_>, watch: &mut Watch<'_>) -> Result<Vec<Row>, StudyError> {
        let (id, label, config) = planned::<Mcmr>(jobs(work.scale), work);
        let (data, trained) = train_job::<Mcmr>(&config, work, watch)?;
        let scored = trained.system.scored(&data, Subset::Test)?;
        animate(&trained);
        let took = |row: Row| row.took(trained.seconds);
        if VARIATIONS.iter().any(|(job, ..)| *job == id) {
            let row = took(with_figures(Row::new(VARIED, label), &data, &scored, None));
            let row = with_camera(row, &data, &scored)
                .with(Cell::larger("purity", scored.purity(), 3))
                .with(Cell::plain("in use", scored.shapes_in_use(), 2))
                .showing(label, &trained.system.gallery(&data, Subset::Test)?)
                .with_objects(&predicted(&trained.system, &data, work.seed)?);
            return Ok(vec![row]);
        }
        if let Some((.., published)) = SINGLE.into_iter().find(|(job, ..)| *job == id) {
            let row = Row::new(ALONE, format!("{label}: alone"));
            return Ok(vec![took(single(row, &data, &scored, published[0]))]);
        }
        let published = SETS.iter().find_map(|set| {
            let which = set.jobs.iter().position(|(job, _)| *job == id)?;
            Some(set.published[which])
        });
        let row = took(with_figures(Row::new(TABLE, label), &data, &scored, published));
        let sample = samples(&trained.system, &data, 1)?;
        let predict = || drop(std::hint::black_box(trained.system.mesh_of_sample(&sample[0].0)));
        let row = with_effort(row, &trained, (&config, &data), predict)?
            .showing(label, &trained.system.gallery(&data, Subset::Test)?)
            .with_objects(&predicted(&trained.system, &data, work.seed)?);
        let mut rows = vec![row, by_published_rule(Row::new(RULE, label), &data, &scored)];
        rows.push(histogram(label, &data, &scored));
        if work.scale == Scale::Quick {
            let scored = work.untrained::<Mcmr>(&config, &data)?.scored(&data, Subset::Test)?;
            rows.push(with_figures(Row::new(TABLE, untrained(label)), &data, &scored, None));
        }
        if config.system.shapes > 1 {
            let pairs = trained.system.gallery_of_shapes(&data, Subset::Test)?;
            let mut all = found(label, &data, &scored).into_iter();
            let shown = format!("{label}: the mean shapes");
            rows.extend(all.next().map(|row| row.showing(shown, &pairs)));
            rows.extend(all);
            rows.extend(replaced(label, &trained.system, &data)?);
        }
        if id == SETS[0].jobs[1].0 {
            for (kind, category) in data.categories().iter().enumerate() {
                let row = Row::new(ALONE, format!("{category}: together"));
                let talk = SINGLE.iter().find(|(.., name, _, _)| name == category);
                let talk = talk.map_or(f64::NAN, |(.., published)| published[1]);
                rows.push(single(row, &data, &scored.of_kind(kind), talk));
            }
        }
        Ok(rows)
    }

    fn claims(&self) -> Vec<Claim> {
        let mut claims: Vec<Claim> = SETS
            .iter()
            .flat_map(|set| [IOU_3D, MASK[0], MASK[1]].map(|column| better(set, column)))
            .collect();
        claims.extend(SETS.iter().map(finds));
        claims.extend([IOU_3D, IOU_3D_STRICT, MASK[0], MASK[1]].map(together));
        claims.extend(SETS.iter().map(sees_where_it_is));
        let two = SETS[0].jobs[1].1;
        let camera = "camera, degrees";
        let varied = |row: &str, column: &str| Score::new(VARIED, row, column);
        claims.extend([IOU_3D, MASK[1]].map(|column| {
            let text = format!("{two}: what reads no image is worse in {column}");
            Claim::new(text, [Score::new(TABLE, two, column).above(varied(BLIND, column))])
        }));
        claims.push(Claim::new(
            "without perturbed spheres and without balance the selection collapses: purity below 0.7 of two categories",
            [varied(PLAIN, "purity").below(0.7)],
        ));
        claims.push(Claim::new(
            "rough poses make worse cameras than exact ones",
            [varied(EXACT, camera).below(varied(ROUGH, camera))],
        ));
        claims
    }

    fn floors(&self) -> Vec<Floor> {
        let floor = |((_, row), found): ((&str, &str), f64)| {
            let floor = Floor::new(Score::new(TABLE, row, MASK[1]), 1.0, found);
            floor.within(QUICK_TIMES).missed_by(untrained(row))
        };
        SETS[0].jobs.into_iter().zip(QUICK_FOUND).map(floor).collect()
    }

    fn caption(&self, table: &str, _: Scale) -> String {
        match table {
            RULE => ABOUT_RULE.to_owned(),
            HISTOGRAM => ABOUT_HISTOGRAM.to_owned(),
            REPLACED => "Nothing is trained anew. Uniform: all mean shapes count alike. The true category's: the one that its validation objects \
                         have most of. As they are: without the deformation. The camera of another object: its true one, which is chance. \
                         The mean colour: of the training's objects, on all of the surface."
                .to_owned(),
            VARIED => "As the row \"airplane, car: 2 mean shapes\" but for what is said; the last row has the four categories of its set."
                .to_owned(),
            ALONE => "Two categories, trained together with two mean shapes and each alone with one, for as many passes over the \
                      photographs. The published protocol aligns by the volumes of boxes, which a single vertex far out changes. \
                      The talk's are of Pascal3D+, alone with a mean shape for each of its models."
                .to_owned(),
            FOUND => "Purity: the share of objects of the commonest category among those whose largest weight is the same mean \
                      shape's. In use: the exponential of the entropy of the mean weights. Of a family: the mean weights of its \
                      objects; the mean shapes are in the order of the families, each family's the one that it has most of among \
                      those that are left."
                .to_owned(),
            _ => format!(
                "Procedural objects, one photograph and a noisy pose each (10 degrees, 10 % in size), 1,440 to train on in every set, \
                 64 pixels. {ABOUT} {ABOUT_EFFORT} The talk's figures are of Pascal3D+. mean-shapes.gif in each training's folder shows the way from \
                 spheres."
            ),
        }
    }
}

/// A row with the figures of one category.
fn single(row: Row, data: &Data, scored: &Scored, published: f64) -> Row {
    with_figures(row, data, scored, None).with(Cell::plain("talk: 3D IoU", published, 3))
}

/// What the same model reaches with a part of its prediction taken away, or told the truth.
fn replaced(label: &str, system: &Mcmr, data: &Data) -> Result<Vec<Row>, StudyError> {
    let none = Replaced::default;
    let selection = |selection| Replaced { selection, ..none() };
    let color = Some(data.mean_color(system.config())?);
    let controls = [
        ("uniform selection", selection(Selection::Uniform)),
        (ORACLE, selection(Selection::oracle(system, data, Subset::Validation)?)),
        ("mean shapes as they are", Replaced { undeformed: true, ..none() }),
        (CHANCE, Replaced { camera_of_another: true, ..none() }),
        ("the mean colour", Replaced { color, ..none() }),
    ];
    let row = |(name, control): (&str, Replaced)| {
        let scored = system.scored_with(data, Subset::Test, &control)?;
        let row = with_figures(Row::new(REPLACED, control_row(label, name)), data, &scored, None);
        Ok(with_camera(row, data, &scored))
    };
    controls.into_iter().map(row).collect()
}

/// Controls that claims are about.
const ORACLE: &str = "the true category's mean shape";
const CHANCE: &str = "the camera of another object";

fn control_row(label: &str, control: &str) -> String {
    format!("{label}: {control}")
}

/// What the selection finds: purity, and the weights of each family.
fn found(label: &str, data: &Data, scored: &Scored) -> Vec<Row> {
    let all = Row::new(FOUND, label)
        .with(Cell::larger("purity", scored.purity(), 3))
        .with(Cell::larger("in use", scored.shapes_in_use(), 2));
    let kinds: Vec<Vec<f64>> =
        (0..data.categories().len()).map(|kind| scored.weights_of(kind)).collect();
    let order = by_category(&kinds);
    let of = |(kind, category): (usize, &String)| {
        let row = Row::new(FOUND, format!("{label}: {category}"));
        let weights = order.iter().map(|&shape| kinds[kind][shape]).enumerate();
        weights.fold(row, |row, (i, w)| row.with(Cell::plain(format!("w {}", i + 1), w, 2)))
    };
    std::iter::once(all).chain(data.categories().iter().enumerate().map(of)).collect()
}

/// The mean shapes in the order of the categories, each that of which its category's objects have most among those left:
/// which number a shape has is chance, and means over seeds would mix them. `weights` are those of each category.
fn by_category(weights: &[Vec<f64>]) -> Vec<usize> {
    let mut left: Vec<usize> = (0..weights.first().map_or(0, Vec::len)).collect();
    let mut order = Vec::with_capacity(left.len());
    for of in weights {
        let most = (0..left.len()).max_by(|&a, &b| of[left[a]].total_cmp(&of[left[b]]));
        order.extend(most.map(|i| left.remove(i)));
    }
    order.extend(left);
    order
}

/// The camera is not that of chance.
fn sees_where_it_is(set: &Set) -> Claim {
    let (_, row) = set.jobs[1];
    let chance = Score::new(REPLACED, control_row(row, CHANCE), MASK[0]);
    let text = format!("{row}: the predicted camera beats that of another object");
    Claim::new(text, [Score::new(TABLE, row, MASK[0]).above(chance)])
}

/// Several mean shapes are better than one.
fn better(set: &Set, column: &str) -> Claim {
    let [(_, one), (_, several)] = set.jobs;
    let [one_score, score] = [one, several].map(|row| Score::new(TABLE, row, column));
    Claim::new(format!("{several} beat 1 in {column}"), [score.above(one_score)])
}

/// The selection tells more than half of the way from chance to all categories.
fn finds(set: &Set) -> Claim {
    let (_, row) = set.jobs[1];
    let kinds: f64 = set.shapes.parse().unwrap_or(1.0);
    let half = 0.5 + 0.5 / kinds;
    let text = format!(
        "{row}: the selection finds the categories, purity above {half:.2}, half of the way from chance to all"
    );
    Claim::new(text, [Score::new(FOUND, row, "purity").above(half)])
}

/// Joint training keeps up with independent trainings.
fn together(column: &str) -> Claim {
    let both = |how: &str| {
        Score::new(ALONE, format!("airplane: {how}"), column).and(format!("car: {how}"))
    };
    let (joint, alone) = (both("together"), both("alone"));
    if column == IOU_3D {
        let (margin, why) = BEHIND;
        let text = format!(
            "trained together, the mean {column} is at most {margin} below that of two trainings"
        );
        return Claim::new(text, [joint.above(alone).by(-margin, why)]);
    }
    let text = format!("trained together, the mean {column} is not behind that of two trainings");
    Claim::new(text, [joint.not_behind(alone, 1.0)])
}

#[cfg(test)]
mod tests {
    use super::by_category;

    #[test]
    fn shapes_follow_the_categories_that_have_most_of_them() {
        let weights = [vec![0.1, 0.2, 0.7], vec![0.3, 0.1, 0.6]];
        assert_eq!(by_category(&weights), [2, 0, 1]);
        assert_eq!(by_category(&[vec![1.0], vec![1.0]]), [0]);
        assert_eq!(by_category(&[]), Vec::<usize>::new());
    }
}
