//! COLMAP models: both encodings hold the same, conventions are converted, bad input is named.

use std::path::Path;

use covis_solvers::evaluation::bundle_cost;
use covis_solvers::geometry::{
    Camera, KannalaBrandt, LieGroup, PinholeRadialTangential, Se3, Snavely,
};
use covis_solvers::io::IoError;
use covis_solvers::io::colmap::{
    ColmapCamera, ColmapCameraModel, ColmapEncoding, ColmapImage, ColmapKeypoint, ColmapModel,
    ColmapPoint, ColmapPointError,
};
use nalgebra::{SVector, Vector2, Vector3};

use super::data::data;
use super::refused;

const BOTH: [ColmapEncoding; 2] = [ColmapEncoding::Text, ColmapEncoding::Binary];

/// Two cameras, three images (one without keypoints), two points.
pub(crate) fn model() -> ColmapModel {
    let mut model = ColmapModel::default();
    let pinhole = PinholeRadialTangential {
        k1: 0.01,
        p2: -0.002,
        ..PinholeRadialTangential::undistorted(500.0, 510.0, 319.5, 239.5)
    };
    model.cameras.insert(1, ColmapCamera::from_camera(&Camera::Pinhole(pinhole), 640, 480));
    let simple = vec![400.0, 320.0, 240.0];
    let kind = ColmapCameraModel::SimplePinhole;
    let camera = ColmapCamera { model: kind, width: 640, height: 480, parameters: simple };
    model.cameras.insert(5, camera);
    for (id, name, camera) in [(1, "view 10.png", 1), (2, "view 9.png", 5), (9, "empty.png", 1)] {
        let tangent = SVector::from([0.1, 0.2, -0.3, 0.02, f64::from(id) * 0.1, 0.05]);
        model.images.insert(id, ColmapImage::new(name.into(), camera, &Se3::exp(&tangent)));
    }
    for (id, x) in [(11, 0.3), (12, -0.4)] {
        model.points.insert(id, ColmapPoint::new(&Vector3::new(x, 0.1, 4.0), [1, 2, 3]));
        for image in [1, 2] {
            let pixel = Vector2::new(300.25 + x, 200.0);
            model.push_observation(image, &pixel, id).unwrap();
        }
    }
    let lonely = ColmapKeypoint { x: 1.5, y: 2.5, point: None };
    model.images.get_mut(&1).unwrap().keypoints.push(lonely);
    model
}

fn parse(model: &ColmapModel, encoding: ColmapEncoding) -> Result<ColmapModel, IoError> {
    let files = model.to_files(encoding)?;
    let bytes = [0, 1, 2].map(|k: usize| files[k].1.as_slice());
    ColmapModel::parse(encoding, bytes, Path::new("model"))
}

#[test]
fn written_models_read_back_equal() {
    for encoding in BOTH {
        assert_eq!(parse(&model(), encoding).unwrap(), model(), "{encoding:?}");
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("sparse/0");
        model().write(&inside, encoding).unwrap();
        assert_eq!(ColmapModel::read(&inside).unwrap(), model(), "{encoding:?}");
    }
    let folder = tempfile::tempdir().unwrap();
    refused(ColmapModel::read(folder.path()), &["no cameras.bin or cameras.txt"]);
}

#[test]
fn a_real_model_survives_both_encodings() {
    let Some(path) = data("colmap/room50") else { return };
    let room = ColmapModel::read(&path).unwrap();
    assert_eq!((room.cameras.len(), room.images.len(), room.points.len()), (1, 50, 5255));
    for encoding in BOTH {
        assert!(parse(&room, encoding).unwrap() == room, "{encoding:?}");
    }
    let original = std::fs::read(path.join("points3D.bin")).unwrap();
    let written = room.to_files(ColmapEncoding::Binary).unwrap();
    assert_eq!(written[2].1.len(), original.len());
    let converted = room.to_problem().unwrap();
    let problem = &converted.problem;
    assert_eq!(problem.reprojections.len(), 55090);
    assert_eq!(problem.behind_camera_count(), 0);
    problem.validate().unwrap();
    // Half the sum of squared errors, by numpy from the raw files in COLMAP's own conventions
    // (camera_from_world, pixel corners), so that a wrong conversion cannot cancel.
    let report = bundle_cost(problem);
    let expected = 67079.14739702072;
    assert!((report.total - expected).abs() < 1e-9 * expected, "{}", report.total);
}

