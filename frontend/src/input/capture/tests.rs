//! Small captures of each layout: what is read of them, and what is said of bad ones.

use std::path::Path;

use serde_json::{Value, json};

use super::*;
use crate::image::{Image, RgbdFrame};
use crate::input::{FrameError, encode};

/// The matrix of a camera at this x, m.
fn matrix(x: f64) -> Value {
    json!([[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
}

fn write(folder: &Path, name: &str, bytes: impl AsRef<[u8]>) {
    let path = folder.join(name);
    fs_err::create_dir_all(path.parent().unwrap()).unwrap();
    fs_err::write(path, bytes).unwrap();
}

/// Color of 8 x 6 pixels and this brightness.
fn color(value: u8) -> Vec<u8> {
    encode::rgb(&Image::filled(8, 6, [value; 3])).unwrap()
}

/// Depth of 4 x 3 pixels in millimeters: the left half near, the right half far.
fn depth() -> Vec<u8> {
    let pixels = [1000u16, 1000, 3000, 3000].repeat(3);
    encode::gray16(&Image::from_pixels(4, 3, pixels).unwrap()).unwrap()
}

fn transforms() -> Value {
    let frame = |number: u32| {
        let (color, depth) = (format!("images/{number}.png"), format!("./depth/{number}.png"));
        json!({
            "file_path": color, "depth_file_path": depth,
            "transform_matrix": matrix(f64::from(number)), "sharpness": 7,
        })
    };
    json!({
        "camera_model": "OPENCV", "fl_x": 8.0, "fl_y": 8.5, "cx": 4, "cy": 3, "w": 8, "h": 6,
        "k1": 0.01, "aabb_scale": 16, "frames": [frame(10), frame(9), frame(11)],
    })
}

/// A nerfstudio folder with this JSON.
fn nerfstudio(json: &Value) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    for number in [9, 10, 11] {
        write(folder.path(), &format!("images/{number}.png"), color(number));
        write(folder.path(), &format!("depth/{number}.png"), depth());
    }
    write(folder.path(), TRANSFORMS_FILE, json.to_string());
    folder
}

fn frames(path: &Path) -> Vec<Result<RgbdFrame, FrameError>> {
    let mut source = open_capture(path, FolderOptions::default()).unwrap().source;
    let frames: Vec<_> = std::iter::from_fn(|| source.next_frame()).collect();
    assert_eq!(frames.len(), source.len());
    frames
}

/// Why a capture cannot be opened.
fn refused(path: &Path) -> String {
    open_capture(path, FolderOptions::default()).err().unwrap().to_string()
}

#[test]
fn a_nerfstudio_folder_has_its_frames_by_name_with_depth_of_their_size() {
    let folder = nerfstudio(&transforms());
    assert!(is_capture(folder.path()) && !is_capture(&folder.path().join("images")));
    let open = open_capture(folder.path(), FolderOptions::default()).unwrap();
    let camera = open.source.camera();
    assert_eq!((camera.fx, camera.fy, camera.cx, camera.cy), (8.0, 8.5, 3.5, 2.5));
    assert_eq!((camera.k1, open.without_depth), (0.01, 0));
    let found: Vec<_> = frames(folder.path()).into_iter().map(Result::unwrap).collect();
    let described = found.iter().map(|f| (f.timestamp_s, f.color.at(0, 0)[0]));
    assert_eq!(described.collect::<Vec<_>>(), [(0.0, 9), (0.1, 10), (0.2, 11)]);
    assert_eq!(found[0].depth_m.row(5), [1.0, 1.0, 1.0, 1.0, 3.0, 3.0, 3.0, 3.0]);
    let pose = found[1].given_pose.unwrap();
    assert_eq!(pose.translation.x, 10.0);
    // It looks along the capture's -z, with its y up.
    assert!(
        (pose.rotation.matrix().diagonal() - nalgebra::Vector3::new(1.0, -1.0, -1.0)).amax()
            < 1e-12
    );
    // The file itself is enough, and the camera may be given in pixels of the images.
    let options = FolderOptions { camera: Some("9,9,3.5,2.5"), depth_units_per_m: Some(500.0) };
    let mut open = open_capture(&folder.path().join(TRANSFORMS_FILE), options).unwrap();
    assert_eq!((open.source.camera().fx, open.source.camera().k1), (9.0, 0.0));
    assert_eq!(open.source.next_frame().unwrap().unwrap().depth_m.at(0, 0), 2.0);
}

#[test]
fn each_frame_is_brought_to_the_median_lens() {
    let mut json = transforms();
    json["frames"][0]["cx"] = json!(5);
    json["frames"][1]["h"] = json!(12);
    let folder = nerfstudio(&json);
    // A ramp to the right, seen through a lens whose center is one pixel further right.
    let ramp: Vec<_> = (0..48).map(|k| [20 * (k % 8) as u8; 3]).collect();
    let ramp = encode::rgb(&Image::from_pixels(8, 6, ramp).unwrap()).unwrap();
    write(folder.path(), "images/10.png", ramp);
    let mut found = frames(folder.path());
    let error = found.remove(0).unwrap_err().to_string();
    assert!(error.ends_with("images/9.png: 8x6 pixels, not 8x12"), "{error}");
    let error = found.remove(0).unwrap_err().to_string();
    assert!(error.ends_with("images/10.png: 8x6 pixels, not 8x12"), "{error}");
    json["frames"][1]["h"] = json!(6);
    write(folder.path(), TRANSFORMS_FILE, json.to_string());
    let frame = frames(folder.path()).remove(1).unwrap();
    assert_eq!(
        frame.color.row(2).iter().map(|p| p[0]).collect::<Vec<_>>(),
        [20, 40, 60, 80, 100, 120, 140, 140]
    );
    assert_eq!(frame.depth_m.row(2), [1.0, 1.0, 1.0, 3.0, 3.0, 3.0, 3.0, 0.0]);
}

#[test]
fn a_large_image_becomes_smaller_and_its_lens_with_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut json = transforms();
    for (field, value) in [("w", 1920), ("h", 1440), ("cx", 960), ("cy", 720), ("fl_x", 1500)] {
        json[field] = json!(value);
    }
    write(folder.path(), TRANSFORMS_FILE, json.to_string());
    let large = encode::rgb(&Image::filled(1920, 1440, [50; 3])).unwrap();
    for number in [9, 10, 11] {
        write(folder.path(), &format!("images/{number}.png"), &large);
        write(folder.path(), &format!("depth/{number}.png"), depth());
    }
    let mut source = open_capture(folder.path(), FolderOptions::default()).unwrap().source;
    assert_eq!((source.camera().fx, source.camera().cx), (500.0, 319.5));
    let frame = source.next_frame().unwrap().unwrap();
    assert_eq!((frame.color.size(), frame.depth_m.size()), ((640, 480), (640, 480)));
    assert_eq!(frame.color.at(639, 479), [50; 3]);
    assert_eq!((frame.depth_m.at(319, 7), frame.depth_m.at(320, 7)), (1.0, 3.0));
}

#[test]
fn a_bad_transforms_file_is_refused_by_file_and_field() {
    let with = |change: &dyn Fn(&mut Value)| {
        let mut json = transforms();
        change(&mut json);
        nerfstudio(&json)
    };
    let refused_if = |change: &dyn Fn(&mut Value)| refused(with(change).path());
    let error = refused_if(&|json| json["camera_model"] = json!("OPENCV_FISHEYE"));
    assert!(error.ends_with(
        "transforms.json: the camera model is OPENCV_FISHEYE; OPENCV and PINHOLE are read"
    ));
    let error = refused_if(&|json| json["depth_unit_scale_factor"] = json!(-1));
    assert!(error.contains("depth_unit_scale_factor is -1, not"), "{error}");
    let error = refused_if(&|json| json["frames"] = json!([]));
    assert!(error.ends_with("transforms.json: the capture has no images"), "{error}");
    let error = refused_if(&|json| json["frames"][1]["transform_matrix"][2] = json!([1, 2]));
    assert!(error.contains("transforms.json: invalid length 2") && error.contains("line 1 column"));
    let error = refused_if(&|json| {
        json["frames"].as_array_mut().unwrap().iter_mut().for_each(|frame| {
            frame.as_object_mut().unwrap().remove("depth_file_path");
        });
    });
    assert!(error.ends_with("none of 3 images has depth (depth_file_path)"), "{error}");
    let error = refused_if(&|json| drop(json.as_object_mut().unwrap().remove("fl_y")));
    assert!(error.contains("frame images/9.png: fl_y is missing"), "{error}");
    let folder = nerfstudio(&transforms());
    write(folder.path(), TRANSFORMS_FILE, "{\"frames\": [{\"file_path\": NaN");
    assert!(refused(folder.path()).contains("transforms.json: expected value at line 1"));
    assert!(refused(&folder.path().join("images")).contains("no capture: neither transforms.json"));
}

#[test]
fn a_bad_frame_is_reported_and_the_next_one_follows() {
    let mut json = transforms();
    json["frames"][1]["fl_x"] = json!(-4);
    json["frames"][0]["file_path"] = json!("../10.png");
    json["frames"][2]["depth_file_path"] = json!("depth/none.png");
    let last = json["frames"][2].clone();
    let all = json["frames"].as_array_mut().unwrap();
    let more = [("k1", json!(0.5)), ("depth_file_path", json!("depth/wide.png"))];
    all.extend(more.into_iter().zip(12..).map(|((field, value), number)| {
        let mut frame = last.clone();
        frame["file_path"] = json!(format!("images/{number}.png"));
        frame[field] = value;
        frame
    }));
    let folder = nerfstudio(&json);
    let wide = encode::gray16(&Image::filled(8, 3, 1000)).unwrap();
    write(folder.path(), "depth/wide.png", wide);
    for number in [12, 13] {
        write(folder.path(), &format!("images/{number}.png"), color(number));
    }
    let errors: Vec<_> =
        frames(folder.path()).into_iter().map(|f| f.unwrap_err().to_string()).collect();
    let parts = [
        "transforms.json, frame ../10.png: the file is outside of the capture's folder",
        "transforms.json, frame images/9.png: fl_x is -4, not a focal length",
        "depth/none.png: cannot be read",
        "images/12.png: the distortion differs from the first frame's",
        "wide.png: depth of 8x3 pixels does not cover the color image of 8x6",
    ];
    assert_eq!(errors.len(), parts.len());
    for (error, part) in errors.iter().zip(parts) {
        assert!(error.contains(part), "`{part}` in `{error}`");
    }
}

#[test]
fn refined_poses_replace_those_of_the_file_and_all_else_stays() {
    let folder = nerfstudio(&transforms());
    let path = transforms_file(folder.path()).unwrap();
    let given = given_poses(folder.path()).unwrap();
    assert_eq!(given[0].frame, "images/9.png");
    let moved = |frame: &str| {
        let mut pose = given.iter().find(|pose| pose.frame == frame)?.world_from_camera;
        pose.translation.z += 0.5;
        (frame != "images/11.png").then_some(pose)
    };
    let (text, kept) = with_poses(&path, moved).unwrap();
    assert_eq!(kept, 1);
    let written: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(written["frames"][2], transforms()["frames"][2]);
    assert_eq!(written["aabb_scale"], 16);
    write(folder.path(), TRANSFORMS_FILE, text);
    let again = given_poses(folder.path()).unwrap();
    assert_eq!(again[1].world_from_camera.translation.z, 0.5);
    assert_eq!(again[0].world_from_camera.translation.x, 9.0);
    assert_eq!(again[2], given[2]);
}

/// A Polycam folder of two frames, the first with corrected pose and confidence.
fn polycam_folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let camera = |microseconds: u64, x: f64| {
        let mut json = json!({
            "fx": 8.0, "fy": 8.0, "cx": 4.0, "cy": 3.0, "width": 8, "height": 6, "blur_score": 165.6,
            "timestamp": microseconds, "neighbors": [1, 2], "manual_keyframe": false,
        });
        for (i, row) in matrix(x).as_array().unwrap()[..3].iter().enumerate() {
            for (j, value) in row.as_array().unwrap().iter().enumerate() {
                json[format!("t_{i}{j}")] = value.clone();
            }
        }
        json.to_string()
    };
    for (stem, number) in [("64000000", 1), ("9500000", 2)] {
        write(path, &format!("keyframes/images/{stem}.png"), color(number));
        write(path, &format!("keyframes/depth/{stem}.png"), depth());
        let time = stem.parse().unwrap();
        write(path, &format!("keyframes/cameras/{stem}.json"), camera(time, f64::from(number)));
    }
    write(path, "keyframes/corrected_cameras/64000000.json", camera(64_000_000, 1.25));
    let confidence = Image::from_pixels(4, 3, [0u8, 127, 255, 255].repeat(3)).unwrap();
    write(path, "keyframes/confidence/64000000.png", encode::gray8(&confidence).unwrap());
    write(path, "keyframes/images/Thumbs.db", "");
    folder
}

