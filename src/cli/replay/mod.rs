//! `covis replay`: streams a BAL file or a COLMAP folder to a server, as a remote frontend would.
//!
//! Keyframe by keyframe, each with its observations and the file's start values, so that the server
//! does all that it does for a robot: checks, acks, local bundle adjustment. Then the whole map is
//! optimized (trivial loss, intrinsics and first keyframe fixed). RMSE = √(Σ‖r‖² / N). If the link
//! breaks, it reconnects and resumes the stream, for up to `--reconnect-for` seconds. It reads
//! files and calls the server through [`crate::client`]; no mathematics here.

mod levels;
mod recording;
mod report;

use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context, anyhow, bail};
use tokio::time::Instant;
use tonic::Code;

use super::choices::number;
use super::config::Config;
use super::connect::connect;
use super::output::{print, succeed_if};
use super::progress::Progress;
use super::signals::Signals;
use crate::client::{
    Client, ClientError, IngestReport, Item, RetryPolicy, SessionOptions, SpillOptions,
    describe_violation,
};
use crate::sync::Mutex;
use crate::wire::v1;
use levels::Levels;
use recording::{Items, Recording};

/// Iterations after which the final optimization stops.
const MAX_ITERATIONS: i32 = 500;
/// It has converged when the cost falls by less than this, relative to itself.
const FUNCTION_TOLERANCE: f64 = 1e-12;
/// Attempts without an ack between them after which a stream that breaks is given up, however soon
/// it can be opened again.
const MAX_ATTEMPTS: u32 = 1000;
/// Longest wait before the server is tried again.
const LONGEST_DELAY: Duration = Duration::from_secs(1);
/// Longest spill file by default: 1 GiB.
const SPILL_BYTES: u64 = 1 << 30;
/// Refused items that are shown.
const SHOWN_REJECTIONS: usize = 5;

/// Streams a BAL file or a COLMAP folder to a server.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// A BAL file, or the folder of a COLMAP sparse model (text or binary).
    file: PathBuf,
    /// Name of the map; it is created if it does not exist [default: the file's name].
    #[arg(long, value_name = "NAME")]
    map: Option<String>,
    /// Add to a map that is not empty. The server recognizes a file that was sent before and adds
    /// nothing twice.
    #[arg(long, conflicts_with = "replace")]
    append: bool,
    /// Delete the map's content first.
    #[arg(long)]
    replace: bool,
    /// Run solves in parallel with the stream: faster, but results are no longer reproducible to
    /// the bit.
    #[arg(long)]
    no_lock_step: bool,
    /// Send this many keyframes per second [default: as fast as the server takes them].
    #[arg(long, value_name = "HZ", value_parser = rate)]
    rate: Option<f64>,
    /// How long to retry when the server disconnects, before giving up; --server-wait is for the start.
    #[arg(long, value_name = "SECONDS", default_value = "10", value_parser = seconds)]
    reconnect_for: Duration,
    /// While the server is unreachable, store unsent items that do not fit in memory in a file in
    /// this folder; the next run of the same recording onto the same map sends them first.
    #[arg(long, value_name = "DIR")]
    spill_dir: Option<PathBuf>,
    /// Maximum size of that file, bytes [default: 1 GiB].
    #[arg(long, value_name = "N", requires = "spill_dir")]
    spill_bytes: Option<u64>,
    /// Print one JSON object instead of a table; also after a failure and on SIGTERM.
    #[arg(long)]
    json: bool,
}

/// Streams a BAL file or a COLMAP folder to a server.
/// Fails for a file that cannot be read, a server that is not there, a map that is not empty, a
/// solve that is refused, a server that stays away, a signal. Refused items are no error: they are
/// shown and make the exit code 1.
pub(super) fn run(args: Args, config: &Config) -> anyhow::Result<()> {
    let recording = Recording::read(&args.file)?;
    let runtime = tokio::runtime::Runtime::new().context("the async runtime")?;
    runtime.block_on(replay(&args, config, &recording))
}

async fn replay(args: &Args, config: &Config, recording: &Recording) -> anyhow::Result<()> {
    let mut signals = Signals::new().context("signal handlers")?;
    let stem = legal_id(&args.file.file_stem().unwrap_or_default().to_string_lossy());
    let map_id = args.map.clone().unwrap_or_else(|| stem.clone());
    if recording.repeated > 0 {
        let count = recording.repeated;
        tracing::warn!("{count} observations occur twice in the file and are added once");
    }
    let retry = RetryPolicy {
        max_attempts: MAX_ATTEMPTS,
        longest_delay: LONGEST_DELAY,
        give_up_after: Some(args.reconnect_for),
        ..RetryPolicy::default()
    };
    let levels = Arc::new(Mutex::new(Levels::default()));
    let work = async {
        // The calls below repeat more than a client does by itself.
        let client = connect(config).await?.with_retry(RetryPolicy::once());
        prepare_map(&client, &map_id, args, retry).await?;
        let report = stream(&client, &map_id, &stem, retry, recording, args, &levels).await?;
        for rejected in report.rejections.iter().take(SHOWN_REJECTIONS) {
            let violations: Vec<String> =
                rejected.violations.iter().map(describe_violation).collect();
            tracing::error!("item {} was rejected: {}", rejected.sequence, violations.join("; "));
        }
        let result = retry.run(|| optimize(&client, &map_id)).await?;
        Ok((report, result))
    };
    let outcome = tokio::select! {
        outcome = work => outcome,
        signal = signals.next() => Err(anyhow!("{signal}")),
    };
    let levels = levels.lock().clone();
    let (report, result) = match outcome {
        Ok(done) => done,
        Err(error) => {
            if args.json {
                print(report::json(&map_id, &levels, None)?)?;
            }
            return Err(error);
        }
    };
    let Some(summary) = &result.summary else { bail!("OptimizeMap answered without a summary") };
    if args.json {
        print(report::json(&map_id, &levels, Some((&result, summary)))?)?;
    } else {
        print(report::table(&map_id, &report, &levels, &result, summary))?;
    }
    let is_good = report.rejected == 0 && report.unanswered() == 0;
    succeed_if(is_good)
}

