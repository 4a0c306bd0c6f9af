//! Captures of phones through the command line: each layout, made of a synthetic sequence with depth of a
//! lower resolution, is tracked as well as the sequence itself; poses help where frames are few; refined
//! poses go back into `transforms.json`.

use std::path::{Path, PathBuf};

use covis::frontend::image::{Image, RgbdFrame};
use covis::frontend::input::{FolderOptions, encode, open_folder};
use covis_solvers::geometry::{LieGroup, Se3, So3};
use covis_solvers::io::trajectory::Trajectory;
use covis_solvers::testing::data;
use fs_err as fs;
use nalgebra::{Matrix3, Vector3};
use serde_json::{Value, json};

use crate::cli_support::{Workspace, number};

/// The size of a phone's depth for images of 640 x 480.
const DEPTH: (usize, usize) = (256, 192);

/// A sequence as a phone would have it.
struct Phone {
    frames: Vec<RgbdFrame>,
    /// fx, fy, cx, cy from the first pixel's corner, and k1, k2, p1, p2.
    lens: [f64; 8],
    /// The poses that it gives.
    poses: Vec<Se3>,
}

impl Phone {
    /// Every `step`th frame of a folder, with poses that are off as `error` says of each frame.
    fn of(folder: &Path, step: usize, error: impl Fn(usize) -> Se3) -> Self {
        let mut source = open_folder(folder, FolderOptions::default()).unwrap().source;
        let c = *source.camera();
        assert_eq!(c.k3, 0.0);
        let all = std::iter::from_fn(|| source.next_frame()).map(Result::unwrap);
        let frames: Vec<RgbdFrame> = all.step_by(step).collect();
        let truth = Trajectory::read(&folder.join("groundtruth.txt")).unwrap();
        let at = |frame: &RgbdFrame| {
            let near = |time: &&f64| (**time - frame.timestamp_s).abs() < 1e-4;
            let index = truth.timestamps.iter().position(|time| near(&time)).unwrap();
            truth.world_from_body[index]
        };
        let poses = frames.iter().enumerate().map(|(k, frame)| at(frame).compose(&error(k)));
        let lens = [c.fx, c.fy, c.cx + 0.5, c.cy + 0.5, c.k1, c.k2, c.p1, c.p2];
        Self { poses: poses.collect(), lens, frames }
    }

    /// Depth of a frame at the phone's resolution, m.
    fn depth(frame: &RgbdFrame) -> Image<f32> {
        let (width, height) = frame.depth_m.size();
        let mut depth = Image::filled(DEPTH.0, DEPTH.1, 0.0);
        for v in 0..DEPTH.1 {
            for u in 0..DEPTH.0 {
                let nearest = |at: usize, from: usize, to: usize| (2 * at + 1) * from / (2 * to);
                let at = frame.depth_m.at(nearest(u, width, DEPTH.0), nearest(v, height, DEPTH.1));
                depth.set(u, v, at);
            }
        }
        depth
    }

    /// Millimeters as a PNG.
    fn png(frame: &RgbdFrame) -> Vec<u8> {
        encode::gray16(&Self::depth(frame).map(|m| (1000.0 * m).round() as u16)).unwrap()
    }

