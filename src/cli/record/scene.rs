//! A map as messages of a recording. Frames chain `map` → `CLIENT/odom` → `CLIENT/base` → `CLIENT/camera`;
//! a base looks along x with z up, as robots have it, and its camera along z with y down.
//!
//! | topic | message |
//! |---|---|
//! | `/tf` | the chain, at each keyframe's capture time |
//! | `/covis/pose/CLIENT` | each keyframe's pose in the map, at its capture time |
//! | `/covis/calibration/CLIENT/ID` | a camera |
//! | `/covis/landmarks`, `/covis/trajectory/CLIENT`, `/covis/closures`, `/covis/map` | the state of the map |
//!
//! A state has the capture time of the newest keyframe, and is a microsecond later than the state before
//! where no keyframe came in between. A map without keyframes has neither time nor state. Only converts; asks no server and knows no clock.

use std::collections::{BTreeMap, BTreeSet};

use covis_solvers::geometry::{LieGroup, Se3, So3};
use nalgebra::Vector3;
use prost_types::Timestamp;

use super::colors::Colors;
use super::schemas::figures::MapFigures;
use super::schemas::foxglove as fx;
use super::sink::Sink;
use crate::client::MapMirror;
use crate::frontend::mapping::messages::se3;
use crate::wire::v1;
use v1::camera::Model;
use v1::constraint::Constraint;

/// The frame of the map.
pub(super) const MAP: &str = "map";
/// A state is later than the one before it by this much at least.
const STEP_NS: u64 = 1000;
/// Below this a keyframe has not moved, m.
const MOVED_M: f64 = 1e-6;
/// Bytes of a landmark: x, y, z as floats of 32 bits, and how often it was seen; then its color, where colors
/// are known.
const STRIDE: u32 = 16;
const COLORED_STRIDE: u32 = 20;
/// The color of landmarks that no image of a keyframe shows.
const UNKNOWN_COLOR: [u8; 3] = [128; 3];

type Key = (String, i64);

/// What has been written of a map.
#[derive(Debug, Default)]
pub(super) struct Scene {
    /// Keyframes that are in the recording, with where they were in the last state.
    keyframes: BTreeMap<Key, Option<Vector3<f64>>>,
    cameras: BTreeSet<Key>,
    /// The time of the last state.
    last_ns: Option<u64>,
    /// Colors of landmarks, where something knows them.
    colors: Option<Colors>,
}

impl Scene {
    /// Nothing is written yet.
    pub(super) fn new(colors: Option<Colors>) -> Self {
        Self { colors, ..Self::default() }
    }

    /// Writes cameras and keyframes that are not in the recording yet. `odometry` has the poses in the
    /// odometry frame where they are known; of others it follows from the client's newest keyframe.
    pub(super) fn put_new(
        &mut self,
        mirror: &MapMirror,
        odometry: &BTreeMap<Key, Se3>,
        sink: &Sink,
    ) -> anyhow::Result<()> {
        let is_new = |key: &&Key| !self.keyframes.contains_key(key);
        let mut new: Vec<(u64, &Key)> = mirror
            .keyframes
            .keys()
            .filter(is_new)
            .map(|key| (capture_ns(mirror, key), key))
            .collect();
        new.sort_unstable();
        // A recording begins with its first keyframe: there is no time before it.
        let Some(&(first_ns, _)) = new.first() else { return Ok(()) };
        for (key, camera) in &mirror.cameras {
            if self.cameras.insert(key.clone()) {
                let topic = format!("/covis/calibration/{}/{}", key.0, key.1);
                sink.put(&topic, first_ns, &calibration(camera, first_ns))?;
            }
        }
        for (time_ns, key) in new {
            let Some(world_from_camera) = pose(mirror, key) else { continue };
            let (client, frames) = (&key.0, Frames::of(&key.0));
            let map_from_odom = match odometry.get(key) {
                Some(odom_from_camera) => world_from_camera.compose(&odom_from_camera.inverse()),
                None => map_from_odom(mirror, client).unwrap_or_else(Se3::identity),
            };
            let odom_from_camera = map_from_odom.inverse().compose(&world_from_camera);
            sink.put("/tf", time_ns, &frames.chain(&map_from_odom, &odom_from_camera, time_ns))?;
            let in_map = fx::PoseInFrame {
                timestamp: Some(timestamp(time_ns)),
                frame_id: MAP.to_owned(),
                pose: Some(to_pose(&world_from_camera)),
            };
            sink.put(&format!("/covis/pose/{client}"), time_ns, &in_map)?;
            self.keyframes.insert(key.clone(), None);
        }
        Ok(())
    }

