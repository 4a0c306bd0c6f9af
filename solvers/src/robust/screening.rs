//! Loop closures that agree with a neighbor.
//!
//! Two closures between nearly the same places make a short loop with the odometry at both ends. A true
//! pair closes it within the noise of its own measurements, however far the odometry has drifted
//! between the two places; a false closure has a partner by chance only. This is pairwise consistency
//! (Mangelson, Dominic, Eustice and Vasudevan 2018) kept to loops that are short enough to decide
//! something. It uses measurements and ids, never poses.

use std::collections::BTreeMap;

use nalgebra::{SMatrix, SVector};

use crate::factors::RelativePose;
use crate::geometry::LieGroup;
use crate::interrupt::Interrupt;
use crate::problem::PoseGraph;

/// Most steps of odometry at either end of a loop.
const REACH: i64 = 5;

/// A relative pose with the covariance of its right perturbation.
#[derive(Clone, Copy)]
struct Measured<G, const N: usize> {
    motion: G,
    covariance: SMatrix<f64, N, N>,
}

impl<G: LieGroup<N>, const N: usize> Measured<G, N> {
    fn exact() -> Self {
        Self { motion: G::identity(), covariance: SMatrix::zeros() }
    }

    fn of(edge: &RelativePose<G, N>) -> Option<Self> {
        let covariance = *edge.information.covariance().ok()?.matrix();
        Some(Self { motion: edge.i_from_j, covariance })
    }

    /// Z⁻¹: Exp(−δ) Z⁻¹ = Z⁻¹ Exp(−Ad(Z) δ).
    fn inverse(&self) -> Self {
        let adjoint = self.motion.adjoint();
        let covariance = adjoint * self.covariance * adjoint.transpose();
        Self { motion: self.motion.inverse(), covariance }
    }

    /// X Y: X Exp(δ) Y = X Y Exp(Ad(Y⁻¹) δ).
    fn compose(&self, other: &Self) -> Self {
        let adjoint = other.motion.inverse().adjoint();
        let moved = adjoint * self.covariance * adjoint.transpose();
        Self { motion: self.motion.compose(&other.motion), covariance: moved + other.covariance }
    }
}

/// A closure from the lower id to the higher.
#[derive(Clone, Copy)]
struct Closure<G, const N: usize> {
    from: i64,
    to: i64,
    measured: Measured<G, N>,
}

/// For each of `closures`, edges of `graph`, whether a neighbor closes a short loop with it in which χ²
/// is at most `threshold`. Closures not checked before `interrupt` was due count as unsupported.
pub(super) fn closures_with_support<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
    closures: &[usize],
    threshold: f64,
    interrupt: &Interrupt,
) -> Vec<bool> {
    let steps = odometry(graph);
    let mut list: Vec<(usize, Closure<G, N>)> = Vec::with_capacity(closures.len());
    for (k, &edge) in closures.iter().enumerate() {
        let edge = &graph.edges[edge];
        let (i, j) = (graph.ids[edge.i], graph.ids[edge.j]);
        let Some(measured) = Measured::of(edge) else { continue };
        let closure = if i <= j {
            Closure { from: i, to: j, measured }
        } else {
            Closure { from: j, to: i, measured: measured.inverse() }
        };
        list.push((k, closure));
    }
    list.sort_by_key(|(k, closure)| (closure.from, closure.to, *k));
    let mut is_supported = vec![false; closures.len()];
    for (place, (k, a)) in list.iter().enumerate() {
        for (l, b) in &list[place + 1..] {
            if b.from > a.from.saturating_add(REACH) {
                break;
            }
            if interrupt.is_due() {
                return is_supported;
            }
            let is_known = is_supported[*k] && is_supported[*l];
            if is_known || b.to.abs_diff(a.to) > REACH.unsigned_abs() {
                continue;
            }
            if agree(&steps, a, b, threshold) {
                is_supported[*k] = true;
                is_supported[*l] = true;
            }
        }
    }
    is_supported
}

/// The first edge from each id to the next.
fn odometry<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
) -> BTreeMap<i64, Measured<G, N>> {
    let mut steps = BTreeMap::new();
    for edge in &graph.edges {
        let (i, j) = (graph.ids[edge.i], graph.ids[edge.j]);
        let Some(measured) = Measured::of(edge) else { continue };
        if i.checked_add(1) == Some(j) {
            steps.entry(i).or_insert(measured);
        } else if j.checked_add(1) == Some(i) {
            steps.entry(j).or_insert_with(|| measured.inverse());
        }
    }
    steps
}

/// The odometry from one id to another; `None` where a step is missing.
fn walk<G: LieGroup<N>, const N: usize>(
    steps: &BTreeMap<i64, Measured<G, N>>,
    from: i64,
    to: i64,
) -> Option<Measured<G, N>> {
    if from > to {
        return walk(steps, to, from).map(|measured| measured.inverse());
    }
    let mut walked = Measured::exact();
    for id in from..to {
        walked = walked.compose(steps.get(&id)?);
    }
    Some(walked)
}

/// Whether the loop a, odometry, b backwards, odometry is closed within its noise.
fn agree<G: LieGroup<N>, const N: usize>(
    steps: &BTreeMap<i64, Measured<G, N>>,
    a: &Closure<G, N>,
    b: &Closure<G, N>,
    threshold: f64,
) -> bool {
    let (Some(before), Some(after)) = (walk(steps, b.from, a.from), walk(steps, a.to, b.to)) else {
        return false;
    };
    let predicted = before.compose(&a.measured).compose(&after);
    let error: SVector<f64, N> = b.measured.motion.inverse().compose(&predicted.motion).log();
    let covariance = predicted.covariance + b.measured.covariance;
    let Some(factor) = covariance.cholesky() else { return false };
    error.dot(&factor.solve(&error)) <= threshold
}
