//! The figures of all sequences as text: drift, what else is measured, and the paper's own table
//! beside it. As in the paper, × is a run that failed; - is what is not known. No error is computed
//! here.

use super::{Row, RunFigures};
use crate::evaluation::{MethodFigures, PaperRow};

/// What a cell shows of a run that failed.
const FAILED: &str = "×";

/// Columns by groups: the width of each column; groups stand two spaces apart, columns one.
type Columns = &'static [&'static [usize]];

const DRIFT: Columns = &[&[10, 10, 9], &[10, 10, 9]];
const OTHERS: Columns = &[&[9, 9], &[6, 6], &[6], &[7, 7]];
const PAPER: Columns = &[&[8, 8, 13, 9, 9], &[8, 8]];

/// All tables.
pub(super) fn text(rows: &[Row]) -> String {
    let width = rows.iter().map(|row| row.name.chars().count()).max().unwrap_or(0).max(18);
    let mut lines = drift(rows, width);
    lines.push(String::new());
    lines.extend(others(rows, width));
    if rows.iter().any(|row| row.paper.is_some()) {
        lines.extend(beside_the_paper(rows, width));
    }
    lines
        .push(format!("\n{FAILED} failed: lost, or under 99 % of the frames tracked; - not known"));
    for row in rows {
        lines.extend(row.error.as_ref().map(|error| format!("{FAILED} {}: {error}", row.source)));
    }
    lines.join("\n")
}

/// A title, then a centered heading over each group.
fn head(title: &str, width: usize, columns: Columns, headings: &[&str]) -> String {
    let mut line = format!("{title:<width$}");
    for (group, heading) in columns.iter().zip(headings) {
        let width = group.iter().sum::<usize>() + group.len() - 1;
        line.push_str(&format!("  {heading:^width$}"));
    }
    line
}

/// A name, then a cell in each column, to the right.
fn line(name: &str, width: usize, columns: Columns, cells: &[impl AsRef<str>]) -> String {
    let mut line = format!("{name:<width$}");
    let mut cells = cells.iter();
    for group in columns {
        line.push(' ');
        for (&width, cell) in group.iter().zip(&mut cells) {
            line.push_str(&format!(" {:>width$}", cell.as_ref()));
        }
    }
    line
}

/// A number, or what stands for none.
fn number(value: Option<f64>, digits: usize, none: &str) -> String {
    value.map_or_else(|| none.to_owned(), |value| format!("{value:.digits$}"))
}

/// A figure of a run that counts.
fn cell(run: Option<&RunFigures>, of: impl Fn(&RunFigures) -> Option<f64>) -> String {
    match run {
        Some(run) if run.counts => number(of(run), 4, "-"),
        _ => FAILED.to_owned(),
    }
}

fn drift(rows: &[Row], width: usize) -> Vec<String> {
    let percent =
        |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |value| format!("{value:.1} %"));
    let names = ["no mask", "mask", "less", "no mask", "mask", "less"];
    let headings = ["translation, m/s", "rotation, deg/s"];
    let mut lines = vec![
        head("RPE over 1 s, RMSE", width, DRIFT, &headings),
        line("sequence", width, DRIFT, &names),
    ];
    for row in rows {
        let (with, without) = (row.with_mask.as_ref(), row.without_mask.as_ref());
        let cells = [
            cell(without, |run| run.rpe_translation_m_per_s),
            cell(with, |run| run.rpe_translation_m_per_s),
            percent(row.reduction_percent.translation),
            cell(without, |run| run.rpe_rotation_deg_per_s),
            cell(with, |run| run.rpe_rotation_deg_per_s),
            percent(row.reduction_percent.rotation),
        ];
        lines.push(line(&row.name, width, DRIFT, &cells));
    }
    lines
}

fn others(rows: &[Row], width: usize) -> Vec<String> {
    let names = ["no mask", "mask", "no m.", "mask", "IoU", "p50", "p99"];
    let headings = ["ATE, m", "lost/frames", "  mask", "track, ms"];
    let mut lines =
        vec![head("", width, OTHERS, &headings), line("sequence", width, OTHERS, &names)];
    for row in rows {
        let (with, without) = (row.with_mask.as_ref(), row.without_mask.as_ref());
        let lost = |run: Option<&RunFigures>| {
            run.map_or_else(|| "-".to_owned(), |run| format!("{}/{}", run.lost, run.frames))
        };
        let cells = [
            cell(without, |run| run.ate_m),
            cell(with, |run| run.ate_m),
            lost(without),
            lost(with),
            number(row.mask_iou, 3, "-"),
            number(with.map(|run| run.track.p50_ms), 1, "-"),
            number(with.map(|run| run.track.p99_ms), 1, "-"),
        ];
        lines.push(line(&row.name, width, OTHERS, &cells));
    }
    lines
}

/// What is compared: its name, the paper's figures of it and covis' own.
type Unit = (&'static str, fn(&PaperRow) -> MethodFigures, fn(&RunFigures) -> Option<f64>);

/// The paper's Table 1 for these sequences, and covis' two columns; an empty line before each unit.
fn beside_the_paper(rows: &[Row], width: usize) -> Vec<String> {
    let units: [Unit; 2] = [
        ("translation, m/s", |p| p.translation_m_per_s, |r| r.rpe_translation_m_per_s),
        ("rotation, deg/s", |p| p.rotation_deg_per_s, |r| r.rpe_rotation_deg_per_s),
    ];
    let names = ["DVO", "BaMVO", "static weight", "no mask", "mask", "no mask", "mask"];
    let mut lines = Vec::new();
    for (unit, paper, covis) in units {
        lines.push(String::new());
        lines.push(head(unit, width, PAPER, &["the paper's Table 1", "covis"]));
        lines.push(line("sequence", width, PAPER, &names));
        for row in rows {
            let Some(figures) = row.paper else { continue };
            let MethodFigures { dvo, bamvo, static_weight, without_removal, with_removal } =
                paper(figures);
            let methods =
                [Some(dvo), Some(bamvo), Some(static_weight), without_removal, with_removal];
            let mut cells: Vec<String> =
                methods.into_iter().map(|value| number(value, 4, FAILED)).collect();
            cells.extend([&row.without_mask, &row.with_mask].map(|run| cell(run.as_ref(), covis)));
            lines.push(line(figures.sequence, width, PAPER, &cells));
        }
    }
    lines
}
