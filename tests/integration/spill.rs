//! Items that do not fit memory while the link is down: they wait in a file, arrive once and in order,
//! outlive the process, and a file that was damaged gives what stands before the damage.
//!
//! A process that was killed is a copy of its file, made while the session still runs.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use covis::client::{
    Client, ClientError, IngestSession, RetryPolicy, SessionOptions, SpillOptions,
};
use covis::wire::v1;
use futures_util::FutureExt;
use tempfile::TempDir;

use crate::common::{TestServer, camera, keyframe, run};
use crate::proxy::Proxy;

/// Items that memory holds.
const IN_MEMORY: usize = 4;
/// Keyframes while the link is down: ten times as many.
const KEYFRAMES: i64 = 40;

/// Retries until the link is back.
fn patient() -> RetryPolicy {
    let delay = Duration::from_millis(1);
    let max_attempts = u32::MAX;
    RetryPolicy { max_attempts, first_delay: delay, longest_delay: delay, ..RetryPolicy::default() }
}

fn options(folder: &Path, max_bytes: u64) -> SessionOptions {
    let spill = Some(SpillOptions { directory: folder.to_owned(), max_bytes });
    let max_unanswered = IN_MEMORY;
    SessionOptions { max_unanswered, spill, retry: patient(), ..SessionOptions::default() }
}

/// A server, a link to it, and a folder.
struct Setup {
    server: TestServer,
    proxy: Proxy,
    folder: TempDir,
}

impl Setup {
    async fn new() -> Self {
        let server = TestServer::start().await;
        server.create_map("room").await;
        let proxy = Proxy::to(server.running.local_addr()).await;
        Self { server, proxy, folder: tempfile::tempdir().unwrap() }
    }

    async fn session(&self, options: SessionOptions) -> IngestSession {
        let client = Client::connect(&self.proxy.url()).await.unwrap();
        client.ingest("room", "robot", options).await.unwrap()
    }

    fn lose_link(&self) {
        self.proxy.close();
        self.proxy.cut();
    }

    /// Sends the camera while the link stands, and all keyframes when it does not.
    async fn spilled(&self, options: SessionOptions) -> IngestSession {
        let mut session = self.session(options).await;
        session.send(camera(0)).await.unwrap();
        session.flush().await.unwrap();
        self.lose_link();
        for id in 0..KEYFRAMES {
            assert_eq!(session.send(keyframe(id)).await.unwrap(), id + 2);
        }
        session
    }

    fn file(&self) -> PathBuf {
        self.folder.path().join("room.robot.spill")
    }

    /// A folder with the file as a killed process would leave it.
    fn killed(&self) -> TempDir {
        let folder = tempfile::tempdir().unwrap();
        fs_err::copy(self.file(), folder.path().join("room.robot.spill")).unwrap();
        folder
    }

    async fn counts(&self) -> (i64, i64) {
        let client = Client::connect(&self.proxy.url()).await.unwrap();
        let map = client.get_map("room").await.unwrap();
        (map.counts.unwrap().keyframe_count, map.clients[0].next_sequence)
    }
}

#[test]
fn ten_times_what_memory_holds_arrives_once_and_in_order() {
    run(async {
        let setup = Setup::new().await;
        let received = Arc::new(Mutex::new(Vec::new()));
        let seen = Arc::clone(&received);
        let options = options(setup.folder.path(), 1 << 24).on_ack(move |ack| {
            if ack.status() == v1::AckStatus::Received && !ack.duplicate {
                seen.lock().unwrap().push(ack.sequence);
            }
        });
        let session = setup.spilled(options).await;
        assert!(setup.file().exists());
        setup.proxy.open();
        let report = session.finish().await.unwrap();
        let all = KEYFRAMES as u64 + 1;
        assert_eq!((report.sent, report.acknowledged, report.rejected), (all, all, 0));
        assert_eq!(*received.lock().unwrap(), (1..=KEYFRAMES + 1).collect::<Vec<_>>());
        assert_eq!(setup.counts().await, (KEYFRAMES, KEYFRAMES + 2));
        assert!(!setup.file().exists(), "it has served");
    });
}

