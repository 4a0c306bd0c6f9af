//! Cameras of COLMAP's models in bundle adjustment: only the parameters of the model move, the optimum is
//! that of the model, and the model is written back.

use covis_solvers::bundle_adjustment::{LinearSolver, Options, solve};
use covis_solvers::evaluation::bundle_cost;
use covis_solvers::geometry::{Camera, FreeParameters, LieGroup, ParameterKind, Se3, Snavely, So3};
use covis_solvers::io::colmap::{
    ColmapCamera, ColmapCameraModel, ColmapEncoding, ColmapImage, ColmapModel, ColmapPoint,
};
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::problem::{BundleProblem, SolveError};
use covis_solvers::testing::data;
use covis_solvers::testing::random::{normal_vector, seeded, uniform_vector};
use nalgebra::{Vector2, Vector3};

use crate::bundle_adjustment::twin;

/// Every model that covis reads, with parameters of a lens that it describes.
const MODELS: [(ColmapCameraModel, &[f64]); 9] = [
    (ColmapCameraModel::SimplePinhole, &[500.0, 320.0, 240.0]),
    (ColmapCameraModel::Pinhole, &[500.0, 510.0, 320.0, 240.0]),
    (ColmapCameraModel::SimpleRadial, &[500.0, 320.0, 240.0, -0.05]),
    (ColmapCameraModel::Radial, &[500.0, 320.0, 240.0, -0.05, 0.01]),
    (ColmapCameraModel::OpenCv, &[500.0, 510.0, 320.0, 240.0, -0.05, 0.01, 0.001, -0.002]),
    (
        ColmapCameraModel::FullOpenCv,
        &[500.0, 510.0, 320.0, 240.0, -0.05, 0.01, 0.001, -0.002, 0.003, 0.0, 0.0, 0.0],
    ),
    (ColmapCameraModel::OpenCvFisheye, &[300.0, 301.0, 320.0, 240.0, 0.02, -0.004, 0.001, 0.0]),
    (ColmapCameraModel::SimpleRadialFisheye, &[300.0, 320.0, 240.0, 0.02]),
    (ColmapCameraModel::RadialFisheye, &[300.0, 320.0, 240.0, 0.02, -0.004]),
];

/// Image `k` of eight: at different distances, towards different points and rolled, since views that
/// circle around one point do not determine a focal length.
fn view(k: u32) -> Se3 {
    let at = |values: &[f64]| values[k as usize % values.len()];
    let across = f64::from(k) - 4.5;
    let position = Vector3::new(0.5 * across, at(&[-1.2, 1.2, 0.0, 0.8]), at(&[0.0, -1.5, 1.0]));
    let target = Vector3::new(at(&[-0.3, 0.0, 0.3]), at(&[-0.25, 0.25]), 5.0);
    let forward = target - position;
    let about = |axis: Vector3<f64>, angle: f64| So3::exp(&(axis * angle));
    let turn = about(Vector3::y(), forward.x.atan2(forward.z));
    let tilt = about(Vector3::x(), -forward.y.atan2(forward.x.hypot(forward.z)));
    let roll = about(Vector3::z(), 1.3 * across);
    Se3::new(turn.compose(&tilt).compose(&roll), position)
}

/// Eight images of one camera, or of one each, with half a pixel of noise; poses, points and intrinsics
/// start beside the truth.
fn model(kind: ColmapCameraModel, parameters: &[f64], cameras: u32) -> ColmapModel {
    let mut rng = seeded(11);
    let mut model = ColmapModel::default();
    let truth =
        ColmapCamera { model: kind, width: 640, height: 480, parameters: parameters.to_vec() };
    let camera = truth.to_camera(1).unwrap();
    let points: Vec<Vector3<f64>> =
        (0..60).map(|_| Vector3::new(0.0, 0.0, 5.0) + uniform_vector::<3>(&mut rng, 1.6)).collect();
    for (id, point) in (1..).zip(&points) {
        let start = point + normal_vector::<3>(&mut rng, 0.02);
        model.points.insert(id, ColmapPoint::new(&start, [0; 3]));
    }
    for id in 1..=8 {
        let pose = view(id);
        let tangent = normal_vector::<6>(&mut rng, 0.005);
        let own = if cameras == 1 { 1 } else { id };
        let name = format!("{id}.png");
        model.images.insert(id, ColmapImage::new(name, own, &pose.plus(&tangent)));
        for (point, position) in (1..).zip(&points) {
            let pixel = camera.project(&pose.inverse_transform(position)).unwrap();
            let noise: Vector2<f64> = normal_vector(&mut rng, 0.5);
            model.push_observation(id, &(pixel + noise), point).unwrap();
        }
    }
    for id in 1..=cameras {
        let mut start = truth.clone();
        start.parameters[0] *= 1.01;
        model.cameras.insert(id, start);
    }
    model
}

