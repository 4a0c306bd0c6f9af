//! Bundler: numbers survive, cameras without a pose are known, bad files are named.

use std::path::Path;

use covis_solvers::evaluation::bundle_cost;
use covis_solvers::io::IoError;
use covis_solvers::io::bundler::{BundlerFile, BundlerView};
use covis_solvers::io::sparse_model::SparseModel;

use super::refused;

/// A camera without a pose, then one at the origin, and one point right of and above its axis.
const SMALL: &str = "# Bundle file v0.3\n2 1\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n\
    100 0 0\n1 0 0\n0 1 0\n0 0 1\n0 0 0\n\
    0.1 0.2 -2\n10 20 30\n1 1 7 5 10\n";

pub(crate) fn small() -> BundlerFile {
    parse(SMALL).unwrap()
}

fn parse(text: &str) -> Result<BundlerFile, IoError> {
    BundlerFile::parse(text.as_bytes(), Path::new("bundle.out"))
}

#[test]
fn reads_the_numbers_where_they_stand() {
    let file = small();
    assert_eq!(file.cameras[1].intrinsics, [100.0, 0.0, 0.0]);
    assert_eq!(file.cameras.iter().map(|c| c.is_placed()).collect::<Vec<_>>(), [false, true]);
    assert_eq!(file.points[0].color, [10, 20, 30]);
    assert_eq!(file.points[0].views, [BundlerView { camera: 1, key: 7, x: 5.0, y: 10.0 }]);
    assert_eq!(BundlerFile::parse(&file.to_bytes(), Path::new("copy")).unwrap(), file);
}

#[test]
fn axes_are_flipped_and_cameras_without_a_pose_left_out() {
    let model = SparseModel::from_bundler(&small()).unwrap();
    assert_eq!(model.problem.poses.len(), 1);
    assert_eq!(model.problem.reprojections.pixels[0], nalgebra::Vector2::new(5.0, -10.0));
    assert!(bundle_cost(&model.problem).total < 1e-24);
    assert_eq!(model.problem.behind_camera_count(), 0);
}

#[test]
fn the_list_of_images_is_read_and_written_beside_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bundle.out");
    let mut file = small();
    file.write(&path).unwrap();
    assert_eq!(BundlerFile::read(&path).unwrap(), file, "no list, no names");
    fs_err::write(folder.path().join("list.txt"), "a.jpg 0 512.5\nb/c.jpg\n").unwrap();
    file.image_names = vec!["a.jpg".to_owned(), "b/c.jpg".to_owned()];
    assert_eq!(BundlerFile::read(&path).unwrap(), file);
    let copy = folder.path().join("copy.out");
    file.write(&copy).unwrap();
    assert_eq!(BundlerFile::read(&copy).unwrap(), file);
    fs_err::write(folder.path().join("copy.list.txt"), "a.jpg\n").unwrap();
    refused(BundlerFile::read(&copy), &["copy.list.txt", "1 image names, 2 are needed"]);
    file.image_names[1] = "with space".to_owned();
    refused(file.write(&copy), &["image 1", "white space"]);
}

#[test]
fn bad_files_are_refused_by_line_and_field() {
    let point = "0.1 0.2 -2\n10 20 30\n1 1 7 5 10\n";
    let table: &[(String, &[&str])] = &[
        (String::new(), &["line 1", "camera count is missing"]),
        ("# x\n1000000 1\n".to_owned(), &["line 2", "camera count says 1000000"]),
        (SMALL.replace("2 1\n0 0 0", "2 1\n0 nan 0"), &["line 3", "focal length, k1, k2[1]"]),
        (SMALL.replace("1 0 0\n0 1 0", "2 0 0\n0 1 0"), &["line 9", "not a rigid motion"]),
        (SMALL.replace(point, "0 0 0\n256 0 0\n0\n"), &["line 14", "red", "`256`"]),
        (SMALL.replace("1 1 7 5 10", "9 1 7 5 10"), &["line 15", "view count says 9"]),
        (SMALL.replace("1 1 7 5 10", "1 0 7 5 10"), &["line 15", "reconstructed camera 0"]),
        (SMALL.replace("1 1 7 5 10", "1 1 7 5 10 3"), &["line 15", "unexpected `3`"]),
        (format!("{SMALL}7\n"), &["unexpected `7`"]),
    ];
    for (text, parts) in table {
        refused(parse(text), parts);
    }
}
