//! Factors beside observations: relative poses, pose priors, position priors.
//!
//! [`StateFactor`] is a closed enum. Each variant names its variables, evaluates its residual and gives
//! a [`Linearized`] to one [`Sink`], which takes variables of any size. Costs, patterns and normal
//! equations iterate over [`all`] of them, so that a new kind of factor is a new variant. There are few
//! of these factors: they are summed in order on one thread. Observations are not read here.

use std::ops::Range;
use std::sync::Arc;

use nalgebra::{SMatrix, SVector};

use super::layout::{Layout, Place};
use crate::factors::{PosePrior, PositionPrior, RelativePose};
use crate::geometry::Se3;
use crate::information::Information;
use crate::linear::{BlockMatrix, BlockPattern};
use crate::loss::Loss;
use crate::problem::BundleProblem;

/// A variable of a state factor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Variable {
    /// A pose, by index.
    Pose(usize),
}

impl Variable {
    /// Dimension of its tangent space.
    pub(super) const fn size(self) -> usize {
        match self {
            Self::Pose(_) => 6,
        }
    }
}

/// A factor beside the observations.
#[derive(Clone, Copy, Debug)]
pub(super) enum StateFactor<'a> {
    /// A relative pose and its loss.
    RelativePose(&'a RelativePose<Se3, 6>, Loss),
    /// A prior on a whole pose.
    PosePrior(&'a PosePrior),
    /// A prior on the position of a point fixed to a pose.
    PositionPrior(&'a PositionPrior),
}

/// All state factors of a problem, by kind. Sums over them have this order.
pub(super) fn all(problem: &BundleProblem) -> impl Iterator<Item = StateFactor<'_>> {
    let relative_poses = problem.relative_poses.iter().map(|factor| {
        StateFactor::RelativePose(factor, factor.loss.unwrap_or(problem.relative_pose_loss))
    });
    let pose_priors = problem.pose_priors.iter().map(StateFactor::PosePrior);
    let position_priors = problem.position_priors.iter().map(StateFactor::PositionPrior);
    relative_poses.chain(pose_priors).chain(position_priors)
}

impl StateFactor<'_> {
    /// The variables that the residual depends on.
    pub(super) fn variables(&self) -> impl Iterator<Item = Variable> + Clone + use<> {
        let (first, second) = match *self {
            Self::RelativePose(factor, _) => (factor.i, Some(factor.j)),
            Self::PosePrior(factor) => (factor.pose, None),
            Self::PositionPrior(factor) => (factor.pose, None),
        };
        std::iter::once(first).chain(second).map(Variable::Pose)
    }

    /// Pairs of its variables, each once.
    pub(super) fn pairs(&self) -> impl Iterator<Item = (Variable, Variable)> + use<> {
        let variables = self.variables();
        let firsts = variables.clone().enumerate();
        firsts.flat_map(move |(k, a)| variables.clone().skip(k + 1).map(move |b| (a, b)))
    }

    /// ρ(rᵀΩr) at the present values.
    fn rho(&self, problem: &BundleProblem) -> f64 {
        let poses = &problem.poses;
        match *self {
            Self::RelativePose(factor, loss) => {
                loss.evaluate(factor.chi2(&poses[factor.i], &poses[factor.j])).rho
            }
            Self::PosePrior(factor) => factor.loss.evaluate(factor.chi2(&poses[factor.pose])).rho,
            Self::PositionPrior(factor) => {
                factor.loss.evaluate(factor.chi2(&poses[factor.pose])).rho
            }
        }
    }

    /// Linearizes it at the present values into `sink`.
    pub(super) fn linearize(&self, problem: &BundleProblem, sink: &mut impl Sink) {
        let poses = &problem.poses;
        match *self {
            Self::RelativePose(factor, loss) => {
                let pair = factor.linearize(&poses[factor.i], &poses[factor.j]);
                let mut jacobian = SMatrix::<f64, 6, 12>::zeros();
                jacobian.fixed_columns_mut::<6>(0).copy_from(&pair.d_i);
                jacobian.fixed_columns_mut::<6>(6).copy_from(&pair.d_j);
                sink.add(&Linearized {
                    residual: pair.residual,
                    jacobian,
                    variables: [Variable::Pose(factor.i), Variable::Pose(factor.j)],
                    information: &factor.information,
                    loss,
                });
            }
            Self::PosePrior(factor) => {
                let (residual, jacobian) = factor.linearize(&poses[factor.pose]);
                sink.add(&Linearized {
                    residual,
                    jacobian,
                    variables: [Variable::Pose(factor.pose)],
                    information: &factor.information,
                    loss: factor.loss,
                });
            }
            Self::PositionPrior(factor) => {
                let (residual, jacobian) = factor.linearize(&poses[factor.pose]);
                sink.add(&Linearized {
                    residual,
                    jacobian,
                    variables: [Variable::Pose(factor.pose)],
                    information: &factor.information,
                    loss: factor.loss,
                });
            }
        }
    }
}

/// A factor with an R-vector residual, linearized in K variables that have C columns together.
pub(super) struct Linearized<'a, const R: usize, const C: usize, const K: usize> {
    /// r, not whitened.
    pub(super) residual: SVector<f64, R>,
    /// ∂r/∂δ: the columns of each variable follow those of the one before.
    pub(super) jacobian: SMatrix<f64, R, C>,
    pub(super) variables: [Variable; K],
    /// Ω.
    pub(super) information: &'a Information<R>,
    pub(super) loss: Loss,
}

