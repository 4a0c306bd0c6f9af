//! A requested change of a map: its name, its policy, and whether it is frozen.
//!
//! The change is one event, or none if everything is as requested already. Freezing ends the streams
//! and drops the result of the running solve; the items that wait for solves keep their places, so
//! that they are solved once the map is open again. What the map holds is not changed here.

use std::fmt;
use std::sync::atomic::Ordering;

use crate::map::{Change, MapPolicy};
use crate::service::engine::EngineError;
use crate::service::engine::actor::Actor;
use crate::service::engine::context::MapInfo;

/// A requested change of a map's name, policy or state; what is `None` stays as it is.
#[derive(Default)]
pub struct MapUpdate {
    /// The new free text for people.
    pub display_name: Option<String>,
    /// Computes the new policy from the present one.
    pub policy: Option<PolicyUpdate>,
    /// Whether the map is to be frozen.
    pub frozen: Option<bool>,
    /// The change is made only at this revision.
    pub expected_revision: Option<i64>,
}

/// Computes a policy from the present one.
pub type PolicyUpdate = Box<dyn FnOnce(&MapPolicy) -> MapPolicy + Send>;

impl fmt::Debug for MapUpdate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { display_name, policy: _, frozen, expected_revision } = self;
        f.debug_struct("MapUpdate")
            .field("display_name", display_name)
            .field("frozen", frozen)
            .field("expected_revision", expected_revision)
            .finish_non_exhaustive()
    }
}

impl Actor {
    /// Makes a requested change and returns the map after it.
    pub(crate) async fn update(&mut self, update: MapUpdate) -> Result<MapInfo, EngineError> {
        self.check_changeable()?;
        let MapUpdate { display_name, policy, frozen, expected_revision } = update;
        let actual = self.map.revision();
        if let Some(expected) = expected_revision.filter(|&expected| expected != actual) {
            let map = self.shared.name.clone();
            return Err(EngineError::RevisionMismatch { map, expected, actual });
        }
        let display_name = display_name.filter(|name| name != self.map.display_name());
        let policy = policy.map(|policy| policy(self.map.policy()));
        let policy = policy.filter(|policy| policy != self.map.policy());
        if policy.as_ref().is_some_and(|policy| !self.map.keeps_anchor(policy)) {
            let map = self.shared.name.clone();
            return Err(EngineError::AnchorInUse { map });
        }
        let frozen = frozen.filter(|&frozen| frozen != self.map.is_frozen());
        if display_name.is_none() && policy.is_none() && frozen.is_none() {
            return Ok(self.info());
        }
        self.commit(None, Change::MapUpdated { display_name, policy, frozen }).await?;
        if frozen == Some(true) {
            self.pause(&EngineError::Frozen { map: self.shared.name.clone() });
        }
        if let Some(frozen) = frozen {
            self.shared.frozen.store(frozen, Ordering::Relaxed);
            let map = &self.shared.name;
            tracing::info!(map, frozen, "the map's state was changed");
        }
        Ok(self.info())
    }
}
