//! Helpers of the tests over the wire: a server on a free loopback port, a small scene with known
//! geometry, ingest streams, and checks of statuses with their details.
//!
//! The scene: cameras in a row looking along +z at a grid of landmarks, exact pixels, start values
//! that are a little off by a fixed pattern. No randomness.

use std::future::Future;
use std::pin::Pin;
use std::sync::Arc;
use std::time::Duration;

use covis::service::engine::{Estimate, SolverPool};
use covis::service::{RunningServer, Server, ServerConfig};
use covis::wire::v1;
use covis_solvers::price::{Ceiling, Price};
use tokio::sync::mpsc;
use tokio_stream::wrappers::ReceiverStream;
use tonic::transport::{Channel, Endpoint};
use tonic::{Code, Request, Status, Streaming};
use tonic_types::StatusExt;
use v1::ingest_request::Item;
use v1::ingest_response::Event;
use v1::ingest_service_client::IngestServiceClient;
use v1::map_service_client::MapServiceClient;
use v1::optimization_service_client::OptimizationServiceClient;

/// Runs a test; a stream that never answers fails it instead of hanging the suite. The longest test takes
/// a minute of an idle machine.
pub(crate) fn run(test: impl Future<Output = ()>) {
    run_boxed(Box::pin(test));
}

/// Apart from [`run`], so that the runtime's code is compiled once and not for each test.
fn run_boxed(test: Pin<Box<dyn Future<Output = ()> + '_>>) {
    let runtime =
        tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap();
    runtime.block_on(async {
        tokio::time::timeout(Duration::from_secs(900), test).await.expect("the test hangs");
    });
}

/// A server with a channel to it.
pub(crate) struct TestServer {
    pub(crate) running: RunningServer,
    pub(crate) channel: Channel,
}

impl TestServer {
    pub(crate) async fn start() -> Self {
        Self::with(|_| {}).await
    }

    /// A server whose fault hook is set.
    pub(crate) async fn with_fault(fault: &str) -> Self {
        Self::with(|config| config.test_fault = Some(fault.to_owned())).await
    }

    /// A server on which each solve finishes before the next item is taken.
    pub(crate) async fn lock_step() -> Self {
        Self::with(|config| config.engine.lock_step = true).await
    }

    pub(crate) fn with(change: impl FnOnce(&mut ServerConfig)) -> impl Future<Output = Self> {
        let mut config = ServerConfig { threads: 1, ..ServerConfig::default() };
        change(&mut config);
        Self::of(config)
    }

    async fn of(config: ServerConfig) -> Self {
        let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
        let running = Server::start(listener, config).await.unwrap();
        let url = format!("http://{}", running.local_addr());
        let channel = Endpoint::from_shared(url).unwrap().connect().await.unwrap();
        Self { running, channel }
    }

    pub(crate) fn maps(&self) -> MapServiceClient<Channel> {
        MapServiceClient::new(self.channel.clone()).max_decoding_message_size(16 << 20)
    }

    pub(crate) fn optimization(&self) -> OptimizationServiceClient<Channel> {
        OptimizationServiceClient::new(self.channel.clone())
    }

    /// Creates a map with the default policy.
    pub(crate) async fn create_map(&self, map_id: &str) -> v1::Map {
        self.create_map_with(map_id, v1::MapPolicy::default()).await
    }

    pub(crate) async fn create_map_with(&self, map_id: &str, policy: v1::MapPolicy) -> v1::Map {
        let request = v1::CreateMapRequest {
            map_id: map_id.to_owned(),
            display_name: String::new(),
            policy: Some(policy),
        };
        self.maps().create_map(request).await.unwrap().into_inner().map.unwrap()
    }

    /// Sends the scene's first `keyframes` keyframes of client "robot" and waits for all acks.
    pub(crate) async fn build_map(&self, map_id: &str, keyframes: i64) {
        let (stream, _) = Stream::open(self, map_id, "robot", 0).await;
        stream.send(1, Item::Camera(camera(0))).await;
        for id in 0..keyframes {
            stream.send(id + 2, Item::Keyframe(keyframe(id))).await;
        }
        for ack in stream.finish().await.unwrap() {
            assert!(ack.violations.is_empty(), "{ack:?}");
        }
    }
}

impl TestServer {
    /// A small map as a new watcher gets it.
    pub(crate) async fn watched(&self, map_id: &str) -> v1::MapDelta {
        let request = v1::WatchMapRequest { map_id: map_id.to_owned(), ..Default::default() };
        let mut stream = self.maps().watch_map(request).await.unwrap().into_inner();
        let delta = stream.message().await.unwrap().unwrap().delta.unwrap();
        assert!(delta.reset && delta.last_part);
        delta
    }

