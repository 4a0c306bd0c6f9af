//! Schur elimination of the landmarks for one damping.
//!
//! For each landmark H_ll + λD = L Lᵀ and y = L⁻¹ g_l, for each of its observations E = W L⁻ᵀ. The
//! reduced camera system is S = H_vv + λD − Σ E Eᵀ with right side −(g_v − Σ E y); landmarks follow
//! as δ_l = −L⁻ᵀ(y + Σ Eᵀ δ_v). Each block row of S is computed by its owner, which sums its
//! observations in landmark order, so that no sum depends on the number of threads.

use nalgebra::{Matrix3, SMatrix, Vector3};
use rayon::prelude::*;

use super::landmarks::LandmarkBlock;
use super::layout::{Layout, Part};
use crate::linear::{BlockMatrix, BlockRowMut};

/// Diagonal entries of D are kept in this range, so that directions without information are damped.
const DIAGONAL_RANGE: (f64, f64) = (1e-6, 1e32);

/// Marquardt's scale of a diagonal entry of H.
pub(super) fn damping_scale(diagonal: f64) -> f64 {
    diagonal.clamp(DIAGONAL_RANGE.0, DIAGONAL_RANGE.1)
}

/// The factored landmark: L (lower) and y.
#[derive(Clone, Copy, Debug)]
pub(super) struct Eliminated {
    factor: Matrix3<f64>,
    y: Vector3<f64>,
}

impl Eliminated {
    /// Before the first elimination.
    pub(super) const NONE: Self = Self {
        factor: Matrix3::new(1., 0., 0., 0., 1., 0., 0., 0., 1.),
        y: Vector3::new(0., 0., 0.),
    };

    /// Factors H_ll + λD; `None` where it is not positive definite.
    pub(super) fn new(block: &LandmarkBlock, damping: f64) -> Option<Self> {
        let mut h = block.hessian;
        for i in 0..3 {
            h[(i, i)] += damping * damping_scale(h[(i, i)]);
        }
        let l00 = positive(h[(0, 0)])?.sqrt();
        let l10 = h[(1, 0)] / l00;
        let l20 = h[(2, 0)] / l00;
        let l11 = positive(h[(1, 1)] - l10 * l10)?.sqrt();
        let l21 = (h[(2, 1)] - l20 * l10) / l11;
        let l22 = positive(h[(2, 2)] - l20 * l20 - l21 * l21)?.sqrt();
        let factor = Matrix3::new(l00, 0.0, 0.0, l10, l11, 0.0, l20, l21, l22);
        let g = &block.gradient;
        let y0 = g.x / l00;
        let y1 = (g.y - l10 * y0) / l11;
        let y2 = (g.z - l20 * y0 - l21 * y1) / l22;
        Some(Self { factor, y: Vector3::new(y0, y1, y2) })
    }

    /// E = W L⁻ᵀ.
    pub(super) fn whiten<const D: usize>(&self, cross: &SMatrix<f64, D, 3>) -> SMatrix<f64, D, 3> {
        let l = &self.factor;
        let first = cross.column(0) / l[(0, 0)];
        let second = (cross.column(1) - first * l[(1, 0)]) / l[(1, 1)];
        let third = (cross.column(2) - first * l[(2, 0)] - second * l[(2, 1)]) / l[(2, 2)];
        SMatrix::from_columns(&[first, second, third])
    }

    /// −L⁻ᵀ(y + s) with s = Σ Eᵀ δ_v.
    pub(super) fn step(&self, s: &Vector3<f64>) -> Vector3<f64> {
        let l = &self.factor;
        let b = self.y + s;
        let z = b.z / l[(2, 2)];
        let y = (b.y - l[(2, 1)] * z) / l[(1, 1)];
        let x = (b.x - l[(1, 0)] * y - l[(2, 0)] * z) / l[(0, 0)];
        -Vector3::new(x, y, z)
    }
}

fn positive(pivot: f64) -> Option<f64> {
    (pivot > 0.0 && pivot.is_finite()).then_some(pivot)
}

/// What the owners read.
pub(super) struct Elimination<'a, const D: usize> {
    pub(super) layout: &'a Layout,
    pub(super) constant_landmarks: &'a [bool],
    pub(super) eliminated: &'a [Eliminated],
    pub(super) whitened: &'a [SMatrix<f64, D, 3>],
}

