//! A mesh that is nearly right, moved until its outlines agree with a few views.

use datasets::View;
use mesh_core::{Topology, TriMesh, subdivide, untangle};
use train::settings::{LARGEST, Options as _};

use super::config::FitConfig;
use super::error::FitError;
use super::exposure::Exposure;
use super::shape::Shape;
use super::sight::Photographed;
use super::target::Target;
use super::{MARGIN, check, color};

train::options! {
    /// Options of a refinement.
    #[serde(deny_unknown_fields)]
    pub struct RefineConfig {
        /// Steps, each over all views.
        pub steps: usize = 50, in 0..=LARGEST as usize;
        /// Length of the first step, in halves of the mesh's longest side; it falls to a tenth of this.
        pub learning_rate: f32 = 0.1, in 1e-6..=1.0;
        /// How far a pull on one vertex spreads; see [`FitConfig::smoothness`].
        pub smoothness: f32 = 8.0, in 0.0..=1e4;
        /// Weight of the bending energy of what is added to the mesh: what no view shows follows its neighbours.
        pub bending: f32 = 0.05, in 0.0..=1e4;
        /// The mesh is subdivided, each face in four, until it has at least so many vertices: outlines have more corners than the
        /// mesh of a network.
        pub vertices: usize = 2_000, in 0..=1_000_000;
        /// How far from a mask's edge its pull still grows, as a share of the object's size in that image.
        pub reach: f32 = 0.5, in 0.001..=2.0;
        /// Blur of the masks' signed distance, pixels.
        pub mask_blur: f32 = 1.0, in 0.0..=16.0;
    }
}

/// Moves a closed mesh until its outlines agree with the masks of views, and gives it their colours where they show it;
/// elsewhere colours change as their neighbours' do. One view will do. What no view shows keeps its shape, but for the smooth
/// part of what its neighbourhood moves by. A texture is not kept.
///
/// It is [`fit`](super::fit) with the mesh as its start and a bending energy of the displacement instead of the shape: for
/// meshes that a network predicted.
///
/// ```
/// use mesh_core::primitives;
/// use recon::fit::{RefineConfig, refine};
/// use synth::{Orbit, RenderOptions, render_views};
///
/// // Three images of an ellipsoid, and a guess that is too round.
/// let object = primitives::icosphere(3).scaled([1.0, 0.6, 0.8]).colored([0.8, 0.1, 0.1]);
/// let cameras = Orbit { count: 3, width: 64, height: 64, ..Orbit::default() }.cameras();
/// let views = render_views(&object, &cameras, &RenderOptions::default(), &|_, _| {})?;
/// let guess = primitives::icosphere(3).scaled([0.8; 3]).colored([0.5; 3]);
/// let refined = refine(&guess, &views, &RefineConfig::default())?;
/// assert!((refined.volume() / object.volume() - 1.0).abs() < 0.1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
///
/// # Cost
/// About four milliseconds a step for five views of 128x128 and 2,562 vertices.
///
/// # Errors
/// See [`FitError`]; [`FitError::Placement`] where the mesh has no size or lies behind a camera.
///
/// # References
/// Leung, Ho, Vasconcelos 2021, *Black-box test-time shape refinement for single view 3D reconstruction* (REFINE), for the
/// refinement of predictions by their silhouettes.
pub fn refine(mesh: &TriMesh, views: &[View], config: &RefineConfig) -> Result<TriMesh, FitError> {
    let problems = config.out_of_range();
    if !problems.is_empty() {
        return Err(FitError::Config(problems));
    }
    if views.is_empty() {
        return Err(FitError::NoViews);
    }
    views.iter().try_for_each(check)?;
    let seen: Vec<&View> = views.iter().filter(|view| view.mask_bounds().is_some()).collect();
    if seen.is_empty() {
        return Err(FitError::EmptyMasks { views: views.len() });
    }
    let (center, radius) = frame(mesh)?;
    let mut mesh = TriMesh { texture: None, ..mesh.clone() };
    while mesh.positions.len() < config.vertices && !mesh.faces.is_empty() {
        mesh = subdivide(&mesh);
    }
    let mut targets: Vec<Target> = seen
        .iter()
        .filter_map(|view| Target::new(view, config.mask_blur, config.reach, MARGIN))
        .collect();
    for target in &mut targets {
        target.place(center, radius);
    }
    let inside =
        |p: &[f32; 3]| std::array::from_fn(|k| ((f64::from(p[k]) - center[k]) / radius) as f32);
    let mut start: Vec<[f32; 3]> = mesh.positions.iter().map(inside).collect();
    // Before the steps, which give back what smoothing takes: a surface that passes through itself has outlines that pull
    // at its wrong side.
    let topology = Topology::new(start.len(), &mesh.faces);
    let _ = untangle(&mut start, &mesh.faces, &topology);
    let options = FitConfig {
        smoothness: config.smoothness,
        bending: config.bending,
        ..FitConfig::default()
    };
    let mut shape = Shape::of(start.clone(), mesh.faces, &options).resting(start);
    let all: Vec<usize> = (0..targets.len()).collect();
    for k in 0..config.steps {
        let rate = config.learning_rate * 0.1_f32.powf(k as f32 / config.steps as f32);
        let edge = shape.mean_edge();
        let stride = |target: &Target| target.lines_between_samples(edge);
        let terms = shape.step(&targets, &all, stride, &options, rate, k + 1)?;
        if terms.blind == all.len() {
            let reason = "the mesh does not lie before the cameras".to_owned();
            return Err(FitError::Placement { reason });
        }
    }
    let Shape { mut positions, faces, topology, .. } = shape;
    // What cannot be mended stays: whoever asks for the mesh's health hears of it.
    let _ = untangle(&mut positions, &faces, &topology);
    let before = mesh.colors.as_deref();
    let photographed = Photographed::new(&seen, &targets, &positions, &faces);
    let even = Exposure::even(seen.len());
    let colors = color::vertex_colors(&photographed, &topology, &even, before);
    let world = positions
        .iter()
        .map(|p| std::array::from_fn(|k| (center[k] + radius * f64::from(p[k])) as f32))
        .collect();
    Ok(TriMesh { positions: world, faces, colors: Some(colors), texture: None })
}

/// Middle of the mesh's box, and half of its longest side.
fn frame(mesh: &TriMesh) -> Result<([f64; 3], f64), FitError> {
    let none = || FitError::Placement { reason: "the mesh has no size".to_owned() };
    let (low, high) = mesh.bounds().ok_or_else(none)?;
    let [low, high] = [low, high].map(|corner| corner.map(f64::from));
    let center = std::array::from_fn(|k| 0.5 * (low[k] + high[k]));
    let radius = (0..3).map(|k| 0.5 * (high[k] - low[k])).fold(0.0, f64::max);
    if radius > 0.0 && radius.is_finite() { Ok((center, radius)) } else { Err(none()) }
}
