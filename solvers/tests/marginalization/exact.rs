//! Small pose graphs, whose marginals are known in closed form or from a dense inverse.

use covis_solvers::bundle_adjustment::{Options, solve};
use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::information::Information;
use covis_solvers::marginalization::marginalize_pose;
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::problem::BundleProblem;
use covis_solvers::testing::random::{element, perturbed, seeded};
use nalgebra::{Matrix6, SMatrix, SVector};

use super::{
    assert_close, dense_delta, is_forest, pose_prior, position_prior, random_information,
    relative_covariance, relative_pose, row_of,
};

fn poses(count: usize, rng: &mut impl rand::Rng) -> BundleProblem {
    let mut problem = BundleProblem::default();
    (0..count).for_each(|_| {
        problem.push_pose(element(rng, 1.0));
    });
    problem
}

#[test]
fn the_middle_of_a_chain_leaves_the_composed_measurement() {
    for seed in 0..20 {
        let mut rng = seeded(seed);
        let mut problem = poses(3, &mut rng);
        let first = relative_pose(&problem, (0, 1), &mut rng);
        let second = relative_pose(&problem, (1, 2), &mut rng);
        // The same measurement seen from the other end: e₂₁ = −Ad(Z) e₁₂.
        let turn = second.i_from_j.inverse().adjoint();
        let information = turn.transpose() * second.information.matrix() * turn;
        let reversed = RelativePose {
            i: 2,
            j: 1,
            i_from_j: second.i_from_j.inverse(),
            information: Information::nearest(&((information + information.transpose()) * 0.5))
                .unwrap(),
            loss: None,
        };
        let covariance = |f: &RelativePose<Se3, 6>| *f.information.covariance().unwrap().matrix();
        let adjoint = second.i_from_j.inverse().adjoint();
        let composed = adjoint * covariance(&first) * adjoint.transpose() + covariance(&second);
        let expected = composed.try_inverse().unwrap();
        for second in [second, reversed] {
            problem.relative_poses = vec![first, second];
            let marginal = marginalize_pose(&problem, 1).unwrap();
            assert!(marginal.pose_priors.is_empty());
            let [edge] = marginal.relative_poses[..] else { panic!("{marginal:?}") };
            assert_eq!((edge.i, edge.j), (0, 2));
            let measured = problem.poses[0].inverse().compose(&problem.poses[2]);
            assert!(edge.i_from_j.minus(&measured).amax() < 1e-12);
            assert_close(edge.information.matrix(), &expected, 1e-9, "chain");
        }
    }
}

#[test]
fn a_star_leaves_the_relative_covariances_of_the_dense_marginal() {
    for (seed, count) in [(1, 3), (2, 4), (3, 7), (4, 12)] {
        let mut rng = seeded(seed);
        let mut problem = poses(count, &mut rng);
        let removed = count / 2;
        for pose in (0..count).filter(|&pose| pose != removed) {
            let factor = relative_pose(&problem, (removed, pose), &mut rng);
            problem.relative_poses.push(factor);
        }
        // What stays does not matter.
        let unrelated = relative_pose(&problem, (0, count - 1), &mut rng);
        problem.relative_poses.push(unrelated);
        let marginal = marginalize_pose(&problem, removed).unwrap();
        assert!(marginal.pose_priors.is_empty());
        assert_eq!(marginal.relative_poses.len(), count - 2);
        assert!(is_forest(marginal.relative_poses.iter().map(|f| (f.i, f.j)), count));
        let delta = dense_delta(&problem, removed);
        for edge in &marginal.relative_poses {
            let (i, j) = (row_of(edge.i, removed), row_of(edge.j, removed));
            let expected = relative_covariance(&delta, i, j).try_inverse().unwrap();
            assert_close(edge.information.matrix(), &expected, 1e-9, "star");
        }
    }
}

#[test]
fn the_tree_loses_least() {
    // Exhaustively over the trees of four neighbors: Σ log det Ω is the greatest.
    let mut rng = seeded(5);
    let mut problem = poses(5, &mut rng);
    for pose in 1..5 {
        let factor = relative_pose(&problem, (0, pose), &mut rng);
        problem.relative_poses.push(factor);
    }
    let delta = dense_delta(&problem, 0);
    let gain = |i: usize, j: usize| {
        -relative_covariance(&delta, row_of(i, 0), row_of(j, 0)).determinant().ln()
    };
    let pairs: Vec<(usize, usize)> = (1..5).flat_map(|i| (i + 1..5).map(move |j| (i, j))).collect();
    let mut best = f64::NEG_INFINITY;
    for choice in 0_u32..64 {
        let edges = || pairs.iter().enumerate().filter(|(k, _)| choice >> k & 1 == 1);
        if choice.count_ones() == 3 && is_forest(edges().map(|(_, &edge)| edge), 5) {
            best = best.max(edges().map(|(_, &(i, j))| gain(i, j)).sum());
        }
    }
    let marginal = marginalize_pose(&problem, 0).unwrap();
    let chosen: f64 = marginal.relative_poses.iter().map(|f| gain(f.i, f.j)).sum();
    assert!((chosen - best).abs() < 1e-6, "{chosen} {best}");
}

