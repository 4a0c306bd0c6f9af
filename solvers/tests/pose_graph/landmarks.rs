//! Landmarks in pose graphs: Jacobians, files against GTSAM's records, gauge, starts, refusals.

use std::path::Path;

use covis_solvers::evaluation::{Quantity, pose_graph_cost};
use covis_solvers::factors::{LandmarkMeasurement, PosePrior, Range, RangeEnd, Sighting};
use covis_solvers::geometry::{LieGroup, Se2, Se3};
use covis_solvers::graph_optimization::{self, Judging};
use covis_solvers::information::Information;
use covis_solvers::initialization::{Start, align_to_priors, initialize};
use covis_solvers::interrupt::Interrupt;
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::pose_graph::{Options, solve, undetermined};
use covis_solvers::price::Limits;
use covis_solvers::problem::{PoseGraph, SolveError};
use covis_solvers::robust::Kernel;
use covis_solvers::testing::assert_jacobian;
use covis_solvers::testing::random::{element, normal_vector, seeded, uniform_vector};
use nalgebra::Vector3;
use serde_json::Value;

use super::graphs::{Recipe, distance, information, make, optimize, tight};

const RECIPE: Recipe = Recipe { seed: 33, poses: 30, measurement_sigma: 0.0, start_sigma: 0.05 };

fn twin(name: &str) -> G2oGraph {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden");
    G2oGraph::read(&folder.join(format!("twins/{name}.g2o"))).unwrap()
}

fn record(name: &str) -> Value {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden");
    let path = folder.join(format!("gtsam/{name}-file-start.json"));
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// Flat where the plane has two axes.
fn point(vector: Vector3<f64>, space: usize) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| if axis < space { vector[axis] } else { 0.0 })
}

fn sweep<G: LieGroup<N>, const N: usize>(seed: u64, space: usize) {
    let mut rng = seeded(seed);
    for size in [0.05, 1.0, 30.0, 1e3] {
        for _ in 0..40 {
            let pose: G = element(&mut rng, 0.8);
            let seen = point(uniform_vector(&mut rng, size), space);
            // Lengths of a few steps of the differences have no derivative to compare.
            if seen.xy().norm() < 0.01 {
                continue;
            }
            let landmark = pose.act(&seen);
            let measured = seen + point(normal_vector(&mut rng, 0.1), space);
            for sighting in
                [Sighting::Position(measured), Sighting::Bearing(measured.y.atan2(measured.x))]
            {
                let measurement = LandmarkMeasurement {
                    pose: Some(0),
                    landmark: 0,
                    sighting,
                    information: Information::identity(),
                    loss: None,
                };
                let at = measurement.linearize(&pose, &landmark);
                assert_eq!(at.residual, measurement.residual(&pose, &landmark));
                let scale = 1.0 / (1.0 + size);
                let of_pose =
                    |d: &_| measurement.residual(&pose.plus(&(d * 0.01)), &landmark) * scale;
                let d_pose = at.d_pose * (0.01 * scale);
                assert_jacobian("pose", of_pose, &d_pose, 1e-7);
                let of_point = |d: &Vector3<f64>| {
                    measurement.residual(&pose, &(landmark + point(*d, space) * 0.01)) * scale
                };
                let mut d_landmark = at.d_landmark * (0.01 * scale);
                (space..3).for_each(|axis| d_landmark.column_mut(axis).fill(0.0));
                assert_jacobian("landmark", of_point, &d_landmark, 1e-7);
            }
        }
    }
}

#[test]
fn the_jacobians_of_measured_landmarks_are_exact() {
    sweep::<Se2, 3>(1, 2);
    sweep::<Se3, 6>(2, 3);
}

#[test]
fn a_bearing_behind_the_pose_has_no_jump() {
    let measurement = LandmarkMeasurement {
        pose: None,
        landmark: 0,
        sighting: Sighting::Bearing(3.1),
        information: LandmarkMeasurement::scalar_information(4.0).unwrap(),
        loss: None,
    };
    let residual = measurement.residual(&Se2::identity(), &Vector3::new(-1.0, -0.01, 0.0));
    assert!((residual.x - (0.0416 + 0.01)).abs() < 1e-3, "{residual}");
    assert!(LandmarkMeasurement::scalar_information(-1.0).is_err());
}

