//! Checks a data directory that no server uses: reads every byte that a server would, replays every
//! event, compares the result with the snapshots, and reports damage.
//!
//! A check changes nothing. A repair never deletes: a damaged file is renamed, and a snapshot of
//! the recovered map replaces the journal. Events that are intact and cannot be read are given up only
//! where that is asked for. Everything here blocks.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::disk::{Disk, RealDisk};
use super::folders::{self, Folder, unused_name};
use super::journal::Journal;
use super::lock::DirectoryLock;
use super::record::{Uid, VERSION};
use super::{
    FileStoreOptions, MARK, SET_ASIDE, file_error, journal_name, load, read, sealed, snapshot_name,
    whole_file,
};
use crate::encoding::decode_identity;
use crate::{Damage, EventOutline, StoreError, UnreadableEvent, sequence_of};
use covis_map::{ClientIndex, Event, Map};

/// The result of checking the files of a map.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct MapCheckup {
    /// The map's name; `None` if it is lost.
    pub map: Option<String>,
    /// Its folder.
    pub folder: PathBuf,
    /// The last revision that can be recovered.
    pub revision: u64,
    /// The names of its journal files, in order.
    pub segments: Vec<String>,
    /// Revision of the newest snapshot that opens.
    pub snapshot: Option<u64>,
    /// The damage: the last byte that can be read, and which events are lost.
    pub damage: Vec<Damage>,
    /// Why it could not be checked or repaired, if so.
    pub failure: Option<String>,
    /// The events from the first one that cannot be read although it is intact; a repair gives them up
    /// only with [`Repair::Cut`].
    pub unreadable: Vec<LostEvent>,
    /// Files that a repair has set aside, with their new names.
    pub set_aside: Vec<PathBuf>,
}

/// An event that is not in the map that can be recovered.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LostEvent {
    /// What can be read of it.
    pub event: EventOutline,
    /// The name of the client whose item it was; `None` for the server's own events.
    pub client: Option<String>,
}

/// What [`check_up`] does about damage.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Repair {
    /// Nothing is changed.
    No,
    /// Damaged files are set aside, and their maps go on from what can be recovered. Maps with an event
    /// that is intact and cannot be read stay as they are.
    Damage,
    /// Those maps are cut before that event, too.
    Cut,
}

impl MapCheckup {
    /// Whether anything is wrong.
    pub fn is_damaged(&self) -> bool {
        !self.damage.is_empty() || self.failure.is_some()
    }
}

/// Checks every map of a data directory, in the order of the folders' names, and repairs damaged
/// ones as `repair` says. Blocks.
///
/// # Errors
/// [`StoreError::InUse`] if a server uses it, [`StoreError::File`] if it is no data directory or
/// cannot be read.
pub fn check_up(directory: &Path, repair: Repair) -> Result<Vec<MapCheckup>, StoreError> {
    let maps = directory.join("maps");
    let entries = RealDisk.list(&maps).map_err(|e| file_error("cannot list", &maps, &e))?;
    let _lock = DirectoryLock::take(directory)?;
    let mut looked: Vec<(MapCheckup, Option<Recoverable>)> =
        entries.iter().filter_map(|entry| look_at(&maps, entry)).collect();
    name_ambiguous(looked.iter_mut().map(|(checkup, _)| checkup));
    for (checkup, found) in &mut looked {
        if let Some(found) = found
            && repair != Repair::No
            && checkup.failure.is_none()
            && !checkup.damage.is_empty()
        {
            checkup.failure = match kept_whole(checkup, repair) {
                None => mend(directory, checkup, found).err().map(|error| error.to_string()),
                reason => reason,
            };
        }
    }
    Ok(looked.into_iter().map(|(checkup, _)| checkup).collect())
}

/// Why a map with an unreadable event stays as it is.
fn kept_whole(checkup: &MapCheckup, repair: Repair) -> Option<String> {
    let lost = checkup.damage.iter().find(|damage| damage.lost.is_some());
    let event = lost.and_then(|damage| damage.unreadable.as_ref())?;
    let count = checkup.unreadable.len();
    if event.is_later {
        let number = event.sequence;
        return Some(format!(
            "a later version wrote event {number}: repair the map with that version"
        ));
    }
    (repair != Repair::Cut)
        .then(|| format!("the map stays as it is: --repair --cut gives up its last {count} events"))
}

/// Checks one entry of `maps`, which nobody writes to; `None` if it is no map. Blocks.
pub(super) fn check_up_map(maps: &Path, entry: &str) -> Option<MapCheckup> {
    look_at(maps, entry).map(|(checkup, _)| checkup)
}

