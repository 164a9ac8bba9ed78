//! The camera in the object's frame: told, or estimated from the image.

use autodiff_lite::Tape;
use mesh_core::{Camera, TriMesh, iou};
use ode_deform::solve::{SolveError, Stats};
use recon::evaluate::seen_from;
use synth::RenderOptions;
use train::{DataError, Terms};

use super::config::CameraSource;
use super::deformer::Deformer;
use super::single_view::{SingleView, guess};
use crate::paired::{Pairs, Picture};
use crate::viewpoint::{
    DIRECTIONS, Hypothesis, LOOKED_AT, Viewpoint, as_seen, begin_at, hypotheses, viewpoint_loss,
};

/// A mesh by the camera that the configuration asks for.
#[derive(Clone, Debug)]
pub enum Seen {
    /// The picture's own.
    Told(TriMesh, Stats),
    /// One that the image was taken by, as far as it shows.
    Estimated(Estimate),
}

/// A mesh with the camera that it was made by.
#[derive(Clone, Debug)]
pub struct Estimate {
    /// In the object's frame.
    pub mesh: TriMesh,
    /// The work that it took, without the meshes of cameras that were not kept.
    pub stats: Stats,
    /// With the lens and the size of the picture's.
    pub camera: Camera,
    /// Where that stands, and how likely it was held.
    pub hypothesis: Hypothesis,
    /// Intersection over union of the mesh's outline and the image's mask.
    pub outline: f64,
    /// How many cameras were tried.
    pub tried: usize,
}

impl Seen {
    /// The mesh in the world of the picture's camera, such that this camera sees it as the camera did that it was made by.
    pub(crate) fn in_world_of(self, picture: &Picture) -> TriMesh {
        match self {
            Self::Told(mesh, _) => picture.frame.mesh_in_world(mesh),
            Self::Estimated(Estimate { mesh, camera, .. }) => {
                as_seen(picture.frame.mesh_in_world(mesh), &camera, &picture.camera)
            }
        }
    }
}

impl<D: Deformer> SingleView<D> {
    /// Lets the camera head begin at the elevation and the distance that the data has in the mean.
    pub(super) fn camera_begins_at(&mut self, data: &Pairs) -> Result<(), DataError> {
        let Some(head) = &mut self.viewpoint else { return Ok(()) };
        let looked_at = data.trained().iter().take(LOOKED_AT);
        let views = looked_at
            .map(|&object| Ok(Viewpoint::of(&data.picture(object, 0)?.camera)))
            .collect::<Result<Vec<_>, DataError>>()?;
        begin_at(head, &views);
        Ok(())
    }

    /// Terms with what the camera head misses, where there is one.
    pub(super) fn with_camera<'t>(
        &self,
        tape: &'t Tape,
        pictures: &[&Picture],
        terms: Terms<'t>,
    ) -> Terms<'t> {
        let Some(head) = &self.viewpoint else { return terms };
        let truth: Vec<Viewpoint> = pictures.iter().map(|p| Viewpoint::of(&p.camera)).collect();
        let missed = tape.scope("viewpoint", || {
            viewpoint_loss(&guess(head, self.images(tape, pictures)), &truth)
        });
        terms.with("camera", self.shared().camera_weight, missed)
    }

    /// From where the image was taken, likeliest first; nothing without a camera head. At most as many as there are directions.
    pub fn viewpoints_of(&self, picture: &Picture) -> Vec<Hypothesis> {
        let Some(head) = &self.viewpoint else { return Vec::new() };
        let tape = Tape::eval();
        let guess = guess(head, self.images(&tape, &[picture]));
        hypotheses(&guess, DIRECTIONS).swap_remove(0)
    }

    /// The mesh of one image in the frame of its picture, and the work that it took. Its camera is that of the picture, or an
    /// estimated one, as the configuration says.
    ///
    /// # Errors
    /// If an integration does not come to its end.
    pub fn mesh_of(&self, picture: &Picture) -> Result<(TriMesh, Stats), SolveError> {
        Ok(match self.seen(picture)? {
            Seen::Told(mesh, stats) => (mesh, stats),
            Seen::Estimated(estimate) => (estimate.mesh, estimate.stats),
        })
    }

    /// The mesh of one image by the camera that the configuration asks for.
    ///
    /// # Errors
    /// If an integration does not come to its end.
    pub fn seen(&self, picture: &Picture) -> Result<Seen, SolveError> {
        let estimate = match self.shared().camera {
            CameraSource::Told => None,
            CameraSource::Estimated => self.estimate(picture)?,
        };
        let finished = |mesh| self.shared().pairs.finished(mesh);
        if let Some(estimate) = estimate {
            Ok(Seen::Estimated(Estimate { mesh: finished(estimate.mesh), ..estimate }))
        } else {
            let (mesh, stats) = self.mesh_told(picture)?;
            Ok(Seen::Told(finished(mesh), stats))
        }
    }

    /// The mesh of one image by a camera that is estimated from it: of the likely ones that whose mesh has the outline that fits
    /// the image's mask best, of equal ones the likeliest. Nothing without a camera head.
    ///
    /// # Errors
    /// If an integration does not come to its end.
    pub fn estimate(&self, picture: &Picture) -> Result<Option<Estimate>, SolveError> {
        let likely = self.viewpoints_of(picture).into_iter().take(self.shared().camera_hypotheses);
        let tries = likely
            .map(|hypothesis| {
                let camera = hypothesis.viewpoint.camera(&picture.camera);
                let (mesh, stats) = self.mesh_told(&picture.seen_by(camera.clone()))?;
                let outline = overlap(picture, &picture.frame.mesh_in_world(mesh.clone()), &camera);
                Ok(Estimate { mesh, stats, camera, hypothesis, outline, tried: 0 })
            })
            .collect::<Result<Vec<_>, SolveError>>()?;
        let tried = tries.len();
        let better =
            |best: Estimate, one: Estimate| if one.outline > best.outline { one } else { best };
        Ok(tries.into_iter().reduce(better).map(|best| Estimate { tried, ..best }))
    }
}

/// Intersection over union of what a camera sees of a mesh of the world and the picture's mask; 0 where it is no mesh.
pub(super) fn overlap(picture: &Picture, mesh: &TriMesh, camera: &Camera) -> f64 {
    let Ok(seen) = seen_from(mesh, camera, &RenderOptions::default()) else { return 0.0 };
    let pixels = seen.mask.data.iter().zip(&picture.mask);
    iou(pixels.map(|(&a, &b)| (a >= 128, b >= 128))).unwrap_or(0.0)
}
