//! Robust losses ρ(s) on the whitened squared residual s = rᵀΩr.
//!
//! A factor costs ½ ρ(s). Widths are in whitened units (standard deviations). All losses satisfy
//! ρ(0) = 0 and ρ'(0) = 1, so that small residuals count as in plain least squares. Solvers weight a
//! factor by ρ'(s) (iteratively reweighted least squares); this file knows nothing of factors.

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

/// ρ and its first derivative at one s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LossValue {
    /// ρ(s); the factor's cost is half of it.
    pub rho: f64,
    /// ρ'(s), the factor's weight; in [0, 1].
    pub weight: f64,
}

impl Loss {
    /// Evaluates ρ and ρ' at `s ≥ 0`.
    #[must_use]
    pub fn evaluate(&self, s: f64) -> LossValue {
        match *self {
            Self::Trivial => LossValue { rho: s, weight: 1.0 },
            Self::Huber(width) => {
                if s <= width * width {
                    LossValue { rho: s, weight: 1.0 }
                } else {
                    let root = s.sqrt();
                    LossValue { rho: 2.0 * width * root - width * width, weight: width / root }
                }
            }
            Self::Cauchy(width) => {
                let ratio = s / (width * width);
                LossValue { rho: width * width * ratio.ln_1p(), weight: 1.0 / (1.0 + ratio) }
            }
            Self::Tukey(width) => {
                let squared = width * width;
                if s <= squared {
                    let u = 1.0 - s / squared;
                    LossValue { rho: squared / 3.0 * (1.0 - u * u * u), weight: u * u }
                } else {
                    LossValue { rho: squared / 3.0, weight: 0.0 }
                }
            }
            Self::GemanMcClure(width) => {
                let squared = width * width;
                let u = squared / (s + squared);
                LossValue { rho: s * u, weight: u * u }
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
    fn weight_is_the_derivative_of_rho() {
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
            }
        }
    }
}
