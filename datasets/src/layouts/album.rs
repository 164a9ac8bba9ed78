//! What the readers of annotated photographs share: one file lists many images, each a view.

use std::path::Path;

use mesh_core::{Camera, TriMesh, read_mesh};

use crate::assemble::{ImageFile, camera_of_size};
use crate::dataset::Catalog;
use crate::error::{ReadViewsError, ViewsProblem};
use crate::options::ReadOptions;
use crate::read::{Pending, Read, Reading, read_pending};
use crate::source::{Opened, Source};
use crate::view::{View, Views};
use crate::wanted::Wanted;

/// A view that an annotation lists.
pub(crate) struct Photo<'a> {
    /// What the view is called.
    pub(crate) name: &'a str,
    /// The image, relative to the root.
    pub(crate) image: &'a str,
    /// Reads the view.
    pub(crate) read: Read<'a>,
}

/// The dataset around the photographs.
pub(crate) struct Album<'a> {
    pub(crate) catalog: &'a Catalog,
    pub(crate) source: &'a Source,
    /// The field that holds the poses, for messages.
    pub(crate) poses: &'static str,
}

impl Album<'_> {
    /// Reads the photograph of an object that has one, as often as it is asked for.
    ///
    /// # Panics
    /// If another view is asked for.
    pub(crate) fn read_single<'a>(
        &self,
        (name, image): (&'a str, &'a str),
        which: Option<&[usize]>,
        options: &ReadOptions,
        progress: &(dyn Fn(usize, usize) + Sync),
        read: impl Fn(&mut Opened<'_>) -> Result<View, ReadViewsError> + Copy + Send + Sync + 'a,
    ) -> Result<Views, ReadViewsError> {
        let photos =
            chosen(1, which).into_iter().map(|_| Photo { name, image, read: Box::new(read) });
        self.read(photos.collect(), options, progress)
    }

    /// Reads the photographs in parallel; those without an image are left out where that is
    /// allowed.
    pub(crate) fn read(
        &self,
        photos: Vec<Photo<'_>>,
        options: &ReadOptions,
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Views, ReadViewsError> {
        let (mut pending, mut warnings, mut left_out) = (Vec::new(), Vec::new(), Vec::new());
        for photo in photos {
            if self.source.has(photo.image) {
                pending.push(Pending::new(photo.name, photo.read));
            } else if options.allow_missing {
                let (name, image) = (photo.name, photo.image);
                warnings.push(format!("view {name} is left out: {image} is missing"));
            } else if !Wanted::of(options).has(photo.name) {
                left_out.push(photo.name.to_owned());
            } else {
                let wanted_by = format!("the annotation of view {} names it", photo.name);
                return Err(self.source.missing_view(photo.image, wanted_by));
            }
        }
        let reading = Reading {
            pending,
            warnings,
            left_out,
            ..Reading::new(self.catalog.layout, self.poses)
        };
        read_pending(&self.catalog.root, self.source, reading, options, progress)
    }
}

/// The indices of the wanted views: all, or those that were asked for.
///
/// # Panics
/// If one does not exist.
pub(crate) fn chosen(count: usize, which: Option<&[usize]>) -> Vec<usize> {
    match which {
        None => (0..count).collect(),
        Some(which) => {
            if let Some(view) = which.iter().find(|&&i| i >= count) {
                panic!("views: view {view} does not exist, there are {count}");
            }
            which.to_vec()
        }
    }
}

/// The camera of an annotation for the image that is really there, which may have been resized.
pub(crate) fn fitted(
    camera: Camera,
    image: &ImageFile,
    file: &Path,
    field: &str,
) -> Result<Camera, ReadViewsError> {
    camera.validate().map_err(ReadViewsError::camera(file, field))?;
    camera_of_size(camera, image, file, &format!("{field}: size"))
}

/// The mesh in a file, where the file is there.
pub(crate) fn model(path: &Path) -> Result<Option<TriMesh>, ReadViewsError> {
    if !path.is_file() {
        return Ok(None);
    }
    read_mesh(path)
        .map(Some)
        .map_err(|e| ReadViewsError::new(path, ViewsProblem::Mesh(Box::new(e))))
}
