//! Checks of observation batches against the variables they refer to.
//!
//! Structure and finiteness only; whether a residual exists at the start is the solver's to find.

use nalgebra::Vector2;

use super::SolveError;
use crate::factors::{DepthReprojectionBatch, ReprojectionBatch};

/// How many poses, cameras and landmarks there are.
type Counts = (usize, usize, usize);

/// Checks lengths, indices and that every number is finite, sigmas positive.
pub(super) fn check_reprojections(
    batch: &ReprojectionBatch,
    counts: Counts,
) -> Result<(), SolveError> {
    let factor = "reprojection";
    check_indices(factor, [&batch.poses, &batch.cameras, &batch.landmarks], batch.len(), counts)?;
    check_sigmas(factor, &batch.sigmas_px, batch.len())?;
    check_pixels(factor, &batch.pixels)
}

/// As [`check_reprojections`], and the depths.
pub(super) fn check_depth_reprojections(
    batch: &DepthReprojectionBatch,
    counts: Counts,
) -> Result<(), SolveError> {
    let factor = "depth reprojection";
    check_indices(factor, [&batch.poses, &batch.cameras, &batch.landmarks], batch.len(), counts)?;
    check_sigmas(factor, &batch.sigmas_px, batch.len())?;
    check_sigmas(factor, &batch.sigmas_depth_m, batch.len())?;
    check_pixels(factor, &batch.pixels)?;
    check_length("depths_m", batch.depths_m.len(), batch.len())?;
    match batch.depths_m.iter().position(|d| !d.is_finite()) {
        Some(index) => Err(SolveError::NotFinite { what: factor, index: index as i64 }),
        None => Ok(()),
    }
}

fn check_length(what: &'static str, actual: usize, expected: usize) -> Result<(), SolveError> {
    if actual == expected {
        Ok(())
    } else {
        Err(SolveError::LengthMismatch { what, actual, expected })
    }
}

fn check_indices(
    factor: &'static str,
    indices: [&[u32]; 3],
    expected: usize,
    counts: Counts,
) -> Result<(), SolveError> {
    let names = [("pose", counts.0), ("camera", counts.1), ("landmark", counts.2)];
    for ((variable, count), indices) in names.into_iter().zip(indices) {
        check_length(variable, indices.len(), expected)?;
        if let Some(index) = indices.iter().position(|&v| v as usize >= count) {
            let value = indices[index] as usize;
            return Err(SolveError::IndexOutOfRange { factor, index, variable, value, count });
        }
    }
    Ok(())
}

fn check_sigmas(factor: &'static str, sigmas: &[f64], expected: usize) -> Result<(), SolveError> {
    check_length("sigmas", sigmas.len(), expected)?;
    match sigmas.iter().position(|&s| !(s.is_finite() && s > 0.0)) {
        Some(index) => Err(SolveError::NotPositiveDefinite { factor, index }),
        None => Ok(()),
    }
}

fn check_pixels(what: &'static str, pixels: &[Vector2<f64>]) -> Result<(), SolveError> {
    match pixels.iter().position(|p| !(p.x.is_finite() && p.y.is_finite())) {
        Some(index) => Err(SolveError::NotFinite { what, index: index as i64 }),
        None => Ok(()),
    }
}
