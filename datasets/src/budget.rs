//! Whether views stay within the memory that they may take together, and to what size they must come down for that.

use std::path::Path;

use mesh_core::OverLimit;
use rayon::prelude::*;

use crate::content::over;
use crate::error::ReadViewsError;
use crate::options::ReadOptions;
use crate::read::Reader;
use crate::view::View;

/// Views of which so few are read that their memory is not judged by the first of them, unless they may be averaged down.
const FEW: usize = 16;

/// Views that tell how much is kept where that is only what is around the object: more than one, since objects are nearer here than
/// there, and read twice, so few.
const SAMPLED: usize = 8;

/// Pixels by which both sides of what is kept of a smaller image may be longer than by its scale: edges are rounded outwards.
const ROUNDED: f64 = 5.0;

impl Reader<'_, '_> {
    /// The first view, all of it, where there are so many that their memory is judged by it, or they may be averaged down. One that cannot be read is spoken of where
    /// all are.
    pub(crate) fn judged(&self) -> Result<Option<View>, ReadViewsError> {
        let are_few = self.chosen.len() < FEW && !self.options.shrink_to_limit;
        if self.chosen.is_empty() || are_few {
            return Ok(None);
        }
        Ok(self.whole(0, &mut self.source.open()?).ok())
    }

    /// To how many pixels of the longer side views must come down for all of them to stay within their memory, if they must.
    ///
    /// # Errors
    /// If they must and are not to; where all of their images are kept, that is known by the first, before the others are read.
    pub(crate) fn longest_side(&self, first: &View) -> Result<Option<usize>, ReadViewsError> {
        let (count, limit) = (self.chosen.len() as u64, self.options.memory_limit);
        let needed = first.bytes() as u64 * count;
        let shrinks = self.options.shrink_to_limit;
        if needed <= limit || (self.margin().is_none() && !shrinks) {
            return check_budget(self.path, self.options, needed).map(|()| None);
        }
        if !shrinks {
            // How much is kept of the others nobody knows: they are counted as they are read.
            return Ok(None);
        }
        let side = first.color.height.max(first.color.width);
        if self.margin().is_none() {
            let scale = (limit as f64 / needed as f64).sqrt();
            // One less, since sides are rounded.
            return Ok(Some(((side as f64 * scale) as usize).saturating_sub(1).max(1)));
        }
        let sample = self.sample(first);
        let needed = |scale: f64| {
            let of_one = sample.iter().map(|view| view.bytes_at(scale)).fold(0.0, f64::max);
            of_one * count as f64
        };
        if needed(1.0) <= limit as f64 {
            return Ok(None);
        }
        let fits = |&longest: &usize| needed(longest as f64 / side as f64) <= limit as f64;
        Ok(Some((1..side).rev().find(fits).unwrap_or(1)))
    }

    /// How large what is kept of some of the views is, the first among them, at their own size.
    fn sample(&self, first: &View) -> Vec<KeptSize> {
        let last = self.chosen.len() - 1;
        let kept = |view: View| KeptSize::of(&self.kept(view));
        let count = SAMPLED.min(self.chosen.len());
        let others = (1..count).into_par_iter().filter_map(|k| {
            let mut opened = self.source.open().ok()?;
            self.whole(k * last / (count - 1), &mut opened).ok().map(kept)
        });
        let mut sample: Vec<KeptSize> = others.collect();
        sample.push(kept(first.clone()));
        sample
    }
}

/// How large the part of a view is that is kept.
struct KeptSize {
    sides: [f64; 2],
    whole: [f64; 2],
    bytes_each: f64,
}

impl KeptSize {
    fn of(view: &View) -> Self {
        let sides = [view.mask.height, view.mask.width];
        let bytes_each = view.bytes() as f64 / view.mask.data.len().max(1) as f64;
        let whole = view.whole_size();
        Self { sides: sides.map(|n| n as f64), whole: whole.map(|n| n as f64), bytes_each }
    }

    /// As many bytes as are kept at most where the image is scaled.
    fn bytes_at(&self, scale: f64) -> f64 {
        let side = |k: usize| {
            let rounded = if scale < 1.0 { ROUNDED } else { 0.0 };
            (self.sides[k] * scale + rounded).min((self.whole[k] * scale).ceil())
        };
        side(0) * side(1) * self.bytes_each
    }
}

pub(crate) fn megabytes(bytes: u64) -> String {
    format!("{} MB", bytes / 1_000_000)
}

