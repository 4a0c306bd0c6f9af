//! `ServerService`: version, limits, durability, features. The health service reports whether the
//! server is healthy. It reads the configuration and asks no engine.

use covis_solvers::simd::Class;
use tonic::{Request, Response, Status};

use super::access::Caller;
use super::context::Rpcs;
use super::convert::map::{to_durability, to_limits};
use super::convert::time::timestamp;
use super::convert::{count, small};
use crate::wire::v1;
use v1::server_service_server::ServerService;

/// What is served, sorted; listed in docs/wire.md.
const FEATURES: [&str; 53] = [
    "export.colmap-binary",
    "export.colmap-text",
    "export.covis",
    "export.g2o",
    "export.ply",
    "export.tum",
    "import.colmap-binary",
    "import.colmap-text",
    "import.covis",
    "import.g2o",
    "import.tum",
    "ingest.camera",
    "ingest.fuse-landmarks",
    "ingest.keyframe",
    "ingest.landmarks",
    "ingest.observations",
    "ingest.pose-prior",
    "ingest.position-prior",
    "ingest.relative-pose",
    "ingest.remove-keyframe",
    "ingest.remove-landmarks",
    "ingest.remove-observations",
    "ingest.revoke-constraint",
    "ingest.set-camera",
    "job.compact",
    "job.evaluate",
    "job.export",
    "job.merge",
    "job.optimize-map",
    "job.optimize-pose-graph",
    "job.rebuild",
    "job.solve-files",
    "map.closure-adjustment",
    "map.copy",
    "map.freeze",
    "map.hints",
    "map.list-constraints",
    "map.list-keyframes",
    "map.list-place-searches",
    "map.merge",
    "map.pending-work",
    "map.place-recognition",
    "map.update",
    "map.watch",
    "map.watch-resolution",
    "optimization.certify",
    "optimization.localize",
    "optimization.optimize-map",
    "optimization.optimize-pose-graph",
    "optimization.refine-pose",
    "optimization.robust-closures",
    "optimization.solve-bundle",
    "optimization.solve-pose-graph",
];

impl Rpcs {
    fn info(&self, caller: &Caller) -> v1::GetServerInfoResponse {
        let config = &self.context.config;
        let bytes = count(config.max_message_bytes);
        let limits = v1::ServerLimits {
            max_receive_message_bytes: bytes,
            max_send_message_bytes: bytes,
            max_map_count: count(config.most_maps()),
            max_concurrent_stream_count: i32::try_from(config.max_concurrent_streams)
                .unwrap_or(i32::MAX),
            map_limits: Some(to_limits(&config.map_limits, config.engine.queue_capacity)),
        };
        let number = |value: u64| i64::try_from(value).unwrap_or(i64::MAX);
        let account = self.context.maps.pool().accounts().tenant(caller.tenant());
        let resources = account.rows().into_iter().map(|row| v1::ResourceUsage {
            resource: row.name.to_owned(),
            held: number(row.held),
            limit: row.limit.map(number),
        });
        let resources = resources.collect();
        v1::GetServerInfoResponse {
            version: env!("CARGO_PKG_VERSION").to_owned(),
            wire_packages: vec!["covis.v1".to_owned()],
            instance_id: self.context.instance_id.clone(),
            start_time: Some(timestamp(self.context.start_time_ns)),
            durability: to_durability(self.context.maps.durability()).into(),
            lock_step: config.engine.lock_step,
            limits: Some(limits),
            features: FEATURES.into_iter().map(str::to_owned).collect(),
            solver_thread_count: small(self.context.maps.pool().threads()),
            simd_class: Class::detect().to_string(),
            resources,
        }
    }
}

#[async_trait::async_trait]
impl ServerService for Rpcs {
    async fn get_server_info(
        &self,
        request: Request<v1::GetServerInfoRequest>,
    ) -> Result<Response<v1::GetServerInfoResponse>, Status> {
        self.context.answer("GetServerInfo", async { Ok(self.info(&Caller::of(&request)?)) }).await
    }
}
