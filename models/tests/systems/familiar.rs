//! Whether a system knows what it was trained on.

use datasets::{ReadOptions, Views};
use models::img2mesh::Img2Mesh;
use models::predict::{Choice, Familiarity, PredictInput, Predictor};
use train::{Configuration, Source, Subset, System, settings};

/// Even a network that learned nothing tells its objects from noise.
#[test]
fn noise_is_farther_than_objects() {
    let set = [("objects", "40"), ("families", "[\"car\", \"chair\"]"), ("test-objects", "12")];
    let set = set.map(|(name, value)| (name.to_owned(), value.to_owned()));
    let (name, preset) = Img2Mesh::PRESETS[0];
    let config: Configuration<<Img2Mesh as System>::Config> =
        settings::read_text(name.as_ref(), preset, &set).unwrap();
    let options = ReadOptions::default();
    let source = Source { path: None, options: &options, seed: 3, progress: &|_, _| () };
    let data = Img2Mesh::open(&config.system, &source).unwrap();
    let system = Img2Mesh::new(&config.system, 3);
    let familiarity = Familiarity::of_data(&system, &data).unwrap().unwrap();
    let judged = |noise: bool| -> Vec<f64> {
        let quantile = |k: usize| {
            let mut views = data.group((Subset::Test, 2), k).unwrap().given;
            if noise {
                for (i, view) in views.iter_mut().enumerate() {
                    view.mask.data.fill(255);
                    let width = 3 * view.color.width;
                    for (p, byte) in view.color.data.iter_mut().enumerate() {
                        // Patches of loud colours all over the image.
                        let patch = (p / width / 16) * 31 + (p % width / 48) * 17 + p % 3 * 7;
                        *byte = if (patch + 5 * k + i) % 5 < 3 { 255 } else { 0 };
                    }
                }
            }
            let input = PredictInput::part(Views::in_memory(views), Choice::All).unwrap();
            let prediction = system.apply(&input).unwrap();
            familiarity.judge(&prediction.features).unwrap().quantile
        };
        (0..6).map(quantile).collect()
    };
    let (own, noise) = (judged(false), judged(true));
    assert!(own.iter().sum::<f64>() < 4.5, "{own:?}");
    assert_eq!(noise, [1.0; 6]);
}
