//! Chunks are those of the whole files, and are made one at a time.

use std::collections::BTreeMap;

use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3};
use covis_solvers::information::Information;
use covis_solvers::io::colmap::{
    ColmapCamera, ColmapImage, ColmapKeypoint, ColmapModel, ColmapPoint, ColmapPointError,
};
use covis_solvers::io::ply::PlyFile;
use covis_solvers::io::trajectory::seconds_of_nanoseconds;
use covis_solvers::problem::PoseGraph;
use nalgebra::{Matrix6, Vector2, Vector3, Vector6};

use super::*;
use crate::map::{
    CameraEntity, Change, ClientIndex, Constraint, ConstraintKind, EntityId, Event, GraphPairs,
    GraphProblem, MapPolicy, NewLandmark, Observation, measured_graph,
};
use crate::service::convert::ids::client_name;
use crate::store::MapFileWriter;

const KEYFRAMES: i64 = 40;
const LANDMARKS: i64 = 4000;

fn id(client: u32, id: i64) -> EntityId {
    EntityId::new(ClientIndex(client), id)
}

fn pose(k: i64) -> Se3 {
    Se3::exp(&(Vector6::new(0.1, -0.2, 0.3, 0.03, 0.02, -0.05) * k as f64))
}

/// Two clients; gaps between ids, landmarks without a position, one seen twice by a keyframe.
fn map() -> Arc<Map> {
    let camera = Camera::Pinhole(PinholeRadialTangential::undistorted(500.0, 501.0, 320.5, 240.25));
    let camera = CameraEntity { camera, width_px: 640, height_px: 480 };
    let landmark = |k: i64| id(u32::from(k % 3 == 0), 2 * k - k % 5);
    let information = Information::new(&(Matrix6::identity() * 100.0)).unwrap();
    let landmarks = (0..LANDMARKS).map(|k| NewLandmark {
        id: landmark(k),
        position: (k % 7 != 0).then(|| Vector3::new(k as f64 / 3.0, 1e-9, -1.0)),
    });
    let mut changes = vec![
        Change::Created {
            policy: MapPolicy::default(),
            create_time_ns: 0,
            display_name: String::new(),
        },
        Change::ClientOpened { name: "robot".to_owned(), epoch: 1 },
        Change::ClientOpened { name: "drone".to_owned(), epoch: 1 },
        Change::CameraSet { id: id(0, 3), camera },
        Change::LandmarksAdded { landmarks: landmarks.collect(), scale: 1.0 },
    ];
    for k in 0..KEYFRAMES {
        let seen = (0..400).map(|j| (k * 61 + j) % LANDMARKS).chain([k * 61 % LANDMARKS]);
        let observations = seen.enumerate().map(|(index, k)| Observation {
            landmark: landmark(k),
            pixel: Vector2::new(index as f64 + 1.0 / 3.0, 7.0),
            sigma_px: 1.0,
            depth: None,
            descriptor: None,
        });
        changes.push(Change::KeyframeAdded {
            id: id(u32::from(k % 2 == 1), k),
            // Not in the order of the ids.
            capture_time_ns: (k * 7 % KEYFRAMES) * 100_000_000,
            camera: Some(id(0, 3)),
            world_from_camera: pose(k),
            odom_from_camera: pose(k),
            observations: observations.collect(),
            landmarks: Vec::new(),
            motion: None,
            global_descriptor: None,
        });
    }
    for k in 0..KEYFRAMES - 2 {
        let constraint = Constraint {
            kind: ConstraintKind::Odometry,
            keyframe_i: id(u32::from(k % 2 == 1), k),
            keyframe_j: id(u32::from(k % 2 == 1), k + 2),
            keyframe_i_from_keyframe_j: pose(2),
            information,
            loss: None,
        };
        changes.push(Change::ConstraintAdded { id: id(0, k), constraint });
    }
    let events: Vec<Event> = (1..)
        .zip(changes)
        .map(|(revision, change)| Event { revision, time_ns: 0, cause: None, change })
        .collect();
    Arc::new(Map::replay(events.iter()).unwrap())
}

