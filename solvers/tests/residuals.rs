//! Residuals by quantity: figures by hand, and whether a wrong sigma shows and a right one does not.

use covis_solvers::bundle_adjustment::{Options, solve};
use covis_solvers::evaluation::{
    ObservationLengths, Quantity, SigmaJudgment, bundle_cost, edge_lengths, pose_graph_cost,
};
use covis_solvers::factors::{PosePrior, PositionPrior, RelativePose, Reprojection};
use covis_solvers::geometry::{LieGroup, Se2, Se3, So3};
use covis_solvers::information::Information;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::problem::{BundleProblem, PoseGraph};
use covis_solvers::testing::random::{normal_vector, seeded};
use covis_solvers::testing::scene::{Scene, SceneOptions};
use nalgebra::{SVector, Vector2, Vector3};

/// A walk with depths, its sigmas those of the noise.
fn walk() -> BundleProblem {
    let options =
        SceneOptions { keyframes: 16, laps: 0.25, landmarks: 600, seed: 5, ..Default::default() };
    Scene::generate(&options).to_problem()
}

fn solved(mut problem: BundleProblem) -> BundleProblem {
    let summary = solve(&mut problem, &Options::default(), &mut ignore_iterations).unwrap();
    assert!(summary.solve.termination.is_converged());
    problem
}

#[test]
fn right_sigmas_are_plausible() {
    let report = bundle_cost(&solved(walk())).residuals;
    for quantity in [Quantity::Pixel, Quantity::Depth] {
        let statistics = report.of(quantity);
        let ratio = statistics.sigma_ratio.unwrap();
        assert!((0.8..1.25).contains(&ratio), "{quantity:?} {ratio}");
        assert_eq!(statistics.judgment(), SigmaJudgment::Plausible);
        assert_eq!(statistics.hint(quantity), None);
        assert!((0.3..1.1).contains(&statistics.reduced_chi2), "{}", statistics.reduced_chi2);
        assert!(statistics.outlier_share < 0.02, "{}", statistics.outlier_share);
    }
}

#[test]
fn a_depth_sigma_that_is_too_small_is_reported() {
    let mut problem = walk();
    problem.depth_reprojections.sigmas_depth_m.iter_mut().for_each(|sigma| *sigma /= 8.0);
    let report = bundle_cost(&solved(problem)).residuals;
    let depth = report.of(Quantity::Depth);
    assert_eq!(depth.judgment(), SigmaJudgment::TooSmall);
    assert!((4.0..12.0).contains(&depth.sigma_ratio.unwrap()), "{:?}", depth.sigma_ratio);
    assert!(depth.hint(Quantity::Depth).unwrap().starts_with("depth residuals are typically"));
    assert!(depth.reduced_chi2 > 9.0);
    assert_eq!(report.of(Quantity::Pixel).judgment(), SigmaJudgment::Plausible);
}

#[test]
fn a_depth_sigma_that_is_too_large_is_reported() {
    let mut problem = walk();
    problem.depth_reprojections.sigmas_depth_m.iter_mut().for_each(|sigma| *sigma *= 8.0);
    let report = bundle_cost(&solved(problem)).residuals;
    assert_eq!(report.of(Quantity::Depth).judgment(), SigmaJudgment::TooLarge);
    assert_eq!(report.of(Quantity::Pixel).judgment(), SigmaJudgment::Plausible);
}

#[test]
fn outliers_do_not_decide_about_a_sigma() {
    let mut problem = solved(walk());
    problem.observation_loss = Loss::Huber(2.0);
    for pixel in problem.depth_reprojections.pixels.iter_mut().step_by(5) {
        *pixel += Vector2::new(90.0, -40.0);
    }
    let report = bundle_cost(&problem).residuals;
    let pixel = report.of(Quantity::Pixel);
    assert_eq!(pixel.judgment(), SigmaJudgment::Plausible);
    assert!(pixel.reduced_chi2 > 100.0);
    assert!((0.2..0.4).contains(&pixel.outlier_share), "{}", pixel.outlier_share);
}

