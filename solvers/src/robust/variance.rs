//! How much larger the errors of odometry and of loop closures are than their information claims.
//!
//! A closure and the odometry between its ends make a loop whose error is normal with covariance
//! c Σ_closure + t Σ_odometry, if the stated covariances are right up to the variance factors c and t.
//! Long loops tell t, short ones c. The factors are those of highest posterior probability: a Student
//! likelihood, so that false closures decide nothing, and a prior on their logarithms, so that a few
//! closures decide little. Uses measurements and ids, never poses: the result is a function of what was
//! measured (variance component estimation; Lange, Little and Taylor 1989 for the likelihood).

use nalgebra::SVector;

use super::chain::{Chain, UncertainMotion};
use crate::geometry::LieGroup;
use crate::information::eigen;
use crate::problem::PoseGraph;

/// Degrees of freedom of the Student likelihood: with 3 the influence of an error falls from 3 standard
/// deviations on, and a tenth of false closures changes no factor by more than 2 in σ.
const STUDENT_FREEDOM: f64 = 3.0;

/// Most likely ln t before any closure is seen. The formal covariance of odometry leaves out what is
/// common to many observations (calibration, rolling shutter), by a factor of two in σ as a rule.
const ODOMETRY_MEAN: f64 = 1.386_294_361_119_890_6;

/// Standard deviation of ln c and ln t before any closure is seen.
const PRIOR_SPREAD: f64 = 1.0;

/// The largest logarithm of a factor that is tried: σ may be a hundred times too small.
const LARGEST: f64 = 9.25;

/// Steps of the search, the first of them the grid of starts.
const STEPS: [f64; 6] = [1.0, 0.5, 0.25, 0.125, 0.0625, 0.03125];

/// What covariances have to be multiplied by.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VarianceFactors {
    /// Of the odometry; at least 1.
    pub odometry: f64,
    /// Of the loop closures; at least 1.
    pub closures: f64,
}

/// The error of a loop in the basis in which both covariances are diagonal: Σ_closure is the identity.
struct Loop<const N: usize> {
    error: SVector<f64, N>,
    /// Variances of the odometry.
    odometry: SVector<f64, N>,
}

/// The variance factors of each group of closures, edges of `graph`, and of the odometry between their
/// ends. Closures without odometry between their ends are ignored.
#[must_use]
pub fn variance_factors<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
    groups: &[Vec<usize>],
) -> Vec<VarianceFactors> {
    let measured = match groups.iter().all(Vec::is_empty) {
        true => Vec::new(),
        false => UncertainMotion::all(graph),
    };
    let chain = Chain::new(graph, &measured);
    let loops = |group: &Vec<usize>| -> Vec<Loop<N>> {
        group.iter().filter_map(|&edge| loop_of(graph, &chain, edge)).collect()
    };
    groups.iter().map(|group| most_probable(&loops(group))).collect()
}

fn loop_of<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
    chain: &Chain<'_, G, N>,
    edge: usize,
) -> Option<Loop<N>> {
    let edge = graph.edges.get(edge)?;
    let closure = UncertainMotion::of(edge)?;
    let odometry = chain.between(graph.ids[edge.i], graph.ids[edge.j])?;
    let error = odometry.motion.inverse().compose(&closure.motion).log();
    let root = closure.covariance.cholesky()?;
    let whiten = |matrix| root.l_dirty().solve_lower_triangular(&matrix);
    let half = whiten(odometry.covariance)?;
    let (variances, basis) = eigen(&whiten(half.transpose())?);
    let error = basis.transpose() * root.l_dirty().solve_lower_triangular(&error)?;
    let is_finite = error.iter().chain(variances.iter()).all(|x| x.is_finite());
    is_finite.then_some(Loop { error, odometry: variances.map(|x| x.max(0.0)) })
}

/// −ln of the posterior density at ln t and ln c, without constants.
fn penalty<const N: usize>(loops: &[Loop<N>], [odometry, closures]: [f64; 2]) -> f64 {
    let (t, c) = (odometry.exp(), closures.exp());
    let of_loop = |errors: &Loop<N>| {
        let mut chi2 = 0.0;
        let mut determinant = 1.0;
        for (error, variance) in errors.error.iter().zip(&errors.odometry) {
            let variance = c + t * variance;
            chi2 += error * error / variance;
            determinant *= variance;
        }
        let freedom = STUDENT_FREEDOM + N as f64;
        0.5 * determinant.ln() + 0.5 * freedom * (chi2 / STUDENT_FREEDOM).ln_1p()
    };
    let prior = |x: f64| 0.5 * (x / PRIOR_SPREAD).powi(2);
    loops.iter().map(of_loop).sum::<f64>() + prior(odometry - ODOMETRY_MEAN) + prior(closures)
}

