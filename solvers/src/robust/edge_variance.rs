//! By how much the stated covariances of a graph's edges are too small, as the positions say that were measured
//! in it.
//!
//! Relative poses from views share what is wrong with a camera: together they are much less certain than each
//! of them says, and a map can be bent by more than any of its parts. A few true positions then contradict
//! it, as many false ones would. Larger covariances of the edges meet true positions all at once, and false
//! ones one by one: the variance of the edges grows until the median of the positions' T ([`costs`]) is the
//! one of true ones. Nothing is judged here.

use super::positions::costs;
use crate::geometry::LieGroup;
use crate::interrupt::Interrupt;
use crate::loss::Loss;
use crate::optimizer::ignore_iterations;
use crate::pose_graph;
use crate::problem::{PoseGraph, SolveError};

/// Positions below which a median says little.
const LEAST_POSITIONS: usize = 5;

/// The median of χ² with three degrees of freedom, and by how much that of n true positions exceeds it at the
/// most: two deviations of a sample's median, 2.6/√n each, and what a fifth of false ones adds.
const MEDIAN: f64 = 2.366;
const DEVIATION: f64 = 2.6;
const LEAST_EXCESS: f64 = 0.9;

/// From one factor to the next that is tried, and the largest: a covariance that counts pixels with a common
/// error as independent is ten to a thousand times too small.
pub(crate) const STEP: f64 = 4.0;
pub(crate) const MAX_FACTOR: f64 = 1024.0;

/// Deviations past which a position pulls less while the factor is sought.
const WIDTH: f64 = 3.0;

/// By what the variance of the edges has to be multiplied to meet the positions, at least 1; 1 where no factor
/// does, and where `interrupt` ends the search. The poses of `graph` are where it ended.
///
/// # Errors
/// Those of [`pose_graph::solve`].
pub fn edge_variance_factor<G: LieGroup<N>, const N: usize>(
    graph: &mut PoseGraph<G, N>,
    options: &pose_graph::Options,
    interrupt: &Interrupt,
) -> Result<f64, SolveError> {
    let count = graph.position_priors.len();
    if count < LEAST_POSITIONS {
        return Ok(1.0);
    }
    for prior in &mut graph.position_priors {
        prior.loss = Loss::Cauchy(WIDTH);
    }
    let most = MEDIAN + (2.0 * DEVIATION / (count as f64).sqrt()).max(LEAST_EXCESS);
    let all = vec![true; count];
    let mut factor = 1.0;
    while factor <= MAX_FACTOR && !interrupt.is_due() {
        pose_graph::solve_until(graph, options, interrupt, &mut ignore_iterations)?;
        let mut found = match costs(graph, &all, interrupt) {
            Err(SolveError::Interrupted) => break,
            found => found?,
        };
        if *found.select_nth_unstable_by(count / 2, f64::total_cmp).1 <= most {
            return Ok(factor);
        }
        factor *= STEP;
        for edge in &mut graph.edges {
            edge.information = edge.information.scaled(1.0 / STEP);
        }
    }
    Ok(1.0)
}
