//! One object of a dataset: its mesh, its cameras, its images.

use std::borrow::Cow;

use datasets::{Subset, SurfacePoints};
use diff_raster::FacesError;
use mesh_core::nalgebra::{Rotation3, Vector3};
use mesh_core::vector::widen;
use mesh_core::{Camera, Image, Lens, TriMesh, bounds, sample_points};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};

use super::config::{CameraSet, GenerateConfig, OutputLayout};
use super::model::Model;
use super::visible::visible_points;
use crate::shapes::Family;
use crate::{Orbit, R2n2Cameras, Rendering, render};

/// Vertical angle of view of cameras that are not 3D-R2N2's, degrees.
const FOV: f64 = 40.0;

/// What is known of an object before anything is made; the manifest of its folder.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectInfo {
    /// What kind of thing it is: the family's name, the model's, or that of its subfolder.
    pub category: String,
    /// ShapeNet's synset of that kind.
    pub synset: String,
    /// Its name within its kind.
    pub name: String,
    /// What it was drawn from; `Family::draw` gives it again.
    pub seed: u64,
    /// What its cameras and the like were drawn from.
    pub view_seed: u64,
    /// Its views.
    pub views: usize,
    /// Vertices of its mesh.
    pub vertices: usize,
    /// Faces of its mesh.
    pub faces: usize,
    /// What was drawn, in words.
    pub traits: Vec<(String, String)>,
}

/// One object to be made.
#[derive(Clone, Debug)]
pub(super) struct Job<'a> {
    pub(super) of: Kind<'a>,
    pub(super) name: String,
    pub(super) seed: u64,
    pub(super) view_seed: u64,
}

/// What an object is.
#[derive(Clone, Copy, Debug)]
pub(super) enum Kind<'a> {
    Family(Family),
    Model(&'a Model),
}

/// An object in memory, ready to be written.
pub(super) struct Made<'a> {
    pub(super) info: ObjectInfo,
    pub(super) mesh: Cow<'a, TriMesh>,
    /// Points of its surface, where the layout has a place for them.
    pub(super) points: Option<SurfacePoints>,
    pub(super) renderings: Vec<Rendering>,
    /// Guesses of depth, one a view, where they were asked for.
    pub(super) monocular: Vec<Image>,
    /// Poses as they are known, one a view, in photo collections.
    pub(super) rough: Vec<Camera>,
}

/// All objects of a dataset, in their order.
pub(super) fn jobs<'a>(config: &GenerateConfig, models: &'a [Model]) -> Vec<Job<'a>> {
    let kinds: Vec<(Kind<'a>, usize)> = if models.is_empty() {
        config.families.iter().map(|&f| (Kind::Family(f), config.objects)).collect()
    } else {
        models.iter().map(|model| (Kind::Model(model), 1)).collect()
    };
    kinds
        .into_iter()
        .flat_map(|(of, count)| {
            (0..count).map(move |i| {
                // A stream for each object: more objects, or other families, move none.
                let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
                rng.set_stream(i as u64 + of.stream());
                // 32 bits each, which every reader of JSON takes as they are.
                let [seed, view_seed] = [(); 2].map(|()| u64::from(rng.random::<u32>()));
                Job { name: of.name(i), of, seed, view_seed }
            })
        })
        .collect()
}

impl Kind<'_> {
    pub(super) fn category(&self) -> &str {
        match self {
            Self::Family(family) => family.name(),
            Self::Model(model) => &model.category,
        }
    }

    /// What the `i`-th object is called.
    fn name(&self, i: usize) -> String {
        match self {
            Self::Family(_) => format!("{i:04}"),
            Self::Model(model) => model.name.clone(),
        }
    }

    /// What the object is for, where that is not drawn.
    pub(super) fn subset(&self) -> Option<Subset> {
        match self {
            Self::Family(_) => None,
            Self::Model(model) => model.subset,
        }
    }

    /// ShapeNet's synset; for what it does not know, another number.
    pub(super) fn synset(&self) -> &str {
        match self {
            Self::Family(family) => family.synset(),
            Self::Model(model) => &model.synset,
        }
    }

    fn stream(&self) -> u64 {
        match self {
            Self::Family(family) => (*family as u64) << 32,
            Self::Model(model) => ((Family::ALL.len() as u64) << 32) + u64::from(model.stream),
        }
    }
}

