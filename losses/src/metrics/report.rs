//! Two meshes compared under a protocol.

use mesh_core::bounds::{center, longest_side};
use mesh_core::{MeshError, TriMesh, face_areas, sample_points, vertex_normals};
use serde::Serialize;

use super::bounds::bounds;
use super::{
    Combination, FScore, IouProtocol, McmrAlignment, Normalization, Points, Protocol, mcmr_iou,
    point_distances, voxel_iou,
};

/// The figures of one comparison and the protocol that made them.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[non_exhaustive]
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
    /// The intersection over union of the volumes; none where a mesh is flat and has none.
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
}

/// Compares two meshes as a protocol says.
///
/// A mesh compared with itself gives distance 0, F-score 1 and IoU 1 exactly, since both are sampled with
/// the protocol's seed.
///
/// A mesh all of whose points lie in a plane has no volume: the distances are measured, the IoU is not.
///
/// # Cost
/// Nearest neighbours both ways by a bounding volume hierarchy, about `samples log samples`, and the winding number of the volumes' cells.
///
/// # Errors
/// If a mesh is invalid or has no surface.
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
    let (factor, offset) = placement(truth, protocol.normalization);
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
    let solid = !flat(&prediction) && !flat(&truth);
    report.iou = protocol.iou.filter(|_| solid).and_then(|iou| match iou {
        IouProtocol::CommonBox { resolution } => Some(voxel_iou(&prediction, &truth, resolution)),
        IouProtocol::McmrAligned => McmrAlignment::of(&prediction, &truth)
            .map(|alignment| mcmr_iou(&prediction, &truth, alignment)),
    });
    Ok(report)
}

fn distances(prediction: &TriMesh, truth: &TriMesh, points: Points, report: &mut Report) {
    let protocol = &report.protocol;
    let take = |mesh: &TriMesh| match points {
        Points::Vertices => (mesh.positions.clone(), vertex_normals(&mesh.positions, &mesh.faces)),
        Points::Surface { samples } => sample_points(mesh, samples, protocol.seed),
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
fn placement(truth: &TriMesh, normalization: Normalization) -> (f64, [f64; 3]) {
    let around = bounds(truth).unwrap_or_default();
    let longest = longest_side(around).max(f64::MIN_POSITIVE);
    match normalization {
        Normalization::AsGiven => (1.0, [0.0; 3]),
        Normalization::Scale { factor } => (factor, [0.0; 3]),
        Normalization::LongestEdge { length } => (length / longest, [0.0; 3]),
        Normalization::Centered { length } => (length / longest, center(around)),
    }
}

fn placed(mesh: &TriMesh, factor: f64, offset: [f64; 3]) -> TriMesh {
    let place =
        |p: &[f32; 3]| std::array::from_fn(|k| ((f64::from(p[k]) - offset[k]) * factor) as f32);
    TriMesh::new(mesh.positions.iter().map(place).collect(), mesh.faces.clone())
}

/// Whether all vertices that faces use lie in one plane, within a millionth of the mesh's extent.
fn flat(mesh: &TriMesh) -> bool {
    let used = || mesh.faces.iter().flatten().map(|&v| mesh.positions[v as usize].map(f64::from));
    let Some(first) = used().next() else { return true };
    let minus = |p: [f64; 3], q: [f64; 3]| -> [f64; 3] { std::array::from_fn(|k| p[k] - q[k]) };
    let cross = |a: [f64; 3], b: [f64; 3]| -> [f64; 3] {
        std::array::from_fn(|k| a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3])
    };
    let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| a[k] * b[k]).sum::<f64>();
    let longest = |vectors: &mut dyn Iterator<Item = [f64; 3]>| {
        vectors.max_by(|a, b| dot(*a, *a).total_cmp(&dot(*b, *b))).unwrap_or_default()
    };
    // The farthest point from the first, and the one that is farthest from the line of both, span the plane.
    let reach = longest(&mut used().map(|p| minus(p, first)));
    let normal = longest(&mut used().map(|p| cross(reach, minus(p, first))));
    let length = dot(normal, normal).sqrt();
    let extent = dot(reach, reach).sqrt();
    used().all(|p| dot(normal, minus(p, first)).abs() <= 1e-6 * extent * length)
}

