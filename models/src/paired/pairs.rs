//! Objects with their images and surfaces.

use std::sync::{Arc, OnceLock};

use datasets::{Dataset, ReadOptions, Subsets, SurfacePoints};
use mesh_core::{TriMesh, sample_points, sample_surface};
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use synth::{Orbit, Placement, Procedural, families_named};
use train::{DataError, DataSummary, Source, Subset};

use super::config::PairsConfig;
use super::frame::{Frame, FrameKind};
use super::input_image::InputImage;
use super::paint::colors_of;
use crate::parts;
use crate::view_cache::ViewCache;

/// Points that are taken from the surface of an object once; each step takes some of them.
const POOL: usize = 10_000;
/// Objects whose content is told by the fingerprint.
const HASHED: usize = 8;

/// A dataset, parted into training, validation and test.
///
/// Images that were prepared are kept within a budget. Surfaces are kept all, each from when it is first asked for, outside of that
/// budget: of an object the points with their normals (240 kB, and 120 kB with colours) and its whole mesh.
#[derive(Debug)]
pub struct Pairs {
    cache: ViewCache<InputImage>,
    surfaces: Vec<OnceLock<Arc<Surface>>>,
    parts: Subsets,
    side: usize,
    scale: f64,
    frame: FrameKind,
    hash: u64,
}

/// A true surface, in the world.
#[derive(Clone, Debug, Default)]
pub struct Surface {
    /// Points spread over it by area, or as the data gives them.
    pub points: SurfacePoints,
    /// sRGB colours of those points, where its mesh has colours; else empty.
    pub colors: Vec<[f32; 3]>,
    /// Its mesh, where the data has one, as the data gives it: with its texture.
    pub mesh: Option<TriMesh>,
}

/// An image and the surface that it shows, in one frame.
#[derive(Clone, Debug)]
pub struct Pair {
    /// What the network sees.
    pub image: Arc<InputImage>,
    /// Points on the surface with their normals.
    pub truth: SurfacePoints,
}

impl Pairs {
    /// Reads what the layout at a path offers, or makes procedural objects.
    ///
    /// # Errors
    /// If files are damaged or there is no surface.
    pub fn open(config: &PairsConfig, source: &Source<'_, ReadOptions>) -> Result<Self, DataError> {
        let data_seed = config.data_seed.or(Some(source.seed));
        let config = &PairsConfig { data_seed, ..config.clone() };
        match source.path {
            None => Self::synthetic(config),
            Some(path) => {
                let dataset = datasets::open_with(path, source.options).map_err(DataError::read)?;
                Self::of(dataset, source.options.clone(), config)
            }
        }
    }

    /// Procedural objects of the configuration's families, seen as 3D-R2N2's renderings see ShapeNet's.
    ///
    /// # Errors
    /// As [`of`](Self::of).
    pub fn synthetic(config: &PairsConfig) -> Result<Self, DataError> {
        Self::of(Self::procedural(config)?, ReadOptions::default(), config)
    }

    /// The dataset of [`synthetic`](Self::synthetic).
    pub(crate) fn procedural(config: &PairsConfig) -> Result<Box<dyn Dataset>, DataError> {
        let families = families_named(&config.families).map_err(DataError::Unfit)?;
        let orbit = Orbit {
            count: config.synthetic_views,
            placement: Placement::Random,
            target: [0.0; 3],
            distance: [0.65, 0.95].map(|ratio| 1.75 * ratio),
            elevation: [25.0, 30.0],
            fov_y: 2.0 * (16.0_f64 / 35.0).atan().to_degrees(),
            width: config.image_size,
            height: config.image_size,
            seed: config.data_seed(),
        };
        Ok(Box::new(Procedural::new(&families, config.counts(), orbit)))
    }

    /// A dataset, parted as [`Subsets::of`] does.
    ///
    /// # Errors
    /// If no object has a view, or the first ones cannot be read or have no surface.
    pub fn of(
        dataset: Box<dyn Dataset>,
        options: ReadOptions,
        config: &PairsConfig,
    ) -> Result<Self, DataError> {
        let cache = ViewCache::new(dataset, options);
        let parts = cache.parts(config.hold_out)?;
        let mut hash = cache.fingerprint();
        let surfaces = cache.entries().iter().map(|_| OnceLock::new()).collect();
        let (side, scale) = (config.image_size, config.scale);
        let frame = FrameKind::Camera;
        let mut pairs = Self { cache, surfaces, parts, side, scale, frame, hash: 0 };
        for &object in pairs.parts.train.iter().take(HASHED) {
            let pair = pairs.pair(object, 0)?;
            let points = pair.truth.positions.as_flattened().iter().flat_map(|x| x.to_le_bytes());
            hash = hash.with(&pair.image.pixels).with(&points.collect::<Vec<u8>>());
        }
        pairs.hash = hash.value();
        Ok(pairs)
    }

