//! The object by its colours, in all views at once, from nothing but where it may be.
//!
//! Rother, Kolmogorov and Blake's GrabCut (SIGGRAPH 2004) alternates a colour model of object and background with a cut
//! of the image, from a box that a person draws. With cameras nobody needs to draw: a body around what all of them look at
//! gives the box of every image, and between the rounds the visual hull of all masks says what the others make of a
//! pixel, as in Campbell, Vogiatzis, Hernández and Cipolla, "Automatic 3D object segmentation in multiple views using
//! volumetric graph-cuts" (BMVC 2007). Colours are counted in CIELAB, in each image and over all.

use mesh_core::{ByteImage, Camera, Mask};
use rayon::prelude::*;

use super::agreement::corrections;
use super::cut::Graph;
use super::dissent::{Dissent, MOST, NOWHERE, Silhouette};
use super::palette::{Palette, cell, lab};
use super::region::Region;
use super::{LEAST, SegmentError};
use crate::mask::keep_largest_part;
use crate::view::View;

/// Longer sides are averaged down to this while the object is looked for; its outline is drawn at full size.
const LONGEST: usize = 256;
/// Cells along each side of the hull.
const SIDE: usize = 112;
/// Rounds of colours, cuts and hull.
const ROUNDS: usize = 8;
/// Share of the views that may speak against a pixel of the object: in the first round, and from the middle one on.
const TOLERANCE: [f64; 2] = [0.25, 0.08];
/// The most that a colour can say, as the logarithm of how much likelier it is.
const SURE: f32 = 4.0;
/// What it costs to part two pixels of the same colour, in the same unit.
const BOND: f32 = 3.0;
/// What it counts for a pixel that all other views allow the object there.
const ALLOWED: f32 = 0.7;
/// A colour's share that is as good as none.
const NEVER: f32 = 2e-5;
/// How much of the background, by its colours, shows how much of it is in what is taken for the object.
const COMMON: f32 = 0.6;
/// Units of the cut's whole numbers.
const UNIT: f32 = 1024.0;

