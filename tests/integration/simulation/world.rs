//! One simulated run: a server on a simulated disk, robots on simulated links, and what goes wrong.
//!
//! turmoil gives hosts, links and the clock; one thread runs everything, a tick at a time. Between two
//! ticks the run may kill the server, wherever its tasks wait, or cut links; within a tick the disk may
//! stop at an operation. The server then starts again on what the crash left. All choices come from one
//! seed, so that a run that breaks a promise is repeated by its seed.

use std::cell::RefCell;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::Arc;
use std::time::{Duration, UNIX_EPOCH};

use hyper_util::rt::TokioIo;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::{Endpoint, Uri};

use super::answer::Broken;
use super::disk::{Faults, SimDisk};
use super::nodes::Crash;
use super::robot::Robot;
use covis::client::Client;
use covis::service::{KeepAlive, Server, ServerConfig};
use covis::store::{FileStore, FileStoreOptions};

/// Small, so that a short run fills several files and takes snapshots.
const FILES: FileStoreOptions = FileStoreOptions { segment_bytes: 1500, snapshot_bytes: 3000 };
const PORT: u16 = 7411;
const SERVER: &str = "server";
const TICK: Duration = Duration::from_millis(1);
/// A server without a crash lives this long at most, ticks: a journal whose sync failed needs a restart.
const LONGEST_LIFE: u64 = 3_000;
/// The longest time for which a link is dead, ticks: longer than the keep-alive of both ends.
const LONGEST_CUT: u64 = 3_000;
/// A run that takes longer hangs, ticks.
const LONGEST_RUN: u64 = 600_000;
/// Keep-alive of both ends: the time without traffic before a probe, and the time to wait for its answer.
const PATIENCE: Duration = Duration::from_millis(500);
/// The last things that happened are told with a broken promise.
const NOTES: usize = 40;

/// What a run does.
#[derive(Clone, Debug)]
pub(crate) struct Plan {
    pub(crate) seed: u64,
    pub(crate) robots: usize,
    /// Things that each robot does.
    pub(crate) actions: usize,
}

/// What a run came to.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct Report {
    /// How often the machine stopped, by whatever cause.
    pub(crate) crashes: u64,
    /// Those in the middle of an operation of the disk.
    pub(crate) stops: u64,
    /// How often a link lost everything for a while.
    pub(crate) cuts: u64,
    /// Operations of the disk.
    pub(crate) operations: u64,
    /// Landmarks that closures joined with others, at each look at the end.
    pub(crate) joined: u64,
    /// Closures that the server found, at each look at the end.
    pub(crate) found: u64,
    /// What the disk did, and at which tick: equal for runs that are equal.
    pub(crate) log: Vec<(u64, &'static str)>,
    /// What happened, as robots saw it.
    pub(crate) notes: Vec<String>,
}

/// What robots see of the run.
#[derive(Debug, Default)]
pub(crate) struct World {
    /// How often the server crashed.
    pub(crate) crashes: u64,
    /// How often a link died or worked again.
    pub(crate) link_changes: u64,
    /// The time, ticks since the beginning of the run.
    tick: u64,
    /// Landmarks that closures joined with others, at each look at the end.
    pub(super) joined: u64,
    /// Closures that the server found, at each look at the end.
    pub(super) found: u64,
    /// Stages that robots have ended: their work, and each look at the end.
    done: usize,
    /// 0 while things go wrong; then one more with each restart.
    calm: u32,
    broken: Option<Broken>,
    /// What happened, for whoever looks into a promise that does not hold.
    notes: Vec<String>,
}

impl World {
    /// Remembers something with its time.
    pub(crate) fn note(&mut self, text: String) {
        let time = TICK * u32::try_from(self.tick).unwrap_or(u32::MAX);
        self.notes.push(format!("{:.3} s  {text}", time.as_secs_f64()));
    }
}

/// Tokio drops the tasks of a runtime in an order that follows from their ids, modulo a small power of
/// two. Ids count up through the process: a run begins at a multiple, to be repeated by its seed.
fn align_task_ids() {
    let Ok(runtime) = tokio::runtime::Builder::new_current_thread().build() else { return };
    let next = || runtime.spawn(async {}).id().to_string().parse::<u64>();
    while next().is_ok_and(|id| !id.is_multiple_of(64)) {}
}

