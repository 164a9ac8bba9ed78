//! How views are read.

use clap::Args;
use std::io::Read;
use std::path::PathBuf;

use datasets::{CameraAxes, MaskSource, PoseDirection, ReadOptions, Turntable};

use super::values::{Choices, degrees, factor, hex_color, memory, one_of};

/// A hundred thousand names fit.
const LIST_BYTES: u64 = 1 << 24;

const AXES: &Choices<CameraAxes> = &[
    ("opencv", "x right, y down, looking along z", CameraAxes::OpenCv),
    ("opengl", "x right, y up, looking along -z", CameraAxes::OpenGl),
];

const POSES: &Choices<PoseDirection> = &[
    ("world-to-camera", "Matrices take the world into the camera", PoseDirection::WorldToCamera),
    ("camera-to-world", "Matrices take the camera into the world", PoseDirection::CameraToWorld),
];

/// How views are read.
#[derive(Args, Clone, Debug)]
#[allow(clippy::struct_excessive_bools, reason = "each is a switch of its own")]
pub(crate) struct Reading {
    /// Where masks come from: auto, alpha, files, backdrop, backdrop:RRGGBB:TOLERANCE, or color-model.
    ///
    /// `auto` takes mask files where the layout has them, else alpha. `backdrop` takes all that
    /// differs from a plain background, whose colour is found at the border unless it is given. `color-model` finds what
    /// all cameras look at before any background, by its colours in all views (`unsphere data mask` shows what it finds).
    #[arg(long, value_name = "SOURCE", default_value = "auto", value_parser = mask_source)]
    pub(crate) mask: MaskSource,
    /// A folder of masks, called as their images are: 7.png, 7.jpg.png, 7_mask.png or 7_seg.png for 7.jpg.
    #[arg(long, value_name = "FOLDER", conflicts_with = "mask")]
    pub(crate) masks: Option<PathBuf>,
    /// Of each mask keep the largest part that hangs together.
    #[arg(long)]
    pub(crate) largest_part: bool,
    /// Fill the holes of masks: what an object surrounds is object.
    #[arg(long)]
    pub(crate) fill_holes: bool,
    /// Dilate masks by so many pixels, with a disk, before the two above.
    #[arg(long, value_name = "PIXELS", default_value_t = 0, value_parser = clap::value_parser!(u32).range(..=64))]
    pub(crate) dilate_masks: u32,
    /// Then erode them by so many pixels: as many as they were dilated by close gaps and notches.
    #[arg(long, value_name = "PIXELS", default_value_t = 0, value_parser = clap::value_parser!(u32).range(..=64))]
    pub(crate) erode_masks: u32,
    /// Only the views that a text file names, one a line.
    #[arg(long, value_name = "FILE", value_parser = view_names)]
    pub(crate) only: Option<ViewNames>,
    /// Leave out these views: names as `data inspect` and `fit` say them.
    #[arg(long, value_name = "NAME,..", value_delimiter = ',')]
    pub(crate) except: Vec<String>,
    /// Masks mark the background instead of the object.
    #[arg(long)]
    pub(crate) invert_masks: bool,
    /// Average larger images down to this many pixels on their longer side.
    #[arg(long, value_name = "PIXELS", value_parser = clap::value_parser!(u32).range(8..))]
    pub(crate) max_size: Option<u32>,
    /// Stay within about so much memory, 2GB or 500MB: views that would take more are averaged down together.
    ///
    /// What counts is what is kept: for `fit` the part of each image around the object. While an image is read all of it is
    /// there beside, one for each thread.
    #[arg(long, value_name = "SIZE", allow_hyphen_values = true, value_parser = memory)]
    pub(crate) max_memory: Option<u64>,
    /// Leave out views whose files are missing or that have no mask, instead of refusing them all.
    #[arg(long)]
    pub(crate) allow_missing: bool,
    /// The cameras' axes, where they are not those that the layout has.
    #[arg(long, value_parser = one_of(AXES))]
    pub(crate) axes: Option<CameraAxes>,
    /// What the poses' matrices do, where it is not what the layout has.
    #[arg(long, value_parser = one_of(POSES))]
    pub(crate) poses: Option<PoseDirection>,
    /// Multiply focal lengths by this.
    #[arg(long, value_name = "FACTOR", value_parser = factor)]
    pub(crate) focal_scale: Option<f64>,
    /// Which object of a dataset of many: its name, or CATEGORY/NAME.
    #[arg(long, value_name = "NAME")]
    pub(crate) object: Option<String>,
    /// Photographs without cameras, one after another on a turntable: so many make a full turn.
    #[arg(long, value_name = "N", requires = "fov")]
    #[arg(value_parser = clap::value_parser!(u32).range(1..=100_000))]
    pub(crate) turntable: Option<u32>,
    /// How far above the object the turntable's camera stood, degrees.
    #[arg(long, value_name = "DEGREES", default_value_t = 0.0, allow_negative_numbers = true)]
    #[arg(value_parser = degrees, requires = "turntable")]
    pub(crate) elevation: f64,
    /// How far from the turntable's axis the camera stood; the mesh is in the same unit.
    #[arg(long, value_name = "LENGTH", default_value_t = 1.0, requires = "turntable")]
    pub(crate) distance: f64,
    /// The turntable's full vertical angle of view, degrees.
    #[arg(long, value_name = "DEGREES", requires = "turntable")]
    pub(crate) fov: Option<f64>,
    /// The object turns counter-clockwise seen from above, not clockwise.
    #[arg(long, requires = "turntable")]
    pub(crate) turntable_reverse: bool,
}

