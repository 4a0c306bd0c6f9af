//! Ranges in pose graphs: Jacobians, recovery, distance zero, gauge, pieces, refusals.

use covis_solvers::evaluation::{Quantity, pose_graph_cost};
use covis_solvers::factors::{PosePrior, Range, RangeEnd, RangePlace};
use covis_solvers::geometry::{LieGroup, Se2, Se3};
use covis_solvers::graph_optimization::{self, Judging};
use covis_solvers::information::Information;
use covis_solvers::initialization::align_to_priors;
use covis_solvers::interrupt::Interrupt;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::pose_graph::{Options, solve, undetermined};
use covis_solvers::problem::{PoseGraph, SolveError};
use covis_solvers::robust::Kernel;
use covis_solvers::testing::assert_jacobian;
use covis_solvers::testing::random::{element, normal_vector, seeded, uniform_vector};
use nalgebra::{SVector, Vector3};

use super::graphs::{Recipe, distance, make, optimize};

use RangeEnd::{Landmark, Pose};

fn range(ends: [RangeEnd; 2], distance_m: f64) -> Range {
    Range { ends, distance_m, precision: 100.0, loss: None }
}

/// Flat where the plane has two axes.
fn point(vector: Vector3<f64>, space: usize) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| if axis < space { vector[axis] } else { 0.0 })
}

/// A place moved by a tangent; of a landmark by its first entries.
fn moved<G: LieGroup<N>, const N: usize>(
    place: &RangePlace<G>,
    delta: &SVector<f64, N>,
    space: usize,
) -> RangePlace<G> {
    match place {
        RangePlace::Pose(pose) => RangePlace::Pose(pose.plus(delta)),
        RangePlace::Landmark(position) => {
            let step = point(Vector3::new(delta[0], delta[1], delta[2]), space);
            RangePlace::Landmark(position + step)
        }
    }
}

fn sweep<G: LieGroup<N>, const N: usize>(seed: u64, space: usize) {
    let mut rng = seeded(seed);
    for size in [0.05, 1.0, 30.0, 1e3] {
        for _ in 0..40 {
            let a = point(uniform_vector(&mut rng, size), space);
            let b = point(uniform_vector(&mut rng, size), space);
            // Lengths of a few steps of the differences have no derivative to compare.
            if (a - b).norm() < 0.01 {
                continue;
            }
            let mut pose = |at: Vector3<f64>| {
                let turned: G = element(&mut rng, 0.8);
                let shift = SVector::<f64, N>::from_fn(|k, _| if k < space { at[k] } else { 0.0 });
                G::exp(&shift).compose(&turned)
            };
            let places = [
                [RangePlace::Pose(pose(a)), RangePlace::Pose(pose(b))],
                [RangePlace::Pose(pose(a)), RangePlace::Landmark(b)],
                [RangePlace::Landmark(a), RangePlace::Landmark(b)],
            ];
            for places in places {
                let measurement = range([Pose(0), Pose(1)], 0.7 * size);
                let at = measurement.linearize(&places);
                let value = |places: &[RangePlace<G>; 2]| {
                    measurement.residual(&places[0].position(), &places[1].position())
                };
                assert_eq!(at.residual, value(&places));
                let scale = 1.0 / (1.0 + size);
                for end in 0..2 {
                    let of_end = |delta: &SVector<f64, N>| {
                        let mut places = places;
                        places[end] = moved(&places[end], &(delta * 0.01), space);
                        SVector::<f64, 1>::new(value(&places) * scale)
                    };
                    let mut jacobian = at.d_ends[end].transpose() * (0.01 * scale);
                    if let RangePlace::Landmark(_) = places[end] {
                        jacobian.columns_mut(space, N - space).fill(0.0);
                    }
                    assert_jacobian("end", of_end, &jacobian, 1e-7);
                }
            }
        }
    }
}

#[test]
fn the_jacobians_of_ranges_are_exact() {
    sweep::<Se2, 3>(1, 2);
    sweep::<Se3, 6>(2, 3);
}

/// A square of landmarks with all six distances, every start at one point.
fn square() -> PoseGraph<Se2, 3> {
    let mut graph = PoseGraph::new();
    for id in 0..4 {
        graph.landmarks.push(id, Vector3::new(1.0, 1.0, 0.0));
    }
    let corners = [[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0_f64]];
    for a in 0..4 {
        for b in 0..a {
            let [ax, ay] = corners[a];
            let [bx, by] = corners[b];
            let distance_m = (ax - bx).hypot(ay - by);
            graph.ranges.push(range([Landmark(a), Landmark(b)], distance_m));
        }
    }
    graph
}

