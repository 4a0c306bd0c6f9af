//! The figures that evo prints for a list of errors.
//!
//! The median is the only quantile among them.

/// Statistics of `n` errors; all NaN but `sse` and `count` for none.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Statistics {
    /// How many errors there are.
    #[serde(rename = "values")]
    pub count: usize,
    /// √(Σ e² / n).
    pub rmse: f64,
    /// Σ e / n.
    pub mean: f64,
    /// The middle error; the mean of the two middle ones where n is even.
    pub median: f64,
    /// √(Σ (e − mean)² / n).
    pub std: f64,
    /// The smallest error.
    pub min: f64,
    /// The largest error.
    pub max: f64,
    /// Σ e².
    pub sse: f64,
}

impl Statistics {
    /// The statistics of `errors`.
    #[must_use]
    pub fn of(errors: &[f64]) -> Self {
        let mut sorted = errors.to_vec();
        sorted.sort_unstable_by(f64::total_cmp);
        let n = sorted.len() as f64;
        // Summing from the smallest up loses least.
        let mean = sorted.iter().sum::<f64>() / n;
        let sse = sorted.iter().map(|e| e * e).sum::<f64>();
        let spread = sorted.iter().map(|e| (e - mean) * (e - mean)).sum::<f64>();
        let at = |index: usize| sorted.get(index).copied().unwrap_or(f64::NAN);
        let middle = sorted.len() / 2;
        let median = if sorted.len() % 2 == 1 {
            at(middle)
        } else {
            0.5 * (at(middle.wrapping_sub(1)) + at(middle))
        };
        Self {
            count: sorted.len(),
            rmse: (sse / n).sqrt(),
            mean,
            median,
            std: (spread / n).sqrt(),
            min: at(0),
            max: at(sorted.len().wrapping_sub(1)),
            sse,
        }
    }
}
