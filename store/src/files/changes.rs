//! Creating maps, deleting them and setting them aside: a change that has begun runs to its end, even if
//! its caller stops waiting.
//!
//! The work and the entry in the table are one closure on the disk's thread, which owns the lock
//! that lets one name change at a time. A map whose caller is gone after the creation never gets an
//! event: its name stays free, and the next creation of that name reuses the map.

use std::io::ErrorKind;
use std::path::Path;
#[cfg(feature = "cluster")]
use std::path::PathBuf;
use std::sync::Arc;

#[cfg(feature = "cluster")]
use super::SET_ASIDE;
use super::failure::of_map;
use super::journal::Journal;
use super::record::Uid;
use super::{Entry, FileStore, Inner, blocking, file_error, folders, load, sealed, snapshot_name};
use crate::{Epoch, StoreError, sequence_of};
use covis_map::Map;

impl FileStore {
    /// Creates a map, empty or with a snapshot. `uid` is what others know it by; it may have been here
    /// before.
    pub(crate) async fn create(
        &self,
        map: &str,
        uid: Option<Uid>,
        snapshot: Option<Arc<Map>>,
    ) -> Result<Epoch, StoreError> {
        let changing = Arc::clone(&self.inner.changing).lock_owned().await;
        let (inner, name) = (Arc::clone(&self.inner), map.to_owned());
        let created = blocking(&*self.inner.disk, move || {
            let epoch = inner.create(&name, uid, snapshot.as_deref())?;
            // Sent with the answer: if nobody receives it, the name is free again.
            Ok((epoch, changing))
        });
        let (epoch, _changing) = created.await.map_err(|error| of_map(map, error))?;
        if let Some(entry) = self.inner.maps.lock().get_mut(map)
            && let Entry::Unclaimed(journal) = entry
        {
            *entry = Entry::Map(Arc::clone(journal));
        }
        Ok(epoch)
    }

    pub(super) async fn delete(&self, map: &str) -> Result<(), StoreError> {
        let changing = Arc::clone(&self.inner.changing).lock_owned().await;
        let journal = self.inner.find(map)?;
        let (inner, name) = (Arc::clone(&self.inner), map.to_owned());
        let deleted = blocking(&*self.inner.disk, move || {
            let _changing = changing;
            journal.delete()?;
            inner.maps.lock().remove(&name);
            Ok(())
        });
        deleted.await.map_err(|error| of_map(map, error))
    }

    /// The uid of a map's files.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`], and why a map is not opened.
    #[cfg(feature = "cluster")]
    pub(crate) fn uid(&self, map: &str) -> Result<Uid, StoreError> {
        Ok(self.inner.find(map)?.uid)
    }

    /// Moves a map's files to where no server reads them; returns the folder. Where it fails it is as
    /// after a failed deletion.
    ///
    /// # Errors
    /// [`StoreError::UnknownMap`], [`StoreError::File`].
    #[cfg(feature = "cluster")]
    pub(crate) async fn set_aside(&self, map: &str) -> Result<PathBuf, StoreError> {
        let changing = Arc::clone(&self.inner.changing).lock_owned().await;
        let journal = self.inner.find(map)?;
        let (inner, name) = (Arc::clone(&self.inner), map.to_owned());
        let moved = blocking(&*self.inner.disk, move || {
            let _changing = changing;
            let aside = inner.root.join(SET_ASIDE);
            let failed = |error| file_error("cannot set aside to", &aside, &error);
            inner.disk.create_folder(&aside).map_err(failed)?;
            inner.disk.sync_folder(&inner.root).map_err(failed)?;
            let to = match journal.aside.get() {
                Some(begun) => begun.clone(),
                None => {
                    let uid = folders::name_of(&journal.uid);
                    let free = folders::unused_name(&*inner.disk, &aside, &uid, "");
                    let free = free.map_err(failed)?;
                    journal.aside.get_or_init(|| free).clone()
                }
            };
            journal.move_to(&to, "cannot set aside", "its files were set aside")?;
            inner.maps.lock().remove(&name);
            Ok(to)
        });
        moved.await.map_err(|error| of_map(map, error))
    }
}

