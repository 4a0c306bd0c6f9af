//! A link that can be cut, held and led elsewhere: a TCP relay between a client and a server.
//!
//! Cutting drops every connection; holding keeps what the server sends from the client; closed, it
//! drops new connections as they come. Everything is by command, nothing by time.

use std::net::SocketAddr;

use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::watch;
use tokio::task::JoinHandle;

#[derive(Clone, Copy)]
struct Link {
    target: SocketAddr,
    /// Connections of an earlier generation are dropped.
    generation: u64,
    is_held: bool,
    is_closed: bool,
}

/// The relay; dropping it cuts everything.
pub(crate) struct Proxy {
    address: SocketAddr,
    link: watch::Sender<Link>,
    task: JoinHandle<()>,
}

impl Proxy {
    pub(crate) async fn to(target: SocketAddr) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
        let address = listener.local_addr().unwrap();
        let link = Link { target, generation: 0, is_held: false, is_closed: false };
        let (link, watched) = watch::channel(link);
        let task = tokio::spawn(async move {
            loop {
                let (client, _) = listener.accept().await.unwrap();
                if !watched.borrow().is_closed {
                    tokio::spawn(relay(client, watched.clone()));
                }
            }
        });
        Self { address, link, task }
    }

    pub(crate) fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// Drops all connections; new ones are taken.
    pub(crate) fn cut(&self) {
        self.link.send_modify(|link| link.generation += 1);
    }

    /// Keeps answers from the client, or lets them through again.
    pub(crate) fn hold(&self, is_held: bool) {
        self.link.send_modify(|link| link.is_held = is_held);
    }

    /// Drops new connections as they come.
    pub(crate) fn close(&self) {
        self.link.send_modify(|link| link.is_closed = true);
    }

    /// Takes new connections again.
    pub(crate) fn open(&self) {
        self.link.send_modify(|link| link.is_closed = false);
    }

    /// Leads new connections to another server.
    pub(crate) fn lead_to(&self, target: SocketAddr) {
        self.link.send_modify(|link| link.target = target);
    }
}

impl Drop for Proxy {
    fn drop(&mut self) {
        self.task.abort();
        self.cut();
    }
}

async fn relay(client: TcpStream, mut link: watch::Receiver<Link>) {
    let Link { target, generation, .. } = *link.borrow();
    let Ok(server) = TcpStream::connect(target).await else { return };
    let (mut from_client, mut to_client) = client.into_split();
    let (mut from_server, mut to_server) = server.into_split();
    let mut held = link.clone();
    let requests = tokio::io::copy(&mut from_client, &mut to_server);
    let answers = async {
        let mut buffer = vec![0; 1 << 16];
        while let Ok(count @ 1..) = from_server.read(&mut buffer).await {
            let moved = held.wait_for(|link| !link.is_held || link.generation != generation).await;
            // What was held when the link was cut is lost, also when it is let go right after.
            let is_cut = moved.map_or(true, |link| link.generation != generation);
            if is_cut || to_client.write_all(&buffer[..count]).await.is_err() {
                return;
            }
        }
    };
    tokio::select! {
        _ = requests => {}
        () = answers => {}
        _ = link.wait_for(|link| link.generation != generation) => {}
    }
}
