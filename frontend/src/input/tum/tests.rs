//! Folders that are written here, whole and damaged, and the recorded one where it is.

use std::path::Path;

use tempfile::TempDir;

use super::*;
use crate::image::Image;
use crate::input::{CameraOrigin, FolderOptions, OpenFolder, encode, open_folder};

/// A folder whose frame i has the time i / 10 s, the color (i, 0, 0) and the depth i m.
fn folder(frames: u8) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    fs_err::create_dir(path.join("rgb")).unwrap();
    fs_err::create_dir(path.join("depth")).unwrap();
    let (mut rgb, mut depth) = ("# color\n".to_owned(), "# depth\n".to_owned());
    for i in 1..=frames {
        write_frame(path, i, (4, 3), (4, 3));
        rgb.push_str(&format!("{:.6} rgb/{i}.png\n", f64::from(i) / 10.0));
        depth.push_str(&format!("{:.6} depth/{i}.png\n", f64::from(i) / 10.0 + 0.01));
    }
    write(path, "rgb.txt", &rgb);
    write(path, "depth.txt", &depth);
    folder
}

fn open(folder: &Path) -> Result<OpenFolder, InputError> {
    open_folder(folder, FolderOptions::default())
}

fn write(folder: &Path, name: &str, text: &str) {
    fs_err::write(folder.join(name), text).unwrap();
}

fn write_frame(folder: &Path, i: u8, color: (usize, usize), depth: (usize, usize)) {
    let color = Image::filled(color.0, color.1, [i, 0, 0]);
    fs_err::write(folder.join(format!("rgb/{i}.png")), encode::rgb(&color).unwrap()).unwrap();
    let mut depth = Image::filled(depth.0, depth.1, u16::from(i) * 5000);
    depth.set(0, 0, 0);
    let bytes = encode::gray16(&depth).unwrap();
    fs_err::write(folder.join(format!("depth/{i}.png")), bytes).unwrap();
}

/// All that a folder gives: the red of a frame, or its error's text without the folder.
fn all(folder: &Path) -> Vec<Result<u8, String>> {
    let mut source = open(folder).unwrap().source;
    let count = source.len();
    let prefix = format!("{}{}", folder.display(), std::path::MAIN_SEPARATOR);
    let results: Vec<_> = std::iter::from_fn(|| source.next_frame())
        .map(|frame| {
            frame
                .map(|frame| frame.color.at(0, 0)[0])
                .map_err(|error| error.to_string().replace(&prefix, ""))
        })
        .collect();
    assert_eq!(results.len(), count);
    assert!(source.next_frame().is_none());
    results
}

fn error(results: &[Result<u8, String>], index: usize) -> &str {
    results[index].as_ref().unwrap_err()
}

#[test]
fn frames_come_in_order_with_the_time_of_their_color() {
    let folder = folder(3);
    let options = FolderOptions { camera: Some("5,5,2,1"), ..FolderOptions::default() };
    let OpenFolder { mut source, without_depth, .. } = open_folder(folder.path(), options).unwrap();
    assert_eq!((source.len(), without_depth), (3, 0));
    let frame = source.next_frame().unwrap().unwrap();
    assert_eq!(frame.timestamp_s, 0.1);
    assert_eq!(frame.color, Image::filled(4, 3, [1, 0, 0]));
    assert_eq!((frame.depth_m.at(0, 0), frame.depth_m.at(1, 0)), (0.0, 1.0));
    assert_eq!(all(folder.path()), [Ok(1), Ok(2), Ok(3)]);
}

#[test]
fn color_without_depth_is_counted_and_is_no_frame() {
    let folder = folder(3);
    write(folder.path(), "depth.txt", "0.11 depth/1.png\n0.32 depth/2.png\n0.319 depth/3.png\n");
    let open = open(folder.path()).unwrap();
    assert_eq!((open.source.len(), open.without_depth), (2, 1));
    assert_eq!(all(folder.path()), [Ok(1), Ok(3)]);
}