#[test]
fn polycam_has_optimized_poses_and_depth_where_the_sensor_is_sure() {
    let folder = polycam_folder();
    let found: Vec<_> = frames(folder.path()).into_iter().map(Result::unwrap).collect();
    assert_eq!(found.iter().map(|f| f.timestamp_s).collect::<Vec<_>>(), [9.5, 64.0]);
    assert_eq!(found[0].given_pose, None, "it was not optimized");
    assert_eq!(found[1].given_pose.unwrap().translation.x, 1.25);
    assert_eq!(found[0].depth_m.row(0), [1.0, 1.0, 1.0, 1.0, 3.0, 3.0, 3.0, 3.0]);
    assert_eq!(found[1].depth_m.row(0), [0.0, 0.0, 1.0, 1.0, 3.0, 3.0, 3.0, 3.0]);
    // Without corrected cameras the poses of the phone hold.
    fs_err::remove_dir_all(folder.path().join("keyframes/corrected_cameras")).unwrap();
    let given = given_poses(folder.path()).unwrap();
    let x: Vec<f64> = given.iter().map(|pose| pose.world_from_camera.translation.x).collect();
    assert_eq!(x, [2.0, 1.0]);
}

#[test]
fn bad_files_of_polycam_are_named_and_the_others_are_read() {
    let folder = polycam_folder();
    write(folder.path(), "keyframes/cameras/9500000.json", "{\"fx\": 8.0, \"fy\": ");
    let found = frames(folder.path());
    let errors: Vec<_> =
        found.iter().filter_map(|f| f.as_ref().err()).map(ToString::to_string).collect();
    assert!(
        errors.len() == 1 && errors[0].contains("cameras/9500000.json: EOF while parsing"),
        "{errors:?}"
    );
    write(folder.path(), "keyframes/cameras/9500000.json", "{}");
    fs_err::remove_file(folder.path().join("keyframes/cameras/64000000.json")).unwrap();
    let error = refused(folder.path());
    assert!(error.contains("cameras/") && error.contains(".json: "), "{error}");
    fs_err::remove_dir_all(folder.path().join("keyframes/depth")).unwrap();
    fs_err::remove_dir_all(folder.path().join("keyframes/cameras")).unwrap();
    assert!(refused(folder.path()).contains("cannot be read"));
}

