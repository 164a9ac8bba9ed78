//! A mesh that is nearly right, moved until its outlines agree with a few views.

use datasets::View;
use mesh_core::vector::widen;
use mesh_core::{Topology, TriMesh, bounds, untangle};
use train::settings::{LARGEST, Options as _};

use super::config::{FitConfig, MARGIN};
use super::distance::Blur;
use super::error::FitError;
use super::grading::{Graded, graded};
use super::prior::Prior;
use super::settle;
use super::shape::Shape;
use super::symmetry::mirrored;
use super::target::Target;
use crate::bake::closest_colors::closest_colors;
use crate::bake::color;
use crate::bake::exposure::Exposure;
use crate::bake::sight::Photographed;

train::options! {
    /// Options of a refinement.
    #[serde(deny_unknown_fields)]
    pub struct RefineConfig {
        /// Steps at each of two levels, each over all views.
        pub steps: usize = 50, in 0..=LARGEST as usize;
        /// Length of a level's first step, in halves of the mesh's longest side; it falls to a tenth of this.
        pub learning_rate: f32 = 0.1, in 1e-6..=1.0;
        /// How far a pull on one vertex spreads; see [`FitConfig::smoothness`].
        pub smoothness: f32 = 8.0, in 0.0..=1e4;
        /// Weight of the bending energy; see [`FitConfig::bending`].
        pub bending: f32 = 0.05, in 0.0..=1e4;
        /// About how many vertices the mesh has in the end: outlines have more corners than the mesh of a network.
        pub vertices: usize = 5_000, in 100..=1_000_000;
        /// How far outside of the mesh the object may be where views say nothing of it, in halves of the mesh's longest side.
        pub tolerance: f32 = 0.01, in -1.0..=1.0;
        /// How far from a mask's edge its pull still grows, as a share of the object's size in that image.
        pub reach: f32 = 0.5, in 0.001..=2.0;
        /// Blur of the masks' signed distance, pixels.
        pub mask_blur: f32 = 1.0, in 0.0..=16.0;
        /// Whether thin parts and gaps get back what the blur takes of them; see [`FitConfig::thin_parts`].
        pub thin_parts: bool = true;
        /// Whether each view counts twice where the mesh is nearly its own mirror image in a plane and the masks allow that of the object: as it
        /// is, and for the other side.
        pub symmetry: bool = false;
    }
}

