//! Images with their surfaces, depths and cells.

use std::path::Path;
use std::sync::{Arc, OnceLock};

use datasets::{Dataset, Pix3d, ReadOptions, SurfacePoints};
use mesh_core::{TriMesh, iou};
use rand::RngExt;
use rand_chacha::ChaCha8Rng;
use train::{DataError, Source, Subset};

use super::boxes::Boxes;
use super::config::RefineConfig;
use super::depth_targets::{DepthTargets, Known};
use crate::paired::{InputImage, Pairs, PairsConfig, Surface, placed, some};
use crate::view_cache::Kept;

/// Bytes of targets that are kept at most; what is beyond is made again each time.
const BUDGET: usize = 3 << 30;

/// An image with what is known of what it shows.
#[derive(Clone, Debug)]
pub struct Scene {
    /// What the network sees.
    pub image: Arc<InputImage>,
    /// Depth and cells.
    pub depth_targets: Arc<DepthTargets>,
    /// Points of the true surface in the frame of the camera; empty where nothing is known of it.
    pub truth: SurfacePoints,
    /// Their colours; empty where the data has none.
    pub colors: Vec<[f32; 3]>,
}

/// The data of both systems.
#[derive(Debug)]
pub struct Scenes {
    pairs: Pairs,
    config: RefineConfig,
    cells: usize,
    kept: Kept<DepthTargets>,
    /// The shape that says nothing of the image: the cells that are often occupied in training.
    mean_shape: OnceLock<Vec<bool>>,
}

impl Scenes {
    /// Reads what the layout at a path offers, or makes procedural objects. Pix3D's images are cut to their given boxes.
    /// `cells` along each axis are made of each image's volume; 0 for none.
    ///
    /// # Errors
    /// If files are damaged or there is no true mesh.
    pub fn open(
        config: &RefineConfig,
        cells: usize,
        source: &Source<'_, ReadOptions>,
    ) -> Result<Self, DataError> {
        let options = ReadOptions { depth: true, ..source.options.clone() };
        let data_seed = config.pairs.data_seed.or(Some(source.seed));
        let pairs = PairsConfig { data_seed, ..config.pairs.clone() };
        let config = &RefineConfig { pairs, ..config.clone() };
        let dataset = match source.path {
            None => Pairs::procedural(&config.pairs)?,
            Some(path) => opened(path, &options)?,
        };
        Self::of(dataset, options, config, cells)
    }

