//! What a robot and the server's memory notice while somebody means harm.
//!
//! `cargo bench --bench attacks -- [NAME]... [--minutes M] [--folder DIR] [--config FILE]`
//!
//! For each name a server with tokens in a process of its own, a robot that streams at 5 Hz into a map
//! with a history, and one attack (`readers` and `all` are several at once). Without a name all of them,
//! one after the other, and then `all`. Told for each: how many calls the attack got answered and
//! refused, the server's memory before and at its highest, the robot's waits from send to RECEIVED and to
//! DURABLE, and how long new connections with a token took. Everything shares the machine. The
//! attackers, who would have machines of their own, have threads of the lowest priority, so that it is
//! the server's work for them and not their own that the robot notices. It ends by itself and stops what
//! it started.

#![allow(clippy::print_stdout, reason = "a bench shows what it measured")]

mod maps;
mod server;
mod solves;
mod strangers;
#[path = "../street/mod.rs"]
mod street;
#[path = "../timing/mod.rs"]
mod timing;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use clap::{Parser, ValueEnum};
use covis::client::Client;
use covis::wire::v1;
use tokio::runtime::{Handle, Runtime};
use tokio::task::JoinSet;

use crate::server::{Server, connect};
use crate::street::{Street, Waits, lock, send};
use crate::timing::milliseconds;

/// Measures a server under attack.
#[derive(Parser)]
struct Args {
    /// Which attacks; all of them one by one, then at once, where none is named.
    attacks: Vec<Attack>,
    /// How long each goes on.
    #[arg(long, default_value_t = 1.0)]
    minutes: f64,
    /// Where servers keep their data (the system's temporary folder).
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Keyframes that the robot's map and the large one have before the attack.
    #[arg(long, default_value_t = 400)]
    history: i64,
    /// Connections of strangers.
    #[arg(long, default_value_t = 10_000)]
    strangers: usize,
    /// The server's configuration file, with other limits for instance (none).
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Given by cargo.
    #[arg(long, hide = true)]
    bench: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Attack {
    /// Nothing: what to compare with.
    None,
    /// Creations and deletions that are cut off.
    Cuts,
    /// 335 kB of SolveBundle with DENSE_SCHUR and a deadline of 0.5 s.
    Dense,
    /// A pose graph whose factorization fills up.
    Fill,
    /// Connections that say nothing.
    Strangers,
    /// Messages to Health of which one half is sent.
    HalfSent,
    /// Four readers that resume a map from revision 1, again and again.
    Watchers,
    /// 20 exports of a large map that nobody reads.
    Exports,
    /// One optimization of a large map after the other.
    Solve,
    /// 150,000 cameras.
    Cameras,
    /// One landmark that 4,000 keyframes see.
    Landmark,
    /// Constraints without end.
    Constraints,
    /// Calls with wrong tokens from 8 connections.
    Logins,
    /// Watchers, exports and a solve at once.
    Readers,
    /// All at once.
    All,
}

impl Attack {
    fn parts(self) -> Vec<Self> {
        match self {
            Self::None => Vec::new(),
            Self::Readers => vec![Self::Watchers, Self::Exports, Self::Solve],
            Self::All => Self::value_variants()
                .iter()
                .copied()
                .filter(|attack| !matches!(attack, Self::None | Self::Readers | Self::All))
                .collect(),
            Self::Cuts
            | Self::Dense
            | Self::Fill
            | Self::Strangers
            | Self::HalfSent
            | Self::Watchers
            | Self::Exports
            | Self::Solve
            | Self::Cameras
            | Self::Landmark
            | Self::Constraints
            | Self::Logins => vec![self],
        }
    }
}

/// What calls of an attack came to.
#[derive(Debug, Default)]
pub(crate) struct Tally {
    answered: AtomicU64,
    refused: AtomicU64,
    /// The first refusal.
    reason: Mutex<Option<String>>,
}

impl Tally {
    pub(crate) fn count<T>(&self, answer: &Result<T, tonic::Status>) -> bool {
        match answer {
            Ok(_) => self.answer(),
            Err(status) => self.refuse(&format!("{:?}: {}", status.code(), status.message())),
        }
        answer.is_ok()
    }

    pub(crate) fn answer(&self) {
        self.answered.fetch_add(1, Ordering::Relaxed);
    }

