//! The flags by which a command finds its server and proves who it is, and the connection.
//!
//! A token comes from a file or from `COVIS_TOKEN`, never from an argument, which every user of the
//! machine could read.

use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use fs_err as fs;

use super::config::{Config, Layer};
use crate::client::{Client, Credentials, RetryPolicy, Token};

/// Which server, and who is asking.
#[derive(Debug, clap::Args)]
pub(super) struct Connection {
    /// The server's URL [default: http://127.0.0.1:7411] [env: COVIS_SERVER].
    #[arg(long, global = true, value_name = "URL")]
    server: Option<String>,
    /// Certificates (PEM) of the authorities to trust instead of the system's [env: COVIS_CA].
    #[arg(long, global = true, value_name = "FILE")]
    ca: Option<PathBuf>,
    /// The client's own certificate (PEM), for mutual TLS [env: COVIS_CERT].
    #[arg(long, global = true, value_name = "FILE")]
    cert: Option<PathBuf>,
    /// The private key of --cert (PEM) [env: COVIS_KEY].
    #[arg(long, global = true, value_name = "FILE")]
    key: Option<PathBuf>,
    /// File that holds the bearer token [env: COVIS_TOKEN_FILE, or the token itself: COVIS_TOKEN].
    #[arg(long, global = true, value_name = "FILE")]
    token_file: Option<PathBuf>,
}

impl Connection {
    /// Whether a flag names the server.
    pub(super) fn names_server(&self) -> bool {
        self.server.is_some()
    }

    /// The settings that flags override.
    pub(super) fn layer(&self) -> Layer {
        Layer {
            server: self.server.clone(),
            ca: self.ca.clone(),
            cert: self.cert.clone(),
            key: self.key.clone(),
            token_file: self.token_file.clone(),
            ..Layer::default()
        }
    }
}

/// Connects to the server that the configuration names.
pub(super) async fn connect(config: &Config) -> anyhow::Result<Client> {
    Ok(Client::connect_with(&config.server, &credentials(config)?).await?)
}

/// As [`connect`], tried again for as long as `retry` allows.
pub(super) async fn connect_patiently(
    config: &Config,
    retry: RetryPolicy,
) -> anyhow::Result<Client> {
    let credentials = credentials(config)?;
    Ok(retry.run(|| Client::connect_with(&config.server, &credentials)).await?)
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
