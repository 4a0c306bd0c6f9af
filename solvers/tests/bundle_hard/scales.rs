//! Units and weights that are very large or very small.

use covis_solvers::bundle_adjustment::Options;
use covis_solvers::problem::BundleProblem;
use covis_solvers::testing::scene::{Scene, SceneOptions};
use nalgebra::Vector3;

use super::{Outcome, SOLVERS, run, scale, solve_honestly, window, windows};

/// Multiplies every standard deviation with `factor`.
fn scale_sigmas(problem: &mut BundleProblem, factor: f64) {
    let (plain, depth) = (&mut problem.reprojections, &mut problem.depth_reprojections);
    let pixels = plain.sigmas_px.iter_mut().chain(&mut depth.sigmas_px);
    pixels.chain(&mut depth.sigmas_depth_m).for_each(|sigma| *sigma *= factor);
}

fn costs(outcome: &Outcome) -> Vec<f64> {
    outcome.summary.solve.iterations.iter().map(|row| row.cost).collect()
}

#[test]
fn the_unit_of_length_does_not_change_the_steps() {
    for (name, problem) in windows() {
        let in_meters = solve_honestly(name, &problem);
        for factor in [1e-6, 1e-3, 1e3, 1e6] {
            let mut scaled = problem.clone();
            scale(&mut scaled, factor);
            let case = format!("{name} in units of {factor:e}");
            for (here, there) in in_meters.iter().zip(&solve_honestly(&case, &scaled)) {
                let (here, there) = (costs(here), costs(there));
                assert_eq!(here.len(), there.len(), "{case}");
                for (a, b) in here.iter().zip(&there) {
                    assert!((a / b - 1.0).abs() < 1e-6, "{case}: {a} {b}");
                }
            }
        }
    }
}

#[test]
fn scenes_of_a_nanometer_and_of_a_million_kilometers_reach_the_same_cost() {
    for (name, problem) in windows() {
        let in_meters = solve_honestly(name, &problem);
        for factor in [1e-9, 1e9] {
            let mut scaled = problem.clone();
            scale(&mut scaled, factor);
            let case = format!("{name} in units of {factor:e}");
            for (here, there) in in_meters.iter().zip(&solve_honestly(&case, &scaled)) {
                assert!(there.is_converged(), "{case}");
                assert!((here.cost() / there.cost() - 1.0).abs() < 1e-6, "{case}");
            }
        }
    }
}

#[test]
fn far_from_the_origin() {
    for (name, problem) in windows() {
        let here = solve_honestly(name, &problem);
        let mut far = problem.clone();
        let offset = Vector3::new(5e5, 4.2e6, 1e3);
        far.poses.iter_mut().for_each(|pose| pose.translation += offset);
        far.landmarks.iter_mut().for_each(|landmark| *landmark += offset);
        for (here, there) in here.iter().zip(&solve_honestly("earth-centered", &far)) {
            assert!((here.cost() / there.cost() - 1.0).abs() < 1e-6, "{name}");
        }
    }
}

#[test]
fn sigmas_of_any_size() {
    for (name, problem) in windows() {
        let plain = solve_honestly(name, &problem);
        for factor in [1e-6, 1e3, 1e6, 1e9] {
            let mut weighted = problem.clone();
            scale_sigmas(&mut weighted, factor);
            let case = format!("{name}, sigmas times {factor:e}");
            for (one, other) in plain.iter().zip(&solve_honestly(&case, &weighted)) {
                // The weaker the measurements, the sooner the gradient is small.
                let cost = other.cost() * factor * factor;
                assert!(cost < one.cost() * 1.001 || factor > 1e6, "{case}: {cost}");
            }
        }
    }
}

#[test]
fn sigmas_of_all_sizes_in_one_problem() {
    for (name, mut problem) in windows() {
        let (plain, depth) = (&mut problem.reprojections, &mut problem.depth_reprojections);
        let sigmas = plain.sigmas_px.iter_mut().chain(&mut depth.sigmas_px);
        for (k, sigma) in sigmas.enumerate() {
            *sigma *= [1e-6, 1.0, 1e6][k % 3];
        }
        solve_honestly(&format!("{name}, mixed sigmas"), &problem);
    }
}

#[test]
fn large_scenes_with_weak_measurements() {
    for (length, sigma) in [(1e6, 1e3), (1e6, 1e6), (1e-6, 1e-6), (1e3, 1e6), (1e9, 1e3)] {
        for (name, mut problem) in windows() {
            scale(&mut problem, length);
            scale_sigmas(&mut problem, sigma);
            solve_honestly(&format!("{name}, {length:e} m, sigmas times {sigma:e}"), &problem);
        }
    }
}

#[test]
fn exact_measurements_converge_however_sharp_they_are() {
    // What is left are residuals of rounding: large in units of sigma, and with no way down.
    let exact = SceneOptions { sigma_px: 1e-12, sigma_depth_m: 1e-15, ..window() };
    let mut problem = Scene::generate(&exact).to_problem();
    for sigma in [1.0, 1e-3, 1e-6, 1e-9] {
        problem.depth_reprojections.sigmas_px.fill(sigma);
        problem.depth_reprojections.sigmas_depth_m.fill(1e-2 * sigma);
        for linear_solver in SOLVERS {
            let outcome = run(&problem, &Options { linear_solver, ..Options::default() });
            let summary = &outcome.summary.solve;
            let case = format!("{sigma:e} px, {linear_solver:?}: {}", summary.termination);
            assert!(outcome.is_converged() && summary.iterations.len() < 40, "{case}");
            assert!(outcome.cost() * sigma * sigma < 1e-18, "{case}: {:e}", outcome.cost());
        }
    }
}