/// Runs a plan.
///
/// # Errors
/// The promise that does not hold.
pub(crate) fn run(plan: &Plan) -> Result<Report, Broken> {
    align_task_ids();
    let mut rng = ChaCha8Rng::seed_from_u64(plan.seed);
    let disk = SimDisk::new(plan.seed);
    let world = Rc::new(RefCell::new(World::default()));
    let mut sim = turmoil::Builder::new()
        .rng_seed(plan.seed)
        .epoch(UNIX_EPOCH + Duration::from_secs(1_700_000_000))
        .tick_duration(TICK)
        .simulation_duration(Duration::from_secs(86_400))
        .min_message_latency(TICK)
        .max_message_latency(Duration::from_millis(rng.random_range(2..15)))
        .tcp_capacity(1 << 16)
        .build();
    let server_disk = disk.clone();
    sim.host(SERVER, move || serve(server_disk.clone()));
    for number in 0..plan.robots {
        let (world, seed, actions) = (Rc::clone(&world), plan.seed, plan.actions);
        sim.client(host(number), async move {
            let mut robot = Robot::new(number, seed, client(), &world);
            let outcome = work(&mut robot, actions, &world).await;
            if let Err(broken) = outcome {
                world.borrow_mut().broken.get_or_insert(broken);
            }
            Ok(())
        });
    }
    let mut machine =
        Machine { disk, rng, up: true, since: 0, back_at: 0, cut: None, report: Report::default() };
    machine.faults();
    let mut ended = false;
    let mut tick = 0;
    while !ended {
        ended = sim.step().map_err(|error| Broken(format!("the simulation: {error}")))?;
        tick += 1;
        machine.disk.set_tick(tick);
        world.borrow_mut().tick = tick;
        let mut broken = world.borrow().broken.clone();
        if tick > LONGEST_RUN {
            broken.get_or_insert(Broken("the run does not end".to_owned()));
        }
        if let Some(Broken(promise)) = broken {
            let world = world.borrow();
            let from = world.notes.len().saturating_sub(NOTES);
            return Err(Broken(format!("{promise}\n  {}", world.notes[from..].join("\n  "))));
        }
        let calm = world.borrow().calm;
        let stage_ends = world.borrow().done == plan.robots * (calm as usize + 1);
        if stage_ends && calm < 3 && machine.up {
            let crash = [Crash::Process, Crash::Process, Crash::PowerNothing][calm as usize];
            machine.crash(&mut sim, tick, crash, &world);
            world.borrow_mut().calm += 1;
        }
        machine.links(&sim, tick, plan.robots, &world);
        machine.step(&mut sim, tick, &world);
    }
    machine.report.operations = machine.disk.operations();
    machine.report.joined = world.borrow().joined;
    machine.report.found = world.borrow().found;
    machine.report.log = machine.disk.log();
    machine.report.notes = std::mem::take(&mut world.borrow_mut().notes);
    Ok(machine.report)
}