/// Moves a closed mesh until its outlines agree with the masks of views, and gives it their colours where they show it; elsewhere
/// those of the closest point of the mesh that was given, of its texture if it has one. One view will do.
///
/// First mesh and masks are joined as solids: what a view shows to be empty is taken away, and where a pixel of a mask shows none of
/// what is left, the point of the visual hull on its ray that is nearest to the mesh is added, and what of the hull lies between. The
/// surface of that has as many holes as mesh and masks have together; from there on it is [`fit`](super::fit). Thin sheets may be left with
/// some self-intersections. What no view shows keeps its shape. A part that masks show and the mesh lacks stays apart from the rest where
/// the hull has nothing in between.
///
/// With [`symmetry`](RefineConfig::symmetry) a side that no view shows is that of its mirror image, in shape and colours, if the mesh nearly
/// is one: as cars, airplanes, chairs and their predictions are. The plane is found on the mesh; what the masks do not allow is left.
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
/// About a second for five views of 128x128 and 5,000 vertices on two cores, some four milliseconds of it for each step.
///
/// # Errors
/// See [`FitError`]; [`FitError::Placement`] where the mesh has no size or lies behind a camera, or has neither anything in common with
/// the masks nor two faces at each edge.
///
/// # References
/// Leung, Ho, Vasconcelos 2021, *Black-box test-time shape refinement for single view 3D reconstruction* (REFINE), for the
/// refinement of predictions by their silhouettes. Thrun and Wegbreit 2005, *Shape from symmetry*. Kutulakos and Seitz 2000, *A theory of
/// shape by space carving*.
pub fn refine(mesh: &TriMesh, views: &[View], config: &RefineConfig) -> Result<TriMesh, FitError> {
    let problems = config.out_of_range();
    if !problems.is_empty() {
        return Err(FitError::Config(problems));
    }
    if views.is_empty() {
        return Err(FitError::NoViews);
    }
    for view in views {
        view.validate()?;
    }
    let seen: Vec<&View> = views.iter().filter(|view| view.mask_bounds().is_some()).collect();
    if seen.is_empty() {
        return Err(FitError::EmptyMasks { views: views.len() });
    }
    let frame = frame(mesh)?;
    let (center, radius) = frame;
    let blur = Blur { sigma: config.mask_blur, keeps_thin: config.thin_parts };
    let measure = |view: &View| Target::new(view, blur, config.reach, MARGIN);
    let mut targets: Vec<Target> = seen.iter().copied().filter_map(measure).collect();
    let mirrored = if config.symmetry {
        mirrored(mesh, frame, (&seen, &mut targets), &measure)
    } else {
        Vec::new()
    };
    let mirrored: Vec<&View> = mirrored.iter().collect();
    let inside =
        |p: &[f32; 3]| std::array::from_fn(|k| ((f64::from(p[k]) - center[k]) / radius) as f32);
    let positions = mesh.positions.iter().map(inside).collect();
    let guess = TriMesh { positions, texture: None, ..mesh.clone() };
    let start = Prior::new(&guess, frame, config.tolerance).carved(&mut targets);
    // Where mesh and masks have nothing in common, the mesh as it is: its outlines are where two of its faces meet.
    let (start, cell) = match start {
        Some(start) => start,
        None if Topology::of(&guess).is_closed() => (guess.clone(), 0.0),
        None => {
            let reason = "masks and mesh have nothing in common, and the mesh is not closed";
            return Err(FitError::Placement { reason: reason.into() });
        }
    };
    for target in &mut targets {
        target.place(center, radius);
    }
    let Shape { mut positions, faces, topology, .. } = moved(&start, cell, &targets, config)?;
    // What cannot be mended stays: whoever asks for the mesh's health hears of it.
    let _ = untangle(&mut positions, &faces, &topology);
    let textured = TriMesh { texture: mesh.texture.clone(), ..guess };
    let before = closest_colors(&textured, &positions);
    let colored = |views: &[&View], targets: &[Target], before: Option<&[[f32; 3]]>| {
        let photographed = Photographed::new(views, targets, &positions, &faces);
        color::vertex_colors(&photographed, &topology, &Exposure::even(views.len()), before)
    };
    let (own, others) = targets.split_at(seen.len());
    let before = match mirrored.as_slice() {
        [] => before,
        mirrored => Some(colored(mirrored, others, before.as_deref())),
    };
    let colors = colored(&seen, own, before.as_deref());
    let world = positions
        .iter()
        .map(|p| std::array::from_fn(|k| (center[k] + radius * f64::from(p[k])) as f32))
        .collect();
    Ok(TriMesh { positions: world, faces, colors: Some(colors), texture: None })
}

/// The surface at two levels, of which the second has four faces for each of the first, fitted to the masks.
fn moved(
    start: &TriMesh,
    cell: f32,
    targets: &[Target],
    config: &RefineConfig,
) -> Result<Shape, FitError> {
    let options = FitConfig {
        smoothness: config.smoothness,
        bending: config.bending,
        learning_rate: config.learning_rate,
        ..FitConfig::default()
    };
    let (topology, faces) = (Topology::of(start), config.vertices / 2);
    let Graded { mesh, sound } = graded(start, &topology, faces, f64::from(cell));
    let mut shape = Shape::of(mesh.positions, mesh.faces, &options);
    steps(&mut shape, targets, config, &options)?;
    let sound = settle::mend(&mut shape, sound.as_deref(), targets);
    let sound = sound.map(|positions| shape.divided(&positions));
    shape = shape.subdivided(&options);
    steps(&mut shape, targets, config, &options)?;
    settle::settle(&mut shape, sound.as_deref(), targets, &options, 2 * config.steps, &|| false)?;
    Ok(shape)
}