    pub(crate) fn refuse(&self, reason: &str) {
        self.refused.fetch_add(1, Ordering::Relaxed);
        let mut first = lock(&self.reason);
        if first.is_none() {
            *first = Some(reason.chars().take(100).collect());
        }
    }
}

/// What an attack is led against.
#[derive(Clone, Debug)]
pub(crate) struct Target {
    pub(crate) url: String,
    pub(crate) tally: Arc<Tally>,
    /// Connections of those who say nothing.
    pub(crate) strangers: usize,
}

#[tokio::main]
async fn main() -> anyhow::Result<()> {
    let args = Args::parse();
    if let Some(ended) = with_more_descriptors()? {
        std::process::exit(ended);
    }
    let attacks = if args.attacks.is_empty() {
        Attack::value_variants().to_vec()
    } else {
        args.attacks.clone()
    };
    let folder = args.folder.clone().unwrap_or_else(std::env::temp_dir);
    println!(
        "{} minutes each; robot at 5 Hz, 400 observations a keyframe, {} keyframes before; times in \
         ms, memory in MB",
        args.minutes, args.history
    );
    println!(
        "{:>12} {:>9} {:>9} {:>7} {:>7} {:>9} {:>9} {:>9} {:>9} {:>9}",
        "attack",
        "answered",
        "refused",
        "before",
        "peak",
        "recv p50",
        "recv p99",
        "dur p50",
        "dur p99",
        "connect"
    );
    for attack in attacks {
        let data = tempfile::Builder::new().prefix("covis-attacks-").tempdir_in(&folder)?;
        if let Err(error) = measure(attack, &args, data.path()).await {
            println!("{:>12} failed: {error:#}", format!("{attack:?}"));
        }
    }
    Ok(())
}

/// Runs this program again with as many descriptors as it may have; `None` where it is that run.
fn with_more_descriptors() -> anyhow::Result<Option<i32>> {
    const MARK: &str = "COVIS_TEST_DESCRIPTORS";
    if std::env::var_os(MARK).is_some() {
        return Ok(None);
    }
    let mut again = Command::new("sh");
    again.args(["-c", "ulimit -n $(ulimit -Hn); exec \"$0\" \"$@\""]);
    again.arg(std::env::current_exe()?).args(std::env::args_os().skip(1)).env(MARK, "1");
    Ok(Some(again.status()?.code().unwrap_or(1)))
}

async fn measure(attack: Attack, args: &Args, data: &Path) -> anyhow::Result<()> {
    let mut server = Server::start(data, args.config.as_deref())?;
    let robot = server.client("robot").await?;
    let street = Street::new(400, 40);
    let waits = Arc::new(Mutex::new(Waits::default()));
    let mut session = street.open(&robot, "street", v1::MapPolicy::default(), 256, &waits).await?;
    for k in 0..args.history {
        send(&mut session, &waits, street.keyframe(k)).await?;
    }
    let large = fill(&server.client("foe").await?, args.history).await;
    while !lock(&waits).undurable.is_empty() {
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    large?;
    tokio::time::sleep(Duration::from_secs(1)).await;
    *lock(&waits) = Waits::default();
    let (before, _) = server.memory().unwrap_or_default();

    let tally = Arc::new(Tally::default());
    let target =
        Target { url: server.url.clone(), tally: Arc::clone(&tally), strangers: args.strangers };
    let (runtime, mut attackers) = (attackers_runtime()?, JoinSet::new());
    for part in attack.parts() {
        launch(part, &target, &mut attackers, runtime.handle());
    }
    let mut connecting = connect_often(&server.url);
    let mut clock = tokio::time::interval(Duration::from_millis(200));
    let end = Instant::now() + Duration::from_secs_f64(60.0 * args.minutes);
    let (mut k, mut failed) = (args.history, None);
    while Instant::now() < end && failed.is_none() {
        clock.tick().await;
        let sent = send(&mut session, &waits, street.keyframe(k));
        match tokio::time::timeout(end.saturating_duration_since(Instant::now()), sent).await {
            Ok(sent) => failed = sent.err().map(|error| error.to_string()),
            Err(_late) => break,
        }
        k += 1;
    }
    // Waits that have no end yet count for what they are by now.
    let mut waits = std::mem::take(&mut *lock(&waits));
    let open = |open: &std::collections::VecDeque<(i64, Instant)>| {
        open.iter().map(|(_, sent)| sent.elapsed().as_secs_f64()).collect::<Vec<_>>()
    };
    waits.received_s.extend(open(&waits.unreceived));
    waits.durable_s.extend(open(&waits.undurable));
    attackers.abort_all();
    runtime.shutdown_background();
    connecting.tasks.abort_all();
    let ([r50, r99, _], [d50, d99, _]) =
        (milliseconds(&mut waits.received_s), milliseconds(&mut waits.durable_s));
    let [_, _, slowest] = milliseconds(&mut lock(&connecting.seconds));
    let count = |of: &AtomicU64| of.load(Ordering::Relaxed);
    let peak = server.memory().map_or_else(|| "gone".to_owned(), |(_, peak)| peak.to_string());
    println!(
        "{:>12} {:>9} {:>9} {before:>7} {peak:>7} {r50:>9.2} {r99:>9.2} {d50:>9.2} {d99:>9.2} \
         {slowest:>9.0}",
        format!("{attack:?}"),
        count(&tally.answered),
        count(&tally.refused),
    );
    if let Some(reason) = &*lock(&tally.reason) {
        println!("{:>12} refused first: {reason}", "");
    }
    if server.log_lines() > 100 {
        println!("{:>12} {} lines in the log", "", server.log_lines());
    }
    for (what, said) in [("the server ended", server.ended()), ("the robot's session", failed)] {
        if let Some(said) = said {
            println!("{:>12} {what}: {said}", "");
        }
    }
    Ok(())
}

/// Threads of the lowest priority.
fn attackers_runtime() -> std::io::Result<Runtime> {
    let mut builder = tokio::runtime::Builder::new_multi_thread();
    builder.worker_threads(2).enable_all();
    // Linux counts priorities by thread.
    #[cfg(target_os = "linux")]
    builder.on_thread_start(|| {
        let _refused = rustix::process::setpriority_process(None, 19);
    });
    builder.build()
}

fn launch(part: Attack, target: &Target, attackers: &mut JoinSet<()>, on: &Handle) {
    match part {
        Attack::Cuts => drop(attackers.spawn_on(maps::cuts(target.clone()), on)),
        Attack::Dense => drop(attackers.spawn_on(solves::dense(target.clone()), on)),
        Attack::Fill => drop(attackers.spawn_on(solves::fill(target.clone()), on)),
        Attack::Strangers => drop(attackers.spawn_on(strangers::idle(target.clone()), on)),
        Attack::HalfSent => {
            for _ in 0..2 {
                attackers.spawn_on(strangers::half_sent(target.clone()), on);
            }
        }
        Attack::Watchers => {
            for _ in 0..4 {
                attackers.spawn_on(maps::watch_from_one(target.clone()), on);
            }
        }
        Attack::Exports => {
            for _ in 0..20 {
                attackers.spawn_on(maps::unread_export(target.clone()), on);
            }
        }
        Attack::Solve => drop(attackers.spawn_on(solves::whole_map(target.clone()), on)),
        Attack::Cameras => drop(attackers.spawn_on(maps::cameras(target.clone()), on)),
        Attack::Landmark => drop(attackers.spawn_on(maps::one_landmark(target.clone()), on)),
        Attack::Constraints => drop(attackers.spawn_on(maps::constraints(target.clone()), on)),
        Attack::Logins => {
            for _ in 0..8 {
                attackers.spawn_on(strangers::wrong_tokens(target.clone()), on);
            }
        }
        Attack::None | Attack::Readers | Attack::All => {}
    }
}

/// The large map of tenant "foes", local bundle adjustment off.
async fn fill(client: &Client, keyframes: i64) -> anyhow::Result<()> {
    let policy = v1::MapPolicy { local_bundle_adjustment: Some(false), ..Default::default() };
    let (street, waits) = (Street::new(400, 200), Arc::new(Mutex::new(Waits::default())));
    let mut session = street.open(client, "large", policy, 256, &waits).await?;
    for k in 0..keyframes {
        send(&mut session, &waits, street.keyframe(k)).await?;
    }
    session.finish().await?;
    Ok(())
}

/// New connections of a robot with its token, one a second.
struct Connecting {
    seconds: Arc<Mutex<Vec<f64>>>,
    tasks: JoinSet<()>,
}

fn connect_often(url: &str) -> Connecting {
    let (seconds, url) = (Arc::new(Mutex::new(Vec::new())), url.to_owned());
    let (taken, mut tasks) = (Arc::clone(&seconds), JoinSet::new());
    tasks.spawn(async move {
        loop {
            let begin = Instant::now();
            let calling = async { connect(&url, "robot").await?.server_info().await };
            let called = tokio::time::timeout(Duration::from_secs(10), calling).await;
            // Who is refused waits as long as one who is not answered.
            let refused = !matches!(called, Ok(Ok(_)));
            lock(&taken).push(if refused { 10.0 } else { begin.elapsed().as_secs_f64() });
            tokio::time::sleep(Duration::from_secs(1)).await;
        }
    });
    Connecting { seconds, tasks }
}
