//! The evaluator against a third implementation, against the factors, and against hand computation.

use std::path::Path;

use covis_solvers::evaluation::{bundle_cost, pose_graph_cost};
use covis_solvers::factors::{PosePrior, PositionPrior, RelativePose, Reprojection};
use covis_solvers::geometry::{
    Camera, KannalaBrandt, LieGroup, PinholeRadialTangential, Se2, Se3, Snavely,
};
use covis_solvers::information::Information;
use covis_solvers::io::bal::BalFile;
use covis_solvers::io::g2o::G2oGraph;
use covis_solvers::loss::Loss;
use covis_solvers::problem::{BundleProblem, PoseGraph};
use nalgebra::{SMatrix, SVector, Vector2, Vector3};

use crate::io::data::data;

/// Costs of the unmodified files, made with numpy in `../shared` by
/// `for f in data/bal/*.txt data/pose_graph/*.g2o; do python3 peers/evaluate.py $f; done`.
const INITIAL_COSTS: [(&str, f64); 14] = [
    ("bal/ladybug-49-7776.txt", 8.509124606808e+05),
    ("bal/trafalgar-21-11315.txt", 4.413239314432e+06),
    ("bal/dubrovnik-3-7.txt", 2.764219984422e+03),
    ("pose_graph/sphere2500.g2o", 1.305657711806e+06),
    ("pose_graph/torus3D.g2o", 2.400615174446e+06),
    ("pose_graph/parking-garage.g2o", 8.363601948120e+03),
    ("pose_graph/smallGrid3D.g2o", 8.389433343553e+04),
    ("pose_graph/tinyGrid3D.g2o", 1.433178735535e+02),
    ("pose_graph/M3500.g2o", 1.317356272512e+06),
    ("pose_graph/city10000.g2o", 3.592312156008e+08),
    ("pose_graph/intel.g2o", 2.769978977821e+02),
    ("pose_graph/sphere2500_outliers.g2o", 8.320476841315e+07),
    ("pose_graph/bicocca25b_bow_0.15.g2o", 6.374810784811e+06),
    ("pose_graph/bicocca25b_gps_truth.g2o", 9.024625149213e-03),
];

fn file_cost(path: &Path) -> f64 {
    if path.extension().is_some_and(|e| e == "txt") {
        return bundle_cost(&BalFile::read(path).unwrap().to_problem()).total;
    }
    match G2oGraph::read(path).unwrap() {
        G2oGraph::Se2(file) => pose_graph_cost(&file.to_pose_graph().unwrap()).total,
        G2oGraph::Se3(file) => pose_graph_cost(&file.to_pose_graph().unwrap()).total,
    }
}

#[test]
fn costs_of_real_files_equal_another_implementations() {
    for (name, expected) in INITIAL_COSTS {
        let Some(path) = data(name) else { return };
        let cost = file_cost(&path);
        assert!((cost - expected).abs() <= 1e-9 * expected, "{name}: {cost:e} {expected:e}");
    }
}

#[test]
fn ladybug_starts_with_points_behind_cameras() {
    let Some(path) = data("bal/ladybug-49-7776.txt") else { return };
    let report = bundle_cost(&BalFile::read(&path).unwrap().to_problem());
    assert_eq!((report.reprojection.count, report.behind_camera), (31843, 31));
    let rmse_px = (2.0 * report.total / 31843.0).sqrt();
    assert!((report.rmse_px - rmse_px).abs() < 1e-12 * rmse_px);
}

/// Numbers that look random and are not: sines of an arithmetic sequence.
fn numbers<const N: usize>(seed: usize, scale: f64) -> SVector<f64, N> {
    SVector::from_fn(|row, _| scale * (7.3 * seed as f64 + 2.1 * row as f64 + 0.4).sin())
}

fn information<const N: usize>(seed: usize) -> Information<N> {
    let root = SMatrix::<f64, N, N>::from_fn(|r, c| ((seed + 3 * r + 5 * c) as f64).sin());
    Information::new(&(root.transpose() * root + SMatrix::identity())).unwrap()
}