/// The steps of one level.
fn steps(
    shape: &mut Shape,
    targets: &[Target],
    config: &RefineConfig,
    options: &FitConfig,
) -> Result<(), FitError> {
    let all: Vec<usize> = (0..targets.len()).collect();
    for k in 0..config.steps {
        let rate = config.learning_rate * 0.1_f32.powf(k as f32 / config.steps as f32);
        let terms = shape.step(targets, &all, options, rate, k + 1)?;
        if terms.blind == all.len() {
            let reason = "the mesh does not lie before the cameras".to_owned();
            return Err(FitError::Placement { reason });
        }
        if options.relax_every.is_some_and(|every| (k + 1).is_multiple_of(every)) {
            shape.relax(options.relax);
        }
    }
    Ok(())
}

/// Middle of the mesh's box, and half of its longest side.
fn frame(mesh: &TriMesh) -> Result<([f64; 3], f64), FitError> {
    let none = || FitError::Placement { reason: "the mesh has no size".to_owned() };
    let (low, high) = mesh.bounds().ok_or_else(none)?;
    let around = (widen(low), widen(high));
    let (center, radius) = (bounds::center(around), 0.5 * bounds::longest_side(around));
    if radius > 0.0 && radius.is_finite() { Ok((center, radius)) } else { Err(none()) }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::nalgebra::Vector3;
    use mesh_core::{Image, Texture, primitives};
    use synth::{Orbit, RenderOptions, render_views};

    use super::*;
    use crate::evaluate::score_views;

    fn seen(object: &TriMesh, count: usize, elevation: f64) -> Vec<View> {
        let orbit =
            Orbit { count, width: 96, height: 96, elevation: [elevation; 2], ..Orbit::default() };
        render_views(object, &orbit.cameras(), &RenderOptions::default(), &|_, _| {}).unwrap()
    }

    fn iou(mesh: &TriMesh, views: &[View]) -> f64 {
        score_views(mesh, &views.iter().collect::<Vec<_>>(), &|_, _| {}).unwrap().mask_iou
    }

    /// A slab on a leg, of which the guess has too large a slab and no leg.
    #[test]
    fn what_masks_show_is_added_and_what_they_do_not_is_taken_away() {
        let slab = primitives::cuboid([1.0, 0.2, 1.0]).colored([0.6; 3]);
        let mut object = slab.clone().translated([0.0, 0.4, 0.0]);
        object.append(&primitives::cuboid([0.15, 0.9, 0.15]).colored([0.6; 3])).unwrap();
        let guess = slab.clone().scaled([1.3, 1.0, 1.0]).translated([0.0, 0.4, 0.0]);
        let (given, others) = (seen(&object, 5, 0.0), seen(&object, 9, 10.0));
        let before = iou(&guess, &others);
        let refined = refine(&guess, &given, &RefineConfig::default()).unwrap();
        let after = iou(&refined, &others);
        let slab = iou(&slab.translated([0.0, 0.4, 0.0]), &others);
        assert!(before < 0.7 && slab < 0.85, "{before}, {slab} without a leg");
        assert!(after > 0.89, "{before} to {after}");
        let found = refined.examined();
        assert!(found.is_solid() && found.health.components == 1, "{found}");
    }

    /// A lump grows, and does not become a sponge of sheets, one for each view.
    #[test]
    fn a_guess_that_is_most_of_the_way_off_becomes_no_sponge() {
        let object = primitives::icosphere(3).scaled([1.0, 0.5, 0.7]).colored([0.6; 3]);
        let guess = object.clone().scaled([0.3; 3]).translated([0.5, 0.2, 0.0]);
        let (given, others) = (seen(&object, 5, 10.0), seen(&object, 9, -10.0));
        let refined = refine(&guess, &given, &RefineConfig::default()).unwrap();
        let found = refined.examined();
        assert!(found.is_solid() && found.health.components == 1, "{found}");
        // By the nearest points alone: 88 holes, 864 pairs of faces that cross, 0.64.
        let (holes, after) = (found.health.genus(), iou(&refined, &others));
        assert!(holes < Some(15) && after > 0.82, "{holes:?} holes, {after}");
    }

    /// What one view does not show, its depth, is the guess's.
    #[test]
    fn what_no_view_shows_stays() {
        let object = primitives::icosphere(3).colored([0.6; 3]).scaled([0.5; 3]);
        let given = seen(&object, 1, 0.0);
        let ahead = given[0].camera.rotation.row(2).transpose();
        let along = |mesh: &TriMesh| {
            let depths = mesh.positions.iter().map(|p| ahead.dot(&Vector3::from(p.map(f64::from))));
            let (low, high) =
                depths.fold((f64::MAX, f64::MIN), |(low, high), d| (low.min(d), high.max(d)));
            high - low
        };
        // Half as wide as the object, across the view, and a half deeper.
        let turn = |p: [f32; 3]| -> [f32; 3] {
            let p = Vector3::from(p.map(f64::from));
            let deep = ahead * ahead.dot(&p);
            (1.5 * deep + 0.5 * (p - deep)).map(|x| x as f32).into()
        };
        let guess = object.clone().map_positions(turn);
        let refined = refine(&guess, &given, &RefineConfig::default()).unwrap();
        let (before, after) = (iou(&guess, &given), iou(&refined, &given));
        assert!(before < 0.5 && after > 0.97, "{before} to {after}");
        let ratio = along(&refined) / along(&guess);
        assert!((0.9..1.1).contains(&ratio), "{ratio} times as deep");
    }

    /// Colours of what no view shows are those of a textured guess, too: red before, green behind.
    #[test]
    fn a_texture_gives_its_colors() {
        let object = primitives::icosphere(3).scaled([0.5; 3]);
        let ahead = seen(&object.clone().colored([0.5; 3]), 1, 0.0)[0].camera.forward();
        let away = |p: [f32; 3]| ahead.dot(&Vector3::from(p.map(f64::from)));
        let behind = |face: &[u32; 3]| u32::from(away(object.positions[face[0] as usize]) > 0.1);
        let faces = object.faces.iter().map(|face| [behind(face); 3]).collect();
        let data = vec![0.9, 0.1, 0.1, 0.1, 0.8, 0.1];
        let image = Image { height: 1, width: 2, channels: 3, data };
        let texture = Texture { image, uvs: vec![[0.25, 0.5], [0.75, 0.5]], faces };
        let guess = TriMesh { texture: Some(texture), ..object.clone() };
        let refined = refine(&guess, &seen(&guess, 1, 0.0), &RefineConfig::default()).unwrap();
        let colors = refined.colors.unwrap();
        let green = |(p, c): (&[f32; 3], &[f32; 3])| away(*p) < 0.25 || c[1] > 0.7 && c[0] < 0.2;
        assert!(refined.positions.iter().zip(&colors).all(green));
    }

    /// A body with wings, of which the guess has none; all views are from one side, so that the body hides most of the other wing.
    #[test]
    fn what_one_side_shows_the_other_has() {
        let mut guess = primitives::cuboid([0.5, 0.4, 1.2]).colored([0.6; 3]);
        let cabin = primitives::icosphere(3).scaled([0.2, 0.3, 0.4]).colored([0.6; 3]);
        guess.append(&cabin.translated([0.0, 0.2, 0.2])).unwrap();
        let mut object = guess.clone();
        for x in [-0.5, 0.5] {
            let wing = primitives::cuboid([0.7, 0.08, 0.3]).colored([0.8, 0.1, 0.1]);
            object.append(&wing.translated([x, -0.1, -0.2])).unwrap();
        }
        let from = |azimuth: f64| {
            let eye = [-2.5 * azimuth.cos(), 0.2, 2.5 * azimuth.sin()];
            mesh_core::Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.7, 96, 96)
        };
        let cameras = [-0.9, -0.3, 0.4].map(from);
        let given = render_views(&object, &cameras, &RenderOptions::default(), &|_, _| {}).unwrap();
        let others = seen(&object, 9, 10.0);
        let [without, with] = [false, true].map(|symmetry| {
            let config = RefineConfig { symmetry, ..RefineConfig::default() };
            iou(&refine(&guess, &given, &config).unwrap(), &others)
        });
        assert!(with > without + 0.015 && with > 0.895, "{without} to {with}");
    }
}
