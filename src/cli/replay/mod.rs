//! `covis replay`: streams a BAL file or a COLMAP folder to a server, as a remote frontend would.
//!
//! Keyframe by keyframe, each with its observations and the file's start values, so that the server
//! does all that it does for a robot: checks, acks, local bundle adjustment. Then the whole map is
//! optimized (trivial loss, intrinsics and first keyframe fixed). RMSE = √(Σ‖r‖² / N). Reads files
//! and speaks through [`crate::client`]; no mathematics here.

pub(crate) mod encode;
mod items;
mod recording;
mod report;

use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::{Arc, Mutex, PoisonError};

use anyhow::{Context, bail};

use super::config::{Config, Layer};
use super::connect::{Connection, connect};
use super::output::print;
use super::progress::Progress;
use crate::client::{Client, IngestReport, SessionOptions, describe_violation};
use crate::wire::v1;
use items::Items;
use recording::Recording;

/// Iterations after which the final optimization stops.
const MAX_ITERATIONS: i32 = 500;
/// It has converged when the cost falls by less than this, relative to itself.
const FUNCTION_TOLERANCE: f64 = 1e-12;
/// Refused items that are shown.
const SHOWN_REJECTIONS: usize = 5;

/// Streams a BAL file or a COLMAP folder to a server.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// A BAL file, or the folder of a COLMAP sparse model (text or binary).
    file: PathBuf,
    #[command(flatten)]
    connection: Connection,
    /// The map; made when it does not exist [default: the file's name].
    #[arg(long, value_name = "NAME")]
    map: Option<String>,
    /// Add to a map that is not empty. A file that was sent before is recognized, nothing doubles.
    #[arg(long, conflicts_with = "replace")]
    append: bool,
    /// Delete what the map holds first.
    #[arg(long)]
    replace: bool,
    /// Let solves run beside the stream: sooner done, but no longer the same bits every time.
    #[arg(long)]
    no_lock_step: bool,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
}

impl Args {
    /// The settings that flags override.
    pub(super) fn layer(&self) -> Layer {
        self.connection.layer()
    }
}

/// Streams a BAL file or a COLMAP folder to a server.
///
/// # Errors
/// A file that cannot be read, a server that is not there, a map that is not empty, a solve that is
/// refused. Refused items are no error: they are shown and make the exit code 1.
pub fn run(args: Args, config: &Config) -> anyhow::Result<ExitCode> {
    let recording = Recording::read(&args.file)?;
    let runtime = tokio::runtime::Runtime::new().context("the async runtime")?;
    runtime.block_on(replay(&args, config, &recording))
}