    /// The same in another frame than the cameras'. What was prepared of the images is made again.
    #[must_use]
    pub fn with_frame(self, frame: FrameKind) -> Self {
        Self { cache: self.cache.forgetting(), frame, ..self }
    }

    /// Objects that are trained on.
    pub fn trained(&self) -> &[usize] {
        &self.parts.train
    }

    /// Objects that are for this; none where there are none.
    pub fn listed(&self, subset: Subset) -> &[usize] {
        parts::listed(&self.parts, subset)
    }

    pub(crate) fn summary(&self) -> DataSummary {
        parts::summary(&self.parts, "objects")
    }

    /// What the object of an entry is called: category and name, the same for each of its views.
    pub(crate) fn object_name(&self, object: usize) -> String {
        self.cache.entries()[object].object_name()
    }

    /// A number of an object's own, whatever stands beside it.
    pub(crate) fn identity(&self, object: usize) -> u64 {
        self.cache.identity(object)
    }

    /// What an object is called: category and name.
    pub fn name(&self, object: usize) -> [&str; 2] {
        let entry = &self.cache.entries()[object];
        [&entry.category, &entry.name]
    }

    /// Views of an object.
    pub fn views(&self, object: usize) -> usize {
        self.cache.count(object)
    }

    /// See [`Fingerprint`](train::Fingerprint).
    pub(crate) fn fingerprint(&self) -> u64 {
        self.hash
    }

    /// One image of an object and all points of its surface that are kept.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn pair(&self, object: usize, view: usize) -> Result<Pair, DataError> {
        let (image, surface) = (self.image(object, view)?, self.surface(object)?);
        let all: Vec<usize> = (0..surface.points.positions.len()).collect();
        let truth = placed(&image.frame, &surface.points, &all);
        Ok(Pair { image, truth })
    }

    /// A random image of an object and `points` random points of its surface.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn draw(
        &self,
        object: usize,
        points: usize,
        rng: &mut ChaCha8Rng,
    ) -> Result<Pair, DataError> {
        let view = rng.random_range(0..self.views(object));
        let (image, surface) = (self.image(object, view)?, self.surface(object)?);
        let truth = some_of(&image, &surface, points, rng);
        Ok(Pair { image, truth })
    }

    /// How many pairs of a subset are scored, `views` of each object.
    ///
    /// # Errors
    /// If there is nothing for that.
    pub fn trials(&self, subset: Subset, views: usize) -> Result<usize, DataError> {
        Ok(views * parts::wanted(&self.parts, subset)?.len())
    }

    /// The `k`-th of the pairs of a subset that are scored; `views` of each object.
    ///
    /// # Errors
    /// If a file cannot be read, or there is nothing for that.
    pub fn trial(
        &self,
        subset: Subset,
        views: usize,
        k: usize,
    ) -> Result<(usize, Pair), DataError> {
        let [object, view] = self.tried(subset, views, k)?;
        Ok((object, self.pair(object, view)?))
    }

    /// Object and view of the `k`-th of the pairs of a subset that are scored.
    pub(crate) fn tried(
        &self,
        subset: Subset,
        views: usize,
        k: usize,
    ) -> Result<[usize; 2], DataError> {
        let object = parts::wanted(&self.parts, subset)?[k / views];
        let (count, nth) = (self.views(object), k % views);
        // Spread over the views, and begun elsewhere for each object.
        let first = (self.identity(object) % count as u64) as usize;
        Ok([object, (nth * count / views.min(count) + first) % count])
    }

    /// One image of an object.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn image(&self, object: usize, view: usize) -> Result<Arc<InputImage>, DataError> {
        let prepare = |view: &datasets::View| {
            Ok(InputImage::new(view, self.side, self.scale)?.with_frame(self.frame))
        };
        let mut found = self.cache.views(object, &[view], &prepare)?;
        Ok(found.swap_remove(0))
    }

    /// The surface of an object, in the world.
    ///
    /// # Errors
    /// If it cannot be read, or there is none.
    pub fn surface(&self, object: usize) -> Result<Arc<Surface>, DataError> {
        let place = &self.surfaces[object];
        if let Some(surface) = place.get() {
            return Ok(Arc::clone(surface));
        }
        let truth = self.cache.truth(object)?;
        let (points, colors) = match (&truth.mesh, truth.points) {
            (_, Some(points)) if !points.positions.is_empty() => (points, Vec::new()),
            (Some(mesh), _) => {
                let seed = self.identity(object);
                let (positions, normals) = sample_points(mesh, POOL, seed);
                let colors = colors_of(mesh, &sample_surface(mesh, POOL, seed));
                (SurfacePoints { positions, normals }, colors)
            }
            (None, _) => (SurfacePoints::default(), Vec::new()),
        };
        // Of faces without area there are none either.
        if points.positions.is_empty() {
            let [category, name] = self.name(object);
            return Err(DataError::Unfit(format!(
                "{category} {name}: no true surface; this system learns from meshes or points"
            )));
        }
        let surface = Arc::new(Surface { points, colors, mesh: truth.mesh });
        Ok(Arc::clone(place.get_or_init(|| surface)))
    }
}

