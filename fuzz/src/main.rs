//! Holds every target, or those that are named, to its memory: inputs of up to 1 MiB that are made to
//! take much, one after another, under the allocator that ends the process past 64 MiB.
#![allow(clippy::print_stdout, reason = "a program that tells what it measured")]

use std::path::Path;
use std::time::Instant;

/// Bytes: the most that the promise is for, and what is still read of the files that have a limit.
const LENGTHS: [usize; 2] = [1 << 20, 1 << 18];

fn main() -> std::io::Result<()> {
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    let is_wanted = |name: &&str| wanted.is_empty() || wanted.iter().any(|w| w == name);
    for target in covis_fuzz::targets().into_iter().filter(is_wanted) {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus").join(target);
        let mut corpus = Vec::new();
        for entry in std::fs::read_dir(folder)? {
            corpus.push(std::fs::read(entry?.path())?);
        }
        let (begin, mut count) = (Instant::now(), 0);
        let mut slowest = std::time::Duration::ZERO;
        covis_fuzz::forget_peak();
        for length in LENGTHS {
            covis_fuzz::largest(target, &corpus, length, &mut |input| {
                let begin = Instant::now();
                covis_fuzz::run(target, input);
                slowest = slowest.max(begin.elapsed());
                count += 1;
            });
        }
        let (peak, seconds) = (covis_fuzz::peak() >> 10, begin.elapsed().as_secs_f64());
        let slowest = slowest.as_secs_f64();
        println!(
            "{target:16} {count:5} large inputs {peak:6} KiB held, {seconds:.1} s, slowest {slowest:.2} s"
        );
    }
    Ok(())
}