impl<'a> Job<'a> {
    /// The mesh, and what was drawn for it in words.
    pub(super) fn mesh(&self) -> (Cow<'a, TriMesh>, Vec<(String, String)>) {
        match self.of {
            Kind::Family(family) => {
                let shape = family.draw(self.seed);
                let mesh = shape.mesh();
                let traits = shape.traits.into_iter().map(|(name, v)| (name.to_owned(), v));
                (Cow::Owned(mesh), traits.collect())
            }
            Kind::Model(model) => (Cow::Borrowed(&model.mesh), Vec::new()),
        }
    }

    /// Draws everything.
    pub(super) fn make(
        &self,
        config: &GenerateConfig,
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Made<'a>, FacesError> {
        let (mesh, traits) = self.mesh();
        let (cameras, rough) = cameras(config, &mesh, self.view_seed);
        let renderings = render(&mesh, &cameras, &config.render_options(), progress)?;
        let floor = mesh.bounds().map(|(low, _)| low[1]);
        let monocular = config.monocular.iter().flat_map(|guesser| {
            renderings.iter().enumerate().map(move |(i, rendering)| {
                let seed = self.view_seed ^ ((i as u64 + 1) << 32);
                let guess = guesser.guess(&rendering.view, floor, seed);
                guess.expect("depth is drawn where it is guessed").image
            })
        });
        let info = ObjectInfo {
            category: self.of.category().to_owned(),
            synset: self.of.synset().to_owned(),
            name: self.name.clone(),
            seed: self.seed,
            view_seed: self.view_seed,
            views: renderings.len(),
            vertices: mesh.positions.len(),
            faces: mesh.faces.len(),
            traits,
        };
        let points = self.points(config, &mesh)?;
        Ok(Made { info, monocular: monocular.collect(), mesh, points, renderings, rough })
    }
}

impl Job<'_> {
    /// Points of the surface, where the layout has a place for them: of what others have made, those that are seen from
    /// outside.
    fn points(
        &self,
        config: &GenerateConfig,
        mesh: &TriMesh,
    ) -> Result<Option<SurfacePoints>, FacesError> {
        if config.layout != OutputLayout::R2n2 || config.points == 0 {
            return Ok(None);
        }
        Ok(Some(match self.of {
            Kind::Family(_) => {
                let (positions, normals) = sample_points(mesh, config.points, self.view_seed);
                SurfacePoints { positions, normals }
            }
            Kind::Model(_) => visible_points(mesh, config.points, self.view_seed)?,
        }))
    }
}

/// The true cameras, and rough ones in photo collections.
fn cameras(config: &GenerateConfig, mesh: &TriMesh, seed: u64) -> (Vec<Camera>, Vec<Camera>) {
    let (width, height, count) = (config.width, config.height, config.views);
    let around = mesh.bounds().unwrap_or_default();
    let (middle, diagonal) = (widen(bounds::center(around)), bounds::diagonal::<f64>(around));
    let diagonal = if diagonal > 0.0 { diagonal } else { 1.0 };
    let fov_y = fov_y(config);
    let near = nearest(config, fov_y) * diagonal;
    let mut cameras = match config.cameras {
        CameraSet::R2n2 => {
            R2n2Cameras { count, width, height, seed, ..R2n2Cameras::default() }.cameras()
        }
        CameraSet::Sphere => {
            let (target, distance) = (middle, [near, 1.25 * near]);
            let set = Orbit { count, target, distance, width, height, seed, ..Orbit::default() };
            turned(Orbit { fov_y: fov_y.to_degrees(), ..set }.cameras(), middle, seed)
        }
        CameraSet::Collection => {
            let (distance, fov_y) = ([near, 1.4 * near], fov_y.to_degrees());
            Orbit { count, distance, fov_y, width, height, seed, ..Orbit::photos() }.cameras()
        }
    };
    let collection = config.cameras == CameraSet::Collection;
    let known = cameras.iter().zip(0..).filter(|_| collection);
    let mut rough: Vec<Camera> = known.map(|(c, i)| config.noise.drawn(c, seed, i)).collect();
    for camera in cameras.iter_mut().chain(&mut rough) {
        if collection {
            // Its cameras are around the origin.
            camera.translation -= camera.rotation * Vector3::from(middle);
        }
        if let Lens::Perspective { cx, cy, .. } = &mut camera.lens {
            *cx += config.principal[0] * width as f64;
            *cy += config.principal[1] * height as f64;
        }
    }
    (cameras, rough)
}

/// All cameras turned about the vertical through a point, by an angle of its own for every object:
/// a spiral alone would look at all of them from the same sides.
fn turned(mut cameras: Vec<Camera>, around: [f64; 3], seed: u64) -> Vec<Camera> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    // The streams below belong to the cameras.
    rng.set_stream(u64::MAX);
    let angle = std::f64::consts::TAU * rng.random::<f64>();
    let turn = Rotation3::from_axis_angle(&Vector3::y_axis(), angle);
    let around = Vector3::from(around);
    for camera in &mut cameras {
        let moved = camera.rotation * (around - turn * around);
        camera.translation += moved;
        camera.rotation *= turn.matrix();
    }
    cameras
}

