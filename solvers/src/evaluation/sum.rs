//! Compensated summation: Neumaier's variant of Kahan's algorithm (1974).
//!
//! The error does not grow with the number of terms, so that a total can be compared with another
//! evaluator's to the last digits. The last bit still depends on the order of the terms.

/// A running sum with its accumulated rounding error.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct CompensatedSum {
    sum: f64,
    compensation: f64,
}

impl CompensatedSum {
    /// Adds a term.
    pub(super) fn add(&mut self, term: f64) {
        let sum = self.sum + term;
        self.compensation += if self.sum.abs() >= term.abs() {
            (self.sum - sum) + term
        } else {
            (term - sum) + self.sum
        };
        self.sum = sum;
    }

    /// The sum so far; NaN or infinite if a term was.
    pub(super) fn value(&self) -> f64 {
        // The compensation of an infinite sum is NaN and must not hide which of the two it was.
        if self.sum.is_finite() { self.sum + self.compensation } else { self.sum }
    }
}

#[cfg(test)]
mod tests {
    use super::CompensatedSum;

    #[test]
    fn small_terms_survive_a_large_one() {
        let mut sum = CompensatedSum::default();
        for term in [1.0, 1e100, 1.0, -1e100] {
            sum.add(term);
        }
        assert_eq!(sum.value(), 2.0);
        sum.add(f64::INFINITY);
        assert_eq!(sum.value(), f64::INFINITY);
    }
}
