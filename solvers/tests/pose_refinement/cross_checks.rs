//! Refinement against code that shares none of its kernels: the evaluator, Gauss-Newton over the
//! factors, and bundle adjustment with known landmarks.

use covis_solvers::bundle_adjustment;
use covis_solvers::evaluation::bundle_cost;
use covis_solvers::factors::Reprojection;
use covis_solvers::geometry::{
    Camera, KannalaBrandt, LieGroup, PinholeRadialTangential, Se3, Snavely,
};
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::pose_refinement::{Options, PointObservation, Refined, refine};
use covis_solvers::problem::BundleProblem;
use covis_solvers::testing::random::{element, normal_vector, seeded, uniform_vector};
use nalgebra::{SMatrix, SVector, Vector2, Vector3};

/// A pose to be refined.
struct Case {
    name: String,
    camera: Camera,
    start: Se3,
    observations: Vec<PointObservation>,
    loss: Loss,
}

fn cameras() -> [Camera; 4] {
    let [fx, fy, cx, cy] = [500.0, 510.0, 320.0, 240.0];
    let plain = PinholeRadialTangential::undistorted(fx, fy, cx, cy);
    let [k1, k2, p1, p2, k3] = [-0.2, 0.05, 1e-3, -2e-3, 0.01];
    [
        plain.into(),
        PinholeRadialTangential { k1, k2, p1, p2, k3, ..plain }.into(),
        Snavely { focal: 520.0, k1: -0.05, k2: 0.01 }.into(),
        KannalaBrandt { fx, fy, cx, cy, k1: 0.02, k2: -0.004, k3: 0.001, k4: 0.0 }.into(),
    ]
}

/// Every camera model, without depths, with some and with all, plain and robust.
fn cases() -> Vec<Case> {
    let mut rng = seeded(17);
    let mut cases = Vec::new();
    for (model, camera) in cameras().into_iter().enumerate() {
        for depth_every in [0, 3, 1] {
            for loss in [Loss::Trivial, Loss::Huber(1.0), Loss::Cauchy(2.0)] {
                let truth: Se3 = element(&mut rng, 0.7);
                let observations = (0_u32..77)
                    .map(|k| {
                        let side: SVector<f64, 3> = uniform_vector(&mut rng, 1.0);
                        let depth_m = 4.0 + 2.0 * side.z;
                        let in_camera =
                            Vector3::new(0.5 * side.x * depth_m, 0.4 * side.y * depth_m, depth_m);
                        let noise: Vector2<f64> = normal_vector(&mut rng, 0.7);
                        PointObservation {
                            point_in_world: truth.transform(&in_camera),
                            pixel: camera.project(&in_camera).unwrap() + noise,
                            sigma_px: 0.6 + 0.1 * f64::from(k % 4),
                            depth_m: (depth_every > 0 && k % depth_every == 0)
                                .then_some((depth_m + 0.02 * side.x, 0.02)),
                        }
                    })
                    .collect();
                cases.push(Case {
                    name: format!("model {model}, depth every {depth_every}, {loss:?}"),
                    camera,
                    start: truth.plus(&normal_vector(&mut rng, 0.02)),
                    observations,
                    loss,
                });
            }
        }
    }
    cases
}

impl Case {
    fn refine(&self) -> Refined {
        let options = Options { loss: self.loss, ..Options::default() };
        let observer = &mut ignore_iterations;
        let Self { camera, start, observations, .. } = self;
        let refined = refine(camera, start, observations, None, &options, observer).unwrap();
        assert!(refined.summary.termination.is_converged(), "{}", self.name);
        refined
    }

    /// The same problem with everything but the pose held.
    fn as_bundle(&self, pose: Se3) -> BundleProblem {
        let mut problem = BundleProblem { observation_loss: self.loss, ..BundleProblem::default() };
        problem.push_pose(pose);
        problem.push_camera(self.camera, true);
        for (index, o) in (0u32..).zip(&self.observations) {
            problem.push_landmark(o.point_in_world);
            problem.push_observation(0, 0, index, factor(o));
        }
        problem.constant_landmarks.fill(true);
        problem
    }
}

fn factor(o: &PointObservation) -> Reprojection {
    Reprojection { pixel: o.pixel, sigma_px: o.sigma_px, depth_m: o.depth_m }
}

#[test]
fn costs_are_the_evaluators() {
    for case in cases() {
        let refined = case.refine();
        let check = |pose: Se3, cost: f64| {
            let report = bundle_cost(&case.as_bundle(pose));
            assert!((cost / report.total - 1.0).abs() < 1e-12, "{}: {cost}", case.name);
            report
        };
        check(case.start, refined.summary.initial_cost);
        let report = check(refined.world_from_camera, refined.summary.final_cost);
        let behind = refined.behind_camera.iter().filter(|behind| **behind).count();
        assert_eq!(behind, report.behind_camera, "{}", case.name);
        if case.loss == Loss::Trivial {
            let sum: f64 = refined.squared_errors.iter().sum();
            assert!((0.5 * sum / report.total - 1.0).abs() < 1e-12, "{}", case.name);
        }
    }
}

#[test]
fn bundle_adjustment_with_known_landmarks_finds_the_same_pose() {
    for case in cases() {
        let refined = case.refine();
        let mut problem = case.as_bundle(case.start);
        let options = bundle_adjustment::Options::default();
        let summary =
            bundle_adjustment::solve(&mut problem, &options, &mut ignore_iterations).unwrap();
        let apart = problem.poses[0].minus(&refined.world_from_camera).norm();
        assert!(apart < 1e-5, "{}: {apart:e} apart", case.name);
        let ratio = summary.solve.final_cost / refined.summary.final_cost;
        assert!((ratio - 1.0).abs() < 1e-8, "{}: {ratio}", case.name);
    }
}

#[test]
fn gauss_newton_over_the_factors_finds_the_same_pose_and_information() {
    for case in cases() {
        let refined = case.refine();
        let mut pose = case.start;
        let mut hessian = SMatrix::<f64, 6, 6>::zeros();
        for _ in 0..60 {
            let mut sums = (SMatrix::zeros(), SVector::<f64, 6>::zeros());
            for o in &case.observations {
                let lin = factor(o).linearize(&pose, &case.camera, &o.point_in_world).unwrap();
                let weight = case.loss.evaluate(lin.residual.norm_squared()).weight;
                sums.0 += lin.d_pose.transpose() * lin.d_pose * weight;
                sums.1 += lin.d_pose.transpose() * lin.residual * weight;
            }
            hessian = sums.0;
            pose = pose.plus(&-hessian.cholesky().unwrap().solve(&sums.1));
        }
        // How far a pose may be off is measured by the cost: ½ δᵀHδ.
        let apart = refined.world_from_camera.minus(&pose);
        let worth = 0.5 * apart.dot(&(hessian * apart));
        assert!(worth < 1e-8 * refined.summary.final_cost, "{}: {worth:e}", case.name);
        let off = (refined.information - hessian).amax() / hessian.amax();
        assert!(off < 1e-4, "{}: information off by {off:e}", case.name);
    }
}