impl<const D: usize> Elimination<'_, D> {
    /// Subtracts Σ E Eᵀ from `reduced` and Σ E y from `gradient`, which hold H_vv and g_v.
    pub(super) fn subtract(&self, reduced: &mut BlockMatrix, gradient: &mut [f64]) {
        let blocks = self.layout.block_sizes.len();
        let mut rows = reduced.rows_mut();
        let mut rest = gradient;
        let mut owners = Vec::with_capacity(blocks);
        for (row, &size) in rows.iter_mut().zip(&self.layout.block_sizes) {
            let (head, tail) = rest.split_at_mut(size);
            rest = tail;
            owners.push((row, head));
        }
        owners.into_par_iter().enumerate().for_each_init(
            || vec![0_usize; blocks],
            |starts, (block, (row, gradient))| self.own(block as u32, row, gradient, starts),
        );
    }

    /// Computes block row `block`. `starts` is scratch: where in the row each column's values begin.
    fn own(
        &self,
        block: u32,
        row: &mut BlockRowMut<'_>,
        gradient: &mut [f64],
        starts: &mut [usize],
    ) {
        let sizes = &self.layout.block_sizes;
        let stride = sizes[block as usize];
        let mut begin = 0;
        for &column in row.columns() {
            starts[column as usize] = begin;
            begin += stride * sizes[column as usize];
        }
        let values = row.values_mut();
        for &index in &self.layout.block_observations[block as usize] {
            let index = index as usize;
            let landmark = self.layout.landmark_of[index] as usize;
            if self.constant_landmarks[landmark] {
                continue;
            }
            let Some(own) = self.part_in(index, block) else { continue };
            let left = &self.whitened[index];
            let y = &self.eliminated[landmark].y;
            for r in 0..own.size {
                let e = left.row(own.column + r);
                gradient[r] -= e[0] * y.x + e[1] * y.y + e[2] * y.z;
            }
            for other in self.layout.track(landmark) {
                let view = &self.layout.views[self.layout.observations[other].view as usize];
                for part in view.parts.iter().filter(|p| p.block <= block) {
                    let target = &mut values[starts[part.block as usize]..];
                    let right = &self.whitened[other];
                    subtract_outer(target, stride, (left, own), (right, part));
                }
            }
        }
    }

    fn part_in(&self, index: usize, block: u32) -> Option<&Part> {
        let view = &self.layout.views[self.layout.observations[index].view as usize];
        view.parts.iter().find(|p| p.block == block)
    }

    /// Σ Eᵀ δ_v over the track of `landmark`.
    pub(super) fn project(&self, landmark: usize, step: &[f64], offsets: &[usize]) -> Vector3<f64> {
        let mut sum = Vector3::zeros();
        for index in self.layout.track(landmark) {
            let view = &self.layout.views[self.layout.observations[index].view as usize];
            let e = &self.whitened[index];
            for part in &view.parts {
                let offset = offsets[part.block as usize];
                for r in 0..part.size {
                    let delta = step[offset + r];
                    for c in 0..3 {
                        sum[c] += e[(part.column + r, c)] * delta;
                    }
                }
            }
        }
        sum
    }
}

/// `target -= left · rightᵀ` on the columns of two parts; `target` is column-major with `stride`.
#[inline]
fn subtract_outer<const D: usize>(
    target: &mut [f64],
    stride: usize,
    (left, own): (&SMatrix<f64, D, 3>, &Part),
    (right, part): (&SMatrix<f64, D, 3>, &Part),
) {
    let (l, r) = (left.as_slice(), right.as_slice());
    let rows = own.column..own.column + own.size;
    let (l0, l1, l2) = (&l[rows.clone()], &l[D..][rows.clone()], &l[2 * D..][rows]);
    for c in 0..part.size {
        let k = part.column + c;
        let (r0, r1, r2) = (r[k], r[D + k], r[2 * D + k]);
        let column = &mut target[c * stride..c * stride + own.size];
        for (row, entry) in column.iter_mut().enumerate() {
            *entry -= l0[row] * r0 + l1[row] * r1 + l2[row] * r2;
        }
    }
}
