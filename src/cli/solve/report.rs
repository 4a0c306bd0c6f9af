//! The report of a solve: rows as they come and a summary for a person, or one JSON object.
//!
//! Seconds count from when the file's numbers were in plain arrays and have the resolution of a
//! microsecond. Row 0 is the unmodified start; a rejected step repeats the cost before it. Only the
//! decrease of the cost from row to row is computed here.

use std::fmt::Display;
use std::time::Duration;

use covis_solvers::optimizer::{Control, IterationSummary, SolveSummary};
use serde::Serialize;

use super::residuals;
use crate::cli::html::{self, solve::Iteration};
use crate::cli::output::print;
use crate::report::{Page, number};

/// One object of `--json`.
#[derive(Debug, Serialize)]
struct Document<'a, D> {
    initial_cost: f64,
    final_cost: f64,
    iterations: Vec<Row>,
    solve_seconds: f64,
    termination: String,
    converged: bool,
    threads: usize,
    gradient_max_norm: f64,
    linear_residual: f64,
    residuals: &'a [residuals::Row],
    #[serde(flatten)]
    details: &'a D,
}

#[derive(Debug, Serialize)]
struct Row {
    #[serde(flatten)]
    row: Iteration,
    gradient_max_norm: f64,
    step_norm: f64,
    step_quality: f64,
}

/// Facts about a problem that only its kind has.
pub(super) trait Details: Serialize {
    /// Lines `name value` under the table.
    fn lines(&self) -> Vec<(&'static str, String)>;
}

/// What a solve came to.
pub(super) struct Solved<D> {
    pub(super) summary: SolveSummary,
    pub(super) residuals: Vec<residuals::Row>,
    pub(super) details: D,
}

/// Reports one solve, row by row.
#[derive(Debug)]
pub(super) struct Report {
    json: bool,
    preparation: Duration,
    last_cost: f64,
    failure: Option<anyhow::Error>,
}

impl Report {
    /// Starts a report; `preparation` is what passed before the solver was called.
    pub(super) fn start(json: bool, preparation: Duration) -> Self {
        Self { json, preparation, last_cost: f64::NAN, failure: None }
    }

    /// The solver's observer: writes a row of the table. Ends the solve when nobody reads.
    pub(super) fn observe(&mut self, row: &IterationSummary) -> Control {
        if self.json {
            return Control::Continue;
        }
        let line = self.line(row);
        self.last_cost = row.cost;
        print_or_cancel(line, &mut self.failure)
    }

    fn line(&self, row: &IterationSummary) -> String {
        let time = self.shifted(row.seconds);
        if row.iteration == 0 {
            let (iteration, cost, blank) = (row.iteration, row.cost, "");
            return format!(
                "{:>9}  {:>18}  {:>11}  {:>9}  {:>8}  {:>11}\n\
                 {iteration:>9}  {cost:>18.10e}  {blank:>33}  {time:>9.4} s",
                "iteration", "cost", "decrease", "damping", "quality", "time"
            );
        }
        let decrease = if row.accepted {
            format!("{:.3e}", self.last_cost - row.cost)
        } else {
            "rejected".to_owned()
        };
        format!(
            "{:>9}  {:>18.10e}  {decrease:>11}  {:>9.1e}  {:>8.3}  {time:>9.4} s",
            row.iteration, row.cost, row.damping, row.step_quality
        )
    }

    /// Ends the command where a row could not be written: the solve was then cut short.
    ///
    /// # Errors
    /// What went wrong with standard output.
    pub(super) fn check_reader(&mut self) -> anyhow::Result<()> {
        self.failure.take().map_or(Ok(()), Err)
    }

    /// Writes the summary or the JSON object.
    /// Fails where standard output cannot be written to.
    pub(super) fn finish(self, solved: &Solved<impl Details>) -> anyhow::Result<()> {
        if self.json {
            let document = self.document(solved);
            return print(serde_json::to_string(&document)?);
        }
        print_lines(&self.lines(solved))
    }

