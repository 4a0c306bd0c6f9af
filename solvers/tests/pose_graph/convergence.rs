//! What "converged" promises: another solve from there finds next to nothing to gain.
//!
//! Graphs with long levers have soft directions, along which damped steps are short and say little.

use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{LieGroup, Se2, Se3};
use covis_solvers::information::Information;
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::optimizer::{SolveSummary, Termination, ignore_iterations};
use covis_solvers::pose_graph::{Options, solve};
use covis_solvers::problem::PoseGraph;
use covis_solvers::testing::random::{element, normal_vector, seeded};
use nalgebra::SVector;
use rand::RngExt;

use crate::io::data::data;

fn optimize<G: LieGroup<N>, const N: usize>(graph: &mut PoseGraph<G, N>) -> SolveSummary {
    solve(graph, &Options::default(), &mut ignore_iterations).unwrap()
}

/// Solves twice. If the first solve claims a minimum, the second gains less than this share.
fn check<G: LieGroup<N>, const N: usize>(graph: &mut PoseGraph<G, N>, what: &str) -> Termination {
    let first = optimize(graph);
    let second = optimize(graph);
    if first.termination.is_converged() {
        let gained = first.final_cost - second.final_cost;
        let share = gained / first.final_cost.max(1e-3);
        assert!(share < 1e-7, "{what}: {first:?} and then {}", second.final_cost);
    }
    first.termination
}

#[test]
fn a_converged_solve_of_long_levers_does_not_go_on_falling() {
    let Some(path) = data("cases/long_levers.g2o") else { return };
    let G2oGraph::Se3(file) = G2oGraph::read(&path).unwrap() else {
        panic!("not a graph in space")
    };
    let mut graph = file.to_pose_graph().unwrap();
    check(&mut graph, "long levers");
    // It had claimed 301,677,630; the optimum is 301,543,312.
    let mut graph = file.to_pose_graph().unwrap();
    let summary = optimize(&mut graph);
    assert!(summary.final_cost < 301_550_000.0, "{}", summary.final_cost);
}

/// Poses up to `lever` apart, with measurements that contradict each other by far.
fn levers<G: LieGroup<N>, const N: usize>(seed: u64, translations: usize) -> PoseGraph<G, N> {
    let mut rng = seeded(seed);
    let count = rng.random_range(3..=20_usize);
    let lever = 10_f64.powf(rng.random_range(0.0..6.0));
    let sigma = 10_f64.powf(rng.random_range(-3.0..0.0));
    let noise = 10_f64.powf(rng.random_range(-4.0..0.0));
    let stretched = |mut tangent: SVector<f64, N>| {
        tangent.rows_mut(0, translations).scale_mut(lever);
        tangent
    };
    let poses = (0..count).map(|_| G::exp(&stretched(element::<G, N>(&mut rng, 1.0).log())));
    let truth: Vec<G> = poses.collect();
    let mut graph = PoseGraph::new();
    for (id, pose) in truth.iter().enumerate() {
        graph.push_pose(id as i64, pose.plus(&stretched(normal_vector(&mut rng, 0.2))));
    }
    let information = Information::from_sigmas(&SVector::repeat(sigma)).unwrap();
    let extra = rng.random_range(1..=count);
    for k in 1..count + extra {
        let (i, j) = match k < count {
            true => (rng.random_range(0..k), k),
            false => (rng.random_range(0..count), rng.random_range(0..count)),
        };
        if i != j {
            let off = stretched(normal_vector(&mut rng, noise));
            let i_from_j = truth[i].inverse().compose(&truth[j]).plus(&off);
            graph.edges.push(RelativePose { i, j, i_from_j, information, loss: None });
        }
    }
    graph.fix_lowest_id();
    graph
}

#[test]
fn converged_graphs_of_random_levers_are_at_a_minimum() {
    let mut converged = 0;
    for seed in 0..400 {
        let what = format!("seed {seed}");
        let termination = match seed % 2 {
            0 => check(&mut levers::<Se2, 3>(seed, 2), &what),
            _ => check(&mut levers::<Se3, 6>(seed, 3), &what),
        };
        converged += usize::from(termination.is_converged());
    }
    assert!(converged > 200, "{converged} of 400 converge");
}