/// A folder of Record3D with two frames.
fn record3d_folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let pack = |bytes: &[u8]| {
        let mut packed = Vec::new();
        lzfse_rust::encode_bytes(bytes, &mut packed).unwrap();
        packed
    };
    let meters = [1.0f32, f32::NAN, 3.0, 3.0].repeat(3);
    let bytes: Vec<u8> = meters.iter().flat_map(|depth| depth.to_le_bytes()).collect();
    for number in [0, 1] {
        // The layout calls its images JPEG; the first bytes decide.
        write(folder.path(), &format!("rgbd/{number}.jpg"), color(number));
        write(folder.path(), &format!("rgbd/{number}.depth"), pack(&bytes));
        write(folder.path(), &format!("rgbd/{number}.conf"), pack(&[2, 2, 2, 0].repeat(3)));
    }
    let json = json!({
        "w": 8, "h": 6, "dw": 4, "dh": 3, "fps": 60, "K": [8.0, 0, 0, 0, 8.5, 0, 4.0, 3.0, 1],
        "poses": [[0, 0, 0, 1, 0, 0, 0], [0, 0.6, 0, 0.8, 1, 2, 3]], "cameraType": 1,
        "frameTimestamps": [7.5, 7.75], "initPose": [0, 0, 0, 1, 0, 0, 0],
    });
    write(folder.path(), "metadata", json.to_string());
    folder
}

