//! Between BAL, Bundler and COLMAP: poses, points and cost stay, whatever way a model goes.

use covis_solvers::evaluation::bundle_cost;
use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3};
use covis_solvers::io::bal::{BalFile, BalObservation};
use covis_solvers::io::bundler::BundlerFile;
use covis_solvers::io::colmap::{ColmapCamera, ColmapCameraModel, ColmapModel};
use covis_solvers::io::sparse_model::SparseModel;
use proptest::prelude::*;

use super::data::data;
use super::{colmap, refused};

/// A BAL file of any numbers a reconstruction may have.
fn bal() -> impl Strategy<Value = BalFile> {
    let camera = (prop::array::uniform6(-2.0..2.0f64), 100.0..2000.0f64, -0.1..0.1f64);
    let camera = camera.prop_map(|([a, b, c, x, y, z], f, k)| [a, b, c, x, y, z, f, k, 0.1 * k]);
    let cameras = prop::collection::vec(camera, 1..5);
    let points = prop::collection::vec(prop::array::uniform3(-5.0..5.0f64), 1..6);
    (cameras, points, any::<u64>()).prop_map(|(cameras, points, seed)| {
        let mut observations = Vec::new();
        for camera in 0..cameras.len() as u32 {
            for point in 0..points.len() as u32 {
                let mixed = seed.wrapping_mul(u64::from(31 * camera + point) + 1) >> 40;
                let (u, v) = ((mixed & 0xfff) as f64 - 2048.0, (mixed >> 12) as f64 / 7.0 - 290.0);
                observations.push(BalObservation { camera, point, u, v });
            }
        }
        BalFile { cameras, points, observations }
    })
}

/// Whether both hold the same poses, points and residuals.
fn same(a: &SparseModel, b: &SparseModel) {
    let near = |a: f64, b: f64| (a - b).abs() <= 1e-9 * (1.0 + b.abs());
    assert_eq!(a.problem.poses.len(), b.problem.poses.len());
    for (a, b) in a.problem.poses.iter().zip(&b.problem.poses) {
        assert!((a.inverse().compose(b)).log().norm() < 1e-12, "{a:?} {b:?}");
    }
    assert_eq!(a.problem.landmarks, b.problem.landmarks);
    let (before, after) = (bundle_cost(&a.problem).total, bundle_cost(&b.problem).total);
    assert!(near(before, after), "{before} {after}");
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 128, failure_persistence: None, ..Default::default() })]

    #[test]
    fn a_model_survives_each_way_through_the_other_formats(file in bal()) {
        let model = SparseModel::from_bal(&file);
        let bundler = SparseModel::from_bundler(&model.to_bundler().unwrap()).unwrap();
        same(&model, &bundler);
        let colmap = SparseModel::from_colmap(&model.to_colmap().unwrap()).unwrap();
        same(&model, &colmap);
        let back = colmap.to_bal().unwrap();
        same(&model, &SparseModel::from_bal(&back));
        // Bundler lists by point; sorted alike, pixels are the same to the bit.
        let mut back = bundler.to_bal().unwrap().observations;
        back.sort_by_key(|o| (o.camera, o.point));
        prop_assert_eq!(back, file.observations);
    }
}

#[test]
fn a_real_file_survives() {
    let Some(path) = data("bal/trafalgar-21-11315.txt") else { return };
    let model = SparseModel::from_bal(&BalFile::read(&path).unwrap());
    let colmap = SparseModel::from_colmap(&model.to_colmap().unwrap()).unwrap();
    same(&model, &colmap);
    let bundler = colmap.to_bundler().unwrap();
    assert_eq!(bundler.image_names[0], "image000001");
    same(&model, &SparseModel::from_bundler(&bundler).unwrap());
}

#[test]
fn names_and_colors_go_along() {
    let mut model = colmap::model();
    for camera in model.cameras.values_mut() {
        let parameters = vec![500.0, 319.5, 240.25, 0.01];
        let kind = ColmapCameraModel::SimpleRadial;
        *camera = ColmapCamera { model: kind, width: 640, height: 480, parameters };
    }
    let sparse = SparseModel::from_colmap(&model).unwrap();
    let bundler = sparse.to_bundler();
    assert_eq!(sparse.image_names, ["empty.png", "view 9.png", "view 10.png"]);
    let file: BundlerFile = bundler.unwrap();
    assert_eq!(file.points[0].color, [1, 2, 3]);
    same(&sparse, &SparseModel::from_bundler(&file).unwrap());
    let trajectory = sparse.trajectory();
    assert_eq!(trajectory.timestamps, [0.0, 1.0, 2.0]);
    let again: ColmapModel = sparse.to_colmap().unwrap();
    assert_eq!(again.images[&2].name, "view 9.png");
    same(&sparse, &SparseModel::from_colmap(&again).unwrap());
}

#[test]
fn images_named_by_their_times_make_a_trajectory_of_these() {
    let names = ["rgb/1305031102.175304.png", "1305031102.211214.png"].map(str::to_owned);
    let mut model = SparseModel { image_names: names.to_vec(), ..SparseModel::default() };
    for _ in 0..2 {
        model.problem.push_pose(Se3::identity());
    }
    assert_eq!(model.trajectory().timestamps, [1305031102.175304, 1305031102.211214]);
    // The same time of two cameras is one; digits that a time does not hold are none.
    model.image_names[1] = "right/1305031102.175304.png".to_owned();
    assert_eq!(model.trajectory().timestamps, [1305031102.175304; 2]);
    model.image_names[1] = "1305031102.17530400001.png".to_owned();
    assert_eq!(model.trajectory().timestamps, [0.0, 1.0]);
    model.image_names[1] = "b.png".to_owned();
    assert_eq!(model.trajectory().timestamps, [0.0, 1.0]);
}

#[test]
fn a_camera_that_the_format_cannot_hold_is_refused_by_its_number() {
    let mut model = SparseModel::from_bal(&super::bal::small());
    let pinhole = PinholeRadialTangential::undistorted(500.0, 501.0, 1.0, 2.0);
    model.problem.cameras[0] = Camera::Pinhole(pinhole);
    refused(model.to_bal(), &["camera 0", "BAL file holds one focal length"]);
    refused(model.to_bundler(), &["camera 0", "Bundler file holds one focal length"]);
}