    /// Procedural objects of the configuration's families.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn synthetic(config: &RefineConfig, cells: usize) -> Result<Self, DataError> {
        Self::of(Pairs::procedural(&config.pairs)?, ReadOptions::default(), config, cells)
    }

    /// A dataset.
    ///
    /// # Errors
    /// As [`open`](Self::open).
    pub fn of(
        dataset: Box<dyn Dataset>,
        options: ReadOptions,
        config: &RefineConfig,
        cells: usize,
    ) -> Result<Self, DataError> {
        let kept = Kept::new(dataset.entries(), BUDGET);
        let pairs = Pairs::of(dataset, options, &config.pairs)?;
        let (config, mean_shape) = (config.clone(), OnceLock::new());
        let scenes = Self { pairs, config, cells, kept, mean_shape };
        // That there are meshes at all is seen by the first object, whatever it is for.
        if let Some(&first) = Subset::ALL.iter().find_map(|&s| scenes.pairs.listed(s).first()) {
            scenes.mesh(first)?;
        }
        Ok(scenes)
    }

    /// Objects, and what is trained on and scored.
    pub fn pairs(&self) -> &Pairs {
        &self.pairs
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
    ) -> Result<Scene, DataError> {
        let view = rng.random_range(0..self.pairs.views(object));
        let surface = self.pairs.surface(object)?;
        let chosen = some(surface.points.positions.len(), points, rng);
        self.scene([object, view], &surface, &chosen)
    }

    /// The `k`-th of the scenes of a subset that are scored, with all points that are kept; `views` of each object.
    ///
    /// # Errors
    /// If a file cannot be read, or there is nothing for that.
    pub fn trial(
        &self,
        subset: Subset,
        views: usize,
        k: usize,
    ) -> Result<(usize, Scene), DataError> {
        let [object, view] = self.pairs.tried(subset, views, k)?;
        let surface = self.pairs.surface(object)?;
        let all: Vec<usize> = (0..surface.points.positions.len()).collect();
        Ok((object, self.scene([object, view], &surface, &all)?))
    }

    fn scene(
        &self,
        place: [usize; 2],
        surface: &Surface,
        chosen: &[usize],
    ) -> Result<Scene, DataError> {
        let image = self.pairs.image(place[0], place[1])?;
        let depth_targets = self.depth_targets(place, &image)?;
        let truth = placed(&depth_targets.frame, &surface.points, chosen);
        let colored = surface.colors.len() == surface.points.positions.len();
        let colors =
            if colored { chosen.iter().map(|&i| surface.colors[i]).collect() } else { Vec::new() };
        Ok(Scene { image, depth_targets, truth, colors })
    }

    /// The true mesh of an object, in the world.
    ///
    /// # Errors
    /// If there is none.
    pub fn mesh(&self, object: usize) -> Result<Arc<Surface>, DataError> {
        let surface = self.pairs.surface(object)?;
        if surface.mesh.as_ref().is_none_or(|mesh| mesh.faces.is_empty()) {
            let [category, name] = self.pairs.name(object);
            return Err(DataError::Unfit(format!(
                "{category} {name}: no true mesh; depth and cells are made of meshes"
            )));
        }
        Ok(surface)
    }

    fn depth_targets(
        &self,
        place: [usize; 2],
        image: &InputImage,
    ) -> Result<Arc<DepthTargets>, DataError> {
        if let Some(depth_targets) = self.kept.get(place) {
            return Ok(depth_targets);
        }
        let [object, view] = place;
        let surface = self.mesh(object)?;
        let mesh: &TriMesh = surface.mesh.as_ref().expect("an object without a mesh is an error");
        // Of this object and view, whatever stands beside them.
        let object = self.pairs.identity(object) << 20;
        let seed = object ^ view as u64 ^ (self.config.pairs.data_seed() << 44);
        let known = Known::Surface(mesh, seed);
        let depth_targets = Arc::new(DepthTargets::new(image, known, &self.config, self.cells));
        self.kept.keep(place, &depth_targets);
        Ok(depth_targets)
    }

    /// Which cells the mean shape of the training occupies; the threshold is the best of nine on the training itself.
    ///
    /// # Errors
    /// If a file cannot be read.
    pub fn mean_shape(&self) -> Result<&[bool], DataError> {
        if let Some(occupied) = self.mean_shape.get() {
            return Ok(occupied);
        }
        let targets = self.pairs.trained().iter().enumerate().map(|(i, &object)| {
            let view = i % self.pairs.views(object);
            self.depth_targets([object, view], &*self.pairs.image(object, view)?)
        });
        let targets = targets.collect::<Result<Vec<_>, DataError>>()?;
        let mut shares = vec![0.0; self.cells.pow(3)];
        for depth_targets in &targets {
            for (share, &bit) in shares.iter_mut().zip(&depth_targets.cells) {
                *share += f64::from(u8::from(bit)) / targets.len() as f64;
            }
        }
        let at = |tenths: usize| -> Vec<bool> {
            shares.iter().map(|&share| share >= 0.1 * tenths as f64).collect()
        };
        let score = |occupied: &[bool]| -> f64 {
            targets.iter().map(|targets| overlap(occupied, &targets.cells)).sum()
        };
        let best = (1..=9).map(at).max_by(|a, b| score(a).total_cmp(&score(b)));
        Ok(self.mean_shape.get_or_init(|| best.expect("nine thresholds")))
    }
}

/// Intersection over union of cells; 1 where both are empty.
pub(super) fn overlap(a: &[bool], b: &[bool]) -> f64 {
    iou(a.iter().copied().zip(b.iter().copied())).unwrap_or(1.0)
}

fn opened(path: &Path, options: &ReadOptions) -> Result<Box<dyn Dataset>, DataError> {
    let dataset = datasets::open_with(path, options).map_err(DataError::read)?;
    if dataset.layout() == datasets::Layout::Pix3d {
        return Ok(Box::new(Boxes::new(Pix3d::open(path).map_err(DataError::read)?)));
    }
    Ok(dataset)
}
