//! Accepts sockets, gives each a slot, makes the TLS handshake if configured, and passes it to the
//! transport; then enforces its time limits. What the services answer is not known here.

use std::io;
use std::sync::Arc;
use std::time::Duration;

use tokio::task::JoinSet;
use tokio::time::{Instant, sleep, sleep_until};
use tokio_stream::{Stream, StreamExt};
use tonic::service::Routes;

use super::link::Link;
use super::registry::Slot;
use super::socket::{Connection, Secured};
use super::{Accepted, Socket};
use crate::service::context::Context;
use crate::service::log_limit::LogLimit;
use crate::service::tls::Tls;

/// How long a peer has to close after it was told to go away.
const GOODBYE_TIME: Duration = Duration::from_secs(1);
/// How long nothing is accepted after an error that would also affect the next socket.
const BACK_OFF: Duration = Duration::from_millis(100);

/// Services, and the protocol settings to serve them.
#[derive(Clone)]
pub(in crate::service) struct Transport {
    /// The settings of HTTP/2.
    pub(in crate::service) server: tonic::transport::Server,
    /// The services.
    pub(in crate::service) routes: Routes,
    /// TLS, if configured.
    pub(in crate::service) tls: Option<Arc<Tls>>,
}

/// Serves all sockets of `incoming` until the server drains, and then until they are done. Dropping it
/// ends every connection.
pub(in crate::service) async fn serve<S: Socket>(
    incoming: impl Stream<Item = io::Result<Accepted<S>>> + Send + 'static,
    transport: Transport,
    context: Arc<Context>,
) {
    let mut running = JoinSet::new();
    accept(incoming, &transport, &context, &mut running).await;
    while running.join_next().await.is_some() {}
}

/// Accepts until the server drains; the listener is closed at the end.
async fn accept<S: Socket>(
    incoming: impl Stream<Item = io::Result<Accepted<S>>> + Send + 'static,
    transport: &Transport,
    context: &Arc<Context>,
    running: &mut JoinSet<()>,
) {
    let mut incoming = std::pin::pin!(incoming);
    let mut drained = std::pin::pin!(context.drained());
    let failures = LogLimit::default();
    let mut is_open = true;
    loop {
        tokio::select! {
            () = &mut drained => return,
            next = incoming.next(), if is_open => match next {
                Some(Ok((socket, peer))) => {
                    let slot = context.connections.enter(peer);
                    let (transport, context) = (transport.clone(), Arc::clone(context));
                    running.spawn(connection(socket, slot, transport, context));
                }
                Some(Err(error)) if is_of_one_socket(&error) => {}
                Some(Err(error)) => {
                    // Most likely no descriptor is left, and the next try would fail too.
                    context.connections.accept_failures.increment();
                    failures.log(
                        || tracing::warn!(%error, "a connection was not accepted"),
                        |count| tracing::warn!(count, "more connections were not accepted"),
                    );
                    tokio::select! {
                        () = &mut drained => return,
                        () = sleep(BACK_OFF) => {}
                    }
                }
                None => is_open = false,
            },
            Some(_ended) = running.join_next(), if !running.is_empty() => {}
        }
    }
}

/// Whether an error of a listener only concerns one socket that was closed before it was accepted.
fn is_of_one_socket(error: &io::Error) -> bool {
    use io::ErrorKind::{
        BrokenPipe, ConnectionAborted, ConnectionReset, Interrupted, NotConnected, TimedOut,
    };
    matches!(
        error.kind(),
        ConnectionAborted | ConnectionReset | NotConnected | BrokenPipe | Interrupted | TimedOut
    )
}

/// A connection from its accept to its end.
async fn connection<S: Socket>(socket: S, slot: Slot, transport: Transport, context: Arc<Context>) {
    let link = Arc::clone(slot.link());
    let Transport { server, routes, tls } = transport;
    let socket = match tls {
        None => Secured::Plain(socket),
        Some(tls) => match handshake(&tls, socket, &slot, &context).await {
            Some(socket) => socket,
            None => return,
        },
    };
    let socket = Connection::new(socket, Arc::clone(&link));
    // The transport serves only this socket, and ends when it is told to.
    let socket = tokio_stream::once(Ok::<_, io::Error>(socket)).chain(tokio_stream::pending());
    let ending = async {
        tokio::select! {
            () = link.draining() => {}
            () = context.drained() => {}
        }
    };
    tokio::select! {
        served = server.serve_with_incoming_shutdown(routes, socket, ending) => {
            if let Err(error) = served {
                tracing::debug!(%error, "a connection ended badly");
            }
        }
        () = watch_over(&link, &slot) => {}
    }
}

/// The socket with TLS; `None` if the handshake failed.
async fn handshake<S: Socket>(
    tls: &Tls,
    socket: S,
    slot: &Slot,
    context: &Context,
) -> Option<Secured<S>> {
    let (link, limits) = (slot.link(), slot.connections().limits());
    let made = tokio::select! {
        made = tls.current().accept(socket) => made,
        // A newer stranger has taken its slot, which is already counted.
        () = link.closed() => return None,
        () = sleep_until(link.since + limits.stranger_time) => {
            slot.connections().ends.stranger_time.increment();
            Err(io::ErrorKind::TimedOut.into())
        }
    };
    match made {
        Ok(socket) => Some(Secured::Tls(Box::new(socket))),
        Err(error) => {
            context.meters.failed_handshakes.increment();
            tracing::debug!(%error, "a TLS handshake failed");
            None
        }
    }
}

/// Ends the connection when its time is over; resolves when it was closed for that reason.
async fn watch_over(link: &Link, slot: &Slot) {
    let (limits, ends) = (slot.connections().limits(), &slot.connections().ends);
    tokio::select! {
        () = link.known() => {}
        () = sleep_until(link.since + limits.stranger_time) => {
            link.drain();
            sleep(GOODBYE_TIME).await;
            if !link.is_known() {
                ends.stranger_time.increment();
                return;
            }
        }
    }
    loop {
        let since = link.idle_since().unwrap_or_else(Instant::now);
        sleep_until(since + limits.idle_time).await;
        if link.is_idle_for(limits.idle_time) {
            link.drain();
            sleep(GOODBYE_TIME).await;
            if link.is_idle_for(limits.idle_time) {
                ends.idle.increment();
                return;
            }
        }
    }
}
