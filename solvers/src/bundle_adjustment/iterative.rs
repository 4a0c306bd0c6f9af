//! Conjugate gradients on the reduced camera system without its matrix.
//!
//! Products come from [`Product`](super::product) over the chunks, state factors and the damping are
//! added; the preconditioner is the inverse of the system's diagonal blocks (Schur-Jacobi). Steps
//! are inexact on purpose. The matrix is never formed; whether this solver is used is decided in
//! `reduced_solver`.

use crate::linear::{BlockJacobi, BlockMatrix, LinearError, Pcg, Solved, StoppingRule};
use crate::parallel;

use super::blocks::ViewVector;
use super::eliminator::Pass;
use super::landmarks::LandmarkGroup;
use super::layout::Layout;
use super::product::{Product, ProductSums};
use super::sorted::{GROUPS, split};

/// Nash and Sofer's η: below it, further inner steps do not make the outer step better.
const FORCING: f64 = 0.1;

/// At most so many inner steps.
pub(super) const MAX_PRODUCTS: usize = 500;

/// The linearization that is multiplied with.
pub(super) struct Linearization<'a> {
    pub(super) pass: Pass<'a>,
    /// First unknown of each block.
    pub(super) offsets: &'a [usize],
    pub(super) groups: &'a [LandmarkGroup],
    /// H of the state factors, where there are any.
    pub(super) state_hessian: Option<&'a BlockMatrix>,
    /// λD.
    pub(super) added: &'a [f64],
}

/// The solver's memory.
#[derive(Debug)]
pub(super) struct Iterative<const D: usize, const V: usize, const T: usize, const R: usize> {
    pcg: Pcg,
    jacobi: BlockJacobi,
    workspace: Workspace<D, V, T, R>,
}

/// The memory of a product.
#[derive(Debug)]
struct Workspace<const D: usize, const V: usize, const T: usize, const R: usize> {
    sums: Vec<ProductSums<D, V, T, R>>,
    vectors: Vec<ViewVector<V, T>>,
    state_product: Vec<f64>,
}

impl<const D: usize, const V: usize, const T: usize, const R: usize> Iterative<D, V, T, R> {
    pub(super) fn new(layout: &Layout) -> Self {
        Self {
            pcg: Pcg::default(),
            jacobi: BlockJacobi::default(),
            workspace: Workspace {
                sums: layout.chunks().iter().map(|c| ProductSums::new(layout, c)).collect(),
                vectors: vec![ViewVector::ZERO; layout.views.len()],
                state_product: Vec::new(),
            },
        }
    }

    /// Solves (S + λD) x = g.
    pub(super) fn solve(
        &mut self,
        linearization: &Linearization<'_>,
        diagonal: &BlockMatrix,
        g: &[f64],
        x: &mut [f64],
    ) -> Result<Solved, LinearError> {
        self.jacobi.factor(diagonal, linearization.added)?;
        let Self { pcg, jacobi, workspace } = self;
        let multiply = |p: &[f64], q: &mut [f64]| linearization.multiply(p, q, workspace);
        let interrupt = linearization.pass.interrupt;
        let stop = StoppingRule { tolerance: FORCING, max_products: MAX_PRODUCTS };
        pcg.solve(multiply, jacobi, g, x, stop, interrupt)
    }
}

/// Each view's part of a vector over the unknowns.
pub(super) fn gather<const V: usize, const T: usize>(
    layout: &Layout,
    offsets: &[usize],
    x: &[f64],
    vectors: &mut [ViewVector<V, T>],
) {
    for (view, vector) in layout.views.iter().zip(vectors) {
        *vector = ViewVector::ZERO;
        for part in &view.parts {
            let offset = offsets[part.block as usize];
            for i in 0..part.size {
                *vector.get_mut(part.column + i) = x[offset + i];
            }
        }
    }
}

impl Linearization<'_> {
    fn multiply<const D: usize, const V: usize, const T: usize, const R: usize>(
        &self,
        p: &[f64],
        q: &mut [f64],
        workspace: &mut Workspace<D, V, T, R>,
    ) {
        let Workspace { sums, vectors, state_product } = workspace;
        let Self { pass, offsets, groups, .. } = *self;
        let Pass { inputs, layout, class, interrupt } = pass;
        gather(layout, offsets, p, vectors);
        let vectors = vectors.as_slice();
        parallel::for_each(layout.chunks().iter().zip(sums.iter_mut()), |(chunk, sums)| {
            let groups = &groups[chunk.tiles.start * GROUPS..chunk.tiles.end * GROUPS];
            inputs.run(
                class,
                Product::<D, V, T, R> { inputs, layout, chunk, groups, vectors, sums, interrupt },
            );
        });
        for ((q, p), added) in q.iter_mut().zip(p).zip(self.added) {
            *q = added * p;
        }
        for (chunk, sums) in layout.chunks().iter().zip(sums.iter()) {
            for (&view, sum) in chunk.views.iter().zip(&sums.views) {
                for part in &layout.views[view as usize].parts {
                    let offset = offsets[part.block as usize];
                    for i in 0..part.size {
                        q[offset + i] += sum.get(part.column + i);
                    }
                }
            }
        }
        if let Some(hessian) = self.state_hessian {
            state_product.resize(p.len(), 0.0);
            hessian.symmetric_multiply(p, state_product);
            q.iter_mut().zip(state_product.iter()).for_each(|(q, x)| *q += x);
        }
    }
}

/// The groups of each chunk.
pub(super) fn split_groups<'a>(
    layout: &Layout,
    groups: &'a mut [LandmarkGroup],
) -> Vec<&'a mut [LandmarkGroup]> {
    split(groups, layout.chunks().iter().map(|c| c.tiles.len() * GROUPS))
}
