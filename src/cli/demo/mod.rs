//! `covis demo`: a whole session on a synthetic scene with known truth, server included.
//!
//! An RGB-D camera walks a little more than once around a room; its odometry drifts. A frontend
//! (`frontend`) streams what it sees through [`crate::client`] to a server in this process, closes
//! the loop when it meets it and follows the corrections. The error is the APE of
//! [`crate::evaluation`]. In lock-step, so that every run prints the same numbers.

mod frontend;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::{Context, bail};
use covis_solvers::io::trajectory::Trajectory;
use covis_solvers::testing::{Scene, SceneOptions};
use fs_err as fs;
use tokio::net::TcpListener;

use super::config::Config;
use super::output::print;
use super::serve::server_config;
use crate::client::Client;
use crate::evaluation::{Evaluation, ape};
use crate::service::Server;
use crate::wire::geometry;
use crate::wire::v1;

/// The demo's map.
const MAP: &str = "demo";
/// The demo's frontend.
const CLIENT: &str = "walker";
/// How far apart timestamps may be that belong together, in seconds.
const MAX_TIME_DIFFERENCE_S: f64 = 0.01;

/// Runs a whole session on a synthetic scene.
#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folder for the map and the trajectories; made when it does not exist.
    #[arg(long, value_name = "FOLDER", default_value = "covis-demo")]
    out: PathBuf,
    /// Keyframes of the walk.
    #[arg(long, value_name = "N", default_value_t = 120, value_parser = clap::value_parser!(u16).range(10..=2000))]
    keyframes: u16,
    /// Seed of all noise.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

/// Runs a whole session on a synthetic scene.
///
/// # Errors
/// A folder that cannot be written, a server that does not start, an item that was refused.
pub fn run(args: Args, config: &Config) -> anyhow::Result<ExitCode> {
    // Seen now rather than after the walk.
    fs::create_dir_all(&args.out)?;
    let runtime = tokio::runtime::Runtime::new().context("the async runtime")?;
    runtime.block_on(session(&args, config))
}

async fn session(args: &Args, config: &Config) -> anyhow::Result<ExitCode> {
    let keyframes = usize::from(args.keyframes);
    let options = SceneOptions { keyframes, seed: args.seed, ..SceneOptions::default() };
    let scene = Scene::generate(&options);
    print(introduction(&scene))?;

    let listener = TcpListener::bind("127.0.0.1:0").await.context("no free loopback port")?;
    let server = Server::start(listener, server_config(config)).await?;
    let url = format!("http://{}", server.local_addr());
    print(format_args!("Server   covis serves on {url} (in this process)"))?;
    let client = Client::connect(&url).await?;
    client.create_map(MAP, None).await?;

    let walk = frontend::walk(&client, &scene).await?;
    print(format_args!(
        "Stream   {} items sent, {} acknowledged, {} rejected; {} solves on the way, {} of them for \
         loop closures",
        walk.report.sent,
        walk.report.acknowledged,
        walk.report.rejected,
        walk.report.optimized,
        walk.closures
    ))?;
    if let Some(refused) = walk.report.rejections.first() {
        bail!("item {} was refused: {:?}", refused.sequence, refused.violations);
    }
    print(optimize(&client).await?)?;

    let truth = trajectory(&scene, &scene.truth);
    let odometry = trajectory(&scene, &scene.odometry);
    let optimized = optimized(&client).await?;
    let before = ape(&truth, &odometry, MAX_TIME_DIFFERENCE_S)?;
    let after = ape(&truth, &optimized, MAX_TIME_DIFFERENCE_S)?;
    print(errors(&before, &after))?;

    truth.write(&args.out.join("truth.tum"))?;
    odometry.write(&args.out.join("odometry.tum"))?;
    optimized.write(&args.out.join("optimized.tum"))?;
    let export = client.export_map(MAP, v1::MapFormat::Ply).await?;
    super::map::write(export, &args.out.join("map.ply")).await?;
    print(ending(&args.out))?;
    drop(client);
    server.shutdown().await;
    Ok(ExitCode::SUCCESS)
}

