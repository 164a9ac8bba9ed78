//! The layouts whose folder, archive or file holds the views of one object.

use std::path::Path;

use mesh_core::ByteImage;

use crate::backdrop::Backdrop;
use crate::dataset::{Catalog, Dataset, Entry};
use crate::error::{ReadViewsError, ViewsProblem};
use crate::layouts::{bop, colmap, kaolin, middlebury, photos, projections, transforms, turntable};
use crate::options::{MaskSource, ReadOptions, Turntable};
use crate::read::{Reading, read_chosen};
use crate::source::Source;
use crate::unknown_layout;
use crate::view::Views;

/// How far above the folder that was opened the files of one object may lie: nerfstudio keeps poses
/// beside `images/`, and COLMAP its models in `sparse/0/`.
const ABOVE: usize = 2;

/// Images in which a common backdrop is looked for.
const SAMPLED: usize = 7;

/// A dataset of one object.
#[derive(Debug)]
pub(crate) struct SingleObject {
    catalog: Catalog,
    source: Source,
    kind: Kind,
}

/// What was recognised, with what is read of it once.
#[derive(Debug)]
enum Kind {
    Kaolin,
    /// The files of poses.
    Transforms(Vec<String>),
    Colmap(colmap::Project),
    Photos,
    /// The file of cameras.
    Middlebury(String),
    Projections(projections::Matrices),
    Turntable(Turntable),
}

impl SingleObject {
    /// The dataset at the path, where it is of such a layout; nothing but names is read.
    pub(crate) fn find(path: &Path, options: &ReadOptions) -> Result<Option<Self>, ReadViewsError> {
        for source in places(path)? {
            let source = source.within(options.limits);
            let json = if path.is_dir() || source.is_zip() { None } else { path.file_name() };
            if let Some(kind) = recognise(&source, json.and_then(|n| n.to_str()), options)? {
                // COLMAP counts pixels as they are stored.
                let source = match kind {
                    Kind::Colmap(_) => source.with_stored_pixels(),
                    _ => source,
                };
                return Self::new(path, source, kind, options).map(Some);
            }
        }
        Ok(None)
    }

    fn new(
        path: &Path,
        source: Source,
        kind: Kind,
        options: &ReadOptions,
    ) -> Result<Self, ReadViewsError> {
        // Counting must not fail where a later reading with other options would succeed.
        let lenient =
            ReadOptions { allow_missing: true, mask: MaskSource::Whole, ..options.clone() };
        let Reading { layout, pending, warnings, .. } = list(&kind, &source, &lenient)?;
        let stem = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let name = stem.file_stem().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
        let entry = Entry { name, views: pending.len(), ..Entry::default() };
        drop(pending);
        let entries = vec![entry];
        let catalog = Catalog { entries, warnings, ..Catalog::new(layout, path) };
        Ok(Self { catalog, source, kind })
    }

    /// The options with the backdrop that some of the images have in common, where it is wanted and has no colour yet;
    /// none where there is no such backdrop, or an image cannot be read, which then is said of the views themselves.
    fn with_backdrop(&self, options: &ReadOptions) -> Option<ReadOptions> {
        let MaskSource::Backdrop { color: None, tolerance } = options.mask else { return None };
        if options.masks.is_some() {
            return None;
        }
        // Bars are counted in the pixels of the files, which is where masks are made of them; the backdrop is that of all images, also
        // where only some are wanted.
        let whole = ReadOptions {
            only: None,
            except: Vec::new(),
            mask: MaskSource::Whole,
            masks: None,
            depth: false,
            undistort: false,
            max_size: None,
            ..options.clone()
        };
        let reading = list(&self.kind, &self.source, &whole).ok()?;
        let count = reading.pending.len();
        let some: Vec<usize> =
            (0..count.min(SAMPLED)).map(|k| k * count / SAMPLED.min(count)).collect();
        let source = &self.source;
        let views =
            read_chosen(&self.catalog.root, source, reading, Some(&some), &whole, &|_, _| ())
                .ok()?;
        let images: Vec<ByteImage> = views.views.into_iter().map(|view| view.color).collect();
        let Backdrop { color, bars, .. } = Backdrop::common(&images, tolerance)?;
        let mask = MaskSource::Backdrop { color: Some(color), tolerance };
        Some(ReadOptions { mask, bars, ..options.clone() })
    }