fn area(mesh: &TriMesh) -> f64 {
    face_areas(&mesh.positions, &mesh.faces).iter().map(|&a| f64::from(a)).sum()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::primitives::{cuboid, icosphere, torus, uv_sphere};

    use super::super::Preset;
    use super::*;

    fn scaled(mesh: &TriMesh, s: f32) -> TriMesh {
        TriMesh::new(mesh.positions.iter().map(|p| p.map(|v| s * v)).collect(), mesh.faces.clone())
    }

    #[test]
    fn a_mesh_is_itself_under_every_preset() {
        for mesh in [torus(1.0, 0.3, 16, 8), scaled(&cuboid([40.0, 75.0, 20.0]), 1.0)] {
            for preset in Preset::ALL {
                let mut protocol = preset.protocol(5);
                if let Some(Points::Surface { samples }) = &mut protocol.points {
                    *samples = (*samples).min(3_000);
                }
                let report = evaluate(&mesh, &mesh, &protocol).unwrap();
                assert!(report.chamfer.is_none_or(|d| d == 0.0));
                assert!(report.f_scores.iter().all(|f| f.f_score == 1.0));
                assert!(report.normal_consistency.is_none_or(|n| (n - 1.0).abs() < 1e-6));
                assert!(report.iou.is_none_or(|iou| iou == 1.0));
                assert!(report.chamfer.is_some() || report.iou.is_some());
            }
        }
    }

    #[test]
    fn concentric_spheres_under_mesh_rcnn() {
        // The truth's longest edge is 2, made 10: radius 5 against 5.2, so squared gaps of 0.04 each way.
        let (ball, preset) = (icosphere(5), Preset::MeshRcnn.protocol(1));
        let report = evaluate(&scaled(&ball, 1.04), &ball, &preset).unwrap();
        // The same faces are sampled at the same places, so there is no noise to add.
        assert!((report.chamfer.unwrap() - 0.08).abs() < 1e-4, "{report:?}");
        assert_eq!(report.f_scores[0].f_score, 0.0);
        assert_eq!(report.f_scores[1].f_score, 1.0);
        assert!(report.normal_consistency.unwrap() > 0.999);

        // Other faces, other samples: of n on an area A the nearest is A / (π n) aside, squared and mean.
        let report = evaluate(&scaled(&uv_sphere(120, 240), 1.04), &ball, &preset).unwrap();
        let aside = 2.0 * 100.0 / 10_000.0;
        let chamfer = report.chamfer.unwrap();
        assert!((chamfer - 0.08 - aside).abs() < 0.2 * aside, "{chamfer}");
    }

    #[test]
    fn the_scale_of_the_pair_does_not_matter_where_the_truth_sets_it() {
        let (a, b) = (torus(1.0, 0.3, 16, 8), torus(1.0, 0.35, 16, 8));
        for preset in [Preset::MeshRcnn, Preset::Mcmr] {
            let small = evaluate(&a, &b, &preset.protocol(2)).unwrap();
            let large =
                evaluate(&scaled(&a, 37.5), &scaled(&b, 37.5), &preset.protocol(2)).unwrap();
            if let (Some(x), Some(y)) = (small.chamfer, large.chamfer) {
                assert!((x - y).abs() < 1e-4 * x, "{x} {y}");
            }
            if let (Some(x), Some(y)) = (small.iou, large.iou) {
                assert!((x - y).abs() < 0.01, "{x} {y}");
            }
        }
    }

    #[test]
    fn the_report_states_its_protocol() {
        let ball = icosphere(1);
        let mut protocol = Preset::P2m.protocol(9);
        protocol.points = Some(Points::Vertices);
        let json = serde_json::to_value(evaluate(&ball, &ball, &protocol).unwrap()).unwrap();
        assert_eq!(json["protocol"]["seed"], 9);
        assert_eq!(json["protocol"]["normalization"]["factor"], 0.57);
        assert_eq!(json["protocol"]["points"]["kind"], "vertices");
        assert_eq!(json["protocol"]["squared"], true);
        assert!(json["protocol"]["formula"].as_str().unwrap().contains("d²"));
        assert_eq!(json["chamfer"], 0.0);
        assert_eq!(json["f_scores"][1]["f_score"], 1.0);
        let thresholds = &json["protocol"]["thresholds"];
        assert!((thresholds[1].as_f64().unwrap().powi(2) - 2e-4).abs() < 1e-12);
        // What is always the same is no choice of the protocol.
        let mcmr = evaluate(&ball, &ball, &Preset::Mcmr.protocol(0)).unwrap();
        let json = serde_json::to_value(mcmr).unwrap();
        assert_eq!(json["protocol"]["iou"], serde_json::json!({ "kind": "mcmr_aligned" }));
    }

    #[test]
    fn what_cannot_be_compared_says_why() {
        let ball = icosphere(1);
        let preset = Preset::Mcmr.protocol(0);
        let message = |p: &TriMesh, t: &TriMesh| evaluate(p, t, &preset).unwrap_err().to_string();
        assert!(
            message(&TriMesh::default(), &ball).starts_with("the predicted mesh has no surface")
        );
        let mut broken = ball.clone();
        broken.faces[3][1] = 999;
        assert!(
            message(&ball, &broken).contains("the true mesh is invalid: face 3 names vertex 999")
        );
        broken = ball.clone();
        broken.positions[7][2] = f32::NAN;
        assert!(message(&broken, &ball).contains("vertex 7"));
    }

    #[test]
    fn a_flat_mesh_has_no_iou_and_keeps_its_distances() {
        let ball = icosphere(1);
        // In a plane of a coordinate, and in a plane of none.
        for corner in [[1.0, 0.0, 0.0], [0.6, 0.1, 0.7]] {
            let flat = TriMesh::new(
                vec![[0.3, 0.2, 0.1], corner, [0.0, 1.0, 0.0], [0.1, -1.0, 0.2]],
                vec![[0, 1, 2]],
            );
            for preset in Preset::ALL {
                for (p, t) in [(&flat, &ball), (&ball, &flat), (&flat, &flat)] {
                    let report = evaluate(p, t, &preset.protocol(0)).unwrap();
                    assert_eq!(report.iou, None);
                    assert_eq!(report.chamfer.is_some(), report.protocol.points.is_some());
                }
            }
        }
        let thin = cuboid([1.0, 1.0, 1e-3]);
        assert_eq!(evaluate(&thin, &thin, &Preset::OccNet.protocol(0)).unwrap().iou, Some(1.0));
    }
}
