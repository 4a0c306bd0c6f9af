//! The services of the wire, each behind the guard and counted, as routes of the two listeners that
//! share them: that of gRPC, which takes nothing else, and that of the page.
//!
//! Nothing is accepted here; [`super::connections`] does.

use std::sync::Arc;

use tonic::body::Body;
use tonic::codec::CompressionEncoding;
use tonic::codegen::http::Request;
use tonic::server::NamedService;
use tonic::service::Routes;
use tonic_health::ServingStatus;
use tonic_health::server::HealthReporter;

use super::access::Guarded;
use super::context::{Context, Rpcs};
use super::grpc_only::{GrpcOnly, with_fallback};
use super::job_service::JobRpcs;
use super::jobs::Jobs;
use super::page::{Answering, PageRoutes};
use super::same_site::Hosts;
use super::server::ServerError;
use super::telemetry::{Metered, respond};
use crate::wire::v1::ingest_service_server::IngestServiceServer;
use crate::wire::v1::job_service_server::JobServiceServer;
use crate::wire::v1::map_service_server::MapServiceServer;
use crate::wire::v1::optimization_service_server::OptimizationServiceServer;
use crate::wire::v1::server_service_server::ServerServiceServer;

/// How much a stream may send before the server reads, bytes.
const STREAM_WINDOW_BYTES: u32 = 256 << 10;
/// The same for a connection. The transport drops a connection whose unread small frames cost more
/// than half of this, 256 bytes each; a stream full of the smallest items stays below.
const CONNECTION_WINDOW_BYTES: u32 = 8 << 20;
/// The largest message to a service that needs no large ones: health, which needs no token.
const SMALL_MESSAGE_BYTES: usize = 4 << 10;
/// All headers of a call together; a JSON Web Token is a few KiB.
const HEADER_LIST_BYTES: u32 = 16 << 10;

/// Every service of the wire that is served, by full name.
pub(super) const SERVED: [&str; 5] = [
    IngestServiceServer::<Rpcs>::NAME,
    JobServiceServer::<JobRpcs>::NAME,
    MapServiceServer::<Rpcs>::NAME,
    OptimizationServiceServer::<Rpcs>::NAME,
    ServerServiceServer::<Rpcs>::NAME,
];

/// What the listeners serve.
pub(super) struct Routed {
    /// Reports the state of the services.
    pub(super) health: HealthReporter,
    /// The routes of the listener of gRPC.
    pub(super) grpc: Routes,
    /// Those of the listener of the page.
    pub(super) page: Option<Routes>,
}

/// The settings of HTTP/2.
pub(super) fn transport(context: &Context) -> tonic::transport::Server {
    let keep_alive = context.config.keep_alive;
    tonic::transport::Server::builder()
        .max_concurrent_streams(context.config.max_concurrent_streams)
        .initial_stream_window_size(STREAM_WINDOW_BYTES)
        .initial_connection_window_size(CONNECTION_WINDOW_BYTES)
        .http2_max_header_list_size(HEADER_LIST_BYTES)
        .http2_keepalive_interval(Some(keep_alive.interval))
        .http2_keepalive_timeout(Some(keep_alive.timeout))
}

/// Makes the services; those of the page if it is served, for the names in `hosts`.
pub(super) async fn routes(
    context: &Arc<Context>,
    jobs: &Arc<Jobs>,
    hosts: Option<Hosts>,
) -> Result<Routed, ServerError> {
    let bytes = context.config.max_message_bytes;
    // The generated servers share no trait for their limits.
    macro_rules! limited {
        ($service:expr) => {
            $service.max_decoding_message_size(bytes).max_encoding_message_size(bytes)
        };
    }
    // A client may send messages compressed; the limit applies to the decompressed size.
    macro_rules! compressed {
        ($service:expr) => {
            $service.accept_compressed(CompressionEncoding::Gzip)
        };
    }
    macro_rules! metered {
        ($service:expr) => {
            Metered::new($service, &context.meters.calls)
        };
    }
    // Health needs no token, because monitoring has none.
    macro_rules! guarded {
        ($service:expr) => {
            metered!(Guarded::new($service, &context.access))
        };
    }
    let (health, health_service) = tonic_health::server::health_reporter();
    for name in SERVED.into_iter().chain([""]) {
        health.set_service_status(name, ServingStatus::NotServing).await;
    }
    // Only corrections and exports are large enough to compress in answers; acks are not.
    let rpcs = Arc::new(Rpcs { context: Arc::clone(context) });
    let maps = compressed!(MapServiceServer::from_arc(Arc::clone(&rpcs)))
        .send_compressed(CompressionEncoding::Gzip);
    let maps = guarded!(limited!(maps));
    let ingest = compressed!(IngestServiceServer::from_arc(Arc::clone(&rpcs)));
    let optimization = compressed!(OptimizationServiceServer::from_arc(Arc::clone(&rpcs)))
        .send_compressed(CompressionEncoding::Gzip);
    let job_rpcs = JobRpcs { context: Arc::clone(context), jobs: Arc::clone(jobs) };
    let job_rpcs =
        compressed!(JobServiceServer::new(job_rpcs)).send_compressed(CompressionEncoding::Gzip);
    let job_rpcs = guarded!(limited!(job_rpcs));
    let info = guarded!(limited!(ServerServiceServer::from_arc(rpcs)));
    let health_service = health_service.max_decoding_message_size(SMALL_MESSAGE_BYTES);
    let page = hosts.map(|hosts| {
        let access = &context.access;
        let (context, jobs) = (Arc::clone(context), Arc::clone(jobs));
        let metrics = Answering(move |request: &Request<Body>| {
            respond(request, &context, &jobs).map(Body::new)
        });
        let metrics = Guarded::plain(metrics, access);
        let page = PageRoutes::new(hosts, metrics);
        page.add(maps.clone()).add(job_rpcs.clone()).add(info.clone()).routes()
    });
    let grpc = Routes::new(GrpcOnly::new(maps))
        .add_service(GrpcOnly::new(guarded!(limited!(ingest))))
        .add_service(GrpcOnly::new(guarded!(limited!(optimization))))
        .add_service(GrpcOnly::new(job_rpcs))
        .add_service(GrpcOnly::new(info))
        .add_service(GrpcOnly::new(metered!(health_service)));
    // The simulation starts thousands of servers, and reading the descriptors is half of a start.
    #[cfg(not(test))]
    let grpc = {
        let reflection = || {
            tonic_reflection::server::Builder::configure()
                .register_encoded_file_descriptor_set(crate::wire::v1::FILE_DESCRIPTOR_SET)
                .register_encoded_file_descriptor_set(tonic_health::pb::FILE_DESCRIPTOR_SET)
        };
        grpc.add_service(GrpcOnly::new(guarded!(limited!(reflection().build_v1()?))))
            .add_service(GrpcOnly::new(guarded!(limited!(reflection().build_v1alpha()?))))
    };
    Ok(Routed { health, grpc: with_fallback(grpc).prepare(), page })
}
