//! The state of one connection: its peer, whether it is a stranger, its open calls, and the stage
//! of its end. It reads and writes no data.

use std::net::{IpAddr, Ipv6Addr, SocketAddr};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Weak};
use std::task::{Context, Poll};
use std::time::Duration;

use futures_util::task::AtomicWaker;
use tokio::sync::watch;
use tokio::time::Instant;
use tonic::body::Body;

use super::Connections;
use super::messages::Arriving;
use crate::service::error::ServiceError;
use crate::sync::Mutex;

/// The stage of a connection's end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Open,
    /// The peer is told to go away; running calls continue.
    Draining,
    Closed,
}

/// A connection.
#[derive(Debug)]
pub(super) struct Link {
    pub(super) id: u64,
    pub(super) peer: SocketAddr,
    /// When it was accepted.
    pub(super) since: Instant,
    connections: Weak<Connections>,
    is_known: watch::Sender<bool>,
    calls: Mutex<Calls>,
    stage: watch::Sender<Stage>,
    is_closed: AtomicBool,
    /// The task that reads and writes.
    waker: AtomicWaker,
}

#[derive(Debug)]
struct Calls {
    open: usize,
    /// When the last one ended.
    idle_since: Instant,
}

impl Link {
    pub(super) fn new(id: u64, peer: SocketAddr, connections: Weak<Connections>) -> Arc<Self> {
        let since = Instant::now();
        Arc::new(Self {
            id,
            peer,
            since,
            connections,
            is_known: watch::Sender::new(false),
            calls: Mutex::new(Calls { open: 0, idle_since: since }),
            stage: watch::Sender::new(Stage::Open),
            is_closed: AtomicBool::new(false),
            waker: AtomicWaker::new(),
        })
    }

    /// The network that the peer is counted with: its address, of IPv6 the first 64 bits, which one
    /// household has to itself.
    pub(super) fn network(&self) -> IpAddr {
        match self.peer.ip().to_canonical() {
            IpAddr::V6(address) => {
                let [a, b, c, d, ..] = address.segments();
                IpAddr::V6(Ipv6Addr::new(a, b, c, d, 0, 0, 0, 0))
            }
            address => address,
        }
    }

    pub(super) fn is_known(&self) -> bool {
        *self.is_known.borrow()
    }

    pub(super) fn set_known(&self) {
        self.is_known.send_replace(true);
    }

    /// Resolves when the connection is no longer a stranger.
    pub(super) async fn known(&self) {
        let mut is_known = self.is_known.subscribe();
        // The sender lives as long as `self`.
        let _known = is_known.wait_for(|&is_known| is_known).await;
    }

    /// Since when there is no call; `None` while there is one.
    pub(super) fn idle_since(&self) -> Option<Instant> {
        let calls = self.calls.lock();
        (calls.open == 0).then_some(calls.idle_since)
    }

    /// Whether there was no call for at least `time`.
    pub(super) fn is_idle_for(&self, time: Duration) -> bool {
        self.idle_since().is_some_and(|since| since.elapsed() >= time)
    }

    fn count(&self, change: impl FnOnce(&mut usize)) {
        let mut calls = self.calls.lock();
        change(&mut calls.open);
        calls.idle_since = Instant::now();
    }

    /// Tells the peer to go away once its calls are done.
    pub(super) fn drain(&self) {
        self.stage.send_if_modified(|stage| {
            let is_open = *stage == Stage::Open;
            if is_open {
                *stage = Stage::Draining;
            }
            is_open
        });
    }

    /// Ends reading and writing at once.
    pub(super) fn close(&self) {
        self.is_closed.store(true, Ordering::Release);
        self.stage.send_replace(Stage::Closed);
        self.waker.wake();
    }

    /// Resolves when the connection is to end.
    pub(super) async fn draining(&self) {
        self.reached(|stage| stage != Stage::Open).await;
    }

    /// Resolves when the connection has ended.
    pub(super) async fn closed(&self) {
        self.reached(|stage| stage == Stage::Closed).await;
    }

    async fn reached(&self, is_there: impl Fn(Stage) -> bool) {
        let mut stage = self.stage.subscribe();
        // The sender lives as long as `self`.
        let _reached = stage.wait_for(|&stage| is_there(stage)).await;
    }

    /// Pending until the connection is closed; the task is then woken.
    pub(super) fn poll_closed(&self, cx: &mut Context<'_>) -> Poll<()> {
        self.waker.register(cx.waker());
        if self.is_closed.load(Ordering::Acquire) { Poll::Ready(()) } else { Poll::Pending }
    }
}

/// The connection of a request; it is in the request's extensions.
#[derive(Clone, Debug)]
pub(in crate::service) struct Peer(pub(super) Arc<Link>);

impl Peer {
    /// The address of the other end.
    pub(in crate::service) fn address(&self) -> SocketAddr {
        self.0.peer
    }

    /// The guard has admitted a call: the connection is no longer a stranger.
    ///
    /// # Errors
    /// [`ServiceError::ServerLimit`] if connections with calls have all slots.
    pub(in crate::service) fn admitted(&self) -> Result<(), ServiceError> {
        if self.0.is_known() {
            return Ok(());
        }
        self.0.connections.upgrade().map_or(Ok(()), |connections| connections.admit(&self.0))
    }

    /// The body of a request, whose messages must arrive in time.
    pub(in crate::service) fn arriving(&self, body: Body) -> Body {
        match self.0.connections.upgrade() {
            Some(connections) => Body::new(Arriving::new(body, &connections)),
            None => body,
        }
    }

    /// Counts a call until it is dropped.
    pub(in crate::service) fn call(&self) -> OpenCall {
        self.0.count(|open| *open += 1);
        OpenCall(Arc::clone(&self.0))
    }
}

/// A call that runs on a connection.
#[derive(Debug)]
pub(in crate::service) struct OpenCall(Arc<Link>);

impl Drop for OpenCall {
    fn drop(&mut self) {
        self.0.count(|open| *open = open.saturating_sub(1));
    }
}
