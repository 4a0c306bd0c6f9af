//! What can be wrong with a pose that matches agree on: chance, a degenerate scene, a second pose, the
//! odometry.
//!
//! Each check returns its reason to refuse. None changes the pose.

use std::f64::consts::PI;

use nalgebra::{Matrix2, Matrix3, Matrix6, Vector2, Vector3};

use super::consensus::{Problem, Projected, gate};
use super::refusal::Refusal;
use super::sampling::Numbers;
use super::{Expected, Feature, Input, MIN_INLIERS, Options, patches};
use crate::geometry::{LieGroup, Se3, So3};
use crate::order;
use crate::relative_motion::squared_error;

/// Expected number of poses, among all that samples can make, that wrong matches give so many inliers.
const FALSE_ALARMS: f64 = 1e-6;
/// Fewest inliers that are evidence of their own: three determine a pose, and as many contradict it.
const MIN_INDEPENDENT: usize = 6;
/// Points whose deviation across a line is a smaller share of that along it: a turn about the line then
/// rests on what a twentieth of the length shows.
const ONE_LINE: f64 = 0.05;
/// A region of a fifth of the width by a fifth of the height is one thing rather than a place.
const SMALL_REGION: f64 = 0.04;
/// Points whose thickness is a smaller share of their width may be on a plane.
const PLANE: f64 = 0.1;
/// χ² by which a mirrored pose must be worse: the 99 % quantile with two degrees of freedom, those of the
/// plane's normal.
const MIRRORED: f64 = 9.21;
/// Largest standard deviations: 0.1 rad, above which the tangent is no picture of the pose, and a tenth
/// of the distance.
const LOOSE: f64 = 0.1;
/// Share of the best pose's weight from which another one makes it ambiguous: where a pattern repeats
/// itself the two are about equal; what moves before a background has less.
const RIVAL: f64 = 0.6;
/// Share of what a pose shows on which matches must be as frequent as around the inliers. Half of it may be
/// hidden, and of the rest some is less textured: of right poses in made rooms a hundredth has less, on
/// recorded images they have 0.9.
const EXPLAINED: f64 = 0.3;
/// Least evidence of a pose: its independent inliers times the square of the share of what it shows that
/// they explain. Four that explain all; where half of it is hidden or has no texture, sixteen. A thing that
/// exists twice has many inliers, and explains little. Chosen on made rooms: the evidence of 14 poses by such
/// a thing reached 3.4, and that of 4 % of 3,600 right ones is less than 4.
const LEAST_EVIDENCE: f64 = 4.0;
/// χ² of six degrees of freedom that one true closure in 10,000 exceeds.
const IMPROBABLE: f64 = 27.86;

/// Inliers that wrong matches have with less than [`FALSE_ALARMS`], at least `least` (Moisan and Stival,
/// IJCV 2004): a wrong match is anywhere among the features, and so in the gate of its point by the share
/// of the gate's area, and of its depth; the tail of a sum of such events is bounded by Chernoff.
pub(super) fn inliers_needed(
    features: &[Feature],
    problem: &Problem<'_>,
    pose: &Se3,
    least: usize,
) -> usize {
    let extent = patches::extent(features).1;
    let area = extent.x * extent.y;
    let depths = || features.iter().filter_map(|f| f.depth_m).map(|(depth, _)| depth);
    let deep = depths().fold(0.0, f64::max) - depths().fold(f64::INFINITY, f64::min);
    let inverse = pose.inverse();
    let (b_from_a, origin) = (inverse.rotation.matrix(), inverse.translation);
    let share = |m: &super::Weighted| {
        let landmark = &m.seen.landmark;
        let at = Projected::new(problem.camera, landmark, &b_from_a, &origin)?;
        let noise = m.seen.sigma_px * m.seen.sigma_px;
        let squared = (at.c00 + noise) * (at.c11 + noise) - at.c01 * at.c01;
        let in_image = gate(2, problem.options.sigma_allowance);
        let in_image = (PI * in_image * squared.max(0.0).sqrt() / area).min(1.0);
        let in_depth = m.seen.depth_m.filter(|_| deep > 0.0).map_or(1.0, |(_, sigma)| {
            let gate = gate(3, problem.options.sigma_allowance);
            (2.0 * (gate * (at.c22 + sigma * sigma)).max(0.0).sqrt() / deep).min(1.0)
        });
        Some(in_image * in_depth)
    };
    let expected: f64 = problem.matches.iter().filter_map(share).sum::<f64>().max(1e-9);
    let count = problem.matches.len() as f64;
    // Four poses of each sample.
    let poses = (count * (count - 1.0) * (count - 2.0) / 6.0 * 4.0).max(1.0).ln();
    let is_no_chance = |inliers: usize| {
        // Three fit by themselves.
        let more = inliers as f64 - 3.0;
        let tail =
            if more > expected { more - expected - more * (more / expected).ln() } else { 0.0 };
        poses + tail < FALSE_ALARMS.ln()
    };
    let most = problem.matches.len() + 1;
    (least..most).find(|&inliers| is_no_chance(inliers)).unwrap_or(most)
}