#[test]
fn times_that_do_not_increase_are_reported_and_skipped() {
    let folder = folder(4);
    let list = "0.1 rgb/1.png\n0.3 rgb/3.png\n0.2 rgb/2.png\n0.3 rgb/3.png\n0.4 rgb/4.png\n";
    write(folder.path(), "rgb.txt", list);
    // The second 0.3 shares the depth image of the first.
    let results = all(folder.path());
    assert_eq!(results.len(), 5);
    assert_eq!((&results[..2], &results[4..]), (&[Ok(1), Ok(3)][..], &[Ok(4)][..]));
    assert_eq!(error(&results, 2), "rgb.txt, line 3: timestamp 0.2 s does not follow 0.3 s");
    assert_eq!(error(&results, 3), "rgb.txt, line 4: timestamp 0.3 s does not follow 0.3 s");
}

#[test]
fn an_unreadable_image_in_the_middle_is_reported_and_skipped() {
    let folder = folder(5);
    let png = fs_err::read(folder.path().join("rgb/2.png")).unwrap();
    fs_err::write(folder.path().join("rgb/2.png"), &png[..png.len() / 2]).unwrap();
    write(folder.path(), "depth/3.png", "not an image");
    fs_err::remove_file(folder.path().join("depth/4.png")).unwrap();
    let results = all(folder.path());
    assert_eq!((&results[0], &results[4]), (&Ok(1), &Ok(5)));
    assert!(error(&results, 1).starts_with("rgb/2.png: PNG: "), "{}", error(&results, 1));
    assert_eq!(error(&results, 2), "depth/3.png: neither PNG nor JPEG");
    assert_eq!(error(&results, 3), "depth/4.png: cannot be read");
}

#[test]
fn unequal_sizes_are_reported_and_skipped() {
    let folder = folder(4);
    write_frame(folder.path(), 2, (4, 3), (4, 2));
    write_frame(folder.path(), 3, (6, 3), (6, 3));
    let results = all(folder.path());
    assert_eq!((&results[0], &results[3]), (&Ok(1), &Ok(4)));
    assert_eq!(error(&results, 1), "depth/2.png: 4x2 pixels, not 4x3");
    assert_eq!(error(&results, 2), "rgb/3.png: 6x3 pixels, not 4x3");
}

#[test]
fn a_size_is_expected_only_once_a_frame_was_read() {
    let folder = folder(3);
    write_frame(folder.path(), 1, (9, 9), (4, 2));
    assert_eq!(all(folder.path())[1..], [Ok(2), Ok(3)]);
}

#[test]
fn a_folder_that_cannot_be_opened_says_why() {
    let folder = folder(1);
    let open = |what: &str| open(folder.path()).err().expect(what);
    write(folder.path(), "rgb.txt", "1.0 rgb/1.png\n2.0 ../secret.png\n");
    assert!(matches!(open("outside"), InputError::Outside { line: 2, .. }));
    write(folder.path(), "rgb.txt", "# nothing\n");
    assert!(matches!(open("empty"), InputError::NoFrames { .. }));
    fs_err::remove_file(folder.path().join("depth.txt")).unwrap();
    let error = open("no depth list");
    assert!(matches!(&error, InputError::Read { path, .. } if path.ends_with("depth.txt")));
    fs_err::remove_file(folder.path().join("rgb.txt")).unwrap();
    assert!(matches!(open("no lists"), InputError::NotASequence { .. }));
}

#[test]
fn the_truth_beside_a_sequence_stays_closed() {
    let folder = folder(2);
    let path = folder.path();
    let before = all(path);
    // A folder in the place of a file cannot be read: whoever tried would fail.
    for name in ["groundtruth.txt", "mask.txt", "accelerometer.txt"] {
        fs_err::create_dir(path.join(name)).unwrap();
    }
    write(path, "mask", "");
    assert_eq!(all(path), before);
}

#[test]
fn the_recorded_sequence_is_read_whole() {
    let Some(path) = covis_solvers::testing::data("rgbd/tum_fr1_rpy") else { return };
    let mut open = open(&path).unwrap();
    assert!(matches!(open.camera_origin, CameraOrigin::File(_)));
    assert_eq!(open.source.camera().fx, 517.3);
    assert_eq!(open.source.len() + open.without_depth, 360);
    assert!(open.without_depth < 20, "{} without depth", open.without_depth);
    assert_eq!(open.implausible_depth, None);
    let mut last = 0.0;
    for _ in 0..30 {
        let frame = open.source.next_frame().unwrap().unwrap();
        assert!(frame.timestamp_s > last);
        last = frame.timestamp_s;
        assert_eq!((frame.color.size(), frame.depth_m.size()), ((640, 480), (640, 480)));
        let valid = frame.depth_m.pixels().iter().filter(|&&z| z > 0.3 && z < 10.0).count();
        assert!(valid > 640 * 480 / 2, "{valid} pixels with depth");
    }
}