/// Makes the map, or sees that the one that is there may be used.
async fn prepare_map(
    client: &Client,
    map_id: &str,
    args: &Args,
    retry: RetryPolicy,
) -> anyhow::Result<()> {
    let Some(map) = retry.run(|| client.find_map(map_id)).await? else {
        // The poses of a file are estimates of photographs and no odometry.
        let policy = v1::MapPolicy { odometry: Some(false), ..v1::MapPolicy::default() };
        return create_map(client, map_id, Some(policy), retry).await;
    };
    let counts = map.counts.unwrap_or_default();
    let entities = counts.camera_count + counts.keyframe_count + counts.landmark_count;
    if args.replace {
        match retry.run(|| client.delete_map(map_id)).await {
            // An attempt whose answer was lost has deleted it.
            Err(error) if error.code() == Some(Code::NotFound) => {}
            deleted => deleted?,
        }
        create_map(client, map_id, Some(map.policy.unwrap_or_default()), retry).await?;
    } else if entities > 0 && !args.append {
        bail!(
            "map {map_id} is not empty ({} keyframes, {} landmarks): --append adds to it, \
             --replace deletes it first, --map NAME names another",
            counts.keyframe_count,
            counts.landmark_count
        );
    }
    Ok(())
}

async fn create_map(
    client: &Client,
    map_id: &str,
    policy: Option<v1::MapPolicy>,
    retry: RetryPolicy,
) -> anyhow::Result<()> {
    match retry.run(|| client.create_map(map_id, policy)).await {
        // An attempt whose answer was lost has made it.
        Err(error) if error.code() == Some(Code::AlreadyExists) => Ok(()),
        created => Ok(created.map(drop)?),
    }
}

/// Sends all items and waits for every ack.
async fn stream(
    client: &Client,
    map_id: &str,
    client_id: &str,
    retry: RetryPolicy,
    recording: &Recording,
    args: &Args,
    levels: &Arc<Mutex<Levels>>,
) -> anyhow::Result<IngestReport> {
    let count = recording.keyframe_ids.len();
    let progress = Arc::new(Mutex::new(Progress::new("keyframes", count as u64)));
    let options = SessionOptions {
        lock_step: !args.no_lock_step,
        omit_solve_summary: true,
        retry,
        spill: args.spill_dir.clone().map(|directory| SpillOptions {
            directory,
            max_bytes: args.spill_bytes.unwrap_or(SPILL_BYTES),
        }),
        ..SessionOptions::default()
    };
    let (shown, taken) = (Arc::clone(&progress), Arc::clone(levels));
    let options = options.on_ack(move |ack| {
        let mut levels = taken.lock();
        let before = levels.keyframes().received;
        levels.take(ack);
        let more = levels.keyframes().received.saturating_sub(before);
        shown.lock().advance(more as u64);
    });
    let mut session = client.ingest(map_id, client_id, options).await?;
    let limit = usize::try_from(session.opened().max_message_bytes).unwrap_or(usize::MAX);
    // What an earlier run left is on its way already.
    let left = session.left_over().map_or(0, |left| left.last_sequence);
    let mut items = Items::new(recording, limit);
    let (mut sequence, start) = (0, Instant::now());
    for index in 0..count {
        if let Some(rate) = args.rate {
            // Counted from the start: what a broken link delayed is caught up with.
            let due = Duration::try_from_secs_f64(index as f64 / rate).unwrap_or(Duration::MAX);
            if let Some(due) = start.checked_add(due) {
                tokio::time::sleep_until(due).await;
            }
        }
        for item in items.of_keyframe(index) {
            sequence += 1;
            levels.lock().send(sequence, matches!(item, Item::Keyframe(_)));
            if sequence > left {
                session.send_as(sequence, item).await?;
            }
        }
    }
    let report = session.finish().await?;
    if let Ok(progress) = Arc::try_unwrap(progress).map(Mutex::into_inner) {
        progress.finish();
    }
    Ok(report)
}

/// Optimizes the whole map.
async fn optimize(client: &Client, map_id: &str) -> Result<v1::OptimizeMapResult, ClientError> {
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
    result.await
}

/// Keyframes a second: above 0.
fn rate(text: &str) -> Result<f64, String> {
    number(text, "it must be a number above 0", |&rate| rate > 0.0 && f64::is_finite(rate))
}

/// Seconds, at least 0.
fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().ok().and_then(|s| Duration::try_from_secs_f64(s).ok());
    seconds.ok_or_else(|| "it must be a number of seconds, at least 0".to_owned())
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
