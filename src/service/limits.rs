//! Ceilings as they are written in files: `[map_limits]` and `[tenant_limits]` of `covis.toml`, and
//! `[[tenant]]` in the file of tokens. An absent key is no ceiling, or the one that stands above.

use serde::Deserialize;

use super::engine::TenantCeilings;
use crate::map::Ceilings;

/// Limits of a map or of all maps of a tenant; counts from 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapLimits {
    /// Keyframes.
    pub max_keyframes: Option<u64>,
    /// Landmarks.
    pub max_landmarks: Option<u64>,
    /// Observations.
    pub max_observations: Option<u64>,
    /// Estimated memory in bytes.
    pub max_bytes: Option<u64>,
}

impl MapLimits {
    /// These ceilings where they are given, else those of `default`.
    #[must_use]
    pub fn over(&self, default: Ceilings) -> Ceilings {
        Ceilings {
            max_keyframes: self.max_keyframes.or(default.max_keyframes),
            max_landmarks: self.max_landmarks.or(default.max_landmarks),
            max_observations: self.max_observations.or(default.max_observations),
            max_bytes: self.max_bytes.or(default.max_bytes),
        }
    }
}

/// Limits of a tenant; counts from 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TenantLimits {
    /// Keyframes of all its maps.
    pub max_keyframes: Option<u64>,
    /// Landmarks of all its maps.
    pub max_landmarks: Option<u64>,
    /// Observations of all its maps.
    pub max_observations: Option<u64>,
    /// Estimated memory of all its maps in bytes.
    pub max_bytes: Option<u64>,
    /// Maps.
    pub max_maps: Option<u64>,
    /// Ingest and watch streams that are open at once.
    pub max_streams: Option<u64>,
    /// Solves that run at once.
    pub max_solves: Option<u64>,
    /// Calls for solves that wait for their turn.
    pub max_waiting_solves: Option<u64>,
}

impl From<TenantLimits> for TenantCeilings {
    fn from(limits: TenantLimits) -> Self {
        let TenantLimits { max_keyframes, max_landmarks, max_observations, max_bytes, .. } = limits;
        let TenantLimits { max_maps, max_streams, max_solves, max_waiting_solves, .. } = limits;
        let held = Ceilings { max_keyframes, max_landmarks, max_observations, max_bytes };
        Self { held, max_maps, max_streams, max_solves, max_waiting_solves }
    }
}