impl Inner {
    /// Creates a map. Blocks; the caller holds the lock for it.
    fn create(
        &self,
        map: &str,
        uid: Option<Uid>,
        snapshot: Option<&Map>,
    ) -> Result<Epoch, StoreError> {
        let left = match self.maps.lock().get(map) {
            None => None,
            Some(Entry::Map(_) | Entry::Refused(_)) => {
                return Err(StoreError::MapExists { map: map.to_owned() });
            }
            Some(Entry::Unclaimed(journal))
                if snapshot.is_some()
                    || journal.state().last > 0
                    || uid.is_some_and(|uid| uid != journal.uid) =>
            {
                let folder = journal.folder.clone();
                let failed = |error| file_error("cannot remove", &folder, &error);
                // Renamed first: a snapshot alone would be a map to the next start.
                folders::discard(&*self.disk, &folder).map_err(failed)?;
                None
            }
            Some(Entry::Unclaimed(journal)) => {
                let epoch = self.next_epoch();
                journal.state().epoch = epoch;
                return Ok(epoch);
            }
            Some(Entry::Leftover(folder)) => Some(folder.clone()),
        };
        if let Some(folder) = left {
            self.remove(&folder)?;
            self.maps.lock().remove(map);
        }
        let epoch = self.next_epoch();
        let given = uid.is_some();
        let uid = uid.unwrap_or_else(|| self.new_uid(map));
        let folder = self.root.join("maps").join(folders::name_of(&uid));
        if given {
            // What a deletion could not remove would be in the way of the next one.
            self.remove(&folder.with_extension("deleted"))?;
        }
        if let Err(error) = self.write(map, &uid, &folder, snapshot) {
            // The remaining files have neither an event nor a snapshot, so that the next start does
            // not take them for a map.
            if self.remove(&folder).is_err() {
                self.maps.lock().insert(map.to_owned(), Entry::Leftover(folder));
            }
            return Err(error);
        }
        let disk = Arc::clone(&self.disk);
        let journal = Journal::new(map, uid, folder, disk, self.options, &self.meters);
        // What there is was made durable already.
        let last = snapshot.map_or(0, |map| sequence_of(map.revision()));
        let snapshots = snapshot.map(|_| last).into_iter().collect();
        let found =
            load::OpenedFiles { snapshots, last, durable: last, ..load::OpenedFiles::default() };
        journal.loaded(found);
        let _settled = journal.flush();
        journal.state().epoch = epoch;
        self.maps.lock().insert(map.to_owned(), Entry::Unclaimed(Arc::new(journal)));
        Ok(epoch)
    }

    /// Writes the folder of a new map and makes it durable. The snapshot comes last: a folder without
    /// it is a leftover for the next start.
    fn write(
        &self,
        map: &str,
        uid: &Uid,
        folder: &Path,
        snapshot: Option<&Map>,
    ) -> Result<(), StoreError> {
        let failed = |error| file_error("cannot create", folder, &error);
        self.disk.create_folder(folder).map_err(failed)?;
        sealed::write_identity(&*self.disk, &folder.join("map"), uid, map)?;
        self.disk.sync_folder(&self.root.join("maps")).map_err(failed)?;
        let Some(map) = snapshot else { return Ok(()) };
        let path = folder.join(snapshot_name(sequence_of(map.revision())));
        let bytes = sealed::write_snapshot(&*self.disk, &path, uid, map)?;
        self.meters.snapshot_bytes.add(bytes);
        Ok(())
    }

    /// Removes a folder without events, if it is there.
    fn remove(&self, folder: &Path) -> Result<(), StoreError> {
        match self.disk.remove_folder(folder) {
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
            removed => removed.map_err(|error| file_error("cannot remove", folder, &error)),
        }
    }
}
