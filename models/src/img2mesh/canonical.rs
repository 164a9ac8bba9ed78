//! The frame in which objects were learned, found for the views of any other world.
//!
//! A network knows its objects in one frame: upright, so large, in the middle. A user's world has units, an origin and a vertical of
//! its own, and looks at the object from no agreed side. Cameras and masks say where the object is and how large, the tops of
//! the images what is up; from which side it is seen, only the masks can judge, after the mesh is made.

use std::f64::consts::TAU;

use datasets::View;
use mesh_core::nalgebra::{Matrix3, Rotation3, SimilarityMatrix3, Vector3};
use mesh_core::{Camera, TriMesh, UpAxis};
use recon::fit::bounding_sphere;

use crate::predict::Detail;
use crate::square::square;

/// Turns about the vertical that are tried.
const TURNS: usize = 8;
/// Radius of an object's sphere beside that of the widest one that was learned from: of the shipped weights' families from 0.6
/// (airplanes, thin in most views) to 1.
const USUAL: f64 = 0.8;
/// Sizes that are tried beside the usual one, after the turn is found.
const SIZES: [f64; 2] = [0.8, 1.2];
/// How far an object that stands where those learned from did may be from their middle, in radii of the widest.
const BESIDE: f64 = 0.5;
/// How much larger than the widest, or smaller, it may be.
const LARGER: f64 = 1.3;
const SMALLER: f64 = 0.5;
/// What the box of an object is widened by: learned images show objects about so.
const MARGIN: f64 = 1.5;

/// Where an object is: what of all cameras' lines of sight through its masks comes nearest, and how wide it is there.
#[derive(Clone, Copy, Debug)]
struct Sphere {
    center: Vector3<f64>,
    radius: f64,
}

impl Sphere {
    /// `None` where no view shows the object. Of a single view, or of some along one line, the distance is open: the object is
    /// then as near to the world's origin as its line of sight comes, or one unit away if the camera stands there.
    fn of(views: &[View]) -> Option<Self> {
        let all: Vec<&View> = views.iter().collect();
        if let Ok((center, radius)) = bounding_sphere(&all) {
            return Some(Self { center: center.into(), radius });
        }
        views.iter().find_map(|view| {
            let [top, left, rows, columns] = view.mask_bounds()?.map(|n| n as f64);
            let (column, row) = (left + columns / 2.0, top + rows / 2.0);
            let origin = view.camera.project([0.0; 3]).depth;
            let depth = if origin > 0.0 { origin } else { 1.0 };
            let at = |column, row| Vector3::from(view.camera.unproject(column, row, depth));
            let center = at(column, row);
            let radius = (at(left, top) - center).norm();
            (radius.is_finite() && radius > 0.0).then_some(Self { center, radius })
        })
    }
}

/// The frame of a model: the middle and the radius of the widest object that it learned from, upright along +Y.
#[derive(Clone, Copy, Debug)]
pub(super) struct Canonical {
    sphere: Sphere,
}

/// How another world is moved into the frame of a model.
#[derive(Clone, Copy, Debug)]
pub(super) struct Placed {
    /// From the world to the frame.
    similarity: SimilarityMatrix3<f64>,
    up: UpAxis,
    /// By how much the world, upright, was turned about the vertical, radians.
    turn: f64,
}

/// What a network makes of an object through one way into its frame.
#[derive(Clone, Debug)]
pub(super) struct Tried {
    pub(super) placed: Placed,
    /// The mesh in the frame of the model.
    pub(super) mesh: TriMesh,
    /// Its IoU with the masks that it is made from.
    pub(super) likeness: f64,
}

impl Canonical {
    /// From centre and scale.
    pub(super) fn new([x, y, z, radius]: [f64; 4]) -> Self {
        Self { sphere: Sphere { center: Vector3::new(x, y, z), radius } }
    }

    /// Whether an object stands and is as large as those that were learned from, as far as views say.
    pub(super) fn holds(&self, views: &[View]) -> bool {
        let Some(found) = Sphere::of(views) else { return true };
        let beside = (found.center - self.sphere.center).norm() / self.sphere.radius;
        let larger = found.radius / self.sphere.radius;
        let upright = UpAxis::of_cameras(views.iter().map(|view| &view.camera)) == UpAxis::Y;
        beside <= BESIDE && (SMALLER..=LARGER).contains(&larger) && upright
    }

