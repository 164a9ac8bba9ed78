//! Pixel2Mesh in the object's own frame: the camera told, estimated from the image, or not needed.

use datasets::View;
use mesh_core::TriMesh;
use models::paired::{Pair, PointScores, point_scores};
use models::pixel2mesh::{
    CameraSource, Deformer, Estimate, Pixel2Mesh, Scored, Seen, SingleView, StagesConfig,
};
use ode_deform::solve::Stats;
use recon::fit::{FitError, RefineConfig, refine};
use train::{DataError, Subset};

use super::{BLINDED, COLUMNS, QUICK as QUICKLY, with_scores};
use crate::effort::{ABOUT, with_effort};
use crate::gallery::predicted;
use crate::preset::{Change, Listed, Planned, over, plan, planned, scaled, train_job};
use crate::progress::Watch;
use crate::{Cell, Claim, Plan, Row, Scale, Score, Study, StudyError, Work};

/// The name of the table.
const TABLE: &str = "One image in whose frame, airplanes";

const CAMERA_FRAME: &str = "the camera's frame";
const OBJECT_FRAME: &str = "the object's frame";
const BLIND: &str = "the object's frame and no image read";
const PUBLISHED: &str = "the object's frame and the former regularisers";
const TOLD: &str = "the object's frame, camera told";
const ESTIMATED: &str = "the object's frame, camera estimated";
const TOLD_REFINED: &str = "the object's frame, camera told, refined";
const ESTIMATED_REFINED: &str = "the object's frame, camera estimated, refined";

/// The size of tables; the preset itself is the size of a model that is kept.
const SIZE: &[Change] = &[
    ("image-size", "64"),
    ("level", "1"),
    ("max-steps", "2000"),
    ("objects", "400"),
    ("synthetic-views", "24"),
    ("validation-every", "none"),
    ("samples-every", "none"),
];

/// The regularisers of the other presets: for edges a third, for displacements a thirtieth of what stands in this one.
const FORMER: [Change; 4] = [
    ("edge-weight", "5.0"),
    ("stretch-weight", "0.0"),
    ("laplacian-weight", "5.0"),
    ("bending-weight", "0.0"),
];

/// The same network with the same steps in the camera's frame, as published, and in the object's, where its camera is told or
/// estimated; each of these also refined on the image's own mask.
#[derive(Clone, Copy, Debug)]
pub struct ObjectFrameStudy;

fn jobs(scale: Scale) -> Vec<Planned<Pixel2Mesh>> {
    let object: Listed = ("object", OBJECT_FRAME, vec![]);
    let blind: Listed = ("object-blind", BLIND, vec![BLINDED]);
    if scale == Scale::Quick {
        let quick = |(id, label, own): Listed| (id, label, [QUICKLY, &own[..]].concat());
        return over::<Pixel2Mesh>("object", [object, blind].map(quick), SILENT);
    }
    let camera = vec![("frame", "camera"), ("camera-weight", "0.0")];
    let jobs = [
        ("camera", CAMERA_FRAME, camera),
        object,
        ("object-former", PUBLISHED, FORMER.into()),
        blind,
    ];
    scaled::<Pixel2Mesh>(scale, over::<Pixel2Mesh>("object", jobs, SIZE))
}

/// Nothing is chosen on the way.
const SILENT: &[Change] = &[("validation-every", "none"), ("samples-every", "none")];

