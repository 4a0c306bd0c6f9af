//! One robot of a load: keyframes at fixed times over one session, and how long each waited.
//!
//! Keyframes leave when they are due, whatever the server does. A wait is from the call of `send`, so it
//! holds encoding, transport, checks, journal, queue, solve and the way back. `covis load` and the bench
//! `load` are made of this. Must not know maps or print.

use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

use covis_solvers::geometry::Se3;
use nalgebra::{Vector2, Vector3};
use tokio::sync::watch;

use crate::client::{Client, ClientError, IngestReport, SessionOptions};
use crate::frontend::mapping::messages::{landmark_ref, rigid, timestamp, vector2, vector3};
use crate::sync::Mutex;
use crate::wire::v1;

/// What a robot measured of a landmark.
#[derive(Clone, Debug)]
pub struct LandmarkMeasurement {
    /// The landmark's id.
    pub landmark: i64,
    /// Where it was seen, and the deviation, px.
    pub pixel: (Vector2<f64>, f64),
    /// How far it was along the optical axis, and the deviation, m; `None` of one camera.
    pub depth_m: Option<(f64, f64)>,
    /// Whether it was not seen before.
    pub is_new: bool,
    /// Where it is in the world, for one that is new.
    pub point_in_world: Option<Vector3<f64>>,
}

/// The message of a keyframe of camera 0.
pub fn keyframe(
    id: i64,
    time_s: f64,
    world_from_camera: &Se3,
    measured: &[LandmarkMeasurement],
) -> v1::Keyframe {
    let pose = Some(rigid(world_from_camera));
    let new = measured.iter().filter(|m| m.is_new).map(|m| v1::Landmark {
        id: m.landmark,
        point_in_world: m.point_in_world.as_ref().map(vector3),
        ..v1::Landmark::default()
    });
    let observations = measured.iter().map(|m| v1::Observation {
        landmark: Some(landmark_ref(m.landmark)),
        pixel: Some(vector2(&m.pixel.0)),
        sigma_px: Some(m.pixel.1),
        depth_m: m.depth_m.map(|(depth_m, _)| depth_m),
        sigma_depth_m: m.depth_m.map(|(_, sigma)| sigma),
        ..v1::Observation::default()
    });
    v1::Keyframe {
        id,
        capture_time: Some(timestamp(time_s)),
        sensor: Some(v1::keyframe::Sensor::CameraId(0)),
        world_from_camera: pose,
        odom_from_camera: pose,
        landmarks: new.collect(),
        observations: observations.collect(),
        ..v1::Keyframe::default()
    }
}

/// When keyframes leave, and when to stop.
#[derive(Clone, Debug)]
pub struct Schedule {
    /// From one keyframe to the next.
    pub period: Duration,
    /// From the start to the first one.
    pub offset: Duration,
    /// Becomes true where no more is to be sent.
    pub stop: watch::Receiver<bool>,
}

/// Waits for one level of acks.
#[derive(Debug, Default)]
pub struct Level {
    /// Keyframes on the way: sequence and when they were sent.
    open: VecDeque<(i64, Instant)>,
    /// From send to the ack, seconds.
    pub waits_s: Vec<f64>,
}

impl Level {
    fn cover(&mut self, through: i64) {
        while let Some(&(sequence, sent)) = self.open.front()
            && sequence <= through
        {
            self.open.pop_front();
            self.waits_s.push(sent.elapsed().as_secs_f64());
        }
    }

    fn forget(&mut self, sequence: i64) {
        self.open.retain(|&(open, _)| open != sequence);
    }

    /// Keyframes that were never covered.
    pub fn unanswered(&self) -> usize {
        self.open.len()
    }
}