#[test]
fn conventions_are_converted() {
    let converted = model().to_problem().unwrap();
    let problem = &converted.problem;
    assert_eq!(converted.image_ids, [9, 2, 1], "natural order of the names");
    assert_eq!((converted.camera_ids, converted.point_ids), (vec![1, 5], vec![11, 12]));
    assert_eq!(problem.reprojections.len(), 4, "the keypoint without a point is no observation");
    assert_eq!(problem.reprojections.pixels[0], Vector2::new(300.55, 200.0));
    let Camera::Pinhole(simple) = problem.cameras[1] else { panic!("{:?}", problem.cameras[1]) };
    assert_eq!((simple.fx, simple.fy, simple.cx, simple.cy), (400.0, 400.0, 319.5, 239.5));
    let tangent = SVector::from([0.1, 0.2, -0.3, 0.02, 0.1, 0.05]);
    assert!(problem.poses[2].minus(&Se3::exp(&tangent)).norm() < 1e-14, "world_from_camera");
}

#[test]
fn a_solved_problem_goes_back() {
    let mut solved = model().to_problem().unwrap();
    let tangent = SVector::from([0.01, 0.02, 0.03, 0.1, 0.2, 0.3]);
    solved.problem.poses[2] = solved.problem.poses[2].plus(&tangent);
    solved.problem.landmarks[1].z += 0.5;
    solved.problem.cameras[1].plus_parameters(&[1.0, 1.0]);
    let mut updated = model();
    updated.update_from(&solved).unwrap();
    assert_eq!(updated.cameras[&5].model, ColmapCameraModel::SimplePinhole);
    assert_eq!(updated.cameras[&5].parameters, [401.0, 320.0, 240.0]);
    assert_eq!(updated.images[&1].keypoints, model().images[&1].keypoints);
    let (a, b) = (bundle_cost(&solved.problem), updated.to_problem().unwrap());
    assert!((a.total - bundle_cost(&b.problem).total).abs() <= 1e-11 * a.total);
    // Once fx and fy part ways, the model must widen.
    solved.problem.cameras[1].plus_parameters(&[1.0]);
    updated.update_from(&solved).unwrap();
    assert_eq!(updated.cameras[&5].model, ColmapCameraModel::Pinhole);
    solved.image_ids[0] = 77;
    refused(updated.update_from(&solved), &["image 77"]);
}

#[test]
fn a_written_point_has_its_mean_error() {
    let mut model = model();
    let converted = model.to_problem().unwrap();
    model.update_from(&converted).unwrap();
    let problem = &converted.problem;
    let distance = |k: usize| {
        let o = problem.observation(k);
        let point = problem.landmarks[o.landmark as usize];
        let in_camera = problem.poses[o.pose as usize].inverse_transform(&point);
        let pixel = problem.cameras[o.camera as usize].project(&in_camera).unwrap();
        (pixel - o.seen.pixel).norm()
    };
    let of_first = |k: &usize| problem.observation(*k).landmark == 0;
    let all: Vec<f64> = (0..4).filter(of_first).map(distance).collect();
    assert!((model.points[&11].error - 0.5 * (all[0] + all[1])).abs() < 1e-9);
    model.points.insert(13, ColmapPoint::new(&Vector3::zeros(), [0; 3]));
    let unseen = model.to_problem().unwrap();
    model.update_from(&unseen).unwrap();
    assert_eq!(model.points[&13].error, -1.0, "nothing observes it");
}

/// The number is that of pycolmap's `update_point_3d_errors`, for pinhole, radial and fisheye cameras.
#[test]
fn a_view_behind_its_camera_counts_as_it_does_in_colmap() {
    let pinhole = PinholeRadialTangential::undistorted(500.0, 500.0, 319.5, 239.5);
    for camera in
        [Camera::Pinhole(pinhole), Camera::Snavely(Snavely { focal: 500.0, k1: 0.0, k2: 0.0 })]
    {
        let center = camera.project(&Vector3::new(0.0, 0.0, 1.0)).unwrap();
        let mut error = ColmapPointError::default();
        assert_eq!(error.mean_px(), -1.0);
        error.add(&camera, &Vector3::new(0.0, 0.0, 2.0), &(center + Vector2::new(3.0, 4.0)));
        assert_eq!(error.mean_px(), 5.0);
        error.add(&camera, &Vector3::new(0.0, 0.0, -2.0), &center);
        assert_eq!(error.mean_px(), 0.5 * f64::MAX.sqrt());
    }
}

