//! Weights by the rule of `fixtures/make_resnet.py`, which makes the same in Python.

use std::path::{Path, PathBuf};

use autodiff_lite::Real;

/// A file written by Python.
pub(crate) fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(name)
}

/// Numbers in [-1, 1) for the k-th array.
pub(crate) fn numbers(k: usize, count: usize) -> Vec<f64> {
    let number = |i: usize| {
        let mut x = (i as u64 * 2_654_435_761 + (k as u64 + 1) * 40_503) & 0xFFFF_FFFF;
        x ^= x >> 15;
        x = x.wrapping_mul(2_246_822_519) & 0xFFFF_FFFF;
        x ^= x >> 13;
        x as f64 / 2.0_f64.powi(31) - 1.0
    };
    (0..count).map(number).collect()
}

/// The product with a wave, and the sum of absolute values.
pub(crate) fn sums<'a, F: Real>(x: impl Iterator<Item = &'a F>) -> [f64; 2] {
    x.enumerate().fold([0.0; 2], |[wave, size], (i, &x)| {
        let x = Real::to_f64(x);
        [wave + x * (i as f64).cos(), size + x.abs()]
    })
}

/// Within a tolerance, relative to `scale` where that is above one.
pub(crate) fn close(what: &str, found: &[f64], expected: &[f64], tolerance: f64, scale: f64) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (f, e) in found.iter().zip(expected) {
        assert!((f - e).abs() <= tolerance * scale.max(1.0), "{what}: {f} instead of {e}");
    }
}
