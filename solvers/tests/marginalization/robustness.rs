//! Input that says little, or is wrong: no panic, no information out of nothing.

use covis_solvers::factors::Reprojection;
use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3, So3};
use covis_solvers::loss::Loss;
use covis_solvers::marginalization::{Marginal, marginalize_pose};
use covis_solvers::problem::{BundleProblem, SolveError};
use covis_solvers::testing::random::{element, normal_vector, seeded, uniform_vector};
use nalgebra::{Vector2, Vector3};
use proptest::prelude::*;
use rand::RngExt;

use super::{is_forest, pose_prior, position_prior, relative_pose};

fn camera() -> Camera {
    Camera::Pinhole(PinholeRadialTangential::undistorted(500.0, 500.0, 320.0, 240.0))
}

/// Cameras side by side that look along +z.
fn row_of_cameras(count: usize) -> BundleProblem {
    let mut problem = BundleProblem::default();
    problem.push_camera(camera(), true);
    for k in 0..count {
        problem.push_pose(Se3::new(So3::identity(), Vector3::new(0.3 * k as f64, 0.0, 0.0)));
    }
    problem
}

/// Landmark at `point`, seen without error by `poses`.
fn see(problem: &mut BundleProblem, point: Vector3<f64>, poses: &[usize]) {
    let landmark = problem.push_landmark(point) as u32;
    for &pose in poses {
        let in_camera = problem.poses[pose].inverse_transform(&point);
        let pixel = problem.cameras[0].project(&in_camera).unwrap();
        problem.reprojections.push(pose as u32, 0, landmark, pixel, 1.0);
    }
}

fn points() -> impl Iterator<Item = Vector3<f64>> {
    (0..12).map(|k| {
        let angle = f64::from(k);
        Vector3::new(angle.cos(), angle.sin(), 3.0 + 0.4 * f64::from(k % 5))
    })
}

#[test]
fn a_pose_without_neighbors_leaves_nothing() {
    let mut problem = row_of_cameras(1);
    assert_eq!(marginalize_pose(&problem, 0), Ok(Marginal::default()));
    points().for_each(|point| see(&mut problem, point, &[0]));
    assert_eq!(marginalize_pose(&problem, 0), Ok(Marginal::default()));
    // Known in the world, but to nobody else.
    problem.pose_priors = vec![pose_prior(&problem, 0, &mut seeded(1))];
    assert_eq!(marginalize_pose(&problem, 0), Ok(Marginal::default()));
    // Others that share nothing with it.
    let mut problem = row_of_cameras(4);
    points().for_each(|point| see(&mut problem, point, &[0, 1, 3]));
    assert_eq!(marginalize_pose(&problem, 2), Ok(Marginal::default()));
}

#[test]
fn one_neighbor_leaves_nothing_but_priors() {
    let mut problem = row_of_cameras(2);
    points().for_each(|point| see(&mut problem, point, &[0, 1]));
    assert_eq!(marginalize_pose(&problem, 1), Ok(Marginal::default()));
    problem.pose_priors = vec![pose_prior(&problem, 1, &mut seeded(2))];
    let marginal = marginalize_pose(&problem, 1).unwrap();
    assert!(marginal.relative_poses.is_empty());
    assert_eq!(marginal.pose_priors.len(), 1);
    assert_eq!(marginal.pose_priors[0].pose, 0);
}

#[test]
fn a_landmark_with_one_view_left_ties_nobody_by_itself() {
    // Each landmark is seen by the removed pose and by one other: six on either side.
    let mut problem = row_of_cameras(3);
    points().for_each(|point| see(&mut problem, point, &[1, 0]));
    points().for_each(|point| see(&mut problem, point, &[1, 2]));
    let marginal = marginalize_pose(&problem, 1).unwrap();
    // Through the removed pose they do: 0 and 2 are both tied to it, but for a scale each.
    assert_eq!(marginal.relative_poses.len(), 1);
    // A single landmark on a side ties nobody.
    let mut problem = row_of_cameras(3);
    let mut points = points();
    see(&mut problem, points.next().unwrap(), &[1, 0]);
    see(&mut problem, points.next().unwrap(), &[1, 2]);
    assert_eq!(marginalize_pose(&problem, 1), Ok(Marginal::default()));
}

#[test]
fn landmarks_behind_a_camera_say_nothing() {
    let mut problem = row_of_cameras(3);
    points().for_each(|point| see(&mut problem, point, &[0, 1, 2]));
    let clean = marginalize_pose(&problem, 1).unwrap();
    assert_eq!(clean.relative_poses.len(), 1);
    for z in [-2.0, -1e-9, 0.0] {
        let landmark = problem.push_landmark(Vector3::new(0.1, 0.2, z)) as u32;
        for pose in 0..3 {
            problem.reprojections.push(pose, 0, landmark, Vector2::new(300.0, 200.0), 1.0);
        }
    }
    assert_eq!(marginalize_pose(&problem, 1).unwrap(), clean);
}

#[test]
fn groups_that_the_removed_pose_cannot_tie_stay_apart() {
    // It shares one landmark with 3 and 4, which says nothing of how they lie to 0 and 1.
    let mut problem = row_of_cameras(5);
    points().for_each(|point| see(&mut problem, point, &[0, 1, 2]));
    let mut rng = seeded(3);
    problem.relative_poses = vec![relative_pose(&problem, (3, 4), &mut rng)];
    see(&mut problem, Vector3::new(0.2, 0.1, 4.0), &[2, 3]);
    let marginal = marginalize_pose(&problem, 2).unwrap();
    let edges: Vec<_> = marginal.relative_poses.iter().map(|f| (f.i, f.j)).collect();
    assert!(edges.contains(&(0, 1)), "{edges:?}");
    assert!(edges.iter().all(|&(i, j)| i != 4 && j != 4), "{edges:?}");
}