/// Points of a surface in the frame of an image: distinct ones while there are enough.
fn some_of(
    image: &InputImage,
    surface: &Surface,
    count: usize,
    rng: &mut ChaCha8Rng,
) -> SurfacePoints {
    placed(&image.frame, &surface.points, &some(surface.points.positions.len(), count, rng))
}

/// `count` of `there` places: distinct ones while there are enough.
pub(crate) fn some(there: usize, count: usize, rng: &mut ChaCha8Rng) -> Vec<usize> {
    if count <= there {
        let mut all: Vec<usize> = (0..there).collect();
        all.partial_shuffle(rng, count).0.to_vec()
    } else {
        (0..count).map(|i| if i < there { i } else { rng.random_range(0..there) }).collect()
    }
}

/// Chosen points in a frame, with their normals where all have one.
pub(crate) fn placed(frame: &Frame, points: &SurfacePoints, chosen: &[usize]) -> SurfacePoints {
    let normals = points.normals.len() == points.positions.len();
    SurfacePoints {
        positions: chosen.iter().map(|&i| frame.place(points.positions[i])).collect(),
        normals: if normals {
            chosen.iter().map(|&i| frame.turn(points.normals[i])).collect()
        } else {
            Vec::new()
        },
    }
}

/// As many of these points, drawn by a seed.
pub(crate) fn subset(points: &[[f32; 3]], count: usize, seed: u64) -> Vec<[f32; 3]> {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut all: Vec<usize> = (0..points.len()).collect();
    let (chosen, _) = all.partial_shuffle(&mut rng, count);
    chosen.iter().map(|&i| points[i]).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use datasets::{Catalog, ReadViewsError, Truth, Views};

    use super::*;

    /// Procedural objects whose true meshes are others.
    #[derive(Debug)]
    struct WithMesh(Box<dyn Dataset>, TriMesh);

    impl Dataset for WithMesh {
        fn catalog(&self) -> &Catalog {
            self.0.catalog()
        }

        fn views(
            &self,
            object: usize,
            which: Option<&[usize]>,
            options: &ReadOptions,
            progress: &(dyn Fn(usize, usize) + Sync),
        ) -> Result<Views, ReadViewsError> {
            self.0.views(object, which, options, progress)
        }

        fn truth(&self, _: usize) -> Result<Truth, ReadViewsError> {
            Ok(Truth { mesh: Some(self.1.clone()), ..Truth::default() })
        }
    }

    /// Pixel2Mesh's samples are in its own lengths already; training on them has to stay in those.
    #[test]
    fn points_of_published_samples_are_trained_on_as_they_are_in_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let points = SurfacePoints {
            positions: vec![[0.1, 0.2, -0.8], [0.0, 0.3, -0.7]],
            normals: vec![[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]],
        };
        let mut image = mesh_core::ByteImage::new(28, 28, 3);
        image.data.fill(255);
        image.data[3 * (14 * 28 + 7)..3 * (14 * 28 + 14)].fill(40);
        let sample = datasets::pixel2mesh::Sample { picture: Some(image), points: points.clone() };
        let file = folder.path().join("02691156_a_00.dat");
        datasets::pixel2mesh::write_sample(&file, &sample).unwrap();
        let config = PairsConfig { image_size: 32, ..PairsConfig::default() };
        let options = ReadOptions::default();
        let (path, seed) = (Some(folder.path()), 0);
        let source = Source { path, options: &options, seed, progress: &|_, _| {} };
        let pairs = Pairs::open(&config, &source).unwrap();
        let truth = pairs.pair(0, 0).unwrap().truth;
        for (found, expected) in truth.positions.iter().zip(&points.positions) {
            assert!(
                (0..3).all(|k| (found[k] - expected[k]).abs() < 1e-6),
                "{found:?} {expected:?}"
            );
        }
        assert_eq!(truth.positions.len(), 2);
        assert_eq!(truth.normals, points.normals);
    }

    #[test]
    fn a_mesh_without_area_is_no_surface() {
        let config = PairsConfig {
            image_size: 32,
            objects: 1,
            test_objects: 1,
            synthetic_views: 1,
            families: vec!["airplane".into()],
            ..PairsConfig::default()
        };
        let line = vec![[0.0; 3], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]];
        for faces in [vec![[0, 1, 2]], vec![]] {
            let made = Pairs::procedural(&config).unwrap();
            let dataset = Box::new(WithMesh(made, TriMesh::new(line.clone(), faces)));
            let error = Pairs::of(dataset, ReadOptions::default(), &config).unwrap_err();
            let error = error.to_string();
            assert!(error.contains("airplane") && error.contains("no true surface"), "{error}");
        }
    }
}
