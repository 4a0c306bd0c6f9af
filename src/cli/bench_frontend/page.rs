//! The page of a bench: the figures of each run, and its trajectory beside the truth.
//!
//! Computes no error: the figures are those of `truth` and of the run.

use super::{Row, RunFigures};
use crate::cli::html::{self, trajectory};
use crate::report::{Page, Table, count, number};

/// The page about all sequences.
pub(super) fn page(rows: &[Row]) -> Page {
    let facts = [("sequences", count(rows.len()))];
    let mut page = html::page("The reference frontend against ground truth", "", &facts);
    page.section("Errors");
    let figure = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), number);
    let cells = |row: &Row, run: &str, figures: &RunFigures| {
        vec![
            row.name.clone(),
            run.to_owned(),
            figure(figures.rpe_translation_m_per_s),
            figure(figures.rpe_rotation_deg_per_s),
            figure(figures.ate_m),
            format!("{} of {}", figures.lost, figures.frames),
            figure(row.mask_iou.filter(|_| run == "mask")),
            number(figures.track.p50_ms),
            number(figures.track.p99_ms),
        ]
    };
    let runs = rows.iter().flat_map(|row| {
        let both = [("mask", row.with_mask), ("no mask", row.without_mask)];
        both.into_iter().filter_map(move |(name, run)| Some(cells(row, name, &run?)))
    });
    let head = [
        "sequence",
        "run",
        "drift, m/s",
        "drift, deg/s",
        "ATE, m",
        "lost",
        "mask IoU",
        "track p50, ms",
        "track p99, ms",
    ];
    let caption = "Drift is the RPE over 1 s (RMSE); – means not known";
    page.table(&Table::new(caption, &head, runs.collect()));
    for row in rows {
        if let Some(error) = &row.error {
            page.note(&format!("{}: {error}", row.source));
        }
        for drawn in &row.drawn {
            page.section(&format!("{}, {}", row.name, drawn.run));
            trajectory::error_plan(&mut page, &drawn.truth, &drawn.errors, true);
        }
    }
    page
}
