//! What only measures between pixels find: a view that stands apart, a lens that is a little off, masks that are too large.

use datasets::View;
use mesh_core::{ByteImage, Camera, MedianOfEven};
use rayon::prelude::*;

use super::coherence::{Coherence, Outlines};
use super::coverage::Unseen;
use super::diagnosis::{Agreement, Problem, some_of};
use super::hull::Sphere;
use super::lens::{LensFit, best_lens};
use super::mask_edge;
use super::silhouette::Silhouette;

// The numbers below are chosen on planted errors; `docs/inspect.md` has what they find, made by the example `inspect_errors`.

/// Room around the sphere that holds the object: cones of the other views may be wider.
const ROOM: f64 = 1.1;
/// A view stands apart where it is to blame for so many pixels of gap, and so many times what is usual.
const BLAMED: (f64, f64) = (1.5, 5.0);
/// A view's mask is odd where the hull misses so large a share, and so many times what is usual.
const ODD_SHARE: (f64, f64) = (0.02, 8.0);
/// A hole or bite is as odd where the others' hull covers so much more than is usual, as a share of the mask. A hole that one view
/// alone shows leaves 0.07 on good views of the clock.
const ODD_EXCESS: f64 = 0.15;
/// No more than this share of the views stand apart from the others.
const APART: usize = 4;
/// A better lens takes away so large a share of the gap, and so many pixels; or less, if what is left is what exact cameras leave. Noise
/// of the poses looks like a shorter lens, which allows more, but is not explained by one.
const LENS: (f64, f64) = (0.45, 0.05);
const LENS_EXACT: (f64, f64, f64) = (0.12, 0.018, 0.2);
/// Pixels that a principal point must be aside, and the share by which a focal length must be off, to be worth a word.
const ASIDE: f64 = 0.75;
const LONGER: f64 = 0.015;
/// Gap in pixels that exact cameras and masks do not leave; parts thinner than a pixel, which masks show here and there, leave 0.4.
const LOOSE: f64 = 0.45;
/// Pixels from the masks' edges to those of the images that are too many.
const EDGE: f64 = 0.8;
/// Share of directions without a view that makes views one-sided.
const ONE_SIDED: f64 = 0.25;

/// Fills in the finer figures, and says what they show where nothing coarser is found.
pub(super) fn look(
    views: &[View],
    sphere: Sphere,
    found: &mut Agreement,
    problems: &mut Vec<Problem>,
) {
    let silhouettes = Silhouette::all(views);
    let outlines = Outlines { views: &silhouettes, sphere: roomy(sphere) };
    found.coherence_by_view = outlines.coherence();
    found.coherence = mean(&found.coherence_by_view);
    let unseen = Unseen::of(views.iter().map(|view| &view.camera), sphere.center);
    found.unseen = Some(unseen.share);
    let colors: Vec<&ByteImage> = views.iter().map(|view| &view.color).collect();
    found.mask_edge = mask_edge::offset(&colors, &silhouettes);
    if unseen.share > ONE_SIDED {
        let message = format!(
            "no view shows the side towards {} ({:.0} % of all directions): the shape there is a guess",
            unseen.side(),
            100.0 * unseen.share
        );
        problems.push(Problem::new("one_sided", message));
    }
    let explained = ["focal_length", "disagreement", "coincident_cameras", "inverse", "opencv"];
    let is_camera = |p: &Problem| {
        p.kind.starts_with("flipped")
            || p.kind == "turned"
            || explained.iter().any(|kind| p.kind.starts_with(kind))
    };
    if problems.iter().any(is_camera) {
        return;
    }
    // Two views can neither be told from each other nor from another lens.
    let enough = views.len() > 2;
    found.lens = enough.then(|| best_lens(&outlines)).flatten();
    let by_view = found.coherence_by_view.as_slice();
    let odd = if enough { odd_views(&outlines, by_view) } else { Vec::new() };
    if !odd.is_empty() && APART * odd.len() <= views.len() {
        let names: Vec<&str> = odd.iter().map(|&k| views[k].name.as_str()).collect();
        let message = format!(
            "{} {} the others: look at cameras and masks",
            some_of(&names, views.len()),
            if names.len() == 1 { "disagrees with" } else { "disagree with" }
        );
        problems.push(Problem::new("odd_views", message));
    } else if let Some(lens) = found.lens.as_ref().filter(|lens| explains(lens)) {
        problems.push(lens_problem(lens));
    } else if let Some(c) = found.coherence.filter(|c| c.gap > LOOSE) {
        let message = format!(
            "outlines miss one another by {:.1} pixels in the mean: poses are a little off, or masks show \
             what is not the object (fit refines cameras where that helps)",
            c.gap * usual_scale(&silhouettes)
        );
        problems.push(Problem::new("loose_cameras", message));
    }
    let edge = |offset| edge_problem(offset, usual_scale(&silhouettes));
    problems.extend(found.mask_edge.and_then(edge));
}

