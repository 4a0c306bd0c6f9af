//! Refuses requests that another site has sent through somebody's browser.
//!
//! A browser reaches each listener that its machine reaches, and so does each site that it shows; with it
//! go the machine's address and the user's client certificate. Three headers that a site cannot forge tell
//! its requests apart: `Origin`, which must be the server's own, `Sec-Fetch-Site`, by which newer browsers
//! say the same of requests without an origin, and `Host`, which holds the site's name after it let that
//! name lead to this server (DNS rebinding). The listeners of gRPC, of the page and of metrics share this.

use std::future::{Ready, ready};
use std::net::{IpAddr, SocketAddr};
use std::task::{Context, Poll};

use futures_util::future::Either;
use hyper::body::{Body as HttpBody, Bytes};
use tonic::body::Body;
use tonic::codegen::http::header::{HOST, ORIGIN};
use tonic::codegen::http::uri::Authority;
use tonic::codegen::http::{HeaderName, HeaderValue, Method, Request, Response, StatusCode};
use tonic::codegen::{Service, StdError};
use tonic::server::NamedService;

use super::page::text;

/// Names that no site of the internet can own, besides those of one label.
const PRIVATE_ENDS: [&str; 4] = [".localhost", ".local", ".internal", ".home.arpa"];
const SEC_FETCH_SITE: HeaderName = HeaderName::from_static("sec-fetch-site");
const SEC_FETCH_MODE: HeaderName = HeaderName::from_static("sec-fetch-mode");

/// The names by which a browser may call the server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Hosts {
    /// Any: a token or a certificate keeps others out, or no browser speaks the protocol.
    Any,
    /// Addresses, and names that no site can own.
    Private,
}

impl Hosts {
    /// The names that are allowed for the page. Without a token and TLS a request is trusted for where it
    /// comes from, so its host must be one that no site can own.
    pub(super) fn of_page(has_tls: bool, is_guarded: bool) -> Self {
        if has_tls || is_guarded { Self::Any } else { Self::Private }
    }

    /// The names that are allowed for metrics, which are plain text and ask for no token. Beyond loopback
    /// they are for scrapers, which may use any name.
    pub(super) fn of_metrics(address: SocketAddr) -> Self {
        if address.ip().is_loopback() { Self::Private } else { Self::Any }
    }

    fn allow(self, host: &str) -> bool {
        if self == Self::Any {
            return true;
        }
        let Ok(authority) = host.parse::<Authority>() else { return false };
        if host.contains('@') {
            return false;
        }
        let name = authority.host().trim_end_matches('.').to_ascii_lowercase();
        let address = name.trim_start_matches('[').trim_end_matches(']');
        let is_private = !name.is_empty()
            && (!name.contains('.') || PRIVATE_ENDS.iter().any(|end| name.ends_with(end)));
        address.parse::<IpAddr>().is_ok() || is_private
    }
}

/// Why a request is refused: the status, and a line for people.
pub(super) fn refusal<B>(request: &Request<B>, hosts: Hosts) -> Option<(StatusCode, &'static str)> {
    let headers = request.headers();
    // HTTP/2 has the host in the request's URI.
    let host = match request.uri().authority() {
        Some(authority) => authority.as_str(),
        None => headers.get(HOST).and_then(|host| host.to_str().ok()).unwrap_or_default(),
    };
    if !hosts.allow(host) {
        let reason = "call this server by its address or as localhost, not by a name of a site\n";
        return Some((StatusCode::MISDIRECTED_REQUEST, reason));
    }
    // Each value counts: a proxy may have added one.
    let is_foreign = |origin: &HeaderValue| {
        let origin = origin.to_str().unwrap_or_default().split_once("://");
        origin.is_none_or(|(_, from)| !from.eq_ignore_ascii_case(host))
    };
    let is_of_other_site =
        |site: &HeaderValue| !matches!(site.as_bytes(), b"same-origin" | b"none");
    // A link on another site may lead here.
    let is_link = [Method::GET, Method::HEAD].contains(request.method())
        && headers.get(SEC_FETCH_MODE).is_some_and(|mode| mode == "navigate");
    let is_refused = headers.get_all(ORIGIN).iter().any(is_foreign)
        || (!is_link && headers.get_all(SEC_FETCH_SITE).iter().any(is_of_other_site));
    is_refused.then_some((StatusCode::FORBIDDEN, "other sites may not call this server\n"))
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
        match refusal(&request, self.hosts) {
            Some((status, why)) => Either::Left(ready(Ok(text(status, why)))),
            None => Either::Right(self.service.call(request.map(Body::new))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_that_a_site_can_own_is_refused_where_nothing_else_keeps_it_out() {
        let private = Hosts::of_page(false, false);
        for host in [
            "localhost:7412",
            "127.0.0.1:7412",
            "192.168.1.5",
            "[::1]:7412",
            "map.localhost",
            "LOCALHOST",
            "robot:7412",
            "Robot.local:7412",
            "covis.default.svc.cluster.local",
        ] {
            assert!(private.allow(host), "{host}");
        }
        for host in [
            "",
            ".",
            "example.com:7412",
            "example.com.",
            "localhost.example.com",
            "127.0.0.1.example.com",
            "local.com",
            "a@b@c",
        ] {
            assert!(!private.allow(host), "{host}");
        }
        for hosts in [Hosts::of_page(true, false), Hosts::of_page(false, true)] {
            assert!(hosts.allow("robot.example.com"));
        }
        assert!(!Hosts::of_metrics("127.0.0.1:9411".parse().unwrap()).allow("example.com"));
        assert!(Hosts::of_metrics("0.0.0.0:9411".parse().unwrap()).allow("example.com"));
    }

    #[track_caller]
    fn check(method: Method, headers: &[(&str, &str)], is_taken: bool) {
        let mut request = Request::builder().method(method).uri("https://maps.example:7411/x");
        for (name, value) in headers {
            request = request.header(*name, *value);
        }
        let refused = refusal(&request.body(()).unwrap(), Hosts::Any);
        assert_eq!(refused.is_none(), is_taken, "{headers:?}: {refused:?}");
    }

    #[test]
    fn what_a_browser_says_of_another_site_is_refused() {
        let own = ("origin", "https://maps.example:7411");
        check(Method::POST, &[], true);
        check(Method::POST, &[own], true);
        check(Method::POST, &[own, ("sec-fetch-site", "same-origin")], true);
        check(Method::POST, &[("sec-fetch-site", "none")], true);
        for origin in ["https://evil.example", "null", "", "https://maps.example", "\u{ff}"] {
            check(Method::POST, &[("origin", origin)], false);
            check(Method::POST, &[own, ("origin", origin)], false);
        }
        for site in ["cross-site", "same-site", "", "later"] {
            check(Method::POST, &[("sec-fetch-site", site)], false);
            check(Method::GET, &[("sec-fetch-site", site)], false);
            let link = [("sec-fetch-site", site), ("sec-fetch-mode", "navigate")];
            check(Method::GET, &link, true);
            check(Method::POST, &link, false);
        }
    }
}
