//! Creating a map with content, in one step.
//!
//! While the content is read, [`ImportRoom`] counts it in the accounts of the map, its tenant and the
//! server, so that no upload takes more memory than they may hold. The map begins in the store as a
//! snapshot at its revision: a crash leaves the whole map or none. What the content is, and where it
//! comes from, is not known here.

use std::fmt;
use std::sync::Arc;

use crate::map::{Map, MapPolicy, Usage};
use crate::service::engine::account::HeldEntities;
use crate::service::engine::maps::run_to_end;
use crate::service::engine::{Account, EngineError, MapInfo, Maps, Reservation, Resource};

/// Room for the content of a map that is being read. Dropping it gives the room back.
pub struct ImportRoom {
    account: Arc<Account>,
    held: HeldEntities,
    reached: Usage,
    /// An upload is an open stream.
    _reservation: Reservation,
}

impl fmt::Debug for ImportRoom {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ImportRoom").field("reached", &self.reached).finish_non_exhaustive()
    }
}

impl ImportRoom {
    /// Reserves room for what was read so far. Counts never fall.
    ///
    /// # Errors
    /// [`EngineError::MapLimit`], [`EngineError::TenantLimit`], [`EngineError::ServerLimit`].
    pub fn reach(&mut self, usage: Usage) -> Result<(), EngineError> {
        let limits = self.account.limits().held;
        if let Some(exceeded) = limits.exceeded(Usage::default(), usage) {
            return Err(self.account.exceeded(exceeded));
        }
        let growth = usage - self.reached;
        self.held.grow(growth)?;
        self.reached = self.reached + growth;
        Ok(())
    }

    /// Reserves memory beside the map, for files as they are parsed. The map's own limits do not count it.
    ///
    /// # Errors
    /// [`EngineError::TenantLimit`], [`EngineError::ServerLimit`].
    pub fn set_aside(&mut self, bytes: u64) -> Result<(), EngineError> {
        self.held.grow(Usage { bytes, ..Usage::default() })
    }
}

/// What an imported map has of its own.
#[derive(Clone, Debug, Default)]
pub struct ImportedAs {
    /// Free text for people; `None` keeps that of the content.
    pub display_name: Option<String>,
    /// How the map is kept; `None` keeps that of the content.
    pub policy: Option<MapPolicy>,
    /// Whether the map is frozen; `None` keeps the state of the content.
    pub frozen: Option<bool>,
}

impl Maps {
    /// Begins the import of a map.
    ///
    /// # Errors
    /// [`EngineError::MapExists`], [`EngineError::TenantLimit`] and
    /// [`EngineError::ServerLimit`] for too many streams, [`EngineError::ShuttingDown`].
    pub async fn begin_import(&self, name: &str) -> Result<ImportRoom, EngineError> {
        if self.look_elsewhere(name).await?.is_some() {
            return Err(EngineError::MapExists { map: name.to_owned() });
        }
        let account = self.inner.pool.accounts().of_map(name);
        let reservation = account.reserve(Resource::Streams, 1)?;
        let held = HeldEntities::existing(&account, Usage::default());
        Ok(ImportRoom { account, held, reached: Usage::default(), _reservation: reservation })
    }

    /// Creates a map with content. Dropping the future does not stop a creation that has begun.
    ///
    /// # Errors
    /// As [`Maps::create`], and those of [`ImportRoom::reach`].
    pub async fn import(
        &self,
        mut room: ImportRoom,
        name: &str,
        content: Map,
        imported: ImportedAs,
    ) -> Result<MapInfo, EngineError> {
        room.reach(content.usage())?;
        let claim = self.claim(name).await?;
        if claim.map().is_some() {
            return Err(EngineError::MapExists { map: name.to_owned() });
        }
        let ImportedAs { display_name, policy, frozen } = imported;
        let content = content.imported(self.create_time_ns(), display_name, policy, frozen);
        let maps = self.clone();
        run_to_end(async move {
            let created = maps.create_claimed(claim, content, None).await;
            // The engine of the new map counts it from here on.
            drop(room);
            created
        })
        .await
    }
}
