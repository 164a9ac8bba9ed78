//! Reading views: finds the layout, decodes in parallel, checks that the whole makes sense.

use std::path::Path;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};

use mesh_core::{Camera, Lens};
use rayon::prelude::*;

use crate::budget::{check_budget, megabytes};
use crate::consistency;
use crate::convention::{Convention, reread};
use crate::error::ReadViewsError;
use crate::mask::clean_mask;
use crate::options::{MaskSource, OnInconsistent, ReadOptions};
use crate::segment::segment_by_color;
use crate::source::{Opened, Source};
use crate::view::{Layout, View, Views};
use crate::wanted::Wanted;

/// What reads a view, on whichever thread comes first.
pub(crate) type Read<'a> =
    Box<dyn Fn(&mut Opened<'_>) -> Result<View, ReadViewsError> + Send + Sync + 'a>;

/// One view that waits to be read.
pub(crate) struct Pending<'a> {
    /// What the view is called: one that is not wanted is not read.
    name: String,
    read: Read<'a>,
}

impl<'a> Pending<'a> {
    /// A view of this name.
    pub(crate) fn new(
        name: impl Into<String>,
        read: impl Fn(&mut Opened<'_>) -> Result<View, ReadViewsError> + Send + Sync + 'a,
    ) -> Self {
        Self { name: name.into(), read: Box::new(read) }
    }
}

/// What a layout found before any pixel is read.
pub(crate) struct Reading<'a> {
    pub(crate) layout: Layout,
    pub(crate) pending: Vec<Pending<'a>>,
    pub(crate) warnings: Vec<String>,
    /// The field that holds the poses, for messages.
    pub(crate) poses: &'static str,
    /// Which of them the source keeps for tests, by their place; ascending.
    pub(crate) test: Vec<usize>,
    /// Names of views that are not wanted and not there, which are no part of the list.
    pub(crate) left_out: Vec<String>,
}

impl<'a> Reading<'a> {
    /// A list of none.
    pub(crate) fn new(layout: Layout, poses: &'static str) -> Self {
        let (pending, warnings, test, left_out) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
        Self { layout, pending, warnings, poses, test, left_out }
    }

    /// Adds a view, or a warning in its place where a file of it is not found and that is allowed; nothing where it is not wanted.
    pub(crate) fn add<T: Send + Sync + 'a>(
        &mut self,
        name: &str,
        found: Result<T, ReadViewsError>,
        options: &ReadOptions,
        read: impl Fn(&T, &mut Opened<'_>) -> Result<View, ReadViewsError> + Send + Sync + 'a,
    ) -> Result<(), ReadViewsError> {
        match found {
            Ok(found) => self.pending.push(Pending::new(name, move |opened| read(&found, opened))),
            Err(error) if options.allow_missing => {
                self.warnings.push(format!("view {name} is left out: {}", error.without_advice()));
            }
            Err(_) if !Wanted::of(options).has(name) => self.left_out.push(name.to_owned()),
            Err(error) => return Err(error),
        }
        Ok(())
    }
}

/// A view, or why there is none; none of both where it was not read any more.
type Decoded = Option<Result<View, ReadViewsError>>;

/// The views that are wanted of a list, in the order in which they are.
pub(crate) struct Reader<'r, 'a> {
    pub(crate) path: &'r Path,
    pub(crate) source: &'r Source,
    layout: Layout,
    pub(crate) options: &'r ReadOptions,
    pub(crate) chosen: Vec<&'r Pending<'a>>,
    /// Their places in the list.
    places: Vec<usize>,
    /// Names of those that are not wanted.
    left_out: Vec<String>,
    /// The most pixels of their longer side.
    longest: Option<usize>,
}

/// What there is of them in the end.
struct Kept {
    views: Vec<View>,
    /// Which of those are for tests.
    test: Vec<usize>,
}

impl Reader<'_, '_> {
    /// One view of the list, as it is kept.
    fn view(&self, at: usize, opened: &mut Opened<'_>) -> Result<View, ReadViewsError> {
        Ok(self.kept(self.whole(at, opened)?))
    }

    /// One view of the list with its camera, all of its image at its own size.
    pub(crate) fn whole(&self, at: usize, opened: &mut Opened<'_>) -> Result<View, ReadViewsError> {
        let view = (self.chosen[at].read)(opened)?;
        Ok(View { camera: meant(view.camera, self.layout, self.options), ..view })
    }

