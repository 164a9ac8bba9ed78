//! A mesh of the user's own as the object.

use std::path::{Path, PathBuf};

use datasets::Subset;
use mesh_core::vector::{norm, widen};
use mesh_core::{ReadMeshError, TriMesh, bounds, read_mesh};
use train::Fingerprint;

/// A mesh from a file, brought to a size.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// What kind of thing it is, in letters, digits, `-` and `_`: the file's name without its extension, or in a
    /// [folder](super::ModelFolder) of many the subfolder's.
    pub category: String,
    /// What the object is called within its kind.
    pub name: String,
    /// What it is for, where a list says so; else it is drawn.
    pub subset: Option<Subset>,
    /// The mesh with its colours and texture.
    pub mesh: TriMesh,
    /// What the manifest says of it, so that another file is not taken for it.
    pub(super) fingerprint: String,
    /// ShapeNet's synset of its kind; zeros for a mesh by itself.
    pub(super) synset: String,
    /// Its own among the streams of random numbers.
    pub(super) stream: u32,
}

/// Why a mesh cannot be the object of a dataset.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReadModelError {
    /// The file cannot be read as a mesh.
    #[error(transparent)]
    Mesh(#[from] ReadMeshError),
    /// There is nothing to render.
    #[error(
        "{}: faces: found none ({vertices} vertices), expected a surface: points alone are not seen",
        path.display()
    )]
    NoFaces {
        /// The file.
        path: PathBuf,
        /// How many vertices it has.
        vertices: usize,
    },
    /// A folder cannot be listed.
    #[error("{}: {source}", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// A folder has no mesh in it, or none that can be used.
    #[error("{}: meshes: found none that can be used, expected .obj, .ply, .glb, .off or .stl in subfolders, one a kind", path.display())]
    NoModels {
        /// The folder.
        path: PathBuf,
    },
    /// The list of what meshes are for is not one.
    #[error("{}: {what}", path.display())]
    List {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
    /// A vertex is nowhere.
    #[error("{}: vertex {vertex}: found {position:?}, expected finite numbers", path.display())]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// The first such vertex, counted from 0.
        vertex: usize,
        /// Where it claims to be.
        position: [f32; 3],
    },
}

/// Refuses what would make images of nothing.
fn check(path: &Path, mesh: &TriMesh) -> Result<(), ReadModelError> {
    let path = path.to_owned();
    if mesh.faces.is_empty() {
        return Err(ReadModelError::NoFaces { path, vertices: mesh.positions.len() });
    }
    let nowhere = mesh.positions.iter().position(|p| !p.iter().all(|x| x.is_finite()));
    nowhere.map_or(Ok(()), |vertex| {
        Err(ReadModelError::NotFinite { path, vertex, position: mesh.positions[vertex] })
    })
}

/// What size a mesh is brought to; all but `None` centre its box at the origin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Normalize {
    /// A box of diagonal 1, as ShapeNet's models have: what 3D-R2N2's cameras are made for.
    #[default]
    UnitDiagonal,
    /// A box of longest side 1.
    UnitBox,
    /// All vertices within 1 of the origin, one at that distance.
    UnitSphere,
    /// Neither moved nor scaled.
    None,
}

/// How far from the origin what 3D-R2N2's cameras stand around may reach: at 1.14 is the nearest of them, and what is smaller is hardly seen.
const R2N2_REACH: [f64; 2] = [0.2, 1.001];

impl Model {
    /// How far the mesh reaches from the origin, where that is too far or too little for 3D-R2N2's cameras.
    pub(super) fn unfit_for_r2n2(&self) -> Option<f64> {
        let positions = self.mesh.positions.iter();
        let reach = positions.map(|p| norm(widen(*p))).fold(0.0, f64::max);
        (!(R2N2_REACH[0]..=R2N2_REACH[1]).contains(&reach)).then_some(reach)
    }

    /// Reads an OBJ, PLY or GLB; colours and texture are kept.
    ///
    /// # Errors
    /// If the file cannot be read, or holds nothing that could be rendered: a cloud of points, a
    /// mesh with a corner that is nowhere.
    pub fn read(path: &Path, normalize: Normalize) -> Result<Self, ReadModelError> {
        let mesh = read_mesh(path)?;
        check(path, &mesh)?;
        let bytes = std::fs::read(path)
            .map_err(|source| ReadMeshError::Io { path: path.into(), source })?;
        let stem = path.file_stem().map(|stem| stem.to_string_lossy()).unwrap_or_default();
        let category = plain(&stem, "model");
        // Of the file, and of what others beside it make of it: materials and textures.
        let hash = hashed(&mesh, Fingerprint::new().with(&bytes)).value();
        let fingerprint = format!("{category} {} bytes {hash:016x} {normalize:?}", bytes.len());
        let mesh = normalize.apply(mesh);
        let (name, synset) = ("0000".to_owned(), "00000000".to_owned());
        Ok(Self { category, name, subset: None, mesh, fingerprint, synset, stream: 0 })
    }
}