/// What the acks of one robot, or of many, told.
#[derive(Debug, Default)]
pub struct Waits {
    /// To RECEIVED: it is in the map.
    pub received: Level,
    /// To DURABLE: it survives a crash. Nothing where the server keeps maps in memory.
    pub durable: Level,
    /// To OPTIMIZED: its local bundle adjustment is applied.
    pub optimized: Level,
    /// Of the solves alone, seconds.
    pub solves_s: Vec<f64>,
    /// Of the solves, all together.
    pub iterations: i64,
    /// Keyframes that were handed over more than a period after they were due.
    pub late: usize,
    /// Keyframes that were handed over.
    pub sent: usize,
    /// Observations in them.
    pub observations: usize,
}

impl Waits {
    fn levels(&mut self) -> [&mut Level; 3] {
        [&mut self.received, &mut self.durable, &mut self.optimized]
    }

    fn send(&mut self, sequence: i64, is_durable: bool) {
        let now = Instant::now();
        self.received.open.push_back((sequence, now));
        if is_durable {
            self.durable.open.push_back((sequence, now));
        }
        self.optimized.open.push_back((sequence, now));
    }

    fn take(&mut self, ack: &v1::IngestAck) {
        match ack.status() {
            v1::AckStatus::Received => self.received.cover(ack.sequence),
            v1::AckStatus::Durable => self.durable.cover(ack.sequence),
            v1::AckStatus::Optimized => self.optimized.cover(ack.sequence),
            v1::AckStatus::Rejected => {
                self.levels().into_iter().for_each(|level| level.forget(ack.sequence));
            }
            v1::AckStatus::Unspecified => {}
        }
        if let Some(summary) = &ack.solve_summary {
            self.solves_s.push(summary.solve_duration_us as f64 * 1e-6);
            self.iterations += i64::from(summary.iteration_count);
        }
    }

    /// Adds what another robot waited for.
    pub fn add(&mut self, mut other: Self) {
        for (level, more) in self.levels().into_iter().zip(other.levels()) {
            level.waits_s.append(&mut more.waits_s);
            level.open.append(&mut more.open);
        }
        self.solves_s.append(&mut other.solves_s);
        self.iterations += other.iterations;
        self.late += other.late;
        self.sent += other.sent;
        self.observations += other.observations;
    }
}

/// Sends keyframes when they are due, waits for all acks, and returns the waits with the session's own
/// report. Stops early, and waits for nothing then, where the schedule says so.
///
/// # Errors
/// What the session ended with.
pub async fn drive(
    client: &Client,
    map: &str,
    camera: v1::Camera,
    keyframes: impl Iterator<Item = v1::Keyframe>,
    mut schedule: Schedule,
) -> Result<(Waits, IngestReport), ClientError> {
    let waits = Arc::new(Mutex::new(Waits::default()));
    let seen = Arc::clone(&waits);
    let options = SessionOptions::default().on_ack(move |ack| seen.lock().take(ack));
    let mut session = client.ingest(map, "robot", options).await?;
    let is_durable = session.opened().durability() != v1::Durability::InMemory;
    session.send(camera).await?;
    let begin = tokio::time::Instant::now() + schedule.offset;
    for (index, keyframe) in (0_u32..).zip(keyframes) {
        let due = begin + schedule.period * index;
        tokio::select! {
            () = tokio::time::sleep_until(due) => {}
            _ = schedule.stop.wait_for(|stop| *stop) => {
                let report = session.report();
                return Ok((std::mem::take(&mut *waits.lock()), report));
            }
        }
        let sequence = session.next_sequence();
        {
            let mut waits = waits.lock();
            waits.observations += keyframe.observations.len();
            waits.sent += 1;
            waits.send(sequence, is_durable);
        }
        session.send_as(sequence, keyframe).await?;
        if due.elapsed() > schedule.period {
            waits.lock().late += 1;
        }
    }
    let report = tokio::select! {
        report = session.finish() => report?,
        _ = schedule.stop.wait_for(|stop| *stop) => IngestReport::default(),
    };
    Ok((std::mem::take(&mut *waits.lock()), report))
}