/// Solves a graph of a file and compares it with GTSAM's record.
fn compare<const N: usize, G>(
    name: &str,
    mut graph: PoseGraph<G, N>,
    numbers: impl Fn(&G) -> Vec<f64>,
) where
    G: LieGroup<N> + covis_solvers::evaluation::ReferencePose<N>,
{
    let record = record(name);
    let number = |field: &str| record[field].as_f64().unwrap();
    let before = pose_graph_cost(&graph).total;
    assert!((before / number("initial_cost") - 1.0).abs() < 1e-9, "{name}: {before}");
    let mut options = tight();
    let mut bits = Vec::new();
    let start = graph.clone();
    for threads in [1, 2] {
        graph = start.clone();
        options.optimizer.threads = Some(threads);
        let summary = solve(&mut graph, &options, &mut ignore_iterations).unwrap();
        assert!(summary.termination.is_converged(), "{name}: {:?}", summary.termination);
        assert!((summary.initial_cost / before - 1.0).abs() < 1e-12);
        bits.push((graph.landmarks.positions.clone(), graph.poses.clone()));
    }
    assert_eq!(bits[0], bits[1], "{name}: threads change bits");
    let report = pose_graph_cost(&graph);
    assert!((report.total / number("final_cost") - 1.0).abs() < 1e-9, "{name}: {}", report.total);
    assert_eq!(report.landmark.count, graph.landmarks.measurements.len());
    assert!(report.residuals.of(Quantity::LandmarkPosition).reduced_chi2 < 1.3);
    assert!(!graph.constant.contains(&true), "{name}: priors hold the gauge");
    assert_eq!(undetermined(&graph).unwrap(), []);
    for (id, expected) in record["poses"].as_object().unwrap() {
        let id: i64 = id.parse().unwrap();
        let expected: Vec<f64> = serde_json::from_value(expected.clone()).unwrap();
        let of = |ids: &[i64]| ids.iter().position(|&other| other == id);
        let found = match of(&graph.ids) {
            Some(pose) => numbers(&graph.poses[pose]),
            None => {
                graph.landmarks.positions[of(&graph.landmarks.ids).unwrap()].as_slice().to_vec()
            }
        };
        for (found, expected) in found.iter().zip(&expected) {
            assert!((found - expected).abs() < 1e-6, "{name}, {id}: {found} {expected}");
        }
    }
}

#[test]
fn files_with_landmarks_and_priors_cost_what_gtsam_says() {
    let G2oGraph::Se2(file) = twin("park-80") else { panic!("read as 3D") };
    compare("park-80", file.to_pose_graph().unwrap(), |pose| {
        vec![pose.translation.x, pose.translation.y, pose.rotation.angle()]
    });
    let G2oGraph::Se3(file) = twin("hall-60") else { panic!("read as 2D") };
    // Of a quaternion the sign is free.
    compare("hall-60", file.to_pose_graph().unwrap(), |pose| pose.translation.as_slice().to_vec());
}

/// A graph whose landmarks are measured exactly, with a start off the truth; the truth.
fn with_landmarks<G: LieGroup<N>, const N: usize>(
    space: usize,
) -> (PoseGraph<G, N>, Vec<G>, Vec<Vector3<f64>>) {
    let (mut graph, truth) = make::<G, N>(RECIPE);
    let mut rng = seeded(8);
    let mut landmarks = Vec::new();
    for k in 0..12 {
        let near = &truth[2 * k];
        let position = near.act(&point(uniform_vector(&mut rng, 3.0), space));
        let landmark = graph
            .landmarks
            .push(1000 + k as i64, position + point(normal_vector(&mut rng, 0.1), space));
        landmarks.push(position);
        for pose in 2 * k..2 * k + 5 {
            let seen = truth[pose].inverse().act(&position);
            if k % 3 == 2 && space == 3 {
                let ends = [RangeEnd::Pose(pose), RangeEnd::Landmark(landmark)];
                let (distance_m, precision, loss) = (seen.norm(), 100.0, None);
                graph.ranges.push(Range { ends, distance_m, precision, loss });
                continue;
            }
            let sighting = match k % 3 {
                0 | 1 => Sighting::Position(seen),
                _ => Sighting::Bearing(seen.y.atan2(seen.x)),
            };
            let information = match sighting {
                Sighting::Position(_) => information(&mut rng),
                Sighting::Bearing(_) => LandmarkMeasurement::scalar_information(100.0).unwrap(),
            };
            let pose = Some(pose);
            let measurement =
                LandmarkMeasurement { pose, landmark, sighting, information, loss: None };
            graph.landmarks.measurements.push(measurement);
        }
    }
    (graph, truth, landmarks)
}

