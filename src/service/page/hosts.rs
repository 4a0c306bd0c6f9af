//! Refuses requests that another site has sent through somebody's browser.
//!
//! A browser on this machine reaches a server on loopback, and so does each site that it shows. Two
//! headers that a site cannot forge tell its requests apart: `Origin`, which must be the server's own,
//! and `Host`, which holds the site's name after it let that name lead to loopback (DNS rebinding).

use std::future::{Ready, ready};
use std::net::{IpAddr, SocketAddr};
use std::task::{Context, Poll};

use futures_util::future::Either;
use hyper::body::{Body as HttpBody, Bytes};
use tonic::body::Body;
use tonic::codegen::http::header::{HOST, ORIGIN};
use tonic::codegen::http::uri::Authority;
use tonic::codegen::http::{HeaderName, HeaderValue, Request, Response, StatusCode};
use tonic::codegen::{Service, StdError};
use tonic::server::NamedService;

use super::assets::text;

/// The names by which a browser may call the server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::service) enum Hosts {
    /// Any: a token or a certificate keeps others out.
    Any,
    /// `localhost` and addresses.
    Local,
}

impl Hosts {
    /// The names that are allowed at `address`. Without a token and TLS a request is trusted for where
    /// it comes from, so its host must be one that no site can own.
    pub(in crate::service) fn of(address: SocketAddr, has_tls: bool, is_guarded: bool) -> Self {
        let is_trusting = address.ip().is_loopback() && !has_tls && !is_guarded;
        if is_trusting { Self::Local } else { Self::Any }
    }

    fn allow(self, host: &str) -> bool {
        if self == Self::Any {
            return true;
        }
        let Ok(authority) = host.parse::<Authority>() else { return false };
        let name = authority.host();
        let address = name.trim_start_matches('[').trim_end_matches(']');
        let is_local = name.eq_ignore_ascii_case("localhost");
        is_local || name.ends_with(".localhost") || address.parse::<IpAddr>().is_ok()
    }
}

/// A service that gets no requests of other sites.
#[derive(Clone, Debug)]
pub(super) struct SameSite<S> {
    service: S,
    hosts: Hosts,
}

impl<S> SameSite<S> {
    pub(super) fn new(service: S, hosts: Hosts) -> Self {
        Self { service, hosts }
    }

    /// Why a request is refused.
    fn refusal<B>(&self, request: &Request<B>) -> Option<Response<Body>> {
        let header = |name: HeaderName| request.headers().get(name).map(HeaderValue::to_str);
        // HTTP/2 has the host in the request's URI.
        let host = match request.uri().authority() {
            Some(authority) => authority.as_str(),
            None => header(HOST).and_then(Result::ok).unwrap_or_default(),
        };
        if !self.hosts.allow(host) {
            let reason =
                "open the page at localhost or by the server's address, not by another name\n";
            return Some(text(StatusCode::MISDIRECTED_REQUEST, reason));
        }
        let origin = header(ORIGIN)?.unwrap_or_default();
        let is_own = origin.split_once("://").is_some_and(|(_, from)| from == host);
        (!is_own).then(|| text(StatusCode::FORBIDDEN, "other sites may not call this server\n"))
    }
}

impl<S: NamedService> NamedService for SameSite<S> {
    const NAME: &'static str = S::NAME;
}

impl<S, B> Service<Request<B>> for SameSite<S>
where
    S: Service<Request<Body>, Response = Response<Body>>,
    B: HttpBody<Data = Bytes> + Send + 'static,
    B::Error: Into<StdError>,
{
    type Response = Response<Body>;
    type Error = S::Error;
    type Future = Either<Ready<Result<Response<Body>, S::Error>>, S::Future>;

    fn poll_ready(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.service.poll_ready(cx)
    }

    fn call(&mut self, request: Request<B>) -> Self::Future {
        match self.refusal(&request) {
            Some(response) => Either::Left(ready(Ok(response))),
            None => Either::Right(self.service.call(request.map(Body::new))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Hosts;

    #[test]
    fn a_name_that_a_site_can_own_is_refused_where_nothing_else_keeps_it_out() {
        let loopback = "127.0.0.1:7412".parse().unwrap();
        let local = Hosts::of(loopback, false, false);
        for host in ["localhost:7412", "127.0.0.1:7412", "[::1]:7412", "map.localhost", "LOCALHOST"]
        {
            assert!(local.allow(host), "{host}");
        }
        for host in
            ["", "example.com:7412", "localhost.example.com", "127.0.0.1.example.com", "a@b@c"]
        {
            assert!(!local.allow(host), "{host}");
        }
        for hosts in [Hosts::of(loopback, true, false), Hosts::of(loopback, false, true)] {
            assert!(hosts.allow("robot.example.com"));
        }
    }
}