    /// Writes the state of the map; `now_ns` is this machine's time, where it is live.
    pub(super) fn put_state(
        &mut self,
        mirror: &MapMirror,
        now_ns: Option<u64>,
        sink: &Sink,
    ) -> anyhow::Result<()> {
        let newest_ns = mirror.keyframes.keys().map(|key| capture_ns(mirror, key)).max();
        let Some(newest_ns) = newest_ns else { return Ok(()) };
        let time_ns = self.last_ns.map_or(newest_ns, |last| newest_ns.max(last + STEP_NS));
        self.last_ns = Some(time_ns);
        // What is gone from the map, for instance with a map of the same name that was made anew.
        self.keyframes.retain(|key, _| mirror.keyframes.contains_key(key));

        sink.put("/covis/landmarks", time_ns, &landmarks(mirror, self.colors.as_ref(), time_ns))?;
        let mut poses: BTreeMap<&str, Vec<(u64, &Key)>> = BTreeMap::new();
        for key in mirror.keyframes.keys() {
            poses.entry(&key.0).or_default().push((capture_ns(mirror, key), key));
        }
        for (client, mut keys) in poses {
            keys.sort_unstable();
            let path = keys.iter().filter_map(|(_, key)| pose(mirror, key));
            let path = fx::PosesInFrame {
                timestamp: Some(timestamp(time_ns)),
                frame_id: MAP.to_owned(),
                poses: path.map(|pose| to_pose(&pose)).collect(),
            };
            sink.put(&format!("/covis/trajectory/{client}"), time_ns, &path)?;
            // Where the robot is after the correction.
            let newest = mirror.client_frames.get(client).and_then(|frame| {
                let keyframe = frame.keyframe.as_ref()?;
                let key = (keyframe.client_id.clone(), keyframe.id);
                Some((map_from_odom(mirror, client)?, pose(mirror, &key)?))
            });
            if let Some((map_from_odom, world_from_camera)) = newest {
                let odom_from_camera = map_from_odom.inverse().compose(&world_from_camera);
                let chain = Frames::of(client).chain(&map_from_odom, &odom_from_camera, time_ns);
                sink.put("/tf", time_ns, &chain)?;
            }
        }
        let (scene, closures, switched_off) = closures(mirror, time_ns);
        sink.put("/covis/closures", time_ns, &scene)?;
        let (moved, farthest) = self.corrections(mirror);
        let figures = MapFigures {
            timestamp: Some(timestamp(newest_ns)),
            revision: mirror.revision,
            keyframe_count: count(mirror.keyframes.len()),
            landmark_count: count(positions(mirror).count()),
            closure_count: closures,
            switched_off_closure_count: switched_off,
            moved_keyframe_count: moved,
            largest_correction_m: farthest,
            delay_s: now_ns.and_then(|now_ns| delay_s(now_ns, newest_ns)),
        };
        sink.put("/covis/map", time_ns, &figures)
    }

    /// How many keyframes have moved since the last state, and the farthest of them.
    fn corrections(&mut self, mirror: &MapMirror) -> (i64, f64) {
        let (mut moved, mut farthest) = (0, 0.0_f64);
        for (key, last) in &mut self.keyframes {
            let Some(position) = pose(mirror, key).map(|pose| pose.translation) else { continue };
            let distance = last.replace(position).map_or(0.0, |last| (position - last).norm());
            moved += i64::from(distance > MOVED_M);
            farthest = farthest.max(distance);
        }
        (moved, farthest)
    }
}

/// The frames of a client.
pub(super) struct Frames {
    odom: String,
    base: String,
    /// That of its camera.
    pub(super) camera: String,
}

/// Where a client's odometry frame lies in the map, in the map's unit of length, which all frames here are in.
fn map_from_odom(mirror: &MapMirror, client: &str) -> Option<Se3> {
    let in_its_unit = mirror.map_from_odom(client).and_then(se3)?;
    Some(Se3::new(in_its_unit.rotation, in_its_unit.translation * mirror.scale(client)))
}

impl Frames {
    pub(super) fn of(client: &str) -> Self {
        let frame = |name: &str| format!("{client}/{name}");
        Self { odom: frame("odom"), base: frame("base"), camera: frame("camera") }
    }

    fn chain(
        &self,
        map_from_odom: &Se3,
        odom_from_camera: &Se3,
        time_ns: u64,
    ) -> fx::FrameTransforms {
        let base_from_camera = base_from_camera();
        let odom_from_base = odom_from_camera.compose(&base_from_camera.inverse());
        let link = |parent: &str, child: &str, pose: &Se3| {
            let pose = to_pose(pose);
            fx::FrameTransform {
                timestamp: Some(timestamp(time_ns)),
                parent_frame_id: parent.to_owned(),
                child_frame_id: child.to_owned(),
                translation: pose.position,
                rotation: pose.orientation,
            }
        };
        let transforms = vec![
            link(MAP, &self.odom, map_from_odom),
            link(&self.odom, &self.base, &odom_from_base),
            link(&self.base, &self.camera, &base_from_camera),
        ];
        fx::FrameTransforms { transforms }
    }
}

