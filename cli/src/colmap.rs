//! COLMAP as a child: from images to cameras.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::Command;

use crate::child;
use crate::failure::Failure;
use crate::interrupt::Interrupt;

/// What is said where it is not installed.
const INSTALL: &str = "install it with `apt-get install colmap` (Debian, Ubuntu), `brew install colmap` (macOS) or \
                       `conda install -c conda-forge colmap`, or name the program with --colmap";

/// The program, and what its release calls things.
#[derive(Clone, Debug)]
pub(crate) struct Colmap {
    program: PathBuf,
    /// The option that keeps the extractor off a GPU, and that of the matcher: `SiftExtraction.use_gpu` until 3.11.
    gpu: [&'static str; 2],
    /// Threads that it may use; as many as there are cores where none.
    threads: u16,
}

/// How COLMAP is asked.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Asked<'a> {
    /// The model of the lens, by COLMAP's name.
    pub(crate) lens: &'a str,
    /// Whether all images were taken with one lens at one setting.
    pub(crate) one_lens: bool,
    /// Whether images are matched with those that follow them only.
    pub(crate) sequential: bool,
}

impl Colmap {
    /// Finds the program, and asks it for the names of its options.
    ///
    /// # Errors
    /// If it is not there; the message says how it is installed.
    pub(crate) fn find(program: &Path, threads: u16) -> Result<Self, Failure> {
        let found = child::find(program, std::env::var_os("PATH").as_deref());
        let missing =
            || Failure::Other(format!("{}: COLMAP is not there: {INSTALL}", program.display()));
        let program = found.ok_or_else(missing)?;
        let has = |verb: &str, option: &str| {
            let text = child::answer(Command::new(&program).args([verb, "-h"]))?;
            Ok::<bool, Failure>(text.contains(option))
        };
        let extraction = if has("feature_extractor", "FeatureExtraction.use_gpu")? {
            "FeatureExtraction"
        } else {
            "SiftExtraction"
        };
        let matching = if has("exhaustive_matcher", "FeatureMatching.use_gpu")? {
            "FeatureMatching"
        } else {
            "SiftMatching"
        };
        Ok(Self { program, gpu: [extraction, matching], threads })
    }

    /// The steps from images to a sparse model, in words and as arguments; `work` gets a database and `sparse`.
    fn steps(
        &self,
        images: &Path,
        work: &Path,
        asked: Asked<'_>,
    ) -> Vec<(&'static str, Vec<OsString>)> {
        let database = work.join("database.db");
        let threads = match self.threads {
            0 => "-1".to_owned(),
            n => n.to_string(),
        };
        let [extraction, matching] = self.gpu;
        let plain = |words: &[&str]| words.iter().map(OsString::from).collect::<Vec<_>>();
        let with = |mut words: Vec<OsString>, option: &str, value: &dyn AsRef<std::ffi::OsStr>| {
            words.push(format!("--{option}").into());
            words.push(value.as_ref().to_owned());
            words
        };
        let mut features = plain(&["feature_extractor"]);
        features = with(features, "database_path", &database);
        features = with(features, "image_path", &images);
        features = with(features, "ImageReader.camera_model", &asked.lens);
        features =
            with(features, "ImageReader.single_camera", &if asked.one_lens { "1" } else { "0" });
        features = with(features, &format!("{extraction}.use_gpu"), &"0");
        features = with(features, &format!("{extraction}.num_threads"), &threads);
        let matcher = if asked.sequential { "sequential_matcher" } else { "exhaustive_matcher" };
        let mut matches = with(plain(&[matcher]), "database_path", &database);
        matches = with(matches, &format!("{matching}.use_gpu"), &"0");
        matches = with(matches, &format!("{matching}.num_threads"), &threads);
        let mut mapper = with(plain(&["mapper"]), "database_path", &database);
        mapper = with(mapper, "image_path", &images);
        mapper = with(mapper, "output_path", &work.join("sparse"));
        mapper = with(mapper, "Mapper.num_threads", &threads);
        vec![("features", features), ("matches", matches), ("cameras", mapper)]
    }

