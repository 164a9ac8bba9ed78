//! `fit`: one object from its images, by optimising one mesh until its images agree.
//!
//! A sphere is placed where the masks allow an object ([`Placement`]), and moved by small steps
//! until its outline in every view lies on the edge of that view's mask: coarse first, then with
//! each face in four. Where the object is too slender for that, or masks show holes through it, the start is the
//! surface of the visual hull instead, with its holes (the private module `solid` says which are
//! real). Colours are then the ones that best explain all images at once.
//!
//! What keeps the surface whole: steps are preconditioned by `(I + lambda L)^-1`, so that a pull
//! on one vertex moves its neighbourhood; a weak bending energy; vertices that slide along the
//! surface to keep the triangles even; and a last pass that mends any place where the surface still
//! passes through itself. What makes it fair: where no outline touches, normals are evened out at the end, up to
//! creases (the private module `flatten`).
//!
//! The outline of a closed mesh is found without drawing it (the private module `outline` says
//! how), at sub-pixel level and in time that follows its length rather than the image's size.
//! That is why a step can afford all views, and why there is no noise to average away.
//!
//! ```
//! use datasets::Views;
//! use mesh_core::primitives;
//! use recon::fit::{FitConfig, fit};
//! use recon::progress::Watch;
//! use synth::{Orbit, RenderOptions, render_views};
//!
//! // Twelve images of a red ellipsoid.
//! let object = primitives::icosphere(3).scaled([1.0, 0.6, 0.8]).colored([0.8, 0.1, 0.1]);
//! let cameras = Orbit { count: 12, width: 48, height: 48, ..Orbit::default() }.cameras();
//! let views = render_views(&object, &cameras, &RenderOptions::default(), &|_, _| {})?;
//! let views = Views::in_memory(views);
//!
//! let config = FitConfig { start_level: 2, level: 3, steps: 60, ..FitConfig::default() };
//! let fitted = fit(&views, &config, &mut Watch::default())?;
//! assert!(fitted.health.is_watertight());
//! assert!(fitted.evaluations.last().unwrap().1 > 0.9); // mask IoU on the views held out
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Cost
//! A step over 80 views of 256x256 at 10,242 vertices takes some 10 ms on two cores. Memory is the
//! views, two bytes for each pixel around the object, and some hundred bytes per vertex and four views.
//!
//! # References
//! Nicolet, Jacobson and Jakob 2021, *Large Steps in Inverse Rendering of Geometry*.

mod alignment;
mod camera_equations;
mod cameras;
mod config;
mod contour;
mod correlation;
mod crossing;
mod distance;
mod error;
mod fairing;
mod flatten;
mod grading;
mod gray_image;
mod hull;
mod inflation;
mod kuhn;
mod lattice;
mod mirror;
mod optimizer;
mod order;
mod outline;
mod photometric;
mod placement;
mod planes;
mod prior;
mod quality;
mod refine;
mod samples;
mod selection;
mod settle;
mod shape;
mod skin;
mod solid;
mod solidify;
mod sparse_views;
mod specks;
mod start;
mod stepper;
mod stereo;
mod symmetry;
pub(crate) mod target;
mod unit;

use std::time::Instant;

use datasets::{View, Views};
use mesh_core::{Health, TriMesh, untangle};
use train::Metric;
use train::progress::{Ended, Event, Facts, Step, Watch};

use crate::bake::color;
use crate::bake::exposure::{self, Exposure};
use crate::bake::sight::Photographed;
use crate::bake::texture;

pub use alignment::RefinedCameras;
pub use config::{ColorKind, FitConfig, MARGIN, TopologyKind};
pub use error::FitError;
pub use photometric::PhotoConsistency;
use photometric::Photographs;
pub use placement::{Placement, bounding_sphere};
pub use quality::{Quality, unused_detail};
pub use refine::{RefineConfig, refine};
pub use solidify::solidify;
pub use stepper::Stepper;

use alignment::{Alignment, Given};
use order::Order;
use selection::Selection;
use shape::Shape;
use start::Start;
use target::Target;

/// Steps between two scores of the held-out views.
const EVALUATE_EVERY: usize = 50;
/// Steps over which a level's progress is judged.
const WINDOW: usize = 20;

