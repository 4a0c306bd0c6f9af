//! The reduced system of the separators: the sections' contributions, summed in their order.
//!
//! Its blocks are those of the whole reduced system that separate. It knows sections only by where
//! their borders' unknowns stand.

use std::sync::Arc;

use crate::interrupt::Interrupt;
use crate::linear::{BlockMatrix, BlockPattern, Cholesky, LinearError};
use crate::optimizer::{damping_scale, from_linear};
use crate::price::Ceiling;
use crate::problem::{BundleProblem, SolveError};

use super::message::{BorderPart, Contribution};
use super::partition::{Members, Partition};

/// Consecutive unknowns of a border that are consecutive in a block of the separators' system.
#[derive(Clone, Copy, Debug)]
struct Piece {
    /// First unknown in the border.
    first: usize,
    size: usize,
    block: usize,
    /// First unknown in the block.
    column: usize,
}

/// The system, with sums of the last linearization.
pub(super) struct Separator {
    /// For each section.
    pieces: Vec<Vec<Piece>>,
    cholesky: Option<Box<Cholesky>>,
    matrix: BlockMatrix,
    right: Vec<f64>,
    /// −g before anything is eliminated has another sign than `right`: this is g.
    gradient: Vec<f64>,
    diagonal: Vec<f64>,
}

impl Separator {
    /// Plans the system for borders as the sections named them. `None` where a border names a variable
    /// that the section does not share.
    pub(super) fn new(
        problem: &BundleProblem,
        partition: &Partition,
        borders: &[Vec<BorderPart>],
        ceiling: Ceiling,
        interrupt: &Interrupt,
    ) -> Result<Option<Self>, SolveError> {
        let blocks = &partition.blocks;
        let mut number = vec![None; blocks.sizes.len()];
        let mut sizes = Vec::new();
        for (block, &size) in blocks.sizes.iter().enumerate() {
            if partition.is_separator[block] {
                number[block] = Some(sizes.len());
                sizes.push(size);
            }
        }
        let mut pieces = Vec::with_capacity(borders.len());
        let mut pairs = Vec::new();
        for (border, members) in borders.iter().zip(&partition.sections) {
            let mut first = 0;
            let mut found = Vec::with_capacity(border.len());
            for &part in border {
                let Some((block, column, size)) = block_of(problem, partition, members, part)
                else {
                    return Ok(None);
                };
                let Some(block) = number.get(block as usize).copied().flatten() else {
                    return Ok(None);
                };
                found.push(Piece { first, size, block, column });
                first += size;
            }
            let met: Vec<usize> = found.iter().map(|piece| piece.block).collect();
            for (k, &i) in met.iter().enumerate() {
                pairs.extend(met[..k].iter().map(|&j| (i, j)));
            }
            pieces.push(found);
        }
        let pattern = Arc::new(BlockPattern::new(sizes, pairs));
        let dimension = pattern.dimension();
        let failed = |error: LinearError| from_linear(error, dimension);
        let cholesky = match dimension {
            0 => None,
            _ => Some(Box::new(
                Cholesky::within(Arc::clone(&pattern), ceiling, interrupt).map_err(failed)?,
            )),
        };
        let zero = vec![0.0; dimension];
        Ok(Some(Self {
            pieces,
            cholesky,
            matrix: BlockMatrix::new(pattern),
            right: zero.clone(),
            gradient: zero.clone(),
            diagonal: zero,
        }))
    }

    /// Unknowns.
    pub(super) fn dimension(&self) -> usize {
        self.right.len()
    }

    /// Forgets the last linearization.
    pub(super) fn clear(&mut self) {
        self.matrix.set_zero();
        for vector in [&mut self.right, &mut self.gradient, &mut self.diagonal] {
            vector.fill(0.0);
        }
    }

    /// Adds what a section leaves on its border; false where it has another shape.
    pub(super) fn add(&mut self, section: usize, contribution: &Contribution) -> bool {
        let size = self.border_dimension(section);
        let vectors = [&contribution.gradient, &contribution.diagonal];
        if vectors.iter().any(|vector| vector.len() != size) {
            return false;
        }
        let mut gradient = std::mem::take(&mut self.gradient);
        let mut diagonal = std::mem::take(&mut self.diagonal);
        self.scatter(section, &contribution.gradient, &mut gradient);
        self.scatter(section, &contribution.diagonal, &mut diagonal);
        (self.gradient, self.diagonal) = (gradient, diagonal);
        if !contribution.is_definite {
            return true;
        }
        if contribution.right.len() != size || contribution.matrix.len() != size * (size + 1) / 2 {
            return false;
        }
        let mut right = std::mem::take(&mut self.right);
        self.scatter(section, &contribution.right, &mut right);
        self.right = right;
        for (k, p) in self.pieces[section].iter().enumerate() {
            for q in &self.pieces[section][..=k] {
                add_piece(&mut self.matrix, (p, q), &contribution.matrix, size);
            }
        }
        true
    }