/// A camera that looks along the base's x axis.
fn base_from_camera() -> Se3 {
    let rotation = So3::from_quaternion_xyzw(-0.5, 0.5, -0.5, 0.5).unwrap_or_else(So3::identity);
    Se3::new(rotation, Vector3::zeros())
}

fn pose(mirror: &MapMirror, key: &Key) -> Option<Se3> {
    se3(mirror.keyframes.get(key)?.world_from_camera.as_ref()?)
}

/// A keyframe's capture time, Unix nanoseconds; 0 where it is before 1970.
fn capture_ns(mirror: &MapMirror, key: &Key) -> u64 {
    let time = mirror.keyframes.get(key).and_then(|keyframe| keyframe.capture_time);
    let ns = time.map_or(0, |t| i128::from(t.seconds) * 1_000_000_000 + i128::from(t.nanos));
    u64::try_from(ns.max(0)).unwrap_or(u64::MAX)
}

/// Nanoseconds as a message has them.
pub(super) fn timestamp(ns: u64) -> Timestamp {
    const SECOND: u64 = 1_000_000_000;
    Timestamp {
        seconds: i64::try_from(ns / SECOND).unwrap_or(i64::MAX),
        nanos: i32::try_from(ns % SECOND).unwrap_or(0),
    }
}

fn to_pose(pose: &Se3) -> fx::Pose {
    let (t, q) = (&pose.translation, pose.rotation.quaternion());
    fx::Pose {
        position: Some(fx::Vector3 { x: t.x, y: t.y, z: t.z }),
        orientation: Some(fx::Quaternion { x: q.i, y: q.j, z: q.k, w: q.w }),
    }
}

pub(super) fn identity() -> fx::Pose {
    to_pose(&Se3::identity())
}

fn count(all: usize) -> i64 {
    i64::try_from(all).unwrap_or(i64::MAX)
}

/// How old the newest keyframe is, unless its clock is another one.
fn delay_s(now_ns: u64, captured_ns: u64) -> Option<f64> {
    const MOST_S: f64 = 3600.0;
    let delay_s = now_ns as f64 * 1e-9 - captured_ns as f64 * 1e-9;
    (delay_s.abs() < MOST_S).then_some(delay_s)
}

/// Landmarks that have a position.
fn positions(mirror: &MapMirror) -> impl Iterator<Item = (&Key, v1::Vector3, i64)> + '_ {
    let landmarks = mirror.landmarks.iter();
    landmarks.filter_map(|(key, l)| Some((key, l.point_in_world?, l.observation_count)))
}

fn landmarks(mirror: &MapMirror, colors: Option<&Colors>, time_ns: u64) -> fx::PointCloud {
    use fx::packed_element_field::NumericType;
    let field = |name: &str, offset, kind: NumericType| fx::PackedElementField {
        name: name.to_owned(),
        offset,
        r#type: kind.into(),
    };
    let mut fields = vec![
        field("x", 0, NumericType::Float32),
        field("y", 4, NumericType::Float32),
        field("z", 8, NumericType::Float32),
        field("observations", 12, NumericType::Uint32),
    ];
    let point_stride = if colors.is_some() { COLORED_STRIDE } else { STRIDE };
    if colors.is_some() {
        let channels = ["red", "green", "blue", "alpha"].into_iter().zip(STRIDE..);
        fields.extend(channels.map(|(name, offset)| field(name, offset, NumericType::Uint8)));
    }
    let known = colors.map(|colors| (colors.client.as_str(), colors.known()));
    let mut data = Vec::with_capacity(mirror.landmarks.len() * point_stride as usize);
    for ((client, id), point, observations) in positions(mirror) {
        for coordinate in [point.x, point.y, point.z] {
            data.extend((coordinate as f32).to_le_bytes());
        }
        data.extend(u32::try_from(observations).unwrap_or(0).to_le_bytes());
        if let Some((its_client, known)) = &known {
            let color = known.get(id).filter(|_| client == its_client);
            data.extend(color.unwrap_or(&UNKNOWN_COLOR));
            data.push(u8::MAX);
        }
    }
    fx::PointCloud {
        timestamp: Some(timestamp(time_ns)),
        frame_id: MAP.to_owned(),
        pose: Some(identity()),
        point_stride,
        fields,
        data,
    }
}

