//! How refinement ends where there is little to find: always, with finite numbers, and no worse than
//! it began.

use covis_solvers::geometry::{LieGroup, Se3};
use covis_solvers::loss::Loss;
use covis_solvers::optimizer::{Method, Termination, Tolerance, ignore_iterations};
use covis_solvers::pose_refinement::{Options, PointObservation, Refined, refine};
use covis_solvers::problem::SolveError;
use covis_solvers::simd::Class;
use covis_solvers::testing::random::{normal_vector, seeded};
use nalgebra::{SMatrix, SVector, Vector2};

use super::{camera, observations};

const LOSSES: [Loss; 5] =
    [Loss::Trivial, Loss::Huber(2.0), Loss::Cauchy(2.0), Loss::Tukey(5.0), Loss::GemanMcClure(3.0)];

fn start() -> Se3 {
    Se3::identity().plus(&SVector::from([0.05, -0.02, 0.02, 0.01, 0.02, -0.01]))
}

/// Refines under every loss, method and instruction set, and checks what holds of every end.
fn ends(start: &Se3, list: &[PointObservation]) -> Vec<Result<Refined, SolveError>> {
    let mut all = Vec::new();
    for loss in LOSSES {
        for method in [Method::LevenbergMarquardt, Method::GaussNewton] {
            for class in [None, Some(Class::Scalar)] {
                let mut options = Options { loss, class, ..Options::default() };
                options.optimizer.method = method;
                let end = refine(&camera(), start, list, None, &options, &mut ignore_iterations);
                if let Ok(end) = &end {
                    check(end, list.len(), &options);
                }
                all.push(end);
            }
        }
    }
    all
}

fn check(end: &Refined, count: usize, options: &Options) {
    let Refined { world_from_camera: pose, summary, .. } = end;
    let what = format!("{:?} {:?}", options, summary.termination);
    assert!(pose.is_finite(), "{what}");
    assert!(summary.iterations.len() <= options.optimizer.max_iterations + 1, "{what}");
    assert!(summary.final_cost <= summary.initial_cost, "{what}");
    assert_eq!((end.squared_errors.len(), end.behind_camera.len()), (count, count), "{what}");
    assert!(end.squared_errors.iter().all(|s| *s >= 0.0), "{what}");
    if summary.termination.is_converged() {
        assert!(summary.final_cost.is_finite() && summary.gradient_max_norm.is_finite(), "{what}");
        assert!(end.information.iter().all(|x| x.is_finite()), "{what}");
    }
}

#[test]
fn too_few_observations_still_end() {
    for depth in [false, true] {
        for count in 1..=3 {
            let list = observations(&Se3::identity(), count, 0.5, depth);
            for end in ends(&start(), &list) {
                end.unwrap();
            }
        }
    }
}

#[test]
fn the_same_observation_again_and_again_still_ends() {
    let list = [observations(&Se3::identity(), 1, 0.5, true)[0]; 50];
    for end in ends(&start(), &list) {
        end.unwrap();
    }
}

#[test]
fn landmarks_behind_the_camera_count_and_are_reported() {
    let mut list = observations(&Se3::identity(), 40, 0.5, false);
    for o in &mut list {
        // Through the center: the same pixel, from behind.
        o.point_in_world = -o.point_in_world;
    }
    for end in ends(&start(), &list) {
        let end = end.unwrap();
        assert_eq!(end.behind_camera, vec![true; 40]);
    }
}

#[test]
fn landmarks_around_the_center_plane_still_end() {
    let mut rng = seeded(21);
    for scale in [1.0, 1e-3, 1e-9] {
        let mut list = observations(&Se3::identity(), 24, 0.5, false);
        for o in &mut list {
            let noise: SVector<f64, 1> = normal_vector(&mut rng, scale);
            o.point_in_world.z = noise.x;
        }
        for end in ends(&Se3::identity(), &list) {
            end.unwrap();
        }
    }
}

#[test]
fn nothing_but_outliers_still_ends() {
    let mut rng = seeded(22);
    let mut list = observations(&Se3::identity(), 64, 0.5, false);
    for o in &mut list {
        let noise: Vector2<f64> = normal_vector(&mut rng, 1e4);
        o.pixel += noise;
    }
    for end in ends(&start(), &list) {
        end.unwrap();
    }
}

#[test]
fn a_loss_that_gives_up_every_observation_leaves_the_start_without_information() {
    let mut list = observations(&Se3::identity(), 20, 0.0, false);
    for o in &mut list {
        o.pixel.x += 1e4;
    }
    let options = Options { loss: Loss::Tukey(3.0), ..Options::default() };
    let end = refine(&camera(), &start(), &list, None, &options, &mut ignore_iterations).unwrap();
    assert_eq!(end.world_from_camera, start());
    assert_eq!(end.summary.termination, Termination::Converged(Tolerance::Gradient));
    assert_eq!(end.information, SMatrix::<f64, 6, 6>::zeros());
}

#[test]
fn huge_and_tiny_numbers_still_end() {
    let plain = observations(&Se3::identity(), 30, 0.5, true);
    let with = |change: &dyn Fn(&mut PointObservation)| {
        let mut list = plain.clone();
        list.iter_mut().for_each(change);
        list
    };
    for exponent in [6, 20, 80, 150, 300] {
        for scale in [10f64.powi(exponent), 10f64.powi(-exponent)] {
            let changed = [
                with(&|o| o.point_in_world *= scale),
                with(&|o| o.sigma_px *= scale),
                with(&|o| o.pixel *= scale),
                with(&|o| o.depth_m = o.depth_m.map(|(d, s)| (d * scale, s * scale))),
                with(&|o| o.depth_m = o.depth_m.map(|(d, s)| (d, s * scale))),
            ];
            for list in &changed {
                for end in ends(&start(), list) {
                    // What cannot be squared is refused at the start, by name.
                    let factor = "observation";
                    if let Err(error) = end {
                        assert_eq!(error, SolveError::ResidualNotFinite { factor, index: 0 });
                        assert!(exponent >= 80, "{scale:e}");
                    }
                }
            }
        }
    }
}

#[test]
fn a_world_far_from_its_origin_gives_the_same_pose() {
    // Kilometers off, as maps in a projected coordinate system are.
    let away = SVector::from([4.2e5, -1.3e6, 800.0, 0.0, 0.0, 0.0]);
    let there = Se3::exp(&away);
    let near = observations(&Se3::identity(), 60, 0.5, true);
    let mut far = near.clone();
    for o in &mut far {
        o.point_in_world = there.transform(&o.point_in_world);
    }
    let options = Options::default();
    let solve = |start: &Se3, list: &[PointObservation]| {
        refine(&camera(), start, list, None, &options, &mut ignore_iterations).unwrap()
    };
    let (a, b) = (solve(&start(), &near), solve(&there.compose(&start()), &far));
    assert!(b.summary.termination.is_converged());
    assert!(b.world_from_camera.minus(&there.compose(&a.world_from_camera)).norm() < 1e-7);
}
