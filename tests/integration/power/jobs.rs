//! Jobs on a disk that is full while they have something to write.

use covis::client::Client;
use covis::wire::v1;
use tonic::Code;
use v1::JobState;

use super::calls::{connect, create, map_out};
use super::cut_off::ENOSPC;
use super::machine::Machine;
use super::trace::Field;
use crate::common::run;
use crate::job_support::{compact, pose_graph};

#[test]
fn a_job_that_finds_the_disk_full_waits_for_room_and_succeeds() {
    let Some(mut machine) = Machine::new() else { return };
    let mut server = machine.start();
    run(async {
        let channel = connect(&server.url).await;
        create(&channel, "house").await.unwrap();
        map_out(&channel, "house", 9).await.unwrap();
        let client = Client::connect(&server.url).await.unwrap();
        let request = |job_id: &str, spec| v1::CreateJobRequest {
            job_id: job_id.to_owned(),
            spec: Some(v1::JobSpec { spec: Some(spec) }),
            priority: 0,
        };
        for round in 0..4 {
            let id = format!("night-{round}");
            client.create_job(request(&id, compact("house", None))).await.unwrap();
            // Wherever it is now, from here on it writes nothing.
            machine.stage.set(Field::WriteErrno, ENOSPC);
            let refused = client.create_job(request("refused", pose_graph("house"))).await;
            let status = refused.unwrap_err();
            let is_busy = status.code() == Some(Code::Aborted);
            assert!(is_busy || status.code() == Some(Code::ResourceExhausted), "{status}");
            let during = client.job(&id).await.unwrap();
            assert_ne!(during.state(), JobState::Failed, "{during:?}");
            machine.stage.heal();
            let job = client.watch_job(&id, |_| {}).await.unwrap();
            assert_eq!(job.state(), JobState::Succeeded, "{job:?}");
            assert!(!client.job_file(&id, "report.json").await.unwrap().is_empty());
        }
    });
    assert_eq!(server.terminate(), Some(0));
}