#[test]
fn landmarks_that_one_pose_sees_count_apart() {
    let mut problem = walk();
    let before = bundle_cost(&problem).residuals;
    let pixel = Vector2::new(10.0, 20.0);
    let measurement = Reprojection { pixel, sigma_px: 1.0, depth_m: Some((2.0, 0.1)) };
    for _ in 0..300 {
        let camera = problem.cameras[0];
        let ray = camera.unproject(&measurement.pixel).unwrap();
        let point = problem.poses[0].transform(&(ray * (2.0 / ray.z)));
        let landmark = problem.push_landmark(point) as u32;
        problem.push_observation(0, 0, landmark, measurement);
    }
    let after = bundle_cost(&problem).residuals;
    for quantity in [Quantity::Pixel, Quantity::Depth] {
        let (a, b) = (before.of(quantity), after.of(quantity));
        assert_eq!(b.count, a.count + 300);
        assert_eq!(b.redundant_count, a.redundant_count);
        assert!(b.rms < 0.99 * a.rms, "{quantity:?}");
        assert_eq!((b.redundant_rms, b.reduced_chi2), (a.redundant_rms, a.reduced_chi2));
        assert_eq!((b.outlier_share, b.sigma_ratio), (a.outlier_share, a.sigma_ratio));
    }
}

#[test]
fn pose_factors_have_meters_and_radians() {
    let mut problem = BundleProblem::default();
    let turn = So3::exp(&Vector3::new(0.0, 0.0, 0.1));
    for pose in [Se3::identity(), Se3::new(turn, Vector3::zeros())] {
        problem.push_pose(pose);
    }
    let sigmas = SVector::from([0.5, 0.5, 0.5, 0.05, 0.05, 0.05]);
    let information = Information::from_sigmas(&sigmas).unwrap();
    let i_from_j = Se3::identity();
    problem.relative_poses.push(RelativePose { i: 0, j: 1, i_from_j, information, loss: None });
    let world_from_camera = Se3::new(So3::identity(), Vector3::new(0.0, 3.0, 4.0));
    problem.pose_priors.push(PosePrior {
        pose: 0,
        world_from_camera,
        information,
        loss: Loss::Trivial,
    });
    let information = Information::from_sigmas(&SVector::from([2.0, 2.0, 2.0])).unwrap();
    let position_in_world = Vector3::new(0.0, 0.0, 6.0);
    problem.position_priors.push(PositionPrior {
        pose: 1,
        position_in_world,
        point_in_camera: Vector3::zeros(),
        information,
        loss: Loss::Trivial,
    });
    let report = bundle_cost(&problem).residuals;
    let expected = [
        (Quantity::RelativeTranslation, 0.0, 0.0),
        (Quantity::RelativeRotation, 0.1, 4.0 / 3.0),
        (Quantity::PriorTranslation, 5.0, 100.0 / 3.0),
        (Quantity::PriorRotation, 0.0, 0.0),
        (Quantity::PriorPosition, 6.0, 9.0 / 3.0),
    ];
    assert_eq!(report.iter().count(), expected.len());
    for (quantity, rms, reduced_chi2) in expected {
        let found = report.of(quantity);
        assert_eq!(found.count, 1);
        assert!((found.rms - rms).abs() < 1e-12, "{quantity:?} {}", found.rms);
        // A graph of two free poses and two factors has nothing that could contradict.
        let redundant = quantity == Quantity::PriorPosition;
        assert_eq!(found.redundant_count, usize::from(redundant), "{quantity:?}");
        if redundant {
            assert!((found.reduced_chi2 - reduced_chi2).abs() < 1e-12, "{quantity:?}");
        }
        assert_eq!(found.judgment(), SigmaJudgment::Unknown);
    }
    // Beside observations each of them can be contradicted.
    let camera = walk().cameras[0];
    problem.push_camera(camera, true);
    problem.push_landmark(Vector3::new(0.0, 0.0, 2.0));
    problem.reprojections.push(0, 0, 0, Vector2::new(300.0, 200.0), 1.0);
    let report = bundle_cost(&problem).residuals;
    for (quantity, _, reduced_chi2) in expected {
        let found = report.of(quantity).reduced_chi2;
        assert!((found - reduced_chi2).abs() < 1e-12, "{quantity:?} {found}");
    }
}