/// Whether the inliers are not on one line.
pub(super) fn not_on_one_line(points: &[Vector3<f64>]) -> Result<(), Refusal> {
    let sizes = principal(points).1;
    let share = (sizes[1] / sizes[2].max(f64::MIN_POSITIVE)).sqrt();
    if share < ONE_LINE { Err(Refusal::OneLine { share }) } else { Ok(()) }
}

/// Whether the inliers spread over both images.
pub(super) fn not_in_a_small_region(
    input: &Input<'_>,
    inliers: &[(usize, usize)],
    points: &[Vector3<f64>],
) -> Result<(), Refusal> {
    // In the query by pixels, in the candidate by directions; each beside all that is seen there.
    let seen = area(inliers.iter().map(|&(_, f)| input.features[f].pixel));
    let of_all = area(input.features.iter().map(|feature| feature.pixel));
    let direction = |p: &Vector3<f64>| (p.z > 0.0).then(|| Vector2::new(p.x / p.z, p.y / p.z));
    let known = area(points.iter().filter_map(direction));
    // Points of covisible keyframes reach beyond the candidate's image: as large as the query's.
    let focal = input.camera.mean_focal_px();
    let of_candidate = area(input.points.iter().filter_map(|p| direction(&p.point)));
    let of_candidate = of_candidate.min(of_all / (focal * focal));
    let share = (seen / of_all).min(known / of_candidate);
    if share < SMALL_REGION { Err(Refusal::SmallRegion { share }) } else { Ok(()) }
}

/// Area of the ellipse of a uniform distribution with the covariance of some pixels.
fn area(pixels: impl Iterator<Item = Vector2<f64>> + Clone) -> f64 {
    let count = pixels.clone().count().max(1) as f64;
    let mean = pixels.clone().sum::<Vector2<f64>>() / count;
    let scatter: Matrix2<f64> = pixels.map(|p| (p - mean) * (p - mean).transpose()).sum();
    4.0 * PI * (scatter / count).determinant().max(0.0).sqrt()
}

/// Directions of a cloud of points and its variances along them, rising, with its center.
fn principal(points: &[Vector3<f64>]) -> (Matrix3<f64>, [f64; 3], Vector3<f64>) {
    let count = points.len().max(1) as f64;
    let center = points.iter().sum::<Vector3<f64>>() / count;
    let scatter: Matrix3<f64> =
        points.iter().map(|p| (p - center) * (p - center).transpose()).sum();
    let eigen = (scatter / count).symmetric_eigen();
    let mut order = [0, 1, 2];
    order::sort_by(&mut order, &mut |a, b| eigen.eigenvalues[a].total_cmp(&eigen.eigenvalues[b]));
    let columns = order.map(|k| eigen.eigenvectors.column(k).into_owned());
    (Matrix3::from_columns(&columns), order.map(|k| eigen.eigenvalues[k].max(0.0)), center)
}

/// Whether the covariance leaves no direction open.
pub(super) fn determined(
    points: &[Vector3<f64>],
    pose: &Se3,
    covariance: &Matrix6<f64>,
) -> Result<(), Refusal> {
    let mut depths: Vec<f64> = points.iter().map(|p| pose.inverse_transform(p).z).collect();
    depths.sort_unstable_by(f64::total_cmp);
    let depth = depths.get(depths.len() / 2).copied().unwrap_or(0.0);
    let largest = |at: usize| {
        let block: Matrix3<f64> = covariance.fixed_view::<3, 3>(at, at).into_owned();
        let variance = block.symmetric_eigenvalues().max();
        // No number of a covariance that is none may pass for a small one.
        if block.iter().all(|v| v.is_finite()) { variance.max(0.0).sqrt() } else { f64::INFINITY }
    };
    let (rotation_rad, distance) = (largest(3), largest(0) / depth);
    if rotation_rad < LOOSE && distance < LOOSE {
        return Ok(());
    }
    Err(Refusal::Undetermined { rotation_rad, distance })
}

/// Whether points on a plane have no second pose: a plane that is seen from afar looks nearly the same
/// when it is turned to the other side of the line of sight (Schweighofer and Pinz, PAMI 2006).
pub(super) fn not_mirrored(
    problem: &Problem<'_>,
    inliers: &[usize],
    pose: &Se3,
) -> Result<(), Refusal> {
    let in_b: Vec<Vector3<f64>> = inliers
        .iter()
        .map(|&k| pose.inverse_transform(&problem.matches[k].seen.landmark.point))
        .collect();
    let (directions, sizes, center) = principal(&in_b);
    if sizes[0] > PLANE * PLANE * sizes[1] {
        return Ok(());
    }
    let (normal, sight) = (directions.column(0).into_owned(), center.normalize());
    let normal = normal * normal.dot(&sight).signum();
    let axis = normal.cross(&sight);
    let angle = axis.norm().atan2(normal.dot(&sight));
    let Some(axis) = axis.try_normalize(1e-6) else { return Ok(()) };
    let turn = So3::exp(&(axis * (2.0 * angle)));
    let mirrored_from_b = Se3::new(turn, center - turn.rotate(&center));
    let start = pose.compose(&mirrored_from_b.inverse());
    let Some(other) = problem.fitted(inliers, &start) else { return Ok(()) };
    let chi2 = |pose: &Se3| -> f64 {
        let of = |&k: &usize| squared_error(problem.camera, &problem.matches[k].seen, pose);
        inliers.iter().map(|k| of(k).map_or(f64::INFINITY, |(chi2, _)| chi2)).sum()
    };
    let apart = pose.rotation.inverse().compose(&other.motion.a_from_b.rotation).log().norm();
    let worse = (chi2(&other.motion.a_from_b) - chi2(pose)) / other.variance.max(1.0);
    // The same pose again is no second one.
    let information = problem.fitted(inliers, pose).map(|f| *f.motion.information.matrix());
    let is_other = information.is_none_or(|information| {
        let difference = other.motion.a_from_b.minus(pose);
        difference.dot(&(information * difference)) > MIRRORED
    });
    if is_other && worse < MIRRORED && apart > 1e-6 {
        return Err(Refusal::MirroredPlane { chi2: worse });
    }
    Ok(())
}

