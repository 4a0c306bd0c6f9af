//! Whether two keyframes show one place, by the geometry of their matches: a relative pose, or a reason.
//!
//! The candidate has points with covariances in its frame, its own and those of covisible keyframes; the
//! query has features, with or without depth. LO-RANSAC over the matches (`consensus`), matches that the
//! pose finds (`guided`), a least-squares pose ([`crate::relative_motion`]), then `checks`: each may
//! refuse. The covariance is that of the fit, with standard deviations as large as the residuals say,
//! and beside it what the calibration leaves open, which no number of matches makes smaller. Without
//! it the error is several times what the fit claims. What is left after that is doubt (`spread`): too little
//! evidence of its own, or a part of the image alone that agrees. Reads no map, and gives the same on any
//! threads.
//!
//! | file | role |
//! |---|---|
//! | `sampling`, `consensus` | LO-RANSAC by weights, from a seed |
//! | `guided` | matches that the pose finds |
//! | `checks` | chance, degenerate scenes, a second pose, the odometry |
//! | `patches`, `spread` | matches that are evidence of their own; how much of what a pose shows agrees |
//! | `refusal` | the reasons, a closed list with names |

mod checks;
mod consensus;
mod guided;
mod patches;
mod refusal;
mod sampling;
mod spread;
#[cfg(test)]
mod tests;

use nalgebra::{Vector2, Vector3};

use crate::geometry::{Camera, LieGroup, Se3};
use crate::information::{Covariance, Information};
use crate::point_matching::Likeness;
use crate::relative_motion::{Calibration, Match, PointEstimate, calibration_covariance};
use consensus::{Consensus, Problem, Weighted};
pub(crate) use sampling::{Numbers, distinct, samples_needed};

pub use refusal::{InputError, Refusal};

/// Fewest matches, and fewest inliers: a dozen is what systems for keyframes ask for (ORB-SLAM: 15 to
/// 20, RTAB-Map: 20), halfway down to the six that determine a pose and contradict it.
pub const MIN_INLIERS: usize = 12;
/// Matches that are used, those with the largest weights: more do not make a pose surer, and what a
/// hostile query costs is bounded.
const MAX_MATCHES: usize = 1000;
/// Share of the matches that agree on a pose than which further ones may not look more different: how much
/// the same corner changes depends on camera, descriptor and view, and what chance makes alike is hardly so
/// alike.
const AGREEING: f64 = 0.95;
/// Times that the pose looks for further matches.
const GUIDED_ROUNDS: usize = 2;

/// A feature of the query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Feature {
    /// (u, v), px.
    pub pixel: Vector2<f64>,
    /// Standard deviation of u and of v, px.
    pub sigma_px: f64,
    /// Depth along the optical axis and its standard deviation, m.
    pub depth_m: Option<(f64, f64)>,
}

/// A match by appearance. No point and no feature is in two of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Proposed {
    /// Index of the candidate's point.
    pub point: usize,
    /// Index of the query's feature.
    pub feature: usize,
    /// How much it counts, at least 0: a point that has been stable for long counts more than one that
    /// may belong to what moves. Only the ratios of the weights matter.
    pub weight: f64,
}

/// What the odometry says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Expected {
    /// The relative pose.
    pub candidate_from_query: Se3,
    /// Of a right perturbation of it, translation first.
    pub covariance: Covariance<6>,
}

impl Expected {
    /// Whether a verified pose is not excluded by what is expected.
    ///
    /// # Errors
    /// [`Refusal::Improbable`].
    pub fn is_met_by(&self, verified: &Verified) -> Result<(), Refusal> {
        let covariance = verified.information.matrix().cholesky().map(|c| c.inverse());
        let covariance = covariance.ok_or(Refusal::RefinementFailed)?;
        checks::probable(self, &verified.candidate_from_query, &covariance)
    }
}

