//! Motion-only refinement: recovery, robustness, prior, bad input, instruction sets.

mod cross_checks;
mod ends;

use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3};
use covis_solvers::information::Information;
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::ignore_iterations;
use covis_solvers::pose_refinement::{Options, PointObservation, Prior, Refined, refine};
use covis_solvers::problem::SolveError;
use covis_solvers::simd::Class;
use covis_solvers::testing::random::{element, normal_vector, seeded, uniform_vector};
use nalgebra::{SVector, Vector2, Vector3};

fn camera() -> Camera {
    PinholeRadialTangential::undistorted(500.0, 500.0, 320.0, 240.0).into()
}

fn observations(truth: &Se3, count: usize, sigma_px: f64, depth: bool) -> Vec<PointObservation> {
    let mut rng = seeded(5);
    (0..count)
        .map(|_| {
            let side: SVector<f64, 3> = uniform_vector(&mut rng, 1.0);
            let depth_m = 4.0 + 2.0 * side.z;
            let in_camera = Vector3::new(0.5 * side.x * depth_m, 0.4 * side.y * depth_m, depth_m);
            let noise: Vector2<f64> = normal_vector(&mut rng, sigma_px);
            PointObservation {
                point_in_world: truth.transform(&in_camera),
                pixel: camera().project(&in_camera).unwrap() + noise,
                sigma_px: sigma_px.max(0.5),
                depth_m: depth.then_some((depth_m, 0.01)),
            }
        })
        .collect()
}

fn run(start: &Se3, observations: &[PointObservation], options: &Options) -> Refined {
    refine(&camera(), start, observations, None, options, &mut ignore_iterations).unwrap()
}

#[test]
fn recovers_the_pose_with_and_without_depth() {
    let mut rng = seeded(1);
    let truth: Se3 = element(&mut rng, 0.5);
    let start = truth.plus(&normal_vector(&mut rng, 0.05));
    for depth in [false, true] {
        let exact = run(&start, &observations(&truth, 40, 0.0, depth), &Options::default());
        assert!(exact.summary.termination.is_converged(), "{:?}", exact.summary.termination);
        assert!(exact.world_from_camera.minus(&truth).norm() < 1e-9);
        assert_eq!(exact.behind_camera, vec![false; 40]);
    }
}

#[test]
fn information_predicts_the_error_of_a_noisy_pose() {
    let truth = Se3::identity();
    let noisy = run(&truth, &observations(&truth, 300, 0.5, false), &Options::default());
    let error = noisy.world_from_camera.minus(&truth);
    let mahalanobis = error.dot(&(noisy.information * error));
    // χ² with 6 degrees of freedom: beyond 27 once in 10,000 draws; the seed is fixed.
    assert!((0.2..27.0).contains(&mahalanobis), "{mahalanobis}");
}

#[test]
fn a_robust_loss_ignores_wrong_matches() {
    let truth = Se3::identity();
    let mut wrong = observations(&truth, 100, 0.0, false);
    for (k, o) in wrong.iter_mut().enumerate().filter(|(k, _)| k % 5 == 0) {
        o.pixel.x += 40.0 + k as f64;
    }
    let start = truth.plus(&SVector::from([0.02, 0.0, 0.01, 0.01, 0.0, -0.01]));
    let plain = run(&start, &wrong, &Options::default());
    let robust = run(&start, &wrong, &Options { loss: Loss::Cauchy(1.0), ..Options::default() });
    let error = |r: &Refined| r.world_from_camera.minus(&truth).norm();
    assert!(error(&robust) < 1e-3 && error(&plain) > 10.0 * error(&robust));
    assert!(robust.squared_errors[0] > 1000.0 && robust.squared_errors[1] < 1.0);
}

#[test]
fn a_prior_holds_what_the_observations_leave_open() {
    let truth = Se3::identity();
    let one = observations(&truth, 1, 0.0, false);
    let prior = Prior { world_from_camera: truth, information: Information::identity() };
    let start = truth.plus(&SVector::from([0.05, 0.0, 0.02, 0.01, 0.02, 0.0]));
    let refined =
        refine(&camera(), &start, &one, Some(&prior), &Options::default(), &mut ignore_iterations)
            .unwrap();
    assert!(refined.world_from_camera.minus(&truth).norm() < 1e-6);
}

