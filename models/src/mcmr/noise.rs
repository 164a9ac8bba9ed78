//! What a network is shown that is to see nothing.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use train::Fingerprint;

/// Noise in the place of an image: every byte is as likely, drawn by the image's own, so that the same image has the
/// same noise, and another crop of it another.
///
/// Not one colour for all: batch norm has nothing to norm where the images of a batch are equal. It then divides by its
/// `eps`, and what it has remembered from training, a few steps old, makes a scored prediction anything at all.
pub(super) fn noise(image: &[u8]) -> Vec<u8> {
    let mut rng = ChaCha8Rng::seed_from_u64(Fingerprint::new().with(image).value());
    let mut noise = vec![0; image.len()];
    rng.fill(&mut noise[..]);
    noise
}