/// Vertical angle of view in radians; the layout of 3D-R2N2 knows only its own lens.
fn fov_y(config: &GenerateConfig) -> f64 {
    if config.layout == OutputLayout::R2n2 {
        2.0 * (16.0 / 35.0 * config.height as f64 / config.width as f64).atan()
    } else {
        FOV.to_radians()
    }
}

/// How near a camera may be to an object whose box has diagonal 1, so that all of it is in view.
fn nearest(config: &GenerateConfig, fov_y: f64) -> f64 {
    let [x, y] = config.principal.map(|shift| 1.0 - 2.0 * shift.abs());
    let tall = (0.5 * fov_y).tan();
    let wide = tall * config.width as f64 / config.height as f64;
    // The cone that touches the nearest border holds the sphere around the box.
    1.02 * 0.5 / (tall * y).min(wide * x).atan().sin()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whatever the shape of the image, every vertex is in it.
    #[test]
    fn objects_are_in_view() {
        let mesh = Family::Chair.draw(3).mesh().scaled([3.0; 3]).translated([1.0, -2.0, 0.5]);
        for cameras_of in [CameraSet::Sphere, CameraSet::Collection] {
            for (layout, principal) in [
                (OutputLayout::Kaolin, [0.0; 2]),
                (OutputLayout::R2n2, [0.0; 2]),
                (OutputLayout::Transforms, [0.2, -0.1]),
            ] {
                for (width, height) in [(64, 64), (96, 40), (40, 96)] {
                    let config = GenerateConfig {
                        cameras: cameras_of,
                        layout,
                        principal,
                        width,
                        height,
                        ..GenerateConfig::default()
                    };
                    let (cameras, rough) = cameras(&config, &mesh, 5);
                    assert_eq!(cameras.len(), 24);
                    assert_eq!(rough.is_empty(), cameras_of != CameraSet::Collection);
                    for (camera, p) in
                        cameras.iter().flat_map(|c| mesh.positions.iter().map(move |p| (c, p)))
                    {
                        let seen = camera.project(p.map(f64::from));
                        assert!(seen.depth > 0.0);
                        assert!((0.0..=width as f64).contains(&seen.column), "{config:?}");
                        assert!((0.0..=height as f64).contains(&seen.row), "{config:?}");
                    }
                }
            }
        }
    }

    /// Each object is seen from sides of its own, and still from all around.
    #[test]
    fn spheres_of_cameras_are_turned() {
        let mesh = Family::Table.draw(1).mesh();
        let config = GenerateConfig { cameras: CameraSet::Sphere, ..GenerateConfig::default() };
        let centers = |seed| -> Vec<[f64; 3]> {
            let (cameras, _) = cameras(&config, &mesh, seed);
            assert!(cameras.iter().all(|camera| camera.validate().is_ok()));
            cameras.iter().map(|camera| camera.center().into()).collect()
        };
        let (one, other) = (centers(1), centers(2));
        let azimuth = |c: &[f64; 3]| c[0].atan2(c[2]);
        assert!((azimuth(&one[12]) - azimuth(&other[12])).abs() > 0.01);
        for quadrant in [[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]] {
            let seen = one.iter().filter(|c| c[0] * quadrant[0] > 0.0 && c[2] * quadrant[1] > 0.0);
            assert!(seen.count() >= 4);
        }
        let share = |c: &[f64; 3]| c[1] / c.iter().map(|x| x * x).sum::<f64>().sqrt();
        assert!(share(&one[0]) > 0.9 && share(&one[23]) < -0.9);
    }

    #[test]
    fn more_objects_and_other_families_move_none() {
        let few = GenerateConfig { objects: 2, ..GenerateConfig::default() };
        let many = GenerateConfig {
            families: vec![Family::Lamp, Family::Car],
            objects: 5,
            ..GenerateConfig::default()
        };
        let seed_of = |config: &GenerateConfig, name: &str| {
            let jobs = jobs(config, &[]);
            let of = |job: &&Job<'_>| job.of.category() == "car" && job.name == name;
            jobs.iter().find(of).map(|job| (job.seed, job.view_seed))
        };
        assert_eq!(seed_of(&few, "0001"), seed_of(&many, "0001"));
        assert_ne!(seed_of(&few, "0000"), seed_of(&few, "0001"));
        assert!(seed_of(&few, "0001").is_some());
    }
}