/// Every kind of factor and camera, some points behind a camera.
fn mixed_problem() -> BundleProblem {
    let mut problem = BundleProblem::default();
    let plain = PinholeRadialTangential::undistorted(500.0, 480.0, 320.0, 240.0);
    let (fx, fy, cx, cy) = (300.0, 310.0, 320.0, 240.0);
    for camera in [
        Camera::Pinhole(PinholeRadialTangential {
            k1: -0.1,
            k2: 0.02,
            p1: 0.001,
            p2: -0.002,
            k3: 0.003,
            ..plain
        }),
        Camera::Fisheye(KannalaBrandt { fx, fy, cx, cy, k1: 0.1, k2: -0.02, k3: 0.01, k4: 0.002 }),
        Camera::Snavely(Snavely { focal: 400.0, k1: -0.05, k2: 0.01 }),
    ] {
        problem.push_camera(camera, false);
    }
    for k in 0..4 {
        problem.push_pose(Se3::exp(&numbers(k, 0.4)));
    }
    for k in 0..12 {
        let z = if k == 5 { -4.0 } else { 4.0 };
        problem.push_landmark(numbers::<3>(100 + k, 1.5) + Vector3::new(0.0, 0.0, z));
    }
    for k in 0..24usize {
        let (pose, camera, landmark) = (k as u32 % 4, k as u32 % 3, k as u32 % 12);
        let pixel: Vector2<f64> = numbers(200 + k, 300.0);
        let sigma_px = 1.0 + 0.1 * k as f64;
        if k % 2 == 0 {
            problem.reprojections.push(pose, camera, landmark, pixel, sigma_px);
        } else {
            let (depth_m, sigma_depth_m) = (3.0, 0.05 * sigma_px);
            let factor = Reprojection { pixel, sigma_px, depth_m: Some((depth_m, sigma_depth_m)) };
            problem.push_observation(pose, camera, landmark, factor);
        }
    }
    for k in 0..3 {
        let i_from_j = Se3::exp(&numbers(300 + k, 1.0));
        let information = information(k);
        problem.relative_poses.push(RelativePose {
            i: k,
            j: k + 1,
            i_from_j,
            information,
            loss: None,
        });
        let world_from_camera = Se3::exp(&numbers(400 + k, 0.8));
        problem.pose_priors.push(PosePrior {
            pose: k,
            world_from_camera,
            information,
            loss: Loss::Trivial,
        });
        problem.position_priors.push(PositionPrior {
            pose: k,
            position_in_world: numbers(500 + k, 1.0),
            information: Information::identity(),
            point_in_camera: Vector3::zeros(),
            loss: Loss::Trivial,
        });
    }
    problem.observation_loss = Loss::Huber(3.0);
    problem.relative_pose_loss = Loss::Cauchy(0.5);
    problem
}