    fn border_dimension(&self, section: usize) -> usize {
        self.pieces[section].last().map_or(0, |piece| piece.first + piece.size)
    }

    /// Adds a section's vector over its border to one over all separators.
    pub(super) fn scatter(&self, section: usize, border: &[f64], all: &mut [f64]) {
        for piece in &self.pieces[section] {
            let offset = self.matrix.pattern().offset(piece.block) + piece.column;
            let target = &mut all[offset..offset + piece.size];
            for (t, s) in target.iter_mut().zip(&border[piece.first..piece.first + piece.size]) {
                *t += s;
            }
        }
    }

    /// A section's part of a vector over all separators.
    pub(super) fn gathered(&self, section: usize, all: &[f64]) -> Vec<f64> {
        let mut border = Vec::with_capacity(self.border_dimension(section));
        for piece in &self.pieces[section] {
            let offset = self.matrix.pattern().offset(piece.block) + piece.column;
            border.extend_from_slice(&all[offset..offset + piece.size]);
        }
        border
    }

    /// Largest |g_i| / √D_i.
    pub(super) fn gradient_max_norm(&self) -> f64 {
        let entries = self.gradient.iter().zip(&self.diagonal);
        entries.map(|(g, d)| g.abs() / damping_scale(*d).sqrt()).fold(0.0, f64::max)
    }

    /// λD.
    pub(super) fn added(&self, damping: f64) -> Vec<f64> {
        self.diagonal.iter().map(|d| damping * damping_scale(*d)).collect()
    }

    /// δᵀ(λDδ − g) and ‖δ‖² of a step.
    pub(super) fn decrease(&self, step: &[f64], added: &[f64]) -> (f64, f64) {
        let mut sums = (0.0, 0.0);
        for ((delta, added), gradient) in step.iter().zip(added).zip(&self.gradient) {
            sums.0 += delta * (added * delta - gradient);
            sums.1 += delta * delta;
        }
        sums
    }

    /// Solves for the step.
    ///
    /// # Errors
    /// Not positive definite, not finite, interrupted.
    pub(super) fn solve(
        &mut self,
        added: &[f64],
        interrupt: &Interrupt,
    ) -> Result<Vec<f64>, LinearError> {
        let mut step = vec![0.0; self.dimension()];
        if let Some(cholesky) = &mut self.cholesky {
            cholesky.factor_until(&self.matrix, added, interrupt)?;
            cholesky.solve_checked(&self.matrix, added, &self.right, &mut step);
        }
        Ok(step)
    }
}

/// Block of the whole reduced system, first unknown in it and size of a part of a border.
fn block_of(
    problem: &BundleProblem,
    partition: &Partition,
    members: &Members,
    part: BorderPart,
) -> Option<(u32, usize, usize)> {
    let blocks = &partition.blocks;
    match part {
        BorderPart::Pose(pose) => {
            let id = *members.poses.get(pose as usize)? as usize;
            Some((blocks.of_pose[id], 0, 6))
        }
        BorderPart::Camera(camera) => {
            let id = *members.cameras.get(camera as usize)? as usize;
            let (block, column) = blocks.of_camera[id];
            Some((block, column, problem.camera_unknowns(id)))
        }
    }
}

/// Adds the entries of two pieces, the later one first, from a packed lower triangle of `size` rows.
fn add_piece(matrix: &mut BlockMatrix, (p, q): (&Piece, &Piece), lower: &[f64], size: usize) {
    let (row_block, column_block) = (p.block.max(q.block), p.block.min(q.block));
    let stride = matrix.pattern().sizes()[row_block];
    let Some(block) = matrix.block_mut(row_block, column_block) else { return };
    for c in 0..q.size {
        let j = q.first + c;
        // Column j begins after the longer ones before it.
        let column = j * size - j * j.saturating_sub(1) / 2;
        for r in 0..p.size {
            let i = p.first + r;
            if i < j {
                continue;
            }
            let (mut row, mut col) = (p.column + r, q.column + c);
            // Only the lower triangle of a diagonal block counts.
            if p.block < q.block || (p.block == q.block && row < col) {
                std::mem::swap(&mut row, &mut col);
            }
            block[col * stride + row] += lower[column + i - j];
        }
    }
}