    /// What is kept of a view: at the size that it is meant to have, and around its object.
    pub(crate) fn kept(&self, view: View) -> View {
        let view = match self.longest {
            Some(longest) => view.at_most(longest),
            None => view,
        };
        match self.margin() {
            Some(margin) => view.cropped_to_object(margin),
            None => view,
        }
    }

    /// What is kept around an object that is known once its view is read; see [`ReadOptions::margin`].
    pub(crate) fn margin(&self) -> Option<f64> {
        self.options.margin.filter(|_| !is_segmented(self.options))
    }

    /// Reads in parallel, until that is more than may be held. `first` is the first view where that was read before.
    fn decode(
        &self,
        first: Option<View>,
        progress: &(dyn Fn(usize, usize) + Sync),
    ) -> Vec<Decoded> {
        let (total, done, bytes) = (self.chosen.len(), AtomicUsize::new(0), AtomicU64::new(0));
        let counted = |view: &View| {
            bytes.fetch_add(view.bytes() as u64, Ordering::Relaxed);
            progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
        };
        let first = first.map(|view| self.kept(view));
        first.iter().for_each(counted);
        let from = usize::from(first.is_some());
        let rest = (from..total).into_par_iter().map_init(
            || None,
            |opened: &mut Option<Opened<'_>>, at| {
                // Once over the budget the rest is not even decoded; which views that are depends on the threads.
                if bytes.load(Ordering::Relaxed) > self.options.memory_limit {
                    return None;
                }
                let view = reopened(opened, self.source).and_then(|opened| self.view(at, opened));
                view.iter().for_each(counted);
                Some(view)
            },
        );
        let rest: Vec<Decoded> = rest.collect();
        first.map(|view| Some(Ok(view))).into_iter().chain(rest).collect()
    }

    /// Sorts out what may be missing, which `warnings` then says.
    ///
    /// # Errors
    /// The first, in the order of the list; also if all together are too much, one that is named is not there, or none is.
    fn keep(
        &self,
        decoded: Vec<Decoded>,
        kept_for_test: &[usize],
        warnings: &mut Vec<String>,
    ) -> Result<Kept, ReadViewsError> {
        let (path, options) = (self.path, self.options);
        let mut views = Vec::with_capacity(decoded.len());
        let (mut test, mut held) = (Vec::new(), 0);
        for (at, result) in decoded.into_iter().enumerate() {
            let index = self.places[at];
            // What was passed over comes before what is too much, so that the error is the same for any number of threads.
            let result = result.unwrap_or_else(|| {
                self.source.open().and_then(|mut opened| self.view(at, &mut opened))
            });
            held += result.as_ref().map_or(0, |view| view.bytes() as u64);
            check_budget(path, options, held)?;
            match result {
                Ok(view) => {
                    if kept_for_test.binary_search(&index).is_ok() {
                        test.push(views.len());
                    }
                    views.push(view);
                }
                Err(error) if options.allow_missing && error.is_incomplete_view() => {
                    warnings.push(format!("a view is left out: {}", error.without_advice()));
                }
                Err(error) => return Err(error),
            }
        }
        self.complete(&views)?;
        Ok(Kept { views, test })
    }

    /// Whether those that are named are there, and any at all.
    fn complete(&self, views: &[View]) -> Result<(), ReadViewsError> {
        let kept: Vec<&str> = views.iter().map(|view| view.name.as_str()).collect();
        let left_out: Vec<&str> = self.left_out.iter().map(String::as_str).collect();
        if let Some((name, expected)) = Wanted::of(self.options).missed(&kept, &left_out) {
            let found = format!("none called {name}");
            return Err(ReadViewsError::field(self.path, "views", found, expected));
        }
        if views.is_empty()
            && !left_out.is_empty()
            && (self.options.only.is_none() || self.chosen.is_empty())
        {
            return Err(ReadViewsError::field(self.path, "views", "all left out", "one at least"));
        }
        if views.is_empty() && !self.chosen.is_empty() {
            return Err(ReadViewsError::field(
                self.path,
                "masks",
                "none in any view",
                "one at least (--masks FOLDER, or --mask backdrop)",
            ));
        }
        Ok(())
    }
}

