//! The calls of each role. A role includes all lower roles.
//!
//! An RPC that is not listed needs the highest role, so that a new RPC is closed until someone
//! decides; a test compares the lists with the descriptors.

/// The rights of a token.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub(in crate::service) enum Role {
    /// Reads maps.
    Read,
    /// Creates maps, adds to them and starts solves.
    Write,
    /// Deletes permanently.
    Admin,
}

impl Role {
    /// The role with this name.
    pub(super) fn of_name(name: &str) -> Option<Self> {
        [Self::Read, Self::Write, Self::Admin].into_iter().find(|role| role.name() == name)
    }

    /// The name in the file of tokens.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Read => "read",
            Self::Write => "write",
            Self::Admin => "admin",
        }
    }
}

const READ: [&str; 16] = [
    "/covis.v1.JobService/DownloadJobFiles",
    "/covis.v1.JobService/GetJob",
    "/covis.v1.JobService/ListJobs",
    "/covis.v1.JobService/WatchJob",
    "/covis.v1.MapService/ExportMap",
    "/covis.v1.MapService/GetMap",
    "/covis.v1.MapService/GetTrajectory",
    "/covis.v1.MapService/ListConstraints",
    "/covis.v1.MapService/ListKeyframes",
    "/covis.v1.MapService/ListLandmarks",
    "/covis.v1.MapService/ListMaps",
    "/covis.v1.MapService/ListPlaceSearches",
    "/covis.v1.MapService/WatchMap",
    "/covis.v1.ServerService/GetServerInfo",
    "/grpc.reflection.v1.ServerReflection/ServerReflectionInfo",
    "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo",
];

/// Solves of problems that come with the call change nothing, but take the server's time.
const WRITE: [&str; 13] = [
    "/covis.v1.IngestService/Ingest",
    "/covis.v1.JobService/CancelJob",
    "/covis.v1.JobService/CreateJob",
    "/covis.v1.JobService/UploadJobFiles",
    "/covis.v1.MapService/CopyMap",
    "/covis.v1.MapService/CreateMap",
    "/covis.v1.MapService/ImportMap",
    "/covis.v1.MapService/UpdateMap",
    "/covis.v1.OptimizationService/Localize",
    "/covis.v1.OptimizationService/OptimizeMap",
    "/covis.v1.OptimizationService/RefinePose",
    "/covis.v1.OptimizationService/SolveBundle",
    "/covis.v1.OptimizationService/SolvePoseGraph",
];

/// The role that the RPC at `path` needs.
pub(super) fn needed(path: &str) -> Role {
    if READ.contains(&path) {
        Role::Read
    } else if WRITE.contains(&path) {
        Role::Write
    } else {
        Role::Admin
    }
}

#[cfg(test)]
mod tests {
    use prost::Message;
    use prost_types::FileDescriptorSet;

    use super::{READ, Role, WRITE, needed};

    #[test]
    fn every_rpc_of_the_wire_has_a_role() {
        let set = FileDescriptorSet::decode(crate::wire::v1::FILE_DESCRIPTOR_SET).unwrap();
        let mut paths = Vec::new();
        for file in &set.file {
            for service in &file.service {
                let name = format!("/{}.{}", file.package(), service.name());
                paths.extend(service.method.iter().map(|m| format!("{name}/{}", m.name())));
            }
        }
        let mut admin: Vec<&str> = paths.iter().map(String::as_str).collect();
        admin.retain(|path| needed(path) == Role::Admin);
        admin.sort_unstable();
        // Whoever adds an RPC decides here who may call it.
        assert_eq!(
            admin,
            [
                "/covis.v1.JobService/DeleteJob",
                "/covis.v1.MapService/DeleteMap",
                "/covis.v1.MapService/MergeMaps",
                "/covis.v1.MapService/UndoMerge",
            ]
        );
        for listed in READ.iter().chain(&WRITE).filter(|path| path.starts_with("/covis")) {
            assert!(paths.iter().any(|path| path == listed), "{listed} is no RPC");
        }
    }
}