    /// Runs `OptimizeMap` to its end.
    pub(crate) async fn optimize_map(
        &self,
        request: v1::OptimizeMapRequest,
    ) -> Result<(Vec<v1::IterationSummary>, v1::OptimizeMapResult), Status> {
        let mut stream = self.optimization().optimize_map(request).await?.into_inner();
        let mut rows = Vec::new();
        while let Some(message) = stream.message().await? {
            match message.event.expect("an event") {
                v1::optimize_map_response::Event::Iteration(row) => rows.push(row),
                v1::optimize_map_response::Event::Result(result) => {
                    assert!(stream.message().await?.is_none(), "the result comes last, once");
                    return Ok((rows, result));
                }
            }
        }
        panic!("the stream ended without a result");
    }

    /// A map that a bug has poisoned.
    pub(crate) async fn with_poisoned_map(map_id: &str) -> Self {
        let server = Self::with_fault("panic-in-engine").await;
        server.create_map(map_id).await;
        let (mut stream, _) = Stream::open(&server, map_id, "robot", 0).await;
        stream.send(1, Item::Camera(camera(0))).await;
        check_status(&stream.end().await, Code::Internal, "BUG");
        server
    }
}

/// Holds the threads of a solver pool that has one of each kind, until it is dropped: what is asked
/// for next waits.
pub(crate) struct Occupied {
    _release: [std::sync::mpsc::Sender<()>; 2],
}

impl Occupied {
    pub(crate) async fn new(pool: &Arc<SolverPool>) -> Self {
        assert_eq!(pool.threads(), 1);
        let release = [hold(pool, small()).await, hold(pool, large()).await];
        Self { _release: release }
    }
}

/// Holds one thread for solves of that size until the answer is dropped.
pub(crate) async fn hold(
    pool: &Arc<SolverPool>,
    estimate: Estimate,
) -> std::sync::mpsc::Sender<()> {
    let (release, released) = std::sync::mpsc::channel();
    let (begun, began) = tokio::sync::oneshot::channel();
    let work = move || begun.send(()).is_ok() && released.recv().is_ok();
    let pool = Arc::clone(pool);
    tokio::spawn(async move { pool.run(&pool.accounts().tenant(""), estimate, work).await });
    began.await.unwrap();
    release
}

/// What a small solve is expected to take.
pub(crate) fn small() -> Estimate {
    Estimate::new(Price::default(), 1, &Ceiling::NONE)
}

/// The same of a large one, of 1 GiB.
pub(crate) fn large() -> Estimate {
    Estimate::new(Price { bytes: 1 << 30, flops_per_iteration: 1e12 }, 1, &Ceiling::NONE)
}

/// [`Occupied`] for a server.
pub(crate) async fn occupy(server: &TestServer) -> Occupied {
    Occupied::new(&server.running.solver_pool()).await
}

/// A request with a bearer token, where it is not empty.
pub(crate) fn bearing<T>(token: &str, message: T) -> Request<T> {
    let mut request = Request::new(message);
    if !token.is_empty() {
        let value = format!("Bearer {token}").parse().unwrap();
        request.metadata_mut().insert("authorization", value);
    }
    request
}

/// An ingest stream.
pub(crate) struct Stream {
    requests: Option<mpsc::Sender<v1::IngestRequest>>,
    answers: Streaming<v1::IngestResponse>,
}

impl Stream {
    /// Opens a stream and reads the answer.
    pub(crate) async fn open(
        server: &TestServer,
        map_id: &str,
        client_id: &str,
        epoch: i64,
    ) -> (Self, v1::IngestOpened) {
        Self::open_with(server, "", map_id, client_id, epoch).await
    }

    /// As [`Stream::open`] with a bearer token.
    pub(crate) async fn open_with(
        server: &TestServer,
        token: &str,
        map_id: &str,
        client_id: &str,
        epoch: i64,
    ) -> (Self, v1::IngestOpened) {
        let mut stream = Self::connect_with(server, token).await;
        stream.send(0, open_item(map_id, client_id, epoch)).await;
        match stream.event().await.unwrap() {
            Event::Opened(opened) => (stream, opened),
            Event::Ack(ack) => panic!("an ack before opened: {ack:?}"),
        }
    }

    /// A stream before its first message.
    pub(crate) async fn connect(server: &TestServer) -> Self {
        Self::connect_with(server, "").await
    }

    async fn connect_with(server: &TestServer, token: &str) -> Self {
        let (requests, receiver) = mpsc::channel(16);
        let mut client = IngestServiceClient::new(server.channel.clone());
        let request = bearing(token, ReceiverStream::new(receiver));
        let answers = client.ingest(request).await.unwrap().into_inner();
        Self { requests: Some(requests), answers }
    }

    pub(crate) async fn send(&self, sequence: i64, item: Item) {
        self.send_message(v1::IngestRequest { sequence, item: Some(item) }).await;
    }

