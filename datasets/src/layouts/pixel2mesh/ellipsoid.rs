//! `info_ellipsoid.dat`: the mesh that Pixel2Mesh deforms, and the graphs it convolves on.

use std::path::Path;

use mesh_core::TriMesh;
use mesh_core::nalgebra::Vector3;
use pickle::{Item, Pickle, PickleError};

use super::sample::read_bytes;
use crate::content::cut;
use crate::error::ReadViewsError;

/// The name it is shipped under.
pub(super) const FILE: &str = "info_ellipsoid.dat";

/// Pixel2Mesh's ellipsoid at its three levels.
#[derive(Clone, Debug, PartialEq)]
pub struct Ellipsoid {
    /// Vertices of the first level, in the camera's frame.
    pub positions: Vec<[f32; 3]>,
    /// From coarse to fine.
    pub levels: Vec<EllipsoidLevel>,
}

/// One level of the ellipsoid.
#[derive(Clone, Debug, PartialEq)]
pub struct EllipsoidLevel {
    /// How many vertices it has.
    pub vertices: usize,
    /// The identity, and the Chebyshev term `2 L / max(eigenvalue of L) - I`, diagonal included:
    /// what a graph convolution sums over.
    pub supports: [Support; 2],
    /// Pairs of vertices whose midpoints are appended for the next level, which are all edges of
    /// this one, each once; empty at the last.
    pub pairs: Vec<[u32; 2]>,
    /// The file's quads, which the method does not use.
    pub quads: Vec<[u32; 4]>,
    /// For each vertex its neighbours. The file pads them with -1, which an array of NumPy's takes
    /// for its last row; here they end.
    pub neighbors: Vec<Vec<u32>>,
    /// The file's Laplacian coordinates, `[V, 3]`.
    pub laplacian: Vec<[f64; 3]>,
    /// Triangles, where they were read from a `face1.obj` to `face3.obj` beside the file, as they
    /// are: every other one of the published finer levels is wound the wrong way round.
    pub faces: Vec<[u32; 3]>,
}

/// A sparse square matrix over vertices.
#[derive(Clone, Debug, PartialEq)]
pub struct Support {
    /// Row and column of each entry, in the order of the file.
    pub entries: Vec<[u32; 2]>,
    /// The entries.
    pub values: Vec<f64>,
}

impl Ellipsoid {
    /// Reads the file, and `face1.obj`, `face2.obj`, `face3.obj` where they are beside it.
    ///
    /// # Errors
    /// If a file cannot be read, is not a pickle of this kind, or names vertices that do not exist.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, ReadViewsError> {
        let path = path.as_ref();
        let bytes = read_bytes(path)?;
        let mut ellipsoid = decode(&bytes)
            .map_err(|e| ReadViewsError::field(path, e.field, e.found, e.expected))?;
        for (i, level) in ellipsoid.levels.iter_mut().enumerate() {
            let faces = path.with_file_name(format!("face{}.obj", i + 1));
            if faces.is_file() {
                level.faces = read_faces(&faces, level.vertices)?;
            }
        }
        Ok(ellipsoid)
    }

    /// The mesh of a level: midpoints of the levels before it, with the faces that were read, each
    /// turned to face away from the middle.
    ///
    /// # Panics
    /// If there is no such level.
    pub fn mesh(&self, level: usize) -> TriMesh {
        let mut positions = self.positions.clone();
        for coarse in &self.levels[..level] {
            for pair in &coarse.pairs {
                let [a, b] = pair.map(|v| positions[v as usize]);
                positions.push(std::array::from_fn(|k| 0.5 * (a[k] + b[k])));
            }
        }
        let mut middle = [0.0; 3];
        for p in &positions {
            (0..3).for_each(|k| middle[k] += f64::from(p[k]) / positions.len() as f64);
        }
        let outward = |&face: &[u32; 3]| {
            let [a, b, c] = face.map(|v| {
                let p = positions[v as usize];
                Vector3::from_fn(|k, _| f64::from(p[k]) - middle[k])
            });
            // The volume of the cell between the face and the middle.
            if a.dot(&b.cross(&c)) < 0.0 { [face[0], face[2], face[1]] } else { face }
        };
        let faces = self.levels[level].faces.iter().map(outward).collect();
        TriMesh::new(positions, faces)
    }
}