/// What a fit found.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// The mesh in the world coordinates of the input: closed, oriented outwards, with the holes of the start.
    pub mesh: TriMesh,
    /// The examination of the mesh.
    pub health: Health,
    /// Pairs of its faces that run through each other.
    pub self_intersections: usize,
    /// Where it started.
    pub placement: Placement,
    /// The losses of every step.
    pub history: Vec<Step>,
    /// Mean mask IoU on the held-out views (all views where none is held out) after so many steps.
    pub evaluations: Vec<(usize, f64)>,
    /// Indices of the views that the mesh was fitted to.
    pub train_views: Vec<usize>,
    /// Indices of the views that were held out.
    pub held_out_views: Vec<usize>,
    /// The cameras that the mesh agrees with, where they are not those of the views: see
    /// [`FitConfig::refine_cameras`].
    pub cameras: Option<RefinedCameras>,
    /// How bright each of the [training views](Self::train_views) is beside the surface's colours, red, green, blue in sRGB,
    /// where photographs differ in exposure or white balance; their geometric mean is 1.
    pub exposures: Option<Vec<[f32; 3]>>,
    /// Whether the surface was moved to where photographs agree, where [`FitConfig::photometric`] asks for it.
    pub photo_consistency: Option<PhotoConsistency>,
    /// Seconds that each stage took, by name.
    pub seconds: Vec<(String, f64)>,
    /// What each [`Event::Warned`] said.
    pub warnings: Vec<String>,
    /// Whether it came to its end.
    pub ended: Ended,
}

impl Fitted {
    /// Nothing found yet.
    fn begun(placement: Placement, train_views: Vec<usize>, held_out_views: Vec<usize>) -> Self {
        Self {
            mesh: TriMesh::default(),
            health: TriMesh::default().health(),
            self_intersections: 0,
            placement,
            history: Vec::new(),
            evaluations: Vec::new(),
            train_views,
            held_out_views,
            cameras: None,
            exposures: None,
            photo_consistency: None,
            seconds: Vec::new(),
            warnings: Vec::new(),
            ended: Ended::Completed,
        }
    }

    /// Least and greatest of [`exposures`](Self::exposures).
    pub fn exposure_range(&self) -> Option<[f32; 2]> {
        exposure::range(self.exposures.as_deref())
    }
}

/// Fits a mesh to views of one object.
///
/// `watch` hears of every step. Once it is [cancelled](train::progress::Cancel), no further step is taken; what there is then is
/// finished and returned, and says so. The result depends on the views and the configuration alone, not on the number of threads.
///
/// # Errors
/// See [`FitError`]. Views with an empty mask are left out with a warning.
pub fn fit(views: &Views, config: &FitConfig, watch: &mut Watch<'_>) -> Result<Fitted, FitError> {
    let problems = config.check();
    if !problems.is_empty() {
        return Err(FitError::Config(problems));
    }
    let mut run = Run::prepare(views, config, watch)?;
    let shape = run.shape(config, &views.views)?;
    Ok(run.finish(shape, config, &views.views))
}

/// A fit under way.
struct Run<'a, 'o> {
    watch: &'a mut Watch<'o>,
    train: Vec<Target>,
    held_out: Vec<Target>,
    start: Option<Start>,
    /// The cameras as they were given, until they are refined; none where they are exact.
    given: Option<Given>,
    alignment: Option<Alignment>,
    /// The most steps, as far as is known by now.
    total: usize,
    fitted: Fitted,
    begun: Instant,
    clock: Instant,
}

impl<'a, 'o> Run<'a, 'o> {
    /// Checks and measures the views, and places the sphere.
    fn prepare(
        views: &Views,
        config: &FitConfig,
        watch: &'a mut Watch<'o>,
    ) -> Result<Self, FitError> {
        let clock = Instant::now();
        let selection = Selection::of(views, config)?;
        let mut warnings: Vec<String> = selection.remark().into_iter().collect();
        let (train_views, held_out_views) = (selection.train, selection.held_out);
        let views = &views.views[..];
        let measure = |indices: &[usize]| -> Vec<Target> {
            use rayon::prelude::*;
            indices.par_iter().filter_map(|&i| config.target(&views[i])).collect()
        };
        let (mut train, mut held_out) = (measure(&train_views), measure(&held_out_views));
        let seen: Vec<&View> = train_views.iter().map(|&i| &views[i]).collect();
        let placement = placement::place(&seen, &mut train)?;
        let given = Given::of(&seen, &mut train, config);
        let (start, remark) = Start::of(&seen, &mut train, &placement, config);
        warnings.extend(remark);
        warnings.extend(placement.remark());
        for target in train.iter_mut().chain(&mut held_out) {
            target.place(placement.center, placement.radius);
        }
        let mut fitted = Fitted::begun(placement, train_views, held_out_views);
        fitted.seconds.push(("placement".into(), clock.elapsed().as_secs_f64()));
        let start = Some(start);
        let (alignment, begun) = (None, clock);
        let total = config.total_steps();
        let mut run =
            Self { watch, train, held_out, start, given, alignment, total, fitted, begun, clock };
        let [center_x, center_y, center_z] = placement.center;
        let facts = Facts::from([
            ("views", run.train.len() as f64),
            ("held_out", run.held_out.len() as f64),
            ("center_x", center_x),
            ("center_y", center_y),
            ("center_z", center_z),
            ("radius", placement.radius),
        ]);
        run.watch.tell(&Event::Started { job: "fit", total: total as u64, done: 0, facts });
        for warning in warnings {
            run.warn(warning);
        }
        Ok(run)
    }