/// A grid of poses, each tied to its neighbors by a measurement with noise of `sigma`.
fn grid(side: usize, sigma: f64, stated: f64) -> PoseGraph<Se2, 3> {
    let mut rng = seeded(3);
    let mut graph = PoseGraph::default();
    let at = |x: usize, y: usize| Se2::exp(&SVector::from([x as f64, y as f64, 0.0]));
    for k in 0..side * side {
        graph.push_pose(k as i64, at(k % side, k / side));
    }
    let information = Information::from_sigmas(&SVector::from([stated; 3])).unwrap();
    for k in 0..side * side {
        let right = (k % side + 1 < side).then_some(k + 1);
        let down = (k / side + 1 < side).then_some(k + side);
        for j in [right, down].into_iter().flatten() {
            let true_motion = graph.poses[k].inverse().compose(&graph.poses[j]);
            let i_from_j = true_motion.plus(&normal_vector(&mut rng, sigma));
            graph.edges.push(RelativePose { i: k, j, i_from_j, information, loss: None });
        }
    }
    graph.constant[0] = true;
    graph
}

#[test]
fn a_graphs_sigmas_are_judged_where_loops_can_contradict_them() {
    let judge = |graph: &mut PoseGraph<Se2, 3>| {
        let options = covis_solvers::pose_graph::Options::default();
        covis_solvers::pose_graph::solve(graph, &options, &mut ignore_iterations).unwrap();
        let report = pose_graph_cost(graph).residuals;
        [Quantity::RelativeTranslation, Quantity::RelativeRotation]
            .map(|quantity| report.of(quantity).judgment())
    };
    assert_eq!(judge(&mut grid(12, 0.02, 0.02)), [SigmaJudgment::Plausible; 2]);
    assert_eq!(judge(&mut grid(12, 0.02, 0.004)), [SigmaJudgment::TooSmall; 2]);
    assert_eq!(judge(&mut grid(12, 0.004, 0.02)), [SigmaJudgment::TooLarge; 2]);
    let mut chain = grid(12, 0.02, 0.02);
    chain.edges.retain(|edge| edge.j == edge.i + 1 || edge.i % 12 == 0);
    assert_eq!(judge(&mut chain), [SigmaJudgment::Unknown; 2]);
}

#[test]
fn the_lengths_of_residuals_add_up_to_the_costs() {
    let problem = walk();
    let (lengths, report) = (ObservationLengths::of(&problem), bundle_cost(&problem));
    let rms = |all: &[f64]| (all.iter().map(|l| l * l).sum::<f64>() / all.len() as f64).sqrt();
    assert_eq!(lengths.pixels_px.len(), problem.observation_count());
    assert!((rms(&lengths.pixels_px) - report.rmse_px).abs() < 1e-12 * report.rmse_px);
    let depth = report.residuals.of(Quantity::Depth);
    assert_eq!(lengths.depths_m.len(), depth.count);
    assert!((rms(&lengths.depths_m) - depth.rms).abs() < 1e-12 * depth.rms);
    // Those of the poses, weighted by how many observations each has, are those of all.
    let by_pose = lengths.rmse_px_by_pose(problem.poses.len());
    let squares: f64 = lengths.poses.iter().map(|&pose| by_pose[pose as usize].powi(2)).sum();
    let all = (squares / lengths.poses.len() as f64).sqrt();
    assert!((all - report.rmse_px).abs() < 1e-12 * report.rmse_px);
    assert_eq!(lengths.rmse_px_by_pose(problem.poses.len() + 1).last(), Some(&0.0));

    let mut graph = PoseGraph::<Se2, 3>::default();
    for k in 0..3 {
        graph.push_pose(k, Se2::exp(&SVector::from([k as f64, 0.0, 0.0])));
    }
    for (i, j, measured) in [(0, 1, 1.5), (1, 2, 1.0)] {
        let i_from_j = Se2::exp(&SVector::from([measured, 0.0, 0.0]));
        let information = Information::identity();
        graph.edges.push(RelativePose { i, j, i_from_j, information, loss: None });
    }
    assert_eq!(
        edge_lengths(&graph).iter().map(|l| (l * 1e9).round()).collect::<Vec<_>>(),
        [5e8, 0.0]
    );
    assert!((pose_graph_cost(&graph).total - 0.125).abs() < 1e-12);
}