/// The eight parts of the file.
fn decode(bytes: &[u8]) -> Result<Ellipsoid, PickleError> {
    let pickle = Pickle::parse(bytes)?;
    let parts = pickle.root().elements(8)?;
    let positions: Vec<[f32; 3]> =
        parts[0].rows::<3>()?.into_iter().map(|p| p.map(|x| x as f32)).collect();
    let pairs = parts[4].elements(2)?;
    let [quads, laplacians, neighbors] =
        [parts[5].elements(3)?, parts[6].elements(3)?, parts[7].elements(3)?];
    let mut levels = Vec::new();
    let mut vertices = positions.len();
    for i in 0..3 {
        let [first, second] = parts[1 + i].elements(2)?.try_into().expect("two elements");
        let pairs = match pairs.get(i) {
            Some(pairs) => indices::<2>(pairs, vertices)?,
            None => Vec::new(),
        };
        let next = vertices + pairs.len();
        levels.push(EllipsoidLevel {
            vertices,
            supports: [support(&first, vertices)?, support(&second, vertices)?],
            quads: indices::<4>(&quads[i], vertices)?,
            neighbors: rings(&neighbors[i], vertices)?,
            laplacian: counted(&laplacians[i], laplacians[i].rows::<3>()?, vertices)?,
            faces: Vec::new(),
            pairs,
        });
        vertices = next;
    }
    Ok(Ellipsoid { positions, levels })
}

fn wrong(item: &Item<'_, '_>, row: usize, found: String, expected: String) -> PickleError {
    PickleError { field: format!("{}[{row}]", item.field), found, expected }
}

/// Rows of whole numbers from 0, below `limit`.
fn indices<const N: usize>(
    item: &Item<'_, '_>,
    limit: usize,
) -> Result<Vec<[u32; N]>, PickleError> {
    let limit = limit.min(u32::MAX as usize);
    let rows = item.rows::<N>()?;
    if let Some(i) = rows
        .iter()
        .position(|row| row.iter().any(|v| !(0.0..limit as f64).contains(v) || v.fract() != 0.0))
    {
        return Err(wrong(
            item,
            i,
            format!("{:?}", rows[i]),
            format!("whole numbers from 0, below {limit}"),
        ));
    }
    Ok(rows.into_iter().map(|row| row.map(|v| v as u32)).collect())
}

fn counted<T>(item: &Item<'_, '_>, rows: Vec<T>, count: usize) -> Result<Vec<T>, PickleError> {
    if rows.len() == count {
        return Ok(rows);
    }
    let (field, found) = (item.field.clone(), format!("{} rows", rows.len()));
    Err(PickleError { field, found, expected: format!("{count}") })
}

/// (entries, values, (V, V)).
fn support(item: &Item<'_, '_>, vertices: usize) -> Result<Support, PickleError> {
    let [entries, values, _shape] = item.elements(3)?.try_into().expect("three elements");
    let entries = indices::<2>(&entries, vertices)?;
    let rows: Vec<f64> = values.rows::<1>()?.into_iter().map(|[v]| v).collect();
    let values = counted(&values, rows, entries.len())?;
    Ok(Support { entries, values })
}

/// Up to eight neighbours padded with -1, then the vertex itself, then how many there are.
fn rings(item: &Item<'_, '_>, vertices: usize) -> Result<Vec<Vec<u32>>, PickleError> {
    let rows = counted(item, item.rows::<10>()?, vertices)?;
    rows.iter()
        .enumerate()
        .map(|(i, row)| {
            let [neighbors @ .., itself, degree] = row;
            let known = |v: &f64| (0.0..vertices as f64).contains(v) && v.fract() == 0.0;
            let ring: Vec<u32> = neighbors.iter().filter(|v| known(v)).map(|&v| v as u32).collect();
            let padded = neighbors.iter().filter(|&&v| v == -1.0).count();
            if ring.len() + padded != 8 || *itself != i as f64 || *degree != ring.len() as f64 {
                let expected =
                    format!("up to 8 vertices below {vertices}, -1 for none, {i}, their count");
                return Err(wrong(item, i, format!("{row:?}"), expected));
            }
            Ok(ring)
        })
        .collect()
}

/// A file with nothing but `f a b c`, counted from 1.
fn read_faces(path: &Path, vertices: usize) -> Result<Vec<[u32; 3]>, ReadViewsError> {
    let bytes = read_bytes(path)?;
    let text = String::from_utf8_lossy(&bytes);
    let mut faces = Vec::new();
    for (i, line) in text.lines().enumerate() {
        let mut words = line.split_whitespace();
        if words.next() != Some("f") {
            continue;
        }
        let corners: Vec<u32> = words
            .map_while(|word| word.split('/').next()?.parse::<u32>().ok()?.checked_sub(1))
            .filter(|&v| (v as usize) < vertices)
            .collect();
        let face: [u32; 3] = corners.try_into().map_err(|_| {
            let expected = format!("three vertices from 1 to {vertices}");
            ReadViewsError::field(path, format!("line {}", i + 1), cut(line), expected)
        })?;
        faces.push(face);
    }
    Ok(faces)
}
