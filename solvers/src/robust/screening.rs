//! Loop closures beside their neighbors and the odometry.
//!
//! Two closures between nearly the same places make a short loop with the odometry at both ends. A true
//! pair closes it within the noise of its own measurements, however far the odometry has drifted
//! between the two places; a false closure has a partner by chance only. This is pairwise consistency
//! (Mangelson, Dominic, Eustice and Vasudevan 2018) kept to loops that are short enough to decide
//! something. It uses measurements and ids, never poses.

use nalgebra::SVector;

use super::chain::{Chain, UncertainMotion};
use crate::geometry::LieGroup;
use crate::interrupt::Interrupt;
use crate::problem::PoseGraph;

/// Most steps of odometry at either end of a loop.
const REACH: i64 = 5;

/// A closure from the lower id to the higher.
#[derive(Clone, Copy)]
struct Closure<G, const N: usize> {
    from: i64,
    to: i64,
    measured: UncertainMotion<G, N>,
}

/// What a closure's neighbors and the odometry say of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Screened {
    /// Whether a neighbor closes a short loop with it in which χ² is within the threshold.
    pub(super) is_supported: bool,
    /// Whether another closure joins nearly the same places.
    pub(super) has_neighbor: bool,
    /// χ² of the loop that it closes with the odometry between its ends, where there is one.
    pub(super) odometry_chi2: Option<f64>,
}

/// Screens `closures`, edges of `graph`; `measured` is that of each edge. Those not reached before `interrupt` was due count as
/// unsupported.
pub(super) fn screen<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
    measured: &[Option<UncertainMotion<G, N>>],
    closures: &[usize],
    threshold: f64,
    interrupt: &Interrupt,
) -> Vec<Screened> {
    let chain = Chain::new(graph, measured);
    let mut screened = vec![Screened::default(); closures.len()];
    let mut list: Vec<(usize, Closure<G, N>)> = Vec::with_capacity(closures.len());
    for (k, &edge) in closures.iter().enumerate() {
        let Some(measured) = measured[edge] else { continue };
        let edge = &graph.edges[edge];
        let (i, j) = (graph.ids[edge.i], graph.ids[edge.j]);
        let closure = if i <= j {
            Closure { from: i, to: j, measured }
        } else {
            Closure { from: j, to: i, measured: measured.inverse() }
        };
        screened[k].odometry_chi2 =
            chain.between(closure.from, closure.to).and_then(|path| chi2(&path, &closure.measured));
        list.push((k, closure));
    }
    list.sort_unstable_by_key(|(k, closure)| (closure.from, closure.to, *k));
    for (index, (k, a)) in list.iter().enumerate() {
        for (l, b) in &list[index + 1..] {
            if b.from > a.from.saturating_add(REACH) {
                break;
            }
            if interrupt.is_due() {
                return screened;
            }
            if b.to.abs_diff(a.to) > REACH.unsigned_abs() {
                continue;
            }
            let pair = [*k, *l];
            let is_known = pair.iter().all(|&at| screened[at].is_supported);
            let do_agree = !is_known && agree(&chain, a, b, threshold);
            for at in pair {
                screened[at].has_neighbor = true;
                screened[at].is_supported |= do_agree;
            }
        }
    }
    screened
}

/// Whether the loop a, odometry, b backwards, odometry is closed within its noise.
fn agree<G: LieGroup<N>, const N: usize>(
    chain: &Chain<'_, G, N>,
    a: &Closure<G, N>,
    b: &Closure<G, N>,
    threshold: f64,
) -> bool {
    let (Some(before), Some(after)) = (chain.walk(b.from, a.from), chain.walk(a.to, b.to)) else {
        return false;
    };
    let predicted = before.compose(&a.measured).compose(&after);
    chi2(&predicted, &b.measured).is_some_and(|chi2| chi2 <= threshold)
}

/// χ² of the difference of two measurements of one motion; `None` where their covariance is singular.
fn chi2<G: LieGroup<N>, const N: usize>(
    a: &UncertainMotion<G, N>,
    b: &UncertainMotion<G, N>,
) -> Option<f64> {
    let error: SVector<f64, N> = b.motion.inverse().compose(&a.motion).log();
    let factor = (a.covariance + b.covariance).cholesky()?;
    Some(error.dot(&factor.solve(&error)))
}
