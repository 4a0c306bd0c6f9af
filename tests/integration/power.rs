//! kill -9 and loss of power: the real server on a disk that forgets what was not synced.
//!
//! A library that is loaded into the server writes down every change below its data directory (shim.c,
//! `trace`). When the server is dead the folder is made again as a loss of power may leave it (`model`),
//! and the next server starts on that (`machine`). Needs Linux and a C compiler, and no rights.
//!
//! `COVIS_TEST_KILLS` is the number of rounds, `COVIS_TEST_SEED` the first one's seed: a round that
//! fails is played again by its seed, though threads may interleave otherwise.

mod calls;
mod cut_off;
mod jobs;
mod machine;
pub(crate) mod model;
mod restart;
mod trace;

use std::collections::BTreeMap;

use covis::client::Client;
use covis::map::Map;
use covis::store::{FileStore, FileStoreOptions, Store};
use covis::wire::v1;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tonic::Code;

use self::calls::{connect, create, delete, get, map_out};
use self::machine::Machine;
use self::model::Disk;
use self::trace::Field;
use crate::cli_support::Running;
use crate::common::run;
use crate::durable::{on_disk, stream_until_killed};

/// Maps that come and go beside the one that is streamed into.
const SIDES: usize = 5;

/// What a client knows of a map that comes and goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Side {
    /// Its creation was answered, or a server served it.
    There,
    /// Its deletion was answered, or a server did not know it.
    Gone,
    /// A call for it was cut off by the kill.
    Unknown,
}

/// What was promised by the servers on one disk.
#[derive(Debug, Default)]
struct Promises {
    /// Last keyframe of "house" that was sent, and that is durable.
    sent: i64,
    durable: i64,
    has_house: bool,
    sides: BTreeMap<String, Side>,
}

impl Promises {
    fn new() -> Self {
        let sides = (0..SIDES).map(|side| (format!("side-{side}"), Side::Gone)).collect();
        Self { sent: -1, durable: -1, has_house: false, sides }
    }

    /// What a server serves keeps what was promised, and is a promise from then on.
    async fn check_served(&mut self, client: &Client, what: &str) {
        let maps = client.list_maps().await.unwrap();
        let is_there = |name: &str| maps.iter().any(|map| map.map_id == name);
        assert!(is_there("house") || !self.has_house, "{what}: \"house\" is missing");
        for (name, side) in &mut self.sides {
            let served = if is_there(name) { Side::There } else { Side::Gone };
            assert!(*side == Side::Unknown || *side == served, "{what}: {name} was {side:?}");
            *side = served;
        }
    }

    /// Creates and deletes maps until the server dies. Returns how many calls were answered.
    async fn churn(&mut self, url: &str, rng: &mut ChaCha8Rng) -> u32 {
        let channel = connect(url).await;
        for answered in 0.. {
            let name = format!("side-{}", rng.random_range(0..SIDES));
            let side = self.sides.get_mut(&name).unwrap();
            let was = std::mem::replace(side, Side::Unknown);
            let (answer, then) = match was {
                Side::There => (delete(&channel, &name).await, Side::Gone),
                Side::Gone | Side::Unknown => (create(&channel, &name).await, Side::There),
            };
            match answer {
                Ok(()) => *side = then,
                Err(status) => {
                    let code = status.code();
                    let is_alive = matches!(code, Code::AlreadyExists | Code::NotFound);
                    assert!(!is_alive, "{name} was {was:?}: {status:?}");
                    return answered;
                }
            }
        }
        0
    }

    /// What is on the disk keeps what was promised of "house". Returns its last keyframe.
    fn check_kept(&self, map: Option<&Map>, what: &str) -> i64 {
        let what = format!("{what}: sent {}, durable {}", self.sent, self.durable);
        let Some(map) = map else {
            assert!(!self.has_house, "{what}: \"house\" is missing");
            return -1;
        };
        let ids: Vec<i64> = map.keyframes().keys().map(|id| id.id).collect();
        let last = ids.last().copied().unwrap_or(-1);
        assert_eq!(ids, (0..=last).collect::<Vec<_>>(), "{what}");
        assert!(self.durable <= last && last <= self.sent, "{what}: kept {last}");
        for (id, keyframe) in map.keyframes() {
            assert_eq!(keyframe.capture_time_ns, 1_000_000_000 + id.id, "{what}");
        }
        let added: Vec<i64> = map.keyframes().values().map(|k| k.added_revision).collect();
        assert!(added.is_sorted_by(|a, b| a < b), "{what}: order");
        if let Some(client) = map.clients().first() {
            // Nothing but a camera may be there yet.
            let next = client.next_sequence;
            assert!(next == last + 3 || (last == -1 && next <= 2), "{what}: goes on at {next}");
        }
        last
    }
}

