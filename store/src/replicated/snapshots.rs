//! Snapshots of maps in an object store: the map files that also move maps between servers.
//!
//! Names are `UID.REVISION`. A snapshot counts once the catalog's entry of its map names it; others are
//! what a cut-off call left, and go with the map.

use std::sync::Arc;

use async_nats::jetstream::object_store::ObjectStore;
use tokio::io::AsyncReadExt;

use super::unavailable;
use crate::{MapFileWriter, StoreError, read_map_file};
use covis_map::{Map, Usage};

/// Bytes of a message of an object.
const CHUNK: usize = 512 << 10;

/// The snapshots of all maps.
#[derive(Clone)]
pub(super) struct Snapshots(pub(super) ObjectStore);

impl Snapshots {
    /// Keeps a map at its revision.
    ///
    /// # Errors
    /// [`StoreError::Unavailable`].
    pub(super) async fn put(
        &self,
        map: &str,
        uid: &str,
        revision: u64,
        content: Arc<Map>,
    ) -> Result<(), StoreError> {
        let failed = |what: &dyn std::fmt::Display| unavailable(map, "the snapshots", what);
        let bytes = tokio::task::spawn_blocking(move || {
            let mut bytes = Vec::new();
            let _all = MapFileWriter::default().put(&content, usize::MAX, &mut bytes);
            bytes
        });
        let bytes = bytes.await.map_err(|error| failed(&error))?;
        let meta = async_nats::jetstream::object_store::ObjectMetadata {
            name: name_of(uid, revision),
            chunk_size: Some(CHUNK),
            ..Default::default()
        };
        self.0.put(meta, &mut &bytes[..]).await.map_err(|error| failed(&error))?;
        Ok(())
    }

    /// A map at a revision.
    ///
    /// # Errors
    /// [`StoreError::Unavailable`], and [`StoreError::Content`] where it does not open.
    pub(super) async fn get(&self, map: &str, uid: &str, revision: u64) -> Result<Map, StoreError> {
        let failed = |what: &dyn std::fmt::Display| unavailable(map, "the snapshots", what);
        let name = name_of(uid, revision);
        let mut object = self.0.get(&name).await.map_err(|error| failed(&error))?;
        let mut bytes = Vec::new();
        object.read_to_end(&mut bytes).await.map_err(|error| failed(&error))?;
        let read = tokio::task::spawn_blocking(move || {
            read_map_file(&mut &bytes[..], &mut |_: Usage| true)
        });
        let read = read.await.map_err(|error| failed(&error))?;
        read.map_err(|error| StoreError::Content { path: name, message: error.to_string() })
    }

    /// Removes a snapshot; what cannot be removed takes room and does no harm.
    pub(super) async fn remove(&self, uid: &str, revision: u64) {
        let name = name_of(uid, revision);
        if let Err(error) = self.0.delete(&name).await {
            tracing::warn!(name, %error, "an old snapshot is left");
        }
    }
}

fn name_of(uid: &str, revision: u64) -> String {
    format!("{uid}.{revision}")
}
