//! `unsphere data depth`: the disparity of images, by a network in ONNX's form.

use crate::args::Depth;
use crate::console::Console;
use crate::failure::Failure;

#[cfg(not(feature = "onnx"))]
pub(crate) fn run(_: Console, arguments: &Depth) -> Result<(), Failure> {
    Err(Failure::Usage(format!(
        "{}: this unsphere was built without the feature onnx, which runs networks; build it with \
         cargo install --path cli --features onnx",
        arguments.model.display()
    )))
}

#[cfg(feature = "onnx")]
pub(crate) use estimate::run;

#[cfg(feature = "onnx")]
mod estimate {
    use std::collections::BTreeSet;
    use std::fmt::Write as _;
    use std::path::{Path, PathBuf};

    use datasets::{DepthEstimator, DepthInput};
    use mesh_core::{
        ByteImage, DisparityMap, GroundPlane, Image, encode_pfm, encode_png, read_image,
    };
    use serde::Serialize;
    use train::output::OutputFolder;

    use super::{Console, Depth, Failure};
    use crate::args::{DepthModelKind, create};
    use crate::interrupt::Interrupt;
    use crate::progress::Progress;

    /// What is printed with `--json`.
    #[derive(Debug, Serialize)]
    struct Estimated<'a> {
        #[serde(serialize_with = "train::path_text::serialize")]
        output: &'a Path,
        pictures: Vec<Picture>,
    }

    #[derive(Debug, Serialize)]
    struct Picture {
        #[serde(serialize_with = "train::path_text::serialize")]
        path: PathBuf,
        file: String,
        /// The smallest and the largest disparity.
        range: [f32; 2],
        /// Whether the object seems to stand on a floor; `null` where the image has no mask.
        floor: Option<bool>,
    }

    pub(crate) fn run(console: Console, arguments: &Depth) -> Result<(), Failure> {
        // Refusals come before the work.
        let folder = create(&arguments.output, arguments.force)?;
        // Nothing is kept of what is not finished.
        let _interrupt = Interrupt::listen(Some(folder.unfinished()))?;
        let names = names(&arguments.pictures)?;
        let input = match arguments.kind {
            DepthModelKind::MidasSmall => DepthInput::midas_small(),
            DepthModelKind::Midas => DepthInput::midas(),
            DepthModelKind::MidasDpt => DepthInput::midas_dpt(),
            DepthModelKind::DepthAnything => DepthInput::depth_anything(),
        };
        let estimator = DepthEstimator::open(&arguments.model, input).map_err(Failure::input)?;
        let progress = Progress::new(console, "depth");
        let mut pictures = Vec::new();
        for (done, (path, name)) in arguments.pictures.iter().zip(names).enumerate() {
            progress.set(done, arguments.pictures.len());
            let picture = read_image(path).map_err(Failure::input)?;
            let seen = picture.over(arguments.background);
            let disparity = estimator.estimate(&seen).map_err(Failure::input)?;
            let range = range(&disparity);
            folder.write(&format!("{name}.png"), &encode_png(&gray(&disparity, range)))?;
            let floor = picture.alpha().map(|mask| GroundPlane::find(&disparity, &mask).is_some());
            let DisparityMap { height, width, data } = disparity;
            let file = format!("{name}.pfm");
            folder.write(&file, &encode_pfm(&Image { height, width, channels: 1, data }))?;
            pictures.push(Picture { path: path.clone(), file, range, floor });
        }
        progress.finish();
        let output = folder.commit()?;
        console.result(&Estimated { output: &output, pictures }, describe)
    }

    fn describe(estimated: &Estimated<'_>) -> String {
        let mut text = String::new();
        for Picture { path, file, range, floor } in &estimated.pictures {
            let _ = write!(
                text,
                "{}: disparity {} to {} in {}",
                path.display(),
                range[0],
                range[1],
                estimated.output.join(file).display()
            );
            text += match floor {
                Some(true) => "; a floor beneath the object, which the image has not\n",
                _ => "\n",
            };
        }
        text
    }

    /// A name for each result: that of the image without its extension.
    fn names(pictures: &[PathBuf]) -> Result<Vec<String>, Failure> {
        let mut seen = BTreeSet::new();
        let name = |path: &PathBuf| {
            let stem = path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
            let stem = stem.filter(|stem| seen.insert(stem.clone()));
            let twice = || format!("{}: a second image of that name", path.display());
            stem.ok_or_else(|| Failure::Usage(twice()))
        };
        pictures.iter().map(name).collect()
    }

    fn range(disparity: &DisparityMap) -> [f32; 2] {
        let known = disparity.data.iter().copied().filter(|v| v.is_finite());
        known.fold([f32::INFINITY, f32::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)])
    }

    /// Black where it is farthest, white where it is nearest.
    fn gray(disparity: &DisparityMap, [low, high]: [f32; 2]) -> ByteImage {
        let scale = if high > low { 1.0 / (high - low) } else { 0.0 };
        let data = disparity.data.iter().map(|v| (v - low) * scale).collect();
        Image { height: disparity.height, width: disparity.width, channels: 1, data }.to_bytes()
    }

    #[cfg(test)]
    mod tests {
        use super::*;

        #[test]
        fn what_is_near_is_white_and_what_is_far_is_black() {
            let data = vec![3.0, 4.0, 5.0, f32::NAN];
            let disparity = DisparityMap { height: 2, width: 2, data };
            let range = range(&disparity);
            assert_eq!(range, [3.0, 5.0]);
            let picture = gray(&disparity, range);
            assert_eq!((picture.height, picture.width, picture.channels), (2, 2, 1));
            assert_eq!(picture.data[..3], [0, 128, 255]);
            let flat = DisparityMap { height: 1, width: 2, data: vec![2.0; 2] };
            assert_eq!(gray(&flat, [2.0, 2.0]).data, [0, 0]);
        }
    }
}
