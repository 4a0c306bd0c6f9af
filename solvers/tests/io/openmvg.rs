//! OpenMVG: cameras of every model project as OpenMVG defines them, what is not placed is left out, bad
//! files are named by line or key.

use std::path::Path;

use covis_solvers::evaluation::bundle_cost;
use covis_solvers::io::IoError;
use covis_solvers::io::openmvg::{OpenMvgFile, OpenMvgIntrinsic, OpenMvgLeftOut};
use covis_solvers::io::sparse_model::SparseModel;

use super::refused;

/// One camera of each model, views that are not placed, a control point (`make_openmvg.py`).
pub(crate) const ROOM: &str = include_str!("../../../tests/golden/twins/room-openmvg.json");

/// A camera at (1, 2, 3) that looks along the world's x, and a point 4 in front of it.
const SMALL: &str = r#"{"sfm_data_version": "0.2", "root_path": "",
"views": [{"key": 7, "value": {"ptr_wrapper": {"id": 2147483649, "data":
  {"local_path": "a", "filename": "b.jpg", "width": 8, "height": 6, "id_view": 7, "id_intrinsic": 3, "id_pose": 9}}}}],
"intrinsics": [{"key": 3, "value": {"polymorphic_id": 2147483649, "polymorphic_name": "pinhole",
  "ptr_wrapper": {"id": 2147483650, "data":
  {"width": 8, "height": 6, "focal_length": 10.0, "principal_point": [4.0, 3.0]}}}}],
"extrinsics": [{"key": 9, "value":
  {"rotation": [[0, -1, 0], [0, 0, -1], [1, 0, 0]], "center": [1, 2, 3]}}],
"structure": [{"key": 5, "value": {"X": [5.0, 1.6, 3.8],
  "observations": [{"key": 7, "value": {"id_feat": 0, "x": [5.5, 1.0]}}]}}],
"control_points": []}
"#;

fn parse(text: &str) -> Result<OpenMvgFile, IoError> {
    OpenMvgFile::parse(text.as_bytes(), Path::new("sfm_data.json"))
}

fn model(text: &str) -> Result<(SparseModel, OpenMvgLeftOut), IoError> {
    SparseModel::from_openmvg(&parse(text)?, Path::new("sfm_data.json"))
}

/// The pixel of a point by OpenMVG's definition of its models.
fn projected(file: &OpenMvgFile, view: u32, point: &[f64; 3]) -> [f64; 2] {
    let pose = &file.poses[&file.views[&view].id_pose];
    let intrinsic: &OpenMvgIntrinsic = &file.intrinsics[&file.views[&view].id_intrinsic];
    let d = [0, 1, 2].map(|i| point[i] - pose.center[i]);
    let [a, b, c] = pose.rotation.map(|row| row[0] * d[0] + row[1] * d[1] + row[2] * d[2]);
    let (x, y) = (a / c, b / c);
    let r2 = x * x + y * y;
    let [k1, k2, k3] = intrinsic.disto_k3.unwrap_or_default();
    let [m1, m2, m3, t1, t2] = intrinsic.disto_t2.unwrap_or_default();
    let [n1] = intrinsic.disto_k1.unwrap_or_default();
    let (k1, k2, k3) = (k1 + m1 + n1, k2 + m2, k3 + m3);
    let mut radial = 1.0 + k1 * r2 + k2 * r2.powi(2) + k3 * r2.powi(3);
    if let Some([k1, k2, k3, k4]) = intrinsic.fisheye {
        let angle = r2.sqrt().atan();
        let powers = k1 * angle.powi(3) + k2 * angle.powi(5) + k3 * angle.powi(7);
        radial = (angle + powers + k4 * angle.powi(9)) / r2.sqrt();
    }
    let u = x * radial + t2 * (r2 + 2.0 * x * x) + 2.0 * t1 * x * y;
    let v = y * radial + t1 * (r2 + 2.0 * y * y) + 2.0 * t2 * x * y;
    let (f, [cx, cy]) = (intrinsic.focal_length.unwrap(), intrinsic.principal_point.unwrap());
    [f * u + cx, f * v + cy]
}

