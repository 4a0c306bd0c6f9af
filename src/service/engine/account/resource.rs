//! The resources that accounts count, their limits, and the names of both: on the wire in errors,
//! in `GetServerInfo`, and on the metrics page. This module has no state.

use crate::map::{Ceilings, Counted};

/// A resource that is reserved. Entities of maps are counted separately.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Resource {
    /// Maps, including those that are being created.
    Maps,
    /// Ingest and watch streams that are open.
    Streams,
    /// Watchers of maps; each is a stream as well.
    Watchers,
    /// Exports that are being read; each holds a snapshot of its map.
    Exports,
    /// Calls whose solves wait in the queue.
    WaitingSolves,
    /// Estimated bytes of the running solves; a solve that would exceed the limit waits.
    RunningSolveBytes,
    /// Bytes of journals that wait for the disk.
    JournalBytes,
    /// Jobs that wait or run.
    PendingJobs,
    /// Bytes of the files of jobs: what was uploaded for them, and what they made.
    JobBytes,
}

impl Resource {
    /// All resources.
    pub const ALL: [Self; 9] = [
        Self::Maps,
        Self::Streams,
        Self::Watchers,
        Self::Exports,
        Self::WaitingSolves,
        Self::RunningSolveBytes,
        Self::JournalBytes,
        Self::PendingJobs,
        Self::JobBytes,
    ];

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Maps => "maps",
            Self::Streams => "streams",
            Self::Watchers => "watchers",
            Self::Exports => "exports",
            Self::WaitingSolves => "waiting_solves",
            Self::RunningSolveBytes => "running_solve_bytes",
            Self::JournalBytes => "journal_bytes",
            Self::PendingJobs => "pending_jobs",
            Self::JobBytes => "job_bytes",
        }
    }
}

/// Limits of an account; `None` is unlimited.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AccountLimits {
    /// Entities of the map, or of all maps together.
    pub held: Ceilings,
    /// Maps.
    pub max_maps: Option<u64>,
    /// Ingest and watch streams that are open at once.
    pub max_streams: Option<u64>,
    /// Watchers at once.
    pub max_watchers: Option<u64>,
    /// Exports that are being read; each holds a snapshot of its map.
    pub max_exports: Option<u64>,
    /// Solves that run at once, small and large ones counted separately.
    pub max_solves: Option<u64>,
    /// Calls whose solves wait in the queue.
    pub max_waiting_solves: Option<u64>,
    /// Estimated bytes of the running solves; a solve that would exceed the limit waits.
    pub max_running_solve_bytes: Option<u64>,
    /// Bytes of journals that wait for the disk. One map has at most 64 MiB; then its items wait.
    pub max_journal_bytes: Option<u64>,
    /// Jobs that wait or run.
    pub max_pending_jobs: Option<u64>,
    /// Bytes of the files of jobs: what was uploaded for them, and what they made. A job without files
    /// counts 4 KiB.
    pub max_job_bytes: Option<u64>,
}

impl AccountLimits {
    /// The limit of a resource.
    #[must_use]
    pub fn of(&self, resource: Resource) -> Option<u64> {
        match resource {
            Resource::Maps => self.max_maps,
            Resource::Streams => self.max_streams,
            Resource::Watchers => self.max_watchers,
            Resource::Exports => self.max_exports,
            Resource::WaitingSolves => self.max_waiting_solves,
            Resource::RunningSolveBytes => self.max_running_solve_bytes,
            Resource::JournalBytes => self.max_journal_bytes,
            Resource::PendingJobs => self.max_pending_jobs,
            Resource::JobBytes => self.max_job_bytes,
        }
    }
}

/// Whose account it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Owner {
    Server,
    Tenant,
    Map,
}

impl Owner {
    /// The name of a resource's limit; for a map or the server it is the name on the wire.
    pub(super) fn limit_of(self, resource: Resource) -> &'static str {
        match (self, resource) {
            (Self::Tenant, Resource::Maps) => "tenant_max_map_count",
            (Self::Tenant, Resource::Streams) => "tenant_max_stream_count",
            (Self::Tenant, Resource::Watchers) => "tenant_max_watcher_count",
            (Self::Tenant, Resource::Exports) => "tenant_max_export_count",
            (Self::Tenant, Resource::WaitingSolves) => "tenant_max_waiting_solve_count",
            (Self::Tenant, Resource::RunningSolveBytes) => "tenant_max_running_solve_bytes",
            (Self::Tenant, Resource::JournalBytes) => "tenant_max_journal_bytes",
            (Self::Tenant, Resource::PendingJobs) => "tenant_max_pending_job_count",
            (Self::Tenant, Resource::JobBytes) => "tenant_max_job_bytes",
            (Self::Map | Self::Server, Resource::Maps) => "max_map_count",
            (Self::Map | Self::Server, Resource::Streams) => "max_stream_count",
            (Self::Map | Self::Server, Resource::Watchers) => "max_watcher_count",
            (Self::Map | Self::Server, Resource::Exports) => "max_export_count",
            (Self::Map | Self::Server, Resource::WaitingSolves) => "max_waiting_solve_count",
            (Self::Map | Self::Server, Resource::RunningSolveBytes) => "max_running_solve_bytes",
            (Self::Map | Self::Server, Resource::JournalBytes) => "max_journal_bytes",
            (Self::Map | Self::Server, Resource::PendingJobs) => "max_pending_job_count",
            (Self::Map | Self::Server, Resource::JobBytes) => "max_job_bytes",
        }
    }

    /// The name of a ceiling of entities, likewise.
    pub(super) fn ceiling_of(self, counted: Counted) -> &'static str {
        match (self, counted) {
            (Self::Tenant, Counted::Clients) => "tenant_max_client_count",
            (Self::Tenant, Counted::Cameras) => "tenant_max_camera_count",
            (Self::Tenant, Counted::Keyframes) => "tenant_max_keyframe_count",
            (Self::Tenant, Counted::Landmarks) => "tenant_max_landmark_count",
            (Self::Tenant, Counted::Observations) => "tenant_max_observation_count",
            (Self::Tenant, Counted::Constraints) => "tenant_max_constraint_count",
            (Self::Tenant, Counted::Priors) => "tenant_max_prior_count",
            (Self::Tenant, Counted::Bytes) => "tenant_max_size_bytes",
            (Self::Map | Self::Server, Counted::Clients) => "max_client_count",
            (Self::Map | Self::Server, Counted::Cameras) => "max_camera_count",
            (Self::Map | Self::Server, Counted::Keyframes) => "max_keyframe_count",
            (Self::Map | Self::Server, Counted::Landmarks) => "max_landmark_count",
            (Self::Map | Self::Server, Counted::Observations) => "max_observation_count",
            (Self::Map | Self::Server, Counted::Constraints) => "max_constraint_count",
            (Self::Map | Self::Server, Counted::Priors) => "max_prior_count",
            (Self::Map | Self::Server, Counted::Bytes) => "max_size_bytes",
        }
    }
}

/// One line of an account.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AccountRow {
    /// What is counted.
    pub name: &'static str,
    /// How much is held.
    pub held: u64,
    /// The limit; `None` is unlimited.
    pub limit: Option<u64>,
}

pub(super) fn name_of(counted: Counted) -> &'static str {
    match counted {
        Counted::Clients => "clients",
        Counted::Cameras => "cameras",
        Counted::Keyframes => "keyframes",
        Counted::Landmarks => "landmarks",
        Counted::Observations => "observations",
        Counted::Constraints => "constraints",
        Counted::Priors => "priors",
        Counted::Bytes => "map_bytes",
    }
}
