//! The journal against redb: durable appends a second at 1 and 16 maps, and reopening after damage.
//!
//! `cargo bench --bench journal [-- FOLDER]` writes below FOLDER (the system's temporary folder by default:
//! name one on the disk that is to be measured). Every append is one keyframe with 200 observations. "one by
//! one" waits for each append before the next; "64 in flight" does not wait until 64 are unacknowledged. For
//! redb a transaction is an append, or a group of 64. What was found is in docs/decisions/0011-journal.md.

#![allow(clippy::print_stdout, reason = "a bench shows what it measured")]

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use covis::map::{
    Change, ClientIndex, EntityId, Event, Keyframe, Landmark, Map, MapParts, MapPolicy,
    Observation, Observers,
};
use covis::store::{FileStore, FileStoreOptions, Flushed, Store};
use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::{Vector2, Vector3};
use redb::{Database, ReadableDatabase, ReadableTable, TableDefinition};

type Failure = Box<dyn std::error::Error + Send + Sync>;

const TABLE: TableDefinition<'_, u64, &[u8]> = TableDefinition::new("journal");
/// Bytes of an encoded event below, about.
const EVENT_BYTES: usize = 7_000;

fn main() -> Result<(), Failure> {
    // Cargo passes flags of its own.
    let folder = std::env::args().skip(1).find(|argument| !argument.starts_with('-'));
    let folder = folder.map_or_else(std::env::temp_dir, PathBuf::from);
    let folder = tempfile::Builder::new().prefix("covis-journal-").tempdir_in(folder)?;
    let runtime = tokio::runtime::Runtime::new()?;
    println!("appends/s, durable, {EVENT_BYTES} bytes each");
    for (maps, in_flight) in [(1, 1), (1, 64), (16, 1), (16, 64)] {
        let each = if in_flight == 1 { 300 } else { 6400 / maps };
        let own = folder.path().join(format!("own-{maps}-{in_flight}"));
        let own = runtime.block_on(appends(&own, maps, each, in_flight))?;
        let many = folder.path().join(format!("redb-{maps}-{in_flight}"));
        let many = redb_files(&many, maps, each, in_flight)?;
        let one = folder.path().join(format!("redb1-{maps}-{in_flight}"));
        let one = redb_one_file(&one, maps, each, in_flight)?;
        println!(
            "{maps:2} maps, {in_flight:2} in flight: own log {own:8.0}   redb, a file a map \
             {many:8.0}   redb, one file {one:8.0}"
        );
    }
    println!("\nreopening after damage, 500 events");
    for damage in [Damage::Cut, Damage::Flip(0.25), Damage::Flip(0.5), Damage::Flip(0.75)] {
        let own = runtime.block_on(damaged(&folder.path().join("own-damaged"), damage))?;
        let redb = damaged_redb(&folder.path().join("redb-damaged"), damage)?;
        println!("{damage:?}\n  own log: {own}\n  redb:    {redb}");
    }
    println!("\n{}", runtime.block_on(snapshot(&folder.path().join("large")))?);
    Ok(())
}

/// Takes a snapshot of 10,000 keyframes of 200 observations and 1M landmarks, and brings it back.
async fn snapshot(folder: &Path) -> Result<String, Failure> {
    let id = |id| EntityId::new(ClientIndex(0), id);
    let keyframe = |k: i64| {
        let Change::KeyframeAdded { mut observations, .. } = event(2 * k + 2).change else {
            return Err("event 2 and later are keyframes");
        };
        observations.iter_mut().for_each(|o| o.landmark.id -= 200);
        Ok((
            id(k),
            Keyframe {
                capture_time_ns: k,
                camera: None,
                world_from_camera: Se3::identity(),
                odom_from_camera: Se3::identity(),
                observations: observations.into(),
                global_descriptor: None,
                added_revision: k,
            },
        ))
    };
    let landmark = |k: i64| {
        let position = Some(Vector3::new(0.1, 1.0 / 3.0, 7e-3).map(|v| (v * k as f64).sin()));
        let landmark = Landmark {
            position,
            sent_position: position,
            reference: None,
            observers: Observers::default(),
            added_revision: k,
            positioned_revision: k,
        };
        (id(k), landmark)
    };
    let parts = MapParts {
        revision: 1,
        keyframes: (0..10_000).map(keyframe).collect::<Result<_, _>>()?,
        landmarks: (-200..1_000_100).map(landmark).collect(),
        ..MapParts::default()
    };
    let map = Arc::new(Map::from_parts(parts)?);
    let hash = map.state_hash();
    let store = FileStore::open(folder, FileStoreOptions::default()).await?;
    let epoch = store.create_map("m", None).await?;
    store.append("m", epoch, 0, vec![Arc::new(event(1))]).await?;
    let start = Instant::now();
    store.put_snapshot("m", epoch, map).await?;
    let put = start.elapsed().as_secs_f64();
    store.close().await;
    let bytes: u64 =
        files(folder, "snap").iter().flat_map(std::fs::metadata).map(|m| m.len()).sum();
    let start = Instant::now();
    let store = FileStore::open(folder, FileStoreOptions::default()).await?;
    store.acquire("m").await?;
    let map = store.get_snapshot("m").await?.ok_or("the snapshot is gone")?;
    let get = start.elapsed().as_secs_f64();
    let same = map.state_hash() == hash;
    let (keyframes, landmarks) = (map.keyframes().len(), map.landmarks().len());
    Ok(format!(
        "snapshot of {keyframes} keyframes, {} observations, {landmarks} landmarks: {} MB; written \
         and read back in {put:.1} s, opened in {get:.1} s, the same state: {same}",
        map.observation_count(),
        bytes / 1_000_000
    ))
}

