//! The files of the page, as `page/build.mjs` made them, and the descriptors of the wire, by which the
//! page reads and writes messages. They are part of the program: nothing is loaded from elsewhere.
//!
//! Each file is answered with headers that let a browser run the page's own script and nothing else.

use std::io::Write;
use std::sync::LazyLock;

use flate2::Compression;
use flate2::write::GzEncoder;
use http_body_util::Full;
use hyper::body::Bytes;
use tonic::body::Body;
use tonic::codegen::http::header::{
    ACCEPT_ENCODING, ALLOW, CACHE_CONTROL, CONTENT_ENCODING, CONTENT_SECURITY_POLICY, CONTENT_TYPE,
    HeaderName, REFERRER_POLICY, VARY, X_CONTENT_TYPE_OPTIONS, X_FRAME_OPTIONS,
};
use tonic::codegen::http::{HeaderMap, HeaderValue, Method, Request, Response, StatusCode};

/// Everything comes from this server; no script and no style stands in the document itself.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; \
                      img-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'; \
                      require-trusted-types-for 'script'; trusted-types 'none'";

/// Headers of every answer.
const HEADERS: [(HeaderName, &str); 7] = [
    (CONTENT_SECURITY_POLICY, POLICY),
    (X_CONTENT_TYPE_OPTIONS, "nosniff"),
    (X_FRAME_OPTIONS, "DENY"),
    (REFERRER_POLICY, "no-referrer"),
    (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
    // Another version of the server has another page.
    (CACHE_CONTROL, "no-cache"),
];

/// A file of the page.
struct Asset {
    path: &'static str,
    content_type: &'static str,
    bytes: Bytes,
    gzip: Bytes,
}

impl Asset {
    fn new(path: &'static str, content_type: &'static str, bytes: &'static [u8]) -> Self {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
        // Writing to memory does not fail; without it the file would go uncompressed.
        let gzip = encoder.write_all(bytes).and_then(|()| encoder.finish()).unwrap_or_default();
        Self { path, content_type, bytes: Bytes::from_static(bytes), gzip: gzip.into() }
    }
}

static FILES: LazyLock<[Asset; 5]> = LazyLock::new(|| {
    let html = "text/html; charset=utf-8";
    let script = "text/javascript; charset=utf-8";
    let style = "text/css; charset=utf-8";
    [
        Asset::new("/", html, include_bytes!("../../../page/dist/index.html")),
        Asset::new("/page.js", script, include_bytes!("../../../page/dist/page.js")),
        Asset::new("/page.css", style, include_bytes!("../../../page/dist/page.css")),
        Asset::new("/icon.svg", "image/svg+xml", include_bytes!("../../../page/dist/icon.svg")),
        Asset::new(
            "/descriptors",
            "application/octet-stream",
            crate::wire::v1::FILE_DESCRIPTOR_SET,
        ),
    ]
});

/// Answers requests for files; everything that no service takes comes here.
pub(super) fn answer(request: &Request<Body>) -> Response<Body> {
    let Some(file) = FILES.iter().find(|file| file.path == request.uri().path()) else {
        return text(StatusCode::NOT_FOUND, "there is no such file; the page is at /\n");
    };
    if ![Method::GET, Method::HEAD].contains(request.method()) {
        let mut response = text(StatusCode::METHOD_NOT_ALLOWED, "GET and HEAD only\n");
        response.headers_mut().insert(ALLOW, HeaderValue::from_static("GET, HEAD"));
        return response;
    }
    let takes_gzip = request.headers().get(ACCEPT_ENCODING).and_then(|value| value.to_str().ok());
    let takes_gzip = takes_gzip.is_some_and(|names| names.contains("gzip"));
    let is_gzip = takes_gzip && !file.gzip.is_empty();
    let bytes = if is_gzip { &file.gzip } else { &file.bytes };
    let mut response = Response::new(Body::new(Full::new(bytes.clone())));
    let headers = response.headers_mut();
    secure(headers);
    headers.insert(CONTENT_TYPE, HeaderValue::from_static(file.content_type));
    headers.insert(VARY, HeaderValue::from_static("accept-encoding"));
    if is_gzip {
        headers.insert(CONTENT_ENCODING, HeaderValue::from_static("gzip"));
    }
    response
}

/// A short answer for people.
pub(in crate::service) fn text(status: StatusCode, text: &'static str) -> Response<Body> {
    let mut response = Response::new(Body::new(text.to_owned()));
    *response.status_mut() = status;
    secure(response.headers_mut());
    let plain = HeaderValue::from_static("text/plain; charset=utf-8");
    response.headers_mut().insert(CONTENT_TYPE, plain);
    response
}

fn secure(headers: &mut HeaderMap) {
    headers.extend(HEADERS.map(|(name, value)| (name, HeaderValue::from_static(value))));
}