    /// Asks whether no further step is to be taken, and keeps the answer where it is so.
    fn ask_cancelled(&mut self) -> bool {
        if self.watch.is_cancelled() {
            self.fitted.ended = Ended::Cancelled;
        }
        self.fitted.ended.is_cancelled()
    }

    /// Keeps what a step came to, and tells of it.
    fn stepped(&mut self, terms: Vec<(&'static str, f64)>) {
        let step = Step::of(self.fitted.history.len() as u64 + 1, self.total as u64, terms);
        self.watch.tell(&Event::Step(step.clone()));
        self.fitted.history.push(step);
    }

    fn stage(&mut self, name: &str, vertices: usize, faces: usize) {
        let facts = Facts::from([("vertices", vertices as f64), ("faces", faces as f64)]);
        self.watch.tell(&Event::Stage { name: name.to_owned(), facts });
    }

    fn warn(&mut self, warning: String) {
        self.fitted.warnings.push(warning.clone());
        self.watch.tell(&Event::Warned { text: warning });
    }

    /// Ends a stage's time and begins the next.
    fn lap(&mut self, name: &str) {
        self.fitted.seconds.push((name.into(), self.clock.elapsed().as_secs_f64()));
        self.clock = Instant::now();
    }

    /// Fits the shape, level by level.
    fn shape(&mut self, config: &FitConfig, views: &[View]) -> Result<Shape, FitError> {
        self.clock = Instant::now();
        let begun = self.start.take().unwrap_or(Start::Sphere);
        let mut order = Order::new(self.train.len(), config);
        let few = self.train.len() <= start::FEW_VIEWS;
        let grown = match &begun {
            Start::Surface { is_sphere: true, .. } if few => {
                self.sphere_instead(&mut order, config)?
            }
            _ => None,
        };
        let thin = grown.is_none() && matches!(begun, Start::Surface { .. });
        // And positions of the vertices at which nothing passes through itself, as near as there are any.
        let (mut shape, start, mut sound) = match grown {
            Some(shape) => (shape.subdivided(config), config.level, None),
            None => begun.shape(config),
        };
        for level in start..=config.level {
            if level > start {
                if thin {
                    let found = settle::mend(&mut shape, sound.as_deref(), &self.train);
                    sound = found.map(|positions| shape.divided(&positions));
                }
                shape = shape.subdivided(config);
            }
            let name = format!("level {level}");
            self.stage(&name, shape.positions.len(), shape.faces.len());
            self.level(&mut shape, &mut order, config)?;
            // What a coarse mesh cannot tell of the cameras, a finer one does not either.
            if level == start || self.alignment.is_some() {
                self.align(&mut shape, &mut order, config)?;
            }
            self.lap(&name);
            if self.ask_cancelled() {
                break;
            }
            // What begins as the hull's surface is as large as the masks allow already.
            if !thin && !few && level + 1 == config.level {
                let step = self.fitted.history.len();
                let (cancelled, train) = (|| self.watch.is_cancelled(), &self.train);
                inflation::inflate(&mut shape, train, &mut order, config, step, &cancelled)?;
                if self.ask_cancelled() {
                    break;
                }
            }
        }
        if config.filter_normals && !self.ask_cancelled() {
            let step = self.fitted.history.len();
            let cancelled = || self.watch.is_cancelled();
            flatten::flatten(&mut shape, &self.train, config, step, &cancelled)?;
            self.ask_cancelled();
            self.evaluate(&shape, self.fitted.history.len());
            self.lap("flatten");
        }
        if config.photometric && !self.ask_cancelled() {
            self.hollow(&mut shape, config, views)?;
        }
        if thin && !self.ask_cancelled() {
            let step = self.fitted.history.len();
            let (cancelled, train) = (|| self.watch.is_cancelled(), &self.train);
            settle::settle(&mut shape, sound.as_deref(), train, config, step, &cancelled)?;
            self.ask_cancelled();
            shape = specks::without_specks(shape, &self.train, config);
            self.evaluate(&shape, self.fitted.history.len());
            self.lap("settle");
        }
        Ok(shape)
    }

    /// Moves the surface into hollows that photographs show.
    fn hollow(
        &mut self,
        shape: &mut Shape,
        config: &FitConfig,
        views: &[View],
    ) -> Result<(), FitError> {
        let seen: Vec<&View> = self.fitted.train_views.iter().map(|&i| &views[i]).collect();
        let step = self.fitted.history.len();
        self.stage("photometric", shape.positions.len(), shape.faces.len());
        let cancelled = || self.watch.is_cancelled();
        let unseen: Vec<&View> = self.fitted.held_out_views.iter().map(|&i| &views[i]).collect();
        let fitted = Photographs { targets: &self.train, views: &seen };
        let held_out = Photographs { targets: &self.held_out, views: &unseen };
        let found = photometric::hollow(shape, fitted, held_out, config, step, &cancelled)?;
        self.fitted.photo_consistency = found;
        self.ask_cancelled();
        self.evaluate(shape, step);
        self.lap("photometric");
        Ok(())
    }

    /// The steps of one level.
    fn level(
        &mut self,
        shape: &mut Shape,
        order: &mut Order,
        config: &FitConfig,
    ) -> Result<(), FitError> {
        let mut distances = Vec::with_capacity(config.steps);
        for k in 0..config.steps {
            if self.ask_cancelled() {
                break;
            }
            let step = self.fitted.history.len() + 1;
            let rate = config.learning_rate * 0.1f32.powf(k as f32 / config.steps as f32);
            let views = order.next();
            let terms = shape.step(&self.train, views, config, rate, step)?;
            if config.relax_every.is_some_and(|every| (k + 1).is_multiple_of(every)) {
                shape.relax(config.relax);
            }
            let rms = terms.outline.rms();
            if terms.blind == views.len() {
                return Err(FitError::Placement {
                    reason: "the mesh reached the cameras: no view sees all of it in front".into(),
                });
            }
            self.stepped(vec![("silhouette", rms), ("bending", terms.bending)]);
            distances.push(rms);
            let last = k + 1 == config.steps || self.ask_cancelled();
            let converged = order.is_whole()
                && k >= WINDOW.max(config.steps / 2)
                && distances[k] > (1.0 - config.tolerance) * distances[k - WINDOW];
            if step.is_multiple_of(EVALUATE_EVERY) || last || converged {
                self.evaluate(shape, step);
            }
            if converged {
                break;
            }
        }
        Ok(())
    }

    fn evaluate(&mut self, shape: &Shape, step: usize) {
        let targets = if self.held_out.is_empty() { &self.train } else { &self.held_out };
        let mask_iou = shape.mask_iou(targets);
        self.fitted.evaluations.push((step, mask_iou));
        let (step, metrics) = (step as u64, vec![Metric::larger("mask_iou", mask_iou)]);
        self.watch.tell(&Event::Evaluated { step, epoch: None, metrics, best: None });
    }

    /// Brings the mesh back to the world.
    fn finish(mut self, shape: Shape, config: &FitConfig, views: &[View]) -> Fitted {
        let seen: Vec<&View> = self.fitted.train_views.iter().map(|&i| &views[i]).collect();
        self.fitted.cameras = self.refined_cameras(&shape, views);
        let Shape { mut positions, faces, topology, .. } = shape;
        let untangled = untangle(&mut positions, &faces, &topology).is_some();
        let (positions, faces, topology) = (&positions, &faces, &topology);
        let (vertices, count) = (positions.len(), faces.len());
        self.stage("color", vertices, count);
        self.clock = Instant::now();
        let targets = std::mem::take(&mut self.train);
        let photographed = Photographed::new(&seen, &targets, positions, faces);
        let even = Exposure::even(seen.len());
        let mut colors = color::vertex_colors(&photographed, topology, &even, None);
        let balanced = || Exposure::found(&photographed, topology, &mut colors);
        let found = config.balance_colors.then(balanced).flatten();
        self.fitted.exposures = found.as_ref().map(Exposure::relative);
        self.lap("color");
        let exposure = found.unwrap_or(even);
        let mut texture = None;
        if config.color == ColorKind::Texture {
            self.stage("texture", vertices, count);
            let atlas = texture::atlas(&photographed, config.texture_size);
            let painted =
                |atlas| texture::painted(&photographed, &exposure, &colors, atlas, &|_, _| ());
            texture = atlas.map(|atlas| painted(atlas).texture);
            if let (None, Some(side)) = (&texture, config.texture_size) {
                self.warn(format!("no texture: {side} x {side} has no room for {count} faces"));
            }
            self.lap("texture");
        }
        let Placement { center, radius, .. } = self.fitted.placement;
        let world = positions
            .iter()
            .map(|p| std::array::from_fn(|k| (center[k] + radius * f64::from(p[k])) as f32))
            .collect();
        self.fitted.mesh =
            TriMesh { positions: world, faces: faces.clone(), colors: Some(colors), texture };
        let found = self.fitted.mesh.examined();
        if let Some(text) = settle::remaining(&found, untangled) {
            self.warn(text);
        }
        self.fitted.health = found.health;
        self.fitted.self_intersections = found.self_intersections;
        let (ended, done) = (self.fitted.ended, self.fitted.history.len() as u64);
        let seconds = self.begun.elapsed().as_secs_f64();
        self.watch.tell(&Event::Finished { ended, done, seconds });
        self.fitted
    }
}
