//! What ranges add to H and g.
//!
//! A range touches two variables and adds w JᵀJ to their blocks and w r Jᵀ to their gradients, w = ρ' / σ²
//! with ρ' of its loss. Ranges are summed in order on one thread, after the landmarks. A graph without ranges
//! is not touched.

use super::rows::Rows;
use crate::geometry::LieGroup;
use crate::linear::BlockMatrix;
use crate::problem::{PoseGraph, SolveError};

/// Names the first range that has no finite χ² at the graph's variables.
pub(super) fn check_finite<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
) -> Result<(), SolveError> {
    match graph.ranges.iter().position(|range| !graph.range_chi2(range).is_finite()) {
        Some(index) => Err(SolveError::ResidualNotFinite { factor: "range", index }),
        None => Ok(()),
    }
}

/// Adds what the ranges say to H and g, which hold all other factors already.
pub(super) fn add<G: LieGroup<N>, const N: usize>(
    graph: &PoseGraph<G, N>,
    rows: &Rows,
    hessian: &mut BlockMatrix,
    gradient: &mut [f64],
) {
    for range in &graph.ranges {
        let at = range.linearize(&range.ends.map(|end| graph.place(end)));
        let loss = range.loss.unwrap_or(graph.loss).evaluate(graph.range_chi2(range));
        let weight = loss.weight * range.precision;
        let rows = range.ends.map(|end| rows.of_end(end));
        for (row, d_end) in rows.iter().zip(&at.d_ends) {
            let Some(row) = *row else { continue };
            let (start, end) = (hessian.pattern().offset(row), hessian.pattern().offset(row + 1));
            let own = gradient[start..end].iter_mut().zip(d_end.iter());
            own.for_each(|(entry, d)| *entry += weight * at.residual * d);
        }
        for (&one, d_one) in rows.iter().zip(&at.d_ends) {
            for (&other, d_other) in rows.iter().zip(&at.d_ends) {
                // The lower triangle alone is stored.
                let Some((row, column)) = one.zip(other).filter(|(row, column)| row >= column)
                else {
                    continue;
                };
                let height = hessian.pattern().sizes()[row];
                let Some(values) = hessian.block_mut(row, column) else { continue };
                for (values, c) in values.chunks_exact_mut(height).zip(d_other.iter()) {
                    let entries = values.iter_mut().zip(d_one.iter());
                    entries.for_each(|(value, r)| *value += weight * r * c);
                }
            }
        }
    }
}
