//! Photographs of an object where objects stand: on a table, before whatever is behind.

use datasets::View;
use diff_raster::FacesError;
use mesh_core::{ByteImage, Camera, TriMesh};
use rayon::prelude::*;

use super::noise::{clouds, scatter};
use super::render::{RenderOptions, render};

/// Samples per pixel and axis of what surrounds the object.
const SAMPLES: usize = 3;

/// What a table is covered with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cloth {
    /// Two tones in squares, stained.
    Checker,
    /// Grain along one direction.
    Wood,
    /// Patches of four colours.
    Print,
}

/// What is behind the table, far away all around.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wall {
    /// Scraps of paper of all colours.
    Confetti,
    /// Squares.
    Checker,
    /// Sky, hills and meadow.
    Landscape,
}

/// A place for an object: a table of any size below it, and what is behind.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Room {
    /// The table's cloth.
    pub cloth: Cloth,
    /// What is behind.
    pub wall: Wall,
    /// How much of the light the object keeps from the table beneath it, 0 to 1.
    pub shadow: f32,
    /// Seed of all that is drawn.
    pub seed: u64,
}

impl Room {
    /// Photographs of the object standing on the table: as [`render`], but for what is around it. Masks are the object's.
    ///
    /// The table is the plane through the object's lowest point, across +Y. Cameras stand above it, or it hides nothing.
    ///
    /// # Errors
    /// If a face names a vertex that is not there.
    pub fn photograph(
        &self,
        object: &TriMesh,
        cameras: &[Camera],
        options: &RenderOptions,
    ) -> Result<Vec<View>, FacesError> {
        let options = RenderOptions { alpha: true, ..options.clone() };
        let floor = Floor::below(object);
        let renderings = render(object, cameras, &options, &|_, _| {})?;
        Ok(renderings
            .into_par_iter()
            .map(|rendering| {
                let mut view = rendering.view;
                let Some(rgba) = rendering.rgba else { return view };
                self.put_behind(&mut view, &rgba, &floor);
                view
            })
            .collect())
    }

    fn put_behind(&self, view: &mut View, rgba: &ByteImage, floor: &Floor) {
        let width = view.color.width;
        for (at, pixel) in view.color.data.chunks_exact_mut(3).enumerate() {
            let own = rgba.data[4 * at + 3];
            if own == 255 {
                continue;
            }
            let mut behind = [0.0; 3];
            for k in 0..SAMPLES * SAMPLES {
                let [row, column] = [at / width, at % width];
                let part = |k: usize| (k as f64 + 0.5) / SAMPLES as f64;
                let (x, y) = (column as f64 + part(k % SAMPLES), row as f64 + part(k / SAMPLES));
                let color = self.seen(&view.camera, [x, y], floor);
                (0..3).for_each(|c| behind[c] += color[c] / (SAMPLES * SAMPLES) as f32);
            }
            let share = f32::from(own) / 255.0;
            for c in 0..3 {
                let color = share * f32::from(rgba.data[4 * at + c]) / 255.0;
                pixel[c] =
                    ((color + (1.0 - share) * behind[c]).clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
            }
        }
    }

    /// The colour at a place of the image where the object is not, sRGB.
    fn seen(&self, camera: &Camera, [column, row]: [f64; 2], floor: &Floor) -> [f32; 3] {
        let ray = camera.ray(column, row);
        let along = (floor.height - ray.origin[1]) / ray.direction[1];
        let p: [f64; 3] = std::array::from_fn(|a| ray.origin[a] + along * ray.direction[a]);
        let at = [0, 2].map(|a| ((p[a] - floor.center[a / 2]) / floor.reach) as f32);
        let far = at[0].hypot(at[1]);
        // The table's edge lies where the horizon would flicker.
        if along > 0.0 && far < 8.0 {
            let shade = 1.0 - self.shadow * (-1.5 * far * far).exp();
            return self.cloth(at).map(|v| v * shade);
        }
        self.wall(ray.direction.map(|v| v as f32))
    }

    fn cloth(&self, [x, z]: [f32; 2]) -> [f32; 3] {
        let stain = clouds([5.0 * x, 0.0, 5.0 * z], 5, self.seed);
        match self.cloth {
            Cloth::Checker => {
                let odd = ((4.0 * x).floor() + (4.0 * z).floor()).rem_euclid(2.0) > 0.5;
                let tone = if odd { [0.82, 0.80, 0.74] } else { [0.28, 0.36, 0.46] };
                tone.map(|v| v + 0.35 * (stain - 0.5))
            }
            Cloth::Wood => {
                let grain = clouds([1.5 * x, 0.0, 24.0 * z], 4, self.seed ^ 1);
                let fine = clouds([20.0 * x, 0.0, 60.0 * z], 3, self.seed ^ 2);
                let tone = 0.25 + 0.5 * grain + 0.3 * (fine - 0.5);
                [0.95 * tone + 0.12, 0.72 * tone + 0.06, 0.45 * tone + 0.02]
            }
            Cloth::Print => {
                let patch = clouds([3.0 * x, 0.0, 3.0 * z], 2, self.seed ^ 3);
                let tones = [
                    [0.15, 0.22, 0.30],
                    [0.55, 0.25, 0.20],
                    [0.75, 0.68, 0.45],
                    [0.30, 0.42, 0.33],
                ];
                let tone = tones[((patch - 0.25) * 8.0).clamp(0.0, 3.0) as usize];
                tone.map(|v| v + 0.3 * (stain - 0.5))
            }
        }
    }

    fn wall(&self, [x, y, z]: [f32; 3]) -> [f32; 3] {
        match self.wall {
            Wall::Confetti => scatter([x, y, z].map(|v| 14.0 * v), self.seed),
            Wall::Checker => {
                let turn = x.atan2(z) * 8.0;
                let odd = (turn.floor() + (8.0 * y).floor()).rem_euclid(2.0) > 0.5;
                let stain = clouds([6.0 * x, 6.0 * y, 6.0 * z], 4, self.seed);
                let tone = if odd { [0.85, 0.30, 0.22] } else { [0.20, 0.22, 0.60] };
                tone.map(|v| v + 0.3 * (stain - 0.5))
            }
            Wall::Landscape => {
                let hill = 0.25 * (clouds([2.0 * x, 0.0, 2.0 * z], 4, self.seed) - 0.5);
                if y > hill {
                    let cloud = clouds([3.0 * x, 6.0 * y, 3.0 * z], 5, self.seed ^ 4);
                    let white = (2.5 * (cloud - 0.45)).clamp(0.0, 1.0);
                    return [0.40, 0.60, 0.88].map(|v| v + white * (0.95 - v));
                }
                let leaf = clouds([25.0 * x, 25.0 * y, 25.0 * z], 4, self.seed ^ 5);
                [0.10 + 0.35 * leaf, 0.18 + 0.5 * leaf, 0.06 + 0.2 * leaf]
            }
        }
    }
}

/// The plane that an object stands on, and the circle around it there.
struct Floor {
    height: f64,
    center: [f64; 2],
    reach: f64,
}

impl Floor {
    fn below(object: &TriMesh) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for p in &object.positions {
            for a in 0..3 {
                low[a] = low[a].min(f64::from(p[a]));
                high[a] = high[a].max(f64::from(p[a]));
            }
        }
        let center = [0, 2].map(|a| 0.5 * (low[a] + high[a]));
        let reach = 0.5 * (high[0] - low[0]).hypot(high[2] - low[2]);
        Self { height: low[1], center, reach: reach.max(1e-6) }
    }
}