fn event(revision: i64) -> Event {
    let id = |id| EntityId::new(ClientIndex(0), id);
    if revision == 1 {
        let change = Change::Created {
            policy: MapPolicy::default(),
            create_time_ns: 1,
            display_name: String::new(),
        };
        return Event { revision, time_ns: 0, cause: None, change };
    }
    let observations = (0..200).map(|k| Observation {
        landmark: id(revision * 50 + k),
        pixel: Vector2::new(0.1, 0.7).map(|v| v * (k + revision) as f64),
        sigma_px: 1.0,
        depth: None,
        descriptor: None,
    });
    let change = Change::KeyframeAdded {
        id: id(revision),
        capture_time_ns: revision,
        camera: Some(id(0)),
        world_from_camera: Se3::identity(),
        odom_from_camera: Se3::identity(),
        observations: observations.collect(),
        landmarks: Vec::new(),
        motion: None,
        global_descriptor: None,
    };
    Event { revision, time_ns: 0, cause: None, change }
}

async fn appends(folder: &Path, maps: usize, each: usize, in_flight: u64) -> Result<f64, Failure> {
    let store = Arc::new(FileStore::open(folder, FileStoreOptions::default()).await?);
    let mut writers = Vec::new();
    for map in 0..maps {
        let name = format!("map {map}");
        let epoch = store.create_map(&name, None).await?;
        writers.push((name, epoch));
    }
    let start = Instant::now();
    let mut tasks = Vec::new();
    for (name, epoch) in writers {
        let store = Arc::clone(&store);
        tasks.push(tokio::spawn(async move {
            let mut flushed = store.follow(&name).await?;
            for sequence in 0..each as u64 {
                let batch = vec![Arc::new(event(sequence as i64 + 1))];
                store.append(&name, epoch, sequence, batch).await?;
                let wanted = (sequence + 2).saturating_sub(in_flight);
                flushed.wait_for(|f: &Flushed| f.through >= wanted).await?;
            }
            flushed.wait_for(|f| f.through >= each as u64).await?;
            Ok::<(), Failure>(())
        }));
    }
    for task in tasks {
        task.await??;
    }
    Ok((maps * each) as f64 / start.elapsed().as_secs_f64())
}

/// One transaction for `group` events of each of the given maps.
fn commit(database: &Database, maps: &[u64], first: u64, group: u64) -> Result<(), Failure> {
    let payload = vec![7_u8; EVENT_BYTES];
    let transaction = database.begin_write()?;
    {
        let mut table = transaction.open_table(TABLE)?;
        for map in maps {
            for sequence in first..first + group {
                table.insert((map << 40) | sequence, &payload[..])?;
            }
        }
    }
    // Durability is immediate by default.
    transaction.commit()?;
    Ok(())
}