    /// Of another three sides, each a quarter's turn from the last, the one of which `judged` thinks the most, where the world is this
    /// frame but for that.
    pub(super) fn best_side(&self, judged: impl Fn(&Placed) -> (TriMesh, f64)) -> Tried {
        let side = |quarters: f64| {
            let turn = quarters * 0.25 * TAU;
            let rotation = Rotation3::from_axis_angle(&Vector3::y_axis(), turn);
            let shift = self.sphere.center - rotation * self.sphere.center;
            let similarity = SimilarityMatrix3::from_parts(shift.into(), rotation, 1.0);
            tried(Placed { similarity, up: UpAxis::Y, turn }, &judged)
        };
        better(better(side(1.0), side(2.0)), side(3.0))
    }

    /// The way into this frame of which `judged` thinks the most: each side may be the front, and then the object a little
    /// smaller or larger. Nothing where no view shows it.
    pub(super) fn best(
        &self,
        views: &[View],
        judged: impl Fn(&Placed) -> (TriMesh, f64),
    ) -> Option<Tried> {
        let found = Sphere::of(views)?;
        let up = UpAxis::of_cameras(views.iter().map(|view| &view.camera));
        let one = |turn: f64, size: f64| tried(self.placed(found, (up, turn), size), &judged);
        let mut best = one(0.0, 1.0);
        for k in 1..TURNS {
            best = better(best, one(k as f64 / TURNS as f64 * TAU, 1.0));
        }
        let turn = best.placed.turn;
        for size in SIZES {
            best = better(best, one(turn, size));
        }
        Some(best)
    }

    /// A sphere brought to the middle, upright, turned, and to a size beside the usual one.
    fn placed(&self, found: Sphere, (up, turn): (UpAxis, f64), size: f64) -> Placed {
        let scale = size * USUAL * self.sphere.radius / found.radius;
        let rotation = Rotation3::from_axis_angle(&Vector3::y_axis(), turn)
            * Rotation3::from_matrix_unchecked(upright(up));
        // p -> s R (p - c) + c'
        let shift = self.sphere.center - scale * (rotation * found.center);
        let similarity = SimilarityMatrix3::from_parts(shift.into(), rotation, scale);
        Placed { similarity, up, turn }
    }
}

impl Placed {
    /// A camera of the world in the frame.
    pub(super) fn camera(&self, camera: &Camera) -> Camera {
        camera.transformed(&self.similarity)
    }

    /// What was done, in words.
    pub(super) fn remark(&self) -> String {
        format!(
            "these weights know objects in another frame than that of the cameras: the cameras were moved into it (scaled by \
             {:.3}, {} up, turned by {:.0} degrees, as fits the masks best), and the mesh was moved back",
            self.similarity.scaling(),
            self.up,
            self.turn.to_degrees(),
        )
    }

    /// The same as numbers with names.
    pub(super) fn details(&self) -> Vec<Detail> {
        let matrix = self.similarity.to_homogeneous();
        let rows = (0..3).flat_map(|i| (0..4).map(move |j| (i, j)));
        vec![
            ("world to model's frame, rows of [A | t]", rows.map(|at| matrix[at]).collect()),
            ("of this the turn about the vertical, degrees", vec![self.turn.to_degrees()]),
        ]
    }

    /// A mesh of the frame in the world of the user's cameras.
    pub(super) fn back(&self, mesh: TriMesh) -> TriMesh {
        let matrix = self.similarity.inverse().to_homogeneous();
        mesh.transformed(&std::array::from_fn(|i| std::array::from_fn(|j| matrix[(i, j)])))
    }
}

fn tried(placed: Placed, judged: &impl Fn(&Placed) -> (TriMesh, f64)) -> Tried {
    let (mesh, likeness) = judged(&placed);
    Tried { placed, mesh, likeness }
}

/// That which is more like the masks; of equals the first.
fn better(a: Tried, b: Tried) -> Tried {
    if b.likeness > a.likeness { b } else { a }
}

/// The rotation that makes an axis +Y.
fn upright(up: UpAxis) -> Matrix3<f64> {
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let columns = axes.map(|axis| Vector3::from(up.upright(axis).map(f64::from)));
    Matrix3::from_columns(&columns)
}

/// The square part of a view that shows the object as large as learned images do.
pub(super) fn around_the_object(view: &View) -> View {
    let view = view.clone();
    match view.mask_bounds() {
        Some([top, left, rows, columns]) => {
            let bounds = [left, top, left + columns, top + rows].map(|n| n as f64);
            square(view, bounds, MARGIN)
        }
        None => view,
    }
}
