//! `covis record` and `covis run --mcap` with the real binary, read back by the reader of the crate `mcap` and by
//! the descriptors that a recording embeds: every channel decodes, transforms chain, counts are the map's.

use std::collections::{BTreeMap, BTreeSet};
use std::io::Read;
use std::process::Stdio;

use covis_solvers::geometry::{LieGroup, Se3, So3};
use covis_solvers::io::trajectory::Trajectory;
use fs_err as fs;
use nalgebra::Vector3;
use protox::prost_reflect::{DescriptorPool, DynamicMessage, Value};

use crate::cli_support::{Running, Workspace, golden, number};
use crate::process::{Process, Signal};

/// A message of a recording.
struct Recorded {
    topic: String,
    schema: String,
    time_ns: u64,
    message: DynamicMessage,
}

impl Recorded {
    fn field(&self, name: &str) -> Value {
        self.message.get_field_by_name(name).unwrap().into_owned()
    }

    fn count(&self, name: &str) -> usize {
        self.field(name).as_i64().unwrap().try_into().unwrap()
    }

    fn list(&self, name: &str) -> Vec<DynamicMessage> {
        let list = self.field(name);
        list.as_list().unwrap().iter().map(|v| v.as_message().unwrap().clone()).collect()
    }
}

/// All messages of a recording, each decoded by the schema of its channel.
fn read(bytes: &[u8]) -> Vec<Recorded> {
    let mut pools: BTreeMap<String, DescriptorPool> = BTreeMap::new();
    let options = mcap::read::Options::IgnoreEndMagic;
    let messages = mcap::MessageStream::new_with_options(bytes, options.into()).unwrap();
    let decoded = messages.map(|message| {
        let message = message.unwrap();
        let schema = message.channel.schema.clone().unwrap();
        assert_eq!(
            (&*schema.encoding, &*message.channel.message_encoding),
            ("protobuf", "protobuf")
        );
        let pool = pools
            .entry(schema.name.clone())
            .or_insert_with(|| DescriptorPool::decode(&*schema.data).unwrap());
        let descriptor = pool.get_message_by_name(&schema.name).unwrap();
        let decoded = DynamicMessage::decode(descriptor, &*message.data).unwrap();
        // A descriptor that does not fit would leave fields over.
        assert_eq!(decoded.unknown_fields().count(), 0, "{}", schema.name);
        Recorded {
            topic: message.channel.topic.clone(),
            schema: schema.name.clone(),
            time_ns: message.log_time,
            message: decoded,
        }
    });
    decoded.collect()
}

fn on<'a>(all: &'a [Recorded], topic: &str) -> Vec<&'a Recorded> {
    all.iter().filter(|recorded| recorded.topic == topic).collect()
}

fn part(message: &DynamicMessage, name: &str) -> DynamicMessage {
    message.get_field_by_name(name).unwrap().as_message().unwrap().clone()
}

fn figure(message: &DynamicMessage, name: &str) -> f64 {
    message.get_field_by_name(name).unwrap().as_f64().unwrap()
}

/// A transform of parts with these names.
fn se3(message: &DynamicMessage, [translation, rotation]: [&str; 2]) -> Se3 {
    let (t, q) = (part(message, translation), part(message, rotation));
    let rotation = ["x", "y", "z", "w"].map(|name| figure(&q, name));
    let rotation = So3::from_quaternion_xyzw(rotation[0], rotation[1], rotation[2], rotation[3]);
    let t = ["x", "y", "z"].map(|name| figure(&t, name));
    Se3::new(rotation.unwrap(), Vector3::from(t))
}

/// The pose of a client's camera in the map, through the chain of a message on `/tf`.
fn chained(transforms: &Recorded, client: &str) -> Option<Se3> {
    let mut parents: BTreeMap<String, (String, Se3)> = BTreeMap::new();
    for link in transforms.list("transforms") {
        let name =
            |field: &str| link.get_field_by_name(field).unwrap().as_str().unwrap().to_owned();
        let pose = se3(&link, ["translation", "rotation"]);
        parents.insert(name("child_frame_id"), (name("parent_frame_id"), pose));
    }
    let (mut frame, mut pose) = (format!("{client}/camera"), Se3::identity());
    let mut links = 0;
    while frame != "map" {
        let (parent, parent_from_frame) = parents.get(&frame)?;
        pose = parent_from_frame.compose(&pose);
        frame.clone_from(parent);
        links += 1;
    }
    assert_eq!(links, 3, "map, odom, base, camera");
    Some(pose)
}

