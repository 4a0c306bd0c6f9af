//! Whether every NATS server syncs before it acknowledges.
//!
//! JetStream answers before fsync unless `sync_interval: always` is set, and the protocol of clients does
//! not tell which: the monitoring address of each server does (`GET /varz`, plain HTTP). It changes no
//! setting of NATS.

use serde::Deserialize;
use tokio::io::{AsyncReadExt, AsyncWriteExt};
use tokio::net::TcpStream;

use super::ReplicationError;

/// Longest answer that is read, bytes.
const LONGEST: u64 = 4 << 20;
/// Longest time that a server may take.
const PATIENCE: std::time::Duration = std::time::Duration::from_secs(5);

/// What `/varz` tells that matters here.
#[derive(Debug, Default, Deserialize)]
struct Varz {
    server_id: String,
    #[serde(default)]
    server_name: String,
    #[serde(default)]
    jetstream: JetStream,
}

#[derive(Debug, Default, Deserialize)]
struct JetStream {
    #[serde(default)]
    config: Option<JetStreamConfig>,
    #[serde(default)]
    meta: Option<Meta>,
}

#[derive(Debug, Default, Deserialize)]
struct JetStreamConfig {
    #[serde(default)]
    sync_always: bool,
}

#[derive(Debug, Default, Deserialize)]
struct Meta {
    #[serde(default)]
    cluster_size: usize,
}

/// Asks each monitoring address.
///
/// # Errors
/// [`ReplicationError::Monitoring`] where one does not answer, [`ReplicationError::Unsynced`] where a
/// server acknowledges before it has synced, [`ReplicationError::Unmonitored`] where the cluster has more
/// servers than were asked.
pub(super) async fn check(addresses: &[String]) -> Result<(), ReplicationError> {
    let mut asked = Vec::new();
    let mut servers = 1;
    for address in addresses {
        let failed = |reason: String| {
            let address = address.clone();
            ReplicationError::Monitoring { address, reason }
        };
        let answer = tokio::time::timeout(PATIENCE, get(address)).await;
        let answer = answer.map_err(|_elapsed| failed("it does not answer".to_owned()))?;
        let body = answer.map_err(|error| failed(error.to_string()))?;
        let varz: Varz = serde_json::from_slice(&body).map_err(|e| failed(e.to_string()))?;
        let config = varz.jetstream.config;
        let config = config.ok_or_else(|| failed("this server has no JetStream".to_owned()))?;
        if !config.sync_always {
            return Err(ReplicationError::Unsynced { server: varz.server_name });
        }
        servers = servers.max(varz.jetstream.meta.map_or(1, |meta| meta.cluster_size));
        if !asked.contains(&varz.server_id) {
            asked.push(varz.server_id);
        }
    }
    if asked.len() < servers {
        return Err(ReplicationError::Unmonitored { asked: asked.len(), servers });
    }
    Ok(())
}

/// The body of `GET /varz`.
async fn get(address: &str) -> std::io::Result<Vec<u8>> {
    let host = address.strip_prefix("http://").unwrap_or(address).trim_end_matches('/');
    let mut stream = TcpStream::connect(host).await?;
    // Of HTTP/1.0 the answer is one piece and ends with the connection.
    let request = format!("GET /varz HTTP/1.0\r\nHost: {host}\r\n\r\n");
    stream.write_all(request.as_bytes()).await?;
    let mut answer = Vec::new();
    stream.take(LONGEST).read_to_end(&mut answer).await?;
    let end = answer.windows(4).position(|bytes| bytes == b"\r\n\r\n");
    let is_ok = answer.starts_with(b"HTTP/1.") && answer.get(8..13) == Some(b" 200 ");
    match end {
        Some(end) if is_ok => Ok(answer.split_off(end + 4)),
        Some(_) | None => Err(std::io::Error::other("it is no monitoring address of NATS")),
    }
}