/// Two keyframes.
#[derive(Clone, Copy, Debug)]
pub struct Input<'a> {
    /// Camera of the query.
    pub camera: &'a Camera,
    /// Features of the query, matched or not.
    pub features: &'a [Feature],
    /// Points in the frame of the candidate, matched or not.
    pub points: &'a [PointEstimate],
    /// Matches by appearance.
    pub matches: &'a [Proposed],
    /// What the odometry says, where it says something.
    pub expected: Option<Expected>,
    /// Of the random numbers; made of the two ids, a verdict can be repeated.
    pub seed: u64,
}

/// What is believed of the input.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Standard deviations may be too small by this factor, at least 1. Real ones leave out what
    /// moves in an exposure, the rows of a rolling shutter and the lens; the variance that is found
    /// among the inliers enters the information.
    pub sigma_allowance: f64,
    /// Most samples: of matches of which a seventh is right, one sample in 343 is, and so 2,400 hold
    /// one but for a thousandth.
    pub max_samples: usize,
    /// How well the cameras are calibrated.
    pub calibration: Calibration,
}

impl Default for Options {
    /// A calibration with a chessboard: focal length to 0.3 %, center to 1 px of 500, scale of the depth
    /// to 1 %, one camera.
    fn default() -> Self {
        let calibration =
            Calibration { focal: 0.003, center_rad: 0.002, depth: 0.01, same_camera: true };
        Self { sigma_allowance: 2.0, max_samples: 2400, calibration }
    }
}

/// A place that is the same.
#[derive(Clone, Debug, PartialEq)]
pub struct Verified {
    /// Pose of the query in the frame of the candidate.
    pub candidate_from_query: Se3,
    /// Of a right perturbation of it, translation first.
    pub information: Information<6>,
    /// (point, feature), by rising point: proposed ones that fit, and those that the pose found.
    pub inliers: Vec<(usize, usize)>,
    /// Those of the proposed inliers that are evidence of their own: of those that show one patch of the
    /// scene, one.
    pub independent: usize,
    /// Variance of the residuals over what is claimed, at least 1.
    pub variance_factor: f64,
}

/// The answer.
#[derive(Clone, Debug, PartialEq)]
pub enum Verdict {
    /// The query shows the candidate's place.
    Accepted(Box<Verified>),
    /// Many matches agree on this pose, but for a reason that is named it may be that of another place.
    Doubtful(Box<Verified>, Refusal),
    /// It does not, or it cannot be told.
    Refused(Refusal),
}

/// Judges a candidate. `likeness(point, feature)` compares descriptors, for the matches that a pose finds:
/// those that are known and not different.
///
/// # Errors
/// [`InputError`] where a number is not finite or out of range, or a match names what is not there.
pub fn verify(
    input: &Input<'_>,
    likeness: &dyn Fn(usize, usize) -> Likeness,
    options: &Options,
) -> Result<Verdict, InputError> {
    validate(input)?;
    Ok(match verified(input, likeness, options) {
        Ok((verified, Ok(()))) => Verdict::Accepted(Box::new(verified)),
        Ok((verified, Err(doubt))) => Verdict::Doubtful(Box::new(verified), doubt),
        Err(refusal) => Verdict::Refused(refusal),
    })
}