/// The masks of the object that all views show, 255 = object, of the size of each view.
///
/// `region` is a body that holds the object and leaves some of every image beside it; `None` takes the ball that all
/// cameras look at, as large as their images show it. What the views' own masks leave out belongs to no image (borders of
/// a lens that was straightened, for one); all else of them is ignored.
///
/// The same views give the same masks, whatever the number of threads.
///
/// # Errors
/// Fewer than three views, cameras without a common point, or nothing that differs from its surroundings.
///
/// # Cost
/// About a quarter of a second of a core per view of 256 pixels, and 40 bytes a pixel of the largest view per thread.
pub fn segment_by_color(
    views: &[View],
    region: Option<Region>,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Vec<ByteImage>, SegmentError> {
    if views.len() < LEAST {
        return Err(SegmentError::FewViews { found: views.len() });
    }
    let cameras: Vec<&Camera> = views.iter().map(|view| &view.camera).collect();
    let region = region.or_else(|| Region::in_sight(&cameras)).ok_or(SegmentError::NoRegion)?;
    let mut looks: Vec<Look> = views.par_iter().map(Look::small).collect();
    let mut grid = region;
    let everywhere: Vec<Silhouette> = looks.iter().map(Look::whole).collect();
    let mut dissent = Dissent::count(&everywhere, &grid, SIDE);
    looks.par_iter_mut().for_each(|look| look.start(&dissent));
    for round in 0..ROUNDS {
        progress(round, ROUNDS + 1);
        let colors = Colors::of(&looks);
        let tolerance = tolerance(round, looks.len());
        let last = round + 1 == ROUNDS;
        looks.par_iter_mut().enumerate().for_each(|(k, look)| {
            let judged = look.judge(&colors.of_view(k));
            look.cut(&judged, tolerance, round >= ROUNDS / 2, None);
            if last {
                look.keep_largest();
            }
        });
        if looks.iter().all(|look| !look.silhouette.mask.data.contains(&true)) {
            return Err(SegmentError::NoObject);
        }
        let silhouettes: Vec<Silhouette> =
            looks.iter().map(|look| look.silhouette.clone()).collect();
        dissent = Dissent::count(&silhouettes, &grid, SIDE);
        let Some(bounds) = dissent.bounds(tolerance) else { return Err(SegmentError::NoObject) };
        // Cells grow finer when the object is found.
        if 2 * round >= ROUNDS && volume(&bounds) < 0.7 * volume(&grid) {
            grid = bounds;
        }
        looks.par_iter_mut().for_each(|look| look.hear(&dissent));
    }
    // What a view cannot tell from its background the others know.
    let silhouettes: Vec<Silhouette> = looks.iter().map(|look| look.silhouette.clone()).collect();
    let found = corrections(&silhouettes, &dissent, tolerance(ROUNDS, looks.len()));
    for (look, correction) in looks.iter_mut().zip(found) {
        let mask = look.silhouette.mask.data.iter_mut().zip(&correction.gap).zip(&look.possible);
        mask.for_each(|((m, gap), possible)| *m |= *gap && *possible);
    }
    let colors = Colors::of(&looks);
    let masks = views
        .par_iter()
        .zip(&looks)
        .enumerate()
        .map(|(k, (view, look))| look.drawn(view, &colors.of_view(k)))
        .collect();
    progress(ROUNDS + 1, ROUNDS + 1);
    Ok(masks)
}

fn volume(region: &Region) -> f64 {
    region.half.iter().product()
}

/// How many views may speak against a pixel of the object.
fn tolerance(round: usize, views: usize) -> u16 {
    let share = (2.0 * round as f64 / ROUNDS as f64).min(1.0);
    let share = TOLERANCE[0] + (TOLERANCE[1] - TOLERANCE[0]) * share;
    ((share * views as f64) as usize).clamp(1, usize::from(MOST)) as u16
}

/// One view while the object is looked for.
struct Look {
    silhouette: Silhouette,
    lab: Vec<[f32; 3]>,
    cells: Vec<u16>,
    /// Whether a pixel belongs to the image at all.
    valid: Vec<bool>,
    /// How many other views speak against every place that a pixel may show.
    others: Vec<u16>,
    /// Whether the object may be there, by the region.
    possible: Vec<bool>,
}

/// The colours of object and background, counted in each view.
struct Colors {
    views: Vec<[Palette; 2]>,
    all: [Palette; 2],
}

impl Colors {
    fn of(looks: &[Look]) -> Self {
        let counted: Vec<[Palette; 2]> = looks.par_iter().map(Look::colors).collect();
        let mut all = [Palette::new(), Palette::new()];
        for view in &counted {
            (0..2).for_each(|k| all[k].add(&view[k]));
        }
        let views = counted.par_iter().map(|pair| pair.each_ref().map(Palette::smooth)).collect();
        Self { views, all: all.map(|palette| palette.smooth()) }
    }

    /// Those that hold in a view: half its own, half of all.
    fn of_view(&self, k: usize) -> [Palette; 2] {
        std::array::from_fn(|side| self.views[k][side].with(&self.all[side]))
    }
}

/// For each cell how much likelier its colour is on the object than beside it, as a logarithm.
///
/// What is taken for the object has some background in it, in the first rounds most of it. A share of it that explains
/// what is commonly met of the background's colours is taken off first: what is left is the object's.
fn odds([taken, background]: &[Palette; 2]) -> Vec<f32> {
    let ratios: Vec<f32> = (0..taken.len())
        .map(|k| (taken.share(k) + NEVER) / (background.share(k) + NEVER))
        .collect();
    let mut order: Vec<(f32, f32)> =
        ratios.iter().enumerate().map(|(k, &ratio)| (ratio, background.share(k))).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut below = 0.0;
    let mixed = order.iter().find(|(_, share)| {
        below += share;
        below >= COMMON
    });
    let mixed = mixed.map_or(0.0, |(ratio, _)| ratio.min(0.95));
    let pure = |ratio: &f32| ((ratio - mixed) / (1.0 - mixed)).max(1e-6).ln().clamp(-SURE, SURE);
    ratios.iter().map(pure).collect()
}

impl Look {
    fn small(view: &View) -> Self {
        let [h, w] = view.color.size_within(LONGEST);
        Self::new(&view.color.resized(h, w), &view.mask.resized(h, w), view.camera.resized(w, h))
    }

    fn new(color: &ByteImage, mask: &ByteImage, camera: Camera) -> Self {
        let lab = lab(color);
        let cells = lab.iter().map(|&lab| cell(lab)).collect();
        let valid = Mask::at_least(mask, 128).data;
        let none = vec![0; valid.len()];
        let mask = Mask::from_fn(mask.height, mask.width, |_, _| false);
        Self {
            silhouette: Silhouette { camera, mask },
            lab,
            cells,
            possible: valid.clone(),
            valid,
            others: none,
        }
    }

    fn whole(&self) -> Silhouette {
        Silhouette {
            camera: self.silhouette.camera.clone(),
            mask: Mask { data: self.valid.clone(), ..self.silhouette.mask },
        }
    }

    /// Takes all of the region for the object.
    fn start(&mut self, dissent: &Dissent) {
        let seen = dissent.seen_by(&self.silhouette.camera);
        for (at, possible) in self.possible.iter_mut().enumerate() {
            *possible &= seen[at] != NOWHERE;
        }
        self.silhouette.mask.data.clone_from(&self.possible);
    }

    /// Hears what the other views make of each pixel.
    fn hear(&mut self, dissent: &Dissent) {
        let seen = dissent.seen_by(&self.silhouette.camera);
        let grown = self.silhouette.mask.dilated().data;
        let without_own = |(n, own): (u16, &bool)| match n {
            NOWHERE => NOWHERE,
            n => n.saturating_sub(u16::from(!own)),
        };
        self.others = seen.into_iter().zip(&grown).map(without_own).collect();
    }

    /// The colours of the object, and of what is beside it. What only this view misses is neither.
    fn colors(&self) -> [Palette; 2] {
        let mut palettes = [Palette::new(), Palette::new()];
        for (at, &cell) in self.cells.iter().enumerate() {
            if self.silhouette.mask.data[at] {
                palettes[0].count(cell);
            } else if self.valid[at] && !(self.possible[at] && self.others[at] == 0) {
                palettes[1].count(cell);
            }
        }
        palettes
    }

    /// How much likelier each pixel's colour is on the object.
    fn judge(&self, colors: &[Palette; 2]) -> Vec<f32> {
        let odds = odds(colors);
        self.cells.iter().map(|&cell| odds[usize::from(cell)]).collect()
    }

    /// Parts object and background where it costs the least.
    ///
    /// Where `known` says something the pixel is not asked; with `fill` it counts that all others allow the object.
    fn cut(&mut self, judged: &[f32], tolerance: u16, fill: bool, known: Option<&[Option<bool>]>) {
        let width = self.silhouette.camera.width;
        let state = |at: usize| match known {
            Some(known) => known[at],
            None => (!self.possible[at] || self.others[at] > tolerance).then_some(false),
        };
        let mut numbers = vec![u32::MAX; judged.len()];
        let mut asked = Vec::new();
        for at in 0..judged.len() {
            if state(at).is_none() {
                numbers[at] = asked.len() as u32;
                asked.push(at);
            }
        }
        let mut graph = Graph::new(asked.len(), 4 * asked.len());
        let sharpness = self.sharpness();
        let height = judged.len() / width;
        for (number, &at) in asked.iter().enumerate() {
            let heard = if fill && self.others[at] == 0 { ALLOWED } else { 0.0 };
            graph.incline(number, ((judged[at] + heard) * UNIT) as i64);
            let (i, j) = ((at / width) as isize, (at % width) as isize);
            for (di, dj) in AROUND {
                let (a, b) = (i + di, j + dj);
                if a < 0 || b < 0 || a >= height as isize || b >= width as isize {
                    continue;
                }
                let near = a as usize * width + b as usize;
                let cost = (self.bond(at, near, sharpness, (di * dj) != 0) * UNIT) as i64;
                match state(near) {
                    Some(object) => graph.incline(number, if object { cost } else { -cost }),
                    None if near > at => graph.join(number, numbers[near] as usize, cost),
                    None => {}
                }
            }
        }
        let sides = graph.cut();
        for at in 0..judged.len() {
            self.silhouette.mask.data[at] =
                state(at).unwrap_or_else(|| sides[numbers[at] as usize]);
        }
    }

    /// What it costs to part two neighbours.
    fn bond(&self, a: usize, b: usize, sharpness: f32, diagonal: bool) -> f32 {
        let apart: f32 = (0..3).map(|k| (self.lab[a][k] - self.lab[b][k]).powi(2)).sum();
        let near = if diagonal { std::f32::consts::FRAC_1_SQRT_2 } else { 1.0 };
        BOND * near * (0.05 + 0.95 * (-sharpness * apart).exp())
    }

    /// One over twice the mean squared difference of neighbours.
    fn sharpness(&self) -> f32 {
        let width = self.silhouette.camera.width;
        let (mut sum, mut count) = (0.0f64, 0usize);
        for at in 0..self.lab.len() {
            for near in [at + 1, at + width] {
                if near < self.lab.len() && (near != at + 1 || near % width != 0) {
                    let [a, b] = [self.lab[at], self.lab[near]];
                    sum += (0..3).map(|k| f64::from(a[k] - b[k]).powi(2)).sum::<f64>();
                    count += 1;
                }
            }
        }
        (count as f64 / (2.0 * sum.max(1e-6))) as f32
    }

    fn keep_largest(&mut self) {
        self.silhouette.mask = self.silhouette.mask.largest_component();
    }

    fn image(&self) -> ByteImage {
        let Camera { width, height, .. } = self.silhouette.camera;
        let data = self.silhouette.mask.data.iter().map(|&m| if m { 255 } else { 0 }).collect();
        ByteImage { height, width, channels: 1, data }
    }

    /// The mask at the size of the view, its outline found there anew.
    fn drawn(&self, view: &View, colors: &[Palette; 2]) -> ByteImage {
        let small = self.image();
        let (height, width) = (view.color.height, view.color.width);
        if (height, width) == (small.height, small.width) {
            return small;
        }
        let rough = small.resized(height, width);
        let mut fine = Self::new(&view.color, &view.mask, view.camera.clone());
        // Twice averaged over a pixel and a half of the small image, what is neither black nor white is near its outline.
        let blurred =
            small.resized(small.height.div_ceil(3), small.width.div_ceil(3)).resized(height, width);
        let known: Vec<Option<bool>> = (0..rough.data.len())
            .map(|at| match (rough.data[at], blurred.data[at]) {
                _ if !fine.valid[at] => Some(false),
                (_, 0..=2) => Some(false),
                (_, 253..=255) => Some(true),
                _ => None,
            })
            .collect();
        fine.others.fill(1);
        let judged = fine.judge(colors);
        fine.cut(&judged, 0, false, Some(&known));
        let mut mask = fine.image();
        keep_largest_part(&mut mask);
        mask
    }
}

/// Half of a pixel's neighbours are after it, half before.
const AROUND: [(isize, isize); 8] =
    [(-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)];