/// The object with its surface painted by solid noise, so that all of it has details: vertex colours of a mesh of small
/// triangles, from two tones.
#[must_use]
pub fn marbled(object: &TriMesh, tones: [[f32; 3]; 2], scale: f32, seed: u64) -> TriMesh {
    let paint = |p: &[f32; 3]| {
        let p = p.map(|v| scale * v);
        let vein = clouds(p, 5, seed);
        let speck = clouds(p.map(|v| 6.0 * v), 2, seed ^ 6);
        let share = ((vein - 0.5) * 3.0 + 0.5).clamp(0.0, 1.0);
        let light = 1.0 + 0.9 * (speck - 0.5);
        std::array::from_fn(|c| {
            (light * (tones[0][c] + share * (tones[1][c] - tones[0][c]))).clamp(0.0, 1.0)
        })
    };
    let colors = object.positions.iter().map(paint).collect();
    TriMesh { colors: Some(colors), texture: None, ..object.clone() }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use crate::Orbit;
    use mesh_core::primitives;

    #[test]
    fn the_object_is_seen_before_the_room_and_nothing_else_changes() {
        let ball = marbled(&primitives::icosphere(4), [[0.9, 0.1, 0.1], [0.2, 0.9, 0.2]], 3.0, 1);
        let orbit =
            Orbit { count: 4, elevation: [10.0, 40.0], width: 48, height: 40, ..Orbit::default() };
        let (cameras, options) = (orbit.cameras(), RenderOptions::default());
        let plain = crate::render_views(&ball, &cameras, &options, &|_, _| {}).unwrap();
        for (cloth, wall) in [
            (Cloth::Checker, Wall::Confetti),
            (Cloth::Wood, Wall::Checker),
            (Cloth::Print, Wall::Landscape),
        ] {
            let room = Room { cloth, wall, shadow: 0.3, seed: 5 };
            let views = room.photograph(&ball, &cameras, &options).unwrap();
            assert_eq!(views, room.photograph(&ball, &cameras, &options).unwrap());
            for (view, plain) in views.iter().zip(&plain) {
                assert_eq!(view.mask, plain.mask);
                let mut tones = std::collections::BTreeSet::new();
                let mut changed = 0;
                for k in 0..48 * 40 {
                    let [own, bare] = [view, plain].map(|v| &v.color.data[3 * k..3 * k + 3]);
                    if plain.mask.data[k] == 0 {
                        tones.insert(own.iter().map(|v| v / 16).collect::<Vec<_>>());
                    } else {
                        changed += usize::from(own != bare);
                    }
                }
                // Busy, and the object's pixels are its own but for its outline.
                assert!(tones.len() > 40, "{cloth:?} {wall:?}: {} tones", tones.len());
                assert!(changed < 120, "{changed}");
            }
        }
    }
}
