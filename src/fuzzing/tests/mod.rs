//! The corpus of every target, and mutations of it, through its function; and the corpus itself:
//! `COVIS_TEST_RECORD_CORPUS=1` writes the seeds anew. Inputs that once broke something stand
//! beside them under names of their own and are kept.

mod seeds;
mod wire_seeds;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::{TARGETS, Target};

/// Mutations of a target's corpus; more of them are the fuzzer's business.
const MUTATIONS: usize = 1000;

fn corpus(target: &Target) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(target.name)
}

/// The inputs with their names, in order.
fn inputs(target: &Target) -> Vec<(String, Vec<u8>)> {
    let folder = corpus(target);
    let entries = fs_err::read_dir(&folder).unwrap();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
    paths.iter().map(|path| (name(path), fs_err::read(path).unwrap())).collect()
}

/// Runs an input; a panic names it.
fn run(target: &Target, name: &str, input: &[u8]) {
    if let Err(panic) = catch_unwind(AssertUnwindSafe(|| (target.run)(input))) {
        let text = panic.downcast_ref::<String>().map(String::as_str);
        let text = text.or(panic.downcast_ref::<&str>().copied()).unwrap_or_default();
        panic!("{} {name}: {text}: {input:02x?}", target.name);
    }
}

/// Changes bytes, cuts, repeats or joins with another input.
fn mutate(bytes: &mut Vec<u8>, other: &[u8], rng: &mut ChaCha8Rng) {
    for _ in 0..rng.random_range(1..4) {
        let at = rng.random_range(0..=bytes.len());
        let end = rng.random_range(at..=bytes.len());
        match rng.random_range(0..6) {
            0 => bytes.truncate(at),
            1 => drop(bytes.drain(at..end.min(at + 8))),
            2 => bytes.extend_from_slice(&other[..at.min(other.len())]),
            3 => bytes.insert(at, rng.random()),
            4 => bytes.extend_from_within(at..end.min(at + 64)),
            _ if at < bytes.len() => {
                let values = [0, 1, 0x7f, 0x80, 0xff, bytes[at] ^ (1 << rng.random_range(0..8))];
                bytes[at] = values[rng.random_range(0..values.len())];
            }
            _ => {}
        }
    }
}

#[test]
fn the_corpus_and_its_mutations_break_nothing() {
    if std::env::var_os("COVIS_TEST_RECORD_CORPUS").is_some() {
        for (target, name, bytes) in seeds::all() {
            let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus").join(target);
            fs_err::create_dir_all(&folder).unwrap();
            fs_err::write(folder.join(name), bytes).unwrap();
        }
    }
    for (seed, target) in (0..).zip(&TARGETS) {
        let inputs = inputs(target);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        for (name, input) in &inputs {
            run(target, name, input);
        }
        for round in 0..MUTATIONS {
            let (name, input) = &inputs[rng.random_range(0..inputs.len())];
            let other = &inputs[rng.random_range(0..inputs.len())].1;
            let mut input = input.clone();
            mutate(&mut input, other, &mut rng);
            run(target, &format!("{name}, mutation {round}"), &input);
        }
    }
}

#[test]
fn every_target_has_a_small_corpus() {
    for target in &TARGETS {
        let inputs = inputs(target);
        assert!((5..=40).contains(&inputs.len()), "{}: {} inputs", target.name, inputs.len());
        let large = inputs.iter().filter(|(_, input)| input.len() > 16_000);
        assert_eq!(large.count(), 0, "{}", target.name);
    }
    let corpora = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/corpus");
    assert_eq!(fs_err::read_dir(corpora).unwrap().count(), TARGETS.len());
}
