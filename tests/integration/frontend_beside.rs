//! The reference frontend tracks beside the server: it waits for nothing, loses nothing that is held,
//! and takes what comes back. Short rendered sequences; the server is real, its link is a relay that
//! the test holds and cuts at given frames.

use std::sync::{Arc, Mutex, OnceLock, mpsc};

use covis::client::{Client, ClientError, SessionOptions};
use covis::frontend::camera::FrameCamera;
use covis::frontend::image::{Image, RgbdFrame};
use covis::frontend::input::{FrameError, FrameSource, SensorTiming};
use covis::frontend::mapping::run::{Companion, MOST_HELD, RunReport, Target, run as track};
use covis::frontend::pipeline::{Outcome, Pipeline, PipelineOptions, TrackedFrame};
use covis::frontend::synthetic::{SceneName, Sequence, SequenceOptions};
use covis::wire::v1;
use covis_solvers::geometry::{LieGroup, PinholeRadialTangential};
use tokio::sync::Notify;

use crate::common::{TestServer, run};
use crate::proxy::Proxy;

const FRAMES: usize = 24;
pub(crate) const CLIENT: &str = "frontend";

/// A camera that turns in a room by 6° a frame, so that each third frame is a keyframe.
pub(crate) fn sequence() -> Sequence {
    let options = SequenceOptions { width: 320, height: 240, frames: 60, seed: 1, noise: false };
    Sequence::new(SceneName::Loop, &options)
}

/// Its first frames, rendered once for all tests.
pub(crate) fn frames() -> &'static [RgbdFrame] {
    static ALL: OnceLock<Vec<RgbdFrame>> = OnceLock::new();
    ALL.get_or_init(|| (0..FRAMES).map(|index| sequence().frame(index)).collect())
}

pub(crate) fn camera() -> &'static PinholeRadialTangential {
    static CAMERA: OnceLock<PinholeRadialTangential> = OnceLock::new();
    CAMERA.get_or_init(|| *sequence().camera())
}

pub(crate) fn pipeline() -> Pipeline {
    let camera = FrameCamera::new(*camera(), 320, 240).unwrap();
    Pipeline::new(camera, PipelineOptions::default())
}

/// What tracking gives without any server.
fn alone() -> Vec<TrackedFrame> {
    let mut pipeline = pipeline();
    frames().iter().filter_map(|frame| pipeline.track(frame, None).tracked).collect()
}

/// Calls back after each frame, with how many there were and whether it has a pose.
pub(crate) struct AfterFrame<F> {
    pub(crate) frames: usize,
    pub(crate) call: F,
}

impl<F: FnMut(usize, bool)> Companion for AfterFrame<F> {
    fn mask(&mut self, _timestamp_s: f64) -> Option<Image<u8>> {
        None
    }

    fn tracked(&mut self, _frame: &RgbdFrame, outcome: &Outcome) {
        self.frames += 1;
        (self.call)(self.frames, outcome.tracked.is_some());
    }

    fn skipped(&mut self, _error: &FrameError) {}
}

/// A run of the sequence into the map "m", which is created.
async fn run_with(
    client: &Client,
    (lock_step, most_held): (bool, usize),
    mut call: impl FnMut(usize) + Send + 'static,
) -> Result<RunReport, ClientError> {
    client.create_map("m", None).await?;
    let target = Target { client, map_id: "m", client_id: CLIENT, lock_step, most_held };
    let source = Box::new(Frames { frames: Arc::new(frames().to_vec()), next: 0 });
    let companion = AfterFrame { frames: 0, call: move |frames, _| call(frames) };
    let (report, companion) = track(source, pipeline(), target, false, companion, None).await?;
    assert_eq!(companion.frames, FRAMES);
    Ok(report)
}

pub(crate) async fn connected(server: &TestServer) -> Client {
    Client::connect(&format!("http://{}", server.running.local_addr())).await.unwrap()
}

