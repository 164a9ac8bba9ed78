//! Every reader of bytes, for a moment each: whatever the bytes, no panic, and memory in proportion.
//!
//! The coverage-guided run of the same functions is in `fuzz/`; this one changes their seeds blindly,
//! by a fixed stream of random numbers. `FUZZ_SECONDS` makes it longer, `FUZZ_SEED` another one.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "../../datasets/tests/counting/mod.rs"]
mod counting;
#[path = "../../fuzz/targets/mod.rs"]
mod targets;

use std::time::{Duration, Instant};

use counting::{limit, peak};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use targets::TARGETS;

/// Words that readers of some format look for, or that claim much.
const WORDS: [&[u8]; 16] = [
    b"\n",
    b"-1",
    b"99999999999999",
    b"nan",
    b"1e39",
    b"../",
    b"[[[[",
    b"{\"a\":",
    b"((((",
    b"h\0R",
    b"\xff\xff\xff\xff",
    b"\xff\xff\xff\x7f",
    b"\0\0\0\0",
    b"\0\0\0\x80",
    b"/",
    b"\xc3\xa9",
];

/// One or a few changes of a seed, which a part of another may follow.
fn changed(random: &mut ChaCha8Rng, seeds: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = seeds[random.random_range(0..seeds.len())].clone();
    for _ in 0..random.random_range(1..6) {
        let n = bytes.len();
        if n == 0 {
            break;
        }
        let at = random.random_range(0..n);
        match random.random_range(0..9) {
            0 => bytes[at] = random.next_u32() as u8,
            1 => bytes[at] ^= 1 << random.random_range(0..8_u32),
            2 => bytes.truncate(at),
            3 => drop(bytes.drain(at..(at + random.random_range(1..20)).min(n))),
            4 => {
                let word = WORDS[random.random_range(0..WORDS.len())];
                bytes.splice(at..at, word.iter().copied());
            }
            5 => {
                let word = WORDS[random.random_range(0..WORDS.len())];
                let end = (at + word.len()).min(n);
                bytes[at..end].copy_from_slice(&word[..end - at]);
            }
            6 => {
                let part = bytes[at..(at + random.random_range(1..64)).min(n)].to_vec();
                let to = random.random_range(0..n);
                bytes.splice(to..to, part);
            }
            7 => {
                let other = &seeds[random.random_range(0..seeds.len())];
                let from = random.random_range(0..other.len().max(1)).min(other.len());
                bytes.splice(at.., other[from..].iter().copied());
            }
            _ => {
                if let Some(digit) = bytes[at..].iter().position(u8::is_ascii_digit) {
                    bytes[at + digit] = b'0' + random.random_range(0..10);
                }
            }
        }
    }
    bytes
}

fn variable(name: &str, otherwise: f64) -> f64 {
    std::env::var(name).ok().and_then(|text| text.parse().ok()).unwrap_or(otherwise)
}

#[test]
fn every_reader_survives_what_its_seeds_are_changed_into() {
    let time = Duration::from_secs_f64(variable("FUZZ_SECONDS", 0.3));
    let mut seeds_of_all = 0;
    for (stream, target) in TARGETS.iter().enumerate() {
        let seeds = (target.seeds)();
        assert!(!seeds.is_empty() && seeds.iter().all(|seed| !seed.is_empty()), "{}", target.name);
        seeds_of_all += seeds.iter().map(Vec::len).sum::<usize>();
        let mut random = ChaCha8Rng::seed_from_u64(variable("FUZZ_SEED", 29.0) as u64);
        random.set_stream(stream as u64);
        let tried = |bytes: &[u8]| {
            let (taken, result) = peak(|| std::panic::catch_unwind(|| (target.run)(bytes)));
            let kept = || {
                let path = std::env::temp_dir().join(format!("fuzz-{}", target.name));
                std::fs::write(&path, bytes).unwrap();
                path.display().to_string()
            };
            assert!(result.is_ok(), "{}: a panic over {}", target.name, kept());
            assert!(taken <= limit(bytes.len()), "{}: {taken} bytes for {}", target.name, kept());
        };
        for seed in &seeds {
            tried(seed);
        }
        let start = Instant::now();
        while start.elapsed() < time {
            tried(&changed(&mut random, &seeds));
        }
    }
    assert!(seeds_of_all < 200_000, "{seeds_of_all} bytes of seeds");
}
