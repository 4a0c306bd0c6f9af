//! The chordal start of graphs with landmarks: exact on exact measurements where only landmarks close a
//! loop or tie two pieces together, and next to the optimum on Victoria Park.

use covis_solvers::evaluation::pose_graph_cost;
use covis_solvers::factors::{LandmarkMeasurement, RelativePose, Sighting};
use covis_solvers::geometry::{LieGroup, RigidMotion, Se2, Se3};
use covis_solvers::information::{Covariance, Information};
use covis_solvers::initialization::{Start, initialize};
use covis_solvers::price::Limits;
use covis_solvers::problem::{PoseGraph, SolveError};
use covis_solvers::testing::random::{seeded, uniform_vector};
use nalgebra::{Matrix3, Vector3};

use super::graphs::{Recipe, distance, make, optimize};
use crate::io::data::data;

const RECIPE: Recipe = Recipe { seed: 12, poses: 40, measurement_sigma: 0.0, start_sigma: 5.0 };

/// Two chains of poses, of which `landmarks` seen by both are all that ties them together; the truth.
fn two_chains<G: RigidMotion<D, N>, const D: usize, const N: usize>(
    landmarks: usize,
) -> (PoseGraph<G, N>, Vec<G>) {
    let (mut graph, truth) = make::<G, N>(RECIPE);
    graph.edges.retain(|edge| (edge.i < 20) == (edge.j < 20));
    let mut rng = seeded(5);
    for id in 0..landmarks {
        let mut position: Vector3<f64> = uniform_vector(&mut rng, 5.0);
        (D..3).for_each(|axis| position[axis] = 0.0);
        let landmark = graph.landmarks.push(1000 + id as i64, Vector3::zeros());
        for pose in [3 + id, 9, 21 + id, 30] {
            let sighting = Sighting::Position(truth[pose].inverse().act(&position));
            let (pose, information, loss) = (Some(pose), Information::identity(), None);
            let measurement = LandmarkMeasurement { pose, landmark, sighting, information, loss };
            graph.landmarks.measurements.push(measurement);
        }
    }
    (graph, truth)
}

fn starts_at_the_truth<G: RigidMotion<D, N>, const D: usize, const N: usize>() {
    let (mut graph, truth) = two_chains::<G, D, N>(D + 1);
    initialize(&mut graph, Start::Chordal, false, Limits::NONE).unwrap();
    assert!(distance(&graph.poses, &truth) < 1e-8, "{}", distance(&graph.poses, &truth));
    let cost = graph.landmarks.cost(&graph.poses, graph.loss);
    assert!(cost < 1e-12, "{cost}");
}

#[test]
fn landmarks_tie_pieces_together_that_no_edge_does() {
    starts_at_the_truth::<Se2, 2, 3>();
    starts_at_the_truth::<Se3, 3, 6>();
}

#[test]
fn too_few_landmarks_leave_a_rotation_open_and_the_graph_as_it_is() {
    let (mut graph, _) = two_chains::<Se3, 3, 6>(2);
    let before = graph.clone();
    let error = initialize(&mut graph, Start::Chordal, false, Limits::NONE).unwrap_err();
    assert!(matches!(error, SolveError::Singular { .. }), "{error}");
    assert_eq!(graph, before);
    let start = initialize(&mut graph, Start::Auto, true, Limits::NONE).unwrap();
    assert_eq!((start, graph), (Start::Given, before));
}

#[test]
fn the_start_of_what_may_move_does_not_matter() {
    let (mut graph, _) = two_chains::<Se3, 3, 6>(6);
    let mut other = graph.clone();
    other.poses[1..].fill(Se3::identity());
    other.landmarks.positions.fill(Vector3::new(1e3, -1e3, 7.0));
    initialize(&mut graph, Start::Chordal, true, Limits::NONE).unwrap();
    initialize(&mut other, Start::Chordal, true, Limits::NONE).unwrap();
    assert_eq!(graph.poses, other.poses);
    assert!(distance_of(&graph, &other) < 1e-9);
}

fn distance_of(graph: &PoseGraph<Se3, 6>, other: &PoseGraph<Se3, 6>) -> f64 {
    let pairs = graph.landmarks.positions.iter().zip(&other.landmarks.positions);
    pairs.map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

/// Victoria Park as the file of iSAM has it, with poses that chain the odometry and landmarks at the origin.
fn victoria_park(text: &str) -> PoseGraph<Se2, 3> {
    let mut graph = PoseGraph::<Se2, 3>::new();
    graph.push_pose(0, Se2::identity());
    let mut rows_of = std::collections::BTreeMap::from([(0, 0)]);
    let mut landmarks = std::collections::BTreeMap::new();
    for line in text.lines() {
        let (tag, rest) = line.split_once(' ').unwrap();
        let n: Vec<f64> = rest.split_whitespace().map(|word| word.parse().unwrap()).collect();
        let i = rows_of[&(n[0] as i64)];
        let id = n[1] as i64;
        if tag == "ODOMETRY" {
            let i_from_j = Se2::from_xy_angle(n[2], n[3], n[4]);
            let j = *rows_of.entry(id).or_insert_with(|| {
                let pose = graph.poses[i].compose(&i_from_j);
                graph.push_pose(id, pose);
                graph.poses.len() - 1
            });
            let matrix = Matrix3::new(n[5], n[6], n[7], n[6], n[8], n[9], n[7], n[9], n[10]);
            let information = Covariance::new(&matrix).unwrap().information().unwrap();
            graph.edges.push(RelativePose { i, j, i_from_j, information, loss: None });
        } else {
            let landmark =
                *landmarks.entry(id).or_insert_with(|| graph.landmarks.push(id, Vector3::zeros()));
            let determinant = n[4] * n[6] - n[5] * n[5];
            let (xx, xy, yy) = (n[6] / determinant, -n[5] / determinant, n[4] / determinant);
            let matrix = Matrix3::new(xx, xy, 0.0, xy, yy, 0.0, 0.0, 0.0, 0.0);
            graph.landmarks.measurements.push(LandmarkMeasurement {
                pose: Some(i),
                landmark,
                sighting: Sighting::Position(Vector3::new(n[2], n[3], 0.0)),
                information: Information::semidefinite(&matrix).unwrap(),
                loss: None,
            });
        }
    }
    graph
}

/// From chained odometry the whole graph ends above 400,000 after a hundred iterations. The lowest cost that
/// is known comes from growing the graph.
#[test]
fn victoria_park_is_solved_at_once() {
    let Some(path) = data("range/victoria_park.txt") else { return };
    let mut graph = victoria_park(&std::fs::read_to_string(path).unwrap());
    assert_eq!((graph.poses.len(), graph.landmarks.len()), (6969, 151));
    graph.fix_lowest_id();
    let start = initialize(&mut graph, Start::Auto, true, Limits::NONE).unwrap();
    assert_eq!(start, Start::Chordal);
    let summary = optimize(&mut graph);
    let cost = pose_graph_cost(&graph).total;
    assert!((cost / 3092.0610988 - 1.0).abs() < 1e-8, "{cost}");
    assert!(summary.iterations.len() <= 8, "{}", summary.iterations.len());
}