#[test]
fn record3d_has_poses_times_and_compressed_depth() {
    let folder = record3d_folder();
    let found: Vec<_> = frames(folder.path()).into_iter().map(Result::unwrap).collect();
    assert_eq!(found.iter().map(|f| f.timestamp_s).collect::<Vec<_>>(), [7.5, 7.75]);
    assert_eq!(found[0].depth_m.row(0), [1.0, 1.0, 0.0, 0.0, 3.0, 3.0, 0.0, 0.0]);
    let pose = found[1].given_pose.unwrap();
    assert_eq!(pose.translation.as_slice(), [1.0, 2.0, 3.0]);
    let looks = pose.rotation.rotate(&nalgebra::Vector3::z());
    assert!((looks - nalgebra::Vector3::new(-0.96, 0.0, -0.28)).norm() < 1e-12, "{looks}");
    assert_eq!(
        open_capture(folder.path(), FolderOptions::default()).unwrap().source.camera().fy,
        8.5
    );
}

#[test]
fn bad_metadata_of_record3d_are_refused_by_field() {
    let folder = record3d_folder();
    let text = fs_err::read_to_string(folder.path().join("metadata")).unwrap();
    let good: Value = serde_json::from_str(&text).unwrap();
    let with = |field: &str, value: Value| {
        let mut json = good.clone();
        json[field] = value;
        write(folder.path(), "metadata", json.to_string());
    };
    with("dw", json!(0));
    assert!(refused(folder.path()).contains("metadata: dw is 0, not a whole number of pixels"));
    with("dw", json!(8));
    let error = frames(folder.path()).remove(0).unwrap_err().to_string();
    assert!(error.contains("rgbd/0.depth: not 96 bytes of LZFSE: 48 bytes"), "{error}");
    with("K", json!([0, 0, 0, 0, 8.5, 0, 4, 3, 1]));
    assert!(refused(folder.path()).contains("metadata, frame 0: K[0] is 0, not a focal length"));
    with("poses", json!([[0, 0, 0, 0, 1, 2, 3]]));
    let mut found = frames(folder.path());
    let error = found.remove(0).unwrap_err().to_string();
    assert!(error.contains("metadata, frame 0: poses is no rigid motion"), "{error}");
    assert_eq!(found.remove(0).unwrap().given_pose, None);
    with("frameTimestamps", json!([7.5, 7.5]));
    let error = frames(folder.path()).remove(1).unwrap_err().to_string();
    assert!(
        error.contains("timestamp is 7.5, not later than the time of the frame before"),
        "{error}"
    );
}

