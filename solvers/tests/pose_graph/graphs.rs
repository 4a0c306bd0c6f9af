//! Synthetic pose graphs with known truth: a winding chain with loop closures.

use covis_solvers::factors::RelativePose;
use covis_solvers::geometry::LieGroup;
use covis_solvers::information::Information;
use covis_solvers::optimizer::{SolveSummary, ignore_iterations};
use covis_solvers::pose_graph::{Options, solve};
use covis_solvers::problem::PoseGraph;
use covis_solvers::testing::random::{element, normal_vector, seeded};
use nalgebra::{SMatrix, SVector};
use rand_chacha::ChaCha8Rng;

/// What a graph is made of.
#[derive(Clone, Copy)]
pub(crate) struct Recipe {
    pub(crate) seed: u64,
    pub(crate) poses: usize,
    /// Standard deviation of every entry of a measurement's error.
    pub(crate) measurement_sigma: f64,
    /// Standard deviation of every entry of the start's error.
    pub(crate) start_sigma: f64,
}

/// A full, well-conditioned information matrix.
pub(crate) fn information<const N: usize>(rng: &mut ChaCha8Rng) -> Information<N> {
    let mut a = SMatrix::<f64, N, N>::zeros();
    for column in 0..N {
        a.set_column(column, &normal_vector(rng, 1.0));
    }
    Information::new(&(a * a.transpose() + SMatrix::identity())).unwrap()
}

/// The edge that truth and noise give between two poses.
pub(crate) fn edge<G: LieGroup<N>, const N: usize>(
    rng: &mut ChaCha8Rng,
    truth: &[G],
    (i, j): (usize, usize),
    sigma: f64,
) -> RelativePose<G, N> {
    let i_from_j = truth[i].inverse().compose(&truth[j]).plus(&normal_vector(rng, sigma));
    RelativePose { i, j, i_from_j, information: information(rng), loss: None }
}

/// A graph with ids 10, 13, 16, …, its first pose constant at the truth, and the truth.
pub(crate) fn make<G: LieGroup<N>, const N: usize>(recipe: Recipe) -> (PoseGraph<G, N>, Vec<G>) {
    let mut rng = seeded(recipe.seed);
    let mut truth: Vec<G> = vec![element(&mut rng, 0.5)];
    let step = SVector::<f64, N>::from_fn(|k, _| if k == 0 { 1.0 } else { 0.0 });
    while truth.len() < recipe.poses {
        let last = truth[truth.len() - 1];
        truth.push(last.plus(&(step + normal_vector(&mut rng, 0.15))));
    }
    let mut graph = PoseGraph::new();
    for (k, pose) in truth.iter().enumerate() {
        let sigma = if k == 0 { 0.0 } else { recipe.start_sigma };
        graph.push_pose(10 + 3 * k as i64, pose.plus(&normal_vector(&mut rng, sigma)));
    }
    graph.constant[0] = true;
    let sigma = recipe.measurement_sigma;
    for k in 1..truth.len() {
        graph.edges.push(edge(&mut rng, &truth, (k - 1, k), sigma));
        if k % 3 == 0 {
            graph.edges.push(edge(&mut rng, &truth, (k, k / 2), sigma));
        }
        if k % 4 == 0 && k >= 7 {
            graph.edges.push(edge(&mut rng, &truth, (k - 7, k), sigma));
        }
    }
    (graph, truth)
}

/// Solves with default options but tolerances tight enough to compare optima.
pub(crate) fn optimize<G: LieGroup<N>, const N: usize>(
    graph: &mut PoseGraph<G, N>,
) -> SolveSummary {
    solve(graph, &tight(), &mut ignore_iterations).unwrap()
}

/// Default options with a cost tolerance of 1e-13.
pub(crate) fn tight() -> Options {
    let mut options = Options::default();
    options.optimizer.cost_tolerance = 1e-13;
    options
}

/// The largest ‖a ⊟ b‖ over two lists of poses.
pub(crate) fn distance<G: LieGroup<N>, const N: usize>(a: &[G], b: &[G]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a.minus(b).norm()).fold(0.0, f64::max)
}
