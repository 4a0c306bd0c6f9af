//! The page that shows maps in a browser, on its own listener.
//!
//! The page is a client like any other: it calls the services of the wire by gRPC-Web, behind the same
//! guard and with the same limits. Without a token it gets only the files it consists of.
//!
//! | module | role |
//! |---|---|
//! | `assets` | the files of the page, and the headers that they are answered with |
//! | `grpc_web` | calls without trailers |
//!
//! Requests that another site has sent through a browser are refused by [`super::same_site`].
//!
//! The sources of the page are in `page/`; this module knows only the files that are built from them.

mod assets;
mod grpc_web;

use std::convert::Infallible;
use std::future::{Ready, ready};
use std::task::{Context, Poll};

use tonic::body::Body;
use tonic::codegen::Service;
use tonic::codegen::http::{Request, Response};
use tonic::server::NamedService;
use tonic::service::Routes;

pub(super) use assets::text;
use grpc_web::GrpcWeb;

use super::same_site::{Hosts, SameSite};

/// A service that answers each request at once, by a function.
#[derive(Clone, Copy, Debug)]
pub(super) struct Answering<F>(pub(super) F);

impl<F: Fn(&Request<Body>) -> Response<Body>> Service<Request<Body>> for Answering<F> {
    type Response = Response<Body>;
    type Error = Infallible;
    type Future = Ready<Result<Response<Body>, Infallible>>;

    fn poll_ready(&mut self, _cx: &mut Context<'_>) -> Poll<Result<(), Infallible>> {
        Poll::Ready(Ok(()))
    }

    fn call(&mut self, request: Request<Body>) -> Self::Future {
        ready(Ok((self.0)(&request)))
    }
}

/// The routes of the page's listener.
pub(super) struct PageRoutes {
    hosts: Hosts,
    routes: Routes,
}

impl PageRoutes {
    /// The files of the page, and `metrics` at `/metrics`, for requests that `hosts` allows.
    pub(super) fn new<M>(hosts: Hosts, metrics: M) -> Self
    where
        M: Service<Request<Body>, Response = Response<Body>, Error = Infallible>,
        M: Clone + Send + Sync + 'static,
        M::Future: Send,
    {
        let mut routes = Routes::default();
        let router = routes.axum_router_mut();
        *router = std::mem::take(router)
            .route_service("/metrics", SameSite::new(metrics, hosts))
            .fallback_service(SameSite::new(Answering(assets::answer), hosts));
        Self { hosts, routes }
    }

    /// With this service too, by gRPC-Web.
    pub(super) fn add<S>(self, service: S) -> Self
    where
        S: Service<Request<Body>, Response = Response<Body>, Error = Infallible> + NamedService,
        S: Clone + Send + Sync + 'static,
        S::Future: Send,
    {
        let service = SameSite::new(GrpcWeb(service), self.hosts);
        Self { routes: self.routes.add_service(service), ..self }
    }

    /// The routes.
    pub(super) fn routes(self) -> Routes {
        self.routes.prepare()
    }
}