fn farthest(graph: &[Vector3<f64>], truth: &[Vector3<f64>]) -> f64 {
    graph.iter().zip(truth).map(|(a, b)| (a - b).norm()).fold(0.0, f64::max)
}

#[test]
fn exact_measurements_give_the_truth_back() {
    let (mut graph, truth, landmarks) = with_landmarks::<Se2, 3>(2);
    optimize(&mut graph);
    assert!(distance(&graph.poses, &truth) < 1e-6);
    assert!(farthest(&graph.landmarks.positions, &landmarks) < 1e-6);
    assert!(graph.landmarks.positions.iter().all(|position| position.z == 0.0));
    let (mut graph, truth, landmarks) = with_landmarks::<Se3, 6>(3);
    optimize(&mut graph);
    assert!(distance(&graph.poses, &truth) < 1e-6);
    assert!(farthest(&graph.landmarks.positions, &landmarks) < 1e-5);
}

#[test]
fn landmarks_that_are_fixed_hold_the_graph_in_place_of_a_pose() {
    let (mut graph, truth, landmarks) = with_landmarks::<Se2, 3>(2);
    graph.constant[0] = false;
    for landmark in [0, 7] {
        graph.landmarks.positions[landmark] = landmarks[landmark];
        graph.landmarks.constant[landmark] = true;
    }
    graph.poses[0] = truth[0].plus(&normal_vector(&mut seeded(3), 0.05));
    let summary = optimize(&mut graph);
    assert!(summary.termination.is_converged() && !graph.constant.contains(&true));
    assert!(distance(&graph.poses, &truth) < 1e-6, "{}", distance(&graph.poses, &truth));
    assert_eq!(undetermined(&graph).unwrap(), []);
}

#[test]
fn a_landmark_of_one_bearing_is_named_as_open_and_stays() {
    let (mut graph, ..) = with_landmarks::<Se2, 3>(2);
    let measurements = &mut graph.landmarks.measurements;
    let first = measurements.iter().position(|m| m.landmark == 2).unwrap();
    let kept = measurements[first];
    measurements.retain(|m| m.landmark != 2);
    measurements.push(kept);
    assert!(!graph.is_rigid());
    optimize(&mut graph);
    let open = undetermined(&graph).unwrap();
    assert_eq!(open.iter().map(|open| open.id).collect::<Vec<_>>(), [1002]);
    let [direction] = open[0].directions[..] else { panic!("{open:?}") };
    assert_eq!(direction[2], 0.0, "a landmark has no rotation");
    // It may move along the line of sight.
    let pose = &graph.poses[kept.pose.unwrap()];
    let sight = graph.landmarks.positions[2] - pose.act(&Vector3::zeros());
    assert!((sight.x * direction[1] - sight.y * direction[0]).abs() < 1e-4 * sight.norm());
}

#[test]
fn a_start_that_is_made_puts_landmarks_where_they_were_measured() {
    let (mut graph, truth, landmarks) = with_landmarks::<Se3, 6>(3);
    graph.landmarks.positions.iter_mut().for_each(|position| *position = Vector3::zeros());
    let start = initialize(&mut graph, Start::Chordal, false, Limits::NONE).unwrap();
    assert_eq!(start, Start::Chordal);
    assert!(distance(&graph.poses, &truth) < 1e-6);
    for (k, (found, truth)) in graph.landmarks.positions.iter().zip(&landmarks).enumerate() {
        // Ranges alone do not tell a place.
        assert!(k % 3 == 2 || (found - truth).norm() < 1e-6, "{k}");
    }
}

#[test]
fn landmarks_go_along_where_a_graph_is_brought_to_its_priors() {
    let (mut graph, truth, landmarks) = with_landmarks::<Se3, 6>(3);
    let motion: Se3 = element(&mut seeded(4), 0.8);
    graph.poses = truth.iter().map(|pose| motion.compose(pose)).collect();
    graph.landmarks.positions = landmarks.iter().map(|position| motion.act(position)).collect();
    graph.constant[0] = false;
    graph.pose_priors.push(PosePrior {
        pose: 4,
        world_from_camera: truth[4],
        information: Information::identity(),
        loss: Loss::Trivial,
    });
    assert!(align_to_priors(&mut graph));
    assert!(pose_graph_cost(&graph).total < 1e-12);
    assert!(farthest(&graph.landmarks.positions, &landmarks) < 1e-9);
}

