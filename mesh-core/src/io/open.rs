//! Opening mesh files, and those that a file names only below its own folder.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use super::{NotRead, ReadMeshError, regular};
use crate::image::is_known_kind;
use crate::{Budget, Image, ImageError, Limits, decode_image_with};

/// A mesh file, or its bytes alone, and what reading it may hold and open.
pub(super) struct Contents<'a> {
    pub(super) bytes: Cow<'a, [u8]>,
    /// The file, or what stands for it in errors.
    pub(super) path: &'a Path,
    pub(super) limits: &'a Limits,
    pub(super) budget: Budget,
    /// Where files that it names may be; bytes alone name none.
    pub(super) root: Option<Root>,
    /// Whether texture coordinates are wanted, and no image that lies on the mesh.
    pub(super) only_uvs: bool,
}

impl<'a> Contents<'a> {
    /// Of a regular file; its bytes count.
    pub(super) fn of_file(path: &'a Path, limits: &'a Limits) -> Result<Self, ReadMeshError> {
        let bytes =
            regular(path).map_err(|source| ReadMeshError::Io { path: path.to_owned(), source })?;
        let root = Some(Root::of(path, limits));
        let mut contents = Self { root, ..Self::of_bytes(Cow::Owned(bytes), path, limits) };
        let length = contents.bytes.len() as u64;
        contents.budget.take(length).map_err(ReadMeshError::over_limit(path))?;
        Ok(contents)
    }

    pub(super) fn of_bytes(bytes: Cow<'a, [u8]>, path: &'a Path, limits: &'a Limits) -> Self {
        let budget = limits.budget(bytes.len() as u64);
        Self { bytes, path, limits, budget, root: None, only_uvs: false }
    }
}

/// The public functions of a format that is read: of a file or of bytes, within the default limits or
/// others.
macro_rules! readers {
    ($(#[$read:meta])* read, $(#[$decode:meta])* decode, $reader:path) => {
        $(#[$read])*
        pub fn read(
            path: impl AsRef<std::path::Path>,
        ) -> Result<crate::TriMesh, crate::io::ReadMeshError> {
            read_with(path, &crate::Limits::default(), &mut Vec::new())
        }

        /// The same within other limits, and what the mesh does not hold of the file in `remarks`.
        ///
        /// # Errors
        /// As [`read`].
        pub fn read_with(
            path: impl AsRef<std::path::Path>,
            limits: &crate::Limits,
            remarks: &mut Vec<crate::io::Remark>,
        ) -> Result<crate::TriMesh, crate::io::ReadMeshError> {
            $reader(crate::io::open::Contents::of_file(path.as_ref(), limits)?, remarks)
        }

        $(#[$decode])*
        ///
        /// `name` stands for the file in errors.
        ///
        /// # Errors
        /// As [`read`], less those of files.
        pub fn decode(
            bytes: &[u8],
            name: impl AsRef<std::path::Path>,
        ) -> Result<crate::TriMesh, crate::io::ReadMeshError> {
            decode_with(bytes, name, &crate::Limits::default(), &mut Vec::new())
        }

        /// The same within other limits, and what the mesh does not hold of the file in `remarks`.
        ///
        /// # Errors
        /// As [`decode`].
        pub fn decode_with(
            bytes: &[u8],
            name: impl AsRef<std::path::Path>,
            limits: &crate::Limits,
            remarks: &mut Vec<crate::io::Remark>,
        ) -> Result<crate::TriMesh, crate::io::ReadMeshError> {
            let contents =
                crate::io::open::Contents::of_bytes(bytes.into(), name.as_ref(), limits);
            $reader(contents, remarks)
        }
    };
}
pub(super) use readers;

/// What stands for the image of a texture of which only the coordinates are wanted: one white pixel.
pub(super) fn blank() -> Image {
    Image { height: 1, width: 1, channels: 3, data: vec![1.0; 3] }
}

/// The image in a file that lies on the mesh `path`, or why the mesh is read without: one of a kind that is not known says
/// nothing against the mesh, one that is damaged does.
pub(super) fn texture(
    path: &Path,
    file: &Path,
    limits: &Limits,
) -> Result<Result<Image, NotRead>, ReadMeshError> {
    let bytes = regular(file).map_err(|source| ReadMeshError::Texture {
        path: path.to_owned(),
        source: ImageError::Io { path: file.to_owned(), source },
    })?;
    picture(path, &bytes, file, limits)
}

/// [`texture`] of bytes; `name` stands for them in errors.
pub(super) fn picture(
    path: &Path,
    bytes: &[u8],
    name: &Path,
    limits: &Limits,
) -> Result<Result<Image, NotRead>, ReadMeshError> {
    if !is_known_kind(bytes) {
        return Ok(Err(NotRead::UnknownKind));
    }
    let image = decode_image_with(bytes, name, limits)
        .map_err(|source| ReadMeshError::Texture { path: path.to_owned(), source })?;
    Ok(Ok(image.to_rgb_floats()))
}

/// The folder of a mesh, below which the files that it names must be.
pub(super) struct Root {
    folder: PathBuf,
    outside: bool,
}

impl Root {
    pub(super) fn of(path: &Path, limits: &Limits) -> Self {
        let folder = folder_of(path);
        // Links are resolved on both sides, or none would be below it.
        let folder = folder.canonicalize().unwrap_or_else(|_| folder.to_owned());
        Self { folder, outside: limits.outside_links }
    }

    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// The regular file that `name`, seen from `folder`, stands for, without links in its path.
    pub(super) fn find(&self, folder: &Path, name: &str) -> Result<PathBuf, NotRead> {
        let file = folder.join(name.replace('\\', "/"));
        let file = file.canonicalize().map_err(|_| NotRead::Missing)?;
        if !self.outside && !file.starts_with(&self.folder) {
            return Err(NotRead::Outside);
        }
        if file.is_file() { Ok(file) } else { Err(NotRead::NotAFile) }
    }
}

/// The folder that a file is in; `.` for a bare name.
pub(super) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder,
        _ => Path::new("."),
    }
}