/// An archive of a folder's files, each name behind `prefix`.
fn packed(folder: &Path, prefix: &str) -> Vec<u8> {
    let mut writer = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let mut folders = vec![folder.to_owned()];
    while let Some(next) = folders.pop() {
        for entry in fs_err::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            let name = path.strip_prefix(folder).unwrap().to_str().unwrap();
            let options = zip::write::SimpleFileOptions::default();
            writer.start_file(format!("{prefix}{name}"), options).unwrap();
            std::io::Write::write_all(&mut writer, &fs_err::read(&path).unwrap()).unwrap();
        }
    }
    writer.finish().unwrap().into_inner()
}

#[test]
fn an_archive_has_the_frames_of_its_folder() {
    let folder = nerfstudio(&transforms());
    let out = tempfile::tempdir().unwrap();
    let expected: Vec<_> = frames(folder.path()).into_iter().map(Result::unwrap).collect();
    for (name, prefix) in [("walk.zip", ""), ("walk.R3D", "walk/")] {
        let path = out.path().join(name);
        fs_err::write(&path, packed(folder.path(), prefix)).unwrap();
        assert!(is_capture(&path) && transforms_file(&path).is_none());
        let found: Vec<_> = frames(&path).into_iter().map(Result::unwrap).collect();
        assert_eq!(found.len(), expected.len());
        for (found, expected) in found.iter().zip(&expected) {
            assert_eq!((&found.color, &found.depth_m), (&expected.color, &expected.depth_m));
            assert_eq!(found.given_pose, expected.given_pose);
        }
        assert_eq!(given_poses(&path).unwrap(), given_poses(folder.path()).unwrap());
    }
    assert_eq!(fs_err::read_dir(out.path()).unwrap().count(), 2, "nothing is unpacked");
}

