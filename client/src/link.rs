//! How a client finds that a link is gone, and how long it waits for answers.
//!
//! A peer that vanishes without closing leaves a connection that looks alive (half-open). Probes find
//! it: a session then makes a new connection and resumes. Calls that solve have no deadline of their
//! own, as it would cut the solve short; the probes end them too. These are options only: no connection
//! is made here.

use std::time::Duration;

use tonic::transport::Endpoint;

use super::RetryPolicy;

/// Times of a link, and how it is used; each with its default.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LinkOptions {
    /// How long a connection may take to stand (10 s).
    pub connect_timeout: Duration,
    /// A connection is probed (HTTP/2 PING) after so long without a word from the server (10 s).
    pub keep_alive: Duration,
    /// It is given up when a probe is not answered for so long (10 s).
    pub keep_alive_timeout: Duration,
    /// The system's own probes (TCP) begin after so long (60 s).
    pub tcp_keep_alive: Duration,
    /// How long a call with one answer may take, those that solve left out (30 s).
    pub deadline: Duration,
    /// How often a call is made again that changes nothing, or that the server says it did not begin:
    /// within the deadline above, counted from the first failure.
    pub retry: RetryPolicy,
    /// Messages travel compressed (gzip), for links that are slow (no). What is large on the way back
    /// comes compressed too.
    pub compress: bool,
}

impl Default for LinkOptions {
    fn default() -> Self {
        let usual = Duration::from_secs(10);
        Self {
            connect_timeout: usual,
            keep_alive: usual,
            keep_alive_timeout: usual,
            tcp_keep_alive: Duration::from_secs(60),
            deadline: Duration::from_secs(30),
            retry: RetryPolicy::default(),
            compress: false,
        }
    }
}

impl LinkOptions {
    /// The endpoint with these times.
    pub(super) fn set(self, endpoint: Endpoint) -> Endpoint {
        endpoint
            .connect_timeout(self.connect_timeout)
            .tcp_nodelay(true)
            .tcp_keepalive(Some(self.tcp_keep_alive))
            .http2_keep_alive_interval(self.keep_alive)
            .keep_alive_timeout(self.keep_alive_timeout)
            .keep_alive_while_idle(true)
    }
}