fn introduction(scene: &Scene) -> String {
    let observations: usize = scene.observations.iter().map(Vec::len).sum();
    format!(
        "A camera with depth walks around a room a little more than once. Its odometry drifts;\n\
         covis gets what it sees, keyframe by keyframe, and sends back where it really was.\n\n\
         Scene    {} keyframes, {} landmarks, {observations} noisy observations, {} loop closures",
        scene.truth.len(),
        scene.landmarks.len(),
        scene.loop_closures.len()
    )
}

/// Optimizes the whole map and says what came of it.
async fn optimize(client: &Client) -> anyhow::Result<String> {
    let request =
        v1::OptimizeMapRequest { map_id: MAP.to_owned(), ..v1::OptimizeMapRequest::default() };
    let result = client.optimize_map(request, |_row| {}).await?;
    let summary = result.summary.context("OptimizeMap answered without a summary")?;
    Ok(format!(
        "Optimize whole map: cost {:.1} to {:.1} in {} iterations ({:.2} s), {}",
        summary.initial_cost,
        summary.final_cost,
        summary.iteration_count,
        summary.solve_duration_us as f64 * 1e-6,
        summary.description
    ))
}

fn trajectory(scene: &Scene, poses: &[covis_solvers::geometry::Se3]) -> Trajectory {
    let mut trajectory = Trajectory::default();
    for (&time, pose) in scene.timestamps_s.iter().zip(poses) {
        trajectory.push(time, *pose);
    }
    trajectory
}

/// The server's trajectory.
async fn optimized(client: &Client) -> anyhow::Result<Trajectory> {
    let mut trajectory = Trajectory::default();
    for pose in client.trajectory(MAP, Some(CLIENT)).await?.poses {
        let world_from_camera = pose.world_from_camera.as_ref().and_then(geometry::se3);
        let (Some(time), Some(world_from_camera)) = (pose.capture_time, world_from_camera) else {
            bail!("the server answered a keyframe without time or pose");
        };
        let seconds = time.seconds as f64 + f64::from(time.nanos) * 1e-9;
        trajectory.push(seconds, world_from_camera);
    }
    Ok(trajectory)
}

fn errors(before: &Evaluation, after: &Evaluation) -> String {
    let row = |name: &str, e: &Evaluation| {
        let (t, r) = (&e.translation_m, &e.angle_deg);
        format!(
            "{name:>10}  {:>10.1} mm  {:>10.1} mm  {:>12.3} deg",
            t.rmse * 1e3,
            t.max * 1e3,
            r.rmse
        )
    };
    let factor = before.translation_m.rmse / after.translation_m.rmse.max(f64::MIN_POSITIVE);
    format!(
        "\nTrajectory error (APE after SE(3) alignment)\n\
         {:>10}  {:>13}  {:>13}  {:>16}\n{}\n{}\n{:>10}  {factor:.0} times closer to the truth",
        "",
        "rmse",
        "largest",
        "rotation rmse",
        row("odometry", before),
        row("covis", after),
        ""
    )
}

fn ending(out: &Path) -> String {
    let folder = out.display();
    format!(
        "\nWritten to {folder}/\n\
         \x20 map.ply         landmarks and trajectory, for MeshLab, CloudCompare or Open3D\n\
         \x20 truth.tum       where the camera was\n\
         \x20 odometry.tum    where its odometry thought it was\n\
         \x20 optimized.tum   where covis says it was\n\n\
         Next: compare them yourself\n\
         \x20 cargo run --release -- eval ape {folder}/truth.tum {folder}/optimized.tum\n\
         or start a server of your own and send it something\n\
         \x20 cargo run --release -- serve\n\
         \x20 cargo run --release --example stream_keyframes"
    )
}