/// The views that cannot be right if the others are.
fn odd_views(outlines: &Outlines<'_>, by_view: &[Option<Coherence>]) -> Vec<usize> {
    let blame = outlines.blame();
    let count = blame.len();
    let blamed: Vec<f64> = (0..count)
        .map(|j| (0..count).map(|k| blame[k][j]).sum::<f64>() + blame[j].iter().sum::<f64>())
        .collect();
    let of = |value: fn(&Coherence) -> f64| -> Vec<f64> {
        by_view.iter().map(|c| c.as_ref().map_or(0.0, value)).collect()
    };
    let (missing, excess) = (of(|c| c.missing), of(|c| c.excess));
    let (usual, usual_missing, usual_excess) = (median(&blamed), median(&missing), median(&excess));
    let is_odd = |&k: &usize| {
        blamed[k] > BLAMED.0.max(BLAMED.1 * usual)
            || missing[k] > ODD_SHARE.0.max(ODD_SHARE.1 * usual_missing)
            || excess[k] > 2.0 * usual_excess + ODD_EXCESS
    };
    (0..count).filter(is_odd).collect()
}

/// The upper median; 0 of nothing.
fn median(values: &[f64]) -> f64 {
    mesh_core::median(values.iter().copied(), MedianOfEven::Upper).unwrap_or(0.0)
}

/// Whether a lens other than the one given is what is wrong.
fn explains(lens: &LensFit) -> bool {
    let LensFit { focal, shift: [right, down], given, gap } = *lens;
    let less = given - gap;
    let (share, pixels, exact) = LENS_EXACT;
    let explained =
        less > (LENS.0 * given).max(LENS.1) || (gap < exact && less > (share * given).max(pixels));
    explained && (right.hypot(down) > ASIDE || (focal - 1.0).abs() > LONGER)
}

fn lens_problem(lens: &LensFit) -> Problem {
    let LensFit { focal, shift: [right, down], given, gap } = *lens;
    let instead = format!(
        "(in images brought to 320 pixels at most outlines miss one another by {gap:.2} pixels instead of {given:.2})"
    );
    if right.hypot(down) > ASIDE {
        let message = format!(
            "the principal point looks off: {right:+.1} pixels to the right and {down:+.1} down explain the \
             masks better {instead}"
        );
        return Problem::new("principal_point", message);
    }
    let message = format!(
        "the focal length looks off: about {focal:.2} times the given one explains the masks better: \
         --focal-scale {focal:.2} {instead}"
    );
    Problem::new("focal_length", message)
}

/// Pixels of an image to one of its silhouette, in the median.
fn usual_scale(silhouettes: &[Silhouette]) -> f64 {
    median(&silhouettes.iter().map(|silhouette| silhouette.scale).collect::<Vec<_>>())
}

fn edge_problem(offset: f64, scale: f64) -> Option<Problem> {
    let pixels = offset * scale;
    // Pixels of the small images, of which each is one of the view's or several.
    if offset.abs() < EDGE {
        return None;
    }
    let (kind, word) =
        if pixels < 0.0 { ("large_masks", "larger") } else { ("small_masks", "smaller") };
    let message = format!(
        "the masks are about {:.1} pixels {word} than the object in the images, all around",
        pixels.abs()
    );
    Some(Problem::new(kind, message))
}

/// How masks fit together, in a few figures.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Fitness {
    /// The means over views.
    pub(crate) coherence: Coherence,
    /// The lens that explains the masks better, if one does.
    pub(crate) lens: Option<LensFit>,
    /// As [`Agreement::mask_edge`].
    pub(crate) mask_edge: Option<f64>,
}

/// How the masks of views fit together under these cameras, and to the views' colours.
pub(super) fn fitness(views: &[(&View, &Camera)], sphere: Sphere) -> Option<Fitness> {
    let seen = |&(view, camera): &(&View, &Camera)| Silhouette::seen_by(view, camera);
    let silhouettes: Vec<Silhouette> = views.par_iter().map(seen).collect();
    let colors: Vec<&ByteImage> = views.iter().map(|(view, _)| &view.color).collect();
    let outlines = Outlines { views: &silhouettes, sphere: roomy(sphere) };
    Some(Fitness {
        coherence: mean(&outlines.coherence())?,
        lens: best_lens(&outlines).filter(explains),
        mask_edge: mask_edge::offset(&colors, &silhouettes),
    })
}

/// The sphere with room for wider cones.
pub(super) fn roomy(sphere: Sphere) -> Sphere {
    Sphere { radius: ROOM * sphere.radius, ..sphere }
}

/// The mean of each figure.
fn mean(by_view: &[Option<Coherence>]) -> Option<Coherence> {
    let count = by_view.iter().flatten().count();
    let of = |value: fn(&Coherence) -> f64| {
        by_view.iter().flatten().map(value).sum::<f64>() / count as f64
    };
    (count > 0).then(|| Coherence {
        missing: of(|c| c.missing),
        excess: of(|c| c.excess),
        gap: of(|c| c.gap),
    })
}
