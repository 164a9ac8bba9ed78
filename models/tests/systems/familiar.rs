//! Whether the weights that come along know what they were trained on.

use std::path::Path;

use datasets::{ReadOptions, View, Views};
use models::img2mesh::Img2Mesh;
use models::mcmr::{Mcmr, McmrConfig};
use models::predict::{Choice, Familiarity, PredictInput, Predictor};
use train::{Checkpoint, Source, Subset, System};

/// Patches of loud colours all over the image.
fn noise(view: &mut View, seed: usize) {
    view.mask.data.fill(255);
    let row = 3 * view.color.width;
    for (p, byte) in view.color.data.iter_mut().enumerate() {
        let patch = (p / row / 16) * 31 + (p % row / 48) * 17 + p % 3 * 7;
        *byte = if (patch + seed) % 5 < 3 { 255 } else { 0 };
    }
}

#[test]
fn noise_is_farther_than_objects() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights/img2mesh.safetensors");
    let checkpoint = Checkpoint::read(&file).unwrap();
    let (system, config) = checkpoint.load::<Img2Mesh>().unwrap();
    let familiarity = Familiarity::of(&checkpoint).unwrap().unwrap();
    let options = ReadOptions::default();
    let source = Source { path: None, options: &options, seed: 0, progress: &|_, _| () };
    let data = Img2Mesh::open(&config.system, &source).unwrap();
    // One test object of each of five families.
    let strange = |noisy: bool| {
        let judged = (0..5).filter(|&family| {
            let mut given = data.group((Subset::Test, 2), 20 * family).unwrap().given;
            if noisy {
                given.iter_mut().enumerate().for_each(|(i, view)| noise(view, family + i));
            }
            let input = PredictInput::part(Views::in_memory(given), Choice::All).unwrap();
            let prediction = system.apply(&input).unwrap();
            familiarity.judge(&prediction.features).unwrap().is_strange()
        });
        judged.count()
    };
    assert_eq!((strange(false), strange(true)), (0, 5));
}

/// What a photograph says that MCMR never saw the like of.
#[test]
fn lamps_are_farther_than_airplanes_and_cars() {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights/mcmr.safetensors");
    let checkpoint = Checkpoint::read(&file).unwrap();
    let (system, config) = checkpoint.load::<Mcmr>().unwrap();
    let familiarity = Familiarity::of(&checkpoint).unwrap().unwrap();
    let farthest_first = |families: &[&str]| -> Vec<f64> {
        let families = families.iter().map(|&family| family.to_owned()).collect();
        let few = McmrConfig { families, objects: 1, test_objects: 6, ..config.system.clone() };
        let data = models::mcmr::Data::synthetic(&few).unwrap();
        let seen = system.features_of(&data, Subset::Test, 12).unwrap();
        let mut distances: Vec<f64> =
            seen.iter().map(|one| familiarity.judge(&one.features).unwrap().distance).collect();
        distances.sort_by(|a, b| b.total_cmp(a));
        distances
    };
    let (known, others) = (farthest_first(&["airplane", "car"]), farthest_first(&["lamp"]));
    assert_eq!((known.len(), others.len()), (12, 6));
    // The middle one of the lamps, and all but two of the others.
    assert!(others[3] > known[2], "{known:?} {others:?}");
}
