//! Procedural objects as a dataset that is on no disk.

use datasets::{
    Catalog, Dataset, Entry, Layout, ReadOptions, ReadViewsError, Truth, Views, mix64,
    split_objects,
};
use mesh_core::{Camera, TriMesh};

use super::{Orbit, Placement, RenderOptions, render_views};
use crate::shapes::Family;

/// Shares of a family's numbers for training, validation and test.
const SHARES: [f64; 3] = [0.8, 0.1, 0.1];
/// Seed of the hash that deals the numbers.
const SPLIT_SEED: u64 = 0;

/// Objects drawn from families, seen by cameras of their own; views are rendered when they are
/// asked for.
///
/// Object `i` of a family is the same whatever else is drawn, and what it is for follows from a hash of the family and
/// `i` alone: however many there are of each kind, and whatever the seed, no number is trained on in one set and scored in
/// another. A set has the first numbers that are dealt to each of its subsets.
///
/// ```
/// use datasets::{Dataset, ReadOptions, Subset};
/// use synth::shapes::Family;
/// use synth::{Orbit, Procedural};
///
/// let cameras = Orbit { count: 4, width: 32, height: 32, ..Procedural::orbit() };
/// let set = Procedural::new(&[Family::Car, Family::Lamp], [3, 1, 1], cameras);
/// assert_eq!(set.entries().len(), 10);
/// assert_eq!(set.entries()[4].subset, Some(Subset::Test));
/// let views = set.views(4, Some(&[2]), &ReadOptions::default(), &|_, _| ())?;
/// assert_eq!(views.views[0].name, "2");
/// # Ok::<(), datasets::ReadViewsError>(())
/// ```
#[derive(Clone, Debug)]
pub struct Procedural {
    orbit: Orbit,
    turned: bool,
    placed: f64,
    drawn: Vec<(Family, u64)>,
    catalog: Catalog,
}

impl Procedural {
    /// So many objects of each family to train on, for validation and to test, in this order, each seen by the orbit's
    /// cameras; the orbit's seed is that of the objects too.
    pub fn new(families: &[Family], counts: [usize; 3], orbit: Orbit) -> Self {
        let (mut drawn, mut entries) = (Vec::new(), Vec::new());
        for &family in families {
            let place = Family::ALL.iter().position(|&f| f == family).unwrap_or_default();
            let seed = mixed(orbit.seed, place as u64);
            for (number, entry) in dealt(family, counts) {
                drawn.push((family, mixed(seed, number)));
                entries.push(Entry { views: orbit.count, ..entry });
            }
        }
        Self {
            drawn,
            catalog: Catalog { entries, ..Catalog::new(Layout::Memory, "procedural objects") },
            turned: false,
            placed: 0.0,
            orbit,
        }
    }

    /// The same objects, each turned about the vertical by an angle of its own. Families face one
    /// way; objects that somebody set down in front of cameras do not, and which way they face is
    /// then seen only with the cameras known.
    #[must_use]
    pub fn turned(self) -> Self {
        Self { turned: true, ..self }
    }

    /// The same objects, each set down beside the middle by a vector of its own, uniform in a cube that reaches
    /// `reach` each way. The cameras stand so much farther away that they still see all of it. Where an object is, one
    /// image does not tell: its size and its distance look alike.
    #[must_use]
    pub fn placed(mut self, reach: f64) -> Self {
        let farther = 1.0 + 2.0 * 3.0_f64.sqrt() * reach;
        self.orbit.distance = self.orbit.distance.map(|distance| distance * farther);
        Self { placed: reach, ..self }
    }

    /// Cameras that stand anywhere around, from level with the object to 50 degrees above, and see
    /// all of it.
    pub fn orbit() -> Orbit {
        Orbit {
            count: 24,
            placement: Placement::Random,
            target: [0.0; 3],
            distance: [1.5, 1.7],
            elevation: [0.0, 50.0],
            ..Orbit::default()
        }
    }