/// Whether the matches that contradict the pose do not agree on another one.
pub(super) fn not_ambiguous(
    problem: &Problem<'_>,
    pose: &Se3,
    options: &Options,
    features: &[Feature],
    numbers: &mut Numbers,
) -> Result<(), Refusal> {
    let near = problem.consensus(*pose, 2.0).inliers;
    let best = problem.consensus(*pose, 1.0).inliers;
    let mut is_near = vec![false; problem.matches.len()];
    near.iter().for_each(|&k| is_near[k] = true);
    let rest: Vec<super::Weighted> =
        (0..problem.matches.len()).filter(|&k| !is_near[k]).map(|k| problem.matches[k]).collect();
    if rest.len() < MIN_INLIERS {
        return Ok(());
    }
    let others = Problem { camera: problem.camera, matches: &rest, options };
    let Some(rival) = others.search(numbers) else { return Ok(()) };
    let weight = |matches: &[super::Weighted], inliers: &[usize]| -> f64 {
        inliers.iter().map(|&k| matches[k].weight).sum()
    };
    let enough = inliers_needed(features, &others, &rival.pose, MIN_INLIERS);
    // A pose that explains the same matches is the same one, seen with larger errors.
    let again = problem.consensus(rival.pose, 3.0).inliers;
    let shared = again.iter().filter(|k| best.binary_search(k).is_ok()).count();
    let is_strong = weight(&rest, &rival.inliers) >= RIVAL * weight(problem.matches, &best);
    if is_strong && rival.inliers.len() >= enough && 2 * shared < best.len() {
        return Err(Refusal::Ambiguous { inliers: best.len(), rival: rival.inliers.len() });
    }
    Ok(())
}

/// Whether so many of the inliers are evidence of their own that chance is excluded. Returns how many are.
pub(super) fn independent(
    input: &Input<'_>,
    problem: &Problem<'_>,
    inliers: &[usize],
    pose: &Se3,
) -> (usize, Result<(), Refusal>) {
    let of = |k: &usize| problem.matches[*k];
    let inlying: Vec<super::Weighted> = inliers.iter().map(of).collect();
    let independent = patches::independent(input, &inlying).len();
    let matches: Vec<super::Weighted> =
        patches::independent(input, problem.matches).iter().map(of).collect();
    let thinned = Problem { camera: problem.camera, matches: &matches, options: problem.options };
    let needed = inliers_needed(input.features, &thinned, pose, MIN_INDEPENDENT);
    let is_enough = independent >= needed;
    let refusal = Refusal::TooFewInliers { inliers: independent, needed };
    (independent, if is_enough { Ok(()) } else { Err(refusal) })
}

/// Whether landmarks match all over what the pose shows, the more so the fewer they are.
pub(super) fn explained(share: f64, independent: usize) -> Result<(), Refusal> {
    let evidence = independent as f64 * share * share;
    let is_enough = share >= EXPLAINED && evidence >= LEAST_EVIDENCE;
    if is_enough { Ok(()) } else { Err(Refusal::Unexplained { share, independent }) }
}

/// Whether the odometry does not exclude the pose.
pub(super) fn probable(
    expected: &Expected,
    pose: &Se3,
    covariance: &Matrix6<f64>,
) -> Result<(), Refusal> {
    let difference = pose.minus(&expected.candidate_from_query);
    // Log(E⁻¹ P) moves by J⁻¹(δ) of a perturbation of P, and by −J⁻¹(−δ) of one of E.
    let by_pose = Se3::right_jacobian_inverse(&difference);
    let by_expected = Se3::right_jacobian_inverse(&-difference);
    let sum = by_pose * covariance * by_pose.transpose()
        + by_expected * expected.covariance.matrix() * by_expected.transpose();
    let chi2 = match sum.cholesky() {
        Some(cholesky) => difference.dot(&cholesky.solve(&difference)),
        None => f64::INFINITY,
    };
    if chi2 <= IMPROBABLE {
        return Ok(());
    }
    Err(Refusal::Improbable { chi2, limit: IMPROBABLE })
}
