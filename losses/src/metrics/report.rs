//! Two meshes compared under a protocol.

use mesh_core::{MeshError, SurfacePoint, TriMesh, sample_surface};
use serde::Serialize;

use super::bounds::bounds;
use super::{
    Combination, FScore, IouProtocol, McmrAlignment, Normalisation, Points, Protocol, mcmr_iou,
    point_distances, voxel_iou,
};

/// The figures of one comparison and the protocol that made them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// How the figures were made.
    pub protocol: Protocol,
    /// The combined distance.
    pub chamfer: Option<f64>,
    /// The mean distance from prediction to truth, squared if the protocol says so.
    pub accuracy: Option<f64>,
    /// The mean distance from truth to prediction, squared if the protocol says so.
    pub completeness: Option<f64>,
    /// One entry for each threshold of the protocol.
    pub f_scores: Vec<FScore>,
    /// The mean `|cos|` between normals at nearest points, both ways averaged.
    pub normal_consistency: Option<f64>,
    /// The intersection over union of the volumes.
    pub iou: Option<f64>,
}

/// Which of the two meshes an error is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// The first.
    Prediction,
    /// The second.
    Truth,
}

impl std::fmt::Display for Role {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Prediction => "predicted mesh",
            Self::Truth => "true mesh",
        })
    }
}

/// Why two meshes cannot be compared.
#[derive(Debug, thiserror::Error)]
pub enum CompareError {
    /// An index out of range or a coordinate that is not finite.
    #[error("the {role} is invalid: {source}")]
    Invalid {
        /// Which mesh.
        role: Role,
        /// What is wrong with it.
        source: MeshError,
    },
    /// No faces, or faces without area.
    #[error("the {role} has no surface: {faces} faces with a total area of zero")]
    NoSurface {
        /// Which mesh.
        role: Role,
        /// How many faces it has.
        faces: usize,
    },
    /// The scale of the comparison is taken from a bounding box that has none.
    #[error("the {role} has a flat bounding box, so the meshes cannot be aligned")]
    Flat {
        /// Which mesh.
        role: Role,
    },
}

/// Compares two meshes as a protocol says.
///
/// A mesh compared with itself gives distance 0, F-score 1 and IoU 1 exactly, since both are sampled with
/// the protocol's seed.
///
/// Cost: brute-force nearest neighbours, `samples²` pairs each way; 100,000 points take about a second.
///
/// # Errors
/// If a mesh is invalid, has no surface, or cannot be aligned.
///
/// ```
/// use losses::metrics::{Preset, evaluate};
/// use mesh_core::primitives::icosphere;
///
/// let ball = icosphere(2);
/// let report = evaluate(&ball, &ball, &Preset::MeshRcnn.protocol(0))?;
/// assert_eq!(report.chamfer, Some(0.0));
/// assert_eq!(report.f_scores[0].f_score, 1.0);
/// # Ok::<(), losses::metrics::CompareError>(())
/// ```
pub fn evaluate(
    prediction: &TriMesh,
    truth: &TriMesh,
    protocol: &Protocol,
) -> Result<Report, CompareError> {
    for (role, mesh) in [(Role::Prediction, prediction), (Role::Truth, truth)] {
        mesh.validate().map_err(|source| CompareError::Invalid { role, source })?;
        if mesh.faces.is_empty() || area(mesh) <= 0.0 {
            return Err(CompareError::NoSurface { role, faces: mesh.faces.len() });
        }
    }
    let (factor, offset) = placement(truth, protocol.normalisation);
    let prediction = placed(prediction, factor, offset);
    let truth = placed(truth, factor, offset);

    let mut report = Report {
        protocol: protocol.clone(),
        chamfer: None,
        accuracy: None,
        completeness: None,
        f_scores: Vec::new(),
        normal_consistency: None,
        iou: None,
    };
    if let Some(points) = protocol.points {
        distances(&prediction, &truth, points, &mut report);
    }
    report.iou = match protocol.iou {
        None => None,
        Some(IouProtocol::CommonBox { resolution }) => Some(voxel_iou(&prediction, &truth, resolution)),
        Some(IouProtocol::McmrAligned { .. }) => {
            let alignment = McmrAlignment::of(&prediction, &truth)
                .ok_or(CompareError::Flat { role: flat(&prediction) })?;
            Some(mcmr_iou(&prediction, &truth, alignment))
        }
    };
    Ok(report)
}

fn distances(prediction: &TriMesh, truth: &TriMesh, points: Points, report: &mut Report) {
    let protocol = &report.protocol;
    let take = |mesh: &TriMesh| -> (Vec<[f32; 3]>, Vec<[f32; 3]>) {
        match points {
            Points::Vertices => (mesh.positions.clone(), mesh_core::vertex_normals(&mesh.positions, &mesh.faces)),
            Points::Surface { samples } => {
                let found = sample_surface(mesh, samples, protocol.seed);
                let normals = mesh_core::face_normals(&mesh.positions, &mesh.faces);
                let normal = |p: &SurfacePoint| normals[p.face as usize];
                (found.iter().map(|p| p.position(mesh)).collect(), found.iter().map(normal).collect())
            }
        }
    };
    let ((p, p_normals), (t, t_normals)) = (take(prediction), take(truth));
    if p.is_empty() || t.is_empty() {
        return;
    }
    let found = point_distances(&p, &t);
    let (accuracy, completeness) = found.chamfer(protocol.squared);
    let sum = accuracy + completeness;
    report.chamfer = Some(match protocol.combination {
        Combination::Sum => sum,
        Combination::Mean => 0.5 * sum,
    });
    report.f_scores = protocol.thresholds.iter().map(|&tau| found.f_score(tau)).collect();
    report.normal_consistency =
        protocol.normals.then(|| found.normal_consistency(&p_normals, &t_normals));
    report.accuracy = Some(accuracy);
    report.completeness = Some(completeness);
}

/// The factor and the offset (subtracted first) that the protocol asks for.
fn placement(truth: &TriMesh, normalisation: Normalisation) -> (f64, [f64; 3]) {
    let (lo, hi) = bounds(truth).unwrap_or_default();
    let longest = (0..3).map(|k| hi[k] - lo[k]).fold(f64::MIN_POSITIVE, f64::max);
    let centre = std::array::from_fn(|k| 0.5 * (lo[k] + hi[k]));
    match normalisation {
        Normalisation::AsGiven => (1.0, [0.0; 3]),
        Normalisation::Scale { factor } => (factor, [0.0; 3]),
        Normalisation::LongestEdge { length } => (length / longest, [0.0; 3]),
        Normalisation::Centred { length } => (length / longest, centre),
    }
}

fn placed(mesh: &TriMesh, factor: f64, offset: [f64; 3]) -> TriMesh {
    let place = |p: &[f32; 3]| std::array::from_fn(|k| ((f64::from(p[k]) - offset[k]) * factor) as f32);
    TriMesh::new(mesh.positions.iter().map(place).collect(), mesh.faces.clone())
}

fn flat(prediction: &TriMesh) -> Role {
    let volume = bounds(prediction).map_or(0.0, |(lo, hi)| (0..3).map(|k| hi[k] - lo[k]).product::<f64>());
    if volume > 0.0 { Role::Truth } else { Role::Prediction }
}

fn area(mesh: &TriMesh) -> f64 {
    mesh_core::face_areas(&mesh.positions, &mesh.faces).iter().map(|&a| f64::from(a)).sum()
}