pub(crate) async fn relayed() -> (TestServer, Arc<Proxy>, Client) {
    let server = TestServer::start().await;
    let proxy = Arc::new(Proxy::to(server.running.local_addr()).await);
    let client = Client::connect(&proxy.url()).await.unwrap();
    (server, proxy, client)
}

async fn map(server: &TestServer) -> v1::Map {
    let request = v1::GetMapRequest { map_id: "m".into(), ..Default::default() };
    server.maps().get_map(request).await.unwrap().into_inner().map.unwrap()
}

/// The keyframes and landmarks that the server has.
async fn counts(server: &TestServer) -> (usize, usize) {
    let counts = map(server).await.counts.unwrap();
    (counts.keyframe_count as usize, counts.landmark_count as usize)
}

#[test]
fn tracking_goes_through_while_the_server_does_not_answer_and_then_all_is_sent() {
    run(async {
        let (server, proxy, client) = relayed().await;
        let all_tracked = Arc::new(Notify::new());
        let (link, done) = (Arc::clone(&proxy), Arc::clone(&all_tracked));
        let running = run_with(&client, (false, MOST_HELD), move |frames| {
            if frames == 1 {
                // No keyframe is made before the second frame.
                link.hold(true);
            }
            if frames == FRAMES {
                done.notify_one();
            }
        });
        let answering = async {
            all_tracked.notified().await;
            proxy.hold(false);
        };
        let (report, ()) = tokio::join!(running, answering);
        let report = report.unwrap();
        assert_eq!(report.live, alone(), "nothing came back while frames were tracked");
        assert_eq!((report.corrections, report.left_out), (0, 0));
        assert!(report.failure.is_none(), "{:?}", report.failure);
        let keyframes = report.keyframes.len();
        assert!(keyframes >= 5, "{keyframes}");
        assert_eq!(report.most_held, keyframes, "all waited at once");
        assert_eq!(counts(&server).await, (keyframes, report.landmarks));
        assert_eq!(report.trajectory.len(), FRAMES);
    });
}

#[test]
fn a_link_that_breaks_loses_no_keyframe_and_odometry_does_not_jump() {
    run(async {
        let (server, proxy, client) = relayed().await;
        let link = Arc::clone(&proxy);
        let report = run_with(&client, (false, MOST_HELD), move |frames| {
            if frames == FRAMES / 2 {
                link.cut();
            }
        });
        let report = report.await.unwrap();
        assert!(report.failure.is_none() && report.reconnects >= 1, "{report:?}");
        let keyframes = report.keyframes.len();
        assert_eq!((report.left_out, report.lost()), (0, 0));
        assert_eq!(counts(&server).await, (keyframes, report.landmarks));
        let sequence = sequence();
        for (index, pair) in report.live.windows(2).enumerate() {
            let pose = |index: usize| sequence.world_from_camera(index);
            let truth = pose(index).inverse().compose(&pose(index + 1));
            let odometry = pair[0].odom_from_camera.inverse().compose(&pair[1].odom_from_camera);
            let error = truth.inverse().compose(&odometry).log().norm();
            assert!(error < 0.01, "frame {index}: odometry is off by {error}");
        }
    });
}

#[test]
fn a_server_that_is_lost_for_good_leaves_a_whole_trajectory() {
    run(async {
        let server = TestServer::start().await;
        let client = connected(&server).await;
        let (reached, is_deleted) = (Arc::new(Notify::new()), mpsc::channel());
        let (at_half, (deleted, wait)) = (Arc::clone(&reached), is_deleted);
        let running = run_with(&client, (false, MOST_HELD), move |frames| {
            if frames == FRAMES / 2 {
                at_half.notify_one();
                wait.recv().unwrap();
            }
        });
        let deleting = async {
            reached.notified().await;
            client.delete_map("m").await.unwrap();
            deleted.send(()).unwrap();
        };
        let (report, ()) = tokio::join!(running, deleting);
        let report = report.unwrap();
        assert!(report.failure.is_some());
        assert_eq!((report.trajectory.len(), report.lost()), (FRAMES, 0));
        assert!(report.keyframes.len() >= 5, "{}", report.keyframes.len());
    });
}