    /// The mesh of an object, within a ball of radius 1/2: around the origin, unless it was [placed](Self::placed).
    ///
    /// # Panics
    /// If the object does not exist.
    pub fn mesh(&self, object: usize) -> TriMesh {
        let (family, seed) = self.drawn[object];
        let mesh = family.draw(seed).mesh();
        if !self.turned && self.placed == 0.0 {
            return mesh;
        }
        // A number in [0, 1) of this object's own.
        let share = |which: u64| mixed(seed, which) as f64 / 2.0_f64.powi(64);
        let angle = if self.turned { share(2) * std::f64::consts::TAU } else { 0.0 };
        let (sin, cos) = angle.sin_cos();
        let [x, y, z] = [3, 4, 5].map(|which| self.placed * (2.0 * share(which) - 1.0));
        let rows = [[cos, 0.0, sin, x], [0.0, 1.0, 0.0, y], [-sin, 0.0, cos, z]];
        mesh.transformed(&rows)
    }

    fn cameras(&self, object: usize) -> Vec<Camera> {
        let seed = mixed(self.drawn[object].1, 1);
        Orbit { seed, ..self.orbit.clone() }.cameras()
    }
}

/// The first numbers of a family that are dealt to each subset, as many as asked for, with what is said of them; subset by
/// subset.
fn dealt(family: Family, counts: [usize; 3]) -> Vec<(u64, Entry)> {
    let mut found: [Vec<(u64, Entry)>; 3] = Default::default();
    let mut number = 0;
    while found.iter().zip(counts).any(|(found, count)| found.len() < count) {
        let name = format!("{}-{number:04}", family.name());
        let mut entry = Entry { category: family.name().to_owned(), name, ..Entry::default() };
        let subset = split_objects(std::slice::from_ref(&entry), SHARES, SPLIT_SEED)[0];
        let place = subset as usize;
        if found[place].len() < counts[place] {
            entry.subset = Some(subset);
            found[place].push((number, entry));
        }
        number += 1;
    }
    found.into_iter().flatten().collect()
}

/// The families of these names; all of them if there is none.
///
/// # Errors
/// If a name is of no family.
pub fn families_named(names: &[String]) -> Result<Vec<Family>, String> {
    if names.is_empty() {
        return Ok(Family::ALL.to_vec());
    }
    let parsed = names.iter().map(|name| name.parse::<Family>());
    parsed.collect::<Result<_, _>>().map_err(|error| error.to_string())
}

/// A seed that two numbers decide: number `b` of the stream that SplitMix64 gives from seed `a`.
fn mixed(a: u64, b: u64) -> u64 {
    mix64(a.wrapping_add(b.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15)))
}

impl Dataset for Procedural {
    fn catalog(&self) -> &Catalog {
        &self.catalog
    }

