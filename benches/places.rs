//! Place recognition in large maps: times of an addition and of a query, memory, recall at precision 1.
//!
//! `cargo bench --bench places -- [--keyframes N] [--descriptors N] [--flipped SHARE] [--seed N]`
//!
//! A way is walked, and six tenths through it is walked again. A point is in sight for twelve
//! keyframes, is seen in six of ten of them, and each view changes `flipped` of the bits of its
//! descriptor. 30 % of the points have one of 300 repeated textures; corridors of 40 keyframes that come
//! every 400 have 60 % of their points in common; 15 % of what a keyframe has is seen once. Queries are
//! runs of five keyframes, 30 in new territory and 30 on the second lap; what was seen within the last
//! 50 keyframes is excluded. One thread. What was found stands in
//! docs/decisions/0023-place-recognition.md.

#![allow(clippy::print_stdout, reason = "a bench shows what it measured")]

mod timing;

use std::time::Instant;

use clap::Parser;
use covis::map::{ClientIndex, EntityId};
use covis::place::{Candidate, Feature, PlaceError, PlaceIndex};

use crate::timing::milliseconds;

/// Place recognition in large maps.
#[derive(Clone, Parser)]
struct Args {
    /// Keyframes of the way, the second lap included.
    #[arg(long, default_value_t = 17_500)]
    keyframes: usize,
    /// Descriptors of a keyframe, of 256 bits.
    #[arg(long, default_value_t = 500)]
    descriptors: usize,
    /// Share of the bits that a view changes.
    #[arg(long, default_value_t = 0.12)]
    flipped: f64,
    /// Candidates of a query.
    #[arg(long, default_value_t = 5)]
    candidates: usize,
    /// Of the scene.
    #[arg(long, default_value_t = 7)]
    seed: u64,
    /// Given by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

type Descriptor = [u64; 4];

/// How far a point is seen, keyframes.
const SIGHT: f64 = 6.0;
/// How often a point in sight is found.
const FOUND: f64 = 0.6;

fn mixed(z: u64) -> u64 {
    let mut z = z.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A stream of numbers: points are made again whenever they are seen, so one has to be cheap to begin.
struct Numbers(u64);

impl Numbers {
    fn word(&mut self) -> u64 {
        let word = mixed(self.0);
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        word
    }

    /// From 0 to 1.
    fn share(&mut self) -> f64 {
        (self.word() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// 64 bits, each set with a probability of `share`, to 16 binary digits of it.
    fn bits(&mut self, share: f64) -> u64 {
        let digits = (share * 65_536.0) as u32;
        (0..16).fold(0, |bits, digit| {
            let word = self.word();
            if (digits >> digit) & 1 == 1 { bits | word } else { bits & word }
        })
    }

    fn descriptor(&mut self) -> Descriptor {
        std::array::from_fn(|_| self.word())
    }

    fn changed(&mut self, descriptor: &Descriptor, share: f64) -> Descriptor {
        descriptor.map(|word| word ^ self.bits(share))
    }
}

impl Args {
    /// The first keyframe of the second lap.
    fn again(&self) -> usize {
        self.keyframes * 6 / 10
    }

    /// Where a keyframe is along the way, in keyframes.
    fn place(&self, keyframe: usize) -> f64 {
        let again = self.again();
        if keyframe < again { keyframe as f64 } else { (keyframe - again) as f64 + 0.37 }
    }

    /// A point of the stretch that begins at `step`: where it is, and its descriptor.
    fn point(&self, step: usize, number: usize) -> (f64, Descriptor) {
        let name = |step: usize| mixed(self.seed ^ mixed(((step as u64) << 20) | number as u64));
        let mut own = Numbers(name(step));
        let at = step as f64 + own.share();
        let texture = own.share();
        if step % 400 < 40 && texture < 0.6 {
            let shared = Numbers(!name(step % 400)).descriptor();
            return (at, own.changed(&shared, 0.03));
        }
        if texture < 0.3 {
            let shared = Numbers(mixed(self.seed ^ (own.word() % 300))).descriptor();
            return (at, own.changed(&shared, 0.05));
        }
        (at, own.descriptor())
    }

    /// What a keyframe sees, as bytes.
    fn seen(&self, keyframe: usize) -> Vec<[u8; 32]> {
        let x = self.place(keyframe);
        let mut view = Numbers(mixed(!self.seed ^ mixed(keyframe as u64)));
        let points = (0.85 * self.descriptors as f64 / (2.0 * SIGHT * FOUND)).round() as usize;
        let mut seen = Vec::with_capacity(self.descriptors);
        for step in (x - SIGHT).max(0.0) as usize..=(x + SIGHT) as usize {
            for number in 0..points {
                let (at, descriptor) = self.point(step, number);
                if (at - x).abs() < SIGHT && view.share() < FOUND {
                    seen.push(view.changed(&descriptor, self.flipped));
                }
            }
        }
        while seen.len() < self.descriptors {
            seen.push(view.descriptor());
        }
        seen.truncate(self.descriptors);
        let bytes = |descriptor: Descriptor| {
            let mut bytes = [0; 32];
            for (to, from) in bytes.chunks_exact_mut(8).zip(descriptor) {
                to.copy_from_slice(&from.to_le_bytes());
            }
            bytes
        };
        seen.into_iter().map(bytes).collect()
    }

    /// The keyframes that are asked for.
    fn queries(&self) -> Vec<usize> {
        let (again, runs) = (self.again(), 30);
        let first = (0..runs).map(|run| again * 3 / 4 + run * (again / 4 - 8) / runs);
        let second = (0..runs).map(|run| again + 10 + run * (self.keyframes - again - 20) / runs);
        first.chain(second).flat_map(|start| start..start + 5).collect()
    }
}

/// The best candidate of a query.
struct Told {
    score: f64,
    is_right: bool,
    is_again: bool,
}

fn main() -> Result<(), PlaceError> {
    let args = Args::parse();
    let id = |keyframe: usize| EntityId::new(ClientIndex(0), keyframe as i64);
    let queries = args.queries();
    let mut index = PlaceIndex::default();
    let (mut added, mut asked, mut told) = (Vec::new(), Vec::new(), Vec::new());
    for keyframe in 0..args.keyframes {
        let data = args.seen(keyframe);
        let features: Vec<Feature<'_>> =
            data.iter().map(|data| Feature { name: "orb", data }).collect();
        if queries.contains(&keyframe) {
            let recent = |other: EntityId| other.id + 50 >= keyframe as i64;
            let start = Instant::now();
            let found = index.query(&features, None, args.candidates, recent)?;
            asked.push(start.elapsed().as_secs_f64());
            let is_right = |candidate: &Candidate| {
                let other = args.place(candidate.keyframe.id as usize);
                (other - args.place(keyframe)).abs() <= SIGHT
            };
            told.push(Told {
                score: found.first().map_or(0.0, |candidate| candidate.score),
                is_right: found.first().is_some_and(is_right),
                is_again: keyframe >= args.again(),
            });
        }
        let start = Instant::now();
        index.add(id(keyframe), keyframe as i64 * 100_000_000, &features)?;
        added.push(start.elapsed().as_secs_f64());
    }
    let again = told.iter().filter(|t| t.is_again).count() as f64;
    let wrong = told.iter().filter(|t| !t.is_right).map(|t| t.score).fold(0.0, f64::max);
    let right = told.iter().filter(|t| t.is_right && t.is_again);
    let first = right.clone().count() as f64 / again;
    let recall = right.filter(|t| t.score > wrong).count() as f64 / again;
    let descriptors = (args.keyframes * args.descriptors) as f64;
    let bytes = index.bytes() as f64;
    let times = |times: &mut Vec<f64>| {
        let [half, most, longest] = milliseconds(times);
        format!("p50 {half:.2}, p99 {most:.2}, longest {longest:.2} ms")
    };
    println!("{} keyframes of {} descriptors", args.keyframes, args.descriptors);
    println!("addition: {}", times(&mut added));
    println!("query, {} candidates: {}", args.candidates, times(&mut asked));
    println!(
        "memory: {:.1} kB a keyframe, {:.1} bytes a descriptor above its own",
        bytes / args.keyframes as f64 / 1e3,
        bytes / descriptors - 32.0
    );
    println!(
        "right first: {first:.3}, recall at precision 1: {recall:.3} (score above {wrong:.3})"
    );
    let start = Instant::now();
    for keyframe in 0..args.keyframes / 2 {
        index.remove(id(keyframe));
    }
    let removed = start.elapsed().as_secs_f64() * 2.0 / args.keyframes as f64;
    println!(
        "removal: {:.2} ms; half of the keyframes take {:.0} % of the memory",
        removed * 1e3,
        index.bytes() as f64 / bytes * 100.0
    );
    Ok(())
}
