//! A robot and a server over links like those of the field: 5G, 802.11p, and a bad one.
//!
//! `cargo bench --bench links -- [5g|80211p|bad|loopback]... [--minutes M] [--compress] [--in-process]`
//! `cargo bench --bench links -- size`
//!
//! The server and the robot are processes in network namespaces of their own, joined by two TUN devices
//! and a relay that delays, drops and limits IP packets (relay.c), so that TCP is the real one. That
//! takes root, `ip` (iproute2) and /dev/net/tun; where something is missing the bench says so and takes a
//! relay within this process, in which nothing is lost and losses are waits. Told for each profile:
//! keyframes that are missing, doubled or out of order, waits from send to RECEIVED, DURABLE and
//! correction, the rate, and bytes a keyframe on the wire with all headers. `size` tells what a
//! compressed keyframe costs without a link.

#![allow(clippy::print_stdout, reason = "a bench shows what it measured")]

mod relay;
mod robot;
mod spaces;
#[path = "../street/mod.rs"]
mod street;
#[path = "../timing/mod.rs"]
mod timing;

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::Ordering;

use anyhow::Context;
use clap::{Parser, ValueEnum};

use crate::robot::Walk;
use crate::spaces::{Passed, Spaces};

/// Measures ingest over links.
#[derive(Parser)]
struct Args {
    /// Which links; 5g, 80211p and bad where none is named.
    links: Vec<Kind>,
    /// How long each.
    #[arg(long, default_value_t = 1.0)]
    minutes: f64,
    /// Observations a keyframe.
    #[arg(long, default_value_t = 400)]
    observations: usize,
    /// Messages travel compressed.
    #[arg(long)]
    compress: bool,
    /// The relay within this process, where namespaces are permitted too.
    #[arg(long)]
    in_process: bool,
    /// Of losses and delays.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Where the server keeps its data (the system's temporary folder).
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
    /// The robot's process: where the server is.
    #[arg(long, hide = true)]
    robot: Option<String>,
    /// Given by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Kind {
    /// 10 ms ± 3, 1 % loss, 50 Mbit/s, a gap of 2 s every 30 s.
    #[value(name = "5g")]
    FiveG,
    /// 50 ms ± 20, 1 % loss, 3 Mbit/s, a gap of 10 s once a minute.
    #[value(name = "80211p")]
    Wave,
    /// As 80211p with 10 % loss, one keyframe a second.
    Bad,
    /// No delay and no loss.
    Loopback,
    /// Bytes and time of a keyframe, compressed and not, without a link.
    Size,
}

/// A link, the same in both directions.
#[derive(Clone, Debug)]
pub(crate) struct Profile {
    pub(crate) delay_ms: f64,
    pub(crate) jitter_ms: f64,
    /// Share of the packets.
    pub(crate) loss: f64,
    pub(crate) mbit: f64,
    /// How long the link is away at the end of each period.
    pub(crate) gap_s: f64,
    pub(crate) period_s: f64,
    hz: f64,
}

impl Kind {
    fn profile(self) -> Profile {
        let wave = Profile {
            delay_ms: 50.0,
            jitter_ms: 20.0,
            loss: 0.01,
            mbit: 3.0,
            gap_s: 10.0,
            period_s: 60.0,
            hz: 5.0,
        };
        match self {
            Self::FiveG => Profile {
                delay_ms: 10.0,
                jitter_ms: 3.0,
                mbit: 50.0,
                gap_s: 2.0,
                period_s: 30.0,
                ..wave
            },
            Self::Wave => wave,
            Self::Bad => Profile { loss: 0.1, hz: 1.0, ..wave },
            Self::Loopback | Self::Size => Profile {
                delay_ms: 0.0,
                jitter_ms: 0.0,
                loss: 0.0,
                mbit: 10_000.0,
                gap_s: 0.0,
                ..wave
            },
        }
    }
}

fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    let runtime = tokio::runtime::Runtime::new()?;
    if let Some(url) = &args.robot {
        let hz = args.links.first().map_or(5.0, |kind| kind.profile().hz);
        return runtime.block_on(walk(&args, hz).run(url));
    }
    let usual = vec![Kind::FiveG, Kind::Wave, Kind::Bad];
    let kinds = if args.links.is_empty() { usual } else { args.links.clone() };
    for kind in kinds {
        if kind == Kind::Size {
            robot::size(args.observations)?;
        } else {
            measure(kind, &args, &runtime)?;
        }
    }
    Ok(())
}