/// Tells meshes apart, keeps no secrets.
fn hashed(mesh: &TriMesh, before: Fingerprint) -> Fingerprint {
    fn floats<const N: usize>(values: &[[f32; N]]) -> Vec<u8> {
        values.iter().flatten().flat_map(|value| value.to_le_bytes()).collect()
    }
    let numbers = |faces: &[[u32; 3]]| -> Vec<u8> {
        faces.iter().flatten().flat_map(|corner| corner.to_le_bytes()).collect()
    };
    let hash = before.with(&floats(&mesh.positions)).with(&numbers(&mesh.faces));
    let hash = mesh.colors.iter().fold(hash, |hash, colors| hash.with(&floats(colors)));
    mesh.texture.iter().fold(hash, |hash, texture| {
        let image: Vec<u8> = texture.image.data.iter().flat_map(|v| v.to_le_bytes()).collect();
        hash.with(&floats(&texture.uvs)).with(&numbers(&texture.faces)).with(&image)
    })
}

/// A name that folders can have: letters, digits, `-` and `_`.
pub(super) fn plain(name: &str, otherwise: &str) -> String {
    let letter = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' };
    let name: String = name.chars().take(60).map(letter).collect();
    if name.is_empty() { otherwise.to_owned() } else { name }
}

impl Normalize {
    /// Moves and scales the mesh; one without extent is only centred.
    #[must_use]
    pub fn apply(self, mesh: TriMesh) -> TriMesh {
        let Some((low, high)) = mesh.bounds() else { return mesh };
        let around = (widen(low), widen(high));
        let middle = bounds::center(around);
        let size = match self {
            Self::None => return mesh,
            Self::UnitDiagonal => norm(bounds::sides(around)),
            Self::UnitBox => bounds::longest_side(around),
            Self::UnitSphere => {
                let squared = |p: &[f32; 3]| -> f64 {
                    (0..3).map(|k| (f64::from(p[k]) - middle[k]).powi(2)).sum()
                };
                mesh.positions.iter().map(squared).fold(0.0, f64::max).sqrt()
            }
        };
        let by = if size > 0.0 { 1.0 / size } else { 1.0 };
        mesh.map_positions(|p| std::array::from_fn(|k| ((f64::from(p[k]) - middle[k]) * by) as f32))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use mesh_core::{ByteImage, primitives};

    #[test]
    fn sizes_are_as_named() {
        let mesh = primitives::cuboid([1.0, 2.0, 2.0]).translated([5.0, -3.0, 1.0]);
        let longest = |mesh: &TriMesh| {
            let (low, high) = mesh.bounds().unwrap();
            assert!((0..3).all(|k| (low[k] + high[k]).abs() < 1e-6));
            high[1] - low[1]
        };
        // The diagonal is 3.
        assert!((longest(&Normalize::UnitDiagonal.apply(mesh.clone())) - 2.0 / 3.0).abs() < 1e-6);
        assert!((longest(&Normalize::UnitBox.apply(mesh.clone())) - 1.0).abs() < 1e-6);
        assert!((longest(&Normalize::UnitSphere.apply(mesh.clone())) - 4.0 / 3.0).abs() < 1e-6);
        assert_eq!(Normalize::None.apply(mesh.clone()), mesh);
    }

    #[test]
    fn names_are_fit_for_folders() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("my chair (2).ply");
        mesh_core::write_mesh(&path, &primitives::cuboid([1.0; 3])).unwrap();
        let model = Model::read(&path, Normalize::UnitBox).unwrap();
        assert_eq!((&*model.category, &*model.name), ("my_chair__2_", "0000"));
        assert!(model.fingerprint.contains("UnitBox"));
        assert!(Model::read(&folder.path().join("no.obj"), Normalize::None).is_err());
    }

    #[test]
    fn another_texture_is_another_model() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.obj");
        let text = "mtllib a.mtl\nusemtl m\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n";
        std::fs::write(&path, text).unwrap();
        std::fs::write(folder.path().join("a.mtl"), "newmtl m\nmap_Kd t.png\n").unwrap();
        let read = |color: [u8; 3]| {
            let image = ByteImage { height: 2, width: 2, channels: 3, data: color.repeat(4) };
            mesh_core::write_png(folder.path().join("t.png"), &image).unwrap();
            Model::read(&path, Normalize::None).unwrap()
        };
        let red = read([255, 0, 0]);
        assert!(red.mesh.texture.is_some());
        assert_eq!(red.fingerprint, read([255, 0, 0]).fingerprint);
        assert_ne!(red.fingerprint, read([0, 0, 255]).fingerprint);
    }

    #[test]
    fn what_cannot_be_seen_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("cloud.ply");
        let ply = |corner: &str, faces: usize| {
            format!(
                "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n\
                 property float z\nelement face {faces}\nproperty list uchar int vertex_indices\n\
                 end_header\n0 0 0\n1 0 0\n{corner}\n{}",
                "3 0 1 2\n".repeat(faces)
            )
        };
        std::fs::write(&path, ply("0 1 0", 0)).unwrap();
        let error = Model::read(&path, Normalize::None).unwrap_err().to_string();
        assert!(error.contains("cloud.ply: faces: found none (3 vertices)"), "{error}");
        std::fs::write(&path, ply("0 nan 0", 1)).unwrap();
        let error = Model::read(&path, Normalize::UnitBox).unwrap_err().to_string();
        // The reader may know better than to hand such a vertex out.
        assert!(error.contains("cloud.ply") && error.to_lowercase().contains("nan"), "{error}");
        std::fs::write(&path, ply("0 1 0", 1)).unwrap();
        assert_eq!(Model::read(&path, Normalize::None).unwrap().mesh.faces.len(), 1);
    }
}
