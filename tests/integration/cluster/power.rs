//! All NATS servers and the owner lose power at once: real servers of both on a disk that forgets what
//! was not synced (`disk`). Skipped where no filesystem can be mounted.

use std::collections::BTreeSet;

use covis::client::{Client, ClientError};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;

use super::copies::set_aside;
use super::disk::ForgetfulDisk;
use super::nats::Nats;
use super::{Robot, messages, patient, prove_one_writer, rounds};
use crate::cli_support::{Running, Workspace};
use crate::common::run;
use crate::power::model::Survival;

/// The owner's folder, on the disk.
const OWNER: &str = "disk/owner";

/// Three NATS servers and the owner of a map, all on one disk. Fields end in this order.
struct Site {
    server: Running,
    nats: Nats,
    disk: ForgetfulDisk,
    workspace: Workspace,
    arguments: &'static [&'static str],
}

impl Site {
    /// `None` where it cannot be had, which is said.
    fn new(syncs: bool) -> Option<Self> {
        let workspace = Workspace::new();
        let folder = workspace.path("disk");
        let disk = ForgetfulDisk::mount(folder.clone())?;
        let nats = Nats::start_on(Some(&folder), 3, syncs)?;
        let arguments: &[&str] = if syncs { &[] } else { &["--accept-unsynced-replicas"] };
        let server = nats.covis_over(&nats.urls(), &workspace, OWNER, arguments);
        Some(Self { server, nats, disk, workspace, arguments })
    }

    /// SIGKILL to all, then the power is lost. Returns how many paths are not as the kill left them.
    fn lose_power(&mut self, owner_first: bool, survival: Survival<'_>) -> usize {
        if owner_first {
            self.server.kill();
            self.nats.kill();
        } else {
            self.nats.kill();
            self.server.kill();
        }
        self.disk.lose_power(survival)
    }

    /// All of them again, the owner where it was.
    fn restart(&mut self) {
        self.nats.restart();
        let port = self.server.port.clone();
        let urls = self.nats.urls();
        let (workspace, arguments) = (&self.workspace, self.arguments);
        self.server = self.nats.start_covis(port, &urls, workspace, OWNER, arguments);
    }

    /// The keyframes that the owner has; none where it does not know the map.
    async fn keyframes(&self) -> BTreeSet<i64> {
        let client = Client::connect(&self.server.url).await.unwrap();
        match patient().run(|| client.trajectory("house", None)).await {
            Ok(found) => found.poses.into_iter().map(|pose| pose.keyframe.unwrap().id).collect(),
            Err(ClientError::Rpc { status, .. }) if status.code() == tonic::Code::NotFound => {
                BTreeSet::new()
            }
            Err(error) => panic!("{error}"),
        }
    }
}

/// The keyframes that a robot was told to be durable: those up to the sequence before the last.
fn acknowledged(robot: &Robot) -> BTreeSet<i64> {
    (0..robot.durable() - 1).collect()
}

#[test]
fn nothing_acknowledged_is_lost_when_the_owner_and_all_of_nats_lose_power() {
    let Some(mut site) = Site::new(true) else { return };
    let (mut taken, mut on_its_way) = (0, 0);
    run(async {
        let mut robot = Robot::new(&site.server.url).await;
        for round in 0..rounds() {
            let last = robot.send(20).await;
            robot.reach(last - 10).await;
            // Nothing of what was not synced is left, or a part of it.
            let mut rng = ChaCha8Rng::seed_from_u64(u64::try_from(round).unwrap());
            let survival = match round % 2 {
                0 => Survival::Nothing,
                _ => Survival::Random(&mut rng),
            };
            let changed = site.lose_power(round % 4 < 2, survival);
            taken += usize::from(changed > 0);
            let promised = acknowledged(&robot);
            on_its_way += usize::from(robot.durable() < last);
            if round % 3 != 0 {
                // The owner's own disk does not come back: the streams have it all.
                site.disk.take_away("owner");
            }
            site.restart();
            let kept = site.keyframes().await;
            let lost: Vec<_> = promised.difference(&kept).collect();
            assert!(lost.is_empty(), "round {round}: acknowledged and gone: {lost:?}");
            // What was not acknowledged comes again.
            let last = robot.send(1).await;
            robot.reach(last).await;
            assert_eq!(site.keyframes().await, (0..robot.sent).collect(), "round {round}");
        }
        prove_one_writer(&messages(&site.nats.urls()).await);
    });
    println!(
        "{} losses of power: nothing acknowledged was lost; in {taken} the power took more than the \
         kill, in {on_its_way} something was on its way",
        rounds()
    );
    assert_eq!(taken, rounds(), "the disk forgot nothing");
}

/// The disk can lose: the same as above, without syncs.
#[test]
fn a_nats_that_acknowledges_before_it_syncs_loses_what_was_acknowledged_with_the_power() {
    let Some(mut site) = Site::new(false) else { return };
    run(async {
        let mut robot = Robot::new(&site.server.url).await;
        let last = robot.send(20).await;
        robot.reach(last).await;
        site.lose_power(true, Survival::Nothing);
        site.disk.take_away("owner");
        site.restart();
        let kept = site.keyframes().await;
        let lost = acknowledged(&robot).difference(&kept).count();
        println!("{lost} of {} acknowledged keyframes are gone", robot.durable() - 1);
        assert!(lost > 0, "the disk forgot nothing");
    });
}

#[test]
fn what_nats_lost_with_the_power_stays_on_the_disk_of_the_owner_also_when_the_map_is_made_again() {
    let Some(mut site) = Site::new(false) else { return };
    run(async {
        let mut robot = Robot::new(&site.server.url).await;
        let last = robot.send(20).await;
        robot.reach(last).await;
        site.lose_power(true, Survival::Nothing);
        site.restart();
        assert_eq!(site.keyframes().await, BTreeSet::new());
        // The robot goes on, and another one makes the map that is unknown.
        let mut other = Robot::new(&site.server.url).await;
        let last = other.send(3).await;
        other.reach(last).await;
        let map = set_aside(&site.workspace.path(OWNER), "house").await;
        let kept: BTreeSet<i64> = map.keyframes().keys().map(|id| id.id).collect();
        assert_eq!(kept, acknowledged(&robot));
    });
}