    pub(crate) async fn send_message(&self, message: v1::IngestRequest) {
        // A stream that has ended takes no more; its answers tell why.
        let _ended = self.requests.as_ref().expect("not closed").send(message).await;
    }

    /// The next event, or how the stream ended.
    pub(crate) async fn event(&mut self) -> Result<Event, Status> {
        let answer = self.answers.message().await?;
        Ok(answer.expect("the stream goes on").event.expect("an event"))
    }

    /// The RECEIVED or REJECTED ack of an item; other acks on the way are skipped.
    pub(crate) async fn answer(&mut self, sequence: i64) -> v1::IngestAck {
        loop {
            let Event::Ack(ack) = self.event().await.unwrap() else { panic!("opened twice") };
            let status = ack.status();
            if matches!(status, v1::AckStatus::Received | v1::AckStatus::Rejected) {
                assert_eq!(ack.sequence, sequence, "acks come in the order of the items");
                return ack;
            }
        }
    }

    /// Sends an item and waits for its ack.
    pub(crate) async fn put(&mut self, sequence: i64, item: Item) -> v1::IngestAck {
        self.send(sequence, item).await;
        self.answer(sequence).await
    }

    /// Half-closes and reads the rest.
    pub(crate) async fn finish(mut self) -> Result<Vec<v1::IngestAck>, Status> {
        self.requests = None;
        let mut acks = Vec::new();
        while let Some(answer) = self.answers.message().await? {
            match answer.event.expect("an event") {
                Event::Ack(ack) => acks.push(ack),
                Event::Opened(_) => panic!("opened twice"),
            }
        }
        Ok(acks)
    }

    /// Reads until the stream ends badly.
    pub(crate) async fn end(&mut self) -> Status {
        loop {
            match self.answers.message().await {
                Ok(Some(_)) => {}
                Ok(None) => panic!("the stream ended well"),
                Err(status) => return status,
            }
        }
    }
}

pub(crate) fn open_item(map_id: &str, client_id: &str, epoch: i64) -> Item {
    let (map_id, client_id) = (map_id.to_owned(), client_id.to_owned());
    Item::Open(v1::IngestOpen { map_id, client_id, epoch, options: None })
}

/// Focal length, px.
pub(crate) const FOCAL: f64 = 500.0;
/// Principal point, px.
pub(crate) const CENTER: [f64; 2] = [319.5, 239.5];
/// Landmarks of the scene.
pub(crate) const LANDMARKS: i64 = 60;

pub(crate) fn camera(id: i64) -> v1::Camera {
    let model = v1::PinholeRadialTangential {
        fx: FOCAL,
        fy: FOCAL,
        cx: CENTER[0],
        cy: CENTER[1],
        ..Default::default()
    };
    v1::Camera {
        id,
        width_px: 640,
        height_px: 480,
        model: Some(v1::camera::Model::PinholeRadialTangential(model)),
        ..Default::default()
    }
}

pub(crate) fn vector3([x, y, z]: [f64; 3]) -> v1::Vector3 {
    v1::Vector3 { x, y, z }
}

