//! A server in this process, in memory, for runs that name none.

use anyhow::Context;
use tokio::net::TcpListener;

use crate::cli::config::Config;
use crate::cli::serve::server_config;
use crate::client::Client;
use crate::service::{RunningServer, Server};

/// The server and a client of it.
pub(in crate::cli) struct Embedded {
    server: RunningServer,
    pub(in crate::cli) client: Client,
}

impl Embedded {
    /// Starts it on a free loopback port.
    pub(in crate::cli) async fn start(config: &Config) -> anyhow::Result<Self> {
        let listener = TcpListener::bind("127.0.0.1:0").await.context("no free loopback port")?;
        let server = Server::start(listener, server_config(config)).await?;
        let client = Client::connect(&format!("http://{}", server.local_addr())).await?;
        Ok(Self { server, client })
    }

    /// Ends it.
    pub(in crate::cli) async fn stop(self) {
        drop(self.client);
        self.server.shutdown().await;
    }
}