impl<const R: usize, const C: usize, const K: usize> Linearized<'_, R, C, K> {
    /// Each variable with its columns of the Jacobian.
    pub(super) fn columns(&self) -> [(Variable, Range<usize>); K] {
        let mut first = 0;
        self.variables.map(|variable| {
            let columns = first..first + variable.size();
            first = columns.end;
            (variable, columns)
        })
    }
}

/// What takes linearized factors.
pub(super) trait Sink {
    /// Adds what the factor says about its variables.
    fn add<const R: usize, const C: usize, const K: usize>(
        &mut self,
        factor: &Linearized<'_, R, C, K>,
    );
}

/// Pairs of blocks that factors tie together.
pub(super) fn block_pairs(problem: &BundleProblem, layout: &Layout) -> Vec<(usize, usize)> {
    all(problem)
        .flat_map(|factor| factor.pairs())
        .filter_map(|(a, b)| Some((layout.place(a)?.block, layout.place(b)?.block)))
        .collect()
}

/// Whether there is any.
pub(super) fn has_any(problem: &BundleProblem) -> bool {
    all(problem).next().is_some()
}

/// ½ Σ ρ over all state factors.
pub(super) fn cost(problem: &BundleProblem) -> f64 {
    let mut sum = 0.0;
    for factor in all(problem) {
        sum += factor.rho(problem);
    }
    0.5 * sum
}

/// A matrix for H of all state factors.
pub(super) fn hessian(problem: &BundleProblem, layout: &Layout) -> BlockMatrix {
    let pairs = block_pairs(problem, layout);
    BlockMatrix::new(Arc::new(BlockPattern::new(layout.block_sizes.clone(), pairs)))
}

/// H of all state factors, set, and their gradient, added; `stiffness` as in [`super::observe::Inputs`].
pub(super) fn linearize(
    problem: &BundleProblem,
    layout: &Layout,
    hessian: &mut BlockMatrix,
    gradient: &mut [f64],
    stiffness: f64,
) {
    hessian.set_zero();
    let mut sink = NormalEquations { layout, hessian, gradient, stiffness };
    for factor in all(problem) {
        factor.linearize(problem, &mut sink);
    }
}

/// Sums H and the gradient by block.
struct NormalEquations<'a> {
    layout: &'a Layout,
    hessian: &'a mut BlockMatrix,
    gradient: &'a mut [f64],
    stiffness: f64,
}

impl Sink for NormalEquations<'_> {
    fn add<const R: usize, const C: usize, const K: usize>(
        &mut self,
        factor: &Linearized<'_, R, C, K>,
    ) {
        let Linearized { residual, jacobian, information, .. } = factor;
        let s = information.squared_norm(residual);
        let loss = factor.loss.evaluate(s);
        // Both are ρ' JᵀΩ. The order decides the last bits, and stored results have these.
        let left = match K {
            1 => jacobian.transpose() * information.matrix() * loss.weight,
            _ => jacobian.transpose() * (information.matrix() * loss.weight),
        };
        let gradient = left * residual;
        // The factor's curvature is ρ' JᵀΩJ − k g gᵀ.
        let mut curvature = left * jacobian;
        let k = loss.flattening(s, self.stiffness);
        if k > 0.0 {
            curvature.ger(-k, &gradient, &gradient, 1.0);
        }
        let parts = factor.columns().map(|(variable, columns)| {
            self.layout.place(variable).map(|place| Part { place, columns })
        });
        for part in parts.iter().flatten() {
            self.add_gradient(&gradient, part);
        }
        for part in parts.iter().flatten() {
            self.add_block(&curvature, part, part);
        }
        for (k, b) in parts.iter().enumerate() {
            for a in &parts[..k] {
                if let (Some(a), Some(b)) = (a, b) {
                    self.add_cross(&curvature, a, b);
                }
            }
        }
    }
}

/// A variable of a factor that is in the reduced system.
struct Part {
    place: Place,
    /// Its columns in the factor's Jacobian.
    columns: Range<usize>,
}

impl NormalEquations<'_> {
    fn add_gradient<const C: usize>(&mut self, values: &SVector<f64, C>, part: &Part) {
        let first = self.hessian.pattern().offset(part.place.block) + part.place.column;
        let entries = &mut self.gradient[first..][..part.columns.len()];
        for (entry, value) in entries.iter_mut().zip(&values.as_slice()[part.columns.clone()]) {
            *entry += value;
        }
    }

    /// Adds the entries between two different variables to the triangle that is stored.
    fn add_cross<const C: usize>(&mut self, curvature: &SMatrix<f64, C, C>, a: &Part, b: &Part) {
        if a.place.block >= b.place.block {
            self.add_block(curvature, a, b);
        }
        // A diagonal block stores both triangles.
        if a.place.block <= b.place.block {
            self.add_block(curvature, b, a);
        }
    }

    /// Adds the entries in the rows of `a` and the columns of `b` to their block.
    fn add_block<const C: usize>(&mut self, curvature: &SMatrix<f64, C, C>, a: &Part, b: &Part) {
        let stride = self.layout.block_sizes[a.place.block];
        let Some(block) = self.hessian.block_mut(a.place.block, b.place.block) else { return };
        for (c, column) in b.columns.clone().enumerate() {
            for (r, row) in a.columns.clone().enumerate() {
                let entry = (b.place.column + c) * stride + a.place.column + r;
                block[entry] += curvature[(row, column)];
            }
        }
    }
}