#[test]
fn points_of_fewer_than_two_images_are_counted() {
    let mut model = model();
    assert_eq!(model.single_view_points(), 0);
    model.points.insert(13, ColmapPoint::new(&Vector3::zeros(), [0; 3]));
    for _ in 0..2 {
        model.push_observation(1, &Vector2::zeros(), 13).unwrap();
        assert_eq!(model.single_view_points(), 1, "twice in one image is one view");
    }
    model.push_observation(9, &Vector2::zeros(), 13).unwrap();
    assert_eq!(model.single_view_points(), 0);
}

#[test]
fn a_camera_has_the_free_parameters_of_its_model() {
    for number in 0..12 {
        let kind = ColmapCameraModel::from_number(number).unwrap();
        let parameters = vec![1.0; kind.parameter_count()];
        let camera = ColmapCamera { model: kind, width: 1, height: 1, parameters };
        let unknowns = kind.free_parameters().count(9);
        match (kind, camera.to_camera(1)) {
            // k4, k5 and k6 are zero in what is read.
            (ColmapCameraModel::FullOpenCv, _) => assert_eq!(unknowns, 9),
            (_, Ok(_)) => assert_eq!(unknowns, kind.parameter_count(), "{}", kind.name()),
            (_, Err(_)) => assert_eq!(unknowns, 0, "{}", kind.name()),
        }
    }
}

#[test]
fn cameras_convert_exactly_or_are_refused() {
    let pinhole = PinholeRadialTangential::undistorted(1.0, 2.0, 3.0, 4.0);
    let snavely = Camera::Snavely(Snavely { focal: 500.0, k1: 0.1, k2: 0.2 });
    let (fx, fy, cx, cy) = (300.0, 301.0, 10.0, 20.0);
    let fisheye = KannalaBrandt { fx, fy, cx, cy, k1: 0.1, k2: 0.2, k3: 0.3, k4: 0.4 };
    for (camera, name) in [
        (Camera::Pinhole(pinhole), "PINHOLE"),
        (Camera::Pinhole(PinholeRadialTangential { p1: 0.1, ..pinhole }), "OPENCV"),
        (Camera::Pinhole(PinholeRadialTangential { k3: 0.1, ..pinhole }), "FULL_OPENCV"),
        (Camera::Fisheye(fisheye), "OPENCV_FISHEYE"),
    ] {
        let colmap = ColmapCamera::from_camera(&camera, 10, 20);
        assert_eq!(colmap.model.name(), name);
        assert_eq!(colmap.parameters.len(), colmap.model.parameter_count());
        assert_eq!(colmap.to_camera(3).unwrap(), camera);
    }
    let radial = ColmapCamera::from_camera(&snavely, 10, 20);
    assert_eq!(
        (radial.model, &radial.parameters[1..3]),
        (ColmapCameraModel::Radial, &[0.5, 0.5][..])
    );
    let point = Vector3::new(0.3, -0.2, 2.0);
    let (a, b) = (radial.to_camera(0).unwrap().project(&point), snavely.project(&point));
    assert!((a.unwrap() - b.unwrap()).norm() < 1e-12);
    let build = |model, parameters| ColmapCamera { model, width: 1, height: 1, parameters };
    let mut full = vec![0.0; 12];
    full[11] = 1e-9;
    refused(build(ColmapCameraModel::FullOpenCv, full).to_camera(8), &["camera 8", "k6", "FULL"]);
    refused(build(ColmapCameraModel::Fov, vec![1.0; 5]).to_camera(4), &["camera 4", "FOV"]);
    refused(build(ColmapCameraModel::Radial, vec![1.0]).to_camera(4), &["parameters", "has 1"]);
}

