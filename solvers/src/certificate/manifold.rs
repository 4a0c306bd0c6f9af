//! Poses whose rotations have D orthonormal columns of p ≥ D entries, and Newton's method on them.
//!
//! The product of Stiefel manifolds with free translations, as SE-Sync relaxes rotations. Minimizes
//! tr(X M Xᵀ) by a Riemannian trust region whose steps come from preconditioned truncated conjugate
//! gradients (Absil, Baker and Gallivan 2007). It knows the quadratic form, not the graph.

use nalgebra::SMatrix;

use super::quadratic::Lifted;
use crate::interrupt::Interrupt;
use crate::linear::{BlockMatrix, Cholesky, LinearError};
use crate::price::Limits;

/// Most outer steps.
const MAX_STEPS: usize = 200;

/// Most inner steps of one outer step.
const MAX_INNER_STEPS: usize = 200;

/// The matrix M with what its minimization needs.
pub(super) struct Problem<'a> {
    pub(super) matrix: &'a BlockMatrix,
    preconditioner: Cholesky,
    /// Asked before each step, inner ones too; the state is then as good as it became.
    interrupt: &'a Interrupt,
}

impl<'a> Problem<'a> {
    /// Factors M, a little of its diagonal added, which preconditions every step.
    pub(super) fn new(matrix: &'a BlockMatrix, limits: Limits<'a>) -> Result<Self, LinearError> {
        let Limits { ceiling, interrupt } = limits;
        let diagonal = matrix.diagonal();
        let pattern = std::sync::Arc::clone(matrix.pattern());
        let mut preconditioner = Cholesky::within(pattern, ceiling, interrupt)?;
        let mut share = 1e-10;
        loop {
            let added: Vec<f64> = diagonal.iter().map(|d| share * d).collect();
            match preconditioner.factor_until(matrix, &added, interrupt) {
                Ok(()) => return Ok(Self { matrix, preconditioner, interrupt }),
                // Rounding may leave the semidefinite matrix indefinite.
                Err(LinearError::NotPositiveDefinite { .. }) if share < 1.0 => share *= 100.0,
                Err(error) => return Err(error),
            }
        }
    }

    /// Minimizes from `x` until no entry of the gradient is larger than `tolerance` times the scale
    /// of M; returns F.
    pub(super) fn minimize<const D: usize>(&mut self, x: &mut Lifted, tolerance: f64) -> f64 {
        let mut product = x.times(self.matrix);
        let mut value = x.dot(&product);
        let mut radius = (x.rows[0].len() as f64).sqrt();
        let largest_radius = 10.0 * radius;
        let scale = self.matrix.diagonal().iter().fold(0.0_f64, |m, d| m.max(*d));
        let gradient_of = |x: &Lifted, product: &Lifted| {
            let multipliers = multipliers::<D>(x, product);
            let mut gradient = product.clone();
            subtract_multiplied::<D>(&mut gradient, x, &multipliers);
            let norm = gradient.rows.iter().flatten().fold(0.0_f64, |m, g| m.max(g.abs()));
            (multipliers, gradient, norm)
        };
        for _ in 0..MAX_STEPS {
            if self.interrupt.is_due() {
                break;
            }
            let (multipliers, gradient, norm) = gradient_of(x, &product);
            if norm <= tolerance * scale {
                break;
            }
            let (step, predicted) = self.step::<D>(x, &multipliers, &gradient, radius);
            let mut trial = x.clone();
            trial.add_scaled(1.0, &step);
            retract::<D>(&mut trial);
            let trial_product = trial.times(self.matrix);
            let trial_value = trial.dot(&trial_product);
            let decrease = value - trial_value;
            // F is a small difference of large terms. Near the optimum their rounding hides what the
            // model still sees; then the gradient tells whether a step was good.
            let is_resolved = predicted > f64::EPSILON * scale * x.dot(x);
            let is_better = is_resolved || gradient_of(&trial, &trial_product).2 < norm;
            let quality = match is_resolved {
                true => decrease / predicted,
                false => f64::from(u8::from(is_better)),
            };
            if quality < 0.25 {
                radius *= 0.25;
            } else if quality > 0.75 {
                radius = (2.0 * radius).min(largest_radius);
            }
            if quality > 0.05 && trial_value.is_finite() {
                (*x, product, value) = (trial, trial_product, trial_value);
            }
            if radius < 1e-12 || !is_better {
                break;
            }
        }
        value
    }

