//! Every reader of bytes, for a moment each: whatever the bytes, no panic, and memory in proportion.
//!
//! The coverage-guided run of the same functions is in `fuzz/`; this one changes their seeds blindly,
//! by a fixed stream of random numbers. `FUZZ_SECONDS` makes it longer, `FUZZ_SEED` another one.
#![allow(clippy::unwrap_used, reason = "tests")]

#[path = "../../mesh-core/tests/counting/mod.rs"]
mod counting;
#[path = "../../fuzz/targets/mod.rs"]
mod targets;

use std::time::{Duration, Instant};

use counting::{alone, limit, peak};
use rand::{Rng, RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use targets::{TARGETS, Target};

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

/// What an image of 128 megapixels may take beyond that: it is unpacked, and put into another form.
const IMAGE: usize = 2 * 4 * 128_000_000;

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

/// Runs a target once: what it did wrong, and where the bytes are that made it do so.
fn tried(target: &Target, bytes: &[u8]) -> Result<(), String> {
    let (taken, result) = peak(|| std::panic::catch_unwind(|| (target.run)(bytes)));
    let most = limit(bytes.len()) + if target.images { IMAGE } else { 0 };
    let what = match result {
        Err(_) => "a panic".to_owned(),
        Ok(()) if taken > most => format!("{taken} bytes of memory, at most {most}"),
        Ok(()) => return Ok(()),
    };
    let path = std::env::temp_dir().join(format!("fuzz-{}", target.name));
    std::fs::write(&path, bytes).unwrap();
    Err(format!("{}: {what}, over {}", target.name, path.display()))
}

/// How often a target ran within the time; it ends at the first thing that goes wrong.
fn fuzzed(target: &Target, stream: u64, seeds: &[Vec<u8>], time: Duration) -> Result<u64, String> {
    let mut random = ChaCha8Rng::seed_from_u64(variable("FUZZ_SEED", 29.0) as u64);
    random.set_stream(stream);
    for seed in seeds {
        tried(target, seed)?;
    }
    let (start, mut runs) = (Instant::now(), 0);
    while start.elapsed() < time {
        tried(target, &changed(&mut random, seeds))?;
        runs += 1;
    }
    Ok(runs)
}

#[test]
fn only_readers_of_images_may_take_an_images_memory() {
    let _alone = alone();
    let greedy = |images| Target {
        name: "greedy",
        run: |_| drop(std::hint::black_box(Vec::<u8>::with_capacity(500_000_000))),
        seeds: Vec::new,
        images,
    };
    assert_eq!(tried(&greedy(true), b"any"), Ok(()));
    let error = tried(&greedy(false), b"any").unwrap_err();
    // To the byte only the limit is known: the test's own harness may allocate meanwhile.
    assert!(error.starts_with("greedy: 5000"), "{error}");
    assert!(error.contains(" bytes of memory, at most 256000060, over "), "{error}");
    std::fs::remove_file(std::env::temp_dir().join("fuzz-greedy")).unwrap();
}

#[test]
fn every_reader_survives_what_its_seeds_are_changed_into() {
    let _alone = alone();
    let time = Duration::from_secs_f64(variable("FUZZ_SECONDS", 0.3));
    let (mut seeds_of_all, mut runs, mut wrong) = (0, 0, Vec::new());
    for (stream, target) in TARGETS.iter().enumerate() {
        let seeds = (target.seeds)();
        assert!(!seeds.is_empty() && seeds.iter().all(|seed| !seed.is_empty()), "{}", target.name);
        seeds_of_all += seeds.iter().map(Vec::len).sum::<usize>();
        match fuzzed(target, stream as u64, &seeds, time) {
            Ok(more) => runs += more,
            Err(what) => wrong.push(what),
        }
    }
    assert!(wrong.is_empty(), "after {runs} runs: {}", wrong.join("; "));
    assert!(seeds_of_all < 200_000, "{seeds_of_all} bytes of seeds");
}