/// The factors of the least penalty: of a grid, then of ever smaller steps from there.
fn most_probable<const N: usize>(loops: &[Loop<N>]) -> VarianceFactors {
    let mut best = [ODOMETRY_MEAN, 0.0];
    let mut least = penalty(loops, best);
    let mut consider = |best: &mut [f64; 2], at: [f64; 2]| {
        let value = penalty(loops, at);
        let is_less = value < least;
        if is_less {
            (least, *best) = (value, at);
        }
        is_less
    };
    if !loops.is_empty() {
        let grid = |k: u8| f64::from(k) * STEPS[0];
        for (t, c) in (0..10).flat_map(|t| (0..10).map(move |c| (t, c))) {
            consider(&mut best, [grid(t), grid(c)]);
        }
        for step in &STEPS[1..] {
            loop {
                let [t, c] = best;
                let mut is_better = false;
                for (x, y) in
                    [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0), (1.0, -1.0), (-1.0, 1.0)]
                {
                    let within = |value: f64| value.clamp(0.0, LARGEST);
                    is_better |= consider(&mut best, [within(t + x * step), within(c + y * step)]);
                }
                if !is_better {
                    break;
                }
            }
        }
    }
    let [odometry, closures] = best.map(f64::exp);
    VarianceFactors { odometry, closures }
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector6;

    use super::*;
    use crate::factors::RelativePose;
    use crate::geometry::Se3;
    use crate::information::Information;
    use crate::testing::random::{element, perturbed, seeded};

    /// Odometry of 200 steps and a closure every third, whose errors are `odometry` and `closures` times
    /// what their information claims; each `false_every`-th closure is wrong.
    fn made(odometry: f64, closures: f64, false_every: usize) -> VarianceFactors {
        let mut rng = seeded(11);
        let mut graph: PoseGraph<Se3, 6> = PoseGraph::new();
        let step = Vector6::new(0.01, 0.01, 0.01, 0.002, 0.002, 0.002);
        let closure = Vector6::new(0.03, 0.03, 0.03, 0.01, 0.01, 0.01);
        let mut truth = vec![Se3::identity()];
        graph.push_pose(0, Se3::identity());
        for k in 1..200 {
            let motion: Se3 = element(&mut rng, 0.1);
            truth.push(truth[k - 1].compose(&motion));
            let j = graph.push_pose(k as i64, Se3::identity());
            let i_from_j = perturbed(&mut rng, &motion, &(step * odometry));
            let information = Information::from_sigmas(&step).unwrap();
            graph.edges.push(RelativePose { i: j - 1, j, i_from_j, information, loss: None });
        }
        let mut group = Vec::new();
        for (count, j) in (20..200).step_by(3).enumerate() {
            let i = (j * 7) % (j - 10);
            let motion = truth[i].inverse().compose(&truth[j]);
            let mut i_from_j = perturbed(&mut rng, &motion, &(closure * closures));
            if count % false_every == 0 {
                i_from_j = i_from_j.compose(&element(&mut rng, 1.0));
            }
            let information = Information::from_sigmas(&closure).unwrap();
            group.push(graph.edges.len());
            graph.edges.push(RelativePose { i, j, i_from_j, information, loss: None });
        }
        variance_factors(&graph, &[group])[0]
    }

    #[test]
    fn factors_are_found_whatever_they_are_and_beside_false_closures() {
        for false_every in [usize::MAX, 10] {
            for (odometry, closures) in [(1.0, 1.0), (3.0, 1.0), (1.0, 5.0), (3.0, 16.0)] {
                let found = made(odometry, closures, false_every);
                let close = |found: f64, true_factor: f64| {
                    found.sqrt() < 2.0 * true_factor && found.sqrt() > true_factor / 2.0
                };
                let told = format!("{odometry} {closures} {false_every}: {found:?}");
                assert!(close(found.closures, closures), "{told}");
                assert!(close(found.odometry, odometry), "{told}");
            }
        }
    }

    #[test]
    fn without_closures_the_information_of_closures_is_believed() {
        let graph: PoseGraph<Se3, 6> = PoseGraph::new();
        let [factors] = variance_factors(&graph, &[Vec::new()])[..] else { panic!() };
        assert_eq!(factors.closures, 1.0);
    }
}
