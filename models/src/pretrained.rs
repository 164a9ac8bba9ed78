//! Weights that others trained, which a configuration names.

use nets::WeightsError;
use train::DataError;

/// Why a file of weights does not serve. Of one that cannot be read with the system's reason, which the error itself leaves to its
/// source: whoever shows a text alone would lose it.
pub(crate) fn unusable(error: WeightsError) -> DataError {
    match &error {
        WeightsError::Io { source, .. } => DataError::Unfit(format!("{error}: {source}")),
        _ => DataError::read(error),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use datasets::ReadOptions;
    use train::{Source, System};

    use crate::depth::DepthPixel2Mesh;
    use crate::img2mesh::Img2Mesh;
    use crate::mcmr::Mcmr;
    use crate::testing::preset_with;

    const NOWHERE: &str = "no/such/weights.pth";

    /// What ends the beginning of a training by the preset `tiny` with these settings.
    fn refusal<S: System<ReadOptions = ReadOptions>>(settings: &[(&str, &str)]) -> String {
        let config = &preset_with::<S>("tiny", settings).system;
        let options = ReadOptions::default();
        let source = Source { path: None, options: &options, seed: 0, progress: &|_, _| () };
        let begun = |data| S::new(config, 0).init_from_data(&data, None);
        S::open(config, &source).and_then(begun).unwrap_err().to_string()
    }

    #[test]
    fn weights_that_cannot_be_read_say_why() {
        let reason = std::fs::read(NOWHERE).unwrap_err().to_string();
        let weights = ("weights", NOWHERE);
        for error in [
            refusal::<DepthPixel2Mesh>(&[weights]),
            refusal::<Img2Mesh>(&[weights, ("encoder", "vgg16")]),
            refusal::<Mcmr>(&[weights]),
            refusal::<Mcmr>(&[("inception-weights", NOWHERE)]),
        ] {
            assert!(error.contains(NOWHERE) && error.contains(&reason), "{error}");
        }
    }
}
