//! Maps that several servers share: a map is opened when it is asked for, and its engine ends when another
//! server has it.
//!
//! Where one server has all maps, all of them are open from the start and nothing here does anything.
//! Which server has a map is decided by the store.

use crate::service::engine::maps::run_to_end;
use crate::service::engine::{EngineError, MapHandle, Maps};
use crate::store::{Durability, StoreError};

impl Maps {
    /// The map called `name`; one that no server serves is opened first.
    ///
    /// # Errors
    /// [`EngineError::MapNotFound`], [`EngineError::Store`] with [`StoreError::OwnedElsewhere`] where
    /// another server has the map, [`EngineError::ShuttingDown`].
    pub async fn find(&self, name: &str) -> Result<MapHandle, EngineError> {
        let found = self.get(name);
        if self.durability() != Durability::Replicated {
            return found;
        }
        match found {
            Ok(handle) if !handle.shared.is_elsewhere() => Ok(handle),
            Ok(_) | Err(EngineError::MapNotFound { .. }) => self.take(name).await,
            Err(error) => Err(error),
        }
    }

    /// Opens a map that no other server serves. Dropping the future does not stop it.
    async fn take(&self, name: &str) -> Result<MapHandle, EngineError> {
        let mut claim = self.claim(name).await?;
        let open = claim.map().filter(|handle| !handle.shared.is_elsewhere());
        if let Some(handle) = open.cloned() {
            return Ok(handle);
        }
        let (maps, name) = (self.clone(), name.to_owned());
        run_to_end(async move {
            let not_found = || EngineError::MapNotFound { map: name.clone() };
            match maps.inner.store.claim(&name).await {
                Err(StoreError::UnknownMap { .. }) => return Err(not_found()),
                claimed => claimed?,
            }
            let start = maps.load_map(&name).await?;
            let handle = start.map(|start| maps.spawn_existing(start));
            claim.set(handle.clone());
            drop(claim);
            let handle = handle.ok_or_else(not_found)?;
            maps.lead_merged(&handle).await;
            Ok(handle)
        })
        .await
    }

    /// Before a name is changed: its map, opened where no server serves it; `None` where the name is free.
    ///
    /// # Errors
    /// [`StoreError::OwnedElsewhere`] where another server does, and those of [`Maps::find`] but
    /// [`EngineError::MapNotFound`].
    pub(crate) async fn look_elsewhere(
        &self,
        name: &str,
    ) -> Result<Option<MapHandle>, EngineError> {
        match self.find(name).await {
            Err(EngineError::MapNotFound { .. }) => Ok(None),
            found => found.map(Some),
        }
    }
}