#[test]
fn a_pose_prior_stays_as_a_pose_prior() {
    for seed in 0..10 {
        let mut rng = seeded(seed);
        let mut problem = poses(4, &mut rng);
        for pair in [(0, 2), (2, 1), (2, 3)] {
            let factor = relative_pose(&problem, pair, &mut rng);
            problem.relative_poses.push(factor);
        }
        problem.pose_priors = vec![pose_prior(&problem, 2, &mut rng)];
        problem.position_priors = vec![position_prior(&problem, 2, &mut rng)];
        let marginal = marginalize_pose(&problem, 2).unwrap();
        // A tree over the world and three poses.
        assert_eq!(marginal.relative_poses.len() + marginal.pose_priors.len(), 3);
        assert!(!marginal.pose_priors.is_empty());
        let covariance = dense_delta(&problem, 2).cholesky().unwrap().inverse();
        let block = |i: usize, j: usize| {
            covariance.fixed_view::<6, 6>(row_of(i, 2), row_of(j, 2)).into_owned()
        };
        for prior in &marginal.pose_priors {
            let expected = block(prior.pose, prior.pose).try_inverse().unwrap();
            assert_close(prior.information.matrix(), &expected, 1e-9, "prior");
        }
        for edge in &marginal.relative_poses {
            let (i, j) = (edge.i, edge.j);
            let adjoint = edge.i_from_j.inverse().adjoint();
            let cross = adjoint * block(i, j);
            let expected = block(j, j) - cross - cross.transpose()
                + adjoint * block(i, i) * adjoint.transpose();
            let expected = expected.try_inverse().unwrap();
            assert_close(edge.information.matrix(), &expected, 1e-8, "edge beside a prior");
        }
        // The neighbors come back to where they were, with nothing else to hold them.
        let mut rest = BundleProblem { poses: problem.poses.clone(), ..Default::default() };
        rest.constant_poses = vec![false; 4];
        rest.relative_poses = marginal.relative_poses;
        rest.pose_priors = marginal.pose_priors;
        let sigmas = SVector::repeat(0.02);
        for pose in [0, 1, 3] {
            rest.poses[pose] = perturbed(&mut rng, &problem.poses[pose], &sigmas);
        }
        if rest.relative_poses.is_empty() {
            continue;
        }
        solve(&mut rest, &Options::default(), &mut ignore_iterations).unwrap();
        for (pose, known) in rest.poses.iter().zip(&problem.poses) {
            assert!(pose.minus(known).amax() < 1e-5, "{}", pose.minus(known));
        }
    }
}

#[test]
fn a_position_prior_stays_as_what_it_says_of_the_neighbor() {
    let mut rng = seeded(11);
    let mut problem = poses(2, &mut rng);
    // As a receiver beside a rover: the removed pose's position is known, its rotation is not.
    problem.relative_poses = vec![relative_pose(&problem, (0, 1), &mut rng)];
    problem.position_priors = vec![position_prior(&problem, 1, &mut rng)];
    let marginal = marginalize_pose(&problem, 1).unwrap();
    assert!(marginal.relative_poses.is_empty());
    let [prior] = marginal.pose_priors[..] else { panic!("{marginal:?}") };
    assert_eq!((prior.pose, prior.world_from_camera), (0, problem.poses[0]));
    // t₁ = t₀ + R₀ t₀₁ has the covariance of the prior plus that of the motion.
    let motion = &problem.relative_poses[0];
    let mut by_motion = SMatrix::<f64, 3, 6>::zeros();
    by_motion.fixed_columns_mut::<3>(0).copy_from(&problem.poses[1].rotation.matrix());
    let by_pose = by_motion * problem.poses[1].inverse().compose(&problem.poses[0]).adjoint();
    let covariance = problem.position_priors[0].information.covariance().unwrap();
    let sum = covariance.matrix()
        + by_motion * motion.information.covariance().unwrap().matrix() * by_motion.transpose();
    let expected = by_pose.transpose() * sum.try_inverse().unwrap() * by_pose;
    assert_close(prior.information.matrix(), &expected, 1e-9, "position prior");
    // Three directions are known; about the others next to nothing is claimed.
    let mut values: Vec<f64> =
        prior.information.matrix().symmetric_eigenvalues().iter().copied().collect();
    values.sort_by(f64::total_cmp);
    assert!(values[0] > 0.0 && values[2] < 1e-9 * values[5] && values[3] > 1e-4 * values[5]);
}

#[test]
fn a_motion_known_in_some_directions_claims_nothing_of_the_others() {
    let mut rng = seeded(12);
    let mut problem = poses(3, &mut rng);
    let mut first = relative_pose(&problem, (0, 1), &mut rng);
    let second = relative_pose(&problem, (1, 2), &mut rng);
    // Translation only.
    let mut matrix = Matrix6::zeros();
    matrix.fixed_view_mut::<3, 3>(0, 0).copy_from(random_information::<3>(&mut rng).matrix());
    first.information = Information::semidefinite(&matrix).unwrap();
    problem.relative_poses = vec![first, second];
    let marginal = marginalize_pose(&problem, 1).unwrap();
    let [edge] = marginal.relative_poses[..] else { panic!("{marginal:?}") };
    let mut values: Vec<f64> =
        edge.information.matrix().symmetric_eigenvalues().iter().copied().collect();
    values.sort_by(f64::total_cmp);
    assert!(values[0] > 0.0 && values[2] < 1e-8 * values[5] && values[3] > 1e-4 * values[5]);
}