/// The map of a copy of the disk; `None` where there is none.
async fn house(folder: &std::path::Path) -> Option<Map> {
    let store = FileStore::open(folder, FileStoreOptions::default()).await.unwrap();
    let is_there = store.list_maps().await.unwrap().contains(&"house".to_owned());
    drop(store);
    let map = if is_there { Some(on_disk(folder, "house").await) } else { None };
    map.filter(|map| map.revision() > 0)
}

/// One life of a server, up to a kill while it works.
async fn live(
    server: &mut Running,
    promises: &mut Promises,
    rng: &mut ChaCha8Rng,
    first: i64,
    what: &str,
) -> u32 {
    let client = Client::connect(&server.url).await.unwrap();
    promises.check_served(&client, what).await;
    let url = server.url.clone();
    let mut other = ChaCha8Rng::seed_from_u64(rng.random());
    let streaming = stream_until_killed(server, rng, first);
    let ((sent, durable), answered) = tokio::join!(streaming, promises.churn(&url, &mut other));
    promises.sent = promises.sent.max(sent);
    promises.durable = promises.durable.max(durable);
    promises.has_house = true;
    answered
}

#[test]
fn a_loss_of_power_after_kill_9_takes_nothing_that_was_acknowledged() {
    let Some(mut machine) = Machine::new() else { return };
    let number = |name: &str, default: u64| {
        std::env::var(name).ok().map_or(default, |value| value.parse().unwrap())
    };
    let (rounds, first_seed) = (number("COVIS_TEST_KILLS", 4), number("COVIS_TEST_SEED", 1));
    println!("{rounds} rounds from seed {first_seed}");
    let runtime = tokio::runtime::Runtime::new().unwrap();
    let mut promises = Promises::new();
    let (mut lives, mut answered, mut between, mut taken) = (0, 0, 0, 0);
    let mut next = 0;
    for round in 0..rounds {
        let mut rng = ChaCha8Rng::seed_from_u64(first_seed + round);
        // A few losses of one disk, then another: no journal grows for the whole test.
        if round % 4 == 0 {
            machine.replace(Disk::new());
            (promises, next) = (Promises::new(), 0);
        }
        let mut reached = -1;
        for life in 0..rng.random_range(1..=2) {
            let what = format!("seed {}, life {life}", first_seed + round);
            machine.stage.set(Field::SyncDelayUs, rng.random_range(0..3000));
            let mut server = machine.start();
            // What a server serves it has brought to the disk first.
            promises.durable = promises.durable.max(next - 1);
            let living = live(&mut server, &mut promises, &mut rng, next, &what);
            answered += runtime.block_on(living);
            lives += 1;
            let copy = machine.copy();
            reached = promises.check_kept(runtime.block_on(house(&copy)).as_ref(), &what);
            next = reached + 1;
        }
        machine.lose_some(&mut rng);
        let what = format!("seed {}: after the power went", first_seed + round);
        let copy = machine.copy();
        let last = promises.check_kept(runtime.block_on(house(&copy)).as_ref(), &what);
        taken += u64::from(last < reached);
        between += u64::from(promises.durable < promises.sent);
        // What was never acknowledged may be gone, and is sent again by the next life.
        (promises.sent, next) = (last, last + 1);
    }
    println!(
        "{rounds} losses of power over {lives} lives: 0 lost, doubled or out of order; {answered} \
         creations and deletions were answered; in {between} rounds something was on its way, in \
         {taken} the power took more than the kill"
    );
    assert!(answered > 0 && between > 0, "the kills came too late or too early");
    assert!(taken > 0 || rounds < 20, "the disk forgot nothing");
}

/// The trace is whole where it explains every byte that a server left.
#[test]
fn the_trace_tells_every_change_of_a_server() {
    let Some(mut machine) = Machine::new() else { return };
    let mut server = machine.start();
    run(async {
        let channel = connect(&server.url).await;
        for name in ["a", "b", "c"] {
            create(&channel, name).await.unwrap();
            map_out(&channel, name, 5).await.unwrap();
        }
        delete(&channel, "b").await.unwrap();
    });
    assert_eq!(server.terminate(), Some(0));
    let (changes, unexplained) = machine.catch_up();
    assert!(changes > 20, "{changes} changes");
    assert_eq!(unexplained, 0, "paths that the disk has otherwise than the trace");
    machine.lose_power(model::Survival::Nothing);
    let server = machine.start();
    run(async {
        let channel = connect(&server.url).await;
        let served = |map: v1::Map| map.counts.unwrap().keyframe_count;
        for name in ["a", "c"] {
            assert_eq!(get(&channel, name).await.map(served).unwrap(), 4);
        }
        assert_eq!(get(&channel, "b").await.unwrap_err().code(), Code::NotFound);
    });
}