#[test]
fn wrong_input_is_an_error() {
    let mut rng = seeded(4);
    let mut problem = row_of_cameras(3);
    points().for_each(|point| see(&mut problem, point, &[0, 1, 2]));
    problem.relative_poses = vec![relative_pose(&problem, (0, 1), &mut rng)];
    let error = marginalize_pose(&problem, 3).unwrap_err();
    assert_eq!(error.to_string(), "marginalization of pose 3: pose 3 does not exist (there are 3)");
    assert!(matches!(
        marginalize_pose(&BundleProblem::default(), 0),
        Err(SolveError::IndexOutOfRange { .. })
    ));
    let spoiled = |spoil: fn(&mut BundleProblem)| {
        let mut problem = problem.clone();
        spoil(&mut problem);
        marginalize_pose(&problem, 1).unwrap_err()
    };
    let not_finite = |what| SolveError::NotFinite { what, index: 1 };
    assert_eq!(spoiled(|p| p.poses[1].translation.x = f64::NAN), not_finite("pose"));
    assert_eq!(spoiled(|p| p.landmarks[1].x = f64::INFINITY), not_finite("landmark"));
    let error = spoiled(|p| p.relative_poses[0].j = 7);
    assert!(matches!(error, SolveError::IndexOutOfRange { value: 7, .. }), "{error}");
    // Finite by itself, not so when squared.
    let error = spoiled(|p| p.reprojections.sigmas_px.fill(1e-200));
    assert_eq!(error, not_finite("information of pose"));
}

/// A scene of anything, little of it sensible.
fn scene(seed: u64) -> BundleProblem {
    let mut rng = seeded(seed);
    let mut problem = BundleProblem::default();
    problem.push_camera(camera(), true);
    let count = rng.random_range(1..9);
    let spread = 10.0_f64.powi(rng.random_range(-3..4));
    for _ in 0..count {
        problem.push_pose(Se3::new(
            So3::exp(&normal_vector(&mut rng, 0.3)),
            uniform_vector(&mut rng, spread),
        ));
    }
    for _ in 0..rng.random_range(0..40) {
        let mut point: Vector3<f64> = uniform_vector(&mut rng, 3.0 * spread);
        point.z += spread * f64::from(rng.random_range(0..3));
        let landmark = problem.push_landmark(point) as u32;
        for pose in 0..count {
            if rng.random::<f64>() < 0.4 {
                continue;
            }
            let noise: Vector2<f64> = normal_vector(&mut rng, 1.0);
            let in_camera = problem.poses[pose].inverse_transform(&point);
            let pixel = problem.cameras[0].project(&in_camera).unwrap_or_default() + noise;
            let sigma_px = 10.0_f64.powi(rng.random_range(-2..3));
            if rng.random::<f64>() < 0.5 {
                problem.reprojections.push(pose as u32, 0, landmark, pixel, sigma_px);
            } else {
                let depth_m = in_camera.z;
                let factor = Reprojection { pixel, sigma_px, depth_m: Some((depth_m, 0.1)) };
                problem.push_observation(pose as u32, 0, landmark, factor);
            }
        }
    }
    for _ in 0..rng.random_range(0..4) {
        let pair = (rng.random_range(0..count), rng.random_range(0..count));
        let mut factor = relative_pose(&problem, pair, &mut rng);
        factor.i_from_j = factor.i_from_j.compose(&element(&mut rng, 0.1));
        problem.relative_poses.push(factor);
    }
    for _ in 0..rng.random_range(0..2) {
        let pose = rng.random_range(0..count);
        let prior = pose_prior(&problem, pose, &mut rng);
        problem.pose_priors.push(prior);
    }
    for _ in 0..rng.random_range(0..2) {
        let pose = rng.random_range(0..count);
        let prior = position_prior(&problem, pose, &mut rng);
        problem.position_priors.push(prior);
    }
    let losses = [Loss::Trivial, Loss::Huber(1.0), Loss::Tukey(2.0), Loss::Cauchy(0.5)];
    problem.observation_loss = losses[rng.random_range(0..4)];
    problem.relative_pose_loss = losses[rng.random_range(0..4)];
    problem
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..Default::default() })]

    #[test]
    fn every_information_is_definite(seed in any::<u64>()) {
        let problem = scene(seed);
        let count = problem.poses.len();
        for removed in 0..count {
            let marginal = marginalize_pose(&problem, removed).unwrap();
            prop_assert_eq!(&marginal, &marginalize_pose(&problem, removed).unwrap());
            // The world is one node more.
            let edges = marginal.relative_poses.iter().map(|f| (f.i, f.j));
            let all = edges.chain(marginal.pose_priors.iter().map(|f| (f.pose, count)));
            prop_assert!(all.clone().all(|(i, j)| i != removed && j != removed && i < j));
            prop_assert!(is_forest(all, count + 1));
            let has_prior = problem.pose_priors.iter().any(|f| f.pose == removed)
                || problem.position_priors.iter().any(|f| f.pose == removed);
            prop_assert!(has_prior || marginal.pose_priors.is_empty());
            for edge in &marginal.relative_poses {
                let residual = edge.residual(&problem.poses[edge.i], &problem.poses[edge.j]);
                prop_assert!(residual.amax() < 1e-9);
            }
            let priors = marginal.pose_priors.iter().map(|f| f.information);
            for information in marginal.relative_poses.iter().map(|f| f.information).chain(priors) {
                prop_assert!(information.matrix().iter().all(|x| x.is_finite()));
                prop_assert!(information.sqrt().is_ok());
                prop_assert_eq!(*information.matrix(), information.matrix().transpose());
            }
        }
    }
}
