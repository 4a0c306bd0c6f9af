//! The name of a map that became part of another one: it leads to the latter.
//!
//! How maps are merged is not known here.

use std::sync::Arc;

use sha2::{Digest as _, Sha256};

use crate::map::{Map, MergedMap};
use crate::service::engine::EngineError;

/// The name of a map that became part of another one, as a handle of the latter has it.
#[derive(Debug)]
pub(crate) struct MergedName {
    /// The name.
    pub(crate) name: String,
    create_time_ns: i64,
    /// The uid of the map that had it: its clients' items are all in the other map.
    pub(crate) uid: String,
}

impl MergedName {
    pub(crate) fn new(merged: &MergedMap) -> Arc<Self> {
        let MergedMap { name, create_time_ns, .. } = merged;
        let uid = uid(name, *create_time_ns);
        Arc::new(Self { name: name.clone(), create_time_ns: *create_time_ns, uid })
    }

    /// What `map` says of this name, which led to it.
    ///
    /// # Errors
    /// [`EngineError::Moving`] where the map of that name has left again.
    pub(crate) fn entry_in<'a>(&self, map: &'a Map) -> Result<&'a MergedMap, EngineError> {
        let known = map.merged_as(&self.name);
        let known = known.filter(|known| known.create_time_ns == self.create_time_ns);
        known.ok_or_else(|| EngineError::Moving { map: self.name.clone() })
    }
}

/// Half a SHA-256 of name and creation time, in hex. It stays the same after a restart and differs
/// for a map that was deleted and created again.
pub(crate) fn uid(name: &str, create_time_ns: i64) -> String {
    let mut hash = Sha256::new();
    hash.update(create_time_ns.to_le_bytes());
    hash.update(name.as_bytes());
    hash.finalize().iter().take(16).map(|byte| format!("{byte:02x}")).collect()
}
