//! What docs/reliability.md promises in numbers: durable ingest, many maps at once, restart, memory.
//!
//! `cargo bench --bench reliability -- ingest|maps|restart|memory [OPTIONS] [--folder DIR]`
//!
//! The server is the `covis` program in a process of its own, on a loopback port, with its data
//! below DIR (the system's temporary folder by default: name one on the disk that is to be measured).
//! A robot walks a street at 0.3 m a keyframe and sees each landmark in consecutive keyframes;
//! poses and pixels carry noise. Robots and server share the machine.

#![allow(clippy::print_stdout, reason = "a bench shows what it measured")]

mod server;
#[path = "../street/mod.rs"]
mod street;
#[path = "../timing/mod.rs"]
mod timing;

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use anyhow::Context;
use clap::{Parser, Subcommand};
use covis::client::Client;
use covis::wire::v1;

use crate::server::{Samples, Server, walk};
use crate::street::{Street, Waits, lock, print_row, send, watch};

/// Measures a durable server.
#[derive(Parser)]
struct Args {
    #[command(subcommand)]
    what: What,
    /// Where the server keeps its data.
    #[arg(long, global = true, value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Observations a keyframe.
    #[arg(long, global = true, default_value_t = 200)]
    observations: usize,
    /// Given by cargo.
    #[arg(long, hide = true, global = true)]
    bench: bool,
}

#[derive(Clone, Subcommand)]
enum What {
    /// Durable keyframes a second of one client, local bundle adjustment off.
    Ingest {
        #[arg(long, default_value_t = 20_000)]
        keyframes: i64,
    },
    /// Waits of several robots at a fixed rate, local bundle adjustment on.
    Maps {
        #[arg(long, default_value_t = 16)]
        maps: usize,
        #[arg(long, default_value_t = 2.0)]
        hz: f64,
        #[arg(long, default_value_t = 120)]
        keyframes: i64,
    },
    /// From the start of the program to SERVING, the server before it killed.
    Restart {
        #[arg(long, default_value_t = 10_000)]
        keyframes: i64,
        /// Landmarks that a keyframe sees first.
        #[arg(long, default_value_t = 100)]
        fresh: usize,
    },
    /// Resident memory while a bounded map takes keyframe after keyframe.
    Memory {
        #[arg(long, default_value_t = 1_000_000)]
        keyframes: i64,
        /// Keyframes that the map may hold.
        #[arg(long, default_value_t = 1_000)]
        most: i64,
    },
}

#[tokio::main]
async fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let folder = args.folder.clone().unwrap_or_else(std::env::temp_dir);
    let folder = tempfile::Builder::new().prefix("covis-reliability-").tempdir_in(folder)?;
    let (data, observations) = (folder.path(), args.observations);
    match args.what {
        What::Ingest { keyframes } => ingest(data, keyframes, observations).await,
        What::Maps { maps, hz, keyframes } => many(data, maps, hz, keyframes, observations).await,
        What::Restart { keyframes, fresh } => restart(data, keyframes, fresh, observations).await,
        What::Memory { keyframes, most } => memory(data, keyframes, most, observations).await,
    }
}

async fn ingest(data: &Path, keyframes: i64, observations: usize) -> anyhow::Result<()> {
    let server = Server::start(data)?;
    let client = Client::connect(&server.url).await?;
    let policy = v1::MapPolicy { local_bundle_adjustment: Some(false), ..Default::default() };
    let street = Street::new(observations, observations / 10);
    let waits = Arc::new(Mutex::new(Waits::default()));
    let mut session = street.open(&client, "map", policy, 1024, &waits).await?;
    let start = Instant::now();
    for k in 0..keyframes {
        send(&mut session, &waits, street.keyframe(k)).await?;
    }
    session.finish().await?;
    let seconds = start.elapsed().as_secs_f64();
    let rate = keyframes as f64 / seconds;
    println!(
        "{keyframes} keyframes of {observations} observations, all durable: {rate:.0} a second"
    );
    print_row("send to DURABLE", &mut lock(&waits).durable_s);
    println!("server's memory {} MB", server.resident()? >> 20);
    Ok(())
}

async fn many(
    data: &Path,
    maps: usize,
    hz: f64,
    keyframes: i64,
    observations: usize,
) -> anyhow::Result<()> {
    let server = Server::start(data)?;
    let mut robots = Vec::new();
    for robot in 0..maps {
        let url = server.url.clone();
        let offset = robot as f64 / maps as f64;
        robots.push(tokio::spawn(async move {
            let client = Client::connect(&url).await?;
            let street = Street::new(observations, observations / 10);
            let waits = Arc::new(Mutex::new(Waits::default()));
            let name = format!("map-{robot}");
            let mut session =
                street.open(&client, &name, v1::MapPolicy::default(), 64, &waits).await?;
            let watching = tokio::spawn(watch(client.clone(), name, Arc::clone(&waits)));
            let period = Duration::from_secs_f64(1.0 / hz);
            let first = tokio::time::Instant::now() + period.mul_f64(1.0 + offset);
            let mut clock = tokio::time::interval_at(first, period);
            for k in 0..keyframes {
                clock.tick().await;
                send(&mut session, &waits, street.keyframe(k)).await?;
            }
            let report = session.finish().await?;
            anyhow::ensure!(report.rejected == 0, "{:?}", report.rejections);
            // What was optimized is also told to watchers, a moment later.
            while !lock(&waits).told.is_empty() {
                tokio::time::sleep(Duration::from_millis(1)).await;
            }
            watching.abort();
            let waits = std::mem::take(&mut *lock(&waits));
            anyhow::Ok(waits)
        }));
    }
    let mut all = Waits::default();
    for robot in robots {
        let waits = robot.await??;
        all.durable_s.extend(waits.durable_s);
        all.optimized_s.extend(waits.optimized_s);
        all.corrected_s.extend(waits.corrected_s);
    }
    println!("{maps} maps, {hz} keyframes a second each, {observations} observations a keyframe");
    print_row("send to DURABLE", &mut all.durable_s);
    print_row("send to OPTIMIZED", &mut all.optimized_s);
    print_row("send to correction", &mut all.corrected_s);
    Ok(())
}