#[test]
fn the_pose_is_inverted_and_pixels_stay() {
    let (model, left_out) = model(SMALL).unwrap();
    assert_eq!(left_out, OpenMvgLeftOut::default());
    assert_eq!(model.image_names, ["a/b.jpg"]);
    assert_eq!(model.image_sizes_px, [[8, 6]]);
    let pose = &model.problem.poses[0];
    assert_eq!(<[f64; 3]>::from(pose.translation), [1.0, 2.0, 3.0]);
    // The point is 0.4 to the left of the world's −y and 0.8 above: (0.4, −0.8, 4) in the camera.
    let seen = pose.inverse_transform(&model.problem.landmarks[0]);
    assert!((seen - nalgebra::Vector3::new(0.4, -0.8, 4.0)).norm() < 1e-15, "{seen}");
    let pixel = model.problem.cameras[0].project(&seen).unwrap();
    assert!((pixel - nalgebra::Vector2::new(5.0, 1.0)).norm() < 1e-14, "{pixel}");
    assert!((bundle_cost(&model.problem).total - 0.125).abs() < 1e-14);
}

#[test]
fn every_model_projects_as_openmvg_defines_it() {
    let file = parse(ROOM).unwrap();
    let (model, left_out) = model(ROOM).unwrap();
    let expected = OpenMvgLeftOut { views: 1, observations: 1, control_points: 1, shared_poses: 0 };
    assert_eq!(left_out, expected);
    let names = ["image0.jpg", "image2.jpg", "image4.jpg"];
    assert_eq!(model.image_names[..3], names);
    assert_eq!(model.image_names[3..], ["left/image1.jpg", "left/image3.jpg", "left/image5.jpg"]);
    let views = [0, 2, 4, 1, 3, 5];
    let (mut k, mut cost) = (0, 0.0);
    for (landmark, point) in file.points.values().enumerate() {
        for (view, pixel) in point.observations.iter().filter(|(view, _)| *view != 6) {
            let seen = &model.problem.reprojections;
            assert_eq!(views[seen.poses[k] as usize], *view);
            assert_eq!(seen.landmarks[k] as usize, landmark);
            assert_eq!(<[f64; 2]>::from(seen.pixels[k]), *pixel);
            let pose = &model.problem.poses[seen.poses[k] as usize];
            let in_camera = pose.inverse_transform(&model.problem.landmarks[landmark]);
            let camera = &model.problem.cameras[seen.cameras[k] as usize];
            let ours = camera.project(&in_camera).unwrap();
            let theirs = projected(&file, *view, &point.position);
            assert!((ours - nalgebra::Vector2::from(theirs)).norm() < 1e-9, "view {view}");
            cost += 0.5 * ((theirs[0] - pixel[0]).powi(2) + (theirs[1] - pixel[1]).powi(2));
            k += 1;
        }
    }
    assert_eq!(k, model.problem.observation_count());
    let total = bundle_cost(&model.problem).total;
    assert!((total - cost).abs() <= 1e-9 * cost, "{total} {cost}");
}

#[test]
fn a_camera_moves_only_what_openmvgs_model_has() {
    let (model, _) = model(ROOM).unwrap();
    // pinhole, radial k1, radial k3, brown, fisheye, pinhole: the unknowns, one focal length each.
    let counts = [3, 4, 6, 8, 7, 3];
    for (camera, count) in counts.into_iter().enumerate() {
        let free = model.problem.free_parameters_of(camera);
        let parameters = model.problem.cameras[camera].parameter_count();
        assert_eq!(free.count(parameters), count, "camera {camera}");
        assert!(free.has_one_focal_length());
    }
}