/// The pose graph by odometry and constraints.
fn unmeasured(map: &Map) -> GraphProblem {
    let pairs = GraphPairs::of(map);
    let motions = vec![None; pairs.ids().len()];
    measured_graph(map, map.policy().gauge, &pairs, &motions)
}

fn started(map: &Arc<Map>, format: Format) -> Export {
    let choice = Choice { format, all_landmarks: false };
    let export = Export::new("room".to_owned(), Arc::clone(map), choice).unwrap();
    match format {
        Format::G2o => export.with_graph(GraphLines::of(unmeasured(map))),
        Format::Colmap(_) | Format::Tum | Format::Ply | Format::Covis => export,
    }
}

/// The files by the writers of whole files.
fn whole(map: &Map, format: Format) -> Vec<(String, Vec<u8>)> {
    match format {
        Format::Colmap(encoding) => whole_colmap(map)
            .to_files(encoding)
            .unwrap()
            .into_iter()
            .map(|(path, bytes)| (path.to_owned(), bytes))
            .collect(),
        Format::Tum => clients_by_name(map)
            .into_iter()
            .map(|(name, client)| {
                let mut trajectory = Trajectory::default();
                for (_, keyframe) in map.trajectory(client) {
                    let seconds = seconds_of_nanoseconds(keyframe.capture_time_ns);
                    trajectory.push(seconds, keyframe.world_from_camera);
                }
                (format!("{name}.tum"), trajectory.to_bytes())
            })
            .collect(),
        Format::G2o => {
            let problem = unmeasured(map);
            let ids = problem.keyframes.iter().map(|keyframe| keyframe.id).collect();
            let graph = PoseGraph { ids, ..problem.graph };
            let file = covis_solvers::io::g2o::G2oSe3::from_pose_graph(&graph).unwrap();
            vec![("graph.g2o".to_owned(), file.to_bytes())]
        }
        Format::Ply => {
            let mut file = PlyFile::default();
            let positions = map.landmarks().values().filter_map(|l| l.position.as_ref());
            file.push_points(positions, LANDMARK_COLOR);
            for (_, client) in clients_by_name(map) {
                let trajectory = map.trajectory(client);
                let path = trajectory.iter().map(|(_, k)| &k.world_from_camera.translation);
                file.push_polyline(path, KEYFRAME_COLOR);
            }
            vec![("map.ply".to_owned(), file.to_bytes(PlyEncoding::Binary))]
        }
        Format::Covis => {
            let mut file = Vec::new();
            assert!(!MapFileWriter::default().put(map, usize::MAX, &mut file));
            vec![("map.covis".to_owned(), file)]
        }
    }
}

fn whole_colmap(map: &Map) -> ColmapModel {
    let mut model = ColmapModel::default();
    let cameras: Vec<EntityId> = map.cameras().keys().copied().collect();
    let mut images: BTreeMap<EntityId, BTreeSet<EntityId>> = BTreeMap::new();
    for (&id, keyframe) in map.keyframes().iter() {
        for observation in keyframe.observations.iter() {
            images.entry(observation.landmark).or_default().insert(id);
        }
    }
    let is_seen_twice = |id: &EntityId| images.get(id).is_some_and(|images| images.len() > 1);
    let positioned = map.landmarks().iter().filter(|(_, l)| l.position.is_some());
    let points: Vec<EntityId> = positioned.map(|(&id, _)| id).filter(is_seen_twice).collect();
    assert!(points.len() > 100 || map.landmarks().is_empty());
    for (number, entity) in (1..).zip(map.cameras().values()) {
        let camera = ColmapCamera::from_camera(&entity.camera, 640, 480);
        model.cameras.insert(number, camera);
    }
    for (number, id) in (1..).zip(&points) {
        let position = map.landmarks().get(id).unwrap().position.unwrap();
        model.points.insert(number, ColmapPoint::new(&position, LANDMARK_COLOR));
    }
    let mut errors = vec![ColmapPointError::default(); points.len()];
    for (image, (&id, keyframe)) in (1..).zip(map.keyframes().iter()) {
        let name = format!("{}/{}", client_name(map, id), id.id);
        let camera = cameras.binary_search(&keyframe.camera.unwrap()).unwrap() as u32 + 1;
        model.images.insert(image, ColmapImage::new(name, camera, &keyframe.world_from_camera));
        let projection = map.cameras().get(&keyframe.camera.unwrap()).unwrap().camera;
        for observation in keyframe.observations.iter() {
            let Ok(point) = points.binary_search(&observation.landmark) else {
                let keypoints = &mut model.images.get_mut(&image).unwrap().keypoints;
                keypoints.push(ColmapKeypoint::new(&observation.pixel, None));
                continue;
            };
            let number = point as u64 + 1;
            model.push_observation(image, &observation.pixel, number).unwrap();
            let position = map.landmarks().get(&points[point]).unwrap().position.unwrap();
            let in_camera = keyframe.world_from_camera.inverse_transform(&position);
            errors[point].add(&projection, &in_camera, &observation.pixel);
        }
    }
    for (point, error) in model.points.values_mut().zip(errors) {
        point.error = error.mean_px();
    }
    model
}

