//! The mesh that is fitted, and what pulls at it.

use mesh_core::vector::{cross, norm, sub};
use mesh_core::{Subdivision, Topology, primitives};
use rayon::prelude::*;

use super::{
    config::FitConfig,
    contour::{AT_ONCE, Edges, Surface},
    error::FitError,
    optimizer::Optimizer,
    outline::{self, Border, Measure, Scratch},
    planes::Planes,
    target::Target,
};

/// Views whose gradients are summed one after the other; the sums are added in order.
const CHUNK: usize = 4;

/// The mesh of one level, in the normalised frame in which it starts as the unit sphere.
#[derive(Debug)]
pub(super) struct Shape {
    /// Vertices `[V, 3]`.
    pub(super) positions: Vec<[f32; 3]>,
    /// Faces `[F, 3]`, turning counter-clockwise seen from outside.
    pub(super) faces: Vec<[u32; 3]>,
    /// Which vertices, edges and faces touch.
    pub(super) topology: Topology,
    edges: Edges,
    planes: Planes,
    optimizer: Optimizer,
    gradient: Vec<[f32; 3]>,
    laplacian: Vec<[f32; 3]>,
    smoothed: Vec<[f32; 3]>,
    chunks: Vec<Chunk>,
}

/// Sums over a few views.
#[derive(Debug, Default)]
struct Chunk {
    scratch: Scratch,
    gradient: Vec<[f32; 3]>,
    measure: Measure,
    /// The first view whose measure was not finite, or which is not in front of its camera.
    failed: Option<usize>,
    blind: usize,
}

/// The losses of a step, each already weighted.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Terms {
    /// Of the outline against the masks, over all views of the step.
    pub(super) outline: Measure,
    /// Bending energy.
    pub(super) bending: f64,
    /// Views of which a vertex was not in front of the camera.
    pub(super) blind: usize,
}

impl Shape {
    /// The unit icosphere of a level.
    pub(super) fn sphere(level: u32, config: &FitConfig) -> Self {
        let sphere = primitives::icosphere(level);
        Self::of(sphere.positions, sphere.faces, config)
    }

    /// Any closed mesh.
    pub(super) fn of(positions: Vec<[f32; 3]>, faces: Vec<[u32; 3]>, config: &FitConfig) -> Self {
        let topology = Topology::new(positions.len(), &faces);
        let edges = Edges::new(&topology, &faces);
        let zeros = || vec![[0.0; 3]; positions.len()];
        let optimizer = Optimizer::new(&topology, config.smoothness);
        Self {
            gradient: zeros(),
            laplacian: zeros(),
            smoothed: zeros(),
            chunks: Vec::new(),
            positions,
            faces,
            topology,
            edges,
            planes: Planes::default(),
            optimizer,
        }
    }

    /// The same surface with each face in four.
    pub(super) fn subdivided(self, config: &FitConfig) -> Self {
        let subdivision = Subdivision::along(&self.topology, &self.faces);
        let positions = subdivision.apply(&self.positions);
        Self::of(positions, subdivision.faces, config)
    }

    /// The components whose vertices are kept.
    pub(super) fn part(&self, is_kept: impl Fn(usize) -> bool, config: &FitConfig) -> Self {
        let kept: Vec<usize> = (0..self.positions.len()).filter(|&v| is_kept(v)).collect();
        let mut number = vec![Topology::NONE; self.positions.len()];
        for (new, &old) in kept.iter().enumerate() {
            number[old] = new as u32;
        }
        let faces = self.faces.iter().map(|face| face.map(|v| number[v as usize]));
        let faces = faces.filter(|face| !face.contains(&Topology::NONE)).collect();
        Self::of(kept.into_iter().map(|v| self.positions[v]).collect(), faces, config)
    }

    /// Where the vertices of the [subdivided](Self::subdivided) surface are for other positions of these.
    pub(super) fn divided(&self, positions: &[[f32; 3]]) -> Vec<[f32; 3]> {
        Subdivision::along(&self.topology, &self.faces).apply(positions)
    }

    /// Moves the vertices once, against the losses over `views` of `targets`.
    ///
    /// # Errors
    /// [`FitError::NotFinite`] with the loss, the tensor and the first view in which it was so.
    pub(super) fn step(
        &mut self,
        targets: &[Target],
        views: &[usize],
        config: &FitConfig,
        rate: f32,
        step: usize,
    ) -> Result<Terms, FitError> {
        let terms = self.losses(targets, views, config, step)?;
        self.descend(rate, step)?;
        Ok(terms)
    }

