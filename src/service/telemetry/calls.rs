//! Counts every call by RPC and status code and measures its duration; a stream counts until its
//! end.
//!
//! [`Metered`] is the outermost layer, so that refused calls count too. The code of an answer with
//! a body is in its trailers; an answer that is dropped before them was canceled. Only RPCs that
//! the server knows have their own rows; any other path is counted as `other`. It changes no answer.

use std::collections::BTreeMap;
use std::future::Future;
use std::pin::Pin;
use std::sync::{Arc, LazyLock};
use std::task::{Context, Poll};
use std::time::Instant;

use hyper::body::{Body as HttpBody, Bytes, Frame, SizeHint};
use prost::Message;
use prost_types::FileDescriptorSet;
use tonic::body::Body;
use tonic::codegen::Service;
use tonic::codegen::http::{HeaderMap, Request, Response};
use tonic::server::NamedService;
use tracing::Instrument;

use super::parent;
use crate::meter::{Counter, Histogram};
use crate::service::connections::{OpenCall, Peer};
use crate::wire::v1;

/// The codes of gRPC, by number.
const CODES: [&str; 17] = [
    "OK",
    "CANCELLED",
    "UNKNOWN",
    "INVALID_ARGUMENT",
    "DEADLINE_EXCEEDED",
    "NOT_FOUND",
    "ALREADY_EXISTS",
    "PERMISSION_DENIED",
    "RESOURCE_EXHAUSTED",
    "FAILED_PRECONDITION",
    "ABORTED",
    "OUT_OF_RANGE",
    "UNIMPLEMENTED",
    "INTERNAL",
    "UNAVAILABLE",
    "DATA_LOSS",
    "UNAUTHENTICATED",
];
const CANCELED: usize = 1;

/// Instruments of one RPC.
#[derive(Debug)]
pub(super) struct CallMeter {
    codes: [Counter; CODES.len()],
    /// From the headers of the request to the end of the answer, ns.
    pub(super) duration_ns: Histogram,
}

impl CallMeter {
    fn new() -> Arc<Self> {
        Arc::new(Self { codes: Default::default(), duration_ns: Histogram::default() })
    }

    /// The codes that occurred, with the number of calls that ended with each.
    pub(super) fn codes(&self) -> impl Iterator<Item = (&'static str, u64)> {
        let rows = CODES.into_iter().zip(&self.codes).map(|(code, count)| (code, count.get()));
        rows.filter(|&(_, count)| count > 0)
    }
}

/// Instruments of all RPCs.
#[derive(Debug)]
pub(in crate::service) struct CallMeters {
    known: BTreeMap<String, Arc<CallMeter>>,
    other: Arc<CallMeter>,
}

impl CallMeters {
    /// Instruments for each RPC of the wire and of health.
    pub(super) fn new() -> Self {
        static RPCS: LazyLock<Vec<String>> = LazyLock::new(rpcs);
        let known = RPCS.iter().map(|rpc| (rpc.clone(), CallMeter::new())).collect();
        Self { known, other: CallMeter::new() }
    }

    /// The RPCs that were called, by name.
    pub(super) fn rows(&self) -> impl Iterator<Item = (&str, &CallMeter)> {
        let known = self.known.iter().map(|(name, meter)| (name.as_str(), &**meter));
        let rows = known.chain([("other", &*self.other)]);
        rows.filter(|(_, meter)| meter.codes().next().is_some())
    }

    /// The name that a path is counted under, and its instruments.
    fn of(&self, path: &str) -> (&str, &Arc<CallMeter>) {
        let known = self.known.get_key_value(path.trim_start_matches('/'));
        known.map_or(("other", &self.other), |(name, meter)| (name, meter))
    }
}

/// Each RPC as `package.Service/Method`.
fn rpcs() -> Vec<String> {
    let sets = [v1::FILE_DESCRIPTOR_SET, tonic_health::pb::FILE_DESCRIPTOR_SET];
    let files = sets.into_iter().filter_map(|set| FileDescriptorSet::decode(set).ok());
    let mut rpcs = Vec::new();
    for file in files.flat_map(|set| set.file) {
        for service in &file.service {
            let service_name = format!("{}.{}", file.package(), service.name());
            let names = service.method.iter().map(|method| method.name());
            rpcs.extend(names.map(|name| format!("{service_name}/{name}")));
        }
    }
    rpcs
}

/// A service whose calls are counted.
#[derive(Clone, Debug)]
pub(in crate::service) struct Metered<S> {
    service: S,
    meters: Arc<CallMeters>,
}

impl<S> Metered<S> {
    /// Counts the calls of `service`.
    pub(in crate::service) fn new(service: S, meters: &Arc<CallMeters>) -> Self {
        Self { service, meters: Arc::clone(meters) }
    }
}

impl<S: NamedService> NamedService for Metered<S> {
    const NAME: &'static str = S::NAME;
}

impl<S> Service<Request<Body>> for Metered<S>
where
    S: Service<Request<Body>, Response = Response<Body>>,
    S::Future: Send + 'static,
{
    type Response = Response<Body>;
    type Error = S::Error;
    type Future = Pin<Box<dyn Future<Output = Result<Response<Body>, S::Error>> + Send>>;

    fn poll_ready(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.service.poll_ready(cx)
    }

    fn call(&mut self, request: Request<Body>) -> Self::Future {
        let (name, meter) = self.meters.of(request.uri().path());
        let (meter, since) = (Arc::clone(meter), Instant::now());
        let open = request.extensions().get().map(Peer::call);
        let call = Call { meter, since, code: CANCELED, _open: open };
        let span = tracing::debug_span!("rpc", rpc = name);
        parent::adopt(&span, request.headers());
        let answer = span.in_scope(|| self.service.call(request));
        let answering = async move {
            let response = answer.await?;
            Ok(match code(response.headers()) {
                Some(code) => {
                    call.ended(code);
                    response
                }
                None => response.map(|body| {
                    Body::new(Answer { body, span: tracing::Span::current(), call: Some(call) })
                }),
            })
        };
        Box::pin(answering.instrument(span))
    }
}

/// A call that runs; counted when it is dropped.
#[derive(Debug)]
struct Call {
    meter: Arc<CallMeter>,
    since: Instant,
    code: usize,
    /// Keeps its connection from being idle.
    _open: Option<OpenCall>,
}

impl Call {
    fn ended(mut self, code: usize) {
        self.code = code;
    }
}

impl Drop for Call {
    fn drop(&mut self) {
        self.meter.duration_ns.observe_time(self.since.elapsed());
        if let Some(count) = self.meter.codes.get(self.code) {
            count.increment();
        }
    }
}

/// The number of the status in these headers or trailers.
fn code(headers: &HeaderMap) -> Option<usize> {
    let number = headers.get("grpc-status")?.to_str().ok()?.parse().ok()?;
    Some(if number < CODES.len() { number } else { 2 })
}

/// A body whose trailers are read when they pass. The span ends with the body.
struct Answer {
    body: Body,
    span: tracing::Span,
    /// `None` once the call is counted.
    call: Option<Call>,
}

impl HttpBody for Answer {
    type Data = Bytes;
    type Error = tonic::Status;

    fn poll_frame(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, tonic::Status>>> {
        let Self { body, span, call } = self.get_mut();
        let _entered = span.enter();
        let frame = Pin::new(body).poll_frame(cx);
        if let Poll::Ready(Some(Ok(frame))) = &frame
            && let Some(code) = frame.trailers_ref().and_then(code)
            && let Some(call) = call.take()
        {
            call.ended(code);
        }
        frame
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}