/// Reads what a layout has listed, in parallel, and checks that the whole makes sense.
///
/// `path` is what the user named, for messages and for [`Views::source`].
pub(crate) fn read_pending(
    path: &Path,
    source: &Source,
    reading: Reading<'_>,
    options: &ReadOptions,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Views, ReadViewsError> {
    read_chosen(path, source, reading, None, options, progress)
}

/// The same for all of the list, or for those with the given indices.
///
/// # Errors
/// Also if a view of `which` is not listed: files go, and what counts them may be a list that is not theirs.
pub(crate) fn read_chosen(
    path: &Path,
    source: &Source,
    reading: Reading<'_>,
    which: Option<&[usize]>,
    options: &ReadOptions,
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Views, ReadViewsError> {
    let Reading { layout, pending, mut warnings, poses, test: kept_for_test, left_out } = reading;
    if pending.is_empty() && left_out.is_empty() {
        return Err(ReadViewsError::field(path, "views", "none that is complete", "at least one"));
    }
    let (chosen, places, left_out) = chosen(path, &pending, which, (options, left_out))?;
    if let Some(field) = unknown_to(layout, options) {
        let found = format!("{layout}, which has no poses of its own");
        return Err(ReadViewsError::field(path, field, found, "a layout with matrices of cameras"));
    }
    let mut reader =
        Reader { path, source, layout, options, chosen, places, left_out, longest: None };
    let first = reader.judged()?;
    if let Some(first) = &first {
        reader.longest = reader.longest_side(first)?;
    }
    if let Some(longest) = reader.longest {
        warnings.push(format!(
            "all views at their own size would take more than {} of memory: their longer side is averaged down to {longest} pixels",
            megabytes(options.memory_limit)
        ));
    }
    let decoded = reader.decode(first, progress);
    let Kept { mut views, test } = reader.keep(decoded, &kept_for_test, &mut warnings)?;
    if is_segmented(options) {
        segment(path, &mut views, options)?;
    }
    if options.on_inconsistent == OnInconsistent::Refuse
        && options.mask != MaskSource::Whole
        && !views.is_empty()
    {
        let poses = (poses, taken_for(layout, options));
        consistency::check(path, &views, poses, source.brightest().value(), &mut warnings)?;
    }
    Ok(Views { views, source: path.to_owned(), layout, warnings, test })
}

/// Views that are read, their places in the list, and the names of those that are not.
type Chosen<'r, 'a> = (Vec<&'r Pending<'a>>, Vec<usize>, Vec<String>);

/// All of the list, or those with the given indices, without those whose names say that they are not wanted; `left_out` begins with
/// names that were found so before.
fn chosen<'r, 'a>(
    path: &Path,
    pending: &'r [Pending<'a>],
    which: Option<&[usize]>,
    (options, mut left_out): (&ReadOptions, Vec<String>),
) -> Result<Chosen<'r, 'a>, ReadViewsError> {
    let wanted = Wanted::of(options);
    let (mut chosen, mut places) = (Vec::new(), Vec::new());
    let all = 0..which.map_or(pending.len(), <[usize]>::len);
    for place in all.map(|k| which.map_or(k, |which| which[k])) {
        let view = pending.get(place).ok_or_else(|| lost(path, place, pending.len()))?;
        if wanted.has(&view.name) {
            chosen.push(view);
            places.push(place);
        } else {
            left_out.push(view.name.clone());
        }
    }
    Ok((chosen, places, left_out))
}

/// Whether masks are made of all views together.
fn is_segmented(options: &ReadOptions) -> bool {
    options.mask == MaskSource::ColorModel && options.masks.is_none()
}

/// Fills the masks by a model of colours over all views.
fn segment(path: &Path, views: &mut [View], options: &ReadOptions) -> Result<(), ReadViewsError> {
    let masks = segment_by_color(views, None, &|_, _| ())
        .map_err(|error| ReadViewsError::new(path, error))?;
    for (view, mask) in views.iter_mut().zip(masks) {
        view.mask = mask;
        clean_mask(&mut view.mask, options);
    }
    if let Some(margin) = options.margin {
        for view in views {
            *view = view.clone().cropped_to_object(margin);
        }
    }
    Ok(())
}

/// What is said of a view that is asked for and not there.
fn lost(path: &Path, view: usize, listed: usize) -> ReadViewsError {
    let found = format!("{listed}, of which none is view {view}, counted from 0");
    ReadViewsError::field(
        path,
        "views",
        found,
        "as many as there were: put back what is missing, or open the dataset again",
    )
}

/// The source as a thread has it open.
fn reopened<'o, 'a>(
    opened: &'o mut Option<Opened<'a>>,
    source: &'a Source,
) -> Result<&'o mut Opened<'a>, ReadViewsError> {
    if opened.is_none() {
        *opened = Some(source.open()?);
    }
    Ok(opened.as_mut().expect("opened above"))
}

/// What is said of poses that a layout does not have.
fn unknown_to(layout: Layout, options: &ReadOptions) -> Option<&'static str> {
    let said = options.axes.map(|_| "axes").or_else(|| options.poses.map(|_| "poses"));
    said.filter(|_| layout.convention().is_none())
}