    /// A step within `radius` and the decrease of F that the model promises (Steihaug and Toint).
    fn step<const D: usize>(
        &mut self,
        x: &Lifted,
        multipliers: &[SMatrix<f64, D, D>],
        gradient: &Lifted,
        radius: f64,
    ) -> (Lifted, f64) {
        let mut step = x.zeros_like();
        let mut residual = gradient.clone();
        let mut z = self.precondition::<D>(x, &residual);
        let mut direction = z.clone();
        direction.scale(-1.0);
        let mut rz = residual.dot(&z);
        let first = rz;
        let mut model = 0.0;
        for _ in 0..MAX_INNER_STEPS {
            if self.interrupt.is_due() {
                break;
            }
            // Half the Hessian of F: V ↦ P(V M − V_R Λ).
            let mut curved = direction.times(self.matrix);
            subtract_multiplied::<D>(&mut curved, &direction, multipliers);
            project::<D>(x, &mut curved);
            let curvature = direction.dot(&curved);
            let alpha = rz / curvature;
            let mut next = step.clone();
            next.add_scaled(alpha, &direction);
            let is_convex = curvature > 0.0;
            if !is_convex || next.dot(&next) >= radius * radius {
                let tau = to_boundary(&step, &direction, radius);
                step.add_scaled(tau, &direction);
                model += tau * residual.dot(&direction) + 0.5 * tau * tau * curvature;
                break;
            }
            model -= 0.5 * alpha * rz;
            step = next;
            residual.add_scaled(alpha, &curved);
            z = self.precondition::<D>(x, &residual);
            let before = rz;
            rz = residual.dot(&z);
            // Superlinear near the optimum.
            if rz <= first * (first / (1.0 + first)).min(1e-2) || rz <= 0.0 || rz.is_nan() {
                break;
            }
            direction.scale(rz / before);
            direction.add_scaled(-1.0, &z);
        }
        (step, -2.0 * model)
    }

    fn precondition<const D: usize>(&mut self, x: &Lifted, v: &Lifted) -> Lifted {
        let mut z = v.clone();
        for row in &mut z.rows {
            self.preconditioner.solve(row);
        }
        project::<D>(x, &mut z);
        z
    }
}

/// How far along `direction` the sphere of `radius` is.
fn to_boundary(step: &Lifted, direction: &Lifted, radius: f64) -> f64 {
    let (a, b) = (direction.dot(direction), step.dot(direction));
    let c = step.dot(step) - radius * radius;
    (-b + (b * b - a * c).max(0.0).sqrt()) / a
}

/// Λ_i = sym(Y_iᵀ (X M)_i) for the rotation part Y_i of each pose: the multipliers of YᵀY = I.
pub(super) fn multipliers<const D: usize>(x: &Lifted, product: &Lifted) -> Vec<SMatrix<f64, D, D>> {
    let count = x.rows[0].len() / (D + 1);
    (0..count).map(|i| symmetric_product::<D>(x, product, i)).collect()
}

/// sym(A_iᵀ B_i) over the rotation parts of pose i.
fn symmetric_product<const D: usize>(a: &Lifted, b: &Lifted, i: usize) -> SMatrix<f64, D, D> {
    let mut sum = SMatrix::<f64, D, D>::zeros();
    for (a, b) in a.rows.iter().zip(&b.rows) {
        let (a, b) = (&a[(D + 1) * i..][..D], &b[(D + 1) * i..][..D]);
        for r in 0..D {
            for c in 0..D {
                sum[(r, c)] += 0.5 * (a[r] * b[c] + b[r] * a[c]);
            }
        }
    }
    sum
}

/// `v` − `x` Λ over rotation parts.
pub(super) fn subtract_multiplied<const D: usize>(
    v: &mut Lifted,
    x: &Lifted,
    multipliers: &[SMatrix<f64, D, D>],
) {
    for (v, x) in v.rows.iter_mut().zip(&x.rows) {
        for (i, lambda) in multipliers.iter().enumerate() {
            let x = &x[(D + 1) * i..][..D];
            let v = &mut v[(D + 1) * i..][..D];
            for c in 0..D {
                for r in 0..D {
                    v[c] -= x[r] * lambda[(r, c)];
                }
            }
        }
    }
}

/// Projects onto the tangent space at `x`: V − Y sym(YᵀV).
fn project<const D: usize>(x: &Lifted, v: &mut Lifted) {
    let normal = multipliers::<D>(x, v);
    subtract_multiplied(v, x, &normal);
}

/// Back to orthonormal columns, by Gram and Schmidt: the retraction of a QR decomposition.
pub(super) fn retract<const D: usize>(x: &mut Lifted) {
    let count = x.rows[0].len() / (D + 1);
    for i in 0..count {
        for c in (D + 1) * i..(D + 1) * i + D {
            for before in (D + 1) * i..c {
                let dot: f64 = x.rows.iter().map(|row| row[before] * row[c]).sum();
                x.rows.iter_mut().for_each(|row| row[c] -= dot * row[before]);
            }
            let norm = x.rows.iter().map(|row| row[c] * row[c]).sum::<f64>().sqrt();
            x.rows.iter_mut().for_each(|row| row[c] /= norm);
        }
    }
}
