//! Random graphs that grow: after each update beside batch solves from four starts.
//!
//! The graphs are hard on purpose: few poses, lengths from a millimeter to 100 km, noise of up to ten
//! standard deviations, information that differs by orders of magnitude between axes.

use covis_solvers::evaluation::{ReferencePose, pose_graph_cost};
use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::{RigidMotion, Se2, Se3};
use covis_solvers::information::Information;
use covis_solvers::initialization::{chordal, odometry};
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::pose_graph::{Options, solve};
use covis_solvers::price::Limits;
use covis_solvers::problem::PoseGraph;
use covis_solvers::testing::random::{element, normal_vector, seeded};
use nalgebra::SVector;
use rand::{Rng, RngExt};

use super::growing::feed;
use crate::io::data::data;

/// Costs below this are rounding.
const FLOOR: f64 = 1e-9;

/// How an edge of a random graph is measured.
#[derive(Clone, Copy)]
struct Recipe {
    scale: f64,
    /// Of the measurement, in standard deviations.
    noise: f64,
    is_stretched: bool,
}

impl Recipe {
    fn edge<G: RigidMotion<D, N>, const D: usize, const N: usize>(
        self,
        rng: &mut impl Rng,
        truth: &[G],
        (i, j): (usize, usize),
    ) -> RelativePose<G, N> {
        let shift = self.scale * 10_f64.powf(rng.random_range(-2.0..0.0));
        let turn = 10_f64.powf(rng.random_range(-3.0..-0.3));
        let sigmas = SVector::<f64, N>::from_fn(|row, _| {
            let sigma = if row < D { shift } else { turn };
            if self.is_stretched { sigma * 10_f64.powf(rng.random_range(-1.0..1.0)) } else { sigma }
        });
        let mut off = normal_vector::<N>(rng, self.noise).component_mul(&sigmas);
        off.iter_mut().skip(D).for_each(|angle| *angle = angle.clamp(-2.0, 2.0));
        let i_from_j = truth[i].inverse().compose(&truth[j]).plus(&off);
        let information = Information::from_sigmas(&sigmas).unwrap();
        RelativePose { i, j, i_from_j, information, loss: None }
    }
}

/// A walk of 3 to 30 poses with closures between any of them; the poses are far from the truth.
fn random<G: RigidMotion<D, N>, const D: usize, const N: usize>(seed: u64) -> PoseGraph<G, N> {
    let mut rng = seeded(seed);
    let count = rng.random_range(3..=30_usize);
    let scale = [1e-3, 1.0, 1.0, 1.0, 1e3, 1e5][rng.random_range(0..6_usize)];
    let noise = [0.3, 1.0, 3.0, 10.0][rng.random_range(0..4_usize)];
    let is_stretched = rng.random_range(0..2_usize) == 0;
    let turn = [0.1, 0.5, 1.5][rng.random_range(0..3_usize)];
    let recipe = Recipe { scale, noise, is_stretched };
    let mut truth = vec![G::identity()];
    for k in 1..count {
        let mut step = element::<G, N>(&mut rng, turn).log();
        step.iter_mut().take(D).for_each(|length| *length *= scale / turn);
        truth.push(truth[k - 1].compose(&G::exp(&step)));
    }
    let mut graph = PoseGraph::new();
    for k in 1..count {
        graph.edges.push(recipe.edge(&mut rng, &truth, (k - 1, k)));
    }
    for _ in 0..rng.random_range(1..=count) {
        let (i, j) = (rng.random_range(0..count), rng.random_range(0..count));
        if i != j {
            graph.edges.push(recipe.edge(&mut rng, &truth, (i, j)));
        }
    }
    for (id, pose) in truth.iter().enumerate() {
        graph.push_pose(id as i64, pose.plus(&normal_vector(&mut rng, 0.3)));
    }
    graph
}

fn optimum<G: RigidMotion<D, N> + ReferencePose<N>, const D: usize, const N: usize>(
    mut graph: PoseGraph<G, N>,
) -> f64 {
    let solved = solve(&mut graph, &Options::default(), &mut ignore_iterations);
    solved.map_or(f64::INFINITY, |_| pose_graph_cost(&graph).total)
}

/// The largest cost after any update over the optimum from the estimate, and over the lowest of the
/// optima from the estimate, the chordal start, the odometry and the file; the last of the latter.
fn excess<G: RigidMotion<D, N> + ReferencePose<N>, const D: usize, const N: usize>(
    graph: &PoseGraph<G, N>,
) -> [f64; 3] {
    let [mut own, mut any, mut last] = [1.0_f64; 3];
    feed(graph, |growing, _| {
        let estimate = growing.graph();
        let cost = pose_graph_cost(estimate).total;
        let [mut relaxed, mut walked, mut given] = [(); 3].map(|()| estimate.clone());
        // A start that cannot be made leaves the estimate.
        let _chordal = chordal(&mut relaxed, Limits::NONE);
        let _odometry = odometry(&mut walked);
        for (id, pose) in given.ids.iter().zip(&mut given.poses).skip(1) {
            *pose = graph.poses[graph.ids.iter().position(|other| other == id).unwrap()];
        }
        let from_estimate = optimum(estimate.clone());
        let least = [relaxed, walked, given].map(optimum).into_iter().fold(from_estimate, f64::min);
        own = own.max((cost + FLOOR) / (from_estimate + FLOOR));
        last = (cost + FLOOR) / (least + FLOOR);
        any = any.max(last);
    });
    [own, any, last]
}

#[test]
fn three_poses_whose_best_angle_is_far_from_the_measured_one_reach_the_optimum() {
    let Some(path) = data("cases/growing_3_poses.g2o") else { return };
    let G2oGraph::Se2(file) = G2oGraph::read(&path).unwrap() else {
        panic!("not a graph in the plane")
    };
    let graph = file.to_pose_graph().unwrap();
    let growing = feed(&graph, |_, _| {});
    let cost = pose_graph_cost(growing.graph()).total;
    assert!((cost / 0.048_382_234_5 - 1.0).abs() < 1e-3, "{cost}");
}

#[test]
fn random_graphs_are_near_a_minimum_after_each_update_and_nearly_always_near_the_lowest() {
    let [mut owns, mut others, mut ends] = [0; 3];
    for seed in 0..200 {
        let [own, any, last] = match seed % 2 {
            0 => excess(&random::<Se2, 2, 3>(seed)),
            _ => excess(&random::<Se3, 3, 6>(seed)),
        };
        assert!(own <= 1.05, "seed {seed}: {own} times the optimum from the estimate");
        owns += usize::from(own > 1.01);
        others += usize::from(any > 1.01);
        ends += usize::from(last > 1.01);
    }
    println!("beyond 1.01: {owns} of 200 of the own minimum, {others} of the lowest, {ends} last");
    assert!(owns <= 4 && others <= 12 && ends <= 4, "{owns} {others} {ends}");
}
