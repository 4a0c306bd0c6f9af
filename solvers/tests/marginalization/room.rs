//! A synthetic room: what the recovered factors are worth to the map that stays.

use covis_solvers::bundle_adjustment::{Options, solve};
use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::loss::Loss;
use covis_solvers::marginalization::{Marginal, marginalize_pose};
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::problem::BundleProblem;
use covis_solvers::testing::random::{perturbed, seeded};
use covis_solvers::testing::scene::{Scene, SceneOptions};
use nalgebra::{DMatrix, SVector};

use super::{assert_close, dense_delta, row_of, schur};

/// The room solved.
fn solved(keyframes: usize, laps: f64, landmarks: usize, seed: u64) -> BundleProblem {
    let options = SceneOptions { keyframes, laps, landmarks, seed, ..Default::default() };
    let mut problem = Scene::generate(&options).to_problem();
    problem.observation_loss = Loss::Huber(2.0);
    solve(&mut problem, &Options::default(), &mut ignore_iterations).unwrap();
    problem
}

#[test]
fn edges_say_what_the_dense_marginal_says() {
    let problem = solved(8, 0.2, 500, 1);
    for removed in [0, 3, 7] {
        let delta = dense_delta(&problem, removed);
        let eigenvalues = delta.symmetric_eigenvalues();
        assert!(eigenvalues.min() > -1e-9 * eigenvalues.max(), "{eigenvalues}");
        let marginal = marginalize_pose(&problem, removed).unwrap();
        assert!(marginal.pose_priors.is_empty());
        // As many edges as Δ needs.
        let rank = eigenvalues.iter().filter(|&&v| v > 1e-6 * eigenvalues.max()).count();
        assert!(rank > 0 && 6 * marginal.relative_poses.len() >= rank, "{removed}: {rank}");
        assert_edges(&marginal, &delta, removed);
    }
}

/// Each edge has the information that the definition gives, all other poses eliminated at once.
fn assert_edges(marginal: &Marginal, delta: &DMatrix<f64>, removed: usize) {
    for edge in &marginal.relative_poses {
        let rows = |pose: usize| (0..6).map(move |k| row_of(pose, removed) + k);
        let kept: Vec<usize> = rows(edge.i).chain(rows(edge.j)).collect();
        let gone: Vec<usize> = (0..delta.nrows()).filter(|k| !kept.contains(k)).collect();
        let pair = schur(delta, &kept, &gone);
        let expected = pair.fixed_view::<6, 6>(6, 6).into_owned();
        assert_close(edge.information.matrix(), &expected, 1e-6, "room");
    }
}

#[test]
fn landmarks_without_depth_leave_edges_too() {
    let mut problem = solved(8, 0.2, 120, 2);
    let depth = std::mem::take(&mut problem.depth_reprojections);
    for k in 0..depth.len() {
        let (pose, camera) = (depth.poses[k], depth.cameras[k]);
        let (pixel, sigma_px) = (depth.pixels[k], depth.sigmas_px[k]);
        problem.reprojections.push(pose, camera, depth.landmarks[k], pixel, sigma_px);
    }
    let marginal = marginalize_pose(&problem, 4).unwrap();
    assert_eq!(marginal.relative_poses.len(), problem.poses.len() - 2);
    assert_edges(&marginal, &dense_delta(&problem, 4), 4);
}

/// How far the poses but `removed` are from `known`: √ Σ ‖Log‖².
fn distance(problem: &BundleProblem, known: &[Se3], removed: usize) -> f64 {
    let pairs = problem.poses.iter().zip(known).enumerate().filter(|(k, _)| *k != removed);
    pairs.map(|(_, (pose, known))| pose.minus(known).norm_squared()).sum::<f64>().sqrt()
}

/// How far the keyframes that stay end from the full solution, perturbed and solved again: with what
/// is recovered of the removed one, and without.
fn distances(full: &BundleProblem, removed: usize, seed: u64) -> (f64, f64) {
    let marginal = marginalize_pose(full, removed).unwrap();
    let mut without = full.clone();
    let poses = without.depth_reprojections.poses.clone();
    without.depth_reprojections.retain(|k| poses[k] as usize != removed);
    let mut rng = seeded(seed);
    let sigmas = SVector::from([0.02, 0.02, 0.02, 0.01, 0.01, 0.01]);
    for pose in without.poses.iter_mut().skip(1) {
        *pose = perturbed(&mut rng, pose, &sigmas);
    }
    let mut with = without.clone();
    with.relative_poses.extend(marginal.relative_poses);
    for problem in [&mut with, &mut without] {
        solve(problem, &Options::default(), &mut ignore_iterations).unwrap();
    }
    (distance(&with, &full.poses, removed), distance(&without, &full.poses, removed))
}

#[test]
fn the_map_that_stays_remembers_what_the_removed_keyframe_measured() {
    for seed in 1..=4 {
        // Every landmark has many views: little is lost, and still less with the edges.
        let (with, without) = distances(&solved(12, 0.2, 600, seed), 5, seed);
        println!("dense, seed {seed}: {with:.2e} with, {without:.2e} without");
        assert!(with < without, "seed {seed}: {with} with, {without} without");
        // The removed keyframe was what tied its neighbors together.
        let (with, without) = distances(&solved(6, 0.5, 600, seed), 3, seed);
        println!("bridge, seed {seed}: {with:.2e} with, {without:.2e} without");
        assert!(with < 0.5 * without, "seed {seed}: {with} with, {without} without");
    }
}
