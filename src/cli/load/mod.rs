//! `covis load`: several maps at once, each with a client that sends keyframes at a fixed rate; measures how
//! long acks and corrections take.
//!
//! Keyframes are those of [`crate::frontend::synthetic::corridor`]. The maps have unique names and are
//! deleted at the end, also after a failure or an interrupt; it never touches an existing map. A correction
//! is measured to its OPTIMIZED ack.

pub mod robot;

use std::hash::{BuildHasher, RandomState};
use std::time::Duration;

use anyhow::{Context, anyhow, ensure};
use serde::Serialize;
use tokio::sync::watch;
use tokio::task::JoinSet;
use tonic::Code;

use self::robot::{LandmarkMeasurement, Schedule, Waits, drive, keyframe};
use super::choices::number;
use super::config::Config;
use super::connect::connect;
use super::output::{show, succeed_if};
use super::progress::Progress;
use super::signals::Signals;
use crate::client::{Client, ClientError, IngestReport};
use crate::frontend::mapping::messages;
use crate::frontend::synthetic::corridor::{Corridor, CorridorView};
use crate::wire::v1;

/// What the names of the maps begin with.
const PREFIX: &str = "covis-load";

/// Arguments of `covis load`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// Maps, each with its own client.
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    maps: u32,
    /// Keyframes per second of each client.
    #[arg(long, value_name = "HZ", default_value_t = 2.0, value_parser = rate)]
    rate: f64,
    /// How long to send.
    #[arg(long, value_name = "SECONDS", default_value_t = 10.0, value_parser = rate)]
    seconds: f64,
    /// Observations of each keyframe.
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u32).range(10..=10_000))]
    observations: u32,
    /// Maps on one connection.
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(1..))]
    maps_per_connection: u32,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
}

/// A number above 0.
fn rate(text: &str) -> Result<f64, String> {
    number(text, "it must be a number above 0", |&rate| rate > 0.0 && rate < 1e6)
}

/// The object of `--json`.
#[derive(Debug, Serialize)]
struct Document {
    maps: u32,
    rate_hz: f64,
    seconds: f64,
    observations: u32,
    /// Keyframes that were handed over.
    sent: usize,
    /// Items that the server refused.
    refused: u64,
    /// Keyframes that left more than a period late, because the server or the link held the stream.
    late: usize,
    /// Keyframes without a correction at the end.
    unanswered: usize,
    failed_solves: u64,
    reconnects: u64,
    received: Quantiles,
    /// Nothing where the server keeps maps in memory.
    durable: Quantiles,
    corrected: Quantiles,
    solve: Quantiles,
}

/// Of some durations.
#[derive(Clone, Copy, Debug, Serialize)]
struct Quantiles {
    count: usize,
    p50_ms: Option<f64>,
    p99_ms: Option<f64>,
    max_ms: Option<f64>,
}

impl Quantiles {
    fn of(mut seconds: Vec<f64>) -> Self {
        seconds.sort_unstable_by(f64::total_cmp);
        let at = |share: f64| {
            let index = (share * seconds.len().saturating_sub(1) as f64).round() as usize;
            seconds.get(index).map(|seconds| (seconds * 1e6).round() / 1e3)
        };
        let [p50_ms, p99_ms, max_ms] = [0.5, 0.99, 1.0].map(at);
        Self { count: seconds.len(), p50_ms, p99_ms, max_ms }
    }
}

/// Loads the server.
/// Fails for a server that is not there, a map that cannot be made or deleted, a session that breaks.
pub(super) fn run(args: &Args, config: &Config) -> anyhow::Result<()> {
    let runtime = tokio::runtime::Runtime::new().context("the async runtime")?;
    runtime.block_on(load(args, config))
}

async fn load(args: &Args, config: &Config) -> anyhow::Result<()> {
    let mut signals = Signals::new().context("signal handlers")?;
    let connections = args.maps.div_ceil(args.maps_per_connection);
    let mut clients = Vec::new();
    for _ in 0..connections {
        clients.push(connect(config).await?);
    }
    let mark = RandomState::new().hash_one(0_u8) >> 32;
    let mut maps: Vec<String> = Vec::new();
    let (stop, stopped) = watch::channel(false);
    let mut interrupted = None;
    let outcome = {
        let work = async {
            make(args, &clients[0], mark, &mut maps, &stopped).await?;
            send(args, &clients, &maps, stopped.clone()).await
        };
        tokio::pin!(work);
        loop {
            tokio::select! {
                outcome = &mut work => break outcome,
                signal = signals.next(), if interrupted.is_none() => {
                    interrupted = Some(signal);
                    stop.send_replace(true);
                }
            }
        }
    };
    let deleted = tokio::select! {
        deleted = delete(&clients[0], &maps) => deleted,
        signal = signals.next() => Err(anyhow!("{signal}; maps {PREFIX}-{mark:08x}-N are left")),
    };
    if let Some(signal) = interrupted {
        deleted?;
        return Err(anyhow!("{signal}; the maps of the load are deleted"));
    }
    let (waits, reports) = outcome?;
    deleted?;
    let sum = |of: fn(&IngestReport) -> u64| reports.iter().map(of).sum();
    let document = Document {
        maps: args.maps,
        rate_hz: args.rate,
        seconds: args.seconds,
        observations: args.observations,
        sent: waits.sent,
        refused: sum(|report| report.rejected),
        late: waits.late,
        unanswered: waits.optimized.unanswered(),
        failed_solves: sum(|report| report.failed_solves),
        reconnects: sum(|report| report.reconnects),
        received: Quantiles::of(waits.received.waits_s),
        durable: Quantiles::of(waits.durable.waits_s),
        corrected: Quantiles::of(waits.optimized.waits_s),
        solve: Quantiles::of(waits.solves_s),
    };
    show(args.json, &document, || table(&document))?;
    succeed_if(document.refused == 0 && document.unanswered == 0)
}