/// What the cameras of a layout were taken for, where it has poses.
fn taken_for(layout: Layout, options: &ReadOptions) -> Option<Convention> {
    let (axes, poses) = layout.convention()?;
    Some((options.axes.unwrap_or(axes), options.poses.unwrap_or(poses)))
}

/// The camera as the options say that it is meant, where it was read as the layout has it.
fn meant(camera: Camera, layout: Layout, options: &ReadOptions) -> Camera {
    let mut camera = camera;
    if let (Some(factor), Lens::Perspective { fx, fy, .. }) =
        (options.focal_scale, &mut camera.lens)
    {
        *fx *= factor;
        *fy *= factor;
    }
    match layout.convention() {
        Some(said) => {
            let known = (options.axes.unwrap_or(said.0), options.poses.unwrap_or(said.1));
            if known == said { camera } else { reread(&camera, said, known) }
        }
        None => camera,
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use std::time::Duration;

    use mesh_core::ByteImage;

    use super::*;
    use crate::convention::CameraAxes::OpenCv;

    fn camera() -> Camera {
        Camera::look_at([1.0, 2.0, 3.0], [0.1, 0.0, -0.2], [0.0, 1.0, 0.0], 0.7, 40, 30)
    }

    #[test]
    fn options_say_what_the_layout_does_not() {
        let plain = ReadOptions::default();
        assert_eq!(meant(camera(), Layout::Colmap, &plain), camera());
        let said = ReadOptions { axes: Some(OpenCv), focal_scale: Some(2.0), ..plain.clone() };
        let found = meant(camera(), Layout::Transforms, &said);
        // NeRF's axes are OpenGL's: told otherwise the camera looks the other way.
        assert_eq!(
            found.project([0.1, 0.0, -0.2]).depth,
            -camera().project([0.1, 0.0, -0.2]).depth
        );
        let (Lens::Perspective { fx, .. }, Lens::Perspective { fx: twice, .. }) =
            (camera().lens, found.lens)
        else {
            panic!("a perspective");
        };
        assert_eq!(twice, 2.0 * fx);
        let same = ReadOptions { axes: Some(OpenCv), ..plain };
        assert_eq!(meant(camera(), Layout::Colmap, &same), camera());
    }

    /// A view of so many rows, 4 * 16 bytes each.
    fn high(rows: usize) -> View {
        let camera = Camera::look_at([0.0, 0.0, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 0.6, 16, rows);
        let (color, mask) = (ByteImage::new(rows, 16, 3), ByteImage::new(rows, 16, 1));
        View { name: rows.to_string(), color, mask, camera, depth: None, crop: None }
    }

    /// Whoever is slow, what is too much is said of the same view.
    #[test]
    fn the_limit_is_met_at_the_same_view_by_any_number_of_threads() {
        let place = tempfile::tempdir().unwrap();
        let source = Source::folder(place.path());
        let said = |threads: usize, memory_limit: u64| {
            let mut reading = Reading::new(Layout::Transforms, "poses");
            for rows in [4, 8, 16, 32] {
                reading.pending.push(Pending::new(rows.to_string(), move |_| {
                    // Where others are there, they come first.
                    if rows == 4 && threads > 1 {
                        std::thread::sleep(Duration::from_millis(30));
                    }
                    Ok(high(rows))
                }));
            }
            let options = ReadOptions { memory_limit, ..ReadOptions::default() };
            let options = ReadOptions { on_inconsistent: OnInconsistent::Accept, ..options };
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| read_pending(place.path(), &source, reading, &options, &|_, _| ()))
                .map(|views| views.len())
                .map_err(|error| error.to_string())
        };
        let one = said(1, 64 * 20).unwrap_err();
        assert!(one.contains(&(64 * 28).to_string()), "{one}");
        assert_eq!(said(4, 64 * 20).unwrap_err(), one);
        // Even where the last view alone is over it.
        assert_eq!(said(4, 64 * 10), said(1, 64 * 10));
        assert_eq!(said(4, 64 * 60), Ok(4));
    }
}
