//! The link in this process, where devices are not permitted: a TCP relay that delays, limits and holds.
//!
//! Bytes cannot be lost in a TCP stream, so that a lost packet is what it is for those behind it: a wait
//! for its retransmission. A gap holds everything. Congestion control sees nothing of all this: rates
//! are those of a better link than the packets' one.

use std::net::SocketAddr;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tokio::io::{AsyncRead, AsyncReadExt, AsyncWrite, AsyncWriteExt};
use tokio::net::{TcpListener, TcpStream};
use tokio::time::Instant;

use crate::Profile;

/// A segment.
const SEGMENT: usize = 1400;
/// What a retransmission waits for at least (Linux).
const RETRANSMISSION: Duration = Duration::from_millis(200);

/// Bytes from the server and to it.
pub(crate) type Bytes = Arc<[AtomicU64; 2]>;

/// Relays to `target` until the runtime ends. The address to connect to, and what goes through.
pub(crate) async fn relay(
    target: SocketAddr,
    profile: Profile,
    seed: u64,
) -> std::io::Result<(SocketAddr, Bytes)> {
    let listener = TcpListener::bind("127.0.0.1:0").await?;
    let (address, bytes) = (listener.local_addr()?, Bytes::default());
    let (counted, start) = (Arc::clone(&bytes), Instant::now());
    tokio::spawn(async move {
        for connection in 0.. {
            let Ok((robot, _)) = listener.accept().await else { return };
            let Ok(server) = TcpStream::connect(target).await else { continue };
            let (from_robot, to_robot) = robot.into_split();
            let (from_server, to_server) = server.into_split();
            let link = |way| Link {
                profile: profile.clone(),
                start,
                rng: ChaCha8Rng::seed_from_u64(seed + 2 * connection + way),
            };
            tokio::spawn(link(0).carry(from_server, to_robot, Arc::clone(&counted), 0));
            tokio::spawn(link(1).carry(from_robot, to_server, Arc::clone(&counted), 1));
        }
    });
    Ok((address, bytes))
}

/// One direction of one connection.
struct Link {
    profile: Profile,
    start: Instant,
    rng: ChaCha8Rng,
}

impl Link {
    async fn carry(
        mut self,
        mut from: impl AsyncRead + Unpin,
        mut to: impl AsyncWrite + Unpin + Send + 'static,
        bytes: Bytes,
        way: usize,
    ) {
        let (sender, mut arriving) = tokio::sync::mpsc::channel::<(Instant, Vec<u8>)>(256);
        tokio::spawn(async move {
            while let Some((release, part)) = arriving.recv().await {
                tokio::time::sleep_until(release).await;
                if to.write_all(&part).await.is_err() {
                    return;
                }
            }
            let _gone = to.shutdown().await;
        });
        let (mut free, mut last) = (Instant::now(), Instant::now());
        let mut buffer = vec![0; SEGMENT];
        while let Ok(count @ 1..) = from.read(&mut buffer).await {
            bytes[way].fetch_add(count as u64, Ordering::Relaxed);
            let line = Duration::from_secs_f64(count as f64 * 8e-6 / self.profile.mbit);
            free = self.after_gap(free.max(Instant::now())) + line;
            last = last.max(free + self.delay());
            if sender.send((last, buffer[..count].to_vec())).await.is_err() {
                return;
            }
        }
    }

    /// The way there, and that of the retransmissions of what is lost.
    fn delay(&mut self) -> Duration {
        let Profile { delay_ms, jitter_ms, loss, .. } = self.profile;
        let mut delay = Duration::ZERO;
        loop {
            let jitter = jitter_ms * (2.0 * self.rng.random::<f64>() - 1.0);
            let way = Duration::from_secs_f64((delay_ms + jitter).max(0.0) * 1e-3);
            if self.rng.random::<f64>() >= loss {
                return delay + way;
            }
            delay += RETRANSMISSION.max(2 * way);
        }
    }

    fn after_gap(&self, at: Instant) -> Instant {
        let Profile { gap_s, period_s, .. } = self.profile;
        let since = at.duration_since(self.start).as_secs_f64();
        let phase = since % period_s;
        let left = if phase >= period_s - gap_s { period_s - phase } else { 0.0 };
        at + Duration::from_secs_f64(left)
    }
}
