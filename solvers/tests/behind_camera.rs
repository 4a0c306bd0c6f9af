//! Leaving out observations whose landmark is behind its camera, at the level of the problem.
//!
//! What is dropped, what stays, and that a solve of what is left moves nothing that lost all of its
//! observations.

use covis_solvers::bundle_adjustment::{Options, solve};
use covis_solvers::factors::Reprojection;
use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3, So3};
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::problem::BundleProblem;
use nalgebra::{Vector2, Vector3};

/// Three cameras in a row that look along +z, the last one backwards; landmarks in front of the
/// first two, one in the center plane of them all, one behind them. Every camera sees every landmark
/// twice: with and without depth.
fn row_of_cameras() -> BundleProblem {
    let mut problem = BundleProblem::default();
    let pinhole = PinholeRadialTangential::undistorted(500.0, 500.0, 320.0, 240.0);
    let camera = problem.push_camera(Camera::Pinhole(pinhole), true) as u32;
    problem.push_pose(Se3::new(So3::identity(), Vector3::zeros()));
    problem.push_pose(Se3::new(So3::identity(), Vector3::new(0.5, 0.0, 0.0)));
    let half_turn = So3::from_quaternion_xyzw(0.0, 1.0, 0.0, 0.0).unwrap();
    problem.push_pose(Se3::new(half_turn, Vector3::new(1.0, 0.0, 0.0)));
    problem.constant_poses[0] = true;
    for point in [[0.1, 0.2, 4.0], [-0.3, 0.1, 5.0], [0.4, -0.2, 3.0], [0.2, 0.3, 0.0]] {
        problem.push_landmark(Vector3::from(point));
    }
    problem.push_landmark(Vector3::new(0.7, 0.1, -4.0));
    for landmark in 0..problem.landmarks.len() as u32 {
        for pose in 0..problem.poses.len() as u32 {
            // The pixel tells the observation apart.
            let pixel = Vector2::new(300.0 + f64::from(landmark), 200.0 + f64::from(pose));
            problem.reprojections.push(pose, camera, landmark, pixel, 1.0);
            let (depth_m, sigma_depth_m) = (4.0 + f64::from(landmark), 0.1);
            let factor =
                Reprojection { pixel, sigma_px: 2.0, depth_m: Some((depth_m, sigma_depth_m)) };
            problem.push_observation(pose, camera, landmark, factor);
        }
    }
    problem
}

#[test]
fn drops_what_is_at_or_behind_the_center_plane_and_nothing_else() {
    let before = row_of_cameras();
    let mut problem = before.clone();
    // The backward camera loses three landmarks, the forward ones the one behind, all the one in
    // their plane; each with and without depth.
    assert_eq!(problem.behind_camera_count(), 2 * (3 + 2 + 3));
    assert_eq!(problem.drop_behind_camera(), 16);
    assert_eq!((problem.observation_count(), problem.behind_camera_count()), (14, 0));
    assert_eq!(problem.drop_behind_camera(), 0);
    let (plain, depth) = (&problem.reprojections, &problem.depth_reprojections);
    let kept = [(0, 0), (1, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 4)];
    for (k, &(pose, landmark)) in kept.iter().enumerate() {
        let pixel = Vector2::new(300.0 + f64::from(landmark), 200.0 + f64::from(pose));
        assert_eq!((plain.poses[k], plain.landmarks[k], plain.pixels[k]), (pose, landmark, pixel));
        assert_eq!((depth.poses[k], depth.landmarks[k], depth.pixels[k]), (pose, landmark, pixel));
        assert_eq!(depth.depths_m[k], 4.0 + f64::from(landmark));
    }
    let lengths = [plain.cameras.len(), plain.sigmas_px.len(), depth.cameras.len()];
    assert_eq!(lengths, [kept.len(); 3]);
    assert_eq!([depth.sigmas_px.len(), depth.sigmas_depth_m.len()], [kept.len(); 2]);
    // All the rest is untouched.
    problem.reprojections = before.reprojections.clone();
    problem.depth_reprojections = before.depth_reprojections.clone();
    assert_eq!(problem, before);
}

#[test]
fn variables_that_lose_all_observations_stay_where_they_are() {
    let mut problem = row_of_cameras();
    // Without landmark 4 the backward camera has nothing left to see.
    problem.landmarks[4].z = 0.0;
    problem.drop_behind_camera();
    let before = problem.clone();
    let summary = solve(&mut problem, &Options::default(), &mut ignore_iterations).unwrap();
    assert!(summary.solve.final_cost < summary.solve.initial_cost);
    assert_ne!(problem.poses[1], before.poses[1]);
    assert_eq!(problem.poses[2], before.poses[2]);
    assert_ne!(problem.landmarks[..3], before.landmarks[..3]);
    assert_eq!(problem.landmarks[3..], before.landmarks[3..]);
}

#[test]
fn an_index_without_a_variable_is_left_to_validate() {
    let mut problem = row_of_cameras();
    problem.reprojections.landmarks[0] = 99;
    problem.depth_reprojections.poses[14] = 99;
    assert_eq!(problem.behind_camera_count(), 16);
    assert_eq!(problem.drop_behind_camera(), 16);
    assert!(problem.validate().is_err());
}
