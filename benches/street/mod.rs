//! A robot that walks a street, and what it waits for; several benches have it.
//!
//! Each keyframe is 0.3 m further and sees every landmark in consecutive keyframes; poses and pixels
//! carry noise that is the same for the same numbers.

#![allow(dead_code, reason = "each bench takes what it needs")]

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use covis::client::{Client, ClientError, IngestSession, SessionOptions, WatchOptions};
use covis::wire::v1;

use crate::timing::milliseconds;

/// How long keyframes of a session waited, in seconds.
#[derive(Default)]
pub(crate) struct Waits {
    /// On the way to RECEIVED, DURABLE and OPTIMIZED: sequence and when they were sent.
    pub(crate) unreceived: VecDeque<(i64, Instant)>,
    pub(crate) undurable: VecDeque<(i64, Instant)>,
    pub(crate) unoptimized: VecDeque<(i64, Instant)>,
    /// Optimized at a revision that watchers have not been told yet.
    pub(crate) told: VecDeque<(i64, Instant)>,
    pub(crate) watched: i64,
    pub(crate) received_s: Vec<f64>,
    pub(crate) durable_s: Vec<f64>,
    pub(crate) optimized_s: Vec<f64>,
    pub(crate) corrected_s: Vec<f64>,
}

impl Waits {
    pub(crate) fn take(&mut self, ack: &v1::IngestAck) {
        let reached = |queue: &mut VecDeque<(i64, Instant)>| {
            let count = queue.iter().take_while(|&&(sequence, _)| sequence <= ack.sequence).count();
            queue.drain(..count).map(|(_, sent)| sent).collect::<Vec<_>>()
        };
        let seconds = |sent: &Instant| sent.elapsed().as_secs_f64();
        match ack.status() {
            v1::AckStatus::Durable => {
                self.durable_s.extend(reached(&mut self.undurable).iter().map(seconds));
            }
            v1::AckStatus::Optimized => {
                let sent = reached(&mut self.unoptimized);
                self.optimized_s.extend(sent.iter().map(seconds));
                self.told.extend(sent.into_iter().map(|sent| (ack.revision, sent)));
                self.tell(self.watched);
            }
            v1::AckStatus::Received => {
                self.received_s.extend(reached(&mut self.unreceived).iter().map(seconds));
            }
            v1::AckStatus::Unspecified | v1::AckStatus::Rejected => {}
        }
    }

    /// A watcher holds `revision`.
    pub(crate) fn tell(&mut self, revision: i64) {
        self.watched = self.watched.max(revision);
        while let Some(&(needed, sent)) = self.told.front()
            && needed <= self.watched
        {
            self.told.pop_front();
            self.corrected_s.push(sent.elapsed().as_secs_f64());
        }
    }
}

pub(crate) async fn watch(
    client: Client,
    map: String,
    waits: Arc<Mutex<Waits>>,
) -> Result<(), ClientError> {
    let mut watch = client.watch(&map, WatchOptions::default()).await?;
    loop {
        let revision = watch.next().await?.revision;
        lock(&waits).tell(revision);
    }
}

pub(crate) fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

pub(crate) async fn send(
    session: &mut IngestSession,
    waits: &Mutex<Waits>,
    keyframe: v1::Keyframe,
) -> Result<(), ClientError> {
    let (sequence, now) = (session.next_sequence(), Instant::now());
    {
        let mut waits = lock(waits);
        waits.unreceived.push_back((sequence, now));
        waits.undurable.push_back((sequence, now));
        waits.unoptimized.push_back((sequence, now));
    }
    session.send_as(sequence, keyframe).await.map(|_sequence| ())
}

pub(crate) fn print_row(name: &str, seconds: &mut [f64]) {
    let [p50, p99, max] = milliseconds(seconds);
    let count = seconds.len();
    println!("{name:>20}: {count} times, p50 {p50:.2} ms, p99 {p99:.2} ms, max {max:.2} ms");
}

/// A walk along a street whose houses carry the landmarks.
#[derive(Clone, Copy)]
pub(crate) struct Street {
    /// Landmarks that a keyframe sees first.
    fresh: usize,
    /// Keyframes that see a landmark.
    span: i64,
}

const FOCAL_PX: f64 = 500.0;
const CENTER_PX: (f64, f64) = (320.0, 240.0);