    /// The rows [R | t] of an OpenGL camera.
    fn rows(pose: &Se3) -> [[f64; 4]; 3] {
        let rotation =
            pose.rotation.matrix() * Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, -1.0));
        [0, 1, 2]
            .map(|i| [rotation[(i, 0)], rotation[(i, 1)], rotation[(i, 2)], pose.translation[i]])
    }

    fn nerfstudio(&self, folder: &Path) -> PathBuf {
        let frame = |(number, (frame, pose)): (usize, (&RgbdFrame, &Se3))| {
            // Names without leading zeros, so that 10 must follow 9.
            let (color, depth) =
                (format!("images/frame_{number}.png"), format!("depth/{number}.png"));
            write(folder, &color, encode::rgb(&frame.color).unwrap());
            write(folder, &depth, Self::png(frame));
            let [a, b, c] = Self::rows(pose);
            json!({
                "file_path": color, "depth_file_path": depth, "colmap_im_id": number,
                "transform_matrix": [a, b, c, [0.0, 0.0, 0.0, 1.0]],
            })
        };
        let frames: Vec<Value> =
            self.frames.iter().zip(&self.poses).enumerate().map(frame).collect();
        let [fx, fy, cx, cy, k1, k2, p1, p2] = self.lens;
        let json = json!({
            "camera_model": "OPENCV", "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy, "w": 640, "h": 480,
            "k1": k1, "k2": k2, "p1": p1, "p2": p2, "aabb_scale": 16, "frames": frames,
        });
        write(folder, "transforms.json", json.to_string());
        folder.to_owned()
    }

    /// With or without poses, in `corrected_cameras`; those of `cameras` are far off.
    fn polycam(&self, folder: &Path, has_poses: bool) -> PathBuf {
        let [fx, fy, cx, cy, ..] = self.lens;
        for (frame, pose) in self.frames.iter().zip(&self.poses) {
            let microseconds = (frame.timestamp_s * 1e6).round() as u64;
            let camera = |pose: &Se3| {
                let mut json = json!({
                    "fx": fx, "fy": fy, "cx": cx, "cy": cy, "width": 640, "height": 480,
                    "timestamp": microseconds, "blur_score": 12.5,
                });
                for (i, row) in Self::rows(pose).iter().enumerate() {
                    for (j, value) in row.iter().enumerate() {
                        json[format!("t_{i}{j}")] = json!(value);
                    }
                }
                json.to_string()
            };
            let keyframes = folder.join("keyframes");
            let put = |kind: &str, end: &str, bytes: Vec<u8>| {
                write(&keyframes, &format!("{kind}/{microseconds}.{end}"), bytes);
            };
            put("images", "png", encode::rgb(&frame.color).unwrap());
            put("depth", "png", Self::png(frame));
            put("confidence", "png", encode::gray8(&Image::filled(DEPTH.0, DEPTH.1, 255)).unwrap());
            put("cameras", "json", camera(&Se3::identity()).into_bytes());
            fs::create_dir_all(keyframes.join("corrected_cameras")).unwrap();
            if has_poses {
                put("corrected_cameras", "json", camera(pose).into_bytes());
            }
        }
        folder.to_owned()
    }

    fn record3d(&self, folder: &Path) -> PathBuf {
        let [fx, fy, cx, cy, ..] = self.lens;
        let pack = |bytes: &[u8]| {
            let mut packed = Vec::new();
            lzfse_rust::encode_bytes(bytes, &mut packed).unwrap();
            packed
        };
        for (number, frame) in self.frames.iter().enumerate() {
            let depth = Self::depth(frame);
            let bytes: Vec<u8> = depth.pixels().iter().flat_map(|m| m.to_le_bytes()).collect();
            write(folder, &format!("rgbd/{number}.jpg"), encode::rgb(&frame.color).unwrap());
            write(folder, &format!("rgbd/{number}.depth"), pack(&bytes));
            write(folder, &format!("rgbd/{number}.conf"), pack(&vec![2; DEPTH.0 * DEPTH.1]));
        }
        let pose = |pose: &Se3| {
            let half_turn = So3::exp(&Vector3::new(std::f64::consts::PI, 0.0, 0.0));
            let rotation = pose.rotation.compose(&half_turn);
            let (q, t) = (rotation.quaternion(), pose.translation);
            [q.i, q.j, q.k, q.w, t.x, t.y, t.z]
        };
        let poses: Vec<_> = self.poses.iter().map(pose).collect();
        let times: Vec<f64> = self.frames.iter().map(|frame| frame.timestamp_s).collect();
        let json = json!({
            "w": 640, "h": 480, "dw": DEPTH.0, "dh": DEPTH.1, "fps": 30, "poses": poses,
            "K": [fx, 0, 0, 0, fy, 0, cx, cy, 1], "frameTimestamps": times, "cameraType": 1,
        });
        write(folder, "metadata", json.to_string());
        folder.to_owned()
    }
}

fn write(folder: &Path, name: &str, bytes: impl AsRef<[u8]>) {
    let path = folder.join(name);
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, bytes).unwrap();
}

/// No error of a phone's pose.
fn exact(_: usize) -> Se3 {
    Se3::identity()
}

/// A phone's error: it drifts, and each pose is off by millimeters and tenths of a degree.
fn drifting(frame: usize) -> Se3 {
    let k = frame as f64;
    let turn = Vector3::new(0.003 * (1.7 * k).sin(), 0.001 * k, 0.003 * (2.3 * k).cos());
    let shift = Vector3::new(0.004 * k, 0.004 * (1.3 * k).sin(), 0.004 * (2.9 * k).cos());
    Se3::new(So3::exp(&turn), shift)
}

/// Runs a source; the JSON object.
fn run(workspace: &Workspace, source: &str, out: &str) -> Value {
    let arguments = format!("--log error run {source} --out {out} --lock-step --no-mask --json");
    workspace.json(&arguments, &[])
}

/// The absolute error of a trajectory, m.
fn error_m(workspace: &Workspace, truth: &str, estimate: &str) -> f64 {
    let ape = workspace.json(&format!("eval ape {truth} {estimate} --json"), &[]);
    number(&ape, "rmse")
}

