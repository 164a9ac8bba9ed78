//! The talk's tables on the data that they were made with, for those who have it.

use models::mcmr::Mcmr;
use train::{DataError, Subset};

use super::{ABOUT, ABOUT_RULE, Published, QUICK, RULE, at_scale, by_published_rule, with_figures};
use crate::gallery::predicted;
use crate::preset::{Planned, over, plan, planned, train_job};
use crate::progress::Watch;
use crate::{Plan, Row, Scale, Study, StudyError, Work};

/// What the talk compares with on Pascal3D+: 3D IoU of aeroplanes and cars.
const OTHERS: &str = "The talk, 3D IoU of aeroplane and car: CSDM 0.400, 0.600; DRC 0.420, 0.670; CMR 0.460, 0.640; IMR 0.440, 0.660; U-CMR -, \
                      0.646; its own, trained one by one 0.460, 0.684, together with two mean shapes 0.448, 0.686.";
/// What it compares with on CUB: mask IoU with predicted and true camera, SSIM, L1, FID by its own definition.
const BIRDS: &str = "The talk: CMR 0.706, 0.734, 0.718, 0.063, 290.32; DIB-R -, 0.757; U-CMR 0.637, -, 0.689, 0.077, 190.35.";

/// One mean shape and several on data that the user has; takes `--data`.
#[derive(Debug)]
pub struct RealStudy {
    name: &'static str,
    about: &'static str,
    table: &'static str,
    preset: &'static str,
    rows: [RowPlan; 2],
    others: &'static str,
}

/// A job, its label, its number of mean shapes, the talk's figures.
type RowPlan = (&'static str, &'static str, &'static str, Published);

/// One mean shape and twelve on Pascal3D+, as it comes or in MCMR's form.
pub const PASCAL: RealStudy = RealStudy {
    name: "mcmr-pascal",
    about: "MCMR on Pascal3D+, one mean shape and twelve (needs --data)",
    table: "Pascal3D+",
    preset: "paper",
    rows: [
        ("pascal-1", "1 mean shape", "1", [0.409, 0.602, 0.670, 0.660, 0.088, 357.51]),
        ("pascal-12", "12 mean shapes", "12", [0.425, 0.620, 0.685, 0.665, 0.086, 345.90]),
    ],
    others: OTHERS,
};

/// One mean shape and fourteen on CUB with CMR's cache.
pub const CUB: RealStudy = RealStudy {
    name: "mcmr-cub",
    about: "MCMR on CUB, one mean shape and fourteen (needs --data)",
    table: "CUB",
    preset: "paper-cub",
    rows: [
        ("cub-1", "1 mean shape", "1", [f64::NAN, 0.658, 0.721, 0.717, 0.064, 227.24]),
        ("cub-14", "14 mean shapes", "14", [f64::NAN, 0.642, 0.723, 0.715, 0.065, 231.95]),
    ],
    others: BIRDS,
};

impl RealStudy {
    fn jobs(&self, scale: Scale) -> Vec<Planned<Mcmr>> {
        let mut quick = Vec::new();
        if scale == Scale::Quick {
            quick.extend(QUICK);
            quick.extend([("max-steps", "20"), ("batch", "2"), ("image-size", "64")]);
            quick.push(("subdivide-at", "none"));
        }
        let jobs = self.rows.map(|(id, label, shapes, _)| (id, label, vec![("shapes", shapes)]));
        at_scale(scale, over::<Mcmr>(self.preset, jobs, &quick))
    }
}

impl Study for RealStudy {
    fn name(&self) -> &'static str {
        self.name
    }

    fn about(&self) -> &'static str {
        self.about
    }

    fn plan(&self, scale: Scale) -> Plan {
        plan::<Mcmr>(&self.jobs(scale))
    }

    fn run(&self, work: &Work<'_>, watch: &mut Watch<'_>) -> Result<Vec<Row>, StudyError> {
        let (id, label, config) = planned::<Mcmr>(self.jobs(work.scale), work);
        let table = self.table;
        if work.data.is_none() {
            let text =
                format!("this study takes real photographs: --data names a folder of {table}");
            return Err(DataError::Unfit(text).into());
        }
        let (data, trained) = train_job::<Mcmr>(&config, work, watch)?;
        let scored = trained.system.scored(&data, Subset::Test)?;
        super::animate(&trained);
        let row = self.rows.iter().find(|(job, ..)| *job == id);
        let row = with_figures(Row::new(table, label), &data, &scored, row.map(|row| row.3));
        Ok(vec![
            row.took(trained.seconds)
                .showing(label, &trained.system.gallery(&data, Subset::Test)?)
                .with_objects(&predicted(&trained.system, &data, work.seed)?),
            by_published_rule(Row::new(RULE, label), &data, &scored),
        ])
    }

    fn needs_data(&self) -> bool {
        true
    }

    fn caption(&self, table: &str, _: Scale) -> String {
        match table {
            RULE => ABOUT_RULE.to_owned(),
            _ => format!("{ABOUT} {}", self.others),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::{Order, ReproduceError, reproduce};

    /// From files in both layouts to a table; without files it says what is missing.
    #[test]
    fn real_layouts_are_trained_on_and_scored() {
        let fixtures =
            Path::new(env!("CARGO_MANIFEST_DIR")).join("../datasets/tests/fixtures/photos");
        for (study, folder) in [(&PASCAL, "mcmr"), (&CUB, "cub")] {
            let place = tempfile::tempdir().unwrap();
            let data = fixtures.join(folder);
            let order = Order { scale: Scale::Quick, data: Some(&data), ..Order::default() };
            let made = reproduce(study, place.path(), &order, &mut Watch::default()).unwrap();
            let rows = &made.tables.table(study.table).unwrap().rows;
            assert_eq!(rows.len(), 2);
            for row in rows {
                let found = made.tables.mean(study.table, &row.label, super::super::MASK[0]);
                assert!(found.is_some_and(|iou| (0.0..=1.0).contains(&iou)), "{found:?}");
            }
            let order = Order { data: None, ..order };
            let other = place.path().join("other");
            let error = reproduce(study, &other, &order, &mut Watch::default()).unwrap_err();
            assert!(matches!(&error, ReproduceError::Job { error: StudyError::Data(_), .. }));
            assert!(error.to_string().contains("--data"), "{error}");
        }
    }
}