fn solved(problem: &mut BundleProblem, linear_solver: LinearSolver) -> f64 {
    let mut options = Options { linear_solver, ..Options::default() };
    options.optimizer.max_iterations = 200;
    let summary = solve(problem, &options, &mut ignore_iterations).unwrap().solve;
    // Inexact steps creep along valleys.
    let is_exact = linear_solver != LinearSolver::IterativeSchur;
    assert!(!is_exact || summary.termination.is_converged(), "{:?}", summary.termination);
    let found = bundle_cost(problem).total;
    assert!((found / summary.final_cost - 1.0).abs() < 1e-9, "{found} {}", summary.final_cost);
    found
}

/// Steps that come near the optimum; cameras of single images are too weakly determined for more.
const FEW: usize = 12;

/// The cost after a few steps.
fn improved(problem: &mut BundleProblem) -> f64 {
    let before = bundle_cost(problem).total;
    let mut options = Options::default();
    options.optimizer.max_iterations = FEW;
    solve(problem, &options, &mut ignore_iterations).unwrap();
    let after = bundle_cost(problem).total;
    assert!(after < 0.1 * before, "{before} to {after}");
    after
}

#[test]
fn the_known_optima_of_colmaps_models_are_reached() {
    // pycolmap and scipy; for SIMPLE_RADIAL scipy.
    for (name, optimum) in [
        ("colmap_pinhole", 11.59872018),
        ("colmap_simple_pinhole", 10.97080636),
        ("colmap_simple_radial", 10.95564279),
    ] {
        let Some(path) = data(&format!("cases/{name}")) else { return };
        let mut model = ColmapModel::read(&path).unwrap();
        let kind = model.cameras[&1].model;
        for linear_solver in [LinearSolver::DenseSchur, LinearSolver::SparseSchur] {
            let mut converted = model.to_problem().unwrap();
            let cost = solved(&mut converted.problem, linear_solver);
            assert!((cost / optimum - 1.0).abs() < 1e-7, "{name}: {cost}, not {optimum}");
            model.update_from(&converted).unwrap();
            let written = &model.cameras[&1];
            assert_eq!((written.model, written.parameters.len()), (kind, kind.parameter_count()));
        }
        let mut held = ColmapModel::read(&path).unwrap().to_problem().unwrap().problem;
        held.constant_cameras.fill(true);
        let cost = solved(&mut held, LinearSolver::Auto);
        assert!(name != "colmap_pinhole" || (cost / 11.77738944 - 1.0).abs() < 1e-7, "{cost}");
    }
}

#[test]
fn each_model_is_solved_and_written_back_as_itself() {
    for (kind, parameters) in MODELS {
        for cameras in [1, 8] {
            let name = format!("{} of {cameras}", kind.name());
            let mut model = model(kind, parameters, cameras);
            let mut converted = model.to_problem().unwrap();
            let start = converted.problem.cameras.clone();
            let cost = improved(&mut converted.problem);
            let free = kind.free_parameters();
            for (before, after) in start.iter().zip(&converted.problem.cameras) {
                let (before, after) = (before.parameters(), after.parameters());
                for k in 0..before.count {
                    assert_eq!(before[k] != after[k], free.is_free()[k], "{name}, parameter {k}");
                }
                assert!(!free.has_one_focal_length() || after[0] == after[1], "{name}");
            }
            model.update_from(&converted).unwrap();
            for encoding in [ColmapEncoding::Text, ColmapEncoding::Binary] {
                let folder = tempfile::tempdir().unwrap();
                model.write(folder.path(), encoding).unwrap();
                let read = ColmapModel::read(folder.path()).unwrap();
                for camera in read.cameras.values() {
                    assert_eq!(camera.model, kind, "{name}");
                    assert_eq!(camera.parameters.len(), kind.parameter_count());
                }
                let again = bundle_cost(&read.to_problem().unwrap().problem).total;
                assert!((again / cost - 1.0).abs() < 1e-9, "{name}: {again} written, not {cost}");
            }
        }
    }
}

