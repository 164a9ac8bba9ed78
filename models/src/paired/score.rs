//! How a predicted mesh compares with the true points, as the papers of Pixel2Mesh measure it.

use datasets::SurfacePoints;
use losses::kernels::assignment::{Assignment, assign, distance};
use losses::metrics::point_distances;
use mesh_core::{TriMesh, sample_points, vertex_normals};

use super::pairs::subset;
use crate::quality::Quality;

/// Points of each surface that the earth mover's distance pairs.
pub const EMD_POINTS: usize = 512;
/// The share of a mesh's faces that may run through another one before it counts as unsound.
pub const CROSSED: f64 = 0.01;
/// Squared distances below which a point counts as found.
const THRESHOLDS: [f64; 2] = [1e-4, 2e-4];

/// Scores in units of the scaled object; whose frame it is makes no difference.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PointScores {
    /// Mean squared distance between predicted **vertices** and true points, both ways added, times 1000.
    pub chamfer: f64,
    /// F-score at a squared distance of 1e-4.
    pub f_score: f64,
    /// F-score at a squared distance of 2e-4.
    pub f_score_double: f64,
    /// Mean distance over the best pairing of [`EMD_POINTS`] surface points, exact, times 100.
    pub earth_mover: f64,
    /// Mean absolute cosine between the normals of nearest points, of both ways.
    pub normals: f64,
    /// What of it runs through itself or is folded over.
    pub quality: Quality,
}

