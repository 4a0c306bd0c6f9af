//! Calls that are cut off at each sync that they wait for, and syncs that fail under them.

use tonic::{Code, Request};

use super::calls::{
    Cut, Robot, connect, create, create_again, create_request, cut_off, delete, eventually, get,
    map_out,
};
use super::machine::Machine;
use super::trace::Field;
use crate::common::run;
use covis::wire::v1;
use v1::map_service_client::MapServiceClient;

/// Linux' numbers of errors.
pub(super) const EIO: i64 = 5;
const EMFILE: i64 = 24;
pub(super) const ENOSPC: i64 = 28;

/// A creation waits for so many syncs at most.
const CREATE_SYNCS: i64 = 8;

/// A copy waits for so many syncs at most.
const COPY_SYNCS: i64 = 5;

/// Where a call is cut off.
fn cuts(syncs: i64) -> impl Iterator<Item = (Cut, i64)> {
    (0..syncs).flat_map(|sync| [(Cut::Dropped, sync), (Cut::Deadline, sync)])
}

#[test]
fn a_create_that_is_cut_off_leaves_its_name_usable_and_one_whole_map() {
    let Some(mut machine) = Machine::new() else { return };
    let mut server = machine.start();
    let (mut wedged, mut durable, mut count) = (Vec::new(), Vec::new(), 0);
    run(async {
        let channel = connect(&server.url).await;
        for (cut, syncs) in cuts(CREATE_SYNCS) {
            let name = format!("map-{cut:?}-{syncs}").to_lowercase();
            let request = create_request(&name);
            let create = |timed: Request<()>| {
                let mut service = MapServiceClient::new(channel.clone());
                async move { service.create_map(timed.map(|()| request)).await }
            };
            let answer = cut_off(&channel, &machine.stage, (cut, syncs), create).await;
            count += i32::from(!matches!(answer, Some(Ok(_))));
            let map_out = || async { map_out(&channel, &name, 3).await.is_ok() };
            let is_mapped = create_again(&channel, &name).await && eventually(map_out).await;
            if is_mapped { durable.push(name) } else { wedged.push(name) }
        }
    });
    assert!(count >= 8, "{count} creations were cut off");
    assert_eq!(server.terminate(), Some(0));
    let server = machine.start();
    let mut lost = Vec::new();
    run(async {
        let channel = connect(&server.url).await;
        for name in &durable {
            match get(&channel, name).await {
                Ok(map) if map.counts.is_some_and(|counts| counts.keyframe_count == 2) => {}
                Ok(map) => lost.push(format!("{name}: {:?}", map.counts)),
                Err(status) => lost.push(format!("{name}: {:?}", status.code())),
            }
        }
    });
    let told = format!(
        "of {count} maps whose creation was cut off\nwedged: {wedged:?}\ndurable, and lost by a \
         clean restart: {lost:#?}"
    );
    assert!(wedged.is_empty() && lost.is_empty(), "{told}");
}

#[test]
fn a_copy_that_is_cut_off_leaves_its_name_usable_and_one_whole_map_or_none() {
    let Some(mut machine) = Machine::new() else { return };
    let mut server = machine.start();
    let (mut partial, mut names, mut count) = (Vec::new(), Vec::new(), 0);
    run(async {
        let channel = connect(&server.url).await;
        create(&channel, "house").await.unwrap();
        map_out(&channel, "house", 3).await.unwrap();
        for (cut, syncs) in cuts(COPY_SYNCS) {
            let name = format!("copy-{cut:?}-{syncs}").to_lowercase();
            let request = v1::CopyMapRequest {
                source_map_id: "house".to_owned(),
                new_map_id: name.clone(),
                at: Some(v1::copy_map_request::At::Revision(4)),
                state: 0,
            };
            let again = request.clone();
            let copy = |timed: Request<()>| {
                let mut service = MapServiceClient::new(channel.clone());
                async move { service.copy_map(timed.map(|()| request)).await }
            };
            let answer = cut_off(&channel, &machine.stage, (cut, syncs), copy).await;
            count += i32::from(!matches!(answer, Some(Ok(_))));
            // None or the whole one: after one more try it is there.
            let mut service = MapServiceClient::new(channel.clone());
            if let Err(status) = service.copy_map(again).await
                && status.code() != Code::AlreadyExists
            {
                partial.push(format!("{name}: {status}"));
            }
            names.push(name);
        }
    });
    assert!(count >= 6, "{count} copies were cut off");
    // Killed, and what was not synced is gone: an answered copy is there, and whole.
    server.kill();
    let server = machine.start();
    run(async {
        let channel = connect(&server.url).await;
        for name in &names {
            match get(&channel, name).await {
                Ok(map)
                    if map.revision >= 4 && map.counts.is_some_and(|c| c.keyframe_count == 1) => {}
                found => partial.push(format!("{name}: {found:?}")),
            }
        }
    });
    assert!(partial.is_empty(), "of {count} copies that were cut off: {partial:#?}");
}

