//! How long a watcher waits for the trajectory that a loop closure corrects, in large maps.
//!
//! `cargo bench --bench loops -- [--keyframes N] [--closures N] [--seed N]`
//!
//! A robot goes twice around a square with noisy odometry and streams its keyframes; then closures of
//! its second lap come one by one. A wait is from the call of `send` to the delta that holds the
//! corrected poses of all keyframes, in a client that watches over a loopback port: transport, journal,
//! measurements of pairs, judgment, solve, event, delta. Some closures are false.

#![allow(clippy::print_stdout, reason = "a bench shows what it measured")]

mod timing;

use std::time::Instant;

use clap::Parser;
use covis::client::{Client, SessionOptions, WatchOptions};
use covis::service::{Server, ServerConfig};
use covis::wire::v1;
use covis_solvers::geometry::{LieGroup, Se3, So3};
use covis_solvers::testing::random::{element, perturbed, seeded};
use nalgebra::{Vector3, Vector6};
use tokio::sync::mpsc;

use crate::timing::milliseconds;

/// Waits for corrected trajectories.
#[derive(Clone, Parser)]
struct Args {
    /// Keyframes of the two laps.
    #[arg(long, default_value_t = 2500)]
    keyframes: usize,
    /// Closures.
    #[arg(long, default_value_t = 100)]
    closures: usize,
    /// Every so many-th is false.
    #[arg(long, default_value_t = 10)]
    false_every: usize,
    /// Of the noise.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Given by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

/// Standard deviations of a step of odometry, a meter long: 1 cm and 0.1°.
const STEP: [f64; 6] = [0.01, 0.01, 0.01, 0.0017, 0.0017, 0.0017];
/// Of a closure: 5 cm and 0.6°.
const CLOSURE: [f64; 6] = [0.05, 0.05, 0.05, 0.01, 0.01, 0.01];

#[tokio::main]
async fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let mut rng = seeded(args.seed);
    let lap = args.keyframes / 2;
    let turn = So3::exp(&Vector3::new(0.0, std::f64::consts::FRAC_PI_2, 0.0));
    let ahead = Se3::new(So3::identity(), Vector3::new(0.0, 0.0, 1.0));
    let corner = Se3::new(turn, Vector3::new(0.0, 0.0, 1.0));
    let mut truth = vec![Se3::identity()];
    let mut odometry = truth.clone();
    for k in 1..args.keyframes {
        let step = if k % (lap / 4).max(1) == 0 { corner } else { ahead };
        truth.push(truth[k - 1].compose(&step));
        let noisy: Se3 = perturbed(&mut rng, &step, &Vector6::from(STEP));
        odometry.push(odometry[k - 1].compose(&noisy));
    }

    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await?;
    let server = Server::start(listener, ServerConfig::default()).await?;
    let client = Client::connect(&format!("http://{}", server.local_addr())).await?;
    client.create_map("loop", None).await?;
    let (acks, mut optimized) = mpsc::unbounded_channel();
    let options = SessionOptions::default().on_ack(move |ack| {
        if ack.status() == v1::AckStatus::Optimized {
            let _closed = acks.send(ack.clone());
        }
    });
    let mut session = client.ingest("loop", "robot", options).await?;
    for (k, pose) in odometry.iter().enumerate() {
        session.send(keyframe(k, pose)).await?;
    }
    let mut watch = client.watch("loop", WatchOptions::default()).await?;
    while watch.next().await?.keyframes.len() < args.keyframes {}

    let (mut waits, mut solves, mut last) = (Vec::new(), Vec::new(), None);
    for count in 0..args.closures {
        let i = (count * 7919) % (lap - 20);
        let j = (i + lap).min(args.keyframes - 1);
        let exact = truth[i].inverse().compose(&truth[j]);
        let mut measured = perturbed(&mut rng, &exact, &Vector6::from(CLOSURE));
        if args.false_every > 0 && count % args.false_every == args.false_every - 1 {
            measured = measured.compose(&element(&mut rng, 3.0));
        }
        let sent = Instant::now();
        let sequence = session.next_sequence();
        session.send_as(sequence, closure(count, i, j, &measured)).await?;
        let ack = loop {
            let ack = optimized.recv().await;
            let ack = ack.ok_or_else(|| anyhow::anyhow!("the session ended"))?;
            if ack.sequence >= sequence {
                break ack;
            }
        };
        while watch.mirror().revision < ack.revision {
            watch.next().await?;
        }
        waits.push(sent.elapsed().as_secs_f64());
        if let Some(summary) = ack.solve_summary {
            solves.push(summary.solve_duration_us as f64 * 1e-6);
            last = summary.closures;
        }
    }
    session.finish().await?;
    println!("{} keyframes, {} closures", args.keyframes, args.closures);
    println!("{:>32} {:>8} {:>8} {:>8}", "milliseconds", "p50", "p99", "max");
    for (name, seconds) in [("send to corrected trajectory", &mut waits), ("solve", &mut solves)] {
        let [p50, p99, max] = milliseconds(seconds);
        println!("{name:>32} {p50:>8.2} {p99:>8.2} {max:>8.2}");
    }
    if let Some(found) = last {
        println!(
            "{} of {} closures switched off, {} of them provisional",
            found.switched_off_count, found.closure_count, found.provisional_count
        );
    }
    Ok(())
}

fn keyframe(k: usize, pose: &Se3) -> v1::Keyframe {
    v1::Keyframe {
        id: k as i64,
        capture_time: Some(prost_types::Timestamp { seconds: k as i64, nanos: 0 }),
        world_from_camera: Some(rigid(pose)),
        ..v1::Keyframe::default()
    }
}

fn closure(id: usize, i: usize, j: usize, measured: &Se3) -> v1::RelativePoseConstraint {
    let keyframe =
        |id: usize| Some(v1::KeyframeRef { id: id as i64, ..v1::KeyframeRef::default() });
    let row = |k: usize| {
        let mut row = vec![0.0; 6 - k];
        row[0] = CLOSURE[k].powi(-2);
        row
    };
    let upper_triangle = (0..6).flat_map(row).collect();
    v1::RelativePoseConstraint {
        id: id as i64,
        keyframe_i: keyframe(i),
        keyframe_j: keyframe(j),
        keyframe_i_from_keyframe_j: Some(rigid(measured)),
        information: Some(v1::InformationMatrix6 { upper_triangle }),
        kind: v1::ConstraintKind::LoopClosure.into(),
        ..v1::RelativePoseConstraint::default()
    }
}

fn rigid(transform: &Se3) -> v1::RigidTransform {
    let (q, t) = (transform.rotation.quaternion(), transform.translation);
    v1::RigidTransform {
        translation: Some(v1::Vector3 { x: t.x, y: t.y, z: t.z }),
        rotation: Some(v1::Quaternion { x: q.i, y: q.j, z: q.k, w: q.w }),
    }
}