    /// Finds the cameras of the images: the folder of the largest model, and how many images it has.
    ///
    /// # Errors
    /// If a step fails, finds no model, or Ctrl-C was pressed.
    pub(crate) fn reconstruct(
        &self,
        images: &Path,
        work: &Path,
        asked: Asked<'_>,
        interrupt: &Interrupt,
        mut step: impl FnMut(&'static str),
    ) -> Result<(PathBuf, u64), Failure> {
        let sparse = work.join("sparse");
        std::fs::create_dir_all(&sparse).map_err(Failure::other)?;
        for (name, arguments) in self.steps(images, work, asked) {
            step(name);
            let mut command = Command::new(&self.program);
            command.args(arguments);
            // It opens a display for its GPU code, and needs none without.
            command.env("QT_QPA_PLATFORM", "offscreen");
            child::run(&mut command, &work.join(format!("{name}.log")), interrupt, || ())?;
        }
        largest(&sparse)?.ok_or_else(|| {
            Failure::Input(
                "COLMAP found no cameras: photographs must overlap, and what they show must have details (a printed cloth \
                 under a plain object helps)"
                    .to_owned(),
            )
        })
    }
}

/// The model with the most images among those in a folder; the first of them where they are as many.
fn largest(sparse: &Path) -> Result<Option<(PathBuf, u64)>, Failure> {
    let mut models = Vec::new();
    for entry in std::fs::read_dir(sparse).map_err(Failure::other)? {
        let path = entry.map_err(Failure::other)?.path();
        if let Some(count) = count(&path.join("images.bin")) {
            models.push((path, count));
        }
    }
    models.sort_by(|a, b| b.1.cmp(&a.1).then_with(|| a.0.cmp(&b.0)));
    Ok(models.into_iter().next())
}

/// How many images a model's file begins with.
fn count(file: &Path) -> Option<u64> {
    use std::io::Read;
    let mut bytes = [0; 8];
    std::fs::File::open(file).ok()?.read_exact(&mut bytes).ok()?;
    Some(u64::from_le_bytes(bytes)).filter(|&n| n > 0)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;

    #[test]
    fn the_largest_model_is_taken() {
        let place = tempfile::tempdir().unwrap();
        assert_eq!(largest(place.path()).unwrap(), None);
        for (name, count) in [("0", 3u64), ("1", 12), ("2", 12), ("3", 0)] {
            std::fs::create_dir(place.path().join(name)).unwrap();
            let mut bytes = count.to_le_bytes().to_vec();
            bytes.extend([1; 20]);
            std::fs::write(place.path().join(name).join("images.bin"), bytes).unwrap();
        }
        std::fs::create_dir(place.path().join("4")).unwrap();
        assert_eq!(largest(place.path()).unwrap(), Some((place.path().join("1"), 12)));
    }

    #[test]
    fn every_step_keeps_off_the_gpu() {
        let colmap = Colmap {
            program: "colmap".into(),
            gpu: ["SiftExtraction", "FeatureMatching"],
            threads: 3,
        };
        let asked = Asked { lens: "OPENCV", one_lens: true, sequential: true };
        let steps = colmap.steps(Path::new("in"), Path::new("work"), asked);
        let words = |k: usize| {
            let words: Vec<_> =
                steps[k].1.iter().map(|w| w.to_string_lossy().into_owned()).collect();
            words.join(" ")
        };
        assert_eq!(
            words(0),
            "feature_extractor --database_path work/database.db --image_path in --ImageReader.camera_model OPENCV \
             --ImageReader.single_camera 1 --SiftExtraction.use_gpu 0 --SiftExtraction.num_threads 3"
        );
        assert_eq!(
            words(1),
            "sequential_matcher --database_path work/database.db --FeatureMatching.use_gpu 0 --FeatureMatching.num_threads 3"
        );
        assert!(words(2).starts_with("mapper ") && words(2).contains("--output_path work/sparse"));
    }
}