fn verified(
    input: &Input<'_>,
    likeness: &dyn Fn(usize, usize) -> Likeness,
    options: &Options,
) -> Result<(Verified, Result<(), Refusal>), Refusal> {
    let mut numbers = Numbers::new(input.seed);
    let proposed = usable(input.matches);
    if proposed.len() < MIN_INLIERS {
        return Err(Refusal::TooFewMatches { matches: proposed.len(), needed: MIN_INLIERS });
    }
    let weighted: Vec<Weighted> =
        proposed.iter().map(|m| weighted(input, m.point, m.feature, m.weight)).collect();
    let problem = Problem { camera: input.camera, matches: &weighted, options };
    let Some(best) = problem.search(&mut numbers) else {
        return Err(Refusal::TooFewInliers { inliers: 0, needed: MIN_INLIERS });
    };
    let needed = checks::inliers_needed(input.features, &problem, &best.pose, MIN_INLIERS);
    if best.inliers.len() < needed {
        return Err(Refusal::TooFewInliers { inliers: best.inliers.len(), needed });
    }
    let mut pairs: Vec<(usize, usize)> = proposed.iter().map(|m| (m.point, m.feature)).collect();
    let agreeing = best.inliers.iter().map(|&k| likeness(pairs[k].0, pairs[k].1));
    let limit = most_different(agreeing);
    let is_different = |likeness| matches!(likeness, Likeness::Distance(d) if d > limit);
    let likeness = &|point: usize, feature: usize| {
        let found = likeness(point, feature);
        if is_different(found) { Likeness::Different } else { found }
    };
    let mut all = weighted.clone();
    let mut found = best;
    for _ in 0..GUIDED_ROUNDS {
        let inlying =
            guided::informative(input, found.inliers.iter().map(|&k| pairs[k]), &found.pose);
        let further = guided::search(input, &inlying, &found.pose, likeness, options);
        // Matches that do not fit give way to those that do.
        pairs = inlying.iter().chain(&further).copied().collect();
        pairs.sort_unstable();
        all = pairs.iter().map(|&(point, feature)| weighted_once(input, point, feature)).collect();
        let problem = Problem { camera: input.camera, matches: &all, options };
        found = problem.optimized(found.pose);
        if further.is_empty() {
            break;
        }
    }
    if found.inliers.len() < MIN_INLIERS {
        return Err(Refusal::TooFewInliers { inliers: found.inliers.len(), needed: MIN_INLIERS });
    }
    let problem_of_all = Problem { camera: input.camera, matches: &all, options };
    let fitted =
        problem_of_all.fitted(&found.inliers, &found.pose).ok_or(Refusal::RefinementFailed)?;
    let pose = fitted.motion.a_from_b;
    let open = calibration_covariance(input.camera, &fitted.matches, &pose, &options.calibration);
    let fitted_matches: Vec<Weighted> = found.inliers.iter().map(|&k| all[k]).collect();
    // Matches of one patch have one error of their landmark and of their pixel.
    let of_one_patch = fitted_matches.len() as f64
        / patches::independent(input, &fitted_matches).len().max(1) as f64;
    let covariance = fitted
        .motion
        .information
        .matrix()
        .cholesky()
        .map(|cholesky| cholesky.inverse() * of_one_patch)
        .zip(open)
        .map(|(of_fit, open)| of_fit + open)
        .ok_or(Refusal::RefinementFailed)?;
    let inlying: Vec<(usize, usize)> = found.inliers.iter().map(|&k| pairs[k]).collect();
    let points: Vec<Vector3<f64>> = inlying.iter().map(|&(p, _)| input.points[p].point).collect();
    checks::not_on_one_line(&points)?;
    checks::determined(&points, &pose, &covariance)?;
    checks::not_in_a_small_region(input, &inlying, &points)?;
    checks::not_mirrored(&problem_of_all, &found.inliers, &pose)?;
    checks::not_ambiguous(&problem, &pose, options, input.features, &mut numbers)?;
    if let Some(expected) = &input.expected {
        checks::probable(expected, &pose, &covariance)?;
    }
    let inverse = covariance.cholesky().ok_or(Refusal::RefinementFailed)?.inverse();
    let information = Information::new(&((inverse + inverse.transpose()) * 0.5))
        .map_err(|_not_definite| Refusal::RefinementFailed)?;
    let agreed: Consensus = problem.consensus(pose, 1.0);
    let (independent, is_no_chance) = checks::independent(input, &problem, &agreed.inliers, &pose);
    let share = spread::explained(input, &inlying, &pose, likeness, options);
    let doubt = is_no_chance.and_then(|()| checks::explained(share, independent));
    let verified = Verified {
        candidate_from_query: pose,
        information,
        inliers: inlying,
        independent,
        variance_factor: (fitted.variance * fitted.motion.variance_factor).max(1.0),
    };
    Ok((verified, doubt))
}

