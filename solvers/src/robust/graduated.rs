//! Weights of graduated non-convexity (Yang, Antonante, Tzoumas and Carlone 2020).
//!
//! A surrogate with control μ goes from convex to the kernel; its weights follow from χ² in closed
//! form (their propositions 3 and 4). Nothing here knows of graphs.

/// Factor of μ from one round to the next.
const RATE: f64 = 1.4;

/// The robust cost over χ² = s with threshold c².
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernel {
    /// min(s, c²): a closure counts in full or not at all.
    TruncatedLeastSquares,
    /// s c²/(s + c²).
    GemanMcClure,
}

/// A kernel on its way from the convex surrogate to the robust cost.
#[derive(Clone, Copy, Debug)]
pub(super) struct Schedule {
    kernel: Kernel,
    threshold: f64,
    control: f64,
}

impl Kernel {
    /// The start for a largest χ² among the edges; `None` where all of them are within the kernel's
    /// convex part.
    pub(super) fn schedule(self, largest: f64, threshold: f64) -> Option<Schedule> {
        let control = match self {
            Self::TruncatedLeastSquares => threshold / (2.0 * largest - threshold),
            Self::GemanMcClure => 2.0 * largest / threshold,
        };
        let is_needed = match self {
            Self::TruncatedLeastSquares => control.is_finite() && control > 0.0,
            Self::GemanMcClure => control.is_finite(),
        };
        let control = match self {
            Self::TruncatedLeastSquares => control,
            Self::GemanMcClure => control.max(1.0),
        };
        is_needed.then_some(Schedule { kernel: self, threshold, control })
    }

    /// Whether weights end at 0 or 1.
    pub(super) fn is_binary(self) -> bool {
        self == Self::TruncatedLeastSquares
    }

    /// The kernel at χ² = `chi2`.
    pub(super) fn cost(self, chi2: f64, threshold: f64) -> f64 {
        match self {
            Self::TruncatedLeastSquares => chi2.min(threshold),
            // At infinity it is the threshold.
            Self::GemanMcClure => threshold / (1.0 + threshold / chi2),
        }
    }

    /// The weight by the kernel itself.
    pub(super) fn final_weight(self, chi2: f64, threshold: f64) -> f64 {
        match self {
            Self::TruncatedLeastSquares => f64::from(u8::from(chi2 <= threshold)),
            Self::GemanMcClure => (threshold / (chi2 + threshold)).powi(2),
        }
    }
}

impl Schedule {
    /// The weight of an edge with `chi2`, in 0..=1.
    pub(super) fn weight(&self, chi2: f64) -> f64 {
        let (c2, mu) = (self.threshold, self.control);
        if !chi2.is_finite() {
            return 0.0;
        }
        match self.kernel {
            Kernel::TruncatedLeastSquares if chi2 <= mu / (mu + 1.0) * c2 => 1.0,
            Kernel::TruncatedLeastSquares if chi2 >= (mu + 1.0) / mu * c2 => 0.0,
            Kernel::TruncatedLeastSquares => (c2 * mu * (mu + 1.0) / chi2).sqrt() - mu,
            Kernel::GemanMcClure => (mu * c2 / (chi2 + mu * c2)).powi(2),
        }
    }

    /// Goes one round further; false at the end.
    pub(super) fn advance(&mut self) -> bool {
        match self.kernel {
            Kernel::TruncatedLeastSquares => {
                self.control *= RATE;
                // By then almost all weights are 0 or 1.
                self.control < 1e3
            }
            Kernel::GemanMcClure => {
                let is_before = self.control > 1.0;
                self.control = (self.control / RATE).max(1.0);
                is_before
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::Kernel;

    #[test]
    fn weights_fall_from_one_to_zero_and_end_at_the_kernel() {
        for kernel in [Kernel::TruncatedLeastSquares, Kernel::GemanMcClure] {
            let mut schedule = kernel.schedule(1e4, 10.0).unwrap();
            assert!(schedule.weight(1e4) > 0.0, "the start is convex up to the largest");
            for _ in 0..200 {
                let weights: Vec<f64> =
                    (0..100).map(|k| schedule.weight(f64::from(k) * 2.0)).collect();
                assert!(weights.windows(2).all(|w| w[0] >= w[1]));
                assert!(weights.iter().all(|w| (0.0..=1.0).contains(w)));
                if !schedule.advance() {
                    break;
                }
            }
            for chi2 in [0.0, 5.0, 20.0, 1e4] {
                let last = schedule.weight(chi2);
                assert!((last - kernel.final_weight(chi2, 10.0)).abs() < 1e-3, "{chi2}");
            }
            assert_eq!(schedule.weight(f64::NAN), 0.0);
        }
    }

    #[test]
    fn residuals_within_the_threshold_need_no_schedule() {
        assert!(Kernel::TruncatedLeastSquares.schedule(4.0, 10.0).is_none());
        assert!(Kernel::TruncatedLeastSquares.schedule(0.0, 10.0).is_none());
    }
}
