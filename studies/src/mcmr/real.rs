//! The talk's tables on the data that they were made with, for those who have it.

use models::mcmr::Mcmr;
use train::DataError;

use super::{ABOUT, ABOUT_RULE, Published, QUICK, RULE, by_published_rule, with_figures};
use crate::preset::{Change, Planned, open, plan, planned, preset};
use crate::{Claim, Plan, Row, Scale, Study, StudyError, Tables, Watch, Work};

/// The names of the tables.
const PASCAL: &str = "Pascal3D+";
const CUB: &str = "CUB";

/// What the talk compares with on Pascal3D+: 3D IoU of aeroplanes and cars.
const OTHERS: &str = "The talk, 3D IoU of aeroplane and car: CSDM 0.400, 0.600; DRC 0.420, 0.670; CMR 0.460, 0.640; IMR 0.440, 0.660; U-CMR -, \
                      0.646; its own, trained one by one 0.460, 0.684, together with two mean shapes 0.448, 0.686.";
/// What it compares with on CUB: mask IoU with predicted and true camera, SSIM, L1, FID by its own definition.
const BIRDS: &str = "The talk: CMR 0.706, 0.734, 0.718, 0.063, 290.32; DIB-R -, 0.757; U-CMR 0.637, -, 0.689, 0.077, 190.35.";

/// One mean shape and several on Pascal3D+, as it comes or in MCMR's form; takes `--data`.
#[derive(Clone, Copy, Debug)]
pub struct PascalStudy;

/// One mean shape and fourteen on CUB with CMR's cache; takes `--data`.
#[derive(Clone, Copy, Debug)]
pub struct CubStudy;

/// A job, its label, its number of mean shapes, the talk's figures.
type RowPlan = (&'static str, &'static str, &'static str, Option<Published>);

const PASCAL_PLANS: [RowPlan; 2] = [
    ("pascal-1", "1 mean shape", "1", Some([0.409, 0.602, 0.670, 0.660, 0.088, 357.51])),
    ("pascal-12", "12 mean shapes", "12", Some([0.425, 0.620, 0.685, 0.665, 0.086, 345.90])),
];
const CUB_PLANS: [RowPlan; 2] = [
    ("cub-1", "1 mean shape", "1", Some([f64::NAN, 0.658, 0.721, 0.717, 0.064, 227.24])),
    ("cub-14", "14 mean shapes", "14", Some([f64::NAN, 0.642, 0.723, 0.715, 0.065, 231.95])),
];

fn jobs(plans: [RowPlan; 2], name: &str, scale: Scale) -> Vec<Planned<Mcmr>> {
    let made = |(id, label, shapes, _): RowPlan| {
        let mut changes: Vec<Change> = vec![("shapes", shapes)];
        if scale == Scale::Quick {
            changes.extend(QUICK);
            changes.extend([("max-steps", "20"), ("batch", "2"), ("image-size", "64")]);
            changes.push(("subdivide-at", "none"));
        }
        (id, label, preset::<Mcmr>(name, &changes))
    };
    plans.into_iter().map(made).collect()
}

fn run(
    table: &str,
    (plans, jobs): ([RowPlan; 2], Vec<Planned<Mcmr>>),
    work: &Work<'_>,
    watch: Watch<'_>,
) -> Result<Vec<Row>, StudyError> {
    let (id, label, config) = planned::<Mcmr>(jobs, work);
    if work.data.is_none() {
        let text = format!("this study takes real photographs: --data names a folder of {table}");
        return Err(DataError::Unfit(text).into());
    }
    let data = open::<Mcmr>(work, &config)?;
    let trained = work.train::<Mcmr>(&config, &data, watch)?;
    work.tell(watch, 1.0, "scoring")?;
    let scored = trained.system.scored(&data)?;
    super::animate(&trained);
    let published = plans.into_iter().find(|(job, ..)| *job == id).and_then(|plan| plan.3);
    let row = with_figures(Row::new(table, label), &scored, published).took(trained.seconds);
    Ok(vec![
        row.showing(label, &trained.system.gallery(&data)?),
        by_published_rule(Row::new(RULE, label), &scored),
    ])
}

/// That every row is there; which one is better is for the data to say.
fn made(table: &str, plans: [RowPlan; 2], tables: &Tables) -> Vec<Claim> {
    let column = super::MASK[0];
    let found = plans.map(|(_, label, ..)| tables.mean(table, label, column).unwrap_or(f64::NAN));
    let text = format!("both rows have a {column}");
    let holds = found.iter().all(|iou| (0.0..=1.0).contains(iou));
    vec![Claim::new(text, format!("{:.3}, {:.3}", found[0], found[1]), holds)]
}

macro_rules! study {
    ($study:ident, $name:literal, $about:literal, $table:ident, $plans:ident, $preset:literal, $others:ident) => {
        impl Study for $study {
            fn name(&self) -> &'static str {
                $name
            }

            fn about(&self) -> &'static str {
                $about
            }

            fn plan(&self, scale: Scale) -> Plan {
                plan::<Mcmr>(&jobs($plans, $preset, scale))
            }

            fn run(&self, work: &Work<'_>, watch: Watch<'_>) -> Result<Vec<Row>, StudyError> {
                run($table, ($plans, jobs($plans, $preset, work.scale)), work, watch)
            }

            fn claims(&self, tables: &Tables, _: Scale) -> Vec<Claim> {
                made($table, $plans, tables)
            }

            fn caption(&self, table: &str, _: Scale) -> String {
                match table {
                    RULE => ABOUT_RULE.to_owned(),
                    _ => format!("{ABOUT} {}", $others),
                }
            }
        }
    };
}

study!(
    PascalStudy,
    "mcmr-pascal",
    "MCMR on Pascal3D+, one mean shape and twelve (needs --data)",
    PASCAL,
    PASCAL_PLANS,
    "paper",
    OTHERS
);
study!(
    CubStudy,
    "mcmr-cub",
    "MCMR on CUB, one mean shape and fourteen (needs --data)",
    CUB,
    CUB_PLANS,
    "paper-cub",
    BIRDS
);

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use std::path::Path;

    use std::ops::ControlFlow;

    use super::*;
    use crate::{Order, ReproduceError, reproduce};

    /// From files in both layouts to a table; without files it says what is missing.
    #[test]
    fn real_layouts_are_trained_on_and_scored() {
        let fixtures =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../datasets/tests/fixtures/photos");
        let studies: [(&dyn Study, &str, &str); 2] =
            [(&PascalStudy, "mcmr", PASCAL), (&CubStudy, "cub", CUB)];
        for (study, folder, table) in studies {
            let place = tempfile::tempdir().unwrap();
            let data = fixtures.join(folder);
            let order = Order { scale: Scale::Quick, data: Some(&data), ..Order::default() };
            let made =
                reproduce(study, place.path(), &order, &mut |_| ControlFlow::Continue(())).unwrap();
            assert!(made.claims.iter().all(|claim| claim.holds), "{:?}", made.claims);
            let rows = &made.tables.table(table).unwrap().rows;
            assert_eq!(rows.len(), 2);
            let order = Order { data: None, ..order };
            let other = place.path().join("other");
            let error =
                reproduce(study, &other, &order, &mut |_| ControlFlow::Continue(())).unwrap_err();
            assert!(matches!(&error, ReproduceError::Job { error: StudyError::Data(_), .. }));
            assert!(error.to_string().contains("--data"), "{error}");
        }
    }
}