/// Works while things go wrong. Then all must be well: at once, after a restart, and after a loss of
/// power.
async fn work(robot: &mut Robot, actions: usize, world: &Rc<RefCell<World>>) -> Result<(), Broken> {
    robot.work(actions).await?;
    world.borrow_mut().done += 1;
    for calm in [1, 2, 3] {
        while world.borrow().calm < calm {
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        robot.finish().await?;
        world.borrow_mut().done += 1;
    }
    Ok(())
}

/// The name of a robot's host.
fn host(number: usize) -> String {
    format!("robot-{number}")
}

/// The machine with the server on it, and its links.
struct Machine {
    disk: SimDisk,
    rng: ChaCha8Rng,
    up: bool,
    /// The tick of its start.
    since: u64,
    /// The tick at which it starts again.
    back_at: u64,
    /// The robot whose link is dead, and the tick at which it works again.
    cut: Option<(usize, u64)>,
    report: Report,
}

impl Machine {
    /// Chooses what goes wrong in the next life of the server.
    fn faults(&mut self) {
        let rng = &mut self.rng;
        let now = self.disk.operations();
        let mut faults = Faults::default();
        if rng.random_range(0..10) < 7 {
            // Half of them early, while the store still brings back what it finds.
            let longest = if rng.random() { 15 } else { 60 };
            faults.stop_at = Some(now + rng.random_range(0..longest));
        }
        match rng.random_range(0..10) {
            0 => faults.failing_syncs = 30_000,
            1 => faults.failing_writes = 30_000,
            2 => faults.full = now..now + rng.random_range(1..30),
            3 => faults.no_descriptors = now..now + rng.random_range(1..30),
            _ => {}
        }
        if rng.random() {
            faults.slowest = Duration::from_millis(rng.random_range(1..40));
        }
        self.disk.set(faults);
    }

    /// Cuts the link of a robot for a while: what is sent on open connections is lost, and neither end
    /// is told. New connections are refused.
    fn links(
        &mut self,
        sim: &turmoil::Sim<'_>,
        tick: u64,
        robots: usize,
        world: &Rc<RefCell<World>>,
    ) {
        let is_calm = world.borrow().calm > 0;
        match self.cut {
            Some((robot, until)) if is_calm || tick >= until => {
                sim.repair(SERVER, host(robot));
                let mut world = world.borrow_mut();
                world.link_changes += 1;
                world.note(format!("the link of {} works again", host(robot)));
                self.cut = None;
            }
            None if !is_calm && self.rng.random_range(0..500) == 0 => {
                let robot = self.rng.random_range(0..robots);
                sim.partition(SERVER, host(robot));
                let mut world = world.borrow_mut();
                world.link_changes += 1;
                world.note(format!("the link of {} is dead", host(robot)));
                self.cut = Some((robot, tick + self.rng.random_range(1..LONGEST_CUT)));
                self.report.cuts += 1;
            }
            Some(_) | None => {}
        }
    }

    fn step(&mut self, sim: &mut turmoil::Sim<'_>, tick: u64, world: &Rc<RefCell<World>>) {
        let is_calm = world.borrow().calm > 0;
        if !self.up {
            if tick >= self.back_at {
                if !is_calm {
                    self.faults();
                }
                sim.bounce(SERVER);
                world.borrow_mut().note("the server starts".to_owned());
                (self.up, self.since) = (true, tick);
            }
            return;
        }
        let stopped = self.disk.has_stopped();
        let ended = !sim.is_host_running(SERVER);
        let life = tick - self.since;
        let killed = !is_calm && (life > LONGEST_LIFE || self.rng.random_range(0..400) == 0);
        if stopped || ended || killed {
            self.report.stops += u64::from(stopped);
            let crash = match self.rng.random_range(0..6) {
                0..3 => Crash::Process,
                3 => Crash::PowerNothing,
                4 => Crash::PowerAll,
                _ => Crash::PowerSome,
            };
            self.crash(sim, tick, crash, world);
        }
    }

    fn crash(
        &mut self,
        sim: &mut turmoil::Sim<'_>,
        tick: u64,
        crash: Crash,
        world: &Rc<RefCell<World>>,
    ) {
        sim.crash(SERVER);
        self.disk.crash(crash);
        self.report.crashes += 1;
        world.borrow_mut().crashes += 1;
        let last = self.disk.log().last().map_or("none", |&(_, what)| what);
        world.borrow_mut().note(format!("{crash:?} crash, the last operation was {last}"));
        (self.up, self.back_at) = (false, tick + self.rng.random_range(1..30));
    }
}

/// The server. Ends where it cannot start, as the program does.
async fn serve(disk: SimDisk) -> turmoil::Result {
    let Ok(store) = FileStore::on(Arc::new(disk), PathBuf::from("/data"), FILES) else {
        return Ok(());
    };
    let address = SocketAddr::from(([127, 0, 0, 1], PORT));
    let listener = turmoil::net::TcpListener::bind(("0.0.0.0", PORT)).await?;
    let (sockets, incoming) = tokio::sync::mpsc::channel(16);
    tokio::spawn(async move {
        while let Ok(accepted) = listener.accept().await {
            if sockets.send(std::io::Result::Ok(accepted)).await.is_err() {
                return;
            }
        }
    });
    // As short as the robots', so that both ends find out by themselves that a link is dead.
    let keep_alive = KeepAlive { interval: PATIENCE, timeout: PATIENCE, ..KeepAlive::default() };
    let config = ServerConfig { max_maps: Some(4), keep_alive, ..ServerConfig::default() };
    let incoming = ReceiverStream::new(incoming);
    let Ok(starting) = Server::listen_in_place(incoming, address, config, store).await else {
        return Ok(());
    };
    let Ok(_running) = starting.open().await else { return Ok(()) };
    std::future::pending().await
}

/// A client whose connections are simulated.
fn client() -> Client {
    let url = format!("http://{SERVER}:{PORT}");
    let connect = |_uri: Uri| async {
        let socket = turmoil::net::TcpStream::connect((SERVER, PORT)).await?;
        std::io::Result::Ok(TokioIo::new(socket))
    };
    let channel = Endpoint::from_static("http://server:7411")
        .connect_timeout(PATIENCE)
        .http2_keep_alive_interval(PATIENCE)
        .keep_alive_timeout(PATIENCE)
        .keep_alive_while_idle(true)
        .connect_with_connector_lazy(tower::service_fn(connect));
    Client::on_channel(channel, &url, PATIENCE)
}
