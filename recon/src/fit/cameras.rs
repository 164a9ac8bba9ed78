//! Cameras that are nearly right, moved until the outlines of the mesh agree with the masks.
//!
//! Between the steps of the shape, each view's pose and one focal length that all views share are improved by Gauss-Newton: the
//! residuals are the distances of the mesh's outline to the mask's edge, and what a camera's motion does to such a distance is the
//! motion of that place of the mesh along the outline's normal (the outline's own sliding over the mesh is tangential, so it does
//! not count). The shape follows what the views have in common, the cameras what sets each apart.
//!
//! The world's frame is not in the masks: turning, moving and scaling everything changes no outline. What the cameras moved by in
//! common is therefore taken back, from them and from the mesh alike, so that the mesh stays in the frame of the input.

use mesh_core::nalgebra::{Matrix3, Matrix4, Rotation3, Vector3, Vector4, Vector6};
use mesh_core::{Camera, Lens};
use rayon::prelude::*;

use super::camera_equations::{Equations, Motion};
use super::planes::Planes;
use super::shape::Shape;
use super::target::Target;
use super::unit::unit_near;

/// Gauss-Newton steps of a round.
const ITERATIONS: usize = 2;
/// Gauss-Newton steps of a view whose mesh is finished.
const LOCATING: usize = 10;
/// How strongly the focal length is held where it was given, in the same unit: on bodies like balls and capsules no outline tells it
/// from the distance, and it would drift.
const HELD: f64 = 0.002;
/// Cameras on their way from where they were given.
#[derive(Clone, Debug)]
pub(super) struct Cameras {
    given: Vec<Camera>,
    center: Vector3<f64>,
    radius: f64,
    /// The focal length, times the one given.
    pub(super) focal: f64,
}

impl Cameras {
    /// Those of targets that are placed around `center`.
    pub(super) fn of(targets: &[Target], center: [f64; 3], radius: f64) -> Self {
        let given = targets.iter().map(|target| target.camera().clone()).collect();
        Self { given, center: center.into(), radius, focal: 1.0 }
    }

    /// The cameras from which the mesh, as it is, looks most like the masks of targets; focal lengths stay.
    pub(super) fn locate(&self, shape: &Shape, targets: &[Target]) -> Vec<Camera> {
        let (edge, planes) = (shape.mean_edge(), shape.planes());
        let located = |target: &Target| {
            let mut target = target.clone();
            for _ in 0..LOCATING {
                let Some(equations) = self.equations(shape, &planes, &target, edge) else { break };
                let camera = moved(target.camera(), self.center, equations.step(0.0), 0.0);
                target.set_camera(camera);
                target.place(self.center.into(), self.radius);
            }
            target.camera().clone()
        };
        targets.par_iter().map(located).collect()
    }

    /// Improves the cameras of all targets for the shape as it is.
    pub(super) fn improve(&mut self, shape: &mut Shape, targets: &mut [Target]) {
        let (edge, planes) = (shape.mean_edge(), shape.planes());
        for _ in 0..ITERATIONS {
            let equations: Vec<Option<Equations>> = targets
                .par_iter()
                .map(|target| self.equations(shape, &planes, target, edge))
                .collect();
            let focal = shared_focal(&equations, self.focal.ln());
            self.focal *= focal.exp();
            for (target, equations) in targets.iter_mut().zip(&equations) {
                let step = equations.as_ref().map_or_else(Vector6::zeros, |e| e.step(focal));
                let camera = moved(target.camera(), self.center, step, focal);
                target.set_camera(camera);
                target.place(self.center.into(), self.radius);
            }
        }
        self.fix_gauge(shape, targets);
    }

