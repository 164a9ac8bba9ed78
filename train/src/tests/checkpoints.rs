//! Checkpoints that were damaged, or say what cannot be.

use std::path::PathBuf;

use super::super::checkpoint::seal;
use super::*;

/// A finished training of one epoch: its folder, its last checkpoint and that one's bytes.
fn finished(place: &Path) -> (PathBuf, Config, PathBuf, Vec<u8>) {
    let folder = place.join("run");
    let config = config(|c| c.train.epochs = 1);
    run_in(&folder, &config, false, &mut on()).unwrap();
    let path = folder.join("checkpoints/last.safetensors");
    let bytes = std::fs::read(&path).unwrap();
    (folder, config, path, bytes)
}

/// The bytes with one text in place of another; of the same length it leaves the header sound.
fn replaced(bytes: &[u8], from: &str, to: &str) -> Vec<u8> {
    let at = bytes.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
    let mut header = bytes[8..].to_owned();
    header.splice(at - 8..at - 8 + from.len(), to.bytes());
    let length = u64::from_le_bytes(bytes[..8].try_into().unwrap());
    let length = length + to.len() as u64 - from.len() as u64;
    [length.to_le_bytes().to_vec(), header].concat()
}

#[test]
fn what_cannot_be_is_named() {
    let place = tempfile::tempdir().unwrap();
    let (folder, config, path, sound) = finished(place.path());
    for cut in [0, 7, 8, 100, sound.len() / 2, sound.len() - 1] {
        std::fs::write(&path, &sound[..cut]).unwrap();
        let error = run_in(&folder, &config, true, &mut on()).unwrap_err();
        assert!(matches!(error, TrainError::Checkpoint(_)), "{error}");
        assert!(error.to_string().contains("last.safetensors"), "{error}");
    }
    let most = u64::MAX.to_string();
    let step = format!("\"step\":\"{most}\"");
    let best = format!("\"best\":\"1.0 at {most}\"");
    let average = |metadata: &str| {
        let from = metadata.find("\"average\":\"").unwrap();
        let length = metadata[from + 11..].find('"').unwrap() + 12;
        metadata[from..from + length].to_owned()
    };
    let text = String::from_utf8_lossy(&sound).into_owned();
    let best_was = text[text.find("\"best\":\"").unwrap()..].split("\",").next().unwrap();
    for (from, to, word) in [
        ("\"format\":\"2\"", "\"format\":\"3\"", "format"),
        ("\"system\":\"blob\"", "\"system\":\"blab\"", "system"),
        ("\"step\":\"4\"", "\"step\":\"x\"", "step"),
        ("\"step\":\"4\"", &step, "2^63"),
        (&format!("{best_was}\""), &best, "2^63"),
        (&average(&text), "\"average\":\"NaN\"", "average"),
        ("\"pending\":\"false\"", "\"pending\":\"nofal\"", "pending"),
        ("\"epochs-begun\":\"1\"", "\"epochs-begun\":\"9\"", "epochs-begun"),
        ("\"hidden.0\"", "\"hibben.0\"", "hidden.0"),
    ] {
        std::fs::write(&path, seal(replaced(&sound, from, to))).unwrap();
        let error = run_in(&folder, &config, true, &mut on()).unwrap_err().to_string();
        assert!(error.contains(word), "{from}: {error}");
    }
    // Moments of another length than their parameter's.
    let mut other = config.clone();
    other.system.hidden = 9;
    std::fs::write(&path, &sound).unwrap();
    let error = run_in(&folder, &other, true, &mut on()).unwrap_err().to_string();
    assert!(error.contains("hidden.0 is [8, 3] instead of [9, 3]"), "{error}");
    run_in(&folder, &config, true, &mut on()).unwrap();
}

/// No byte of a checkpoint can change without being noticed, the entry of the checksum included.
#[test]
fn damage_is_noticed_wherever_it_is() {
    let place = tempfile::tempdir().unwrap();
    let (_, _, path, sound) = finished(place.path());
    assert!(Checkpoint::read(&path).is_ok());
    let mut places: Vec<usize> = (0..sound.len()).step_by(997).collect();
    let at = sound.windows(8).position(|w| w == b"checksum").unwrap();
    places.extend(at - 2..at + 32);
    for at in places {
        let mut damaged = sound.clone();
        damaged[at] ^= 1;
        std::fs::write(&path, &damaged).unwrap();
        let error = Checkpoint::read(&path).unwrap_err().to_string();
        assert!(error.contains("last.safetensors"), "{at}: {error}");
    }
    let mut damaged = sound.clone();
    let middle = sound.len() / 2;
    damaged[middle..middle + 500].fill(0xff);
    std::fs::write(&path, &damaged).unwrap();
    let error = Checkpoint::read(&path).unwrap_err();
    assert!(matches!(error, CheckpointError::Damaged { .. }), "{error}");
    assert!(error.to_string().contains("damaged after it was written"), "{error}");
}

#[test]
fn those_of_the_first_format_have_no_checksum() {
    let place = tempfile::tempdir().unwrap();
    let (folder, mut config, path, sound) = finished(place.path());
    let at = sound.windows(12).position(|w| w == b"\"checksum\":\"").unwrap();
    let entry = String::from_utf8(sound[at..at + 30].to_vec()).unwrap();
    let former = replaced(&sound, &entry, "");
    let unversioned = former.clone();
    let former = replaced(&former, "\"format\":\"2\"", "\"format\":\"1\"");
    std::fs::write(&path, &former).unwrap();
    assert_eq!(Checkpoint::read(&path).unwrap().step().unwrap(), 4);
    config.train.epochs = 2;
    assert_eq!(run_in(&folder, &config, true, &mut on()).unwrap().steps, 8);
    // One of the present format has lost it.
    std::fs::write(&path, &unversioned).unwrap();
    let error = Checkpoint::read(&path).unwrap_err().to_string();
    assert!(error.contains("checksum"), "{error}");
}