/// The file of the poses that a capture gives.
fn poses_of(workspace: &Workspace, capture: &str) -> String {
    let out = format!("{}.txt", capture.replace(['/', '.'], "-"));
    let ran = workspace.run(&format!("eval truth {capture} {out}"), &[]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    out
}

#[test]
fn captures_of_each_layout_are_tracked_as_the_sequence_that_they_were_made_of() {
    let workspace = Workspace::new();
    let folder = workspace.room(30);
    let whole = run(&workspace, "tum:seq", "whole");
    assert_eq!(number(&whole, "tracked"), 30.0);
    let usual = error_m(&workspace, "seq", "whole/trajectory.txt");
    let phone = Phone::of(&folder, 1, exact);
    phone.nerfstudio(&workspace.path("nerf"));
    phone.polycam(&workspace.path("poly"), true);
    phone.record3d(&workspace.path("r3d"));
    for (name, truth) in [("nerf", "nerf"), ("poly", "seq"), ("r3d", "seq")] {
        let out = format!("out-{name}");
        let document = run(&workspace, name, &out);
        assert_eq!(
            (number(&document, "tracked"), number(&document, "skipped")),
            (30.0, 0.0),
            "{name}"
        );
        let error = error_m(&workspace, truth, &format!("{out}/trajectory.txt"));
        // Depth of two fifths of the resolution in millimeters costs a little.
        assert!(error < 1.5 * usual + 0.002, "{name}: {error} m, {usual} m from the folder");
    }
    // What was given is read as a trajectory, and frames are fused at it.
    let ran = workspace.run("eval truth poly given.txt", &[]);
    assert_eq!(ran.stdout.trim(), "30 poses in given.txt", "{}", ran.stderr);
    assert!(error_m(&workspace, "seq", "given.txt") < 1e-6);
    let fused =
        workspace.json("--log error fuse r3d --poses r3d --voxel 0.05 --out fused --json", &[]);
    assert_eq!((number(&fused, "frames"), number(&fused, "skipped")), (30.0, 0.0));
}

#[test]
fn poses_of_the_phone_carry_tracking_over_few_frames_a_second() {
    let workspace = Workspace::new();
    let ran =
        workspace.run("--log warn synth rgbd seq --scene rounds --frames 150 --no-noise", &[]);
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    // Five frames a second.
    let phone = Phone::of(&workspace.path("seq"), 6, drifting);
    phone.polycam(&workspace.path("with"), true);
    phone.polycam(&workspace.path("without"), false);
    let [with, without] =
        ["with", "without"].map(|name| run(&workspace, name, &format!("{name}-out")));
    let count = phone.frames.len() as f64;
    assert_eq!((number(&with, "tracked"), number(&with, "lost")), (count, 0.0));
    let error = error_m(&workspace, "seq", "with-out/trajectory.txt");
    let given = error_m(&workspace, "seq", &poses_of(&workspace, "with"));
    assert!(error < given && error < 0.05, "{error} m; given {given} m");
    // Constant velocity does not reach so far.
    assert!(number(&without, "lost") > 0.5 * count, "{without}");
}

#[test]
fn refined_poses_are_written_for_training_and_lost_frames_keep_theirs() {
    let workspace = Workspace::new();
    let folder = workspace.room(24);
    let truth = Phone::of(&folder, 2, exact);
    let phone = Phone::of(&folder, 2, drifting);
    let capture = phone.nerfstudio(&workspace.path("nerf"));
    write(&capture, "images/frame_5.png", "no image");
    let document = run(&workspace, "nerf/transforms.json", "out");
    assert_eq!(document["refined"], json!({ "refined": 11, "kept": 1 }));
    let read = |path: &Path| -> Value { serde_json::from_slice(&fs::read(path).unwrap()).unwrap() };
    let (before, after) =
        (read(&capture.join("transforms.json")), read(&workspace.path("out/transforms.json")));
    assert_eq!(before["frames"][5], after["frames"][5]);
    assert_ne!(before["frames"][4], after["frames"][4]);
    assert_eq!(before["frames"][4]["colmap_im_id"], after["frames"][4]["colmap_im_id"]);
    assert_eq!((&before["fl_x"], &before["aabb_scale"]), (&after["fl_x"], &after["aabb_scale"]));
    // It is read again, and is nearer to the truth.
    fs::rename(workspace.path("out/transforms.json"), workspace.path("nerf/refined.json")).unwrap();
    truth.nerfstudio(&workspace.path("true"));
    let given = error_m(&workspace, "true", &poses_of(&workspace, "nerf"));
    let refined = error_m(&workspace, "true", &poses_of(&workspace, "nerf/refined.json"));
    assert!(refined < 0.5 * given, "{refined} m refined, {given} m given");

    let ran = workspace.run("--log error run nerf --out nerf --force", &[]);
    ran.expect_failure(&["transforms.json: this is the capture's own file"]);
}

#[test]
fn what_is_no_capture_is_refused_with_what_to_do() {
    let workspace = Workspace::new();
    let refused = |source: &str, parts: &[&str]| {
        workspace.run(&format!("--log error run {source}"), &[]).expect_failure(parts);
    };
    workspace.file("walk.r3d", "PK");
    refused("walk.r3d", &["walk.r3d: is not a zip archive that can be read"]);
    fs::create_dir(workspace.path("empty")).unwrap();
    refused("capture:empty", &["empty: no capture: neither transforms.json"]);
    workspace.file("cut.json", "{\"frames\": [");
    refused("cut.json", &["cut.json: EOF while parsing"]);
    refused("cut.json --color-topic /rgb", &["topics are named for an MCAP file or a bag"]);

    // EuRoC and KITTI have no depth; their trajectories are read by the folder.
    let table = "#timestamp,p_x,p_y,p_z,q_w,q_x,q_y,q_z\n1000000000,1,2,3,1,0,0,0\n2000000000,2,2,3,1,0,0,0\n";
    let mav = workspace.path("MH_01/mav0");
    write(&mav, "cam0/data.csv", "");
    write(&mav, "imu0/data.csv", "");
    refused("MH_01", &["MH_01: a folder of EuRoC with cam0, imu0: it has no depth images"]);
    let ran = workspace.run("eval truth MH_01 out.txt", &[]);
    ran.expect_failure(&["MH_01: a folder of EuRoC without its poses"]);
    write(&mav, "state_groundtruth_estimate0/data.csv", table);
    refused("MH_01", &["`covis eval` compares with the trajectory in it"]);
    assert_eq!(workspace.run("eval truth MH_01 out.txt", &[]).stdout.trim(), "2 poses in out.txt");
    let truth = Trajectory::read(&workspace.path("out.txt")).unwrap();
    assert_eq!(
        (&*truth.timestamps, truth.world_from_body[1].translation.x),
        (&[1.0, 2.0][..], 2.0)
    );

    let row = "1 0 0 0 0 1 0 0 0 0 1 ";
    write(&workspace.path("kitti"), "sequences/07/calib.txt", "");
    write(&workspace.path("kitti"), "sequences/07/image_2/000000.png", "");
    write(&workspace.path("kitti"), "poses/07.txt", format!("{row}0\n{row}1\n"));
    refused("kitti/sequences/07", &["07: a folder of KITTI with image_2: it has no depth images"]);
    write(&workspace.path("kitti"), "sequences/07/times.txt", "5.0\n5.1\n");
    workspace.run("eval truth kitti/sequences/07 kitti.txt", &[]);
    let times = Trajectory::read(&workspace.path("kitti.txt")).unwrap().timestamps;
    assert_eq!(times, [5.0, 5.1]);
    write(&workspace.path("kitti"), "sequences/07/times.txt", "5.0\n");
    let ran = workspace.run("eval truth kitti/sequences/07 kitti.txt --force", &[]);
    ran.expect_failure(&["times.txt: 1 times, but there are 2 poses"]);
}

#[test]
fn a_capture_of_a_recorded_sequence_is_tracked_as_its_folder() {
    let Some(folder) = data("rgbd/tum_fr1_rpy") else { return };
    let workspace = Workspace::new();
    let mut source = open_folder(&folder, FolderOptions::default()).unwrap().source;
    let all = std::iter::from_fn(|| source.next_frame()).filter_map(Result::ok);
    let frames: Vec<RgbdFrame> = all.take(60).collect();
    // The camera's lens has distortion, which only transforms.json can say; k3 is beyond OPENCV's four.
    let c = *source.camera();
    let lens = [c.fx, c.fy, c.cx + 0.5, c.cy + 0.5, c.k1, c.k2, c.p1, c.p2];
    let poses = vec![Se3::identity(); frames.len()];
    let times: Vec<f64> = frames.iter().map(|frame| frame.timestamp_s).collect();
    let phone = Phone { frames, lens, poses };
    let capture = phone.nerfstudio(&workspace.path("nerf"));
    let path = capture.join("transforms.json");
    let mut json: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    json["k3"] = json!(c.k3);
    fs::write(&path, json.to_string()).unwrap();
    let document = run(&workspace, "nerf", "out");
    assert_eq!((number(&document, "tracked"), number(&document, "lost")), (60.0, 0.0));
    // Poses that say that the camera stands still do not hold it.
    let found = Trajectory::read(&workspace.path("out/trajectory.txt")).unwrap();
    let mut timed = Trajectory::default();
    for (&time, &pose) in times.iter().zip(&found.world_from_body) {
        timed.push(time, pose);
    }
    timed.write(&workspace.path("timed.txt")).unwrap();
    let truth = folder.join("groundtruth.txt");
    let ape = workspace.json("eval ape {} timed.txt --max-time-difference 0.02 --json", &[&truth]);
    let error = number(&ape, "rmse");
    assert!(error < 0.03, "{error} m");
}