    fn equations(
        &self,
        shape: &Shape,
        planes: &Planes,
        target: &Target,
        edge: f32,
    ) -> Option<Equations> {
        let stride = target.lines_between_samples(edge);
        let motion = Motion::of(target.camera(), self.center, self.radius);
        let mut residuals = Vec::new();
        shape.borders(
            planes,
            std::slice::from_ref(target),
            |_| stride,
            |_, border| {
                let [a, b] = border.ends.map(|v| shape.positions[v as usize]);
                // Along the edge in space it is not the share in the image, but what is off is along the outline.
                let p = Vector3::from_fn(|k, _| {
                    let q = f64::from(a[k]) + f64::from(border.share) * f64::from(b[k] - a[k]);
                    self.center[k] + self.radius * q
                });
                residuals.push(motion.residual(p - self.center, &border));
            },
        );
        Equations::of(&residuals, motion.units)
    }

    /// Takes back what all cameras moved by in common, from them and from the mesh.
    fn fix_gauge(&self, shape: &mut Shape, targets: &mut [Target]) {
        let (turn, shift, scale) = self.gauge(targets);
        for target in targets.iter_mut() {
            let camera = target.camera();
            let rotation = camera.rotation * turn.transpose();
            let middle = camera.rotation * self.center + camera.translation;
            let scale = if camera.is_perspective() { scale } else { 1.0 };
            let translation = scale * middle - rotation * (self.center + shift);
            let camera = Camera { rotation, translation, ..camera.clone() };
            target.set_camera(camera);
            target.place(self.center.into(), self.radius);
        }
        let positions = shape
            .positions
            .iter()
            .map(|p| {
                let p = turn * Vector3::from(p.map(f64::from)) * scale + shift / self.radius;
                [p.x as f32, p.y as f32, p.z as f32]
            })
            .collect();
        shape.place(positions);
    }

    /// The turn around the object's middle, the shift and the scale of the world that the cameras' motions have in common.
    fn gauge(&self, targets: &[Target]) -> (Matrix3<f64>, Vector3<f64>, f64) {
        let mut turn = Vector3::zeros();
        let (mut normal, mut right) = (Matrix4::<f64>::zeros(), Vector4::<f64>::zeros());
        // What holds the scale is a share of all, which must not depend on the unit of the world.
        let unit = unit_near(self.radius);
        let perspective = targets.iter().all(|target| target.camera().is_perspective());
        for (target, given) in targets.iter().zip(&self.given) {
            let camera = target.camera();
            let back = given.rotation.transpose();
            turn += Rotation3::from_matrix_unchecked(back * camera.rotation).scaled_axis();
            let now = camera.rotation * self.center + camera.translation;
            let before = given.rotation * self.center + given.translation;
            let shift = back * (now - before) / unit;
            let away = (self.center - given.center()) / unit;
            for k in 0..3 {
                // shift = common + scale * away, one equation for each axis of the world.
                let mut row = Vector4::zeros();
                row[k] = 1.0;
                row[3] = if perspective { away[k] } else { 0.0 };
                normal += row * row.transpose();
                right += row * shift[k];
            }
        }
        turn /= targets.len().max(1) as f64;
        let damp = 1e-9 * normal.trace();
        for k in 0..4 {
            normal[(k, k)] += damp;
        }
        let found = normal.cholesky().map_or_else(Vector4::zeros, |c| c.solve(&right));
        let shift = unit * Vector3::new(found[0], found[1], found[2]);
        (*Rotation3::new(turn).matrix(), shift, 1.0 / (1.0 + found[3]))
    }

    /// How far the outlines moved in the images because of the cameras, root mean square in pixels.
    pub(super) fn motion(&self, shape: &Shape, targets: &[Target]) -> f64 {
        let sums: Vec<(f64, usize)> = targets
            .par_iter()
            .zip(&self.given)
            .map(|(target, given)| {
                let mut sum = (0.0, 0);
                for p in shape.positions.iter().step_by(7) {
                    let world: [f64; 3] =
                        std::array::from_fn(|k| self.center[k] + self.radius * f64::from(p[k]));
                    let (now, before) = (target.camera().project(world), given.project(world));
                    sum.0 += (now.column - before.column).powi(2) + (now.row - before.row).powi(2);
                    sum.1 += 1;
                }
                sum
            })
            .collect();
        let (sum, count) = sums.iter().fold((0.0, 0), |(s, n), (t, m)| (s + t, n + m));
        (sum / count.max(1) as f64).sqrt()
    }

