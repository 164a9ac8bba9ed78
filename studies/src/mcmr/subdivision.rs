//! 162 vertices, 642, and from the one to the other in the middle of the training.

use models::mcmr::Mcmr;
use train::Subset;

use super::{
    ABOUT, MASK, Published, QUICK, QUICK_TIMES, at_scale, not_behind, untrained, with_figures,
};
use crate::gallery::predicted;
use crate::preset::{Change, Listed, Planned, over, plan, planned, train_job};
use crate::progress::Watch;
use crate::{Claim, Floor, Plan, Row, Scale, Score, Study, StudyError, Work};

/// The name of the table.
const TABLE: &str = "Subdivision";
const COARSE: &str = "162 vertices";
const FINE: &str = "642 vertices";
const BOTH: &str = "162 to 642 vertices";

/// The mask IoU with the true camera that the quick one was found to have.
const QUICK_FOUND: f64 = 0.44;

/// The talk's ablation of subdivision, on four categories with four mean shapes.
#[derive(Clone, Copy, Debug)]
pub struct SubdivisionStudy;

fn jobs(scale: Scale) -> Vec<Planned<Mcmr>> {
    let never: Change = ("subdivide-at", "none");
    let mut set = vec![
        ("shapes", "4"),
        ("families", r#"["bicycle", "bus", "car", "motorbike"]"#),
        ("objects", "360"),
        ("test-objects", "100"),
    ];
    let mut jobs: Vec<Listed> = vec![("v162-642", BOTH, vec![])];
    if scale == Scale::Quick {
        set.extend(QUICK);
        // Six steps an epoch.
        set.push(("subdivide-at", "8"));
    } else {
        jobs.insert(0, ("v162", COARSE, vec![never]));
        jobs.insert(1, ("v642", FINE, vec![never, ("level", "3")]));
    }
    at_scale(scale, over::<Mcmr>("table", jobs, &set))
}

/// The talk's figures; it has no 3D IoU here.
fn published(label: &str) -> Option<Published> {
    let row = |values: [f64; 5]| {
        let [predicted, true_camera, ssim, l1, fid] = values;
        Some([f64::NAN, predicted, true_camera, ssim, l1, fid])
    };
    match label {
        COARSE => row([0.701, 0.759, 0.600, 0.096, 395.96]),
        FINE => row([0.685, 0.756, 0.593, 0.101, 385.68]),
        BOTH => row([0.711, 0.759, 0.607, 0.094, 380.15]),
        _ => None,
    }
}

impl Study for SubdivisionStudy {
    fn name(&self) -> &'static str {
        "mcmr-subdivision"
    }

    fn about(&self) -> &'static str {
        "MCMR: 162 vertices, 642, and a subdivision in the middle of the training"
    }

    fn plan(&self, scale: Scale) -> Plan {
        plan::<Mcmr>(&jobs(scale))
    }

    fn run(&self, work: &Work<'_>, watch: &mut Watch<'_>) -> Result<Vec<Row>, StudyError> {
        let (_, label, config) = planned::<Mcmr>(jobs(work.scale), work);
        let (data, trained) = train_job::<Mcmr>(&config, work, watch)?;
        let scored = trained.system.scored(&data, Subset::Test)?;
        let row = with_figures(Row::new(TABLE, label), &data, &scored, published(label));
        let mut rows = vec![
            row.took(trained.seconds)
                .showing(label, &trained.system.gallery(&data, Subset::Test)?)
                .with_objects(&predicted(&trained.system, &data, work.seed)?),
        ];
        if work.scale == Scale::Quick {
            let scored = work.untrained::<Mcmr>(&config, &data)?.scored(&data, Subset::Test)?;
            rows.push(with_figures(Row::new(TABLE, untrained(label)), &data, &scored, None));
        }
        Ok(rows)
    }

    fn claims(&self) -> Vec<Claim> {
        let as_good = |column: &str| {
            let compared = [COARSE, FINE].map(|other| not_behind(TABLE, BOTH, other, column));
            Claim::new(format!("162 to 642 is not behind either of the two in {column}"), compared)
        };
        MASK.map(as_good).into()
    }

    fn floors(&self) -> Vec<Floor> {
        let score = Score::new(TABLE, BOTH, MASK[1]);
        vec![Floor::new(score, 1.0, QUICK_FOUND).within(QUICK_TIMES).missed_by(untrained(BOTH))]
    }

    fn caption(&self, _: &str, _: Scale) -> String {
        format!(
            "Procedural bicycles, buses, cars and motorbikes, 360 of each, one photograph and a noisy pose each, four mean shapes. \
             {ABOUT} The talk calls them levels 3, 4 and 3 to 4, on Pascal3D+."
        )
    }
}
