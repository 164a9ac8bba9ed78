//! Planes in which an object is its own mirror image, as a prediction has it and masks allow.
//!
//! What people make mostly has a left and a right side that are alike, and a network that has seen many such objects predicts
//! shapes that nearly have. Then each view is two: what it says of one side holds for the other. A plane is found on the
//! prediction, by the closest points of its mirrored ones (Besl and McKay 1992, with a reflection for the rigid motion), and believed
//! only if the masks allow it: an object that is not its own mirror image shows pixels that its mirrored masks say are empty.

use datasets::View;
use mesh_core::nalgebra::{Matrix3, SymmetricEigen, Vector3};
use mesh_core::{ClosestPoint, TriMesh, sample_points};
use rayon::prelude::*;

use super::lattice::Lattice;
use super::mirror::Mirror;
use super::placement::Placement;
use super::target::Target;

/// Points of the surface that are mirrored.
const SAMPLES: usize = 500;
/// Rounds of closest points, at most.
const ROUNDS: usize = 40;
/// A plane that turns by less in a round, in radians, and moves by less, in radii, is found.
const FOUND: f64 = 1e-4;
/// A plane whose mirrored points are farther from the mesh than this in the mean after so many rounds, in radii, is given up.
const EARLY: usize = 4;
const HOPELESS: f64 = 0.1;
/// Mean distance of mirrored points from the mesh above which a plane is not asked about, in radii.
const NEAR: f64 = 0.05;
/// Points of the lattice along its longest side.
const LONGEST: usize = 64;
/// And the least distance between them, in pixels.
const FINEST: f32 = 1.0;
/// How far the object may reach, in radii.
const ROOM: f64 = 1.4;
/// Share of the masks' pixels that may show nothing more of the hull because of the mirrored masks.
const LOST: f64 = 0.03;

/// Where the search for planes begins.
const STARTS: [[f64; 3]; 9] = [
    [1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, 0.0, 1.0],
    [1.0, 1.0, 0.0],
    [1.0, -1.0, 0.0],
    [1.0, 0.0, 1.0],
    [1.0, 0.0, -1.0],
    [0.0, 1.0, 1.0],
    [0.0, 1.0, -1.0],
];

/// The views as the mirror image of the object would show them, in the plane in which the mesh is most nearly its own; none if the masks do
/// not allow that plane. No other plane is asked for: where an object has but one side, one along it may be allowed, and wrong.
///
/// `targets` are those of the views; those of the mirrored ones are added.
pub(super) fn mirrored(
    mesh: &TriMesh,
    (center, radius): ([f64; 3], f64),
    (seen, targets): (&[&View], &mut Vec<Target>),
    measure: &(dyn Fn(&View) -> Option<Target> + Sync),
) -> Vec<View> {
    let Some(plane) = plane_of(mesh, center.into(), radius) else { return Vec::new() };
    let placement = Placement { center, radius, half_extent: ROOM * radius };
    let count = targets.len();
    let most = lost(targets, count, &placement) + LOST;
    let tried = plane.of_coordinates(radius).into_iter().chain([plane]).map(|plane| {
        let views: Vec<View> = seen.iter().map(|view| plane.view(view)).collect();
        let mut all = targets.clone();
        all.extend(views.iter().filter_map(measure));
        (lost(&mut all, count, &placement), views, all)
    });
    let best = tried.min_by(|a, b| a.0.total_cmp(&b.0));
    match best.filter(|(lost, ..)| *lost <= most) {
        Some((_, views, all)) => {
            *targets = all;
            views
        }
        None => Vec::new(),
    }
}

/// The plane in which a mesh is most nearly its own mirror image, if it is in any.
fn plane_of(mesh: &TriMesh, center: Vector3<f64>, radius: f64) -> Option<Mirror> {
    let surface = ClosestPoint::new(mesh);
    let (points, _) = sample_points(mesh, SAMPLES, 0);
    let points: Vec<Vector3<f64>> =
        points.into_iter().map(|p| Vector3::from(p.map(f64::from))).collect();
    let found: Vec<(f64, Mirror)> = STARTS
        .par_iter()
        .filter_map(|&normal| {
            let normal = Vector3::from(normal).normalize();
            let start = Mirror { normal, offset: normal.dot(&center) };
            aligned(mesh, (&points, &surface), start, radius)
        })
        .collect();
    let best = found.into_iter().min_by(|a, b| a.0.total_cmp(&b.0))?;
    (best.0 <= NEAR * radius).then_some(best.1)
}