#[test]
fn bad_input_is_named() {
    let truth = Se3::identity();
    let check = |change: &dyn Fn(&mut Vec<PointObservation>)| {
        let mut list = observations(&truth, 5, 0.0, true);
        change(&mut list);
        refine(&camera(), &truth, &list, None, &Options::default(), &mut ignore_iterations)
            .unwrap_err()
    };
    assert!(matches!(check(&|l| l.clear()), SolveError::Empty(_)));
    let index = 2;
    assert_eq!(
        check(&|l| l[2].pixel.x = f64::NAN),
        SolveError::NotFinite { what: "observation", index: 2 }
    );
    let factor = "observation";
    assert_eq!(check(&|l| l[2].sigma_px = 0.0), SolveError::NotPositiveDefinite { factor, index });
    assert_eq!(
        check(&|l| l[2].point_in_world = Vector3::new(1.0, 0.0, 0.0)),
        SolveError::ResidualNotFinite { factor, index }
    );
    assert_eq!(
        check(&|l| l[2].depth_m = Some((1.0, f64::INFINITY))),
        SolveError::NotPositiveDefinite { factor, index }
    );
    // The first of several is named.
    assert_eq!(
        check(&|l| {
            l[2].point_in_world.z = 0.0;
            l[3].depth_m = Some((f64::NAN, 1.0));
            l[4].sigma_px = -1.0;
        }),
        SolveError::ResidualNotFinite { factor, index }
    );
}

#[test]
fn every_instruction_set_takes_the_same_steps() {
    let mut rng = seeded(3);
    let truth: Se3 = element(&mut rng, 0.5);
    let start = truth.plus(&normal_vector(&mut rng, 0.1));
    for (depth, loss) in [(false, Loss::Trivial), (true, Loss::Huber(1.0))] {
        let list = observations(&truth, 83, 0.5, depth);
        let with = |class| run(&start, &list, &Options { loss, class, ..Options::default() });
        let costs =
            |r: &Refined| -> Vec<f64> { r.summary.iterations.iter().map(|row| row.cost).collect() };
        let scalar = with(Some(Class::Scalar));
        let mut vectors = Vec::new();
        for class in [Class::Avx2, Class::Avx512, Class::Neon] {
            if !class.is_available() {
                continue;
            }
            let found = with(Some(class));
            for (a, b) in costs(&found).iter().zip(costs(&scalar)) {
                assert!((a / b - 1.0).abs() < 1e-10, "{class}: {a} {b}");
            }
            assert!(found.world_from_camera.minus(&scalar.world_from_camera).norm() < 1e-9);
            vectors.push(found);
        }
        for pair in vectors.windows(2) {
            assert_same_bits(&pair[0], &pair[1]);
        }
    }
}

/// All but times and the number of threads.
fn assert_same_bits(a: &Refined, b: &Refined) {
    assert_eq!(a.world_from_camera, b.world_from_camera);
    assert_eq!(a.information, b.information);
    assert_eq!(a.squared_errors, b.squared_errors);
    assert_eq!(a.behind_camera, b.behind_camera);
    let rows = |r: &Refined| -> Vec<_> {
        r.summary.iterations.iter().map(|x| (x.cost, x.accepted, x.step_norm, x.damping)).collect()
    };
    assert_eq!(rows(a), rows(b));
    assert_eq!(a.summary.termination, b.summary.termination);
}

#[test]
fn a_far_start_ends_no_worse_than_it_began() {
    let truth = Se3::identity();
    let list = observations(&truth, 60, 0.5, false);
    let mut rng = seeded(9);
    let mut rejected = 0;
    for _ in 0..20 {
        let start = truth.plus(&normal_vector(&mut rng, 0.8));
        for loss in [Loss::Trivial, Loss::Tukey(4.0), Loss::GemanMcClure(4.0)] {
            let end = run(&start, &list, &Options { loss, ..Options::default() });
            assert!(end.summary.final_cost <= end.summary.initial_cost);
            rejected += end.summary.iterations.iter().filter(|row| !row.accepted).count();
            // What is told of the end is what a fresh call finds there.
            let mut options = Options { loss, ..Options::default() };
            options.optimizer.max_iterations = 0;
            let again = run(&end.world_from_camera, &list, &options);
            assert_eq!(again.summary.initial_cost, end.summary.final_cost);
            assert_eq!(again.information, end.information);
            assert_eq!(again.squared_errors, end.squared_errors);
        }
    }
    assert!(rejected > 0, "the starts were meant to be far");
}
