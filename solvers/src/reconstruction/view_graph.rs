//! Which pairs of keyframes are worth a relative pose: the view graph before its edges are measured.
//!
//! Each keyframe keeps the neighbors with which it shares most landmarks and those that see them from
//! another place: how far the rays are apart after the best common turn (Wahba's problem) tells a wide
//! baseline from a short one without a pose. It counts and compares, and decides nothing about poses.

use std::cmp::Reverse;

use nalgebra::Matrix3;

use super::bearings::Bearings;
use super::relative_poses::Edge;
use crate::geometry::So3;
use crate::interrupt::Interrupt;
use crate::order;
use crate::parallel;
use crate::problem::DisjointSets;

/// Landmarks of a pair that are looked at for its parallax.
const LOOKED_AT: usize = 48;
/// Landmarks beyond this number do not make a pair better.
const ENOUGH: usize = 100;
/// Parallax beyond so many standard deviations does not make a pair better.
const WIDE: f64 = 400.0;

/// Two keyframes that share landmarks, `a` below `b`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    pub(super) a: usize,
    pub(super) b: usize,
    /// Landmarks in common.
    pub(super) common: usize,
    /// Root of the number of landmarks times the parallax: larger is better.
    score: f64,
}

/// All pairs with at least `min_common` landmarks in common, by (a, b); some of them where `interrupt` is
/// due.
pub(super) fn candidates(
    bearings: &Bearings,
    min_common: usize,
    interrupt: &Interrupt,
) -> Vec<Candidate> {
    let of_pose = |a: usize| {
        if interrupt.is_due() {
            return Vec::new();
        }
        let mut counts = vec![0_u32; bearings.of_pose.len()];
        let mut met = Vec::new();
        for &s in &bearings.of_pose[a] {
            for &t in &bearings.of_landmark[bearings.get(s).landmark] {
                let b = bearings.get(t).pose;
                if b > a {
                    if counts[b] == 0 {
                        met.push(b);
                    }
                    counts[b] += 1;
                }
            }
        }
        met.sort_unstable();
        let enough = met.into_iter().filter(|&b| counts[b] as usize >= min_common);
        enough.map(|b| candidate(bearings, a, b)).collect::<Vec<_>>()
    };
    let lists = parallel::map(0..bearings.of_pose.len(), of_pose);
    lists.into_iter().flatten().collect()
}

/// The most landmarks that a keyframe shares with another one.
pub(super) fn most_common(bearings: &Bearings, pose: usize) -> usize {
    let mut counts = vec![0; bearings.of_pose.len()];
    for &s in &bearings.of_pose[pose] {
        for &t in &bearings.of_landmark[bearings.get(s).landmark] {
            counts[bearings.get(t).pose] += 1;
        }
    }
    counts[pose] = 0;
    counts.into_iter().max().unwrap_or(0)
}

fn candidate(bearings: &Bearings, a: usize, b: usize) -> Candidate {
    let pairs = bearings.common(a, b);
    let common = pairs.len();
    let every = common.div_ceil(LOOKED_AT).max(1);
    let looked_at =
        || pairs.iter().step_by(every).map(|&(s, t)| (bearings.get(s), bearings.get(t)));
    let turn = looked_at().fold(Matrix3::zeros(), |sum, (s, t)| sum + t.ray * s.ray.transpose());
    let turn = So3::from_matrix(&turn);
    let mut parallax: Vec<f64> = looked_at()
        .map(|(s, t)| turn.rotate(&s.ray).cross(&t.ray).norm() / s.sigma_rad.hypot(t.sigma_rad))
        .collect();
    let parallax = super::median(&mut parallax).clamp(1.0, WIDE);
    Candidate { a, b, common, score: common.min(ENOUGH) as f64 * parallax.sqrt() }
}

/// The pairs that are measured: for each keyframe the `neighbors` best by score and half as many by
/// common landmarks. Indices into `candidates`, rising.
pub(super) fn selected(candidates: &[Candidate], poses: usize, neighbors: usize) -> Vec<usize> {
    let mut of_pose: Vec<Vec<usize>> = vec![Vec::new(); poses];
    for (index, candidate) in candidates.iter().enumerate() {
        of_pose[candidate.a].push(index);
        of_pose[candidate.b].push(index);
    }
    let mut taken = vec![false; candidates.len()];
    for own in &mut of_pose {
        order::sort_by(own, &mut |i, j| {
            candidates[j].score.total_cmp(&candidates[i].score).then(i.cmp(&j))
        });
        own.iter().take(neighbors).for_each(|&index| taken[index] = true);
        order::sort_by(own, &mut |i, j| {
            candidates[j].common.cmp(&candidates[i].common).then(i.cmp(&j))
        });
        own.iter().take(neighbors / 2).for_each(|&index| taken[index] = true);
    }
    (0..candidates.len()).filter(|&index| taken[index]).collect()
}

/// Further pairs between keyframes that `edges` leave apart, those with most landmarks first: a few for
/// each two pieces. Indices into `candidates`, rising.
pub(super) fn between_pieces(
    candidates: &[Candidate],
    chosen: &[usize],
    edges: &[Edge],
    poses: usize,
) -> Vec<usize> {
    /// Pairs for each two pieces.
    const TRIED: usize = 8;
    let mut sets = DisjointSets::new(poses);
    edges.iter().for_each(|edge| _ = sets.join(edge.a, edge.b));
    let mut open: Vec<(usize, usize, Reverse<usize>, usize)> = (0..candidates.len())
        .filter(|index| chosen.binary_search(index).is_err())
        .filter_map(|index| {
            let Candidate { a, b, common, .. } = candidates[index];
            let (a, b) = (sets.root(a), sets.root(b));
            (a != b).then_some((a.min(b), a.max(b), Reverse(common), index))
        })
        .collect();
    open.sort_unstable();
    let mut further: Vec<usize> = open
        .chunk_by(|p, q| (p.0, p.1) == (q.0, q.1))
        .flat_map(|pairs| pairs.iter().take(TRIED).map(|pair| pair.3))
        .collect();
    further.sort_unstable();
    further
}
