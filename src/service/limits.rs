//! Limits as they are written in files: `[map_limits]`, `[tenant_limits]`, `[server_limits]` and
//! `[solve_limits]` of `covis.toml`, and `[[tenant]]` in the file of tokens. An absent key means
//! the default, or the limit of the level above. They are enforced elsewhere.

use serde::Deserialize;

use super::engine::{AccountLimits, EngineConfig};
use crate::map::Ceilings;

/// Limits of the estimate of one solve; a solve above them is not started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SolveLimits {
    /// Memory in bytes.
    pub max_bytes: Option<u64>,
    /// Work of one iteration, Gflop.
    pub max_gflops: Option<u64>,
}

impl SolveLimits {
    /// These limits where they are set, otherwise those of `default`.
    #[must_use]
    pub fn over(&self, default: EngineConfig) -> EngineConfig {
        EngineConfig {
            max_solve_bytes: self.max_bytes.unwrap_or(default.max_solve_bytes),
            max_solve_gflops: self.max_gflops.unwrap_or(default.max_solve_gflops),
            ..default
        }
    }
}

/// Limits of a tenant, or of the server; counts from 1.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TenantLimits {
    /// Clients of all its maps.
    pub max_clients: Option<u64>,
    /// Cameras of all its maps.
    pub max_cameras: Option<u64>,
    /// Keyframes of all its maps.
    pub max_keyframes: Option<u64>,
    /// Landmarks of all its maps.
    pub max_landmarks: Option<u64>,
    /// Observations of all its maps.
    pub max_observations: Option<u64>,
    /// Relative-pose constraints of all its maps.
    pub max_constraints: Option<u64>,
    /// Priors of all its maps.
    pub max_priors: Option<u64>,
    /// Estimated memory of all its maps in bytes.
    pub max_bytes: Option<u64>,
    /// Maps.
    pub max_maps: Option<u64>,
    /// Ingest and watch streams that are open at once.
    pub max_streams: Option<u64>,
    /// Watchers at once.
    pub max_watchers: Option<u64>,
    /// Exports that are read at once.
    pub max_exports: Option<u64>,
    /// Solves that run at once, small and large ones counted separately.
    pub max_solves: Option<u64>,
    /// Calls whose solves wait in the queue.
    pub max_waiting_solves: Option<u64>,
    /// Estimated bytes of the running solves; a solve that would exceed the limit waits.
    pub max_running_solve_bytes: Option<u64>,
    /// Bytes of journals that wait for the disk.
    pub max_journal_bytes: Option<u64>,
    /// Jobs that wait or run.
    pub max_pending_jobs: Option<u64>,
    /// Bytes of uploads for jobs, and of the files that jobs made.
    pub max_job_bytes: Option<u64>,
}

impl TenantLimits {
    /// These limits where they are set, otherwise those of `default`.
    #[must_use]
    pub fn over(&self, default: AccountLimits) -> AccountLimits {
        let given = AccountLimits::from(*self);
        AccountLimits {
            held: given.held.over(&default.held),
            max_maps: given.max_maps.or(default.max_maps),
            max_streams: given.max_streams.or(default.max_streams),
            max_watchers: given.max_watchers.or(default.max_watchers),
            max_exports: given.max_exports.or(default.max_exports),
            max_solves: given.max_solves.or(default.max_solves),
            max_waiting_solves: given.max_waiting_solves.or(default.max_waiting_solves),
            max_running_solve_bytes: given
                .max_running_solve_bytes
                .or(default.max_running_solve_bytes),
            max_journal_bytes: given.max_journal_bytes.or(default.max_journal_bytes),
            max_pending_jobs: given.max_pending_jobs.or(default.max_pending_jobs),
            max_job_bytes: given.max_job_bytes.or(default.max_job_bytes),
        }
    }
}

impl From<TenantLimits> for AccountLimits {
    fn from(limits: TenantLimits) -> Self {
        let TenantLimits { max_clients, max_cameras, max_keyframes, max_landmarks, .. } = limits;
        let TenantLimits { max_observations, max_constraints, max_priors, max_bytes, .. } = limits;
        let TenantLimits { max_maps, max_streams, max_watchers, max_exports, .. } = limits;
        let TenantLimits { max_solves, max_waiting_solves, max_running_solve_bytes, .. } = limits;
        let TenantLimits { max_journal_bytes, max_pending_jobs, max_job_bytes, .. } = limits;
        let held = Ceilings {
            max_clients,
            max_cameras,
            max_keyframes,
            max_landmarks,
            max_observations,
            max_constraints,
            max_priors,
            max_bytes,
        };
        Self {
            held,
            max_maps,
            max_streams,
            max_watchers,
            max_exports,
            max_solves,
            max_waiting_solves,
            max_running_solve_bytes,
            max_journal_bytes,
            max_pending_jobs,
            max_job_bytes,
        }
    }
}
