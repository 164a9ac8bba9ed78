//! The camera in the object's frame: told, or estimated from the image.

use autodiff_lite::Tape;
use mesh_core::{Camera, TriMesh, iou};
use ode_deform::solve::{SolveError, Stats};
use synth::{RenderOptions, render_view};
use train::{DataError, Terms};

use super::config::CameraSource;
use super::deformer::Deformer;
use super::single_view::{SingleView, guess};
use crate::paired::{InputImage, Pairs};
use crate::viewpoint::{
    DIRECTIONS, Hypothesis, LOOKED_AT, Viewpoint, as_seen, begin_at, hypotheses, viewpoint_loss,
};

/// A mesh by the camera that the configuration asks for.
#[derive(Clone, Debug)]
pub enum Seen {
    /// The image's own.
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
    /// With the lens and the size of the image's.
    pub camera: Camera,
    /// Where that stands, and how likely it was held.
    pub hypothesis: Hypothesis,
    /// Intersection over union of the mesh's outline and the image's mask.
    pub outline: f64,
    /// How many cameras were tried.
    pub tried: usize,
}

impl Estimate {
    /// How well the camera explains the image: the outline's intersection over union and, times `prior_weight`, the logarithm of
    /// the camera's probability.
    pub fn score(&self, prior_weight: f64) -> f64 {
        // No weight times the logarithm of 0 would be no number.
        self.outline + prior_weight * self.hypothesis.probability.max(f64::MIN_POSITIVE).ln()
    }
}

impl Seen {
    /// The mesh in the world of the image's camera, such that this camera sees it as the camera did that it was made by.
    pub(crate) fn in_world_of(self, image: &InputImage) -> TriMesh {
        match self {
            Self::Told(mesh, _) => image.frame.mesh_in_world(mesh),
            Self::Estimated(Estimate { mesh, camera, .. }) => {
                as_seen(image.frame.mesh_in_world(mesh), &camera, &image.camera)
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
            .map(|&object| Ok(Viewpoint::of(&data.image(object, 0)?.camera)))
            .collect::<Result<Vec<_>, DataError>>()?;
        begin_at(head, &views);
        Ok(())
    }

    /// Terms with what the camera head misses, where there is one.
    pub(super) fn with_camera<'t>(
        &self,
        tape: &'t Tape,
        images: &[&InputImage],
        terms: Terms<'t>,
    ) -> Terms<'t> {
        let Some(head) = &self.viewpoint else { return terms };
        let truth: Vec<Viewpoint> = images.iter().map(|p| Viewpoint::of(&p.camera)).collect();
        let missed = tape
            .scope("viewpoint", || viewpoint_loss(&guess(head, self.pixels(tape, images)), &truth));
        terms.with("camera", self.shared().camera_weight, missed)
    }

    /// From where the image was taken, likeliest first; nothing without a camera head. At most as many as there are directions.
    pub fn viewpoints_of(&self, image: &InputImage) -> Vec<Hypothesis> {
        let Some(head) = &self.viewpoint else { return Vec::new() };
        let tape = Tape::eval();
        let guess = guess(head, self.pixels(&tape, &[image]));
        hypotheses(&guess, DIRECTIONS).swap_remove(0)
    }

    /// The mesh of one image in its frame, and the work that it took. Its camera is the image's, or an
    /// estimated one, as the configuration says.
    ///
    /// # Errors
    /// If an integration does not come to its end.
    pub fn mesh_of(&self, image: &InputImage) -> Result<(TriMesh, Stats), SolveError> {
        Ok(match self.seen(image)? {
            Seen::Told(mesh, stats) => (mesh, stats),
            Seen::Estimated(estimate) => (estimate.mesh, estimate.stats),
        })
    }

    /// The mesh of one image by the camera that the configuration asks for.
    ///
    /// # Errors
    /// If an integration does not come to its end.
    pub fn seen(&self, image: &InputImage) -> Result<Seen, SolveError> {
        let estimate = match self.shared().camera {
            CameraSource::Told => None,
            CameraSource::Estimated => self.estimate(image)?,
        };
        let finished = |mesh| self.shared().pairs.finished(mesh);
        if let Some(estimate) = estimate {
            Ok(Seen::Estimated(Estimate { mesh: finished(estimate.mesh), ..estimate }))
        } else {
            let (mesh, stats) = self.mesh_told(image)?;
            Ok(Seen::Told(finished(mesh), stats))
        }
    }

    /// The mesh of one image by a camera that is estimated from it: of the likely ones that with the highest
    /// [score](Estimate::score), of equal ones the likeliest. Nothing without a camera head.
    ///
    /// # Errors
    /// If an integration does not come to its end.
    pub fn estimate(&self, image: &InputImage) -> Result<Option<Estimate>, SolveError> {
        let likely = self.viewpoints_of(image).into_iter().take(self.shared().camera_hypotheses);
        let tries = likely
            .map(|hypothesis| {
                let camera = hypothesis.viewpoint.camera(&image.camera);
                let (mesh, stats) = self.mesh_told(&image.seen_by(camera.clone()))?;
                let outline = overlap(image, &image.frame.mesh_in_world(mesh.clone()), &camera);
                Ok(Estimate { mesh, stats, camera, hypothesis, outline, tried: 0 })
            })
            .collect::<Result<Vec<_>, SolveError>>()?;
        let tried = tries.len();
        let score = |one: &Estimate| one.score(self.shared().camera_prior_weight);
        let better =
            |best: Estimate, one: Estimate| if score(&one) > score(&best) { one } else { best };
        Ok(tries.into_iter().reduce(better).map(|best| Estimate { tried, ..best }))
    }
}

/// Intersection over union of what a camera sees of a mesh of the world and the image's mask; 0 where it is no mesh.
pub(super) fn overlap(image: &InputImage, mesh: &TriMesh, camera: &Camera) -> f64 {
    let Ok(seen) = render_view(mesh, camera, &RenderOptions::default()) else { return 0.0 };
    let pixels = seen.mask.data.iter().zip(&image.mask);
    iou(pixels.map(|(&a, &b)| (a >= 128, b >= 128))).unwrap_or(0.0)
}