/// Each loop closure as a line between its keyframes, green where it counts and red where it was found
/// false; then how many of both there are.
fn closures(mirror: &MapMirror, time_ns: u64) -> (fx::SceneUpdate, i64, i64) {
    let (mut counting, mut switched_off) = (0, 0);
    let mut entities = Vec::new();
    for (key, constraint) in &mirror.constraints {
        let Some(Constraint::RelativePose(closure)) = &constraint.constraint else { continue };
        if closure.kind() != v1::ConstraintKind::LoopClosure {
            continue;
        }
        let off = closure.switched_off.as_ref();
        if off.is_some() {
            switched_off += 1
        } else {
            counting += 1
        }
        let ends = [&closure.keyframe_i, &closure.keyframe_j].map(|keyframe| {
            let keyframe = keyframe.as_ref()?;
            let at = pose(mirror, &(keyframe.client_id.clone(), keyframe.id))?.translation;
            Some(fx::Point3 { x: at.x, y: at.y, z: at.z })
        });
        let verdict = match off {
            None => "counts",
            Some(off) if off.provisional => "found false, provisional",
            Some(_) => "found false",
        };
        let (r, g) = if off.is_some() { (0.85, 0.15) } else { (0.1, 0.65) };
        let pair = |key: &str, value: String| fx::KeyValuePair { key: key.to_owned(), value };
        let mut metadata = vec![pair("verdict", verdict.to_owned())];
        metadata.extend(off.map(|off| pair("chi2", off.chi2.to_string())));
        metadata.extend(off.map(|off| pair("weight", off.weight.to_string())));
        entities.push(fx::SceneEntity {
            timestamp: Some(timestamp(time_ns)),
            frame_id: MAP.to_owned(),
            id: format!("{}/{}", key.0, key.1),
            frame_locked: true,
            metadata,
            lines: vec![fx::LinePrimitive {
                r#type: fx::line_primitive::Type::LineList.into(),
                pose: Some(identity()),
                thickness: 2.0,
                scale_invariant: true,
                points: ends.into_iter().flatten().collect(),
                color: Some(fx::Color { r, g, b: 0.15, a: 1.0 }),
            }],
            triangles: Vec::new(),
        });
    }
    // Those that were taken back have to go, and a viewer that jumps in time sees this message alone.
    let all = fx::SceneEntityDeletion {
        timestamp: Some(timestamp(time_ns)),
        r#type: fx::scene_entity_deletion::Type::All.into(),
        id: String::new(),
    };
    (fx::SceneUpdate { deletions: vec![all], entities }, counting, switched_off)
}

fn calibration(camera: &v1::Camera, time_ns: u64) -> fx::CameraCalibration {
    let (k, distortion_model, d) = match &camera.model {
        Some(Model::PinholeRadialTangential(c)) => {
            ([c.fx, c.fy, c.cx, c.cy], "plumb_bob", vec![c.k1, c.k2, c.p1, c.p2, c.k3])
        }
        Some(Model::KannalaBrandt(c)) => {
            ([c.fx, c.fy, c.cx, c.cy], "kannala_brandt", vec![c.k1, c.k2, c.k3, c.k4])
        }
        // Foxglove has no name for this distortion, which is small as a rule.
        Some(Model::Snavely(c)) => ([c.focal, c.focal, 0.0, 0.0], "", Vec::new()),
        None => ([0.0; 4], "", Vec::new()),
    };
    let [fx_px, fy_px, cx_px, cy_px] = k;
    fx::CameraCalibration {
        timestamp: Some(timestamp(time_ns)),
        width: u32::try_from(camera.width_px).unwrap_or(0),
        height: u32::try_from(camera.height_px).unwrap_or(0),
        distortion_model: distortion_model.to_owned(),
        d,
        k: vec![fx_px, 0.0, cx_px, 0.0, fy_px, cy_px, 0.0, 0.0, 1.0],
        r: vec![1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0],
        p: vec![fx_px, 0.0, cx_px, 0.0, 0.0, fy_px, cy_px, 0.0, 0.0, 0.0, 1.0, 0.0],
        frame_id: Frames::of(&camera.client_id).camera,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_odometry_frame_of_a_client_with_a_scale_is_in_the_unit_of_the_map() {
        let frame = |scale| v1::ClientFrame {
            client_id: "robot".to_owned(),
            map_from_odom: Some(v1::RigidTransform {
                translation: Some(v1::Vector3 { x: 1.0, y: -2.0, z: 0.5 }),
                rotation: Some(v1::Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
            }),
            scale,
            ..Default::default()
        };
        // 0 is what an earlier server sends.
        for (scale, expected) in [(2.0, [2.0, -4.0, 1.0]), (0.0, [1.0, -2.0, 0.5])] {
            let mut mirror = MapMirror::default();
            mirror.client_frames.insert("robot".to_owned(), frame(scale));
            let found = map_from_odom(&mirror, "robot").map(|pose| pose.translation);
            assert_eq!(found, Some(Vector3::from(expected)));
        }
    }
}
