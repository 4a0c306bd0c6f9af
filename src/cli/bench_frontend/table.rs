//! The figures of all sequences as text: drift, what else is measured, and the paper's own table
//! beside it. As in the paper, × is a run that failed; - is what is not known.

use super::{PaperFigures, PaperMethods, Row, RunFigures};

/// What a cell shows of a run that failed.
const FAILED: &str = "×";

/// All tables.
pub(super) fn text(rows: &[Row]) -> String {
    let width = rows.iter().map(|row| row.name.chars().count()).max().unwrap_or(0).max(8);
    let mut text = drift(rows, width) + "\n\n" + &others(rows, width);
    if rows.iter().any(|row| row.paper.is_some()) {
        text.push_str("\n\n");
        text.push_str(&beside_the_paper(rows, width));
    }
    text.push_str(&format!(
        "\n\n{FAILED} failed: lost, or under 99 % of the frames tracked; - not known"
    ));
    for row in rows {
        if let Some(error) = &row.error {
            text.push_str(&format!("\n{FAILED} {}: {error}", row.source));
        }
    }
    text
}

/// A figure of a run that counts.
fn cell(
    run: Option<&RunFigures>,
    digits: usize,
    of: impl Fn(&RunFigures) -> Option<f64>,
) -> String {
    match run {
        Some(run) if run.counts => {
            of(run).map_or_else(|| "-".to_owned(), |value| format!("{value:.digits$}"))
        }
        _ => FAILED.to_owned(),
    }
}

fn percent(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.1} %"))
}

fn drift(rows: &[Row], width: usize) -> String {
    let mut text = format!(
        "{:<width$}  {:^31}  {:^31}\n{:<width$}  {:>10} {:>10} {:>9}  {:>10} {:>10} {:>9}",
        "RPE over 1 s, RMSE",
        "translation, m/s",
        "rotation, deg/s",
        "sequence",
        "no mask",
        "mask",
        "less",
        "no mask",
        "mask",
        "less",
        width = width.max(18)
    );
    for row in rows {
        let (with, without) = (row.with_mask.as_ref(), row.without_mask.as_ref());
        let translation = |run: Option<&RunFigures>| cell(run, 4, |r| r.rpe_translation_m_per_s);
        let rotation = |run: Option<&RunFigures>| cell(run, 4, |r| r.rpe_rotation_deg_per_s);
        text.push_str(&format!(
            "\n{:<width$}  {:>10} {:>10} {:>9}  {:>10} {:>10} {:>9}",
            row.name,
            translation(without),
            translation(with),
            percent(row.reduction_percent.translation),
            rotation(without),
            rotation(with),
            percent(row.reduction_percent.rotation),
            width = width.max(18)
        ));
    }
    text
}

fn others(rows: &[Row], width: usize) -> String {
    let mut text = format!(
        "{:<width$}  {:^19}  {:^13}  {:>6}  {:^15}\n\
         {:<width$}  {:>9} {:>9}  {:>6} {:>6}  {:>6}  {:>7} {:>7}",
        "",
        "ATE, m",
        "lost/frames",
        "mask",
        "track, ms",
        "sequence",
        "no mask",
        "mask",
        "no m.",
        "mask",
        "IoU",
        "p50",
        "p99",
        width = width.max(18)
    );
    for row in rows {
        let (with, without) = (row.with_mask.as_ref(), row.without_mask.as_ref());
        let ate = |run: Option<&RunFigures>| cell(run, 4, |run| run.ate_m);
        let lost = |run: Option<&RunFigures>| {
            run.map_or_else(|| "-".to_owned(), |run| format!("{}/{}", run.lost, run.frames))
        };
        let time = |of: fn(&RunFigures) -> f64| {
            with.map_or_else(|| "-".to_owned(), |run| format!("{:.1}", of(run)))
        };
        text.push_str(&format!(
            "\n{:<width$}  {:>9} {:>9}  {:>6} {:>6}  {:>6}  {:>7} {:>7}",
            row.name,
            ate(without),
            ate(with),
            lost(without),
            lost(with),
            row.mask_iou.map_or_else(|| "-".to_owned(), |iou| format!("{iou:.3}")),
            time(|run| run.track.p50_ms),
            time(|run| run.track.p99_ms),
            width = width.max(18)
        ));
    }
    text
}

/// What is compared: its name, the paper's figures of it and covis' own.
type Unit = (&'static str, fn(&PaperFigures) -> PaperMethods, fn(&RunFigures) -> Option<f64>);

/// The paper's Table 1 for these sequences, and covis' two columns.
fn beside_the_paper(rows: &[Row], width: usize) -> String {
    let width = width.max(18);
    let known: Vec<(&Row, &PaperFigures)> =
        rows.iter().filter_map(|row| Some((row, row.paper.as_ref()?))).collect();
    let mut parts = Vec::new();
    let units: [Unit; 2] = [
        ("translation, m/s", |p| p.translation_m_per_s, |r| r.rpe_translation_m_per_s),
        ("rotation, deg/s", |p| p.rotation_deg_per_s, |r| r.rpe_rotation_deg_per_s),
    ];
    for (unit, paper, covis) in units {
        let mut part = format!(
            "{unit:<width$}  {:^51}  {:^17}\n\
             {:<width$}  {:>8} {:>8} {:>13} {:>9} {:>9}  {:>8} {:>8}",
            "the paper's Table 1",
            "covis",
            "sequence",
            "DVO",
            "BaMVO",
            "static weight",
            "no mask",
            "mask",
            "no mask",
            "mask"
        );
        let own = |value: Option<f64>| {
            value.map_or_else(|| FAILED.to_owned(), |value| format!("{value:.4}"))
        };
        for (row, figures) in &known {
            let methods = paper(figures);
            part.push_str(&format!(
                "\n{:<width$}  {:>8.4} {:>8.4} {:>13.4} {:>9} {:>9}  {:>8} {:>8}",
                figures.sequence,
                methods.dvo,
                methods.bamvo,
                methods.static_weight,
                own(methods.without_removal),
                own(methods.with_removal),
                cell(row.without_mask.as_ref(), 4, covis),
                cell(row.with_mask.as_ref(), 4, covis),
            ));
        }
        parts.push(part);
    }
    parts.join("\n\n")
}
