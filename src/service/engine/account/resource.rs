//! The resources that accounts count, their limits, and the names of both: in files of limits, on the
//! wire in errors, in `GetServerInfo`, and on the metrics page. This module has no state.

use std::collections::BTreeMap;

use serde::de::{Deserialize, Deserializer, Error as _};

use crate::map::{Counted, Counts, MapLimits};

/// A resource that is reserved. Entities of maps are counted separately.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Resource {
    /// Maps, including those that are being created.
    Maps,
    /// Ingest and watch streams that are open.
    Streams,
    /// Watchers of maps; each is a stream as well.
    Watchers,
    /// Exports that are being read, each of which holds a snapshot of its map, and downloads of files of
    /// jobs.
    Exports,
    /// Lists and trajectories of maps that are being read, each of which holds a snapshot of its map.
    Lists,
    /// Calls whose solves wait in the queue.
    WaitingSolves,
    /// Estimated bytes of what calls with a problem of their own hold while they wait in the queue.
    WaitingSolveBytes,
    /// Estimated bytes of the running solves; a solve that would exceed the limit waits.
    RunningSolveBytes,
    /// Bytes of journals that wait for the disk. One map has at most 64 MiB; then its items wait.
    JournalBytes,
    /// Jobs that wait or run.
    PendingJobs,
    /// Bytes of the files of jobs: what was uploaded for them, and what they made. Each file and each
    /// upload counts 8 KiB more, each job 4 KiB and its record, and until it has ended the lists of its spec
    /// in memory.
    JobBytes,
    /// Uploads that no job has taken, those that are being sent too.
    Uploads,
    /// Solves that run at once, small and large ones counted separately. The pool counts them.
    Solves,
}

impl Resource {
    /// All resources.
    pub const ALL: [Self; 13] = [
        Self::Maps,
        Self::Streams,
        Self::Watchers,
        Self::Exports,
        Self::Lists,
        Self::WaitingSolves,
        Self::WaitingSolveBytes,
        Self::RunningSolveBytes,
        Self::JournalBytes,
        Self::PendingJobs,
        Self::JobBytes,
        Self::Uploads,
        Self::Solves,
    ];

    /// Its name, and that of its limit for a tenant.
    fn names(self) -> Names {
        match self {
            Self::Maps => ("maps", "tenant_max_map_count"),
            Self::Streams => ("streams", "tenant_max_stream_count"),
            Self::Watchers => ("watchers", "tenant_max_watcher_count"),
            Self::Exports => ("exports", "tenant_max_export_count"),
            Self::Lists => ("lists", "tenant_max_list_count"),
            Self::WaitingSolves => ("waiting_solves", "tenant_max_waiting_solve_count"),
            Self::WaitingSolveBytes => ("waiting_solve_bytes", "tenant_max_waiting_solve_bytes"),
            Self::RunningSolveBytes => ("running_solve_bytes", "tenant_max_running_solve_bytes"),
            Self::JournalBytes => ("journal_bytes", "tenant_max_journal_bytes"),
            Self::PendingJobs => ("pending_jobs", "tenant_max_pending_job_count"),
            Self::JobBytes => ("job_bytes", "tenant_max_job_bytes"),
            Self::Uploads => ("uploads", "tenant_max_upload_count"),
            Self::Solves => ("solves", "tenant_max_solve_count"),
        }
    }

    pub(super) fn name(self) -> &'static str {
        self.names().0
    }
}

type Names = (&'static str, &'static str);

/// The same names of what maps hold.
const COUNTED: Counts<Names> = Counts {
    clients: ("clients", "tenant_max_client_count"),
    cameras: ("cameras", "tenant_max_camera_count"),
    keyframes: ("keyframes", "tenant_max_keyframe_count"),
    landmarks: ("landmarks", "tenant_max_landmark_count"),
    observations: ("observations", "tenant_max_observation_count"),
    constraints: ("constraints", "tenant_max_constraint_count"),
    priors: ("priors", "tenant_max_prior_count"),
    bytes: ("bytes", "tenant_max_size_bytes"),
};

/// Limits of an account; what has none is unlimited. In files (`[tenant_limits]` and `[server_limits]` of
/// `covis.toml`, `limits` of a tenant in the file of tokens) the keys are `max_maps`, `max_keyframes` and
/// so on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Deserialize)]
#[serde(from = "BTreeMap<Key, u64>")]
pub struct AccountLimits {
    /// Entities of the map, or of all maps together.
    pub held: MapLimits,
    reserved: [Option<u64>; Resource::ALL.len()],
}

impl AccountLimits {
    /// Limits of entities, and no others.
    #[must_use]
    pub fn of_maps(held: MapLimits) -> Self {
        Self { held, ..Self::default() }
    }

    /// These limits, with another one of a resource.
    #[must_use]
    pub fn with(mut self, resource: Resource, limit: u64) -> Self {
        self.reserved[resource as usize] = Some(limit);
        self
    }

    /// The limit of a resource.
    pub fn of(&self, resource: Resource) -> Option<u64> {
        self.reserved[resource as usize]
    }

    /// These limits where they are set, otherwise those of `default`.
    #[must_use]
    pub fn over(&self, default: &Self) -> Self {
        Self {
            held: self.held.over(&default.held),
            reserved: Resource::ALL.map(|resource| self.of(resource).or(default.of(resource))),
        }
    }
}

/// The key of a limit in a file.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Key {
    Counted(Counted),
    Resource(Resource),
}

impl<'de> Deserialize<'de> for Key {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let key = String::deserialize(deserializer)?;
        let counted = Counted::ALL.map(|counted| (COUNTED.of(counted).0, Self::Counted(counted)));
        let resources = Resource::ALL.map(|resource| (resource.name(), Self::Resource(resource)));
        let all = || counted.into_iter().chain(resources);
        let found = all().find(|(name, _)| key.strip_prefix("max_") == Some(name));
        found.map(|(_, found)| found).ok_or_else(|| {
            let known: Vec<String> = all().map(|(name, _)| format!("`max_{name}`")).collect();
            D::Error::custom(format!("unknown key `{key}`, expected one of {}", known.join(", ")))
        })
    }
}

impl From<BTreeMap<Key, u64>> for AccountLimits {
    fn from(given: BTreeMap<Key, u64>) -> Self {
        let limit = |key| given.get(&key).copied();
        Self {
            held: MapLimits::each(|counted| limit(Key::Counted(counted))),
            reserved: Resource::ALL.map(|resource| limit(Key::Resource(resource))),
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
        self.named(resource.names())
    }

    /// The name of a limit of entities, likewise.
    pub(super) fn limit_of_counted(self, counted: Counted) -> &'static str {
        self.named(COUNTED.of(counted))
    }

    fn named(self, (_, of_tenant): Names) -> &'static str {
        match self {
            Self::Tenant => of_tenant,
            Self::Map | Self::Server => of_tenant.strip_prefix("tenant_").unwrap_or(of_tenant),
        }
    }
}

/// The name on the wire of a map's limit.
pub fn limit_name(counted: Counted) -> &'static str {
    Owner::Map.limit_of_counted(counted)
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
    // Beside the bytes of journals and solves.
    if counted == Counted::Bytes { "map_bytes" } else { COUNTED.of(counted).0 }
}
