//! gRPC-Web: gRPC for callers that cannot read trailers, as browsers are.
//!
//! Messages are framed as in gRPC. Trailers follow the last message as a frame of their own: a flag of
//! 0x80, four bytes of length, and a line of text for each. Only the binary form is served; calls in
//! base64 and calls of gRPC itself are refused.

use std::convert::Infallible;
use std::future::{Ready, ready as ready_now};
use std::pin::Pin;
use std::task::{Context, Poll, ready};

use futures_util::future::{Either, MapOk, TryFutureExt};
use hyper::body::{Body as HttpBody, Bytes, Frame};
use tonic::Status;
use tonic::body::Body;
use tonic::codegen::Service;
use tonic::codegen::http::header::{CONTENT_LENGTH, CONTENT_TYPE, TE};
use tonic::codegen::http::{HeaderMap, HeaderValue, Method, Request, Response, StatusCode};
use tonic::server::NamedService;

use super::assets::text;

/// The flag of a frame of trailers.
const TRAILERS: u8 = 0x80;
const GRPC: HeaderValue = HeaderValue::from_static("application/grpc");
const GRPC_WEB: HeaderValue = HeaderValue::from_static("application/grpc-web+proto");

/// A service of gRPC for callers of gRPC-Web.
#[derive(Clone, Debug)]
pub(super) struct GrpcWeb<S>(pub(super) S);

impl<S: NamedService> NamedService for GrpcWeb<S> {
    const NAME: &'static str = S::NAME;
}

impl<S> Service<Request<Body>> for GrpcWeb<S>
where
    S: Service<Request<Body>, Response = Response<Body>, Error = Infallible>,
{
    type Response = Response<Body>;
    type Error = Infallible;
    type Future = Either<Ready<Result<Response<Body>, Infallible>>, MapOk<S::Future, Translate>>;

    fn poll_ready(&mut self, cx: &mut Context<'_>) -> Poll<Result<(), Infallible>> {
        self.0.poll_ready(cx)
    }

    fn call(&mut self, mut request: Request<Body>) -> Self::Future {
        let refused = |status, why| Either::Left(ready_now(Ok(text(status, why))));
        let kind = request.headers().get(CONTENT_TYPE).map(HeaderValue::as_bytes);
        if !matches!(kind, Some(b"application/grpc-web" | b"application/grpc-web+proto")) {
            let why = "a call has the content type application/grpc-web+proto\n";
            return refused(StatusCode::UNSUPPORTED_MEDIA_TYPE, why);
        }
        if request.method() != Method::POST {
            return refused(StatusCode::METHOD_NOT_ALLOWED, "a call is a POST\n");
        }
        let headers = request.headers_mut();
        headers.remove(CONTENT_LENGTH);
        headers.insert(CONTENT_TYPE, GRPC);
        headers.insert(TE, HeaderValue::from_static("trailers"));
        Either::Right(self.0.call(request).map_ok(translated as Translate))
    }
}

type Translate = fn(Response<Body>) -> Response<Body>;

/// An answer of gRPC as one of gRPC-Web.
fn translated(response: Response<Body>) -> Response<Body> {
    let mut response = response.map(|body| Body::new(Framed(body)));
    response.headers_mut().insert(CONTENT_TYPE, GRPC_WEB);
    response
}

/// A body whose trailers are its last frame of data.
struct Framed(Body);

impl HttpBody for Framed {
    type Data = Bytes;
    type Error = Status;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Bytes>, Status>>> {
        let frame = ready!(Pin::new(&mut self.0).poll_frame(cx));
        Poll::Ready(frame.map(|frame| {
            frame.map(|frame| match frame.into_trailers() {
                Ok(trailers) => Frame::data(framed(&trailers)),
                Err(frame) => frame,
            })
        }))
    }

    fn is_end_stream(&self) -> bool {
        self.0.is_end_stream()
    }
}

fn framed(trailers: &HeaderMap) -> Bytes {
    let mut lines = Vec::new();
    for (name, value) in trailers {
        lines.extend([name.as_str().as_bytes(), b":", value.as_bytes(), b"\r\n"].concat());
    }
    let size = u32::try_from(lines.len()).unwrap_or(u32::MAX).to_be_bytes();
    [&[TRAILERS], &size[..], &lines].concat().into()
}