#[test]
fn keyframes_beyond_the_queue_are_left_out_and_reported() {
    run(async {
        let (server, proxy, client) = relayed().await;
        let all_tracked = Arc::new(Notify::new());
        let (link, done) = (Arc::clone(&proxy), Arc::clone(&all_tracked));
        let running = run_with(&client, (false, 2), move |frames| {
            if frames == 1 {
                link.hold(true);
            }
            if frames == FRAMES {
                done.notify_one();
            }
        });
        let answering = async {
            all_tracked.notified().await;
            proxy.hold(false);
        };
        let (report, ()) = tokio::join!(running, answering);
        let report = report.unwrap();
        assert!(report.failure.is_none(), "{:?}", report.failure);
        assert_eq!((report.most_held, report.left_out), (2, report.keyframes.len() - 2));
        assert_eq!(counts(&server).await.0, 2);
        // What was left out has a place in the trajectory all the same.
        assert_eq!((report.live.len(), report.trajectory.len()), (FRAMES, FRAMES));
    });
}

#[test]
fn a_run_without_room_for_two_keyframes_sends_what_the_server_takes() {
    run(async {
        let server = TestServer::start().await;
        let client = connected(&server).await;
        // Which ones are sent depends on the server's pace; that none is refused does not: landmarks
        // come with the first keyframe that is sent and sees them.
        let report = run_with(&client, (false, 1), |_| {}).await.unwrap();
        assert!(report.failure.is_none(), "{:?}", report.failure);
        let sent = report.keyframes.len() - report.left_out;
        assert_eq!((counts(&server).await.0, report.most_held), (sent, 1));
    });
}

#[test]
fn loops_of_others_come_back_and_descriptors_go_out_in_both_modes() {
    for lock_step in [false, true] {
        run(async {
            let server = TestServer::start().await;
            let client = connected(&server).await;
            let (reached, (closed, wait)) = (Arc::new(Notify::new()), mpsc::channel());
            let near_the_end = Arc::clone(&reached);
            let wait = Mutex::new(wait);
            let running = run_with(&client, (lock_step, MOST_HELD), move |frames| {
                if frames == FRAMES - 2 {
                    near_the_end.notify_one();
                    wait.lock().unwrap().recv().unwrap();
                }
            });
            let closing = async {
                reached.notified().await;
                // The server has both keyframes when they are in a watcher's mirror.
                let mut watch = client.watch("m", Default::default()).await.unwrap();
                let poses = loop {
                    let mirror = watch.next().await.unwrap();
                    let of = |id: i64| mirror.keyframes.get(&(CLIENT.to_owned(), id)).cloned();
                    if let (Some(a), Some(b)) = (of(0), of(3)) {
                        break [a, b].map(|keyframe| {
                            let pose = keyframe.world_from_camera.unwrap();
                            covis::frontend::mapping::messages::se3(&pose).unwrap()
                        });
                    }
                };
                let keyframe = |id: i64| Some(v1::KeyframeRef { client_id: CLIENT.into(), id });
                let measured = poses[0].inverse().compose(&poses[1]);
                let mut upper_triangle = vec![0.0; 21];
                for diagonal in [0, 6, 11, 15, 18, 20] {
                    upper_triangle[diagonal] = 1e4;
                }
                let options = SessionOptions::default();
                let mut session = client.ingest("m", "finder", options).await.unwrap();
                let closure = v1::RelativePoseConstraint {
                    id: 0,
                    keyframe_i: keyframe(0),
                    keyframe_j: keyframe(3),
                    keyframe_i_from_keyframe_j: Some(covis::frontend::mapping::messages::rigid(
                        &measured,
                    )),
                    information: Some(v1::InformationMatrix6 { upper_triangle }),
                    kind: v1::ConstraintKind::LoopClosure.into(),
                    ..Default::default()
                };
                session.send(closure).await.unwrap();
                let answered = session.finish().await.unwrap();
                assert_eq!(answered.acknowledged, 1, "{answered:?}");
                closed.send(()).unwrap();
            };
            let (report, ()) = tokio::join!(running, closing);
            let report = report.unwrap();
            assert!(report.failure.is_none(), "{:?}", report.failure);
            assert_eq!((report.loops.counting, report.loops.switched_off), (1, 0));
            assert_eq!(report.lost(), 0);

            let mask = prost_types::FieldMask { paths: vec!["observations".into()] };
            let listed = client.keyframes("m", Some(mask)).await.unwrap();
            assert!(!listed.keyframes.is_empty());
            let observations: Vec<_> =
                listed.keyframes.iter().flat_map(|keyframe| &keyframe.observations).collect();
            let described: Vec<_> =
                observations.iter().filter_map(|seen| seen.descriptor.as_ref()).collect();
            // A landmark within 15 px of the image's border has none.
            assert!(described.len() * 2 > observations.len(), "{}", described.len());
            for descriptor in described {
                assert_eq!(descriptor.kind(), v1::DescriptorKind::Binary);
                assert_eq!(descriptor.data.len(), 32);
            }
        });
    }
}