impl Street {
    pub(crate) fn new(observations: usize, fresh: usize) -> Self {
        let fresh = fresh.clamp(1, observations.max(1));
        Self { fresh, span: (observations / fresh).max(1) as i64 }
    }

    /// Creates the map and opens a session with the camera sent.
    pub(crate) async fn open(
        &self,
        client: &Client,
        map: &str,
        policy: v1::MapPolicy,
        max_unanswered: usize,
        waits: &Arc<Mutex<Waits>>,
    ) -> anyhow::Result<IngestSession> {
        let options = SessionOptions {
            max_unanswered,
            omit_solve_summary: true,
            ..SessionOptions::default()
        };
        self.begin(client, map, policy, options, waits).await
    }

    /// As [`Street::open`], with other options.
    pub(crate) async fn begin(
        &self,
        client: &Client,
        map: &str,
        policy: v1::MapPolicy,
        options: SessionOptions,
        waits: &Arc<Mutex<Waits>>,
    ) -> anyhow::Result<IngestSession> {
        client.create_map(map, Some(policy)).await?;
        let seen = Arc::clone(waits);
        let options = options.on_ack(move |ack| lock(&seen).take(ack));
        let mut session = client.ingest(map, "robot", options).await?;
        session.send(camera()).await?;
        Ok(session)
    }

    /// Where landmark `index` of those that keyframe `first` sees first is.
    fn landmark(&self, first: i64, index: usize) -> [f64; 3] {
        let middle = 0.3 * (first as f64 + 0.5 * self.span as f64);
        let seed = first * 4096 + index as i64;
        [middle + scatter(seed, 1), 1.5 * scatter(seed, 2), 6.5 + 1.5 * scatter(seed, 3)]
    }

    pub(crate) fn keyframe(&self, k: i64) -> v1::Keyframe {
        let noise = |axis| 0.01 * scatter(k, axis) * f64::from(k > 0);
        let position = [0.3 * k as f64, 0.0, 0.0];
        let claimed = v1::Vector3 { x: position[0] + noise(10), y: noise(11), z: noise(12) };
        let pose = v1::RigidTransform {
            translation: Some(claimed),
            rotation: Some(v1::Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
        };
        let mut keyframe = v1::Keyframe {
            id: k,
            capture_time: Some(prost_types::Timestamp { seconds: k, nanos: 0 }),
            sensor: Some(v1::keyframe::Sensor::CameraId(0)),
            world_from_camera: Some(pose),
            odom_from_camera: Some(pose),
            ..Default::default()
        };
        for first in (k - self.span + 1).max(0)..=k {
            for index in 0..self.fresh {
                let id = first * self.fresh as i64 + index as i64;
                let [x, y, z] = self.landmark(first, index);
                let seed = k * 7919 + id;
                let pixel = v1::Vector2 {
                    x: CENTER_PX.0 + FOCAL_PX * (x - position[0]) / z + 0.5 * scatter(seed, 20),
                    y: CENTER_PX.1 + FOCAL_PX * (y - position[1]) / z + 0.5 * scatter(seed, 21),
                };
                if first == k {
                    keyframe.landmarks.push(v1::Landmark {
                        id,
                        point_in_world: Some(v1::Vector3 { x: x + noise(10), y, z }),
                        ..Default::default()
                    });
                }
                keyframe.observations.push(v1::Observation {
                    landmark: Some(v1::LandmarkRef { id, ..Default::default() }),
                    pixel: Some(pixel),
                    sigma_px: Some(0.5),
                    ..Default::default()
                });
            }
        }
        keyframe
    }
}

/// From −1 to 1, the same for the same numbers (SplitMix64).
pub(crate) fn scatter(seed: i64, axis: u64) -> f64 {
    let mut z = (seed as u64).wrapping_add(axis.wrapping_mul(0x9e37_79b9_7f4a_7c15));
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    ((z ^ (z >> 31)) >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
}

/// The camera of every street.
pub(crate) fn camera() -> v1::Camera {
    let (cx, cy) = CENTER_PX;
    let (fx, fy) = (FOCAL_PX, FOCAL_PX);
    let model = v1::PinholeRadialTangential { fx, fy, cx, cy, ..Default::default() };
    v1::Camera {
        id: 0,
        width_px: 640,
        height_px: 480,
        model: Some(v1::camera::Model::PinholeRadialTangential(model)),
        ..Default::default()
    }
}
