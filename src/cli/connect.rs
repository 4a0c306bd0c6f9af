//! The connection of a command to the server that the configuration names, or to one in this
//! process.
//!
//! A token comes from a file or from `COVIS_TOKEN`, never from an argument, which every user of the
//! machine could read.

use std::net::SocketAddr;
use std::path::Path;
use std::time::Duration;

use anyhow::{Context, bail};
use fs_err as fs;
use tokio::net::TcpListener;
use tonic::transport::Channel;

use super::config::Config;
use super::serve::server_config;
use crate::client::{
    Client, ClientError, Credentials, LinkOptions, RetryPolicy, Token, connect_channel,
};
use crate::service::{RunningServer, Server, ServerConfig};

/// Longest pause between two tries while a server is not ready.
const LONGEST_PAUSE: Duration = Duration::from_secs(1);

/// Connects to the server that the configuration names, once it is ready. While nobody answers there, or
/// the server still opens its maps, it is asked again for as long as `--server-wait` says. For as long, the
/// client repeats those calls of the command that change nothing or that the server did not begin.
pub(super) async fn connect(config: &Config) -> anyhow::Result<Client> {
    let (credentials, wait) = (credentials(config)?, config.server_wait());
    let retry = RetryPolicy {
        max_attempts: u32::MAX,
        longest_delay: LONGEST_PAUSE,
        give_up_after: Some(wait),
        ..RetryPolicy::default()
    };
    let ready = retry.run(|| async {
        let client = Client::connect_with(config.server(), &credentials).await?;
        client.with_retry(RetryPolicy::once()).server_info().await?;
        Ok(client.with_retry(retry))
    });
    match ready.await {
        Ok(client) => Ok(client),
        // Without a wait, the reason says all.
        Err(ClientError::RetriesExhausted { last, .. }) if wait.is_zero() => Err((*last).into()),
        Err(ClientError::RetriesExhausted { last, .. }) => {
            let (seconds, server) = (wait.as_secs(), config.server());
            let waited = format!("waited {seconds} s for {server} to be ready");
            Err(anyhow::Error::new(*last).context(waited))
        }
        Err(error) => Err(error.into()),
    }
}

/// A channel to the server that the configuration names, for services that ask for no token. Ends where
/// the server does not answer for some seconds.
pub(super) async fn channel(config: &Config, deadline: Duration) -> anyhow::Result<Channel> {
    let credentials = Credentials { token: None, ..credentials(config)? };
    let link = LinkOptions { deadline, ..LinkOptions::default() };
    // Of several servers, the first is asked.
    let url = config.server().split(',').next().unwrap_or_default().trim();
    let connecting = connect_channel(url, &credentials, link);
    match tokio::time::timeout(deadline, connecting).await {
        Ok(channel) => Ok(channel?),
        Err(_elapsed) => bail!("{url}: no answer within {} s", deadline.as_secs_f64()),
    }
}

/// Runs `act` with a client of the server that the configuration names.
pub(super) fn with_client(
    config: &Config,
    act: impl AsyncFnOnce(Client) -> anyhow::Result<()>,
) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Runtime::new().context("the async runtime")?;
    runtime.block_on(async { act(connect(config).await?).await })
}

fn credentials(config: &Config) -> anyhow::Result<Credentials> {
    let read = |path: &Path| fs::read(path).context("credentials");
    let identity_pem = match (&config.cert, &config.key) {
        (Some(cert), Some(key)) => Some((read(cert)?, read(key)?)),
        (None, None) => None,
        _ => bail!("--cert and --key belong together: one of them is missing"),
    };
    // A file that is named on purpose wins over a variable that may stand there for another server.
    let token = match &config.token_file {
        Some(path) => Some(Token::new(&fs::read_to_string(path).context("credentials")?)),
        None => config.token.clone(),
    };
    let ca_pem = config.ca.as_deref().map(read).transpose()?;
    Ok(Credentials { ca_pem, identity_pem, token })
}

/// A server in this process, in memory, and a client of it: for runs that name no server.
pub(super) struct Embedded {
    server: RunningServer,
    pub(super) client: Client,
}

impl Embedded {
    /// Starts it on a free loopback port.
    pub(super) async fn start(config: &Config) -> anyhow::Result<Self> {
        Self::serve(server_config(config)).await
    }

    /// Starts it with the page on another free loopback port, and tells where that is.
    pub(super) async fn start_with_page(config: &Config) -> anyhow::Result<(Self, SocketAddr)> {
        let page_listen = Some("127.0.0.1:0".to_owned());
        let embedded = Self::serve(ServerConfig { page_listen, ..server_config(config) }).await?;
        let address = embedded.server.page_addr().context("the page is not served")?;
        Ok((embedded, address))
    }

    async fn serve(config: ServerConfig) -> anyhow::Result<Self> {
        let listener = TcpListener::bind("127.0.0.1:0").await.context("no free loopback port")?;
        let server = Server::start(listener, config).await?;
        let client = Client::connect(&format!("http://{}", server.local_addr())).await?;
        Ok(Self { server, client })
    }

    /// Ends it.
    pub(super) async fn stop(self) {
        drop(self.client);
        self.server.shutdown().await;
    }
}