impl PointScores {
    /// With their names, and whether more is better.
    pub fn named(&self) -> [(&'static str, f64, bool); 9] {
        [
            ("chamfer", self.chamfer, false),
            ("f-score", self.f_score, true),
            ("f-score-2", self.f_score_double, true),
            ("emd", self.earth_mover, false),
            ("normals", self.normals, true),
            ("self-intersecting", self.quality.self_intersecting, false),
            ("folded", self.quality.folded, false),
            ("sound", if self.is_sound() { 1.0 } else { 0.0 }, true),
            ("likeness", self.likeness(), true),
        ]
    }

    /// Whether less than [`CROSSED`] of the faces run through another one.
    pub fn is_sound(&self) -> bool {
        self.quality.self_intersecting < CROSSED
    }

    /// From 0 to 1, what an eye would choose by: the fourth root of
    ///
    /// ```text
    /// F(τ) · normals · 1 / max(EMD, 1) · min(1, CROSSED / share of the faces that run through another one)
    /// ```
    ///
    /// Chamfer distance and F-score alone prefer crumpled paper that is near everywhere to a smooth surface of the right shape.
    /// Surfaces without true normals count 1 for them; what is no mesh has 0.
    pub fn likeness(&self) -> f64 {
        let crossing = self.quality.self_intersecting;
        if self.earth_mover.is_nan() || crossing.is_nan() {
            return 0.0;
        }
        let normals = if self.normals.is_nan() { 1.0 } else { self.normals };
        let sound = if crossing < CROSSED { 1.0 } else { CROSSED / crossing };
        (self.f_score * normals * sound / self.earth_mover.max(1.0)).powf(0.25)
    }

    /// The means of several.
    pub fn mean(all: &[Self]) -> Self {
        let mean = |f: fn(&Self) -> f64| all.iter().map(f).sum::<f64>() / all.len().max(1) as f64;
        Self {
            chamfer: mean(|s| s.chamfer),
            f_score: mean(|s| s.f_score),
            f_score_double: mean(|s| s.f_score_double),
            earth_mover: mean(|s| s.earth_mover),
            normals: mean(|s| s.normals),
            quality: Quality {
                self_intersecting: mean(|s| s.quality.self_intersecting),
                folded: mean(|s| s.quality.folded),
            },
        }
    }
}

/// Compares a mesh with true points, both in one frame.
///
/// Pixel2Mesh's protocol compares the predicted **vertices**, not points of the surface between them; the earth
/// mover's distance, which needs as many points on either side, takes points spread over the surface.
///
/// # References
/// Wang et al. 2018, *Pixel2Mesh*, section 4.1, as its code computes it.
pub fn point_scores(mesh: &TriMesh, truth: &SurfacePoints) -> PointScores {
    let normals = || vertex_normals(&mesh.positions, &mesh.faces);
    scores_of(&mesh.positions, &normals, mesh, truth)
}

/// The same with `count` points spread over the mesh in the place of its vertices: for meshes whose vertices are not,
/// such as those that people made.
pub fn surface_scores(mesh: &TriMesh, count: usize, truth: &SurfacePoints) -> PointScores {
    let (positions, normals) = sample_points(mesh, count, 1);
    scores_of(&positions, &|| normals.clone(), mesh, truth)
}

fn scores_of(
    positions: &[[f32; 3]],
    normals: &dyn Fn() -> Vec<[f32; 3]>,
    mesh: &TriMesh,
    truth: &SurfacePoints,
) -> PointScores {
    let quality = Quality::of(mesh);
    // What did not come to its end is no mesh at all, and has no points.
    let finite = !positions.is_empty() && positions.as_flattened().iter().all(|x| x.is_finite());
    if !finite || truth.positions.is_empty() {
        let [chamfer, earth_mover, normals] = [f64::NAN; 3];
        let (f_score, f_score_double) = (0.0, 0.0);
        return PointScores { chamfer, f_score, f_score_double, earth_mover, normals, quality };
    }
    let found = point_distances(positions, &truth.positions);
    let (there, back) = found.chamfer(true);
    let f = |threshold: f64| found.f_score(threshold.sqrt()).f_score;
    let normals = if truth.normals.len() == truth.positions.len() {
        found.normal_consistency(&normals(), &truth.normals)
    } else {
        f64::NAN
    };
    PointScores {
        chamfer: 1e3 * (there + back),
        f_score: f(THRESHOLDS[0]),
        f_score_double: f(THRESHOLDS[1]),
        earth_mover: 1e2 * earth_mover(mesh, truth),
        normals,
        quality,
    }
}

fn earth_mover(mesh: &TriMesh, truth: &SurfacePoints) -> f64 {
    let (own, _) = sample_points(mesh, EMD_POINTS, 0);
    let other = subset(&truth.positions, own.len(), 0);
    let wide = |points: &[[f32; 3]]| -> Vec<[f64; 3]> {
        points.iter().map(|p| p.map(f64::from)).collect()
    };
    let (a, b) = (wide(&own[..other.len().min(own.len())]), wide(&other));
    if a.is_empty() {
        return f64::NAN;
    }
    let pairs = assign(&a, &b, Assignment::Exact);
    pairs.iter().enumerate().map(|(i, &j)| distance(a[i], b[j as usize])).sum::<f64>()
        / a.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesh_core::primitives::icosphere;

    /// A sphere a little too large: all distances are the difference of the radii but for the spacing of the points.
    #[test]
    fn a_larger_ball_is_as_far_as_it_is_larger() {
        let (ball, other) = (icosphere(4).scaled([0.2; 3]), icosphere(5).scaled([0.25; 3]));
        let normals = vertex_normals(&other.positions, &other.faces);
        let truth = SurfacePoints { positions: other.positions.clone(), normals };
        let scores = point_scores(&ball, &truth);
        assert!((scores.chamfer - 2.0 * 2.5).abs() < 0.1, "{scores:?}");
        // Random points of either surface lie beside each other: the pairing pays for that too.
        assert!((5.0..6.5).contains(&scores.earth_mover), "{scores:?}");
        assert!(scores.normals > 0.999 && scores.f_score == 0.0);
        let same = SurfacePoints { positions: ball.positions.clone(), normals: Vec::new() };
        let scores = point_scores(&ball, &same);
        assert_eq!((scores.chamfer, scores.f_score, scores.f_score_double), (0.0, 1.0, 1.0));
        assert!(scores.normals.is_nan());
    }

    /// Rows that were measured: crumpled paper has the better distance and F-score, a smooth airplane the better likeness.
    #[test]
    fn likeness_has_eyes() {
        let scores = |[chamfer, f_score, earth_mover, normals, self_intersecting]: [f64; 5]| {
            let quality = Quality { self_intersecting, folded: 0.0 };
            PointScores { chamfer, f_score, f_score_double: 0.0, earth_mover, normals, quality }
        };
        let crumpled = scores([0.328, 0.546, 4.19, 0.604, 0.9]);
        let smooth = scores([0.414, 0.561, 3.65, 0.672, 0.2]);
        let object = scores([0.174, 0.747, 2.86, 0.778, 0.009]);
        assert!(crumpled.likeness() < 0.8 * smooth.likeness());
        assert!(smooth.likeness() < 0.7 * object.likeness());
        assert!(object.is_sound() && !smooth.is_sound());
        // By hand: what is sound pays nothing for what crosses.
        assert!((object.likeness() - (0.747 * 0.778 / 2.86_f64).powf(0.25)).abs() < 1e-12);
        let perfect = scores([0.0, 1.0, 0.5, f64::NAN, 0.0]);
        assert_eq!(perfect.likeness(), 1.0);
        let none = PointScores { earth_mover: f64::NAN, ..perfect };
        assert_eq!(none.likeness(), 0.0);
    }

    /// A mesh with a place that is none is no sound one, and the mean over several says that there is such a mesh.
    #[test]
    fn what_is_not_finite_is_scored_as_no_mesh() {
        let ball = icosphere(2).scaled([0.2; 3]);
        let normals = vertex_normals(&ball.positions, &ball.faces);
        let truth = SurfacePoints { positions: ball.positions.clone(), normals };
        let mut broken = ball.clone();
        broken.positions[7][1] = f32::NAN;
        let scores = point_scores(&broken, &truth);
        let Quality { self_intersecting, folded } = scores.quality;
        for none in [scores.chamfer, scores.earth_mover, scores.normals, self_intersecting, folded]
        {
            assert!(none.is_nan(), "{scores:?}");
        }
        assert!(!scores.is_sound() && scores.likeness() == 0.0 && scores.f_score == 0.0);
        let mean = PointScores::mean(&[point_scores(&ball, &truth), scores]);
        assert!(mean.quality.self_intersecting.is_nan() && mean.normals.is_nan(), "{mean:?}");
        assert!(!mean.is_sound() && mean.likeness() == 0.0);
        // Without true points nothing is known of the distance, but of the mesh.
        let unknown = point_scores(&ball, &SurfacePoints::default());
        assert!(unknown.chamfer.is_nan() && unknown.quality == Quality::default());
    }

    /// Points spread over a surface say of it what its vertices say where those are spread as well, whatever they are.
    #[test]
    fn a_surface_is_scored_whatever_its_vertices_are() {
        let ball = icosphere(4).scaled([0.2; 3]);
        let normals = vertex_normals(&ball.positions, &ball.faces);
        let truth = SurfacePoints { positions: ball.positions.clone(), normals };
        let spread = surface_scores(&ball, 2562, &truth);
        // Beside each other by half of the spacing, about 0.014.
        assert!(spread.chamfer < 0.2 && spread.normals > 0.99, "{spread:?}");
        let cube = mesh_core::primitives::cuboid([0.2; 3]);
        let (positions, normals) = sample_points(&cube, 5000, 3);
        let truth = SurfacePoints { positions, normals };
        let (few, many) = (point_scores(&cube, &truth), surface_scores(&cube, 2562, &truth));
        assert!(20.0 * many.chamfer < few.chamfer && many.normals > 0.95, "{many:?} {few:?}");
    }
}