async fn restart(
    data: &Path,
    keyframes: i64,
    fresh: usize,
    observations: usize,
) -> anyhow::Result<()> {
    let mut server = Server::start(data)?;
    let client = Client::connect(&server.url).await?;
    let policy = v1::MapPolicy { local_bundle_adjustment: Some(false), ..Default::default() };
    let street = Street::new(observations, fresh);
    let waits = Arc::new(Mutex::new(Waits::default()));
    let mut session = street.open(&client, "map", policy, 1024, &waits).await?;
    for k in 0..keyframes {
        send(&mut session, &waits, street.keyframe(k)).await?;
    }
    session.finish().await?;
    let digests = client.get_map_digests("map").await?;
    server.process.kill()?;
    server.process.wait()?;
    let bytes: u64 = walk(data)?;
    let start = Instant::now();
    let server = Server::start(data)?;
    let seconds = start.elapsed().as_secs_f64();
    let client = Client::connect(&server.url).await?;
    let again = client.get_map_digests("map").await?;
    anyhow::ensure!(digests == again, "{digests:?} became {again:?}");
    let counts = client.get_map("map").await?.counts.unwrap_or_default();
    println!(
        "{} keyframes, {} landmarks, {} observations, {} MB on disk: serving after {seconds:.2} s, \
         the same map",
        counts.keyframe_count,
        counts.landmark_count,
        counts.observation_count,
        bytes >> 20
    );
    println!(
        "server's memory {} MB, its own estimate of the map {} MB",
        server.resident()? >> 20,
        counts.size_bytes >> 20
    );
    Ok(())
}

async fn memory(data: &Path, keyframes: i64, most: i64, observations: usize) -> anyhow::Result<()> {
    let server = Server::start(data)?;
    let client = Client::connect(&server.url).await?;
    let limits = v1::MapLimits { max_keyframe_count: Some(most), ..Default::default() };
    let policy = v1::MapPolicy {
        local_bundle_adjustment: Some(false),
        limits: Some(limits),
        when_full: v1::WhenFull::Marginalize.into(),
        ..Default::default()
    };
    let street = Street::new(observations, observations / 10);
    let waits = Arc::new(Mutex::new(Waits::default()));
    let mut session = street.open(&client, "map", policy, 1024, &waits).await?;
    let start = Instant::now();
    let head = ["keyframes", "mean MB", "most MB", "disk MB", "seconds"];
    println!("{:>10} {:>10} {:>10} {:>10} {:>8}", head[0], head[1], head[2], head[3], head[4]);
    // The items whose digests are remembered are the last limit to be reached.
    let settled = 100_000.min(keyframes / 4);
    let samples = Samples::of(&server);
    let mut windows = Vec::new();
    for k in 0..keyframes {
        send(&mut session, &waits, street.keyframe(k)).await?;
        {
            let mut waits = lock(&waits);
            waits.durable_s.clear();
            waits.received_s.clear();
        }
        if (k + 1) % (keyframes / 40).max(1) == 0 {
            let (mean, most) = samples.take().context("the server's memory")?;
            if k >= settled {
                windows.push((mean, most));
            }
            let (disk, seconds) = (walk(data)? >> 20, start.elapsed().as_secs());
            println!("{:>10} {mean:>10.1} {most:>10.1} {disk:>10} {seconds:>8}", k + 1);
        }
    }
    session.finish().await?;
    let mean = windows.iter().map(|(mean, _)| mean).sum::<f64>() / windows.len() as f64;
    let low = windows.iter().map(|(mean, _)| *mean).fold(f64::INFINITY, f64::min);
    let high = windows.iter().map(|(mean, _)| *mean).fold(0.0, f64::max);
    let most = windows.iter().map(|(_, most)| *most).fold(0.0, f64::max);
    println!(
        "after {settled} keyframes: mean {mean:.1} MB, windows' means within {:.1} %, \
         the highest moment {:.1} % above the mean",
        100.0 * (high - low) / low,
        100.0 * (most - mean) / mean,
    );
    let counts = client.get_map("map").await?.counts.unwrap_or_default();
    println!("{counts:?}");
    Ok(())
}
