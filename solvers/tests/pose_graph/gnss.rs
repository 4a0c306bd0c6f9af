//! Drifting odometry and sparse fixes: the fixes that are withheld are the truth.
//!
//! The odometry is made from a real trajectory and seeded noise and strung together in a frame of its
//! own; every tenth fix is given, with a lever arm, some of them false. Sections whose data are absent
//! are skipped with a line.

use covis_solvers::factors::{PositionPrior, RelativePose};
use covis_solvers::geometry::{Geodetic, LieGroup, LocalFrame, Se3, So3};
use covis_solvers::graph_optimization::{self, Optimized, optimize};
use covis_solvers::information::Information;
use covis_solvers::initialization::{Start, align_to_priors};
use covis_solvers::interrupt::Interrupt;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::problem::PoseGraph;
use covis_solvers::robust::PositionJudging;
use covis_solvers::testing::data;
use covis_solvers::testing::random::{normal_vector, seeded, uniform_vector};
use nalgebra::{Vector3, Vector6};

/// The antenna in the frame of the body, in meters.
const ARM: Vector3<f64> = Vector3::new(0.4, -0.3, 1.2);

/// Every so many fixes one is given.
const GIVEN: usize = 10;

/// Standard deviations of an odometry step: the share of its length, and radians.
const SHARE: f64 = 0.01;
const TURN_RAD: f64 = 0.003;

/// What is wrong with each step on top: a scale of 0.3 % and a turn of 0.02°.
const BIAS: [f64; 2] = [0.003, 0.0003];

/// Antenna positions in meters: those of the car at 1 Hz, while it moves.
fn car() -> Option<Vec<Vector3<f64>>> {
    let text = std::fs::read_to_string(data("gnss/car/gnss.csv")?).unwrap();
    let rows = text.lines().filter(|line| !line.starts_with('#')).step_by(4);
    let places: Vec<Geodetic> = rows
        .map(|line| {
            let numbers: Vec<f64> = line.split(',').take(4).map(|x| x.parse().unwrap()).collect();
            let [_, latitude_deg, longitude_deg, height_m] = numbers[..] else { panic!("{line}") };
            Geodetic { latitude_deg, longitude_deg, height_m }
        })
        .collect();
    let frame = LocalFrame::new(&places[0]);
    Some(moving(places.iter().map(|place| frame.point_in_local(place))))
}

fn kitti() -> Option<Vec<Vector3<f64>>> {
    let text = std::fs::read_to_string(data("gnss/KittiGps_converted.txt")?).unwrap();
    let point = |line: &str| {
        let numbers: Vec<f64> = line.split(',').map(|x| x.trim().parse().unwrap()).collect();
        Vector3::new(numbers[1], numbers[2], numbers[3])
    };
    Some(moving(text.lines().skip(1).filter(|line| !line.trim().is_empty()).map(point)))
}

/// Points at least a meter apart, so that each has a course.
fn moving(points: impl Iterator<Item = Vector3<f64>>) -> Vec<Vector3<f64>> {
    let mut kept: Vec<Vector3<f64>> = Vec::new();
    for point in points {
        if kept.last().is_none_or(|last| (point - last).norm() >= 1.0) {
            kept.push(point);
        }
    }
    kept
}

/// Poses of the body: x along the course, z up, the antenna at its point.
fn poses(antenna: &[Vector3<f64>]) -> Vec<Se3> {
    let pose = |k: usize| {
        let next = (k + 1).min(antenna.len() - 1);
        let course = antenna[next] - antenna[next - 1];
        let rotation = So3::exp(&(Vector3::z() * course.y.atan2(course.x)));
        Se3::new(rotation, antenna[k] - rotation.rotate(&ARM))
    };
    (0..antenna.len()).map(pose).collect()
}

/// The odometry in its own frame, and the fixes that are given; false ones are at `is_false`.
fn problem(truth: &[Se3], sigma_m: f64, is_false: &[usize]) -> PoseGraph<Se3, 6> {
    let mut rng = seeded(1707);
    let mut graph = PoseGraph::new();
    let mut pose = Se3::exp(&Vector6::new(30.0, -20.0, 5.0, 0.1, -0.2, 2.5));
    graph.push_pose(0, pose);
    for k in 1..truth.len() {
        let step = truth[k - 1].inverse().compose(&truth[k]);
        let length = step.translation.norm();
        let t = SHARE * length + 0.01;
        let sigmas = Vector6::new(t, t, t, TURN_RAD, TURN_RAD, TURN_RAD);
        let bias = Vector6::new(BIAS[0] * length, 0.0, 0.0, 0.0, 0.0, BIAS[1]);
        let noise = normal_vector::<6>(&mut rng, 1.0).component_mul(&sigmas);
        let i_from_j = step.plus(&(noise + bias));
        let information = Information::from_sigmas(&sigmas).unwrap();
        graph.edges.push(RelativePose { i: k - 1, j: k, i_from_j, information, loss: None });
        pose = pose.compose(&i_from_j);
        graph.push_pose(k as i64, pose);
    }
    for (number, pose) in (0..truth.len()).step_by(GIVEN).enumerate() {
        let mut position_in_world =
            truth[pose].transform(&ARM) + normal_vector::<3>(&mut rng, sigma_m);
        if is_false.contains(&number) {
            let off: Vector3<f64> = uniform_vector(&mut rng, 1.0);
            position_in_world += off.normalize() * 25.0;
        }
        graph.position_priors.push(PositionPrior {
            pose,
            position_in_world,
            point_in_camera: ARM,
            information: Information::from_sigmas(&Vector3::repeat(sigma_m)).unwrap(),
            loss: Loss::Trivial,
        });
    }
    graph
}