    /// A page with the summary and the cost; the caller adds what it knows of its problem.
    pub(super) fn page(&self, title: &str, solved: &Solved<impl Details>) -> Page {
        let mut page = html::page(title, &verdict(solved), &self.lines(solved));
        let rows = solved.summary.iterations.iter().map(|row| self.iteration(row));
        html::solve::cost(&mut page, &rows.collect::<Vec<_>>());
        page
    }

    /// Lines `name value`: the outcome, what is special to the problem, the residuals.
    fn lines(&self, solved: &Solved<impl Details>) -> Vec<(&'static str, String)> {
        let Solved { summary, residuals, details } = solved;
        let count = summary.iterations.len().saturating_sub(1);
        let accepted = summary.iterations.iter().skip(1).filter(|row| row.accepted).count();
        let seconds = self.shifted(summary.solve_seconds);
        let mut lines = vec![
            ("termination", summary.termination.to_string()),
            ("cost", format!("{:.10e} -> {:.10e}", summary.initial_cost, summary.final_cost)),
            ("iterations", format!("{count} ({accepted} accepted)")),
            ("time", format!("{seconds:.6} s, {} threads", summary.threads)),
            ("gradient", format!("{:.3e} (largest entry, scaled)", summary.gradient_max_norm)),
            ("linear residual", format!("{:.3e}", summary.linear_residual)),
        ];
        lines.extend(details.lines());
        lines.extend(residuals.iter().flat_map(residuals::Row::lines));
        lines
    }

    fn document<'a, D>(&self, solved: &'a Solved<D>) -> Document<'a, D> {
        let Solved { summary, residuals, details } = solved;
        let row = |row: &IterationSummary| Row {
            row: self.iteration(row),
            gradient_max_norm: row.gradient_max_norm,
            step_norm: row.step_norm,
            step_quality: row.step_quality,
        };
        Document {
            initial_cost: summary.initial_cost,
            final_cost: summary.final_cost,
            iterations: summary.iterations.iter().map(row).collect(),
            solve_seconds: self.shifted(summary.solve_seconds),
            termination: summary.termination.to_string(),
            converged: summary.termination.is_converged(),
            threads: summary.threads,
            gradient_max_norm: summary.gradient_max_norm,
            linear_residual: summary.linear_residual,
            residuals,
            details,
        }
    }

    fn iteration(&self, row: &IterationSummary) -> Iteration {
        let &IterationSummary { iteration, cost, seconds, accepted, damping, .. } = row;
        Iteration { iteration, cost, seconds: self.shifted(seconds), accepted, damping }
    }

    /// Seconds since the clock started, to the microsecond.
    fn shifted(&self, seconds: f64) -> f64 {
        ((self.preparation.as_secs_f64() + seconds) * 1e6).round() / 1e6
    }
}

/// What came out, in a sentence.
fn verdict<D>(solved: &Solved<D>) -> String {
    let Solved { summary, residuals, .. } = solved;
    let ended = if summary.termination.is_converged() { "Converged" } else { "Not converged" };
    let steps = summary.iterations.len().saturating_sub(1);
    let mut text = format!(
        "{ended} after {steps} iterations: cost {} → {}",
        number(summary.initial_cost),
        number(summary.final_cost)
    );
    residuals.iter().for_each(|kind| text.push_str(&format!("; {}", kind.verdict())));
    text.push('.');
    text
}

/// Prints lines `name value` under a table.
pub(super) fn print_lines(lines: &[(&'static str, String)]) -> anyhow::Result<()> {
    lines.iter().try_for_each(|(name, value)| print(format_args!("{name:>17}: {value}")))
}

/// Prints a line of progress; where nobody reads it, notes the failure and has the solve end.
pub(super) fn print_or_cancel(line: impl Display, failure: &mut Option<anyhow::Error>) -> Control {
    if let Err(error) = print(line) {
        *failure = Some(error);
    }
    if failure.is_some() { Control::Cancel } else { Control::Continue }
}
