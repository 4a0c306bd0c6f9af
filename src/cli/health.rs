//! `covis health`: whether a server is ready, for scripts and probes.
//!
//! Asks `grpc.health.v1`, which takes no token. The exit code is the answer. It asks once: to wait for a
//! server, call it again.

use std::time::Duration;

use anyhow::Context;
use tonic_health::pb::HealthCheckRequest;
use tonic_health::pb::health_check_response::ServingStatus;
use tonic_health::pb::health_client::HealthClient;

use super::config::Config;
use super::connect::channel;
use super::output::{show, succeed_if};

/// How long the server may take to answer.
const DEADLINE: Duration = Duration::from_secs(4);

/// Arguments of `covis health`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Print one JSON object instead of a sentence.
    #[arg(long)]
    json: bool,
}

/// Asks, prints the answer; the exit code is 0 if the server serves.
/// Fails for a server that is not there.
pub(super) fn run(args: &Args, config: &Config) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let serving = runtime.context("the async runtime")?.block_on(ask(config))?;
    let server = config.server();
    let document = serde_json::json!({ "server": server, "serving": serving });
    show(args.json, &document, || {
        let text =
            if serving { "serves" } else { "is opening its maps or draining: it refuses calls" };
        format!("{server} {text}")
    })?;
    succeed_if(serving)
}

async fn ask(config: &Config) -> anyhow::Result<bool> {
    let mut health = HealthClient::new(channel(config, DEADLINE).await?);
    let mut request = tonic::Request::new(HealthCheckRequest::default());
    request.set_timeout(DEADLINE);
    let answer = health.check(request).await;
    let answer = answer.with_context(|| format!("{}: health", config.server()))?.into_inner();
    Ok(answer.status() == ServingStatus::Serving)
}