#[test]
fn no_small_move_of_the_free_parameters_lowers_the_cost() {
    for (kind, parameters) in MODELS {
        let mut problem = model(kind, parameters, 1).to_problem().unwrap().problem;
        let best = solved(&mut problem, LinearSolver::DenseSchur);
        let free = problem.free_parameters_of(0);
        for unknown in 0..problem.camera_unknowns(0) {
            for step in [1e-3, -1e-3, 1e-5, -1e-5] {
                let mut moves = [0.0; 9];
                moves[unknown] = step;
                let mut moved = problem.clone();
                moved.cameras[0].plus_parameters(&free.of_parameters(&moves));
                let cost = bundle_cost(&moved).total;
                let name = kind.name();
                assert!(cost > best * (1.0 - 1e-9), "{name}, {unknown}: {cost} below {best}");
            }
        }
    }
}

#[test]
fn every_linear_solver_and_loss_takes_the_free_parameters_alike() {
    for loss in [Loss::Trivial, Loss::Huber(1.0)] {
        for (kind, parameters) in [MODELS[0], MODELS[2], MODELS[7]] {
            let mut problem = model(kind, parameters, 1).to_problem().unwrap().problem;
            problem.observation_loss = loss;
            let costs =
                [LinearSolver::DenseSchur, LinearSolver::SparseSchur, LinearSolver::IterativeSchur]
                    .map(|linear_solver| solved(&mut problem.clone(), linear_solver));
            assert!((costs[1] / costs[0] - 1.0).abs() < 1e-9, "{}: {costs:?}", kind.name());
            assert!((costs[2] / costs[0] - 1.0).abs() < 1e-5, "{}: {costs:?}", kind.name());
        }
    }
}

/// The twin of BAL's form with these kinds of intrinsics free.
fn restricted(kinds: &[ParameterKind]) -> BundleProblem {
    let mut problem = twin();
    for camera in 0..problem.cameras.len() {
        let own = problem.free_parameters_of(camera);
        let own = own.only(&problem.cameras[camera], |kind| kinds.contains(&kind));
        problem.set_free_parameters(camera, own);
    }
    problem
}

#[test]
fn kinds_of_intrinsics_are_held_on_request() {
    use ParameterKind::{Distortion, FocalLength, PrincipalPoint};
    let cost = |kinds: &[ParameterKind]| {
        let mut problem = restricted(kinds);
        let start = problem.cameras.clone();
        let cost = solved(&mut problem, LinearSolver::Auto);
        for (before, after) in start.iter().zip(&problem.cameras) {
            let (Camera::Snavely(before), Camera::Snavely(after)) = (before, after) else {
                panic!("BAL's cameras are Snavely's")
            };
            assert_eq!(before.focal != after.focal, kinds.contains(&FocalLength));
            assert_eq!(before.k1 != after.k1, kinds.contains(&Distortion));
        }
        cost
    };
    let (none, focal) = (cost(&[PrincipalPoint]), cost(&[FocalLength]));
    let (distortion, all) = (cost(&[Distortion]), cost(&[FocalLength, Distortion]));
    assert!(all < focal && focal < none && all < distortion && distortion < none);
    let mut known = twin();
    known.constant_cameras.fill(true);
    assert_eq!(none, solved(&mut known, LinearSolver::Auto), "no free parameter is a known camera");
    let full = solved(&mut twin(), LinearSolver::Auto);
    assert!((all / full - 1.0).abs() < 1e-9, "{all} {full}");
}

#[test]
fn a_list_of_another_length_is_refused() {
    let mut problem = twin();
    problem.free_parameters = vec![FreeParameters::ALL];
    let error = problem.validate().unwrap_err();
    assert!(matches!(error, SolveError::LengthMismatch { what: "free_parameters", .. }), "{error}");
    problem.set_free_parameters(1, FreeParameters::NONE);
    let camera = Camera::Snavely(Snavely { focal: 1.0, k1: 0.0, k2: 0.0 });
    let added = problem.push_camera(camera, false);
    problem.validate().unwrap();
    assert_eq!((problem.camera_unknowns(1), problem.camera_unknowns(added)), (0, 3));
}
