//! A frontend of the demo: tracks in its own drifting frame, maps through the server.
//!
//! It never sees the truth. Start estimates are map_from_odom · odom_from_camera with the newest
//! correction of `WatchMap`, new landmarks come from the measured depth, and a place seen again is
//! sent as a loop closure. It waits for each OPTIMIZED and its correction, so that runs repeat.

use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::testing::{Scene, SceneObservation};

use super::super::progress::Progress;
use super::{CLIENT, MAP};
use crate::client::{Client, IngestReport, IngestSession, MapWatch, SessionOptions, WatchOptions};
use crate::wire::geometry;
use crate::wire::v1;

/// The camera's id.
const CAMERA: i64 = 0;
/// Standard deviations of a loop closure: meters, then radians, each axis.
const CLOSURE_SIGMA: (f64, f64) = (0.005, 0.002);

/// What a walk left.
#[derive(Debug)]
pub(super) struct Walk {
    /// The session's counts.
    pub(super) report: IngestReport,
    /// Loop closures that were sent.
    pub(super) closures: usize,
}

/// Streams the whole scene.
pub(super) async fn walk(client: &Client, scene: &Scene) -> anyhow::Result<Walk> {
    let options = SessionOptions { lock_step: true, ..SessionOptions::default() };
    let mut session = client.ingest(MAP, CLIENT, options).await?;
    let options = WatchOptions { omit_landmarks: true, ..WatchOptions::default() };
    let mut watch = client.watch(MAP, options).await?;
    let (width, height) = scene.image_px;
    let size = (i32::try_from(width)?, i32::try_from(height)?);
    session.send(geometry::camera(CAMERA, &scene.camera, size)).await?;

    let mut progress = Progress::new("keyframes", scene.odometry.len() as u64);
    let mut is_known = vec![false; scene.landmarks.len()];
    let mut map_from_odom = Se3::identity();
    let mut closures = 0;
    for (index, odom_from_camera) in scene.odometry.iter().enumerate() {
        let world_from_camera = map_from_odom.compose(odom_from_camera);
        let keyframe = keyframe(scene, index, &world_from_camera, &mut is_known);
        let sequence = session.send(keyframe).await?;
        map_from_odom = corrected(&mut session, &mut watch, sequence).await?;
        for &(i, j, measured) in scene.loop_closures.iter().filter(|closure| closure.1 == index) {
            progress.message("loop closed");
            let constraint = closure(closures, i, j, &measured);
            let sequence = session.send(constraint).await?;
            map_from_odom = corrected(&mut session, &mut watch, sequence).await?;
            closures += 1;
        }
        progress.advance(1);
    }
    let report = session.finish().await?;
    progress.finish();
    Ok(Walk { report, closures })
}

/// Waits until the server has optimized up to `sequence`, then for the correction.
async fn corrected(
    session: &mut IngestSession,
    watch: &mut MapWatch,
    sequence: i64,
) -> anyhow::Result<Se3> {
    session.optimized(sequence).await?;
    let mirror = watch.reach(session.report().revision).await?;
    let frame = mirror.map_from_odom(CLIENT).and_then(geometry::se3);
    frame.ok_or_else(|| anyhow::anyhow!("the server tells no odometry frame of {CLIENT}"))
}

fn keyframe(
    scene: &Scene,
    index: usize,
    world_from_camera: &Se3,
    is_known: &mut [bool],
) -> v1::Keyframe {
    let mut keyframe = v1::Keyframe {
        id: index as i64,
        capture_time: Some(geometry::timestamp(scene.timestamps_s[index])),
        sensor: Some(v1::keyframe::Sensor::CameraId(CAMERA)),
        world_from_camera: Some(geometry::rigid(world_from_camera)),
        odom_from_camera: Some(geometry::rigid(&scene.odometry[index])),
        ..v1::Keyframe::default()
    };
    for SceneObservation { landmark, measurement } in &scene.observations[index] {
        let id = *landmark as i64;
        if !std::mem::replace(&mut is_known[*landmark], true) {
            // Where the ray of the pixel reaches the measured depth.
            let ray = scene.camera.unproject(&measurement.pixel);
            let point =
                ray.map(|ray| world_from_camera.transform(&(ray * (measurement.depth_m / ray.z))));
            keyframe.landmarks.push(v1::Landmark {
                id,
                point_in_world: point.as_ref().map(geometry::vector3),
                ..v1::Landmark::default()
            });
        }
        keyframe.observations.push(v1::Observation {
            landmark: Some(geometry::landmark_ref(id)),
            pixel: Some(geometry::vector2(&measurement.pixel)),
            sigma_px: Some(measurement.sigma_px),
            depth_m: Some(measurement.depth_m),
            sigma_depth_m: Some(measurement.sigma_depth_m),
            ..v1::Observation::default()
        });
    }
    keyframe
}

/// The constraint that keyframe `j` sees the place of the older keyframe `i` again.
fn closure(id: usize, i: usize, j: usize, i_from_j: &Se3) -> v1::RelativePoseConstraint {
    let (meters, radians) = CLOSURE_SIGMA;
    let mut upper_triangle = Vec::with_capacity(21);
    for row in 0..6 {
        for column in row..6 {
            let sigma = if row < 3 { meters } else { radians };
            upper_triangle.push(if row == column { 1.0 / (sigma * sigma) } else { 0.0 });
        }
    }
    v1::RelativePoseConstraint {
        id: id as i64,
        keyframe_i: Some(geometry::keyframe_ref(i as i64)),
        keyframe_j: Some(geometry::keyframe_ref(j as i64)),
        keyframe_i_from_keyframe_j: Some(geometry::rigid(i_from_j)),
        information: Some(v1::InformationMatrix6 { upper_triangle }),
        kind: v1::ConstraintKind::LoopClosure.into(),
        ..v1::RelativePoseConstraint::default()
    }
}