/// Makes the maps, and notes the name of each that may be there after it.
async fn make(
    args: &Args,
    client: &Client,
    mark: u64,
    maps: &mut Vec<String>,
    stop: &watch::Receiver<bool>,
) -> anyhow::Result<()> {
    for number in 0..args.maps {
        ensure!(!*stop.borrow(), "interrupted");
        let name = format!("{PREFIX}-{mark:08x}-{number}");
        maps.push(name.clone());
        if let Err(error) = client.create_map(&name, None).await {
            if error.code() == Some(Code::AlreadyExists) {
                // Somebody else's, however unlikely: it is not for this load to delete.
                maps.pop();
            }
            return Err(anyhow::Error::new(error).context(format!("map {name}")));
        }
    }
    Ok(())
}

/// Lets every robot send, and waits for all.
async fn send(
    args: &Args,
    clients: &[Client],
    maps: &[String],
    stop: watch::Receiver<bool>,
) -> anyhow::Result<(Waits, Vec<IngestReport>)> {
    let period = Duration::from_secs_f64(1.0 / args.rate);
    let count = (args.rate * args.seconds).ceil() as usize;
    let mut robots = JoinSet::new();
    for (number, map) in (0_u32..).zip(maps.iter().cloned()) {
        let client = clients[(number / args.maps_per_connection) as usize].clone();
        let schedule = Schedule {
            period,
            // Robots are not synchronized with each other.
            offset: period.mul_f64(f64::from(number) / f64::from(args.maps)),
            stop: stop.clone(),
        };
        let views = Corridor::new(u64::from(number), args.observations).take(count);
        let seconds = 1.0 / args.rate;
        let keyframes = views.enumerate().map(move |(id, view)| message(id, seconds, &view));
        let (camera, [width, height]) = Corridor::camera();
        let camera = messages::camera(0, &camera, (width, height));
        robots.spawn(async move { drive(&client, &map, camera, keyframes, schedule).await });
    }
    let mut progress = Progress::new("clients that are done", u64::from(args.maps));
    let (mut waits, mut reports) = (Waits::default(), Vec::new());
    while let Some(robot) = robots.join_next().await {
        let (more, report) = robot.context("a client")??;
        waits.add(more);
        reports.push(report);
        progress.advance(1);
    }
    progress.finish();
    Ok((waits, reports))
}

/// The keyframe of a view.
fn message(id: usize, period_s: f64, view: &CorridorView) -> v1::Keyframe {
    let (camera, _) = Corridor::camera();
    let measured: Vec<LandmarkMeasurement> = view
        .sightings
        .iter()
        .map(|s| {
            let ray = camera.unproject(&s.pixel).filter(|_| s.is_new);
            let in_odom = |ray| view.odom_from_camera.transform(&ray);
            LandmarkMeasurement {
                landmark: s.landmark as i64,
                pixel: (s.pixel, Corridor::sigma_px()),
                depth_m: Some((s.depth_m, s.sigma_depth_m)),
                is_new: s.is_new,
                point_in_world: ray.map(|ray| in_odom(ray * (s.depth_m / ray.z))),
            }
        })
        .collect();
    keyframe(id as i64, id as f64 * period_s, &view.odom_from_camera, &measured)
}

/// Deletes what was made; goes on where one cannot be deleted, and then fails with the first reason.
async fn delete(client: &Client, maps: &[String]) -> anyhow::Result<()> {
    let mut failure: Option<(ClientError, &str)> = None;
    for map in maps {
        if let Err(error) = client.delete_map(map).await
            && error.code() != Some(Code::NotFound)
        {
            failure.get_or_insert((error, map));
        }
    }
    match failure {
        Some((error, map)) => Err(anyhow::Error::new(error)
            .context(format!("map {map} of the load is left; `covis map delete` removes it"))),
        None => Ok(()),
    }
}

fn table(document: &Document) -> String {
    let Document { maps, rate_hz, seconds, observations, sent, .. } = document;
    let mut text = format!(
        "{maps} maps, {rate_hz} keyframes/s of {observations} observations each, {seconds} s\n\
         {sent} keyframes sent: {} refused, {} late, {} without a correction; {} solves failed, \
         {} reconnects\n\n{:>24} {:>8} {:>10} {:>10} {:>10}",
        document.refused,
        document.late,
        document.unanswered,
        document.failed_solves,
        document.reconnects,
        "milliseconds",
        "count",
        "p50",
        "p99",
        "max"
    );
    for (name, row) in [
        ("send to RECEIVED", document.received),
        ("send to DURABLE", document.durable),
        ("send to correction", document.corrected),
        ("local bundle adjustment", document.solve),
    ] {
        let cell = |ms: Option<f64>| ms.map_or("-".to_owned(), |ms| format!("{ms:.1}"));
        let [p50, p99, max] = [row.p50_ms, row.p99_ms, row.max_ms].map(cell);
        text.push_str(&format!("\n{name:>24} {:>8} {p50:>10} {p99:>10} {max:>10}", row.count));
    }
    text
}
