//! A restart brings to the disk what it serves: what was written and not synced before the server died,
//! and what a failed sync left in memory, does not count as durable until it was synced again.

use covis::wire::v1;
use tonic::transport::Channel;
use v1::map_service_client::MapServiceClient;

use super::calls::{Robot, connect, create_request, eventually, get, map_out};
use super::cut_off::EIO;
use super::machine::Machine;
use super::model::Survival;
use super::trace::Field;
use crate::common::run;

/// Items that a server wrote without a sync.
const LAST: i64 = 6;

/// Sends items of which the bytes are written and no sync succeeds, then kills the server.
fn die_before_the_sync(machine: &mut Machine, has_failed: bool) {
    let mut server = machine.start();
    run(async {
        let channel = connect(&server.url).await;
        // No solve writes to the journal beside the items.
        let mut request = create_request("house");
        request.policy =
            Some(v1::MapPolicy { local_bundle_adjustment: Some(false), ..Default::default() });
        MapServiceClient::new(channel.clone()).create_map(request).await.unwrap();
        map_out(&channel, "house", 2).await.unwrap();
        let mut robot = Robot::open(&channel, "house").await.unwrap();
        // The sync of this item shows that nothing of the opening is on its way any more.
        robot.send_item(3).await;
        robot.until(v1::AckStatus::Durable, 3).await.unwrap();
        if has_failed {
            machine.stage.set(Field::SyncErrno, EIO);
        } else {
            machine.stage.set(Field::IsHeld, 1);
        }
        let before = machine.stage.get(Field::Syncs);
        for sequence in 4..=LAST {
            robot.send_item(sequence).await;
        }
        // What comes before the held sync is written; the rest waits for it in memory.
        let asked = eventually(|| async { machine.stage.get(Field::Syncs) > before });
        assert!(asked.await, "no sync was asked for");
    });
    server.kill();
    machine.stage.heal();
}

/// The last item that a second server serves or acknowledges as durable, and the last one that is there
/// after the power went.
fn promised_and_kept(machine: &mut Machine, is_held: bool) -> (i64, i64) {
    let mut server = machine.start();
    let mut promised = 0;
    run(async {
        let channel = connect(&server.url).await;
        // No sync of a new item may take the old ones along.
        machine.stage.set(Field::IsHeld, i64::from(is_held));
        promised = served(&channel).await;
        if is_held {
            return;
        }
        let mut robot = Robot::open(&channel, "house").await.unwrap();
        let last = robot.next_sequence;
        assert_eq!(last, promised + 1);
        for sequence in [promised, last] {
            robot.send_item(sequence).await;
        }
        robot.until(v1::AckStatus::Durable, last).await.unwrap();
        promised = last;
    });
    server.kill();
    machine.stage.heal();
    machine.lose_power(Survival::Nothing);
    let server = machine.start();
    let mut kept = 0;
    run(async {
        let channel = connect(&server.url).await;
        assert_eq!(get(&channel, "house").await.unwrap().state(), v1::MapState::Open);
        kept = served(&channel).await;
    });
    (promised, kept)
}

/// The last item that a server serves: the camera is the first.
async fn served(channel: &Channel) -> i64 {
    1 + get(channel, "house").await.unwrap().counts.unwrap().keyframe_count
}

#[test]
fn a_restart_serves_nothing_that_a_loss_of_power_still_takes() {
    let Some(mut machine) = Machine::new() else { return };
    die_before_the_sync(&mut machine, false);
    let (served, kept) = promised_and_kept(&mut machine, true);
    assert!(served > 3, "nothing that was unsynced is served: {served}");
    assert!(served <= kept, "served through {served}, kept through {kept}");
}

#[test]
fn a_restart_after_a_failed_sync_writes_again_what_it_counts_as_durable() {
    let Some(mut machine) = Machine::new() else { return };
    die_before_the_sync(&mut machine, true);
    let (durable, kept) = promised_and_kept(&mut machine, false);
    assert!(durable > 4, "nothing that was unsynced was read: {durable}");
    assert!(durable <= kept, "durable through {durable}, kept through {kept}");
}
