//! The catalog: one entry a map, in a key-value bucket; every change names the revision that it replaces.
//!
//! An entry says where the map's stream is, who serves the map and which snapshots there are. It is read
//! from the bucket's leader: a follower may not have the newest one yet. It decides who tries to serve a
//! map, and nothing else: that only one can write is decided by the map's stream.

use async_nats::jetstream::kv;
use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use serde::{Deserialize, Serialize};

use super::bucket::latest;
use super::message::Owner;
use super::unavailable;
use crate::StoreError;

/// A map as the catalog knows it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Entry {
    /// The map's name.
    pub(super) name: String,
    /// Names its stream and its snapshots; never used before.
    pub(super) uid: String,
    /// Who serves it; nobody after it was let go of.
    pub(super) owner: Option<Owner>,
    /// Revisions of the snapshots that are kept, rising; at most two.
    #[serde(default)]
    pub(super) snapshots: Vec<u64>,
    /// Whether its stream was missing once: what servers' own journals have may have been acknowledged.
    #[serde(default)]
    pub(super) stream_was_lost: bool,
}

/// An entry and the revision of its key.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct StoredEntry {
    pub(super) entry: Entry,
    pub(super) revision: u64,
}

/// The entries of all maps.
#[derive(Clone, Debug)]
pub(super) struct Catalog(pub(super) kv::Store);

impl Catalog {
    /// The entry of a map, as the leader has it.
    ///
    /// # Errors
    /// [`StoreError::Unavailable`], and [`StoreError::Content`] for an entry that cannot be read.
    pub(super) async fn get(&self, map: &str) -> Result<Option<StoredEntry>, StoreError> {
        let latest = latest(&self.0, &key(map)).await;
        let latest = latest.map_err(|error| unavailable(map, "the catalog", &error))?;
        let Some((payload, revision)) = latest else { return Ok(None) };
        let entry = serde_json::from_slice(&payload).map_err(|error| {
            let path = format!("the catalog's entry of map {map:?}");
            StoreError::Content { path, message: error.to_string() }
        })?;
        Ok(Some(StoredEntry { entry, revision }))
    }

    /// Makes an entry; `None` where there is one.
    ///
    /// # Errors
    /// [`StoreError::Unavailable`]; then the entry may be there or not.
    pub(super) async fn create(&self, entry: Entry) -> Result<Option<StoredEntry>, StoreError> {
        match self.0.create(key(&entry.name), bytes(&entry)?).await {
            Ok(revision) => Ok(Some(StoredEntry { entry, revision })),
            Err(error) if error.kind() == kv::CreateErrorKind::AlreadyExists => Ok(None),
            Err(error) => Err(unavailable(&entry.name, "the catalog", &error)),
        }
    }

    /// Replaces the entry that was `known`; `None` where somebody else has changed it.
    ///
    /// # Errors
    /// [`StoreError::Unavailable`]; then it may be replaced or not.
    pub(super) async fn replace(
        &self,
        known: &StoredEntry,
        entry: Entry,
    ) -> Result<Option<StoredEntry>, StoreError> {
        match self.0.update(key(&entry.name), bytes(&entry)?, known.revision).await {
            Ok(revision) => Ok(Some(StoredEntry { entry, revision })),
            Err(error) if error.kind() == kv::UpdateErrorKind::WrongLastRevision => Ok(None),
            Err(error) => Err(unavailable(&entry.name, "the catalog", &error)),
        }
    }

    /// Removes an entry; false where somebody else has changed it.
    ///
    /// # Errors
    /// [`StoreError::Unavailable`]; then it may be removed or not.
    pub(super) async fn remove(&self, known: &StoredEntry) -> Result<bool, StoreError> {
        let StoredEntry { entry: Entry { name, .. }, revision } = known;
        match self.0.delete_expect_revision(key(name), Some(*revision)).await {
            Ok(()) => Ok(true),
            Err(error) if error.kind() == kv::UpdateErrorKind::WrongLastRevision => Ok(false),
            Err(error) => Err(unavailable(name, "the catalog", &error)),
        }
    }
}

/// The key of a map: names have letters that keys do not take.
fn key(map: &str) -> String {
    URL_SAFE_NO_PAD.encode(map)
}

fn bytes(entry: &Entry) -> Result<bytes::Bytes, StoreError> {
    let path = || format!("the catalog's entry of map {:?}", entry.name);
    let bytes = serde_json::to_vec(entry);
    let failed =
        |error: serde_json::Error| StoreError::Content { path: path(), message: error.to_string() };
    bytes.map(Into::into).map_err(failed)
}