#[test]
fn poses_that_see_one_landmark_hang_together() {
    let (mut graph, truth, _) = with_landmarks::<Se2, 3>(2);
    // Both sides see two landmarks by position, which leave nothing open in the plane.
    for (landmark, pose) in [(6, 13), (7, 13), (6, 15), (7, 15)] {
        let seen = truth[pose].inverse().act(&graph.landmarks.positions[landmark]);
        let sighting = Sighting::Position(seen);
        let information = Information::identity();
        let pose = Some(pose);
        let measurement = LandmarkMeasurement { pose, landmark, sighting, information, loss: None };
        graph.landmarks.measurements.push(measurement);
    }
    graph.edges.retain(|edge| (edge.i < 14) == (edge.j < 14));
    graph.validate().unwrap();
    assert_eq!(undetermined(&graph).unwrap(), []);
    // Landmarks 5 to 7 are those that poses of both sides see.
    graph.landmarks.measurements.retain(|m| !(5..=7).contains(&m.landmark));
    let error = solve(&mut graph, &Options::default(), &mut ignore_iterations).unwrap_err();
    assert!(matches!(error, SolveError::Disconnected { .. }), "{error}");
}

#[test]
fn a_landmark_that_nothing_measures_stays_and_is_named() {
    let (mut graph, truth, _) = with_landmarks::<Se2, 3>(2);
    let alone = Vector3::new(7.0, -3.0, 0.0);
    graph.landmarks.push(77, alone);
    let summary = optimize(&mut graph);
    assert!(summary.termination.is_converged());
    assert!(distance(&graph.poses, &truth) < 1e-6);
    assert_eq!(graph.landmarks.positions[12], alone);
    let open = undetermined(&graph).unwrap();
    let [open] = &open[..] else { panic!("{open:?}") };
    assert_eq!((open.id, open.directions.len()), (77, 2));
}

#[test]
fn what_is_wrong_with_a_landmark_is_named() {
    type Change = fn(&mut PoseGraph<Se2, 3>);
    let table: &[(Change, &str)] = &[
        (|graph| graph.landmarks.ids[3] = 10, "landmark id 10 occurs twice"),
        (|graph| graph.landmarks.ids[3] = 1000, "landmark id 1000 occurs twice"),
        (|graph| graph.landmarks.positions[3].x = f64::NAN, "landmark 1003 is not finite"),
        (|graph| graph.landmarks.constant.truncate(3), "constant landmarks has 3 entries"),
        (|graph| graph.landmarks.measurements[2].pose = Some(99), "measurement 2: pose 99"),
        (|graph| graph.landmarks.measurements[2].landmark = 12, "measurement 2: landmark 12"),
        (
            |graph| graph.landmarks.measurements[2].sighting = Sighting::Bearing(f64::INFINITY),
            "landmark measurement 2 is not finite",
        ),
        (
            |graph| graph.landmarks.measurements[2].loss = Some(Loss::Huber(-1.0)),
            "landmark measurement 2: the width",
        ),
    ];
    for (change, expected) in table {
        let (mut graph, ..) = with_landmarks::<Se2, 3>(2);
        change(&mut graph);
        let error = graph.validate().unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn judging_and_certificates_refuse_landmarks() {
    let judging = Some(Judging::new(Kernel::TruncatedLeastSquares));
    let judged = graph_optimization::Options { judging, ..Default::default() };
    let proved = graph_optimization::Options { certify: true, ..Default::default() };
    for (options, field) in [(judged, "robust"), (proved, "certify")] {
        let (mut graph, ..) = with_landmarks::<Se2, 3>(2);
        let run = graph_optimization::optimize;
        let error = run(&mut graph, true, &options, &Interrupt::NEVER, &mut ignore_iterations);
        let error = error.unwrap_err().to_string();
        assert!(error.contains(field) && error.contains("landmarks"), "{error}");
    }
}

/// What a loss makes of an outlier among the measurements.
#[test]
fn the_loss_of_the_graph_is_that_of_landmarks() {
    let (mut graph, truth, _) = with_landmarks::<Se3, 6>(3);
    let Sighting::Position(z) = &mut graph.landmarks.measurements[1].sighting else { panic!() };
    z.x += 50.0;
    graph.loss = Loss::Cauchy(0.5);
    let before = pose_graph_cost(&graph).total;
    let summary = optimize(&mut graph);
    assert!((summary.initial_cost / before - 1.0).abs() < 1e-12);
    let after = pose_graph_cost(&graph);
    assert!((summary.final_cost / after.total - 1.0).abs() < 1e-12);
    assert!(distance(&graph.poses, &truth) < 0.05, "{}", distance(&graph.poses, &truth));
}