#[test]
fn bad_text_is_refused_by_line_and_field() {
    let files = model().to_files(ColmapEncoding::Text).unwrap();
    let texts = [0, 1, 2].map(|k: usize| String::from_utf8(files[k].1.clone()).unwrap());
    let table: &[(usize, &str, &str, &[&str])] = &[
        (0, "OPENCV", "OPENVC", &["cameras.txt, line 2", "camera model", "`OPENVC`"]),
        (0, "SIMPLE_PINHOLE", "PINHOLE", &["line 3", "parameter[3] is missing"]),
        (0, "\n5 ", "\n1 ", &["line 3", "camera 1 occurs twice"]),
        (1, " view 9.png", "", &["images.txt, line 5", "image name is missing"]),
        (1, " 5 view", " 6 view", &["line 5", "camera 6 does not exist"]),
        (1, " 11 ", " 13 ", &["line 4", "point 13 does not exist"]),
        (1, " -1\n", " -2\n", &["line 4", "keypoint point id", "`-2`"]),
        (1, " -1\n", "\n", &["line 4", "keypoint point id is missing"]),
        (1, "\n9 ", "\n2 ", &["line 7", "image 2 occurs twice"]),
        (2, "\n12 ", "\n11 ", &["points3D.txt, line 3", "point 11 occurs twice"]),
        (2, " 1 2 3 ", " 1 2 300 ", &["line 2", "blue", "`300`"]),
        (1, " 11 ", " 18446744073709551615 ", &["line 4", "point 18446744073709551615 does not"]),
        (2, "\n12 ", "\n18446744073709551615 ", &["line 3", "point id", "`18446744073709551615`"]),
        (2, " 2 0\n", " 2\n", &["line 2", "track keypoint is missing"]),
        (2, " 2 0\n", " 2 9\n", &["record 11", "image 2 is 9", "there are 2"]),
        (2, " 2 0\n", " 7 0\n", &["record 11", "image 7 does not exist"]),
    ];
    for &(file, old, new, parts) in table {
        let mut bad = texts.clone();
        assert!(bad[file].contains(old), "`{old}` in {}", bad[file]);
        bad[file] = bad[file].replacen(old, new, 1);
        let bytes = [bad[0].as_bytes(), bad[1].as_bytes(), bad[2].as_bytes()];
        refused(ColmapModel::parse(ColmapEncoding::Text, bytes, Path::new("m")), parts);
    }
}

#[test]
fn bad_binary_is_refused_by_byte_and_field() {
    let files = model().to_files(ColmapEncoding::Binary).unwrap();
    let refuse = |file: usize, change: &dyn Fn(&mut Vec<u8>), parts: &[&str]| {
        let mut bad = [files[0].1.clone(), files[1].1.clone(), files[2].1.clone()];
        change(&mut bad[file]);
        let bytes = [bad[0].as_slice(), bad[1].as_slice(), bad[2].as_slice()];
        refused(ColmapModel::parse(ColmapEncoding::Binary, bytes, Path::new("m")), parts);
    };
    let set = |at: usize, new: &[u8], bytes: &mut Vec<u8>| {
        bytes[at..at + new.len()].copy_from_slice(new);
    };
    refuse(0, &|b| b.clear(), &["cameras.bin, byte 0", "camera count is missing"]);
    let huge = u64::MAX.to_le_bytes();
    refuse(0, &|b| set(0, &huge, b), &["byte 0", "camera count says 18446744073709551615"]);
    refuse(0, &|b| set(12, &[99], b), &["byte 8", "camera model", "`99`"]);
    refuse(0, &|b| b.truncate(b.len() - 1), &["parameter[2] is missing"]);
    refuse(0, &|b| b.push(0), &["unexpected `1 bytes`"]);
    refuse(1, &|b| set(12, &[0; 32], b), &["images.bin, byte 8", "norm 0"]);
    refuse(1, &|b| set(44, &f64::NAN.to_le_bytes(), b), &["byte 44", "translation[0]"]);
    let name_end = 8 + 4 + 56 + 4 + "view 10.png".len() + 1;
    refuse(1, &|b| set(name_end, &huge, b), &[&format!("byte {name_end}"), "keypoint count"]);
    refuse(1, &|b| set(name_end - 3, &[0xff], b), &["image name"]);
    refuse(2, &|b| set(8, &huge, b), &["points3D.bin, byte 8", "point id cannot be `18446744"]);
    refuse(2, &|b| set(51, &[200], b), &["points3D.bin, byte 51", "track length says 200"]);
}

#[test]
fn names_that_a_format_cannot_hold_are_refused() {
    for (encoding, name) in
        [(BOTH[0], "two\nlines"), (BOTH[0], " outer"), (BOTH[0], ""), (BOTH[1], "zero\0")]
    {
        let mut model = model();
        model.images.get_mut(&2).unwrap().name = name.into();
        refused(model.to_files(encoding), &["image 2"]);
    }
}
