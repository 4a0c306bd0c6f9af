//! The guard in front of a service: a request that is not admitted reaches no handler.
//!
//! It reads only the path and the headers, never the body. A refusal is a status of gRPC; where plain HTTP
//! is served it has the status of HTTP as well, because no such client reads the other one.

use std::future::{Ready, ready};
use std::sync::Arc;
use std::task::{Context, Poll};

use futures_util::future::Either;
use tonic::body::Body;
use tonic::codegen::Service;
use tonic::codegen::http::header::{CONTENT_TYPE, WWW_AUTHENTICATE};
use tonic::codegen::http::{HeaderValue, Request, Response, StatusCode};
use tonic::server::NamedService;
use tonic::{Code, Status};

use super::Access;
use crate::service::connections::Peer;
use crate::service::deadline::Arrival;

/// A service that only serves callers that [`Access`] admits.
#[derive(Clone, Debug)]
pub(in crate::service) struct Guarded<S> {
    service: S,
    access: Arc<Access>,
    refuse: fn(Status) -> Response<Body>,
}

impl<S> Guarded<S> {
    /// Puts the guard in front of a `service` of gRPC.
    pub(in crate::service) fn new(service: S, access: &Arc<Access>) -> Self {
        Self { service, access: Arc::clone(access), refuse: Status::into_http }
    }

    /// Puts the guard in front of a `service` of plain HTTP.
    pub(in crate::service) fn plain(service: S, access: &Arc<Access>) -> Self {
        Self { service, access: Arc::clone(access), refuse: refused_plainly }
    }
}

/// A refusal for a client of plain HTTP: 401 without a known token, 403 where its role is too low, 503
/// where there is no place for it.
fn refused_plainly(status: Status) -> Response<Body> {
    let (code, text) = (status.code(), format!("{}\n", status.message()));
    let mut response = status.into_http::<Body>().map(|_empty| Body::new(text));
    let headers = response.headers_mut();
    headers.insert(CONTENT_TYPE, HeaderValue::from_static("text/plain; charset=utf-8"));
    let http = if code == Code::Unauthenticated {
        headers.insert(WWW_AUTHENTICATE, HeaderValue::from_static("Bearer"));
        StatusCode::UNAUTHORIZED
    } else if code == Code::PermissionDenied {
        StatusCode::FORBIDDEN
    } else {
        StatusCode::SERVICE_UNAVAILABLE
    };
    *response.status_mut() = http;
    response
}

impl<S: NamedService> NamedService for Guarded<S> {
    const NAME: &'static str = S::NAME;
}

impl<S> Service<Request<Body>> for Guarded<S>
where
    S: Service<Request<Body>, Response = Response<Body>>,
{
    type Response = Response<Body>;
    type Error = S::Error;
    type Future = Either<Ready<Result<Response<Body>, S::Error>>, S::Future>;

    fn poll_ready(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.service.poll_ready(cx)
    }

    fn call(&mut self, mut request: Request<Body>) -> Self::Future {
        let admitted = self.access.admit(request.uri().path(), request.headers());
        // An admitted caller keeps its connection longer than a stranger.
        let peer = request.extensions().get::<Peer>();
        match admitted.and_then(|caller| peer.map_or(Ok(()), Peer::admitted).map(|()| caller)) {
            Ok(caller) => {
                if let Some(peer) = peer.cloned() {
                    request = request.map(|body| peer.arriving(body));
                }
                request.extensions_mut().insert(caller);
                request.extensions_mut().insert(Arrival::now());
                Either::Right(self.service.call(request))
            }
            Err(error) => Either::Left(ready(Ok((self.refuse)(Status::from(error))))),
        }
    }
}