fn redb_files(folder: &Path, maps: usize, each: usize, group: u64) -> Result<f64, Failure> {
    std::fs::create_dir_all(folder)?;
    let databases = (0..maps)
        .map(|map| Database::create(folder.join(format!("{map}.redb"))))
        .collect::<Result<Vec<_>, _>>()?;
    let start = Instant::now();
    std::thread::scope(|scope| {
        let work = |database: &Database| -> Result<(), Failure> {
            (0..each as u64 / group).try_for_each(|k| commit(database, &[0], k * group, group))
        };
        let threads: Vec<_> = databases.iter().map(|d| scope.spawn(move || work(d))).collect();
        threads.into_iter().try_for_each(|t| t.join().map_err(|_panic| "a thread panicked")?)
    })?;
    Ok((maps * each) as f64 / start.elapsed().as_secs_f64())
}

/// All maps in one file: what waits together shares a transaction.
fn redb_one_file(folder: &Path, maps: usize, each: usize, group: u64) -> Result<f64, Failure> {
    std::fs::create_dir_all(folder)?;
    let database = Database::create(folder.join("all.redb"))?;
    let all: Vec<u64> = (0..maps as u64).collect();
    let start = Instant::now();
    for k in 0..each as u64 / group {
        commit(&database, &all, k * group, group)?;
    }
    Ok((maps * each) as f64 / start.elapsed().as_secs_f64())
}

/// What happens to the largest file.
#[derive(Clone, Copy, Debug)]
enum Damage {
    /// Its last 20,000 bytes are gone.
    Cut,
    /// Sixteen bytes are flipped at this share of its length.
    Flip(f64),
}

fn hurt(file: &Path, damage: Damage) -> Result<(), Failure> {
    let mut bytes = std::fs::read(file)?;
    match damage {
        Damage::Cut => bytes.truncate(bytes.len().saturating_sub(20_000)),
        Damage::Flip(share) => {
            let at = (bytes.len() as f64 * share) as usize;
            bytes[at..at + 16].iter_mut().for_each(|byte| *byte ^= 0x5a);
        }
    }
    Ok(std::fs::write(file, bytes)?)
}

fn files(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() {
            found.extend(files(&path, extension));
        } else if path.extension().is_some_and(|e| e == extension) {
            found.push(path);
        }
    }
    found
}

async fn damaged(folder: &Path, damage: Damage) -> Result<String, Failure> {
    let _old = std::fs::remove_dir_all(folder);
    let store = FileStore::open(folder, FileStoreOptions::default()).await?;
    let epoch = store.create_map("m", None).await?;
    let events = (1..=500).map(|revision| Arc::new(event(revision))).collect();
    store.append("m", epoch, 0, events).await?;
    store.follow("m").await?.wait_for(|f| f.through >= 500).await?;
    drop(store);
    for file in files(folder, "log") {
        hurt(&file, damage)?;
    }
    let store = FileStore::open(folder, FileStoreOptions::default()).await?;
    store.acquire("m").await?;
    let read = store.read("m", 0).await?;
    let wrong = read.iter().filter(|e| ***e != event(e.revision)).count();
    let told: Vec<String> = store.damage("m").await?.iter().map(ToString::to_string).collect();
    Ok(format!("{} events read, {wrong} wrong; told: {told:?}", read.len()))
}

fn damaged_redb(folder: &Path, damage: Damage) -> Result<String, Failure> {
    let _old = std::fs::remove_dir_all(folder);
    std::fs::create_dir_all(folder)?;
    let file = folder.join("m.redb");
    let database = Database::create(&file)?;
    for first in (0..500).step_by(50) {
        commit(&database, &[0], first, 50)?;
    }
    drop(database);
    hurt(&file, damage)?;
    let opened = match std::panic::catch_unwind(|| Database::open(&file)) {
        Ok(Ok(database)) => database,
        Ok(Err(error)) => return Ok(format!("does not open: {error}")),
        Err(_panic) => return Ok("panics while opening".to_owned()),
    };
    let read = || -> Result<(usize, usize), Failure> {
        let transaction = opened.begin_read()?;
        let table = transaction.open_table(TABLE)?;
        let (mut count, mut wrong) = (0, 0);
        for row in table.iter()? {
            let (_, value) = row?;
            count += 1;
            wrong += usize::from(value.value().iter().any(|&byte| byte != 7));
        }
        Ok((count, wrong))
    };
    match std::panic::catch_unwind(std::panic::AssertUnwindSafe(read)) {
        Ok(Ok((count, wrong))) => Ok(format!("{count} rows read, {wrong} wrong, nothing told")),
        Ok(Err(error)) => Ok(format!("opens, then: {error}")),
        Err(_panic) => Ok("panics while reading".to_owned()),
    }
}