impl Reading {
    pub(crate) fn options(&self) -> ReadOptions {
        let defaults = ReadOptions::default();
        ReadOptions {
            mask: self.mask,
            memory_limit: self.max_memory.map_or(defaults.memory_limit, for_pixels),
            masks: self.masks.clone(),
            largest_part: self.largest_part,
            fill_holes: self.fill_holes,
            dilate: self.dilate_masks as usize,
            erode: self.erode_masks as usize,
            only: self.only.clone().map(|names| names.0),
            except: self.except.clone(),
            axes: self.axes,
            poses: self.poses,
            focal_scale: self.focal_scale,
            invert: self.invert_masks,
            max_size: self.max_size.map(|n| n as usize),
            shrink_to_limit: self.max_memory.is_some(),
            allow_missing: self.allow_missing,
            object: self.object.clone(),
            turntable: self.turntable.zip(self.fov).map(|(count, fov)| Turntable {
                count: count as usize,
                elevation: self.elevation,
                distance: self.distance,
                fov,
                reverse: self.turntable_reverse,
            }),
            ..defaults
        }
    }
}

/// What of so much memory is for pixels. A fit takes up to 0.4 GB and nearly half as much again beside them (docs/views.md has what was
/// measured), of small images less than that.
fn for_pixels(memory: u64) -> u64 {
    let memory = memory as f64;
    ((memory - 4e8) / 1.45).max(memory / 2.5) as u64
}

/// The views that a file names.
#[derive(Clone, Debug)]
pub(crate) struct ViewNames(Vec<String>);

fn view_names(path: &str) -> Result<ViewNames, String> {
    let mut text = String::new();
    let read = std::fs::File::open(path)
        .and_then(|file| file.take(LIST_BYTES + 1).read_to_string(&mut text));
    read.map_err(|error| error.to_string())?;
    // Cut, it would name another view at its end.
    if text.len() as u64 > LIST_BYTES {
        return Err("more than 16 MB, expected the names of views, one a line".to_owned());
    }
    let names: Vec<String> =
        text.lines().map(str::trim).filter(|name| !name.is_empty()).map(str::to_owned).collect();
    if names.is_empty() { Err("names no view".to_owned()) } else { Ok(ViewNames(names)) }
}

fn mask_source(text: &str) -> Result<MaskSource, String> {
    let mut parts = text.split(':');
    let source = match parts.next() {
        Some("auto") => MaskSource::Auto,
        Some("alpha") => MaskSource::Alpha,
        Some("files") => MaskSource::Files,
        Some("color-model") => MaskSource::ColorModel,
        Some("backdrop") => MaskSource::Backdrop {
            color: parts.next().filter(|c| !c.is_empty()).map(hex_color).transpose()?,
            tolerance: match parts.next() {
                None => 24,
                Some(number) => number.parse().map_err(|_| "tolerance: 0 to 255".to_owned())?,
            },
        },
        _ => {
            return Err(
                "expected auto, alpha, files, backdrop, backdrop:RRGGBB:TOLERANCE or color-model"
                    .into(),
            );
        }
    };
    match parts.next() {
        None => Ok(source),
        Some(rest) => Err(format!("nothing expected after the source, found {rest:?}")),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        reading: Reading,
    }

    fn options(line: &str) -> Result<ReadOptions, String> {
        let words = std::iter::once("x").chain(line.split(' ').filter(|word| !word.is_empty()));
        let line = <Line as clap::Parser>::try_parse_from(words);
        line.map(|line| line.reading.options()).map_err(|error| error.to_string())
    }

    #[test]
    fn what_is_said_of_a_turntable_needs_one() {
        assert_eq!(options("").unwrap().turntable, None);
        let table = options("--turntable 9 --fov 30 --elevation -20").unwrap().turntable.unwrap();
        assert_eq!((table.count, table.elevation, table.distance), (9, -20.0, 1.0));
        for alone in ["--elevation 20", "--distance 3", "--fov 30", "--turntable-reverse"] {
            assert!(options(alone).unwrap_err().contains("--turntable"), "{alone}");
        }
    }

    #[test]
    fn a_list_of_names_is_read_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("list.txt");
        let read = || view_names(path.to_str().unwrap());
        std::fs::write(&path, "a\n\n b \n").unwrap();
        assert_eq!(read().unwrap().0, ["a", "b"]);
        std::fs::write(&path, "0001\n".repeat((LIST_BYTES / 5) as usize + 1)).unwrap();
        assert!(read().unwrap_err().contains("16 MB"));
        std::fs::write(&path, "\n").unwrap();
        assert!(read().unwrap_err().contains("no view"));
    }

    #[test]
    fn sources_of_masks_are_read() {
        assert_eq!(mask_source("alpha"), Ok(MaskSource::Alpha));
        let backdrop = |color, tolerance| Ok(MaskSource::Backdrop { color, tolerance });
        assert_eq!(mask_source("backdrop"), backdrop(None, 24));
        assert_eq!(mask_source("backdrop:00ff10:9"), backdrop(Some([0, 255, 16]), 9));
        assert_eq!(mask_source("backdrop::9"), backdrop(None, 9));
        for wrong in ["", "green", "alpha:1", "backdrop:red", "backdrop:000000:999"] {
            assert!(mask_source(wrong).is_err(), "{wrong}");
        }
    }
}