    /// The COLMAP project, where it is one.
    pub(crate) fn colmap(&self) -> Option<(&Source, &colmap::Project)> {
        match &self.kind {
            Kind::Colmap(project) => Some((&self.source, project)),
            _ => None,
        }
    }
}

impl Dataset for SingleObject {
    fn catalog(&self) -> &Catalog {
        &self.catalog
    }

    fn views(
        &self,
        object: usize,
        which: Option<&[usize]>,
        options: &ReadOptions,
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Result<Views, ReadViewsError> {
        assert!(object == 0, "views: object {object} does not exist");
        let found = self.with_backdrop(options);
        let options = found.as_ref().unwrap_or(options);
        let reading = list(&self.kind, &self.source, options)?;
        read_chosen(&self.catalog.root, &self.source, reading, which, options, progress)
    }
}

/// Where the views may be: the folder, then the one folder in it where it holds nothing else,
/// which is what unpacking a zip leaves; or the archive; or the folder of the JSON file.
fn places(path: &Path) -> Result<Vec<Source>, ReadViewsError> {
    let metadata = std::fs::metadata(path).map_err(|e| ReadViewsError::new(path, e))?;
    if metadata.is_dir() {
        let outer = Source::folder(path).reaching(ABOVE);
        let names = outer.root_names()?;
        let inner = match names.as_slice() {
            [only] if path.join(only).is_dir() => {
                Some(Source::folder(&path.join(only)).reaching(ABOVE))
            }
            _ => None,
        };
        return Ok([Some(outer), inner].into_iter().flatten().collect());
    }
    let has_extension = |wanted: &str| {
        path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(wanted))
    };
    if has_extension("json") {
        let folder = match path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        return Ok(vec![Source::folder(folder).reaching(ABOVE)]);
    }
    if !metadata.is_file() {
        return Err(ReadViewsError::new(path, ViewsProblem::Irregular));
    }
    let mut magic = [0u8; 4];
    let is_zip = std::fs::File::open(path)
        .and_then(|mut file| std::io::Read::read_exact(&mut file, &mut magic))
        .is_ok_and(|()| magic == *b"PK\x03\x04");
    if is_zip || has_extension("zip") {
        return Ok(vec![Source::zip(path)?]);
    }
    if has_extension("hdf5") || has_extension("h5") {
        return Err(bop::no_hdf5(path));
    }
    Err(unknown_layout::of_file(path, "a file that is neither a zip archive nor .json"))
}

/// The layout of what is there; `json` is the file that was named, where one was.
fn recognise(
    source: &Source,
    json: Option<&str>,
    options: &ReadOptions,
) -> Result<Option<Kind>, ReadViewsError> {
    if let Some(name) = json {
        let kind = match name {
            photos::CAMERAS => Kind::Photos,
            _ => Kind::Transforms(vec![name.to_owned()]),
        };
        return Ok(Some(kind));
    }
    // A turntable is asked for by name; what else is there does not matter then.
    if let Some(table) = options.turntable {
        let any = !turntable::photographs(source)?.is_empty();
        return Ok(any.then_some(Kind::Turntable(table)));
    }
    let names = source.root_names()?;
    if kaolin::recognises(&names) {
        return Ok(Some(Kind::Kaolin));
    }
    let files = transforms::files_among(&names);
    if !files.is_empty() {
        return Ok(Some(Kind::Transforms(files)));
    }
    if photos::recognises(source) {
        return Ok(Some(Kind::Photos));
    }
    if let Some(file) = middlebury::parameters(&names) {
        return Ok(Some(Kind::Middlebury(file)));
    }
    if let Some(found) = colmap::recognises(source) {
        return Ok(Some(Kind::Colmap(colmap::Project::read(source, found)?)));
    }
    Ok(projections::recognises(source, &names)?.map(Kind::Projections))
}

fn list<'a>(
    kind: &'a Kind,
    source: &'a Source,
    options: &'a ReadOptions,
) -> Result<Reading<'a>, ReadViewsError> {
    match kind {
        Kind::Kaolin => kaolin::list(source, &source.root_names()?, options),
        Kind::Transforms(files) => transforms::list(source, files, options),
        Kind::Colmap(project) => project.list(source, options),
        Kind::Photos => photos::list(source, options),
        Kind::Middlebury(file) => middlebury::list(source, options, file),
        Kind::Projections(matrices) => projections::list(source, options, matrices),
        Kind::Turntable(table) => turntable::list(source, options, *table),
    }
}
