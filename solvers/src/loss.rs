//! Robust losses ρ(s) on the whitened squared residual s = rᵀΩr.
//!
//! A factor costs ½ ρ(s). Widths are in whitened units (standard deviations). All losses satisfy
//! ρ(0) = 0 and ρ'(0) = 1, so that small residuals count as in plain least squares. Solvers weight a
//! factor by ρ'(s) and may take less curvature along its residual; this file knows nothing of factors.

/// A loss function on s = rᵀΩr.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Loss {
    /// ρ(s) = s: plain least squares.
    #[default]
    Trivial,
    /// ρ(s) = s up to width², then 2·width·√s − width².
    Huber(f64),
    /// ρ(s) = width² · ln(1 + s/width²).
    Cauchy(f64),
    /// Tukey's biweight: ρ(s) = width²/3 · (1 − (1 − s/width²)³), constant past width².
    Tukey(f64),
    /// ρ(s) = s · width² / (s + width²).
    GemanMcClure(f64),
}

/// ρ and its derivatives at one s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LossValue {
    /// ρ(s); the factor's cost is half of it.
    pub rho: f64,
    /// ρ'(s), the factor's weight; in [0, 1].
    pub weight: f64,
    /// d = 1 + 2 s ρ''(s) / ρ'(s), at most 1: the curvature of ½ ρ(‖r‖²) along the residual r, as a
    /// share of its curvature ρ' across it. 0 where ρ' is.
    pub curvature: f64,
}

impl LossValue {
    /// The curvature that a linearization of this stiffness takes: `stiffness` at least, at most 1.
    #[must_use]
    #[inline]
    pub fn curvature_from(&self, stiffness: f64) -> f64 {
        at_least(self.curvature, stiffness)
    }

    /// k = (1 − d) / (s ρ') with d of [`Self::curvature_from`]; 0 where ρ' or s is: with its gradient
    /// g = ρ' JᵀΩr, the curvature of a factor is ρ' JᵀΩJ − k g gᵀ.
    #[must_use]
    pub fn flattening(&self, s: f64, stiffness: f64) -> f64 {
        let (flat, across) = (1.0 - self.curvature_from(stiffness), s * self.weight);
        if flat > 0.0 && across > 0.0 { flat / across } else { 0.0 }
    }
}

/// The curvature that a linearization of this stiffness takes.
#[inline(always)]
pub(crate) fn at_least(curvature: f64, stiffness: f64) -> f64 {
    // Not by `max`, since a curvature that is not a number stays one.
    if curvature < stiffness { stiffness } else { curvature }
}

impl Loss {
    /// Evaluates ρ and its derivatives at `s ≥ 0`.
    #[must_use]
    pub fn evaluate(&self, s: f64) -> LossValue {
        let (weight, curvature) = self.derivatives(s);
        LossValue { rho: self.rho(s), weight, curvature }
    }

    /// ρ at `s ≥ 0`.
    #[inline(always)]
    pub(crate) fn rho(&self, s: f64) -> f64 {
        match *self {
            Self::Trivial => s,
            Self::Huber(width) if s <= width * width => s,
            Self::Huber(width) => 2.0 * width * s.sqrt() - width * width,
            Self::Cauchy(width) => width * width * (s / (width * width)).ln_1p(),
            Self::Tukey(width) => {
                let squared = width * width;
                let u = 1.0 - s / squared;
                squared / 3.0 * if s / squared < 1.0 { 1.0 - u * u * u } else { 1.0 }
            }
            Self::GemanMcClure(width) => s * (width * width / (s + width * width)),
        }
    }

    /// Weight and curvature at `s ≥ 0`; see [`LossValue`].
    #[inline(always)]
    pub(crate) fn derivatives(&self, s: f64) -> (f64, f64) {
        match *self {
            Self::Trivial => (1.0, 1.0),
            Self::Huber(width) if s <= width * width => (1.0, 1.0),
            Self::Huber(width) => (width / s.sqrt(), 0.0),
            Self::Cauchy(width) => {
                let ratio = s / (width * width);
                let weight = 1.0 / (1.0 + ratio);
                (weight, (1.0 - ratio) * weight)
            }
            Self::Tukey(width) => {
                let ratio = s / (width * width);
                let u = 1.0 - ratio;
                if ratio < 1.0 { (u * u, (1.0 - 5.0 * ratio) / u) } else { (0.0, 0.0) }
            }
            Self::GemanMcClure(width) => {
                let squared = width * width;
                let u = squared / (s + squared);
                (u * u, 1.0 - 4.0 * (1.0 - u))
            }
        }
    }

    /// The width in whitened units; `None` for [`Loss::Trivial`].
    #[must_use]
    pub fn width(&self) -> Option<f64> {
        match *self {
            Self::Trivial => None,
            Self::Huber(w) | Self::Cauchy(w) | Self::Tukey(w) | Self::GemanMcClure(w) => Some(w),
        }
    }

    /// Whether the width, if there is one, is finite and positive.
    #[must_use]
    pub fn is_valid(&self) -> bool {
        self.width().is_none_or(|w| w.is_finite() && w > 0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::Loss;

    #[test]
    fn weight_and_curvature_are_derivatives_of_rho() {
        for loss in [
            Loss::Trivial,
            Loss::Huber(1.3),
            Loss::Cauchy(0.7),
            Loss::Tukey(2.0),
            Loss::GemanMcClure(1.1),
        ] {
            assert_eq!(loss.evaluate(0.0).rho, 0.0, "{loss:?}");
            for i in 1..200 {
                let s = f64::from(i) * 0.05;
                let h = 1e-6 * (1.0 + s);
                let numeric = (loss.evaluate(s + h).rho - loss.evaluate(s - h).rho) / (2.0 * h);
                let value = loss.evaluate(s);
                assert!((numeric - value.weight).abs() < 1e-5, "{loss:?} at {s}");
                assert!((0.0..=1.0).contains(&value.weight), "{loss:?} at {s}");
                let (up, down) = (loss.evaluate(s + h).weight, loss.evaluate(s - h).weight);
                let numeric = value.weight + s * (up - down) / h;
                let error = (numeric - value.curvature * value.weight).abs();
                // Between the two sides of a kink there is no derivative.
                let kinked = loss.width().is_some_and(|w| (s - w * w).abs() <= h);
                assert!(kinked || error < 1e-4, "{loss:?} at {s}: off by {error}");
            }
        }
    }
}
