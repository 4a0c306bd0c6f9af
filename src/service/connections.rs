//! Sockets on their way from a listener to the transport.
//!
//! The transport takes any stream of [`Accepted`] sockets. Those of the system come from [`accepted`];
//! a simulated network brings its own and serves the very same services.

use std::io;
use std::net::SocketAddr;
use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio_stream::{Stream, StreamExt};
use tonic::transport::server::{Connected, TcpConnectInfo, TcpIncoming};

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

/// A socket as the transport sees it.
#[derive(Debug)]
pub(super) struct Connection<S> {
    socket: S,
    peer: SocketAddr,
}

impl<S> Connection<S> {
    /// With the address that calls are said to come from.
    pub(super) fn new(socket: S, peer: SocketAddr) -> Self {
        Self { socket, peer }
    }
}

impl<S> Connected for Connection<S> {
    type ConnectInfo = TcpConnectInfo;

    fn connect_info(&self) -> TcpConnectInfo {
        TcpConnectInfo { local_addr: None, remote_addr: Some(self.peer) }
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for Connection<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.socket).poll_read(cx, buffer)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for Connection<S> {
    fn poll_write(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.socket).poll_write(cx, bytes)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.socket).poll_write_vectored(cx, slices)
    }

    fn is_write_vectored(&self) -> bool {
        self.socket.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.socket).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.socket).poll_shutdown(cx)
    }
}