const FORMATS: [Format; 6] = [
    Format::Colmap(ColmapEncoding::Text),
    Format::Colmap(ColmapEncoding::Binary),
    Format::Tum,
    Format::G2o,
    Format::Ply,
    Format::Covis,
];

#[test]
fn chunks_are_those_of_the_whole_files() {
    let map = map();
    for format in FORMATS {
        let mut export = started(&map, format);
        let paths = export.paths();
        let mut files: Vec<(String, Vec<u8>)> = Vec::new();
        let (mut is_open, mut most) = (false, 0);
        while let Some(chunk) = export.next_chunk().unwrap() {
            if !is_open {
                files.push((chunk.path.clone(), Vec::new()));
            }
            let (path, bytes) = files.last_mut().unwrap();
            assert_eq!((&chunk.path, chunk.offset), (&*path, bytes.len() as i64));
            assert!(chunk.data.len() == CHUNK_BYTES || chunk.last_chunk);
            bytes.extend(chunk.data);
            is_open = !chunk.last_chunk;
            most = most.max(export.made.capacity());
        }
        assert!(!is_open);
        // A keyframe or a landmark more than a chunk, and what a vector reserves.
        assert!(most <= 4 * CHUNK_BYTES, "{format:?} holds {most} bytes");
        assert_eq!(paths, files.iter().map(|(path, _)| path.clone()).collect::<Vec<_>>());
        let whole = whole(&map, format);
        assert_eq!(files.len(), whole.len());
        for ((path, bytes), (name, expected)) in files.iter().zip(&whole) {
            assert_eq!(path, name);
            assert!(bytes == expected, "{format:?}: {path} differs");
        }
    }
}

#[test]
fn a_chunk_is_made_when_it_is_asked_for() {
    let format = Format::Colmap(ColmapEncoding::Text);
    let mut export = started(&map(), format);
    assert!(export.made.is_empty(), "nothing before the first question");
    let _cameras = export.next_chunk().unwrap().unwrap();
    assert!(export.made.is_empty(), "and nothing of the next file");
    let images = export.next_chunk().unwrap().unwrap();
    assert!(!images.last_chunk && images.data.len() == CHUNK_BYTES);
    // The rest of one record.
    assert!(export.made.len() < CHUNK_BYTES / 2, "{}", export.made.len());
}

#[test]
fn a_map_without_entities_has_files_without_records() {
    for format in FORMATS {
        let map = Arc::new(Map::new());
        let mut export = started(&map, format);
        for (path, bytes) in whole(&map, format) {
            let chunk = export.next_chunk().unwrap().unwrap();
            assert_eq!((chunk.path, chunk.data, chunk.last_chunk), (path, bytes, true));
        }
        assert!(export.next_chunk().unwrap().is_none());
    }
}

#[test]
fn a_time_has_all_digits_of_its_nanoseconds_and_no_others() {
    let map = map();
    let mut export = started(&map, Format::Tum);
    let text = String::from_utf8(export.next_chunk().unwrap().unwrap().data).unwrap();
    let times: Vec<&str> = text.lines().skip(1).filter_map(|row| row.split(' ').next()).collect();
    assert_eq!(times[..3], ["0.1", "0.3", "0.5"]);
}
