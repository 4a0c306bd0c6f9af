//! Creating a map that holds what another one holds, or held.
//!
//! The content comes from a snapshot of the map, or is replayed from its journal; what becomes of it is an
//! import. The source is not changed.

use super::importing::ImportedAs;
use crate::map::Map;
use crate::service::engine::journal::history::{Moment, map_at};
use crate::service::engine::{EngineError, MapHandle, MapInfo, Maps, PastState, Resource};
use crate::store::StoreError;

/// A copy.
#[derive(Clone, Debug)]
pub struct Copied {
    /// The new map.
    pub map: MapInfo,
    /// The state of the source that it shows.
    pub state: PastState,
}

impl Maps {
    /// Creates the map `name` with the content of `source`: as it is now, or at a moment. What a crash could
    /// still undo in the source is waited for. Dropping the future leaves no map, or the whole one.
    ///
    /// # Errors
    /// [`EngineError::NotKept`], [`EngineError::Store`], and those of [`Maps::import`].
    pub async fn copy(
        &self,
        source: &MapHandle,
        moment: Option<Moment>,
        name: &str,
        frozen: bool,
    ) -> Result<Copied, EngineError> {
        let mut room = match self.begin_import(name).await {
            // Whoever asked there would be sent back here, where the source is.
            Err(EngineError::Store(StoreError::OwnedElsewhere { owner: Some(_), .. })) => {
                return Err(EngineError::MapExists { map: name.to_owned() });
            }
            room => room?,
        };
        // Of a source as many copies and exports are made at once as its account allows.
        let _reservation = source.account().reserve(Resource::Exports, 1)?;
        let present = source.snapshot().await?;
        let content = match moment {
            None => Map::clone(&present),
            Some(moment) => {
                let (store, newest) = (&*self.inner.store, PastState::of(&present));
                map_at(store, source.name(), moment, newest, |map| room.reach(map.usage())).await?
            }
        };
        let state = PastState::of(&content);
        source.durable(state.revision).await?;
        let imported = ImportedAs { frozen: Some(frozen), ..ImportedAs::default() };
        let map = self.import(room, name, content, imported).await?;
        Ok(Copied { map, state })
    }
}
