//! Connections from their accept to their end, so that nobody without a token holds the server up.
//!
//! The transport takes any stream of [`Accepted`] sockets. Those of the system come from [`accepted`];
//! a simulated network brings its own and serves the very same services. Each connection is served by
//! itself, so that one alone can be told to go away. It is a stranger until the guard admits a call.
//!
//! | module | role |
//! |---|---|
//! | `limits` | how many, and for how long |
//! | `registry` | all connections, and who makes place |
//! | `link` | what is known of one |
//! | `socket` | a socket that can be closed from elsewhere |
//! | `messages` | request messages that are half there |
//! | `serving` | the way of a connection |

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

/// What a listener gives: a socket and the address of its peer.
pub(crate) type Accepted<S> = (S, SocketAddr);

/// A socket that the transport can serve.
pub(crate) trait Socket: AsyncRead + AsyncWrite + Unpin + Send + 'static {}

impl<S: AsyncRead + AsyncWrite + Unpin + Send + 'static> Socket for S {}

/// The sockets that connect to `listener`, probed by the system after `keep_alive` without a word.
pub(super) fn accepted(
    listener: TcpListener,
    keep_alive: Duration,
) -> impl Stream<Item = io::Result<Accepted<TcpStream>>> + Send + 'static {
    // The transport's own switches do not reach a listener that was bound outside; without this one
    // each small answer waits some 40 ms for the peer's delayed acknowledgment.
    let incoming = TcpIncoming::from(listener).with_nodelay(Some(true));
    let incoming = incoming.with_keepalive(Some(keep_alive));
    incoming.map(|socket| {
        let socket = socket?;
        let peer = socket.peer_addr()?;
        Ok((socket, peer))
    })
}
