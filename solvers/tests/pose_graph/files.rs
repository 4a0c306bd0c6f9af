//! Known optima of public graphs (first vertex fixed), where `../shared/data` is present.
//!
//! The costs are those that Ceres and GTSAM agree on; each is checked by the independent evaluator.

use covis_solvers::evaluation::{ReferencePose, pose_graph_cost};
use covis_solvers::geometry::LieGroup;
use covis_solvers::initialization::spanning_tree;
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::optimizer::{Method, SolveSummary, ignore_iterations};
use covis_solvers::pose_graph::{Options, solve};
use covis_solvers::problem::PoseGraph;

use crate::io::data::data;

const OPTIMA: [(&str, f64); 7] = [
    ("sphere2500", 675.7009629),
    ("parking-garage", 0.6341923996),
    ("M3500", 68.95743912),
    ("city10000", 255.9937253),
    ("intel", 22.50211654),
    ("kitti_00", 49.16106911),
    ("CSAIL", 20.27544167),
];

fn run<G: LieGroup<N> + ReferencePose<N>, const N: usize>(
    mut graph: PoseGraph<G, N>,
    has_vertices: bool,
    options: &Options,
) -> SolveSummary {
    if !has_vertices {
        spanning_tree(&mut graph).unwrap();
    }
    let start = pose_graph_cost(&graph).total;
    let summary = solve(&mut graph, options, &mut ignore_iterations).unwrap();
    let end = pose_graph_cost(&graph).total;
    assert!((summary.initial_cost / start - 1.0).abs() < 1e-9);
    assert!((summary.final_cost / end - 1.0).abs() < 1e-9);
    summary
}

/// `None` where the data is absent.
fn solve_file(name: &str, options: &Options) -> Option<SolveSummary> {
    let graph = G2oGraph::read(&data(&format!("pose_graph/{name}.g2o"))?).unwrap();
    let has_vertices = graph.has_vertices();
    Some(match graph {
        G2oGraph::Se2(file) => run(file.to_pose_graph().unwrap(), has_vertices, options),
        G2oGraph::Se3(file) => run(file.to_pose_graph().unwrap(), has_vertices, options),
    })
}

#[test]
fn levenberg_marquardt_reaches_the_known_optima() {
    for (name, expected) in OPTIMA {
        let Some(summary) = solve_file(name, &Options::default()) else { return };
        assert!(summary.termination.is_converged(), "{name}: {}", summary.termination);
        assert!(summary.iterations.len() <= 21, "{name}: {}", summary.iterations.len());
        let ratio = summary.final_cost / expected;
        assert!((ratio - 1.0).abs() < 1e-6, "{name}: {:.10e}", summary.final_cost);
    }
}

#[test]
fn gauss_newton_reaches_the_same_optima() {
    let mut options = Options::default();
    options.optimizer.method = Method::GaussNewton;
    for (name, expected) in OPTIMA {
        let Some(summary) = solve_file(name, &options) else { return };
        let ratio = summary.final_cost / expected;
        assert!((ratio - 1.0).abs() < 1e-6, "{name}: {:.10e}", summary.final_cost);
    }
}

#[test]
fn small_grids_converge_alike_with_much_and_little_damping() {
    for name in ["tinyGrid3D", "smallGrid3D"] {
        let costs: Option<Vec<f64>> = [1e-10, 1e-6, 1e-3]
            .into_iter()
            .map(|damping| {
                let mut options = Options::default();
                options.optimizer.initial_damping = damping;
                let summary = solve_file(name, &options)?;
                assert!(summary.termination.is_converged());
                Some(summary.final_cost)
            })
            .collect();
        let Some(costs) = costs else { return };
        assert!(costs.iter().all(|cost| (cost / costs[0] - 1.0).abs() < 1e-6), "{name} {costs:?}");
    }
}