async fn replay(args: &Args, config: &Config, recording: &Recording) -> anyhow::Result<ExitCode> {
    let stem = legal_id(&args.file.file_stem().unwrap_or_default().to_string_lossy());
    let map_id = args.map.clone().unwrap_or_else(|| stem.clone());
    if recording.repeated > 0 {
        let count = recording.repeated;
        tracing::warn!("{count} observations stand twice in the file: left out once");
    }
    let client = connect(config).await?;
    prepare_map(&client, &map_id, args).await?;
    let report = stream(&client, &map_id, &stem, recording, !args.no_lock_step).await?;
    for rejected in report.rejections.iter().take(SHOWN_REJECTIONS) {
        let violations: Vec<String> = rejected.violations.iter().map(describe_violation).collect();
        tracing::error!("item {} was rejected: {}", rejected.sequence, violations.join("; "));
    }
    let result = optimize(&client, &map_id).await?;
    let Some(summary) = &result.summary else { bail!("OptimizeMap answered without a summary") };
    if args.json {
        print(report::json(&map_id, &report, &result, summary)?)?;
    } else {
        print(report::table(&map_id, &report, &result, summary))?;
    }
    let is_good = report.rejected == 0 && report.unanswered() == 0;
    Ok(if is_good { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

/// Makes the map, or sees that the one that is there may be used.
async fn prepare_map(client: &Client, map_id: &str, args: &Args) -> anyhow::Result<()> {
    let Some(map) = client.find_map(map_id).await? else {
        client.create_map(map_id, None).await?;
        return Ok(());
    };
    let counts = map.counts.unwrap_or_default();
    let entities = counts.camera_count + counts.keyframe_count + counts.landmark_count;
    if args.replace {
        client.delete_map(map_id).await?;
        client.create_map(map_id, Some(map.policy.unwrap_or_default())).await?;
    } else if entities > 0 && !args.append {
        bail!(
            "map {map_id} is not empty ({} keyframes, {} landmarks): --append adds to it, \
             --replace deletes it first, --map NAME takes another",
            counts.keyframe_count,
            counts.landmark_count
        );
    }
    Ok(())
}

/// Sends all items and waits for every ack.
async fn stream(
    client: &Client,
    map_id: &str,
    client_id: &str,
    recording: &Recording,
    lock_step: bool,
) -> anyhow::Result<IngestReport> {
    let count = recording.keyframe_ids.len();
    let progress = Arc::new(Mutex::new(Progress::new("keyframes", count as u64)));
    // Acks name sequences: those of the keyframes that are on their way, oldest first.
    let pending = Arc::new(Mutex::new(std::collections::VecDeque::<i64>::new()));
    let options = {
        let (progress, pending) = (Arc::clone(&progress), Arc::clone(&pending));
        let options = SessionOptions { lock_step, omit_solve_summary: true, ..Default::default() };
        options.on_ack(move |ack| {
            if !matches!(ack.status(), v1::AckStatus::Received | v1::AckStatus::Rejected) {
                return;
            }
            let mut pending = pending.lock().unwrap_or_else(PoisonError::into_inner);
            while pending.front().is_some_and(|&sequence| sequence <= ack.sequence) {
                pending.pop_front();
                progress.lock().unwrap_or_else(PoisonError::into_inner).advance(1);
            }
        })
    };
    let mut session = client.ingest(map_id, client_id, options).await?;
    let limit = usize::try_from(session.opened().max_message_bytes).unwrap_or(usize::MAX);
    let mut items = Items::new(recording, limit);
    let mut sequence = 0;
    for index in 0..count {
        let of_keyframe = items.of_keyframe(index);
        let last = sequence + of_keyframe.len() as i64;
        pending.lock().unwrap_or_else(PoisonError::into_inner).push_back(last);
        for item in of_keyframe {
            sequence += 1;
            session.send_as(sequence, item).await?;
        }
    }
    let report = session.finish().await?;
    if let Ok(progress) = Arc::try_unwrap(progress).map(Mutex::into_inner) {
        progress.unwrap_or_else(PoisonError::into_inner).finish();
    }
    Ok(report)
}

/// Optimizes the whole map.
async fn optimize(client: &Client, map_id: &str) -> anyhow::Result<v1::OptimizeMapResult> {
    let trivial = v1::Loss { kind: v1::LossKind::Trivial.into(), width: None };
    let request = v1::OptimizeMapRequest {
        map_id: map_id.to_owned(),
        options: Some(v1::SolverOptions {
            max_iteration_count: Some(MAX_ITERATIONS),
            function_tolerance: Some(FUNCTION_TOLERANCE),
            ..v1::SolverOptions::default()
        }),
        observation_loss: Some(trivial),
        constraint_loss: Some(trivial),
        gauge: v1::Gauge::FirstKeyframeFixed.into(),
        refine_intrinsics: false,
        problem: v1::MapProblem::Full.into(),
        certify: false,
    };
    tracing::info!("optimizing the whole map");
    let result = client.optimize_map(request, |row| {
        tracing::debug!(iteration = row.iteration, cost = row.cost, accepted = row.accepted);
    });
    Ok(result.await?)
}

/// A map's or client's id from any name: 1 to 63 characters of a-z, 0-9, '_' and '-'.
fn legal_id(name: &str) -> String {
    let legal = |c: char| match c.to_ascii_lowercase() {
        c @ ('a'..='z' | '0'..='9' | '_' | '-') => c,
        _ => '-',
    };
    let id: String = name.chars().map(legal).take(63).collect();
    let id = id.trim_matches('-');
    if id.is_empty() { "replay".to_owned() } else { id.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::legal_id;

    #[test]
    fn any_name_becomes_a_legal_id() {
        assert_eq!(legal_id("ladybug-49-7776"), "ladybug-49-7776");
        assert_eq!(legal_id("My Room (2)"), "my-room--2");
        assert_eq!(legal_id("über.alles"), "ber-alles");
        assert_eq!(legal_id("..."), "replay");
        assert_eq!(legal_id(&"x".repeat(100)).len(), 63);
    }
}