/// The distance that [`AGREEING`] of the matches that agree on a pose do not exceed.
fn most_different(agreeing: impl Iterator<Item = Likeness>) -> f64 {
    let distance = |likeness| match likeness {
        Likeness::Distance(distance) => Some(distance),
        Likeness::Different | Likeness::Unknown => None,
    };
    let mut distances: Vec<f64> = agreeing.filter_map(distance).collect();
    distances.sort_unstable_by(f64::total_cmp);
    let at = (AGREEING * distances.len() as f64) as usize;
    distances.get(at).copied().unwrap_or(f64::INFINITY)
}

/// The matches that have a weight, at most [`MAX_MATCHES`], by index; the largest weight is 1.
fn usable(matches: &[Proposed]) -> Vec<Proposed> {
    let mut usable: Vec<Proposed> = matches.iter().filter(|m| m.weight > 0.0).copied().collect();
    if usable.len() > MAX_MATCHES {
        usable.sort_by(|a, b| b.weight.total_cmp(&a.weight).then(a.point.cmp(&b.point)));
        usable.truncate(MAX_MATCHES);
    }
    // The sum of weights of any size is a number then.
    let largest = usable.iter().map(|m| m.weight).fold(0.0, f64::max);
    usable.iter_mut().for_each(|m| m.weight /= largest);
    usable.sort_unstable_by_key(|m| (m.point, m.feature));
    usable
}

fn weighted(input: &Input<'_>, point: usize, feature: usize, weight: f64) -> Weighted {
    let Feature { pixel, sigma_px, depth_m } = input.features[feature];
    Weighted { seen: Match { landmark: input.points[point], pixel, sigma_px, depth_m }, weight }
}

/// Once a pose is known, a match counts by how it fits.
fn weighted_once(input: &Input<'_>, point: usize, feature: usize) -> Weighted {
    weighted(input, point, feature, 1.0)
}

fn validate(input: &Input<'_>) -> Result<(), InputError> {
    let positive = |value: f64| value > 0.0 && value.is_finite();
    let wrong = |what, index| InputError::Number { what, index };
    if !input.camera.is_finite() {
        return Err(wrong("camera", 0));
    }
    if input.expected.is_some_and(|expected| !expected.candidate_from_query.is_finite()) {
        return Err(wrong("expected pose", 0));
    }
    let is_feature = |f: &Feature| {
        let depth = f.depth_m.is_none_or(|(depth, sigma)| positive(depth) && positive(sigma));
        f.pixel.iter().all(|v| v.is_finite()) && positive(f.sigma_px) && depth
    };
    if let Some(index) = input.features.iter().position(|f| !is_feature(f)) {
        return Err(wrong("feature", index));
    }
    let is_point = |p: &PointEstimate| {
        p.point.iter().chain(p.covariance.iter()).all(|v| v.is_finite())
            && p.covariance.diagonal().iter().all(|&v| v >= 0.0)
    };
    if let Some(index) = input.points.iter().position(|p| !is_point(p)) {
        return Err(wrong("point", index));
    }
    let mut points = vec![false; input.points.len()];
    let mut features = vec![false; input.features.len()];
    for (index, m) in input.matches.iter().enumerate() {
        if !(m.weight >= 0.0 && m.weight.is_finite()) {
            return Err(wrong("weight of match", index));
        }
        for (what, named, taken) in
            [("point", m.point, &mut points), ("feature", m.feature, &mut features)]
        {
            let count = taken.len();
            match taken.get_mut(named) {
                None => return Err(InputError::NoSuch { index, what, named, count }),
                Some(taken) if *taken => return Err(InputError::Twice { index, what }),
                Some(taken) => *taken = true,
            }
        }
    }
    Ok(())
}