    /// The losses and their gradient, along which [`descend`](Self::descend) goes.
    ///
    /// # Errors
    /// As [`step`](Self::step).
    pub(super) fn losses(
        &mut self,
        targets: &[Target],
        views: &[usize],
        config: &FitConfig,
        step: usize,
    ) -> Result<Terms, FitError> {
        let mut terms = self.pull(targets, views, step)?;
        if config.bending > 0.0 {
            terms.bending = self.bend(config.bending, terms.outline.length);
        }
        Ok(terms)
    }

    /// Adds to the gradient of the [`losses`](Self::losses).
    pub(super) fn add(&mut self, gradient: &[[f32; 3]]) {
        for (own, more) in self.gradient.iter_mut().zip(gradient) {
            for k in 0..3 {
                own[k] += more[k];
            }
        }
    }

    /// Moves the vertices once, against the gradient.
    ///
    /// # Errors
    /// As [`step`](Self::step).
    pub(super) fn descend(&mut self, rate: f32, step: usize) -> Result<(), FitError> {
        let not_finite =
            |tensor| FitError::NotFinite { step, loss: "shape", tensor, view: "all".into() };
        if !self.gradient.iter().flatten().all(|g| g.is_finite()) {
            return Err(not_finite("gradient [V, 3]"));
        }
        self.optimizer.step(&self.gradient, &mut self.positions, rate);
        if !self.positions.iter().flatten().all(|g| g.is_finite()) {
            return Err(not_finite("positions [V, 3]"));
        }
        Ok(())
    }

    /// The gradient of the outline's distance to the masks, summed over views in a fixed order.
    fn pull(
        &mut self,
        targets: &[Target],
        views: &[usize],
        step: usize,
    ) -> Result<Terms, FitError> {
        let edge = self.mean_edge();
        let Self { positions, faces, edges, planes, gradient, chunks, .. } = self;
        planes.measure(positions, faces);
        let surface = Surface { positions, planes, edges };
        let count = views.len().div_ceil(CHUNK);
        chunks.resize_with(count.max(chunks.len()), Chunk::default);
        chunks[..count].par_iter_mut().zip(views.par_chunks(CHUNK)).for_each(|(chunk, views)| {
            chunk.gradient.clear();
            chunk.gradient.resize(positions.len(), [0.0; 3]);
            chunk.measure = Measure::default();
            (chunk.failed, chunk.blind) = (None, 0);
            let Chunk { scratch, gradient, .. } = chunk;
            outline::look(surface, views.iter().map(|&view| &targets[view]), scratch);
            for (k, &view) in views.iter().enumerate() {
                let target = &targets[view];
                let stride = target.lines_between_samples(edge);
                let measured = outline::outline(surface, target, k, stride, scratch, gradient);
                match measured {
                    Some(measure) if measure.energy.is_finite() => {
                        chunk.measure = chunk.measure.plus(measure);
                    }
                    Some(_) => chunk.failed = chunk.failed.or(Some(view)),
                    None => chunk.blind += 1,
                }
            }
        });
        let mut terms = Terms::default();
        for chunk in &chunks[..count] {
            if let Some(view) = chunk.failed {
                return Err(FitError::NotFinite {
                    step,
                    loss: "silhouette",
                    tensor: "outline distance",
                    view: targets[view].name.clone(),
                });
            }
            terms.outline = terms.outline.plus(chunk.measure);
            terms.blind += chunk.blind;
        }
        let chunks = &chunks[..count];
        gradient.par_chunks_mut(1024).enumerate().for_each(|(block, out)| {
            let from = block * 1024;
            out.fill([0.0; 3]);
            for chunk in chunks {
                for (o, g) in out.iter_mut().zip(&chunk.gradient[from..]) {
                    for k in 0..3 {
                        o[k] += g[k];
                    }
                }
            }
        });
        Ok(terms)
    }

    /// Adds the gradient of `scale * weight / 2 * sum |laplacian|^2`, the Laplacian being the
    /// vertex less the mean of its ring.
    fn bend(&mut self, weight: f32, scale: f64) -> f64 {
        let rings = &self.topology.vertex_vertices;
        ring_offset(rings, &self.positions, &mut self.laplacian);
        ring_offset(rings, &self.laplacian, &mut self.smoothed);
        let weight = weight * scale as f32;
        for (g, s) in self.gradient.iter_mut().zip(&self.smoothed) {
            for k in 0..3 {
                g[k] += weight * s[k];
            }
        }
        let square: f64 = self.laplacian.iter().flatten().map(|&l| f64::from(l * l)).sum();
        0.5 * f64::from(weight) * square
    }

