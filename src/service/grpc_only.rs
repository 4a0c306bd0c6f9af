//! The listener of gRPC takes gRPC and nothing else.
//!
//! A page of any site may have a browser post to any address, without being asked, with the content types
//! of forms; a browser asks the server first before it sends `application/grpc`, and is never told that it
//! may. So a request with another content type is answered with 415, as the specification of gRPC over
//! HTTP/2 says, before its body is read. gRPC-Web is for the page's listener, which translates it. What a
//! browser says of its request is looked at as well ([`super::same_site`]).

use std::convert::Infallible;
use std::future::{Ready, ready};
use std::task::{Context, Poll};

use futures_util::future::Either;
use hyper::body::{Body as HttpBody, Bytes};
use tonic::Status;
use tonic::body::Body;
use tonic::codegen::http::header::{ALLOW, CONTENT_TYPE};
use tonic::codegen::http::{HeaderMap, HeaderValue, Method, Request, Response, StatusCode};
use tonic::codegen::{Service, StdError};
use tonic::server::NamedService;
use tonic::service::Routes;

use super::error::ServiceError;
use super::page::{Answering, text};
use super::same_site::{Hosts, SameSite};

/// A service that gets requests of gRPC clients only.
#[derive(Clone, Debug)]
pub(super) struct GrpcOnly<S>(SameSite<S>);

impl<S> GrpcOnly<S> {
    /// Puts the check in front of `service`.
    pub(super) fn new(service: S) -> Self {
        // No browser speaks HTTP/2 without TLS, and a certificate is of one name: each name is taken.
        Self(SameSite::new(service, Hosts::Any))
    }
}

/// Answers what no service takes, behind the same check.
pub(super) fn with_fallback(mut routes: Routes) -> Routes {
    let router = routes.axum_router_mut();
    let unserved =
        |_: &Request<Body>| Status::from(ServiceError::Unserved { what: "this call" }).into_http();
    *router = std::mem::take(router).fallback_service(GrpcOnly::new(Answering(unserved)));
    routes
}

/// Whether the content type is one of gRPC, and of no other protocol whose name begins alike.
fn is_grpc(headers: &HeaderMap) -> bool {
    let mut kinds = headers.get_all(CONTENT_TYPE).iter().map(HeaderValue::as_bytes);
    let (Some(kind), None) = (kinds.next(), kinds.next()) else { return false };
    let subtype = kind.strip_prefix(b"application/grpc");
    subtype.is_some_and(|rest| matches!(rest.first(), None | Some(b'+' | b';')))
}

impl<S: NamedService> NamedService for GrpcOnly<S> {
    const NAME: &'static str = S::NAME;
}

impl<S, B> Service<Request<B>> for GrpcOnly<S>
where
    S: Service<Request<Body>, Response = Response<Body>, Error = Infallible>,
    B: HttpBody<Data = Bytes> + Send + 'static,
    B::Error: Into<StdError>,
{
    type Response = Response<Body>;
    type Error = Infallible;
    type Future = Either<
        Ready<Result<Response<Body>, Infallible>>,
        <SameSite<S> as Service<Request<B>>>::Future,
    >;

    fn poll_ready(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), Infallible>> {
        Service::<Request<B>>::poll_ready(&mut self.0, cx)
    }

    fn call(&mut self, request: Request<B>) -> Self::Future {
        if !is_grpc(request.headers()) {
            let why = "a call of gRPC has the content type application/grpc\n";
            return Either::Left(ready(Ok(text(StatusCode::UNSUPPORTED_MEDIA_TYPE, why))));
        }
        if request.method() != Method::POST {
            let mut response = text(StatusCode::METHOD_NOT_ALLOWED, "a call is a POST\n");
            response.headers_mut().insert(ALLOW, HeaderValue::from_static("POST"));
            return Either::Left(ready(Ok(response)));
        }
        Either::Right(self.0.call(request))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn content_types_of_grpc_are_told_from_all_others() {
        let headers = |kinds: &[&'static str]| {
            let kinds = kinds.iter().map(|kind| (CONTENT_TYPE, HeaderValue::from_static(kind)));
            kinds.collect::<HeaderMap>()
        };
        for kind in [
            "application/grpc",
            "application/grpc+proto",
            "application/grpc;charset=utf-8",
            "application/grpc+proto; x=y",
        ] {
            assert!(is_grpc(&headers(&[kind])), "{kind}");
        }
        for kinds in [
            &[][..],
            &[""],
            &["text/plain"],
            &["text/plain, application/grpc"],
            &["text/plain;application/grpc"],
            &["application/x-www-form-urlencoded"],
            &["multipart/form-data; boundary=application/grpc"],
            &["application/grpc-web"],
            &["application/grpc-web+proto"],
            &["application/grpcx"],
            &["application/grpc, text/plain"],
        ] {
            assert!(!is_grpc(&headers(kinds)), "{kinds:?}");
        }
        // `collect` keeps the last of equal names.
        let mut two = headers(&["application/grpc"]);
        two.append(CONTENT_TYPE, HeaderValue::from_static("text/plain"));
        assert!(!is_grpc(&two));
    }
}