#[test]
fn a_delete_that_is_cut_off_leaves_its_name_usable() {
    let Some(mut machine) = Machine::new() else { return };
    let server = machine.start();
    let (mut wedged, mut count) = (Vec::new(), 0);
    run(async {
        let channel = connect(&server.url).await;
        for (cut, syncs) in cuts(2).chain(cuts(2)).chain(cuts(2)) {
            let name = format!("map-{count}");
            create(&channel, &name).await.unwrap();
            map_out(&channel, &name, 2).await.unwrap();
            let request = v1::DeleteMapRequest { map_id: name.clone() };
            let delete_cut = |timed: Request<()>| {
                let mut service = MapServiceClient::new(channel.clone());
                async move { service.delete_map(timed.map(|()| request)).await }
            };
            let _cut = cut_off(&channel, &machine.stage, (cut, syncs), delete_cut).await;
            count += 1;
            // Deleted to the end or not at all: after one more try the name is free.
            let is_usable = eventually(|| async {
                let gone = delete(&channel, &name).await;
                let is_gone = gone.map_or_else(|status| status.code() == Code::NotFound, |()| true);
                is_gone && create(&channel, &name).await.is_ok()
            });
            if !is_usable.await {
                let (gone, made) = (get(&channel, &name).await, create(&channel, &name).await);
                let codes = [gone.err(), made.err()].map(|error| error.map(|e| e.code()));
                wedged.push(format!("{name} ({cut:?}, {syncs}): GetMap, CreateMap {codes:?}"));
            }
        }
    });
    assert!(wedged.is_empty(), "{} of {count} deletions: {wedged:#?}", wedged.len());
}

#[test]
fn a_delete_that_fails_ends_the_map_or_keeps_what_it_acknowledges() {
    let Some(mut machine) = Machine::new() else { return };
    let mut server = machine.start();
    let mut durable = false;
    run(async {
        let channel = connect(&server.url).await;
        create(&channel, "house").await.unwrap();
        let mut robot = Robot::open(&channel, "house").await.unwrap();
        robot.send_item(1).await;
        robot.until(v1::AckStatus::Durable, 1).await.unwrap();
        machine.stage.set(Field::SyncKind, 2);
        machine.stage.set(Field::SyncErrno, EIO);
        delete(&channel, "house").await.unwrap_err();
        machine.stage.heal();
        for sequence in 2..5 {
            robot.send_item(sequence).await;
        }
        durable = robot.until(v1::AckStatus::Durable, 4).await.is_ok();
    });
    assert_eq!(server.terminate(), Some(0));
    let server = machine.start();
    run(async {
        let channel = connect(&server.url).await;
        let found = get(&channel, "house").await;
        println!("durable after the failed delete: {durable}; after a restart: {found:?}");
        if durable {
            let counts = found.expect("a map that acknowledged").counts.unwrap();
            assert_eq!(counts.keyframe_count, 3);
        }
    });
}

#[test]
fn a_full_disk_ends_by_itself_when_there_is_room_again() {
    let Some(mut machine) = Machine::new() else { return };
    let mut server = machine.start();
    run(async {
        let channel = connect(&server.url).await;
        create(&channel, "house").await.unwrap();
        map_out(&channel, "house", 4).await.unwrap();
        machine.stage.set(Field::WriteErrno, ENOSPC);
        let mut robot = Robot::open(&channel, "house").await;
        if let Ok(robot) = &mut robot {
            robot.send_item(5).await;
            let durable = tokio::time::timeout(
                std::time::Duration::from_millis(300),
                robot.until(v1::AckStatus::Durable, 5),
            );
            assert!(!matches!(durable.await, Ok(Ok(()))), "DURABLE on a full disk");
        }
        machine.stage.heal();
        let goes_on = eventually(|| async { map_out(&channel, "house", 9).await.is_ok() }).await;
        assert!(goes_on, "the map does not go on: {:?}", map_out(&channel, "house", 9).await);
    });
    assert_eq!(server.terminate(), Some(0));
    let server = machine.start();
    run(async {
        let counts = get(&connect(&server.url).await, "house").await.unwrap().counts.unwrap();
        assert_eq!(counts.keyframe_count, 8);
    });
}

#[test]
fn a_create_without_descriptors_leaves_nothing_behind() {
    let Some(mut machine) = Machine::new() else { return };
    let server = machine.start();
    run(async {
        let channel = connect(&server.url).await;
        machine.stage.set(Field::OpenErrno, EMFILE);
        create(&channel, "house").await.unwrap_err();
        assert_eq!(get(&channel, "house").await.unwrap_err().code(), Code::NotFound);
        machine.stage.heal();
        create(&channel, "house").await.unwrap();
        map_out(&channel, "house", 3).await.unwrap();
    });
}