#[test]
fn loops_that_the_server_finds_come_back_and_lock_step_repeats_to_the_bit() {
    run(async {
        // The whole turn, and on over its beginning, which tracking has forgotten by then.
        let at = |index: usize| {
            let frame = sequence().frame(if index < 60 { index } else { index - 59 });
            RgbdFrame { timestamp_s: 1.0 + index as f64 / 30.0, ..frame }
        };
        let all: Arc<Vec<RgbdFrame>> = Arc::new((0..75).map(at).collect());
        let mut reports = Vec::new();
        for _ in 0..2 {
            let server = TestServer::start().await;
            let client = connected(&server).await;
            client.create_map("m", None).await.unwrap();
            let target = Target {
                client: &client,
                map_id: "m",
                client_id: CLIENT,
                lock_step: true,
                most_held: MOST_HELD,
            };
            let camera = FrameCamera::new(*camera(), 320, 240).unwrap();
            let options = PipelineOptions { most_keyframes: 5, ..PipelineOptions::default() };
            let source = Box::new(Frames { frames: Arc::clone(&all), next: 0 });
            let companion = AfterFrame { frames: 0, call: |_, _| {} };
            let pipeline = Pipeline::new(camera, options);
            let (report, _) =
                track(source, pipeline, target, false, companion, None).await.unwrap();
            assert!(report.keyframes.len() > 15, "{} keyframes", report.keyframes.len());
            reports.push(report);
        }
        assert_eq!(reports[0].live, reports[1].live);
        assert_eq!(reports[0].trajectory, reports[1].trajectory);
        assert_eq!(reports[0].keyframes, reports[1].keyframes);
        assert_eq!(reports[0].loops, reports[1].loops);
        // The start was seen again under other ids: only descriptors tell that it is one place.
        assert!(reports[0].loops.counting > 0, "{:?}", reports[0].loops);
        assert_eq!(reports[0].lost(), 0);
    });
}

/// Frames as a source.
pub(crate) struct Frames {
    pub(crate) frames: Arc<Vec<RgbdFrame>>,
    pub(crate) next: usize,
}

impl FrameSource for Frames {
    fn camera(&self) -> &PinholeRadialTangential {
        camera()
    }

    fn timing(&self) -> SensorTiming {
        SensorTiming::default()
    }

    fn len(&self) -> usize {
        self.frames.len()
    }

    fn next_frame(&mut self) -> Option<Result<RgbdFrame, FrameError>> {
        self.next += 1;
        Some(Ok(self.frames.get(self.next - 1)?.clone()))
    }
}
