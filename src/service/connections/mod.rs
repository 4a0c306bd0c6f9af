//! Connections from their accept to their end, so that nobody without a token can block the server.
//!
//! The transport takes any stream of [`Accepted`] sockets. Those of the system come from
//! [`accepted`]; a simulated network has its own sockets for the same services. Each connection is
//! served separately, so that a single one can be closed. A connection is a stranger until the
//! guard admits a call.
//!
//! | module | role |
//! |---|---|
//! | `limits` | how many, and for how long |
//! | `registry` | all connections, and which one makes room |
//! | `link` | the state of one connection |
//! | `socket` | a socket that can be closed from elsewhere |
//! | `messages` | incomplete request messages |
//! | `serving` | a connection from accept to end |

mod limits;
mod link;
mod messages;
mod registry;
mod serving;
mod socket;

use std::io;
use std::net::SocketAddr;
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite};
use tokio::net::{TcpListener, TcpStream};
use tokio_stream::{Stream, StreamExt};
use tonic::transport::server::TcpIncoming;

pub use limits::ConnectionLimits;
pub(super) use link::{OpenCall, Peer};
pub(super) use registry::Connections;
pub(super) use serving::{Transport, serve};

/// The item of a listener: a socket and the address of its peer.
pub(crate) type Accepted<S> = (S, SocketAddr);

/// A socket that the transport can serve.
pub(crate) trait Socket: AsyncRead + AsyncWrite + Unpin + Send + 'static {}

impl<S: AsyncRead + AsyncWrite + Unpin + Send + 'static> Socket for S {}

/// The sockets that connect to `listener`; the system probes them after `keep_alive` without data.
pub(super) fn accepted(
    listener: TcpListener,
    keep_alive: Duration,
) -> impl Stream<Item = io::Result<Accepted<TcpStream>>> + Send + 'static {
    // The transport's own options do not apply to a listener that was bound outside. Without this
    // option each small answer waits some 40 ms for the peer's delayed acknowledgment.
    let incoming = TcpIncoming::from(listener).with_nodelay(Some(true));
    let incoming = incoming.with_keepalive(Some(keep_alive));
    incoming.map(|socket| {
        let socket = socket?;
        let peer = socket.peer_addr()?;
        Ok((socket, peer))
    })
}
