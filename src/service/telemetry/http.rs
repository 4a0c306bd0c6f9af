//! The listener for Prometheus: plain HTTP/1.1, `GET /metrics` and nothing else.
//!
//! One answer per connection, few connections at once, and little time and memory for a request. If
//! there are too many, a new connection replaces the oldest, so that nobody keeps a scraper out.
//! The listener reads atomics and never waits for an engine. A page of another site gets nothing
//! ([`same_site`](crate::service::same_site)). [`respond`] is the same page for another listener.

use std::convert::Infallible;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use hyper::header::{ALLOW, CONTENT_TYPE};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Method, Request, Response, StatusCode};
use hyper_util::rt::{TokioIo, TokioTimer};
use tokio::net::{TcpListener, TcpStream};
use tokio::task::JoinSet;

use super::{page, text};
use crate::service::connections::{ConnectionLimits, Connections};
use crate::service::context::Context;
use crate::service::jobs::Jobs;
use crate::service::log_limit::LogLimit;
use crate::service::same_site::{Hosts, refusal};

/// Connections at once; a scraper needs one.
const MAX_CONNECTIONS: usize = 16;
/// A connection's time, from the accept to the end of the answer.
const CONNECTION_TIME: Duration = Duration::from_secs(10);
/// Room for a request, bytes; the least that the transport allows.
const REQUEST_BYTES: usize = 8 << 10;

/// Answers scrapes at `address` until it is dropped.
pub(in crate::service) async fn serve(
    listener: TcpListener,
    address: SocketAddr,
    context: Arc<Context>,
    jobs: Arc<Jobs>,
) {
    let hosts = Hosts::of_metrics(address);
    let limits = ConnectionLimits {
        max_connections: 2 * MAX_CONNECTIONS,
        max_strangers: MAX_CONNECTIONS,
        ..ConnectionLimits::default()
    };
    let (connections, failures) = (Connections::new(limits, None), LogLimit::default());
    let mut answers = JoinSet::new();
    loop {
        match listener.accept().await {
            Ok((stream, peer)) => {
                let slot = connections.enter(peer);
                let (context, jobs) = (Arc::clone(&context), Arc::clone(&jobs));
                answers.spawn(async move {
                    tokio::select! {
                        () = answer(stream, hosts, context, jobs) => {}
                        () = slot.closed() => tracing::debug!("a connection for metrics made room"),
                        () = tokio::time::sleep(CONNECTION_TIME) => {
                            tracing::debug!("a connection for metrics took too long");
                        }
                    }
                });
            }
            Err(error) => {
                failures.log(
                    || tracing::warn!(%error, "a connection for metrics was not taken"),
                    |count| tracing::warn!(count, "more connections for metrics were not taken"),
                );
                // Most likely no descriptor is left, and an immediate try would fail too.
                tokio::time::sleep(Duration::from_millis(100)).await;
            }
        }
        while answers.try_join_next().is_some() {}
    }
}

async fn answer(stream: TcpStream, hosts: Hosts, context: Arc<Context>, jobs: Arc<Jobs>) {
    let service = service_fn(move |request| {
        let response = match refusal(&request, hosts) {
            Some((status, why)) => plain(status, why),
            None => respond(&request, &context, &jobs),
        };
        async move { Ok::<_, Infallible>(response) }
    });
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .keep_alive(false)
        .max_buf_size(REQUEST_BYTES)
        .serve_connection(TokioIo::new(stream), service);
    if let Err(error) = connection.await {
        tracing::debug!(%error, "a connection for metrics");
    }
}

fn plain(status: StatusCode, text: &str) -> Response<String> {
    let mut response = Response::new(text.to_owned());
    *response.status_mut() = status;
    response
}

/// Answers a request for the page.
pub(in crate::service) fn respond<B>(
    request: &Request<B>,
    context: &Context,
    jobs: &Jobs,
) -> Response<String> {
    if request.uri().path() != "/metrics" {
        return plain(StatusCode::NOT_FOUND, "there is /metrics only\n");
    }
    if request.method() != Method::GET {
        let mut response = plain(StatusCode::METHOD_NOT_ALLOWED, "GET only\n");
        response.headers_mut().insert(ALLOW, hyper::header::HeaderValue::from_static("GET"));
        return response;
    }
    let mut response = Response::new(page(context, jobs));
    let format = hyper::header::HeaderValue::from_static(text::CONTENT_TYPE);
    response.headers_mut().insert(CONTENT_TYPE, format);
    response
}