#[test]
fn an_archive_that_is_none_is_refused_by_name() {
    let folder = nerfstudio(&transforms());
    let path = folder.path().join("walk.zip");
    let whole = packed(&folder.path().join("images"), "");
    fs_err::write(&path, &whole).unwrap();
    assert!(refused(&path).contains("walk.zip: no capture: neither transforms.json"));
    for cut in [0, 2, whole.len() / 2, whole.len() - 5] {
        fs_err::write(&path, &whole[..cut]).unwrap();
        assert!(
            refused(&path).contains("walk.zip: is not a zip archive that can be read"),
            "{cut}"
        );
    }
}

#[test]
fn the_one_folder_of_a_layout_is_not_left_out() {
    let folder = tempfile::tempdir().unwrap();
    write(folder.path(), "keyframes/images/1.jpg", color(9));
    let path = folder.path().join("poly.zip");
    fs_err::write(&path, packed(folder.path(), "")).unwrap();
    let error = refused(&path);
    assert!(error.contains("poly.zip/keyframes/") && !error.contains("no capture"), "{error}");
}

/// Archives that Python's `zipfile` made; those that it cannot make were changed by hand.
fn made(name: &str) -> archive::Archive {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../fuzz/corpus/capture_archive");
    let bytes = fs_err::read(folder.join(name)).unwrap();
    archive::Archive::read_from(std::io::Cursor::new(bytes), Path::new(name)).unwrap()
}

#[test]
fn what_an_archive_says_of_its_entries_is_not_trusted() {
    let mut deflated = made("deflated-in-a-folder");
    assert_eq!(deflated.names("walk"), ["metadata"]);
    deflated.enter_common_folder();
    assert!(deflated.has("metadata") && deflated.has("rgbd") && !deflated.has("rgb"));
    assert_eq!(deflated.names("rgbd"), ["0.depth", "0.jpg"]);
    assert_eq!(deflated.read("rgbd/0.jpg", 100).unwrap(), b"image");
    // Ten megabytes of zeros in ten kilobytes.
    assert_eq!(made("zeros").read("rgbd/0.jpg", 1000).unwrap().len(), 1000);
    let refused = |name: &str, part: &str| {
        let error = made(name).read("rgbd/0.jpg", 1000).unwrap_err().to_string();
        assert!(error.contains(part), "{name}: {error}");
    };
    refused("encrypted", "assword");
    refused("wrong-checksum", "checksum");
    refused("bzip2", "ompression method not supported");
    // Names that lead outside are only names, and the target of a link is only the bytes of a file.
    let mut outside = made("names-outside");
    assert_eq!(outside.names("rgbd"), ["0.jpg"]);
    assert!(!outside.has("passwd"));
    assert_eq!(outside.read("rgbd/0.jpg", 100).unwrap(), b"/etc/passwd");
}
