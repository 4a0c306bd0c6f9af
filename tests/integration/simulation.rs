//! A simulation of the whole server: client, links, service, engine and store on one thread, with a
//! disk, a clock and links that a seed decides.
//!
//! | module | role |
//! |---|---|
//! | `disk`, `nodes` | a disk that keeps written and synced apart, and fails, fills up and stops on demand |
//! | `items` | what a client sends |
//! | `answer` | how a call ended, and a promise that does not hold |
//! | `sending` | how a robot sends keyframes |
//! | `robot` | a client that remembers what it was told, and holds every answer against it |
//! | `world` | one run: the server, its robots, crashes and restarts |
//!
//! docs/simulation.md describes how to run many, repeat one and add a fault.

mod answer;
mod disk;
mod items;
mod nodes;
mod robot;
mod sending;
mod world;

use self::world::{Plan, run};

/// A pool with one thread, so that parallel solves run on the thread of their simulated run.
fn one_thread() -> rayon::ThreadPool {
    rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap()
}

/// How many seeds a run of the tests takes.
const SEEDS: u64 = 20;

fn plan(seed: u64) -> Plan {
    Plan { seed, robots: 2, actions: 25 }
}

#[test]
fn no_promise_is_broken_whatever_crashes_and_is_cut_off() {
    let wanted = std::env::var("COVIS_TEST_SEEDS").ok();
    let (first, count) = match wanted.as_deref().map(|text| text.split_once('+')) {
        None => (0, SEEDS),
        Some(Some((first, count))) => (first.parse().unwrap(), count.parse().unwrap()),
        Some(None) => panic!("COVIS_TEST_SEEDS is FIRST+COUNT"),
    };
    let (mut crashes, mut stops, mut cuts, mut operations) = (0, 0, 0, 0);
    let (mut joined, mut found) = (0, 0);
    let mut failed = Vec::new();
    let one = one_thread();
    for seed in first..first + count {
        match one.install(|| run(&plan(seed))) {
            Ok(report) => {
                crashes += report.crashes;
                stops += report.stops;
                cuts += report.cuts;
                operations += report.operations;
                joined += report.joined;
                found += report.found;
            }
            Err(broken) => {
                println!("seed {seed}: {}", broken.0);
                failed.push(seed);
            }
        }
    }
    println!(
        "{count} runs from seed {first}: {crashes} crashes, {stops} of them in the middle of \
         one of {operations} operations of the disk; {cuts} dead links; {joined} landmarks joined; \
         {found} closures found; broken: {failed:?}"
    );
    assert!(failed.is_empty());
    assert!(count < SEEDS || joined > 0, "no closure joined anything");
    assert!(count < SEEDS || found > 0, "the server found no closure itself");
}

/// Tokio draws the order of waiters from a seed of its own, which can be set with this flag only.
#[cfg(tokio_unstable)]
#[test]
fn a_run_is_repeated_by_its_seed() {
    let one = one_thread();
    for seed in 0..10 {
        let [first, second] = [(); 2].map(|()| one.install(|| run(&plan(seed))).unwrap());
        let differ = first.log.iter().zip(&second.log).position(|(a, b)| a != b);
        if let Some(at) = differ {
            let from = at.saturating_sub(3);
            let part = |log: &[(u64, &str)]| format!("{:?}", &log[from..=at]);
            panic!("seed {seed}: operation {at}: {} {}", part(&first.log), part(&second.log));
        }
        assert_eq!(first, second, "seed {seed}");
    }
}
