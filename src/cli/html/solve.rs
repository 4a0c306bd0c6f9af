//! What pages show of a solve: the cost over iterations and time, residuals before and after. Figures come
//! from the solvers and the evaluator; only their quantiles are taken here.

use serde::{Deserialize, Serialize};

use crate::report::{Labels, Line, Page, Span, Table, histogram, lines, number, quantiles};

/// An iteration of a solve, as `--json` and reports of jobs have it.
#[derive(Clone, Copy, Debug, Deserialize, Serialize)]
pub(in crate::cli) struct Iteration {
    pub(in crate::cli) iteration: usize,
    pub(in crate::cli) cost: f64,
    pub(in crate::cli) seconds: f64,
    pub(in crate::cli) accepted: bool,
    pub(in crate::cli) damping: f64,
}

/// Rows of iterations that are shown unasked.
const SHOWN: usize = 12;

/// How far the cost was above its last value, over iterations and over time, with its table.
pub(in crate::cli) fn cost(page: &mut Page, rows: &[Iteration]) {
    page.section("Cost");
    let last = rows.iter().map(|row| row.cost).fold(f64::INFINITY, f64::min);
    let line = |x: fn(&Iteration) -> f64| {
        // The last row has nothing above it, and no place where powers of ten are.
        let above = rows.iter().filter(|row| row.cost > last).map(|row| (row, row.cost - last));
        let point = |(row, above): (&Iteration, f64)| (x(row), above);
        Line {
            points: above.clone().map(point).collect(),
            marked: above.filter(|(row, _)| !row.accepted).map(point).collect(),
            ..Line::default()
        }
    };
    let described = |title, x| Labels {
        title,
        description: "How far the cost is above the lowest. A circle is a step that was rejected.",
        x,
        y: "cost − lowest cost",
    };
    let pictures = [
        lines(
            described("Cost over iterations", "iteration"),
            Span::OfValues,
            &[line(|r| r.iteration as f64)],
        ),
        lines(described("Cost over time", "time, s"), Span::OfValues, &[line(|r| r.seconds)]),
    ];
    // A solve that begins at its optimum has nothing to draw.
    if rows.iter().any(|row| row.cost > last) {
        page.row(&pictures, &[]);
    }
    let cells = |row: &Iteration| {
        vec![
            row.iteration.to_string(),
            format!("{:.10e}", row.cost),
            format!("{:.6}", row.seconds),
            format!("{:.1e}", row.damping),
            if row.accepted { "taken" } else { "rejected" }.to_owned(),
        ]
    };
    let head = ["iteration", "cost", "time, s", "damping", "step"];
    let table = Table::new("Iterations", &head, rows.iter().map(cells).collect());
    if rows.len() > SHOWN { page.folded(&table) } else { page.table(&table) }
}

/// Residuals of one kind.
#[derive(Clone, Copy, Debug)]
pub(in crate::cli) struct Residuals<'a> {
    /// What they are of.
    pub(in crate::cli) name: &'a str,
    pub(in crate::cli) unit: &'a str,
    /// Their lengths before, where they are known.
    pub(in crate::cli) before: Option<&'a [f64]>,
    pub(in crate::cli) after: &'a [f64],
}

/// Histograms of residuals, with quantiles beside them.
pub(in crate::cli) fn residuals(page: &mut Page, all: &[Residuals<'_>]) {
    let all: Vec<_> = all.iter().filter(|kind| !kind.after.is_empty()).collect();
    if all.is_empty() {
        return;
    }
    page.section("Residuals");
    let head = ["residuals", "count", "rms", "median", "90 %", "99 %", "largest"];
    for kind in all {
        let Residuals { name, unit, before, after } = *kind;
        let title = format!("Residuals of {name}");
        let description = format!("Share of them, %, over their length, {unit}.");
        let labels = Labels { title: &title, description: &description, x: unit, y: "%" };
        let row = |when: &str, values: &[f64]| {
            let [count, rest @ ..] = quantiles(values);
            let start = [when.to_owned(), count, number(rms(values))];
            start.into_iter().chain(rest).collect::<Vec<_>>()
        };
        let mut rows: Vec<Vec<String>> =
            before.map(|before| row("before", before)).into_iter().collect();
        rows.push(row("after", after));
        let caption = format!("{title}, {unit}");
        page.row(&[histogram(labels, before, after)], &[Table::new(&caption, &head, rows)]);
    }
}

/// Root mean square; 0 without values.
pub(in crate::cli) fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len().max(1) as f64).sqrt()
}