    /// Gives the targets back the cameras that they had.
    pub(super) fn give_back(&self, targets: &mut [Target]) {
        for (target, given) in targets.iter_mut().zip(&self.given) {
            target.set_camera(given.clone());
            target.place(self.center.into(), self.radius);
        }
    }
}

/// The step of the logarithm of the focal length that all views share, from where it is: `moved` from the one given.
fn shared_focal(equations: &[Option<Equations>], moved: f64) -> f64 {
    let (mut normal, mut right) = (0.0, 0.0);
    for e in equations.iter().flatten() {
        let eliminated = e.solve(&e.coupling);
        let unit = e.units[3];
        let held = HELD * e.weight * unit * unit;
        normal += (e.focal - e.coupling.dot(&eliminated)) * unit * unit + held;
        right += (e.right_focal - eliminated.dot(&e.right)) * unit - held * moved;
    }
    if normal > 0.0 { (right / normal).clamp(-0.1, 0.1) } else { 0.0 }
}

/// The camera turned about the object's middle and moved, both in its own frame, and with another focal length.
fn moved(camera: &Camera, center: Vector3<f64>, step: Vector6<f64>, focal: f64) -> Camera {
    let middle = camera.rotation * center + camera.translation;
    let turn = *Rotation3::new(Vector3::new(step[0], step[1], step[2])).matrix();
    let rotation = turn * camera.rotation;
    let translation = middle + Vector3::new(step[3], step[4], step[5]) - rotation * center;
    Camera { rotation, translation, lens: longer(camera.lens, focal.exp()), ..camera.clone() }
}