fn walk(args: &Args, hz: f64) -> Walk {
    let Args { minutes, observations, compress, .. } = *args;
    Walk { hz, minutes, observations, compress }
}

fn measure(kind: Kind, args: &Args, runtime: &tokio::runtime::Runtime) -> anyhow::Result<()> {
    let profile = kind.profile();
    let folder = args.folder.clone().unwrap_or_else(std::env::temp_dir);
    let folder = tempfile::Builder::new().prefix("covis-links-").tempdir_in(folder)?;
    println!(
        "{kind:?}: {} ms ± {}, {} % lost, {} Mbit/s, away {} s of {}; {} Hz, {} minutes, compressed: {}",
        profile.delay_ms,
        profile.jitter_ms,
        100.0 * profile.loss,
        profile.mbit,
        profile.gap_s,
        profile.period_s,
        profile.hz,
        args.minutes,
        args.compress
    );
    let spaces = if args.in_process {
        None
    } else {
        let made = Spaces::make(folder.path(), &profile, args.seed);
        made.inspect_err(|e| println!("no network namespaces, a relay in this process: {e:#}")).ok()
    };
    let keyframes = (profile.hz * 60.0 * args.minutes) as u64;
    let [down, up] = match spaces {
        Some(spaces) => {
            let server = spaces.command(0, Path::new(env!("CARGO_BIN_EXE_covis")));
            let server = Server::start(server, &Spaces::listen(), folder.path())?;
            let mut robot = spaces.command(1, &std::env::current_exe()?);
            let name = kind.to_possible_value().context("a profile")?.get_name().to_owned();
            robot.arg(name).args(["--robot", &server.url]);
            robot.args(["--minutes", &args.minutes.to_string()]);
            robot.args(["--observations", &args.observations.to_string()]);
            if args.compress {
                robot.arg("--compress");
            }
            let status = robot.status()?;
            anyhow::ensure!(status.success(), "the robot: {status}");
            drop(server);
            spaces.end()?
        }
        None => {
            let server = Command::new(env!("CARGO_BIN_EXE_covis"));
            let server = Server::start(server, "127.0.0.1:0", folder.path())?;
            let target = server.url.trim_start_matches("http://").parse()?;
            let bytes = runtime.block_on(async {
                let (address, bytes) = relay::relay(target, profile.clone(), args.seed).await?;
                walk(args, profile.hz).run(&format!("http://{address}")).await?;
                anyhow::Ok(bytes)
            })?;
            [0, 1].map(|way| Passed {
                bytes: bytes[way].load(Ordering::Relaxed),
                ..Passed::default()
            })
        }
    };
    for (name, passed) in [("robot to server", up), ("server to robot", down)] {
        println!(
            "{name:>20}: {} bytes a keyframe; {} packets, {} lost, {} more than the queue holds",
            passed.bytes / keyframes.max(1),
            passed.packets,
            passed.lost,
            passed.overflown
        );
    }
    Ok(())
}

/// A server process; dropped, it is killed.
struct Server {
    process: Child,
    url: String,
}

impl Server {
    fn start(mut command: Command, listen: &str, folder: &Path) -> anyhow::Result<Self> {
        command.args(["--log", "error", "serve", "--insecure-plain-text", "--listen", listen]);
        command.arg("--data-dir").arg(folder.join("maps"));
        let process = command.stdout(Stdio::piped()).spawn()?;
        // From here on the process ends with the value, also where an error is returned.
        let mut server = Self { process, url: String::new() };
        let output = server.process.stdout.take().context("the server's output")?;
        let mut line = String::new();
        BufReader::new(output).read_line(&mut line)?;
        let url = line.trim().strip_prefix("listening on ").context("the server's address")?;
        url.clone_into(&mut server.url);
        Ok(server)
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        // What is still running has nothing to finish: the data are thrown away.
        let _ended = self.process.kill();
        let _ended = self.process.wait();
    }
}
