//! The figures of a fit, as a file holds them.

use losses::metrics::Report as Comparison;
use mesh_core::{Examination, Health};
use serde::Serialize;

use super::refinement::Refinement;
use crate::evaluate::ViewScores;
use crate::fit::PhotoConsistency;
use crate::verdict::{Evidence, Verdict};

/// What `metrics.json` holds: figures that depend on the input and the options alone.
///
/// Times are in the report, so that this file is the same byte for byte on every machine and for
/// every number of threads.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Metrics {
    /// Version of this layout.
    pub schema_version: u32,
    /// Steps that were taken.
    pub steps: usize,
    /// Whether the fit was stopped before its end.
    pub interrupted: bool,
    /// The axis that is up in the coordinates of the mesh: `y` for most, `z` for NeRF's. `mesh.glb` is turned so that it is +Y
    /// there, as in viewers; `mesh.ply` and `mesh.obj` are not.
    pub up: &'static str,
    /// How far the mesh can be trusted, and why.
    pub verdict: Verdict,
    /// What the reader of the views and the fit had to say besides.
    pub warnings: Vec<String>,
    /// What the verdict is made of.
    pub evidence: Evidence,
    /// What the cameras were refined by; none where they are those of the input.
    pub cameras: Option<Refinement>,
    /// The darkest and the brightest channel of a photograph beside the mesh's colours, in sRGB; none where photographs do not
    /// differ in exposure or white balance.
    pub exposure: Option<[f32; 2]>,
    /// Whether the surface was moved to where photographs agree, where that was asked for.
    pub photo_consistency: Option<PhotoConsistency>,
    /// Which views the scores are of: `held-out`, or `fitted` where none was held out.
    pub scored_on: &'static str,
    /// The scores on those views.
    pub views: ViewScores,
    /// Whether the mesh is whole.
    pub health: Health,
    /// Its holes, as in a ring, which has one; null where it is not closed.
    pub genus: Option<usize>,
    /// The same in words: `genus 3: three holes`.
    pub holes: Option<String>,
    /// Pairs of faces that run through each other.
    pub self_intersections: usize,
    /// Against the true mesh, one entry for each protocol; empty where it is not known.
    pub truth: Vec<Comparison>,
}

impl Metrics {
    /// What they say of the mesh by itself, for words.
    pub fn examination(&self) -> Examination {
        let self_intersections = self.self_intersections;
        Examination { health: self.health.clone(), self_intersections }
    }
}