fn difference(a: &Se3, b: &Se3) -> f64 {
    a.inverse().compose(b).log().norm()
}

#[test]
fn a_recorded_map_reads_back_with_its_counts_and_its_poses() {
    let workspace = Workspace::new();
    workspace.room(12);
    let server = Running::start(&workspace, &workspace.path("data"));
    let url = &server.url;
    workspace.json(&format!("run tum:seq --lock-step --map room --json --server {url}"), &[]);
    let ran = workspace.run(&format!("record room room.mcap --server {url}"), &[]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    let bytes = fs::read(workspace.path("room.mcap")).unwrap();
    let all = read(&bytes);
    assert_eq!(ran.stdout, format!("{} messages in room.mcap\n", all.len()));

    let map = workspace.json(&format!("map show room --json --server {url}"), &[]);
    let count = |key: &str| number(&map, key) as usize;
    let state = &on(&all, "/covis/map")[0];
    assert_eq!(state.schema, "covis.recording.v1.MapFigures");
    assert_eq!(state.count("revision"), count("revision"));
    assert_eq!(state.count("keyframe_count"), count("keyframes"));
    let cloud = on(&all, "/covis/landmarks")[0];
    assert_eq!(cloud.schema, "foxglove.PointCloud");
    let points = cloud.field("data").as_bytes().unwrap().len() / 16;
    assert_eq!(points, state.count("landmark_count"));
    assert_eq!(points, count("positioned_landmarks"));
    assert!(points > 50, "{points}");
    let calibrations = on(&all, "/covis/calibration/frontend/0");
    assert_eq!(calibrations.len(), 1);
    assert_eq!(calibrations[0].schema, "foxglove.CameraCalibration");
    assert_eq!(calibrations[0].field("width").as_u32(), Some(640));

    // Each keyframe's pose, on its own and through the chain, is that of the trajectory that the server exports.
    workspace
        .json(&format!("map export room --format tum --out room.tum --json --server {url}"), &[]);
    let exported = Trajectory::read(&workspace.path("room.tum")).unwrap();
    let (poses, transforms) = (on(&all, "/covis/pose/frontend"), on(&all, "/tf"));
    assert_eq!((poses.len(), exported.len()), (count("keyframes"), count("keyframes")));
    for ((recorded, time_s), pose) in
        poses.iter().zip(&exported.timestamps).zip(&exported.world_from_body)
    {
        assert!((recorded.time_ns as f64 * 1e-9 - time_s).abs() < 1e-6);
        let alone = se3(&part(&recorded.message, "pose"), ["position", "orientation"]);
        assert!(difference(&alone, pose) < 1e-9);
        let at_its_time = transforms.iter().filter(|t| t.time_ns == recorded.time_ns);
        let chains: Vec<Se3> = at_its_time.filter_map(|t| chained(t, "frontend")).collect();
        assert!(!chains.is_empty() && chains.iter().all(|chain| difference(chain, pose) < 1e-9));
    }
    let path = on(&all, "/covis/trajectory/frontend")[0].list("poses");
    assert_eq!(path.len(), exported.len());
    let last = se3(path.last().unwrap(), ["position", "orientation"]);
    assert!(difference(&last, exported.world_from_body.last().unwrap()) < 1e-9);

    // An index and a footer, and the same bytes from the same map, also on standard output.
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    assert_eq!(summary.stats.unwrap().message_count as usize, all.len());
    let mut piped = workspace.command();
    let output = piped.args(["record", "room", "-", "--server", url]).output().unwrap();
    assert!(output.status.success() && output.stdout == bytes);
}

#[test]
fn closures_are_lines_between_their_keyframes_and_tell_their_verdicts() {
    let workspace = Workspace::new();
    let server = Running::start(&workspace, &workspace.path("data"));
    let url = &server.url;
    let graph = golden("twins/sphere-200.g2o");
    workspace.json(&format!("map import sphere {{}} --json --server {url}"), &[&graph]);
    let listed = workspace.json(&format!("map constraints sphere --json --server {url}"), &[]);
    let rows = listed["constraints"].as_array().unwrap();
    let closures = rows.iter().filter(|row| row["kind"] == "loop closure").count();
    workspace.run(&format!("record sphere a.mcap --server {url}"), &[]);
    let all = read(&fs::read(workspace.path("a.mcap")).unwrap());
    let scene = on(&all, "/covis/closures")[0];
    let entities = scene.list("entities");
    assert_eq!(scene.schema, "foxglove.SceneUpdate");
    assert!(closures > 100 && entities.len() == closures, "{closures} {}", entities.len());
    let state = on(&all, "/covis/map")[0];
    assert_eq!(state.count("closure_count") + state.count("switched_off_closure_count"), closures);
    for entity in entities {
        let lines = entity.get_field_by_name("lines").unwrap().into_owned();
        let line = lines.as_list().unwrap()[0].as_message().unwrap().clone();
        assert_eq!(line.get_field_by_name("points").unwrap().as_list().unwrap().len(), 2);
        let metadata = entity.get_field_by_name("metadata").unwrap().into_owned();
        let first = metadata.as_list().unwrap()[0].as_message().unwrap().clone();
        assert_eq!(first.get_field_by_name("key").unwrap().as_str(), Some("verdict"));
    }
}

#[test]
fn a_run_records_its_map_as_it_grows_with_images_frames_and_solves() {
    let workspace = Workspace::new();
    workspace.room(12);
    let document = workspace.json("--log warn run tum:seq --lock-step --json --mcap run.mcap", &[]);
    let all = read(&fs::read(workspace.path("run.mcap")).unwrap());
    let keyframes = number(&document, "keyframes") as usize;
    assert_eq!(on(&all, "/covis/frame").len(), 12);
    assert_eq!(on(&all, "/covis/pose/frontend").len(), keyframes);
    let images = on(&all, "/covis/image");
    assert_eq!(images.len(), keyframes);
    // Each shows what its keyframe saw: the first one comes to the recording a frame late.
    let times = |all: &[&Recorded]| all.iter().map(|one| one.time_ns).collect::<BTreeSet<_>>();
    assert_eq!(times(&images), times(&on(&all, "/covis/pose/frontend")));
    for image in &images {
        assert_eq!(image.schema, "foxglove.CompressedImage");
        assert!(image.field("data").as_bytes().unwrap().starts_with(b"\x89PNG"));
        assert_eq!(image.field("frame_id").as_str(), Some("frontend/camera"));
    }
    let solves = on(&all, "/covis/solve");
    assert!(!solves.is_empty());
    assert!(
        solves
            .iter()
            .all(|s| figure(&s.message, "final_cost") <= figure(&s.message, "initial_cost"))
    );
    // The last state is that of the final map.
    let last = on(&all, "/covis/map").into_iter().max_by_key(|state| state.time_ns).unwrap();
    assert_eq!(last.count("keyframe_count"), keyframes);
    assert!(last.count("landmark_count") > 50);
    // Landmarks have the colors of the room.
    let cloud = on(&all, "/covis/landmarks").into_iter().max_by_key(|state| state.time_ns).unwrap();
    assert_eq!(cloud.field("point_stride").as_u32(), Some(20));
    let data = cloud.field("data");
    let points = data.as_bytes().unwrap().chunks_exact(20);
    let colors: BTreeSet<&[u8]> = points.map(|point| &point[16..]).collect();
    assert!(colors.len() > 20 && colors.iter().all(|color| color[3] == 255), "{colors:?}");
    assert!(on(&all, "/covis/mesh").is_empty());
}

#[test]
fn a_run_that_fuses_a_surface_records_it_as_it_is_in_the_file() {
    let workspace = Workspace::new();
    workspace.room(6);
    let run = "--log warn run tum:seq --lock-step --json --mesh --voxel 0.05 --mcap run.mcap";
    let document = workspace.json(run, &[]);
    let all = read(&fs::read(workspace.path("run.mcap")).unwrap());
    let meshes = on(&all, "/covis/mesh");
    assert_eq!(meshes.len(), 1);
    let entity = &meshes[0].list("entities")[0];
    let surface = entity.get_field_by_name("triangles").unwrap();
    let surface = surface.as_list().unwrap()[0].as_message().unwrap().clone();
    let size = |name: &str| surface.get_field_by_name(name).unwrap().as_list().unwrap().len();
    let vertices = number(&document["mesh"], "vertices") as usize;
    assert!(vertices > 1000);
    assert_eq!([size("points"), size("colors")], [vertices, vertices]);
    assert_eq!(size("indices"), 3 * number(&document["mesh"], "triangles") as usize);
    let last_ns = on(&all, "/covis/frame").iter().map(|frame| frame.time_ns).max();
    assert_eq!(Some(meshes[0].time_ns), last_ns);
}

#[cfg(unix)]
#[test]
fn a_recording_that_follows_ends_complete_on_a_signal_and_readable_where_it_was_killed() {
    let workspace = Workspace::new();
    let server = Running::start(&workspace, &workspace.path("data"));
    let url = &server.url;
    let graph = golden("twins/sphere-200.g2o");
    workspace.json(&format!("map import sphere {{}} --json --server {url}"), &[&graph]);
    let once = {
        workspace.run(&format!("record sphere once.mcap --server {url}"), &[]);
        read(&fs::read(workspace.path("once.mcap")).unwrap()).len()
    };
    // A recording on a pipe: what it has flushed tells that it follows.
    let follow = || {
        let mut command = workspace.command();
        command.args(["record", "sphere", "-", "--follow", "--every", "0", "--server", url]);
        Process::spawn(command.stdout(Stdio::piped()).stderr(Stdio::null()))
    };
    for signal in [Signal::INT, Signal::KILL] {
        let mut recording = follow();
        let mut out = recording.stdout.take().unwrap();
        let mut bytes = Vec::new();
        let mut buffer = vec![0; 1 << 16];
        let whole = |bytes: &[u8]| {
            let options = mcap::read::Options::IgnoreEndMagic;
            let messages = mcap::MessageStream::new_with_options(bytes, options.into());
            messages.map_or(0, |messages| messages.map_while(Result::ok).count())
        };
        while whole(&bytes) < once {
            let count = out.read(&mut buffer).unwrap();
            assert!(count > 0, "the recording ended by itself");
            bytes.extend(&buffer[..count]);
        }
        recording.signal(signal);
        out.read_to_end(&mut bytes).unwrap();
        let status = recording.wait().unwrap();
        assert_eq!(whole(&bytes), once);
        let summary = mcap::Summary::read(&bytes);
        if signal == Signal::INT {
            assert!(status.success());
            assert!(summary.unwrap().is_some(), "no footer");
        } else {
            assert!(summary.is_err(), "a footer where none can be");
        }
    }
}

#[test]
fn what_cannot_be_recorded_is_one_line() {
    let workspace = Workspace::new();
    let server = Running::start(&workspace, &workspace.path("data"));
    let run = |arguments: &str| workspace.run(&format!("{arguments} --server {}", server.url), &[]);
    run("record none a.mcap").expect_failure(&["none"]);
    assert!(!workspace.path("a.mcap").exists(), "a file without a map");
    workspace.json(
        &format!("map import sphere {{}} --json --server {}", server.url),
        &[&golden("twins/sphere-200.g2o")],
    );
    run("record sphere no/where.mcap").expect_failure(&["no/where.mcap"]);
    assert_eq!(run("record sphere a.mcap --for 1 --follow").code, Some(2));
    assert_eq!(run("record sphere a.mcap --for -1").code, Some(2));
    assert_eq!(run("record sphere a.mcap --for 0").code, Some(0));
    let ran = workspace.run("--log warn run synthetic:static --frames 2 --mcap - --out out", &[]);
    ran.expect_failure(&["--mcap"]);
}