#[test]
fn a_type_is_known_by_its_number_after_its_first_name() {
    let models: Vec<String> =
        parse(ROOM).unwrap().intrinsics.into_values().map(|intrinsic| intrinsic.model).collect();
    assert_eq!((models[0].as_str(), models[5].as_str()), ("pinhole", "pinhole"));
    // Version 0.3 gives views types too, which take numbers.
    let typed = SMALL
        .replace(
            r#"{"ptr_wrapper": {"id": 2147483649"#,
            r#"{"polymorphic_id": 2147483649, "polymorphic_name": "view_priors",
               "ptr_wrapper": {"id": 2147483649"#,
        )
        .replace(
            r#""polymorphic_id": 2147483649, "polymorphic_name": "pinhole""#,
            r#""polymorphic_id": 2147483650, "polymorphic_name": "pinhole""#,
        );
    assert_eq!(parse(&typed).unwrap().intrinsics[&3].model, "pinhole");
    refused(
        parse(&SMALL.replace(r#""polymorphic_name": "pinhole","#, "")),
        &["sfm_data.json, intrinsic 3", "polymorphic_id without a name cannot be `2147483649`"],
    );
}

#[test]
fn what_is_not_placed_is_left_out_with_a_count() {
    let no_pose = SMALL.replace(r#""id_pose": 9"#, r#""id_pose": 4294967295"#);
    let no_intrinsic = SMALL.replace(r#""id_intrinsic": 3"#, r#""id_intrinsic": 4294967295"#);
    for text in [no_pose, no_intrinsic] {
        let (model, left_out) = model(&text).unwrap();
        assert_eq!((left_out.views, left_out.observations), (1, 1));
        assert_eq!((model.problem.poses.len(), model.problem.landmarks.len()), (0, 1));
        assert_eq!(model.problem.constant_landmarks, [true]);
    }
    let view = &SMALL[SMALL.find(r#"{"key": 7"#).unwrap()..SMALL.find("],\n\"intrinsics").unwrap()];
    let second = view.replace(r#""key": 7"#, r#""key": 8"#).replace("b.jpg", "c.jpg");
    let (model, left_out) = model(&SMALL.replace(view, &format!("{view}, {second}"))).unwrap();
    assert_eq!((left_out.shared_poses, model.problem.poses.len()), (2, 2));
}

#[test]
fn bad_files_are_refused_by_line_or_key() {
    let doubled = SMALL.replace(
        r#""structure": ["#,
        r#""structure": [{"key": 5, "value":
        {"X": [0, 0, 0], "observations": []}}, "#,
    );
    let table: &[(String, &[&str])] = &[
        (String::new(), &["sfm_data.json, line 1", "EOF"]),
        ("{}".to_owned(), &["line 1", "missing field `sfm_data_version`"]),
        (SMALL.replace("0.2", "0.9"), &["sfm_data_version cannot be `0.9`"]),
        (SMALL.replace(r#""center": [1, 2, 3]"#, r#""center": [1, 2]"#), &["line 8", "length 2"]),
        (SMALL.replace(r#", "center": [1, 2, 3]"#, ""), &["line 8", "missing field `center`"]),
        (SMALL.replace("5.5", "1e999"), &["line 10", "out of range"]),
        (SMALL.replace("5.5", "NaN"), &["line 10", "expected value"]),
        (SMALL.replace("]}\n", "]}\nx"), &["line 12", "trailing characters"]),
        (doubled, &["point 5", "key 5 occurs twice"]),
        (
            SMALL.replace(r#""id_intrinsic": 3"#, r#""id_intrinsic": 4"#),
            &["view 7", "intrinsic 4 does not exist"],
        ),
        (
            SMALL.replace(r#"[{"key": 7, "value": {"id_feat"#, r#"[{"key": 8, "value": {"id_feat"#),
            &["point 5", "view 8 does not exist"],
        ),
        (SMALL.replace("[0, 0, -1]", "[0, 0, -2]"), &["pose 9", "not a rigid motion"]),
        (SMALL.replace("[0, 0, -1]", "[0, 0, 1]"), &["pose 9", "reflection"]),
        (
            SMALL.replace(r#""focal_length": 10.0, "#, ""),
            &["intrinsic 3", "focal_length is missing"],
        ),
        (
            SMALL.replace(r#""pinhole""#, r#""pinhole_radial_k3""#),
            &["intrinsic 3", "disto_k3 is missing"],
        ),
        (
            SMALL.replace(r#""pinhole""#, r#""spherical""#),
            &["camera 3", "spherical", "no such model"],
        ),
    ];
    for (text, parts) in table {
        refused(model(text), parts);
    }
    let path = Path::new("sfm_data.json.gz");
    refused(OpenMvgFile::parse(b"\x1f\x8b\x08", path), &["compressed (gzip)"]);
}

#[test]
fn a_model_survives_the_way_through_colmap() {
    let (model, _) = model(ROOM).unwrap();
    let colmap = SparseModel::from_colmap(&model.to_colmap().unwrap()).unwrap();
    assert_eq!(colmap.image_names, model.image_names);
    assert_eq!(colmap.problem.cameras, model.problem.cameras);
    assert_eq!(colmap.problem.landmarks, model.problem.landmarks);
    let (before, after) = (bundle_cost(&model.problem).total, bundle_cost(&colmap.problem).total);
    assert!((before - after).abs() <= 1e-9 * before, "{before} {after}");
}