/// The plane near another in which the points lie best on the surface when they are mirrored, and their mean distance from it.
fn aligned(
    mesh: &TriMesh,
    (points, surface): (&[Vector3<f64>], &ClosestPoint),
    mut plane: Mirror,
    radius: f64,
) -> Option<(f64, Mirror)> {
    let mut distance = f64::INFINITY;
    for round in 0..ROUNDS {
        let pairs: Option<Vec<(Vector3<f64>, Vector3<f64>)>> = points
            .iter()
            .map(|&p| {
                let mirrored = plane.point(p);
                let closest = surface.find_wide(mirrored.into())?;
                Some((p, Vector3::from(closest.point.position(mesh).map(f64::from))))
            })
            .collect();
        let pairs = pairs?;
        let n = pairs.len() as f64;
        distance = pairs.iter().map(|(p, q)| (plane.point(*p) - q).norm()).sum::<f64>() / n;
        if round == EARLY && distance > HOPELESS * radius {
            return None;
        }
        let before = std::mem::replace(&mut plane, plane_between(&pairs)?);
        let turned = before.normal.cross(&plane.normal).norm();
        let moved = (before.offset.abs() - plane.offset.abs()).abs();
        if turned < FOUND && moved < FOUND * radius {
            break;
        }
    }
    Some((distance, plane))
}

/// The plane that mirrors the first of each pair to the second, in the sense of least squares.
fn plane_between(pairs: &[(Vector3<f64>, Vector3<f64>)]) -> Option<Mirror> {
    let n = pairs.len() as f64;
    let (p, q) = pairs.iter().fold((Vector3::zeros(), Vector3::zeros()), |(p, q), pair| {
        (p + pair.0 / n, q + pair.1 / n)
    });
    let mut sum = -(q - p) * (q - p).transpose() * n;
    for (a, b) in pairs {
        let product: Matrix3<f64> = (a - p) * (b - q).transpose();
        sum += 2.0 * (product + product.transpose());
    }
    let eigen = SymmetricEigen::new(sum);
    let normal: Vector3<f64> = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into();
    let offset = 0.5 * normal.dot(&(p + q));
    (offset.is_finite() && normal.norm() > 0.5).then_some(Mirror { normal, offset })
}

/// Share of the pixels of the first masks that show nothing of the hull of all.
fn lost(targets: &mut [Target], count: usize, placement: &Placement) -> f64 {
    let Some(lattice) = Lattice::of(targets, placement, LONGEST, FINEST) else { return 1.0 };
    let counts: Vec<[usize; 2]> = targets[..count]
        .par_iter()
        .map(|target| {
            let (mut all, mut none) = (0, 0);
            lattice.cast(target, placement, |on_ray| {
                all += 1;
                none += usize::from(on_ray.is_empty());
            });
            [all, none]
        })
        .collect();
    let [all, none] = counts.iter().fold([0, 0], |sum, one| [sum[0] + one[0], sum[1] + one[1]]);
    none as f64 / all.max(1) as f64
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::nalgebra::Rotation3;
    use mesh_core::primitives;
    use synth::{Orbit, RenderOptions, render_views};

    use super::super::distance::Blur;
    use super::*;

    /// A body with a cabin, and a fin on one side or on both; its left is its right at x = 0.
    fn car(fins: &[f32]) -> TriMesh {
        let mut car = primitives::cuboid([0.6, 0.3, 1.2]).colored([0.7, 0.2, 0.2]);
        car.append(
            &primitives::icosphere(2)
                .scaled([0.25, 0.3, 0.4])
                .translated([0.0, 0.15, 0.2])
                .colored([0.2, 0.2, 0.7]),
        )
        .unwrap();
        for &x in fins {
            let fin = primitives::cuboid([0.5, 0.08, 0.3]).colored([0.2, 0.7, 0.2]);
            car.append(&fin.translated([x, 0.0, -0.3])).unwrap();
        }
        car
    }

    fn turned(mesh: TriMesh, turn: &Rotation3<f64>) -> TriMesh {
        mesh.map_positions(|p| {
            let p = turn * Vector3::from(p.map(f64::from));
            [p[0] as f32, p[1] as f32, p[2] as f32]
        })
    }

    #[test]
    fn the_plane_of_a_turned_object_is_found() {
        let turn = Rotation3::from_euler_angles(0.1, 0.3, -0.15);
        let car = turned(car(&[-0.5, 0.5]), &turn);
        let found = plane_of(&car, Vector3::zeros(), 0.75).unwrap();
        let cosine = found.normal.dot(&(turn * Vector3::x())).abs();
        assert!(cosine > 0.99999 && found.offset.abs() < 1e-3, "{cosine} {found:?}");
    }

    /// The guess has a fin on either side. Views from the left and from above show whether the object has.
    #[test]
    fn masks_say_whether_there_is_one() {
        let guess = car(&[-0.5, 0.5]);
        let measure = |view: &View| {
            let blur = Blur { sigma: 1.0, keeps_thin: true };
            Target::new(view, blur, 0.5, 0.5)
        };
        for (fins, expected) in [(&[-0.5, 0.5][..], 5), (&[-0.5], 0)] {
            let orbit =
                Orbit { count: 5, width: 96, height: 96, elevation: [40.0; 2], ..Orbit::default() };
            let views =
                render_views(&car(fins), &orbit.cameras(), &RenderOptions::default(), &|_, _| {})
                    .unwrap();
            let seen: Vec<&View> = views.iter().collect();
            let mut targets: Vec<Target> = seen.iter().filter_map(|view| measure(view)).collect();
            let found = mirrored(&guess, ([0.0; 3], 0.75), (&seen, &mut targets), &measure);
            assert_eq!([found.len(), targets.len()], [expected, 5 + expected]);
        }
    }
}