    fn views(
        &self,
        object: usize,
        which: Option<&[usize]>,
        _: &ReadOptions,
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Views, ReadViewsError> {
        let all = self.cameras(object);
        let chosen: Vec<usize> = which.map_or_else(|| (0..all.len()).collect(), <[usize]>::to_vec);
        let cameras: Vec<Camera> = chosen.iter().map(|&i| all[i].clone()).collect();
        let options = RenderOptions::default();
        let mut views = render_views(&self.mesh(object), &cameras, &options, progress)
            .expect("the faces of a family's mesh name its vertices");
        for (view, i) in views.iter_mut().zip(chosen) {
            view.name = i.to_string();
        }
        let source = self.root().join(&self.catalog.entries[object].name);
        Ok(Views { source, ..Views::in_memory(views) })
    }

    fn truth(&self, object: usize) -> Result<Truth, ReadViewsError> {
        Ok(Truth { mesh: Some(self.mesh(object)), ..Truth::default() })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use datasets::Subset;

    /// What an object is for depends neither on how many there are nor on the seed, and as many of a subset are the same.
    #[test]
    fn no_object_changes_its_subset() {
        let families = [Family::Car, Family::Lamp];
        let set = |counts, seed| {
            let orbit = Orbit { count: 1, seed, ..Procedural::orbit() };
            Procedural::new(&families, counts, orbit)
        };
        let known = |set: &Procedural| -> std::collections::BTreeMap<String, Option<Subset>> {
            set.entries().iter().map(|entry| (entry.full_name(), entry.subset)).collect()
        };
        let of = |set: &Procedural, subset: Subset| -> Vec<String> {
            let here = set.entries().iter().filter(|entry| entry.subset == Some(subset));
            here.map(Entry::full_name).collect()
        };
        let large = set([300, 30, 40], 1);
        for (counts, seed) in [([3, 1, 2], 1), ([200, 30, 0], 1), ([0, 2, 40], 9)] {
            let other = set(counts, seed);
            let all = known(&large);
            assert!(known(&other).iter().all(|(name, subset)| all[name] == *subset), "{counts:?}");
            for ((_, subset), count) in Subset::NAMES.into_iter().zip(counts) {
                let names = of(&other, subset);
                assert_eq!(names.len(), 2 * count);
                assert!(names.iter().all(|name| of(&large, subset).contains(name)));
            }
        }
        // Another seed makes another object of the same number.
        assert_ne!(set([1, 0, 0], 1).mesh(0).positions, set([1, 0, 0], 2).mesh(0).positions);
        let first = |set: &Procedural| {
            let place = set.entries().iter().position(|e| e.subset == Some(Subset::Test)).unwrap();
            (set.entries()[place].name.clone(), set.mesh(place).positions)
        };
        assert_eq!(first(&set([2, 0, 1], 1)), first(&set([40, 5, 3], 1)));
    }

    #[test]
    fn objects_are_their_own_and_wholly_seen() {
        let orbit = Orbit { count: 3, width: 40, height: 30, seed: 5, ..Procedural::orbit() };
        let few = Procedural::new(&[Family::Table], [1, 0, 0], orbit.clone());
        let many = Procedural::new(&[Family::Car, Family::Table], [2, 0, 1], orbit);
        assert_eq!(few.mesh(0).positions, many.mesh(3).positions);
        assert_ne!(many.mesh(3).positions, many.mesh(4).positions);
        // Turned about the vertical, and not each by the same angle.
        let (stands, turned) = (many.mesh(3), many.clone().turned().mesh(3));
        let far = |p: &[f32; 3]| p[0].hypot(p[2]);
        for (a, b) in stands.positions.iter().zip(&turned.positions) {
            assert!((a[1] - b[1]).abs() < 1e-6 && (far(a) - far(b)).abs() < 1e-5);
        }
        let mut pairs = stands.positions.iter().zip(&turned.positions);
        assert!(pairs.any(|(a, b)| (a[0] - b[0]).abs() > 0.01), "not turned");
        // Set down elsewhere, not turned, and still wholly seen.
        let placed = many.clone().placed(0.2);
        let by: Vec<[f32; 3]> = stands
            .positions
            .iter()
            .zip(&placed.mesh(3).positions)
            .map(|(a, b)| std::array::from_fn(|k| b[k] - a[k]))
            .collect();
        assert!(by.iter().all(|d| (0..3).all(|k| (d[k] - by[0][k]).abs() < 1e-6)));
        assert!(by[0].iter().all(|d| d.abs() < 0.2 + 1e-6) && by[0].iter().any(|d| d.abs() > 0.01));
        let edge = |k: usize| {
            let (row, column) = (k / 40, k % 40);
            row == 0 || row == 29 || column == 0 || column == 39
        };
        for object in 0..placed.entries().len() {
            let views = placed.views(object, None, &ReadOptions::default(), &|_, _| ()).unwrap();
            for view in views.views {
                assert!((0..1200).filter(|&k| edge(k)).all(|k| view.mask.data[k] == 0), "cut off");
            }
        }
        let read = |which: Option<&[usize]>| {
            many.views(3, which, &ReadOptions::default(), &|_, _| ()).unwrap().views
        };
        let (all, one) = (read(None), read(Some(&[2])));
        assert_eq!(
            (all[2].color.data.as_slice(), &all[2].name),
            (&one[0].color.data[..], &one[0].name)
        );
        for view in &all {
            let inside = view.mask.data.iter().filter(|&&m| m > 0).count();
            assert!(inside > 40, "{inside}");
            assert!((0..1200).filter(|&k| edge(k)).all(|k| view.mask.data[k] == 0), "cut off");
        }
    }
}