/// The lens with its focal length times a factor; one without a focal length as it is.
pub(super) fn longer(lens: Lens, factor: f64) -> Lens {
    match lens {
        Lens::Perspective { fx, fy, cx, cy } => {
            Lens::Perspective { fx: fx * factor, fy: fy * factor, cx, cy }
        }
        Lens::Orthographic { .. } => lens,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::primitives;
    use synth::{Orbit, Planted, RenderOptions, render_views};

    use super::*;
    use crate::fit::FitConfig;
    use crate::fit::distance::Blur;

    /// A shape without any symmetry, as it is seen, with targets that have spoilt cameras.
    fn spoilt(mistake: Planted) -> (Shape, Vec<Target>) {
        let mut mesh = primitives::icosphere(4);
        for p in &mut mesh.positions {
            let r = 0.8 + 0.3 * (3.0 * p[0] + 1.0).sin() * (2.0 * p[1]).cos() + 0.2 * p[2];
            *p = p.map(|v| v * r);
        }
        let orbit =
            Orbit { count: 8, target: [0.0; 3], width: 128, height: 112, ..Orbit::default() };
        let good =
            render_views(&mesh, &orbit.cameras(), &RenderOptions::default(), &|_, _| {}).unwrap();
        let bad = mistake.plant(good, [0.0; 3], 2);
        let mut targets: Vec<Target> =
            bad.iter().map(|view| Target::new(view, Blur::plain(1.0), 0.3, 0.3).unwrap()).collect();
        for target in &mut targets {
            target.place([0.0; 3], 1.0);
        }
        (Shape::of(mesh.positions, mesh.faces, &FitConfig::default()), targets)
    }

    #[test]
    fn poses_are_found_from_outlines() {
        let (mut shape, mut targets) = spoilt(Planted::Poses(1.0));
        let mut cameras = Cameras::of(&targets, [0.0; 3], 1.0);
        let before = shape.distance(&targets);
        assert!(before > 1.0, "{before}");
        for _ in 0..4 {
            cameras.improve(&mut shape, &mut targets);
        }
        let after = shape.distance(&targets);
        assert!(after < 0.3, "{before} {after}");
        assert!((cameras.focal - 1.0).abs() < 0.01, "{}", cameras.focal);
        cameras.give_back(&mut targets);
        assert!(cameras.motion(&shape, &targets) < 1e-9);
    }

    #[test]
    fn the_focal_length_moves_towards_the_true_one_by_perspective() {
        let (mut shape, mut targets) = spoilt(Planted::Focal(1.03));
        let mut cameras = Cameras::of(&targets, [0.0; 3], 1.0);
        for _ in 0..6 {
            cameras.improve(&mut shape, &mut targets);
        }
        // It is held where it was given, so it comes back in part.
        assert!((0.965..0.999).contains(&cameras.focal), "{}", cameras.focal);
        assert!(shape.distance(&targets) < 0.35, "{}", shape.distance(&targets));
        // Cameras stay as far away as they were; the shape changes by less than the mistake.
        let size = shape.positions.iter().map(|p| p[0]).fold(0.0, f32::max);
        let given =
            spoilt(Planted::Focal(1.03)).0.positions.iter().map(|p| p[0]).fold(0.0, f32::max);
        assert!((size / given - 1.0).abs() < 0.03, "{size} {given}");
    }

    #[test]
    fn what_cameras_have_in_common_does_not_depend_on_the_unit() {
        let gauge = |unit: f64| {
            let (_, mut targets) = spoilt(Planted::Focal(1.0));
            let scaled = |target: &mut Target, by: f64| {
                let camera = target.camera().clone();
                target.set_camera(Camera { translation: by * camera.translation, ..camera });
            };
            for target in &mut targets {
                scaled(target, unit);
            }
            let cameras = Cameras::of(&targets, [0.0; 3], unit);
            for target in &mut targets {
                scaled(target, 1.02);
            }
            let (_, shift, scale) = cameras.gauge(&targets);
            (shift / unit, scale)
        };
        let (shift, scale) = gauge(1.0);
        for unit in [1e-6, 1e6] {
            let (other, also) = gauge(unit);
            assert!((shift - other).norm() < 1e-6 && (scale - also).abs() < 1e-6, "{unit}: {also}");
        }
        assert!((scale - 1.0 / 1.02).abs() < 1e-6, "{scale}");
    }

    #[test]
    fn what_cameras_move_by_in_common_moves_the_mesh_instead() {
        let (mut shape, mut targets) = spoilt(Planted::Focal(1.0));
        let cameras = Cameras::of(&targets, [0.0; 3], 1.0);
        let seen: Vec<_> = targets.iter().map(|t| t.project(shape.positions[5])).collect();
        // The world is turned, moved and scaled for all cameras alike.
        let (turn, shift) = (
            *Rotation3::new(Vector3::new(0.02, 0.03, -0.01)).matrix(),
            Vector3::new(0.03, 0.01, -0.02),
        );
        for target in &mut targets {
            let camera = target.camera().clone();
            let rotation = camera.rotation * turn;
            let translation = 1.02 * (camera.rotation * shift + camera.translation);
            target.set_camera(Camera { rotation, translation, ..camera });
            target.place([0.0; 3], 1.0);
        }
        let moved: Vec<_> = targets.iter().map(|t| t.project(shape.positions[5])).collect();
        cameras.fix_gauge(&mut shape, &mut targets);
        for ((target, moved), seen) in targets.iter().zip(&moved).zip(&seen) {
            // The same is seen, by cameras that are where they were.
            let now = target.project(shape.positions[5]);
            assert!((now[0] - moved[0]).hypot(now[1] - moved[1]) < 0.01, "{now:?} {moved:?}");
            assert!((moved[0] - seen[0]).hypot(moved[1] - seen[1]) > 0.2);
        }
        assert!(cameras.motion(&shape, &targets) < 0.3, "{}", cameras.motion(&shape, &targets));
    }
}