/// A folder with one frame whose depth image holds these values, each on a tenth of the pixels.
fn with_depth(values: [u16; 10]) -> TempDir {
    let folder = folder(1);
    let path = folder.path();
    let color = Image::filled(10, 4, [1, 0, 0]);
    fs_err::write(path.join("rgb/1.png"), encode::rgb(&color).unwrap()).unwrap();
    let depth = Image::from_pixels(10, 4, values.repeat(4)).unwrap();
    fs_err::write(path.join("depth/1.png"), encode::gray16(&depth).unwrap()).unwrap();
    folder
}

#[test]
fn a_depth_scale_that_does_not_fit_the_first_images_is_reported() {
    // A desk at 1.2 m and a wall at 3 m in millimeters, and in the benchmark's units.
    let desk: [u16; 10] = std::array::from_fn(|i| if i < 5 { 1200 } else { 3000 });
    let millimeters = with_depth(desk);
    let doubt = open(millimeters.path()).unwrap().implausible_depth.unwrap();
    assert_eq!((doubt.units_per_m, doubt.near_m, doubt.far_m), (5000.0, 0.24, 0.6));
    assert!(doubt.to_string().ends_with("a tenth of the measured depth is nearer than 0.24 m"));
    // The middle of a room in millimeters: nothing is near.
    let room = with_depth(std::array::from_fn(|i| 2200 + 200 * i as u16));
    let doubt = open(room.path()).unwrap().implausible_depth.unwrap();
    assert!(
        doubt.to_string().ends_with("nine tenths of the measured depth are nearer than 0.80 m")
    );
    let usual = with_depth(desk.map(|z| z * 5));
    assert_eq!(open(usual.path()).unwrap().implausible_depth, None);
    // One that measures finer than the default: everything looks too far.
    let fine = with_depth(desk.map(|z| z * 20));
    let doubt = open(fine.path()).unwrap().implausible_depth.unwrap();
    assert!(doubt.to_string().ends_with("farther than 12.0 m"), "{doubt}");
    // What was not measured says nothing, nor do images without depth.
    let holes = with_depth([0, u16::MAX, 0, u16::MAX, 0, 6000, 7000, 8000, 9000, 10_000]);
    assert_eq!(open(holes.path()).unwrap().implausible_depth, None);
    assert_eq!(open(with_depth([0; 10]).path()).unwrap().implausible_depth, None);
}

#[test]
fn a_given_depth_scale_is_used_without_a_warning() {
    let folder = with_depth([1500; 10]);
    let scaled = |units| {
        let options = FolderOptions { depth_units_per_m: Some(units), ..FolderOptions::default() };
        open_folder(folder.path(), options)
    };
    let mut open = scaled(1000.0).unwrap();
    assert_eq!(open.implausible_depth, None);
    assert_eq!(open.source.next_frame().unwrap().unwrap().depth_m.at(3, 2), 1.5);
    assert_eq!(scaled(10_000.0).unwrap().implausible_depth, None, "the caller knows");
    for bad in [0.0, -1000.0, f32::NAN, f32::INFINITY] {
        let error = scaled(bad).err().unwrap();
        assert!(matches!(error, InputError::DepthScale { .. }), "{error}");
    }
}

#[test]
fn a_folder_of_ten_frames_a_second_is_read_whole() {
    let folder = folder(6);
    let depth: String =
        (1..=6).map(|i| format!("{:.3} depth/{i}.png\n", f64::from(i) / 10.0 + 0.045)).collect();
    write(folder.path(), "depth.txt", &depth);
    let OpenFolder { mut source, without_depth, .. } = open(folder.path()).unwrap();
    assert_eq!((source.len(), without_depth), (6, 0));
    let frame = source.next_frame().unwrap().unwrap();
    assert!((frame.depth_delay_s - 0.045).abs() < 1e-9, "{}", frame.depth_delay_s);
}
