//! Residuals of a solve by what is measured: rows of the JSON object and lines under the table.
//!
//! The figures come from the evaluator; nothing is computed here. A hint is printed if a sigma is off.

use covis_solvers::evaluation::{CostReport, Quantity, ResidualStatistics, SigmaJudgment};
use serde::Serialize;

use crate::report::number;

/// The residuals of one quantity; those before are absent where nobody kept the start.
#[derive(Debug, Serialize)]
pub(super) struct Row {
    quantity: &'static str,
    unit: &'static str,
    count: usize,
    initial_rms: Option<f64>,
    final_rms: f64,
    redundant_count: usize,
    initial_redundant_rms: Option<f64>,
    final_redundant_rms: f64,
    reduced_chi2: f64,
    outlier_share: f64,
    sigma_ratio: Option<f64>,
    sigma: &'static str,
    hint: Option<String>,
}

/// A row a quantity that occurs.
pub(super) fn rows(before: Option<&CostReport>, after: &CostReport) -> Vec<Row> {
    let row = |(quantity, after): (Quantity, &ResidualStatistics)| {
        let before = before.map(|before| before.residuals.of(quantity));
        Row {
            quantity: quantity.name(),
            unit: quantity.unit(),
            count: after.count,
            initial_rms: before.map(|before| before.rms),
            final_rms: after.rms,
            redundant_count: after.redundant_count,
            initial_redundant_rms: before.map(|before| before.redundant_rms),
            final_redundant_rms: after.redundant_rms,
            reduced_chi2: after.reduced_chi2,
            outlier_share: after.outlier_share,
            sigma_ratio: after.sigma_ratio,
            sigma: match after.judgment() {
                SigmaJudgment::Unknown => "unknown",
                SigmaJudgment::Plausible => "plausible",
                SigmaJudgment::TooSmall => "too-small",
                SigmaJudgment::TooLarge => "too-large",
            },
            hint: after.hint(quantity),
        }
    };
    after.residuals.iter().map(row).collect()
}

impl Row {
    /// What a sentence about the solve says of them.
    pub(super) fn verdict(&self) -> String {
        let Self { quantity, unit, .. } = self;
        let (rms, outliers) = (number(self.final_rms), 100.0 * self.outlier_share);
        format!("{quantity} residuals of {rms} {unit} (rms), {outliers:.1} % outliers")
    }

    /// Its line under the table, and one more where there is a hint.
    pub(super) fn lines(&self) -> Vec<(&'static str, String)> {
        let before = self.initial_rms.map(|rms| format!("{rms:.4} -> ")).unwrap_or_default();
        let single = match self.count - self.redundant_count {
            0 => String::new(),
            single => format!(
                " ({:.4} without the {single} of landmarks that one pose sees)",
                self.final_redundant_rms
            ),
        };
        let figures = format!(
            "{} with rms {before}{:.4} {}{single}, reduced chi2 {:.3}, {:.1} % outliers",
            self.count,
            self.final_rms,
            self.unit,
            self.reduced_chi2,
            100.0 * self.outlier_share,
        );
        let mut lines = vec![(self.quantity, figures)];
        lines.extend(self.hint.clone().map(|hint| ("hint", hint)));
        lines
    }
}
