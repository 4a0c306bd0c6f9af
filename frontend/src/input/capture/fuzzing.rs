//! The fuzz targets of captures: the JSON of each layout and compressed depth, and archives.
//!
//! Built for tests and with the feature `fuzzing` only. They take any bytes and panic where a promise is
//! broken.

use std::io::Cursor;
use std::path::{Component, Path};

use covis_solvers::geometry::LieGroup;

use super::archive::Archive;
use super::lzfse::Lzfse;
use super::record3d::Metadata;
use super::{CapturedFrame, Place, numbers, polycam, transforms};
use crate::camera::FrameCamera;

/// Frames that are looked at of each input.
const MOST_FRAMES: usize = 100;

/// The JSON of a capture, or a compressed image. An accepted frame has a rigid pose that is written and
/// read as the same, a lens with focal lengths, a time, and no file outside of the capture.
pub fn capture(input: &[u8]) {
    let path = Path::new("capture.json");
    if let Ok((_, frames)) = transforms::parse(input, path) {
        frames.iter().flatten().take(MOST_FRAMES).for_each(check);
    }
    if let Ok(frame) = polycam::frame(input, path) {
        check(&frame);
    }
    if let Ok(metadata) = Metadata::parse(input, path) {
        let _size = metadata.depth_size(path);
        (0..MOST_FRAMES)
            .filter_map(|number| metadata.frame(number, path).ok())
            .for_each(|f| check(&f));
    }
    let size = (13, 7);
    if let Ok(depth) = Lzfse::default().depth(input, size, path) {
        let is_depth = |&d: &f32| d.is_finite() && d >= 0.0;
        assert!(depth.size() == size && depth.pixels().iter().all(is_depth), "no depth in meters");
    }
}

/// An archive: what it lists is there, and of an entry no more is read than asked for.
pub fn archive(input: &[u8]) {
    const LIMIT: u64 = 1 << 20;
    let Ok(mut archive) = Archive::read_from(Cursor::new(input.to_vec()), Path::new("a.zip"))
    else {
        return;
    };
    for folder in ["rgbd", polycam::IMAGES] {
        for name in archive.names(folder).into_iter().take(MOST_FRAMES) {
            let name = format!("{folder}/{name}");
            assert!(archive.has(&name), "{name}");
            let read = archive.read(&name, LIMIT);
            assert!(read.is_err() || read.is_ok_and(|bytes| bytes.len() as u64 <= LIMIT));
        }
    }
}

fn check(frame: &CapturedFrame) {
    let CapturedFrame { timestamp_s, color, depth, lens, world_from_camera, .. } = frame;
    assert!(timestamp_s.is_finite(), "{frame:?}");
    for name in [Some(color), depth.as_ref()].into_iter().flatten() {
        let is_inside = |part: Component<'_>| matches!(part, Component::Normal(_));
        assert!(Path::new(name).components().all(is_inside), "{name}");
    }
    assert!(
        lens.camera.fx > 0.0 && lens.camera.fy > 0.0 && lens.size.0 * lens.size.1 > 0,
        "{lens:?}"
    );
    if let Some(camera) = FrameCamera::new(lens.camera, 8, 6) {
        let rays = camera.rays().pixels().as_flattened();
        assert!(rays.iter().all(|ray| ray.is_finite()), "{lens:?}");
    }
    if let Some(pose) = world_from_camera {
        let place = || Place { path: "again".into(), frame: None };
        let again = numbers::pose(numbers::rows(pose), "pose", place).ok();
        let error = again.map(|again| again.inverse().compose(pose).log().amax());
        assert!(error.is_some_and(|error| error < 1e-6), "{pose:?}");
    }
}

/// The corpus of the fuzz target.
#[must_use]
pub fn seeds() -> Vec<(&'static str, Vec<u8>)> {
    let matrix = "[[0,0,1,1],[1,0,0,2],[0,1,0,3],[0,0,0,1]]";
    let frame = |name: &str, more: &str| {
        format!("{{\"file_path\":\"{name}\",\"transform_matrix\":{matrix}{more}}}")
    };
    let transforms = format!(
        "{{\"camera_model\":\"OPENCV\",\"fl_x\":500,\"fl_y\":501,\"cx\":320,\"cy\":240,\"w\":640,\"h\":480,\
         \"k1\":0.1,\"depth_unit_scale_factor\":0.001,\"frames\":[{},{},{}]}}",
        frame("images/10.jpg", ",\"depth_file_path\":\"./depth/10.png\""),
        frame("images/9.jpg", ",\"fl_x\":-1"),
        frame("../9.jpg", ""),
    );
    let polycam = "{\"fx\":764.6,\"fy\":764.6,\"cx\":512,\"cy\":382,\"width\":1024,\"height\":768,\
                   \"timestamp\":262195552056,\"blur_score\":165.6,\"t_00\":1,\"t_01\":0,\"t_02\":0,\
                   \"t_03\":1.1,\"t_10\":0,\"t_11\":1,\"t_12\":0,\"t_13\":-0.1,\"t_20\":0,\"t_21\":0,\
                   \"t_22\":1,\"t_23\":2.2}";
    let record3d = "{\"w\":720,\"h\":960,\"dw\":192,\"dh\":256,\"fps\":30,\"K\":[690,0,0,0,690,0,361,481,1],\
                    \"poses\":[[0,0,0,1,0,0,0],[0,0.6,0,0.8,1,2,3]],\"frameTimestamps\":[0,0.5],\
                    \"perFrameIntrinsicCoeffs\":[[691,691,360,480]]}";
    let mut packed = Vec::new();
    let depth: Vec<u8> = (0..91).flat_map(|k| (0.1 * k as f32).to_le_bytes()).collect();
    // What cannot be packed leaves a seed that is empty.
    let _packed = lzfse_rust::encode_bytes(&depth, &mut packed);
    vec![
        ("transforms", transforms.into_bytes()),
        ("polycam", polycam.into()),
        ("record3d", record3d.into()),
        ("depth", packed),
        ("deep", b"[[[[[[[[{\"frames\":[".to_vec()),
    ]
}