/// Root mean square distance of the antenna from the fixes that were withheld, in meters.
fn withheld_error(poses: &[Se3], truth: &[Se3]) -> f64 {
    let withheld = (0..poses.len()).filter(|pose| pose % GIVEN != 0);
    let apart = |k: usize| (poses[k].transform(&ARM) - truth[k].transform(&ARM)).norm_squared();
    let count = withheld.clone().count() as f64;
    (withheld.map(apart).sum::<f64>() / count).sqrt()
}

fn solve(graph: &mut PoseGraph<Se3, 6>, positions: Option<PositionJudging>) -> Optimized {
    let options = graph_optimization::Options {
        start: Start::Given,
        positions,
        costs: true,
        ..graph_optimization::Options::default()
    };
    optimize(graph, true, &options, &Interrupt::NEVER, &mut ignore_iterations).unwrap()
}

/// Errors of the odometry, of all fixes taken for true, and of the judged ones.
fn check(name: &str, antenna: &[Vector3<f64>], sigma_m: f64) {
    let truth = poses(antenna);
    let is_false = [3, 8, 9, 17, 25, 33];
    let mut graph = problem(&truth, sigma_m, &is_false);
    let mut odometry = graph.clone();
    assert!(align_to_priors(&mut odometry));
    let drift = withheld_error(&odometry.poses, &truth);
    let mut trusting = graph.clone();
    solve(&mut trusting, None);
    let trusting = withheld_error(&trusting.poses, &truth);
    let optimized = solve(&mut graph, Some(PositionJudging::default()));
    let judged = withheld_error(&graph.poses, &truth);
    println!("{name}: odometry {drift:.2} m, all fixes {trusting:.2} m, judged {judged:.2} m");
    assert!(optimized.solve.termination.is_converged());
    assert!(!graph.constant.contains(&true), "priors hold the frame");
    let off: Vec<usize> = (0..optimized.positions.len())
        .filter(|&k| optimized.positions[k].is_switched_off)
        .collect();
    for k in is_false {
        assert!(off.contains(&k), "{name}: {k} is false and was believed; off are {off:?}");
    }
    assert!(off.len() <= is_false.len() + 2, "{name}: off are {off:?}");
    assert!(judged < 0.25 * drift, "{name}: {judged} m, odometry {drift} m");
    assert!(judged < 0.6 * trusting, "{name}: {judged} m, trusting {trusting} m");
    // What was found false stays so, and costs no more rounds.
    let switched_off = off.clone();
    let again = solve(&mut graph, Some(PositionJudging { switched_off, threshold: None }));
    let still: Vec<usize> =
        (0..again.positions.len()).filter(|&k| again.positions[k].is_switched_off).collect();
    assert_eq!(still, off);
    assert!((withheld_error(&graph.poses, &truth) - judged).abs() < 0.05);
}

#[test]
fn every_tenth_fix_of_a_car_corrects_its_odometry() {
    let Some(antenna) = car() else { return };
    for sigma_m in [0.02, 1.0] {
        check("car", &antenna, sigma_m);
    }
}

#[test]
fn every_tenth_fix_of_kitti_corrects_its_odometry() {
    let Some(antenna) = kitti() else { return };
    check("kitti", &antenna, 0.1);
}

#[test]
fn a_true_fix_that_was_found_false_comes_back() {
    let antenna: Vec<Vector3<f64>> = (0..300)
        .map(|k| f64::from(k) * 0.05)
        .map(|a| Vector3::new(80.0 * a.sin(), 60.0 * (2.0 * a).sin(), a))
        .collect();
    let truth = poses(&antenna);
    let mut graph = problem(&truth, 0.05, &[4]);
    let wrong = PositionJudging { switched_off: vec![7, 12], threshold: None };
    let optimized = solve(&mut graph, Some(wrong));
    let off: Vec<usize> = (0..optimized.positions.len())
        .filter(|&k| optimized.positions[k].is_switched_off)
        .collect();
    // One in a hundred true ones may be left out.
    assert!(off.contains(&4) && !off.contains(&7) && !off.contains(&12), "{off:?}");
    assert!(off.len() <= 2, "{off:?}");
}