fn look_at(maps: &Path, entry: &str) -> Option<(MapCheckup, Option<Recoverable>)> {
    let folder = maps.join(entry);
    let mut checkup = MapCheckup { folder, ..MapCheckup::default() };
    match folders::look(&RealDisk, maps, entry) {
        // It is removed when a server starts.
        Folder::Leftover => None,
        Folder::Stray(reason) => {
            let folder = checkup.folder.display();
            tracing::warn!(%folder, reason, "not a map, it is left alone");
            None
        }
        Folder::Later(error) => {
            checkup.failure = Some(error.to_string());
            if let StoreError::Later { map, .. } = error {
                checkup.map = Some(map);
            }
            Some((checkup, None))
        }
        Folder::Map { .. } | Folder::Nameless(_) | Folder::Unknown(_) => {
            let found = look(&mut checkup);
            let map = checkup.map.clone().unwrap_or_default();
            let found = found.map_err(|error| {
                if let StoreError::Later { file, reason, .. } = error {
                    return StoreError::Later { map, file, reason };
                }
                error
            });
            checkup.failure = found.as_ref().err().map(ToString::to_string);
            Some((checkup, found.ok()))
        }
    }
}

/// Reports maps that have the same name: a server opens none of them, and a person has to choose.
pub(super) fn name_ambiguous<'a>(checkups: impl Iterator<Item = &'a mut MapCheckup>) {
    let mut named: BTreeMap<String, Vec<&mut MapCheckup>> = BTreeMap::new();
    for checkup in checkups {
        if let Some(map) = checkup.map.clone() {
            named.entry(map).or_default().push(checkup);
        }
    }
    for (map, checkups) in named.into_iter().filter(|(_, checkups)| checkups.len() > 1) {
        let folder = |c: &MapCheckup| {
            c.folder.file_name().unwrap_or_default().to_string_lossy().into_owned()
        };
        let folders = checkups.iter().map(|checkup| folder(checkup)).collect();
        let error = StoreError::Ambiguous { map, folders }.to_string();
        for checkup in checkups {
            checkup.failure.get_or_insert_with(|| error.clone());
        }
    }
}

/// The data that a repair needs of a map.
struct Recoverable {
    uid: Uid,
    /// The map at the last revision that can be recovered.
    map: Map,
    /// Revisions of the snapshots that open.
    snapshots: Vec<u64>,
}

/// Reads all files of a map.
fn look(checkup: &mut MapCheckup) -> Result<Recoverable, StoreError> {
    let folder = checkup.folder.clone();
    let uid = identity(checkup)?;
    let found = load::look(&RealDisk, &folder, &uid)?;
    checkup.segments = found.segments.iter().map(|&first| journal_name(first)).collect();
    checkup.damage.extend(found.damage.iter().cloned());
    let (last, mut snapshots) = (found.last, Vec::new());
    for &sequence in &found.snapshots {
        let path = folder.join(snapshot_name(sequence));
        let mut file = RealDisk.stream(&path).map_err(|e| file_error("cannot read", &path, &e))?;
        match sealed::read_snapshot(&mut file) {
            Ok(map) => snapshots.push(map),
            Err(error) => {
                let _reason = error.damage(&path)?;
                checkup.damage.push(whole_file(&path));
            }
        }
    }
    let name = checkup.map.clone().unwrap_or_default();
    let options = FileStoreOptions::default();
    let journal =
        Journal::new(&name, uid, folder.clone(), Arc::new(RealDisk), options, &Arc::default());
    // It is only read: nothing is made durable.
    journal.loaded(found);
    let map = replay(&journal, last, &snapshots, checkup)?;
    checkup.revision = sequence_of(map.revision());
    checkup.snapshot = snapshots.last().map(|map| sequence_of(map.revision()));
    let is_told = checkup.damage.iter().any(|damage| damage.lost.is_some());
    if checkup.revision < last && !is_told {
        let home = journal.segments().into_iter().rfind(|&first| first <= checkup.revision + 1);
        let file = home.map_or_else(|| folder.clone(), |first| folder.join(journal_name(first)));
        let lost = Some((checkup.revision + 1, last));
        checkup.damage.push(Damage { lost, ..whole_file(&file) });
    }
    let is_unreadable = |damage: &Damage| damage.lost.is_some() && damage.unreadable.is_some();
    if checkup.damage.iter().any(is_unreadable) {
        let events = read::outlines(&journal, checkup.revision, last)?;
        let named = |event: EventOutline| {
            let client = event.cause.map(|(client, _)| ClientIndex(client));
            let client = client.and_then(|client| map.client(client)).map(|c| c.name.clone());
            LostEvent { event, client }
        };
        checkup.unreadable = events.into_iter().map(named).collect();
    }
    let snapshots = snapshots.iter().map(|map| sequence_of(map.revision())).collect();
    Ok(Recoverable { uid, map, snapshots })
}

/// The map's uid, from its file or otherwise from its folder.
fn identity(checkup: &mut MapCheckup) -> Result<Uid, StoreError> {
    let path = checkup.folder.join("map");
    if let Ok(mut file) = RealDisk.stream(&path)
        && let Ok((label, (VERSION, body))) = sealed::read_identity(&mut file)
        && let Ok(name) = decode_identity(&body)
    {
        checkup.map = Some(name);
        return Ok(label.uid);
    }
    checkup.damage.push(whole_file(&path));
    let name = checkup.folder.file_name().unwrap_or_default().to_string_lossy();
    let message = "neither its name nor its folder's identifies the map".to_owned();
    let path = path.display().to_string();
    folders::uid_of(&name).ok_or(StoreError::Content { path, message })
}

