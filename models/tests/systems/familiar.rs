//! Whether the weights that come along know what they were trained on.

use std::path::Path;

use datasets::{ReadOptions, View, Views};
use models::img2mesh::Img2Mesh;
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