#[test]
fn a_process_that_was_killed_goes_on_where_it_was() {
    run(async {
        let setup = Setup::new().await;
        let session = setup.spilled(options(setup.folder.path(), 1 << 24)).await;
        let killed = setup.killed();
        drop(session);
        setup.proxy.open();
        let mut session = setup.session(options(killed.path(), 1 << 24)).await;
        let left = session.left_over().unwrap();
        assert_eq!((left.items, left.last_sequence), (KEYFRAMES as u64, KEYFRAMES + 1));
        assert_eq!(left.damage, None);
        assert_eq!(session.next_sequence(), KEYFRAMES + 2);
        session.send(keyframe(KEYFRAMES)).await.unwrap();
        let report = session.finish().await.unwrap();
        let all = KEYFRAMES as u64 + 1;
        assert_eq!((report.sent, report.acknowledged, report.rejected), (all, all, 0));
        assert_eq!(setup.counts().await, (KEYFRAMES + 1, KEYFRAMES + 3));
        // What was sent twice does no harm: the file of the session that was dropped holds it too.
        let session = setup.session(options(setup.folder.path(), 1 << 24)).await;
        let report = session.finish().await.unwrap();
        assert_eq!((report.acknowledged, report.duplicates), (all - 1, all - 1));
        assert_eq!(setup.counts().await, (KEYFRAMES + 1, KEYFRAMES + 3));
    });
}

#[test]
fn a_session_that_ends_early_leaves_what_memory_held() {
    run(async {
        let setup = Setup::new().await;
        let mut session = setup.session(options(setup.folder.path(), 1 << 24)).await;
        session.send(camera(0)).await.unwrap();
        session.flush().await.unwrap();
        setup.lose_link();
        session.send(keyframe(0)).await.unwrap();
        assert_eq!(fs_err::metadata(setup.file()).unwrap().len(), 0, "memory serves");
        drop(session);
        setup.proxy.open();
        let session = setup.session(options(setup.folder.path(), 1 << 24)).await;
        assert_eq!(session.left_over().unwrap().items, 1);
        session.finish().await.unwrap();
        assert_eq!(setup.counts().await, (1, 3));
    });
}

#[test]
fn a_damaged_file_is_named_and_gives_what_stands_before_the_damage() {
    run(async {
        let setup = Setup::new().await;
        let session = setup.spilled(options(setup.folder.path(), 1 << 24)).await;
        let killed = setup.killed();
        drop(session);
        let path = killed.path().join("room.robot.spill");
        let mut bytes = fs_err::read(&path).unwrap();
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        fs_err::write(&path, &bytes).unwrap();
        setup.proxy.open();
        let session = setup.session(options(killed.path(), 1 << 24)).await;
        let left = session.left_over().unwrap().clone();
        let damage = left.damage.unwrap();
        assert!(damage.offset <= middle as u64, "{damage:?}");
        assert_eq!(damage.offset + damage.bytes, bytes.len() as u64);
        assert!(damage.moved_to.exists());
        assert!((1..KEYFRAMES as u64).contains(&left.items), "{}", left.items);
        let report = session.finish().await.unwrap();
        assert_eq!((report.acknowledged, report.rejected), (left.items, 0));
        assert_eq!(setup.counts().await.1, left.last_sequence + 1);
    });
}

#[test]
fn items_for_a_map_that_is_gone_are_kept_and_not_sent() {
    run(async {
        let setup = Setup::new().await;
        drop(setup.spilled(options(setup.folder.path(), 1 << 24)).await);
        let before = fs_err::read(setup.file()).unwrap();
        setup.proxy.open();
        let client = Client::connect(&setup.proxy.url()).await.unwrap();
        client.delete_map("room").await.unwrap();
        setup.server.create_map("room").await;
        let options = options(setup.folder.path(), 1 << 24);
        let error = client.ingest("room", "robot", options).await.unwrap_err();
        assert!(matches!(error, ClientError::SpillOfAnotherMap { .. }), "{error}");
        assert!(error.to_string().contains("room.robot.spill"), "{error}");
        assert_eq!(fs_err::read(setup.file()).unwrap(), before);
    });
}

#[test]
fn past_the_longest_file_sending_waits_again() {
    run(async {
        let setup = Setup::new().await;
        let mut session = setup.session(options(setup.folder.path(), 20_000)).await;
        session.send(camera(0)).await.unwrap();
        session.flush().await.unwrap();
        setup.lose_link();
        let mut id = 0;
        while session.send(keyframe(id)).now_or_never().is_some() {
            id += 1;
        }
        assert!((IN_MEMORY as i64 + 1..KEYFRAMES).contains(&id), "{id}");
        assert!(fs_err::metadata(setup.file()).unwrap().len() <= 20_000);
        setup.proxy.open();
        for id in id..KEYFRAMES {
            session.send(keyframe(id)).await.unwrap();
        }
        let report = session.finish().await.unwrap();
        assert_eq!((report.unanswered(), report.rejected), (0, 0));
        assert_eq!(setup.counts().await, (KEYFRAMES, KEYFRAMES + 2));
    });
}