/// The map at the last revision that can be recovered. Starts at the first event and uses snapshots
/// to pass gaps; each snapshot must equal the result of its events.
fn replay(
    journal: &Journal,
    last: u64,
    snapshots: &[Arc<Map>],
    checkup: &mut MapCheckup,
) -> Result<Map, StoreError> {
    let mut map = Map::new();
    let mut later = snapshots.iter().peekable();
    loop {
        let read = read::events(journal, sequence_of(map.revision()), last)?;
        let mut stopped = read.unreadable;
        for event in read.events {
            if let Err(error) = map.apply(&event) {
                stopped = Some(unfit(journal, &event, error.to_string(), last));
                break;
            }
            let Some(snapshot) = later.next_if(|next| next.revision() == map.revision()) else {
                continue;
            };
            if snapshot.state_hash() != map.state_hash() {
                let name = snapshot_name(sequence_of(map.revision()));
                checkup.damage.push(whole_file(&journal.folder.join(name)));
            }
        }
        let next = later.find(|next| next.revision() > map.revision());
        if let Some(damage) = stopped {
            let lost = damage.lost.filter(|_| next.is_none());
            checkup.damage.push(Damage { lost, ..damage });
        }
        let Some(snapshot) = next else { return Ok(map) };
        map = (**snapshot).clone();
    }
}

/// The damage of an event that does not fit the map before it.
fn unfit(journal: &Journal, event: &Event, reason: String, last: u64) -> Damage {
    let sequence = sequence_of(event.revision);
    let home = journal.segments().into_iter().rfind(|&first| first <= sequence);
    let file =
        home.map_or_else(|| journal.folder.clone(), |f| journal.folder.join(journal_name(f)));
    let kind = event.change.name();
    let unreadable = Some(Box::new(UnreadableEvent { sequence, kind, reason, is_later: false }));
    Damage { lost: Some((sequence, last)), unreadable, ..whole_file(&file) }
}

/// Sets damaged files aside and leaves a map that opens, if anything could be recovered.
fn mend(directory: &Path, checkup: &mut MapCheckup, found: &Recoverable) -> Result<(), StoreError> {
    let folder = checkup.folder.clone();
    if checkup.revision == 0 {
        let aside = directory.join(SET_ASIDE);
        RealDisk.create_folder(&aside).map_err(|e| file_error("cannot create", &aside, &e))?;
        let to = set_aside(&folder, &aside)?;
        let maps = directory.join("maps");
        RealDisk.sync_folder(&maps).map_err(|e| file_error("cannot sync", &maps, &e))?;
        checkup.set_aside.push(to);
        return Ok(());
    }
    let mut aside: Vec<PathBuf> = checkup.damage.iter().map(|d| PathBuf::from(&d.file)).collect();
    let is_log = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "log");
    let lost = checkup.damage.iter().any(|damage| damage.lost.is_some());
    aside.retain(|path| *path != folder && !is_log(path));
    aside.sort_unstable();
    aside.dedup();
    for path in aside.iter().filter(|path| RealDisk.read(path).is_ok()) {
        checkup.set_aside.push(set_aside(path, &folder)?);
    }
    if checkup.map.is_none() {
        let uid: String = found.uid.iter().take(4).map(|byte| format!("{byte:02x}")).collect();
        let name = format!("recovered-{uid}");
        let path = folder.join("map");
        sealed::write_identity(&RealDisk, &path, &found.uid, &name)?;
        checkup.map = Some(name);
    }
    if lost || checkup.damage.iter().any(|damage| is_log(&PathBuf::from(&damage.file))) {
        // From here on the snapshot has everything; a journal with a gap could not be read as a
        // whole.
        let path = folder.join(snapshot_name(checkup.revision));
        if !found.snapshots.contains(&checkup.revision) || aside.contains(&path) {
            sealed::write_snapshot(&RealDisk, &path, &found.uid, &found.map)?;
        }
        let mut journal = checkup.segments.clone();
        journal.push(MARK.to_owned());
        for name in journal {
            let path = folder.join(name);
            if RealDisk.read(&path).is_ok() {
                checkup.set_aside.push(set_aside(&path, &folder)?);
            }
        }
    }
    RealDisk.sync_folder(&folder).map_err(|e| file_error("cannot sync", &folder, &e))
}

/// Renames a file or folder to an unused name in `folder` that no server reads.
fn set_aside(path: &Path, folder: &Path) -> Result<PathBuf, StoreError> {
    let failed = |error| file_error("cannot rename", path, &error);
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let to = unused_name(&RealDisk, folder, &name, ".bad").map_err(failed)?;
    RealDisk.rename(path, &to).map_err(failed)?;
    RealDisk.sync_folder(folder).map_err(failed)?;
    Ok(to)
}