#[test]
fn agrees_with_the_factors_on_every_kind() {
    let problem = mixed_problem();
    let report = bundle_cost(&problem);
    let (poses, cameras, landmarks) = (&problem.poses, &problem.cameras, &problem.landmarks);
    let observed =
        |p: u32, c: u32, l: u32| (&poses[p as usize], &cameras[c as usize], &landmarks[l as usize]);
    let rho = |loss: Loss, s: f64| 0.5 * loss.evaluate(s).rho;
    let of_kind = |with_depth: bool| -> f64 {
        problem
            .observations()
            .filter(|o| o.seen.depth_m.is_some() == with_depth)
            .map(|o| {
                let (p, c, l) = observed(o.pose, o.camera, o.landmark);
                let residual = o.seen.residual(p, c, l).unwrap();
                rho(problem.observation_loss, residual.norm_squared())
            })
            .sum()
    };
    let (reprojection, depth_reprojection) = (of_kind(false), of_kind(true));
    let relative_pose: f64 = problem
        .relative_poses
        .iter()
        .map(|f| {
            let residual = f.residual(&poses[f.i], &poses[f.j]);
            rho(problem.relative_pose_loss, f.information.squared_norm(&residual))
        })
        .sum();
    let pose_prior: f64 = problem
        .pose_priors
        .iter()
        .map(|f| 0.5 * f.information.squared_norm(&f.linearize(&poses[f.pose]).0))
        .sum();
    let position_prior: f64 = problem
        .position_priors
        .iter()
        .map(|f| 0.5 * f.information.squared_norm(&f.linearize(&poses[f.pose]).0))
        .sum();
    for (part, count, cost) in [
        (report.reprojection, 12, reprojection),
        (report.depth_reprojection, 12, depth_reprojection),
        (report.relative_pose, 3, relative_pose),
        (report.pose_prior, 3, pose_prior),
        (report.position_prior, 3, position_prior),
    ] {
        assert_eq!(part.count, count);
        assert!(cost > 0.0 && (part.cost - cost).abs() <= 1e-12 * cost, "{} {cost}", part.cost);
    }
    let sum = reprojection + depth_reprojection + relative_pose + pose_prior + position_prior;
    assert!((report.total - sum).abs() <= 1e-12 * sum);
    assert_eq!(report.behind_camera, problem.behind_camera_count());
    assert!(report.behind_camera > 0);
}

/// Two poses and one edge whose residual is known by hand.
fn pair<G: LieGroup<N>, const N: usize>(
    world_from_j: G,
    information: Information<N>,
) -> PoseGraph<G, N> {
    let mut graph = PoseGraph::new();
    graph.push_pose(0, G::identity());
    graph.push_pose(1, world_from_j);
    graph.edges.push(RelativePose { i: 0, j: 1, i_from_j: G::identity(), information, loss: None });
    graph
}

#[test]
fn half_turns_and_tiny_turns_have_their_known_costs() {
    use std::f64::consts::PI;
    let cost = |tangent: [f64; 6]| {
        pose_graph_cost(&pair(Se3::exp(&SVector::from(tangent)), Information::identity())).total
    };
    for angle in [PI, PI - 1e-9, 1.0, 1e-3, 1e-5, 1e-8, 1e-12] {
        let found = cost([1.0, -2.0, 0.5, 0.0, angle, 0.0]);
        let expected = 0.5 * (5.25 + angle * angle);
        assert!((found - expected).abs() < 1e-12 * expected, "{angle}: {found} {expected}");
        let plane = pair(Se2::exp(&SVector::from([1.0, -2.0, angle])), Information::identity());
        let (found, expected) = (pose_graph_cost(&plane).total, 0.5 * (5.0 + angle * angle));
        assert!((found - expected).abs() < 1e-12 * expected, "{angle}: {found} {expected}");
    }
}

#[test]
fn losses_and_information_weigh_as_defined() {
    let information = Information::new(&SMatrix::<f64, 3, 3>::from_diagonal_element(4.0)).unwrap();
    let mut graph = pair(Se2::from_xy_angle(3.0, 0.0, 0.0), information);
    assert_eq!(pose_graph_cost(&graph).total, 18.0);
    // s = 36, so Huber with width 2 gives rho = 2 * 2 * 6 - 4 = 20.
    graph.loss = Loss::Huber(2.0);
    let report = pose_graph_cost(&graph);
    assert_eq!(
        (report.total, report.relative_pose.cost, report.relative_pose.count),
        (10.0, 10.0, 1)
    );
    assert_eq!((report.rmse_px, report.behind_camera), (0.0, 0));
}

#[test]
fn an_index_without_a_variable_is_not_a_panic() {
    let mut problem = mixed_problem();
    problem.reprojections.landmarks[0] = 99;
    assert!(bundle_cost(&problem).total.is_nan());
    let mut graph = pair(Se2::identity(), Information::identity());
    graph.edges[0].j = 5;
    assert!(pose_graph_cost(&graph).total.is_nan());
}