    /// Slides the vertices along the surface, `rate` of the way to the centre of their ring.
    pub(super) fn relax(&mut self, rate: f32) {
        let rings = &self.topology.vertex_vertices;
        ring_offset(rings, &self.positions, &mut self.laplacian);
        for i in 0..self.positions.len() {
            let mut normal = [0.0f32; 3];
            for &face in self.topology.vertex_faces.row(i) {
                let [a, b, c] = self.faces[face as usize].map(|v| self.positions[v as usize]);
                let n = cross(sub(b, a), sub(c, a));
                for k in 0..3 {
                    normal[k] += n[k];
                }
            }
            let square = normal.iter().map(|n| n * n).sum::<f32>().max(1e-30);
            let offset = self.laplacian[i];
            let along = (0..3).map(|k| offset[k] * normal[k]).sum::<f32>() / square;
            self.smoothed[i] = std::array::from_fn(|k| {
                self.positions[i][k] - rate * (offset[k] - along * normal[k])
            });
        }
        self.positions.copy_from_slice(&self.smoothed);
    }

    /// As views look at it, by planes that were measured of it as it is.
    fn surface<'a>(&'a self, planes: &'a Planes) -> Surface<'a> {
        Surface { positions: &self.positions, planes, edges: &self.edges }
    }

    /// The planes of its faces.
    pub(super) fn planes(&self) -> Planes {
        Planes::of(&self.positions, &self.faces)
    }

    /// Every place of the outline in some views, by the shape's [planes](Self::planes), with the number of the view; views of which a
    /// vertex is not in front of the camera have none. See [`outline::borders`].
    pub(super) fn borders(
        &self,
        planes: &Planes,
        targets: &[Target],
        stride: impl Fn(&Target) -> usize,
        mut visit: impl FnMut(usize, Border),
    ) {
        let (surface, mut scratch) = (self.surface(planes), Scratch::default());
        for (nth, targets) in targets.chunks(AT_ONCE).enumerate() {
            outline::look(surface, targets.iter(), &mut scratch);
            for (k, target) in targets.iter().enumerate() {
                let visit = |border| visit(nth * AT_ONCE + k, border);
                let _ = outline::borders(surface, target, k, stride(target), &mut scratch, visit);
            }
        }
    }

    /// Distance of the outlines to the edges of all masks, root mean square in pixels.
    pub(super) fn distance(&self, targets: &[Target]) -> f64 {
        let (edge, planes) = (self.mean_edge(), self.planes());
        let stride = |target: &Target| target.lines_between_samples(edge);
        let measures: Vec<Measure> = targets
            .par_chunks(CHUNK)
            .map(|targets| {
                let mut sum = Measure::default();
                self.borders(&planes, targets, stride, |_, border| {
                    sum = sum.plus(border.measure());
                });
                sum
            })
            .collect();
        measures.into_iter().fold(Measure::default(), Measure::plus).rms()
    }

    /// Puts the vertices elsewhere.
    pub(super) fn place(&mut self, positions: Vec<[f32; 3]>) {
        self.positions = positions;
    }

    /// Mean mask IoU of the targets given: exact hard coverage at pixel centres, in the targets' boxes.
    pub(super) fn mask_iou(&self, targets: &[Target]) -> f64 {
        let planes = self.planes();
        let surface = self.surface(&planes);
        let scores = |targets: &[Target]| {
            let mut scratch = Scratch::default();
            outline::look(surface, targets.iter(), &mut scratch);
            let score = |(view, target)| {
                let covered = outline::coverage(surface, target, view, &mut scratch);
                covered.map_or(0.0, |covered| target.iou(&covered))
            };
            targets.iter().enumerate().map(score).collect()
        };
        let scores: Vec<Vec<f64>> = targets.par_chunks(CHUNK).map(scores).collect();
        scores.iter().flatten().sum::<f64>() / targets.len().max(1) as f64
    }

    /// Mean length of the edges.
    pub(super) fn mean_edge(&self) -> f32 {
        let total: f64 = self
            .topology
            .edges
            .iter()
            .map(|e| {
                let d = sub(self.positions[e[0] as usize], self.positions[e[1] as usize]);
                f64::from(norm(d))
            })
            .sum();
        (total / self.topology.edges.len().max(1) as f64) as f32
    }
}

/// Each vertex less the mean of its ring.
fn ring_offset(rings: &mesh_core::Csr, x: &[[f32; 3]], out: &mut [[f32; 3]]) {
    for (i, out) in out.iter_mut().enumerate() {
        let ring = rings.row(i);
        let mut sum = [0.0; 3];
        for &j in ring {
            for k in 0..3 {
                sum[k] += x[j as usize][k];
            }
        }
        let share = 1.0 / ring.len().max(1) as f32;
        *out = std::array::from_fn(|k| x[i][k] - share * sum[k]);
    }
}