/// Refuses views that take more than they may.
pub(crate) fn check_budget(
    path: &Path,
    options: &ReadOptions,
    found: u64,
) -> Result<(), ReadViewsError> {
    if found <= options.memory_limit {
        return Ok(());
    }
    let field = "all views in memory";
    Err(over(path, field, OverLimit { needed: found, most: options.memory_limit }))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use mesh_core::{ByteImage, Camera};

    use super::*;
    use crate::options::OnInconsistent;
    use crate::read::{Pending, Reading, read_pending};
    use crate::source::Source;
    use crate::view::{Layout, Views};

    const SIZE: [usize; 2] = [120, 160];
    const WHOLE: u64 = 4 * 120 * 160;
    const COUNT: u64 = 24;

    /// A square of 20 to 43 pixels somewhere in the image.
    fn view(k: usize) -> View {
        let [height, width] = SIZE;
        let camera =
            Camera::look_at([0.0, 0.0, 4.0], [0.0; 3], [0.0, 1.0, 0.0], 0.6, width, height);
        let (color, mut mask) =
            (ByteImage::new(height, width, 3), ByteImage::new(height, width, 1));
        let [top, left] = [3 * k, 2 * k + 10];
        for row in top..(top + 20 + k).min(height) {
            mask.data[row * width + left..row * width + left + 20 + k].fill(255);
        }
        View { name: k.to_string(), color, mask, camera, depth: None, crop: None }
    }

    /// What is read within so much memory, and how often a view was.
    fn read(options: &ReadOptions) -> (Result<Views, ReadViewsError>, usize) {
        read_of(COUNT as usize, options)
    }

    fn read_of(count: usize, options: &ReadOptions) -> (Result<Views, ReadViewsError>, usize) {
        let (place, reads) = (tempfile::tempdir().unwrap(), AtomicUsize::new(0));
        let source = Source::folder(place.path());
        let mut reading = Reading::new(Layout::Transforms, "poses");
        for k in 0..count {
            let reads = &reads;
            reading.pending.push(Pending::new(k.to_string(), move |_| {
                reads.fetch_add(1, Ordering::Relaxed);
                Ok(view(k))
            }));
        }
        let on_inconsistent = OnInconsistent::Accept;
        let options = ReadOptions { on_inconsistent, ..options.clone() };
        let views = read_pending(place.path(), &source, reading, &options, &|_, _| ());
        (views, reads.into_inner())
    }

    #[test]
    fn no_view_is_read_twice_where_all_fit() {
        let all = ReadOptions { memory_limit: COUNT * WHOLE, ..ReadOptions::default() };
        let (views, reads) = read(&all);
        assert_eq!((views.unwrap().views[0].clone(), reads), (view(0), COUNT as usize));
        let smaller = ReadOptions { shrink_to_limit: true, memory_limit: WHOLE, ..all.clone() };
        let (views, reads) = read(&smaller);
        let longest = views.as_ref().unwrap().views[1].color.width;
        assert_eq!(
            (views.unwrap().views[0].clone(), reads),
            (view(0).at_most(longest), COUNT as usize)
        );
        // Refused by the first.
        assert_eq!(read(&ReadOptions { memory_limit: WHOLE, ..all }).1, 1);
    }

    #[test]
    fn few_views_are_averaged_down_too() {
        for count in [1, 2, 15] {
            let limit = count as u64 * WHOLE / 3;
            let options = ReadOptions { memory_limit: limit, ..ReadOptions::default() };
            assert!(read_of(count, &options).0.is_err());
            for margin in [None, Some(3.0)] {
                let options = ReadOptions { shrink_to_limit: true, margin, ..options.clone() };
                let views = read_of(count, &options).0.unwrap();
                assert!(views.len() == count && views.bytes() as u64 <= limit);
            }
        }
    }

    #[test]
    fn what_is_not_wanted_is_neither_read_nor_counted() {
        let only = ["3", "20"].map(String::from).to_vec();
        let two = ReadOptions { memory_limit: 2 * WHOLE, ..ReadOptions::default() };
        let (views, reads) = read(&ReadOptions { only: Some(only), ..two.clone() });
        assert_eq!((views.unwrap().len(), reads), (2, 2));
        let except = (2..COUNT).map(|k| k.to_string()).collect();
        let (views, reads) = read(&ReadOptions { except, ..two.clone() });
        assert_eq!((views.unwrap().len(), reads), (2, 2));
        // Names that mean nothing, and nothing that is left.
        for only in [vec!["99".to_owned()], vec![]] {
            assert!(read(&ReadOptions { only: Some(only), ..two.clone() }).0.is_err());
        }
        let except = (0..COUNT).map(|k| k.to_string()).collect();
        let error = read(&ReadOptions { except, ..two }).0.unwrap_err().to_string();
        assert!(error.contains("all left out"), "{error}");
    }

    #[test]
    fn what_counts_is_what_is_kept() {
        let whole = ReadOptions { memory_limit: COUNT * WHOLE / 2, ..ReadOptions::default() };
        assert!(read(&whole).0.is_err());
        let part = ReadOptions { margin: Some(0.2), ..whole };
        let kept = read(&part).0.unwrap();
        assert!((kept.bytes() as u64) < COUNT * WHOLE / 4 && kept.warnings.is_empty());
        // With room for all of it nothing is averaged; with less, all are, to nearly what there is room for.
        let shrinks = ReadOptions { shrink_to_limit: true, ..part };
        assert!(read(&shrinks).0.unwrap().views == kept.views);
        let limit = kept.bytes() as u64 / 3;
        let small = read(&ReadOptions { memory_limit: limit, ..shrinks.clone() }).0.unwrap();
        assert!(small.bytes() as u64 <= limit && 4 * small.bytes() as u64 > limit);
        assert!(small.warnings[0].contains("averaged down to"), "{:?}", small.warnings);
        // What is too much is so without being averaged, too.
        let refused = ReadOptions { memory_limit: limit, shrink_to_limit: false, ..shrinks };
        assert!(read(&refused).0.unwrap_err().to_string().contains("all views in memory"));
    }
}