#[test]
fn a_range_at_distance_zero_is_finite_and_moves_its_ends_apart() {
    let places = [RangePlace::Pose(Se3::identity()), RangePlace::Landmark(Vector3::zeros())];
    let at = range([Pose(0), Landmark(0)], 2.0).linearize(&places);
    assert_eq!(at.residual, -2.0);
    assert_eq!(at.d_ends[1].as_slice(), [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert_eq!(at.d_ends[0], -at.d_ends[1]);
    let mut graph = square();
    graph.landmarks.positions[1].x = 1.5;
    let mut pair = graph.clone();
    pair.ranges.retain(|range| range.ends == [Landmark(3), Landmark(2)]);
    let summary = solve(&mut pair, &Options::default(), &mut ignore_iterations).unwrap();
    assert!(summary.termination.is_converged() && summary.final_cost < 1e-9, "{summary:?}");
    let summary = solve(&mut graph, &Options::default(), &mut ignore_iterations).unwrap();
    assert!(graph.landmarks.positions.iter().all(|p| p.iter().all(|x| x.is_finite())));
    assert!(summary.final_cost < summary.initial_cost);
}

#[test]
fn landmarks_without_a_pose_take_their_shape_and_are_named_as_free() {
    let mut graph = square();
    for (position, start) in
        graph.landmarks.positions.iter_mut().zip([[0.3, -0.2], [1.8, 0.3], [2.2, 1.7], [-0.3, 2.1]])
    {
        *position = Vector3::new(start[0], start[1], 0.0);
    }
    let summary = optimize(&mut graph);
    assert!(summary.termination.is_converged() && summary.final_cost < 1e-15, "{summary:?}");
    let farthest = graph.landmarks.positions.iter().map(|p| p.norm()).fold(0.0, f64::max);
    assert!(farthest < 4.0, "the map stays where it started: {farthest}");
    let open = undetermined(&graph).unwrap();
    assert_eq!(open.iter().map(|open| open.id).collect::<Vec<_>>(), [0, 1, 2, 3]);
    assert!(graph.landmarks.positions.iter().all(|position| position.z == 0.0));
}

/// Two robots whose chains ranges alone tie together, with beacons; the truth.
fn fleet<G: LieGroup<N>, const N: usize>(
    space: usize,
    sigma: f64,
) -> (PoseGraph<G, N>, Vec<G>, Vec<Vector3<f64>>) {
    let recipe = Recipe { seed: 5, poses: 30, measurement_sigma: 0.0, start_sigma: 0.03 };
    let (mut graph, truth) = make::<G, N>(recipe);
    graph.edges.retain(|edge| (edge.i < 15) == (edge.j < 15));
    let mut rng = seeded(9);
    let origin = |pose: &G| pose.act(&Vector3::zeros());
    let mut beacons = Vec::new();
    for k in 0..4 {
        let position = origin(&truth[7 * k]) + point(uniform_vector(&mut rng, 4.0), space);
        let start = position + point(normal_vector(&mut rng, 0.05), space);
        let landmark = graph.landmarks.push(1000 + k as i64, start);
        beacons.push(position);
        for pose in (k % 3..30).step_by(3) {
            let distance = (origin(&truth[pose]) - position).norm();
            let noise = sigma * normal_vector::<1>(&mut rng, 1.0)[0];
            graph.ranges.push(range([Pose(pose), Landmark(landmark)], distance + noise));
        }
    }
    graph.ranges.push(range([Landmark(0), Landmark(3)], (beacons[0] - beacons[3]).norm()));
    for k in 0..15 {
        let (a, b) = (k, 15 + (4 * k + 3) % 15);
        let distance = (origin(&truth[a]) - origin(&truth[b])).norm();
        graph.ranges.push(range([Pose(a), Pose(b)], distance));
    }
    (graph, truth, beacons)
}

fn recover<G, const N: usize>(space: usize)
where
    G: LieGroup<N> + covis_solvers::evaluation::ReferencePose<N>,
{
    let (mut graph, truth, beacons) = fleet::<G, N>(space, 0.0);
    graph.validate().unwrap();
    let before = pose_graph_cost(&graph);
    let summary = optimize(&mut graph);
    assert!((summary.initial_cost / before.total - 1.0).abs() < 1e-12);
    assert!(summary.termination.is_converged() && summary.final_cost < 1e-14, "{summary:?}");
    assert_eq!(before.range.count, graph.ranges.len());
    let found = distance(&graph.poses, &truth);
    assert!(found < 1e-5, "{found}");
    for (found, truth) in graph.landmarks.positions.iter().zip(&beacons) {
        assert!((found - truth).norm() < 1e-5);
    }
    assert_eq!(undetermined(&graph).unwrap(), []);
    assert!(!graph.is_rigid(), "ranges are not looked at");
}

#[test]
fn two_robots_that_ranges_tie_together_get_the_truth_back() {
    recover::<Se2, 3>(2);
    recover::<Se3, 6>(3);
}

#[test]
fn noisy_ranges_cost_the_same_by_the_evaluator_and_at_any_thread_count() {
    let (start, ..) = fleet::<Se3, 6>(3, 0.1);
    let mut bits = Vec::new();
    for threads in [1, 2] {
        let mut graph = start.clone();
        let mut options = super::graphs::tight();
        options.optimizer.threads = Some(threads);
        let summary = solve(&mut graph, &options, &mut ignore_iterations).unwrap();
        let after = pose_graph_cost(&graph);
        assert!((summary.final_cost / after.total - 1.0).abs() < 1e-12);
        assert!(after.range.cost > 0.0);
        assert_eq!(after.residuals.of(Quantity::Range).count, graph.ranges.len());
        bits.push((graph.poses, graph.landmarks.positions));
    }
    assert_eq!(bits[0], bits[1], "threads change bits");
}

#[test]
fn a_false_range_is_left_to_the_loss() {
    let (mut graph, truth, _) = fleet::<Se2, 3>(2, 0.0);
    graph.ranges[3].distance_m += 20.0;
    graph.loss = Loss::Cauchy(0.5);
    optimize(&mut graph);
    assert!(distance(&graph.poses, &truth) < 0.05);
    graph.loss = Loss::Trivial;
    graph.ranges[3].loss = Some(Loss::Cauchy(0.5));
    optimize(&mut graph);
    assert!(distance(&graph.poses, &truth) < 0.05);
}

#[test]
fn ranges_go_along_where_a_graph_is_brought_to_its_priors() {
    let (mut graph, truth, beacons) = fleet::<Se3, 6>(3, 0.0);
    let motion: Se3 = element(&mut seeded(4), 0.8);
    graph.poses = truth.iter().map(|pose| motion.compose(pose)).collect();
    graph.landmarks.positions = beacons.iter().map(|position| motion.act(position)).collect();
    graph.constant[0] = false;
    graph.pose_priors.push(PosePrior {
        pose: 4,
        world_from_camera: truth[4],
        information: Information::identity(),
        loss: Loss::Trivial,
    });
    assert!(align_to_priors(&mut graph));
    assert!(pose_graph_cost(&graph).total < 1e-12);
}

#[test]
fn robots_that_no_range_ties_together_are_named() {
    let (mut graph, ..) = fleet::<Se2, 3>(2, 0.0);
    graph.ranges.retain(|range| range.ends == [Landmark(0), Landmark(3)]);
    // The first robot has a range to one beacon, the second one to the other.
    graph.ranges.push(range([Pose(2), Landmark(0)], 1.0));
    graph.ranges.push(range([Pose(20), Landmark(3)], 1.0));
    graph.validate().unwrap();
    graph.ranges.remove(0);
    let error = graph.validate().unwrap_err();
    assert!(matches!(&error, SolveError::Disconnected { pieces } if pieces.len() == 2), "{error}");
}

#[test]
fn what_is_wrong_with_a_range_is_named() {
    type Change = fn(&mut Range);
    let table: &[(Change, &str)] = &[
        (|range| range.ends[0] = Pose(99), "range 2: pose 99 does not exist"),
        (|range| range.ends[1] = Landmark(4), "range 2: landmark 4 does not exist"),
        (|range| range.ends[0] = range.ends[1], "range 2 is between a variable and itself"),
        (|range| range.distance_m = f64::NAN, "range 2 is not finite"),
        (|range| range.precision = 0.0, "range 2: the information"),
        (|range| range.precision = f64::INFINITY, "range 2: the information"),
        (|range| range.loss = Some(Loss::Huber(0.0)), "range 2: the width"),
    ];
    for (change, expected) in table {
        let (mut graph, ..) = fleet::<Se2, 3>(2, 0.0);
        change(&mut graph.ranges[2]);
        let error = graph.validate().unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn judging_and_certificates_refuse_ranges() {
    let judging = Some(Judging::new(Kernel::TruncatedLeastSquares));
    let judged = graph_optimization::Options { judging, ..Default::default() };
    let proved = graph_optimization::Options { certify: true, ..Default::default() };
    for (options, field) in [(judged, "robust"), (proved, "certify")] {
        let (mut graph, _) =
            make::<Se2, 3>(Recipe { seed: 1, poses: 9, measurement_sigma: 0.0, start_sigma: 0.0 });
        graph.ranges.push(range([Pose(0), Pose(5)], 4.0));
        let run = graph_optimization::optimize;
        let error = run(&mut graph, true, &options, &Interrupt::NEVER, &mut ignore_iterations);
        let error = error.unwrap_err().to_string();
        assert!(error.contains(field) && error.contains("ranges"), "{error}");
    }
}
