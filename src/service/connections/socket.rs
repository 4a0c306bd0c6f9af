//! A socket as the transport sees it: plain or with TLS, and closed when its connection must end.
//! The data that passes is not read.

use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::task::{Context, Poll};

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio_rustls::server::TlsStream;
use tonic::transport::server::Connected;

use super::Socket;
use super::link::{Link, Peer};

/// With TLS or without.
pub(super) enum Secured<S> {
    Plain(S),
    Tls(Box<TlsStream<S>>),
}

/// A socket and the state of its connection.
pub(super) struct Connection<S> {
    socket: Secured<S>,
    link: Arc<Link>,
}

impl<S> Connection<S> {
    pub(super) fn new(socket: Secured<S>, link: Arc<Link>) -> Self {
        Self { socket, link }
    }

    fn check(&self, cx: &mut Context<'_>) -> io::Result<()> {
        match self.link.poll_closed(cx) {
            Poll::Ready(()) => Err(io::ErrorKind::ConnectionAborted.into()),
            Poll::Pending => Ok(()),
        }
    }
}

impl<S> Drop for Connection<S> {
    /// Notifies all that wait for the end of the connection.
    fn drop(&mut self) {
        self.link.close();
    }
}

impl<S> Connected for Connection<S> {
    type ConnectInfo = Peer;

    fn connect_info(&self) -> Peer {
        Peer(Arc::clone(&self.link))
    }
}

/// Calls `$call` of the socket, whichever it is.
macro_rules! either {
    ($self:ident, $call:ident($($argument:expr),*)) => {
        match &mut $self.get_mut().socket {
            Secured::Plain(socket) => Pin::new(socket).$call($($argument),*),
            Secured::Tls(socket) => Pin::new(&mut **socket).$call($($argument),*),
        }
    };
}

impl<S: Socket> AsyncRead for Connection<S> {
    fn poll_read(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        self.check(cx)?;
        either!(self, poll_read(cx, buffer))
    }
}

impl<S: Socket> AsyncWrite for Connection<S> {
    fn poll_write(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        self.check(cx)?;
        either!(self, poll_write(cx, bytes))
    }

    fn poll_write_vectored(
        self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        self.check(cx)?;
        either!(self, poll_write_vectored(cx, slices))
    }

    fn is_write_vectored(&self) -> bool {
        match &self.socket {
            Secured::Plain(socket) => socket.is_write_vectored(),
            Secured::Tls(socket) => socket.is_write_vectored(),
        }
    }

    fn poll_flush(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.check(cx)?;
        either!(self, poll_flush(cx))
    }

    fn poll_shutdown(self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.check(cx)?;
        either!(self, poll_shutdown(cx))
    }
}
