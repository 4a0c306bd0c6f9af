//! Spans over OTLP, in builds with the feature `opentelemetry`: a collector of a few lines gets the
//! span of a call under the caller's own, and the spans of what the call led to.

use std::collections::BTreeMap;

use prost::Message;
use tokio::net::TcpListener;
use tokio::sync::mpsc;
use tonic::codegen::http::{Request as HttpRequest, Response as HttpResponse};
use tonic::codegen::{BoxFuture, Service};
use tonic::server::{Grpc, NamedService, UnaryService};
use tonic::transport::server::TcpIncoming;
use tonic::{Request, Response, Status};
use tonic_prost::ProstCodec;

use covis::wire::v1;
use v1::ingest_request::Item;
use v1::ingest_service_client::IngestServiceClient;
use v1::map_service_client::MapServiceClient;

use crate::cli_support::{Running, Workspace};
use crate::common::{camera, keyframe, open_item, run};

/// `opentelemetry.proto.collector.trace.v1.ExportTraceServiceRequest`, as far as it is read here.
#[derive(Clone, PartialEq, Message)]
struct Export {
    #[prost(message, repeated, tag = "1")]
    resources: Vec<ResourceSpans>,
}

#[derive(Clone, PartialEq, Message)]
struct ResourceSpans {
    #[prost(message, repeated, tag = "2")]
    scopes: Vec<ScopeSpans>,
}

#[derive(Clone, PartialEq, Message)]
struct ScopeSpans {
    #[prost(message, repeated, tag = "2")]
    spans: Vec<Span>,
}

#[derive(Clone, PartialEq, Message)]
struct Span {
    #[prost(bytes = "vec", tag = "1")]
    trace_id: Vec<u8>,
    #[prost(bytes = "vec", tag = "2")]
    span_id: Vec<u8>,
    #[prost(bytes = "vec", tag = "4")]
    parent_span_id: Vec<u8>,
    #[prost(string, tag = "5")]
    name: String,
}

/// `ExportTraceServiceResponse`: all was taken.
#[derive(Clone, PartialEq, Message)]
struct Exported {}

/// Hands on what it gets.
#[derive(Clone)]
struct Collector(mpsc::UnboundedSender<Span>);

impl NamedService for Collector {
    const NAME: &'static str = "opentelemetry.proto.collector.trace.v1.TraceService";
}

impl UnaryService<Export> for Collector {
    type Response = Exported;
    type Future = BoxFuture<Response<Exported>, Status>;

    fn call(&mut self, request: Request<Export>) -> Self::Future {
        let resources = request.into_inner().resources.into_iter();
        for span in resources.flat_map(|r| r.scopes).flat_map(|s| s.spans) {
            let _read_enough = self.0.send(span);
        }
        Box::pin(async { Ok(Response::new(Exported {})) })
    }
}

impl Service<HttpRequest<tonic::body::Body>> for Collector {
    type Response = HttpResponse<tonic::body::Body>;
    type Error = std::convert::Infallible;
    type Future = BoxFuture<Self::Response, Self::Error>;

    fn poll_ready(
        &mut self,
        _: &mut std::task::Context<'_>,
    ) -> std::task::Poll<Result<(), Self::Error>> {
        std::task::Poll::Ready(Ok(()))
    }

    fn call(&mut self, request: HttpRequest<tonic::body::Body>) -> Self::Future {
        let collector = self.clone();
        Box::pin(async move {
            let mut grpc = Grpc::new(ProstCodec::<Exported, Export>::default());
            Ok(grpc.unary(collector, request).await)
        })
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

#[cfg(unix)]
#[test]
fn a_collector_gets_the_span_of_a_call_under_the_callers_own() {
    let workspace = Workspace::new();
    run(async {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let endpoint = format!("http://{}", listener.local_addr().unwrap());
        let (sender, mut spans) = mpsc::unbounded_channel();
        let router = tonic::transport::Server::builder().add_service(Collector(sender));
        let collector = tokio::spawn(router.serve_with_incoming(TcpIncoming::from(listener)));

        // The log says nothing; spans do not depend on it.
        let arguments = ["--otlp-endpoint", &endpoint, "--log", "off"];
        let mut server = Running::with(&workspace, &workspace.path("maps"), &arguments);
        let mut maps = MapServiceClient::connect(server.url.clone()).await.unwrap();
        let create = v1::CreateMapRequest { map_id: "house".to_owned(), ..Default::default() };
        let mut create = Request::new(create);
        let (trace, parent) = ("0af7651916cd43dd8448eb211c80319c", "b7ad6b7169203331");
        let traceparent = format!("00-{trace}-{parent}-01").parse().unwrap();
        create.metadata_mut().insert("traceparent", traceparent);
        maps.create_map(create).await.unwrap();
        let mut ingest = IngestServiceClient::connect(server.url.clone()).await.unwrap();
        let items = [
            open_item("house", "robot", 0),
            Item::Camera(camera(0)),
            Item::Keyframe(keyframe(0)),
            Item::Keyframe(keyframe(1)),
        ];
        let items = (0..).zip(items);
        let requests: Vec<_> = items
            .map(|(sequence, item)| v1::IngestRequest { sequence, item: Some(item) })
            .collect();
        let answers = ingest.ingest(tokio_stream::iter(requests)).await.unwrap();
        let mut answers = answers.into_inner();
        while answers.message().await.unwrap().is_some() {}
        // What is left is sent when the server ends.
        let ended = tokio::task::spawn_blocking(move || server.terminate());
        assert_eq!(ended.await.unwrap(), Some(0));

        let mut by_name: BTreeMap<String, Vec<Span>> = BTreeMap::new();
        while let Ok(span) = spans.try_recv() {
            by_name.entry(span.name.clone()).or_default().push(span);
        }
        let names: Vec<&String> = by_name.keys().collect();
        assert_eq!(names, ["item", "rpc", "solve"]);
        let rpcs = &by_name["rpc"];
        let created = rpcs.iter().find(|span| hex(&span.trace_id) == trace);
        assert_eq!(hex(&created.expect("the caller's trace").parent_span_id), parent);
        let ingested = rpcs.iter().find(|span| span.parent_span_id.is_empty());
        let ingested = ingested.expect("a call of its own trace");
        assert!(by_name["item"].iter().all(|item| {
            item.trace_id == ingested.trace_id && item.parent_span_id == ingested.span_id
        }));
        assert!(by_name["item"].len() >= 3, "{by_name:?}");
        collector.abort();
    });
}
