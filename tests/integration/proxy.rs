//! A link that can be cut, held, frozen and led elsewhere: a TCP relay between a client and a server.
//!
//! Cutting drops every connection; holding keeps what the server sends from the client; closed, it
//! drops new connections as they come; frozen, its present connections swallow all bytes and never
//! close, as if the other end had lost its power. Everything is by command, nothing by time.

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
    /// The connections that were made so far.
    made: u64,
    /// Of these the first ones swallow everything.
    frozen: u64,
    /// Frozen connections that the server gave up.
    given_up: u64,
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
        let link = Link {
            target,
            generation: 0,
            made: 0,
            frozen: 0,
            given_up: 0,
            is_held: false,
            is_closed: false,
        };
        let (link, _) = watch::channel(link);
        let shared = link.clone();
        let task = tokio::spawn(async move {
            loop {
                let (client, _) = listener.accept().await.unwrap();
                if !shared.borrow().is_closed {
                    shared.send_modify(|link| link.made += 1);
                    tokio::spawn(relay(client, shared.clone()));
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

    /// Has the present connections swallow all bytes, and neither end be told.
    pub(crate) fn freeze(&self) {
        self.link.send_modify(|link| link.frozen = link.made);
    }

    /// Waits until the server has given up so many frozen connections.
    pub(crate) async fn given_up(&self, count: u64) {
        self.link.subscribe().wait_for(|link| link.given_up >= count).await.unwrap();
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

async fn relay(client: TcpStream, link: watch::Sender<Link>) {
    let Link { target, generation, made: number, .. } = *link.borrow();
    let Ok(server) = TcpStream::connect(target).await else { return };
    let (mut from_client, mut to_client) = client.into_split();
    let (mut from_server, mut to_server) = server.into_split();
    let is_frozen = || number <= link.borrow().frozen;
    let requests = async {
        let mut buffer = vec![0; 1 << 16];
        while let Ok(count @ 1..) = from_client.read(&mut buffer).await {
            // What is sent after a cut is lost, also before this task notices it otherwise.
            if link.borrow().generation != generation {
                return;
            }
            if !is_frozen() && to_server.write_all(&buffer[..count]).await.is_err() {
                break;
            }
        }
        stay_if(is_frozen()).await;
    };
    let answers = async {
        let (mut buffer, mut held) = (vec![0; 1 << 16], link.subscribe());
        while let Ok(count @ 1..) = from_server.read(&mut buffer).await {
            let moved = held.wait_for(|link| !link.is_held || link.generation != generation).await;
            // What was held when the link was cut is lost, also when it is let go right after.
            if moved.map_or(true, |link| link.generation != generation) {
                return;
            }
            if !is_frozen() && to_client.write_all(&buffer[..count]).await.is_err() {
                break;
            }
        }
        if is_frozen() {
            link.send_modify(|link| link.given_up += 1);
        }
        stay_if(is_frozen()).await;
    };
    let mut watched = link.subscribe();
    tokio::select! {
        () = requests => {}
        () = answers => {}
        _ = watched.wait_for(|link| link.generation != generation) => {}
    }
}

/// Keeps the end of one side from reaching the other.
async fn stay_if(is_frozen: bool) {
    if is_frozen {
        std::future::pending::<()>().await;
    }
}
