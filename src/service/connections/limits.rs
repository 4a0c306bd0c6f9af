//! How many connections a server holds, and how long one may keep its slot without use. This
//! module has only the numbers; `registry` and `serving` enforce them.

use std::time::Duration;

/// Limits of connections.
///
/// A connection is a stranger until it makes a call that the guard admits. A stranger costs some 100
/// KiB at most, any other up to the 8 MiB of the HTTP/2 window that its streams share.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ConnectionLimits {
    /// Most connections at once, strangers included (512). They never exceed half of the files that
    /// the process may open, because journals need the rest.
    pub max_connections: usize,
    /// Strangers at once (256). A new one takes the slot of the oldest stranger of the network
    /// that has most of them, so that strangers keep nobody out.
    pub max_strangers: usize,
    /// How long a connection may be a stranger: the time for the TLS handshake, the preface of HTTP/2
    /// and the first call that is admitted together (30 s).
    pub stranger_time: Duration,
    /// How long a connection may be without an open call; it is then told to go away (5 min).
    pub idle_time: Duration,
    /// How long the peer may take for the next 64 KiB of a request message that it has begun, or
    /// for the rest of it (30 s).
    pub message_time: Duration,
    /// Bytes of request messages that have begun to come and are not complete, of all connections
    /// (256 MiB); messages up to 64 KiB do not count. Further ones wait.
    pub max_unfinished_bytes: usize,
}

impl Default for ConnectionLimits {
    fn default() -> Self {
        Self {
            max_connections: 512,
            max_strangers: 256,
            stranger_time: Duration::from_secs(30),
            idle_time: Duration::from_secs(300),
            message_time: Duration::from_secs(30),
            max_unfinished_bytes: 256 << 20,
        }
    }
}

impl ConnectionLimits {
    /// These limits, lowered so that half of the files that the process may open stay free.
    pub(super) fn within(self, descriptors: Option<u64>) -> Self {
        let half = descriptors.and_then(|limit| usize::try_from(limit / 2).ok());
        let max_connections = self.max_connections.min(half.unwrap_or(usize::MAX)).max(2);
        // Callers with a token need a slot too.
        let max_strangers = self.max_strangers.clamp(1, max_connections.div_ceil(2));
        if max_connections < self.max_connections {
            tracing::warn!(
                max_connections,
                "fewer connections than asked for: the limit of open files allows no more"
            );
        }
        Self { max_connections, max_strangers, ..self }
    }

    /// Most connections that are not strangers.
    pub(super) fn max_known(&self) -> usize {
        self.max_connections.saturating_sub(self.max_strangers)
    }
}
