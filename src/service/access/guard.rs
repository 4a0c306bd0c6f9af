//! The guard in front of a service: a request that is not admitted reaches no handler.
//!
//! It reads only the path and the headers, never the body.

use std::future::{Ready, ready};
use std::sync::Arc;
use std::task::{Context, Poll};

use futures_util::future::Either;
use tonic::Status;
use tonic::body::Body;
use tonic::codegen::Service;
use tonic::codegen::http::{Request, Response};
use tonic::server::NamedService;

use super::Access;
use crate::service::connections::Peer;
use crate::service::deadline::Arrival;

/// A service that only serves callers that [`Access`] admits.
#[derive(Clone, Debug)]
pub(in crate::service) struct Guarded<S> {
    service: S,
    access: Arc<Access>,
}

impl<S> Guarded<S> {
    /// Puts the guard in front of `service`.
    pub(in crate::service) fn new(service: S, access: &Arc<Access>) -> Self {
        Self { service, access: Arc::clone(access) }
    }
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
            Err(error) => Either::Left(ready(Ok(Status::from(error).into_http()))),
        }
    }
}