/// A transform without rotation.
pub(crate) fn shift(translation: [f64; 3]) -> v1::RigidTransform {
    v1::RigidTransform {
        translation: Some(vector3(translation)),
        rotation: Some(v1::Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
    }
}

/// True position of a landmark.
pub(crate) fn landmark_position(id: i64) -> [f64; 3] {
    let k = id as f64;
    let (column, row) = ((k % 10.0), (k / 10.0).floor() % 6.0);
    [-1.6 + 0.4 * column, -1.1 + 0.4 * row, 4.0 + 0.35 * ((k * 7.0) % 5.0)]
}

/// True position of a keyframe; rotations are the identity.
pub(crate) fn keyframe_position(id: i64) -> [f64; 3] {
    let k = id as f64;
    [0.12 * k, 0.03 * (k % 3.0), 0.02 * (k % 2.0)]
}

/// The pixel of a landmark in a keyframe.
pub(crate) fn pixel(keyframe: i64, landmark: i64) -> v1::Vector2 {
    let (c, p) = (keyframe_position(keyframe), landmark_position(landmark));
    let z = p[2] - c[2];
    v1::Vector2 {
        x: FOCAL * (p[0] - c[0]) / z + CENTER[0],
        y: FOCAL * (p[1] - c[1]) / z + CENTER[1],
    }
}

pub(crate) fn observation(keyframe: i64, landmark: i64) -> v1::Observation {
    v1::Observation {
        landmark: Some(v1::LandmarkRef { id: landmark, ..Default::default() }),
        pixel: Some(pixel(keyframe, landmark)),
        ..Default::default()
    }
}

/// A landmark with a start value that is a little off.
pub(crate) fn landmark(id: i64) -> v1::Landmark {
    let p = landmark_position(id);
    let off = |phase: f64| 0.02 * (id as f64 + phase).sin();
    let start = [p[0] + off(0.0), p[1] + off(1.0), p[2] + off(2.0)];
    v1::Landmark { id, point_in_world: Some(vector3(start)), ..Default::default() }
}

/// A keyframe of camera 0 that sees all landmarks; the first brings them along.
pub(crate) fn keyframe(id: i64) -> v1::Keyframe {
    let [x, y, z] = keyframe_position(id);
    let off = if id == 0 { 0.0 } else { 0.01 };
    v1::Keyframe {
        id,
        capture_time: Some(prost_types::Timestamp { seconds: 100 + id, nanos: 500_000_000 }),
        sensor: Some(v1::keyframe::Sensor::CameraId(0)),
        world_from_camera: Some(shift([x + off, y - off, z])),
        observations: (0..LANDMARKS).map(|k| observation(id, k)).collect(),
        landmarks: if id == 0 { (0..LANDMARKS).map(landmark).collect() } else { Vec::new() },
        ..Default::default()
    }
}

/// The upper triangle of `n` × `n` times `scale`.
/// The descriptor of a whole image.
pub(crate) fn image_descriptor(numbers: &[f32]) -> v1::Descriptor {
    let data = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
    v1::Descriptor { kind: v1::DescriptorKind::Float32.into(), name: "vlad".to_owned(), data }
}

pub(crate) fn diagonal(n: usize, scale: f64) -> Vec<f64> {
    let entry = move |row, column| if row == column { scale } else { 0.0 };
    (0..n).flat_map(|row| (row..n).map(move |column| entry(row, column))).collect()
}

pub(crate) fn information6(scale: f64) -> v1::InformationMatrix6 {
    v1::InformationMatrix6 { upper_triangle: diagonal(6, scale) }
}

pub(crate) fn information3(scale: f64) -> v1::InformationMatrix3 {
    v1::InformationMatrix3 { upper_triangle: diagonal(3, scale) }
}

/// A true relative pose between two keyframes of the scene.
pub(crate) fn relative_pose(id: i64, i: i64, j: i64) -> v1::RelativePoseConstraint {
    let (a, b) = (keyframe_position(i), keyframe_position(j));
    v1::RelativePoseConstraint {
        id,
        keyframe_i: Some(v1::KeyframeRef { id: i, ..Default::default() }),
        keyframe_j: Some(v1::KeyframeRef { id: j, ..Default::default() }),
        keyframe_i_from_keyframe_j: Some(shift([b[0] - a[0], b[1] - a[1], b[2] - a[2]])),
        information: Some(information6(100.0)),
        kind: v1::ConstraintKind::Odometry.into(),
        ..Default::default()
    }
}

/// The scene with `poses` keyframes as a bundle.
pub(crate) fn bundle(poses: i64) -> v1::BundleProblem {
    let observations = (0..poses).flat_map(|pose| {
        (0..LANDMARKS).map(move |point| v1::BundleObservation {
            pose_index: pose as i32,
            point_index: point as i32,
            pixel: Some(pixel(pose, point)),
            ..Default::default()
        })
    });
    v1::BundleProblem {
        cameras: vec![camera(0)],
        poses: (0..poses)
            .map(|k| v1::BundlePose {
                camera_index: 0,
                world_from_camera: keyframe(k).world_from_camera,
                fixed: k < 2,
            })
            .collect(),
        points: (0..LANDMARKS)
            .map(|k| v1::BundlePoint { point_in_world: landmark(k).point_in_world, fixed: false })
            .collect(),
        observations: observations.collect(),
    }
}

/// Checks code, `ErrorInfo` and, for bad fields, that the field is named.
#[track_caller]
pub(crate) fn check_status(status: &Status, code: Code, reason: &str) {
    assert_eq!(status.code(), code, "{status:?}");
    let info = status.get_details_error_info().expect("an ErrorInfo");
    assert_eq!((info.domain.as_str(), info.reason.as_str()), ("covis", reason), "{status:?}");
}

/// Checks that a status refuses `field` for `reason`.
#[track_caller]
pub(crate) fn check_field(status: &Status, field: &str, reason: &str) {
    let expected =
        if reason == "UNIMPLEMENTED" { Code::Unimplemented } else { Code::InvalidArgument };
    check_status(status, expected, reason);
    let request = status.get_details_bad_request().expect("a BadRequest");
    let first = request.field_violations.first().expect("a violation");
    assert_eq!((first.field.as_str(), first.reason.as_str()), (field, reason));
    assert!(!first.description.is_empty());
}

/// Checks that a status says when to come back.
#[track_caller]
pub(crate) fn check_retry(status: &Status) {
    let retry = status.get_details_retry_info().expect("a RetryInfo");
    assert!(retry.retry_delay.is_some_and(|delay| !delay.is_zero()));
}