impl Study for ObjectFrameStudy {
    fn name(&self) -> &'static str {
        "pixel2mesh-object"
    }

    fn about(&self) -> &'static str {
        "Pixel2Mesh in the object's own frame: the camera told, estimated, or not needed; refined on the image's mask"
    }

    fn plan(&self, scale: Scale) -> Plan {
        plan::<Pixel2Mesh>(&jobs(scale)).with("emd = 512 points\n")
    }

    fn run(&self, work: &Work<'_>, watch: &mut Watch<'_>) -> Result<Vec<Row>, StudyError> {
        let (_, label, config) = planned::<Pixel2Mesh>(jobs(work.scale), work);
        let (data, trained) = train_job::<Pixel2Mesh>(&config, work, watch)?;
        let system = &trained.system;
        let scored = system.scored(&data, Subset::Test)?;
        if label != OBJECT_FRAME {
            let row = with_scores(Row::new(TABLE, label), &data, &scored).took(trained.seconds);
            return Ok(vec![row.with_objects(&predicted(system, &data, work.seed)?)]);
        }
        let guessing = guessing(system);
        let guessed = guessing.scored(&data, Subset::Test)?;
        work.tell(watch, 1.0, "refining")?;
        let refined = |system: &Pixel2Mesh| {
            let views = system.shared().pairs.scored_views;
            let config = RefineConfig::default();
            let moved =
                |mesh: &TriMesh, view: &View| refine(mesh, std::slice::from_ref(view), &config);
            Scored::of(&data, (Subset::Test, views), |pair| changed(system, pair, moved))
        };
        let row = |label: &str, scored: &Scored| with_scores(Row::new(TABLE, label), &data, scored);
        let (_, pair) = data.trial(Subset::Test, 1, 0)?;
        let shown = |row: Row, system: &Pixel2Mesh| -> Result<Row, StudyError> {
            let predict = || drop(std::hint::black_box(system.seen(&pair.image)));
            Ok(with_effort(row, &trained, (&config, &data), predict)?
                .took(trained.seconds)
                .showing("", &system.gallery(&data, Subset::Test)?)
                .with_objects(&predicted(system, &data, work.seed)?))
        };
        Ok(vec![
            shown(with_camera(row(TOLD, &scored), &scored), system)?,
            row(TOLD_REFINED, &refined(system)?),
            shown(with_camera(row(ESTIMATED, &guessed), &guessed), &guessing)?,
            row(ESTIMATED_REFINED, &refined(&guessing)?),
        ])
    }

    fn claims(&self) -> Vec<Claim> {
        let score = |row: &str, column: &str| Score::new(TABLE, row, column);
        let better = |own: &str, other: &str| {
            let of = |row: &str| [score(row, "CD"), score(row, "EMD")];
            of(own)
                .into_iter()
                .zip(of(other))
                .map(|(own, other)| own.below(other))
                .collect::<Vec<_>>()
        };
        vec![
            Claim::new(
                "told its camera, the network is better in the object's own frame than in the camera's",
                better(TOLD, CAMERA_FRAME),
            ),
            Claim::new(
                "and so it is with a camera that it estimates",
                better(ESTIMATED, CAMERA_FRAME),
            ),
            Claim::new("it reads its image: better than what sees nothing", better(TOLD, BLIND)),
            Claim::new("and so it does by its own camera", better(ESTIMATED, BLIND)),
            Claim::new(
                "stronger regularisers leave fewer faces that run through others, and are not behind in distance",
                [
                    score(TOLD, "self-intersecting, %")
                        .below(score(PUBLISHED, "self-intersecting, %")),
                    score(TOLD, "CD").not_behind(score(PUBLISHED, "CD"), 0.0),
                ],
            ),
            Claim::new(
                "refined on the image's mask it is better, the camera told",
                [score(TOLD_REFINED, "CD").below(score(TOLD, "CD"))],
            ),
            Claim::new(
                "and estimated",
                [score(ESTIMATED_REFINED, "CD").below(score(ESTIMATED, "CD"))],
            ),
        ]
    }

    fn caption(&self, _: &str, _: Scale) -> String {
        format!(
            "Procedural airplanes as 3D-R2N2 renders them, 400 to train and 40 others to test; 64 pixels, Pixel2Mesh in two stages to 618 vertices, \
             all rows as many steps. In the camera's frame no camera is needed; in the object's it is told, or estimated by a head that is trained beside \
             (up to three hypotheses, of which the outline alone chooses). Told and estimated are one model. Refined: 50 steps on the mask of the one image, \
             by that camera, without more vertices. {COLUMNS} {ABOUT}"
        )
    }
}

/// The same model, left alone with the image.
fn guessing(system: &Pixel2Mesh) -> Pixel2Mesh {
    let mut config: StagesConfig = system.config().clone();
    config.shared.camera = CameraSource::Estimated;
    // As the published table was made.
    config.shared.camera_prior_weight = 0.0;
    system.with_config(&config)
}

/// A row with what is known of its cameras.
fn with_camera(row: Row, scored: &Scored) -> Row {
    row.with(Cell::smaller("azimuth error, degrees", scored.azimuth_error(), 1))
        .with(Cell::smaller("flips, %", 100.0 * scored.flips(), 1))
}

/// The scores of what becomes of a prediction: of the mesh in the world of the image's camera, and the image with the camera that the
/// mesh was seen by; and the work that the prediction took.
///
/// # Errors
/// Those of `change`.
pub fn changed<D: Deformer>(
    system: &SingleView<D>,
    pair: &Pair,
    change: impl Fn(&TriMesh, &View) -> Result<TriMesh, FitError>,
) -> Result<(PointScores, Stats), DataError> {
    let image = &*pair.image;
    let (mesh, stats, camera) = match system.seen(image) {
        Ok(Seen::Told(mesh, stats)) => (mesh, stats, image.camera.clone()),
        Ok(Seen::Estimated(Estimate { mesh, stats, camera, .. })) => (mesh, stats, camera),
        Err(_) => return Ok((point_scores(&TriMesh::default(), &pair.truth), Stats::default())),
    };
    let world = image.frame.mesh_in_world(mesh);
    let world = change(&world, &View { camera, ..image.view() }).map_err(DataError::unfit)?;
    Ok((point_scores(&image.frame.mesh_placed(&world), &pair.truth), stats))
}

#[cfg(test)]
mod tests {
    use train::System as _;

    use super::*;

    #[test]
    fn jobs_are_sound() {
        for scale in [Scale::Full, Scale::Quick] {
            for (id, _, config) in jobs(scale) {
                let problems = Pixel2Mesh::check(&config.system);
                assert_eq!(problems, Vec::<String>::new(), "{id}");
            }
        }
    }
}
