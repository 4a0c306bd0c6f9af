//! What pages show of trajectories: positions from above and from the side, errors over time and by size.
//! The errors are those of [`crate::evaluation`].

use covis_solvers::io::trajectory::Trajectory;

use crate::evaluation::PoseError;
use crate::report::{Labels, Line, Page, Plan, Span, Table, histogram, lines, quantiles, views};

/// Where the errors are: the trajectory beside the truth. `is_absolute` says that they are of single
/// poses, otherwise they are of motions and are shown along the truth.
pub(in crate::cli) fn error_plan(
    page: &mut Page,
    truth: &Trajectory,
    errors: &[PoseError],
    is_absolute: bool,
) {
    let estimate: Vec<[f64; 3]> = errors.iter().map(|e| e.position.into()).collect();
    let lengths: Vec<f64> = errors.iter().map(|e| e.translation_m).collect();
    let truth: Vec<[f64; 3]> =
        truth.world_from_body.iter().map(|pose| pose.translation.into()).collect();
    let plan = Plan {
        name: if is_absolute { "Estimate" } else { "Truth" },
        positions: &estimate,
        errors: &lengths,
        error_name: if is_absolute { "position error, m" } else { "error of the motion, m" },
        is_path: true,
        reference: Some(("the truth", &truth)),
        points: &[],
        links: &[],
    };
    page.row(&views(&plan), &[]);
}

/// Sections about the errors of a trajectory: where they are, when, and how large.
pub(in crate::cli) fn errors(
    page: &mut Page,
    truth: &Trajectory,
    errors: &[PoseError],
    is_absolute: bool,
) {
    page.section("Trajectory");
    error_plan(page, truth, errors, is_absolute);
    let lengths: Vec<f64> = errors.iter().map(|e| e.translation_m).collect();
    let angles: Vec<f64> = errors.iter().map(|e| e.angle_deg).collect();

    page.section("Errors over time");
    let start = errors.first().map_or(0.0, |e| e.timestamp_s);
    let over_time = |values: &[f64]| Line {
        points: errors.iter().map(|e| e.timestamp_s - start).zip(values.iter().copied()).collect(),
        ..Line::default()
    };
    let labels = |title, description, y| Labels { title, description, x: "time, s", y };
    let translation = labels("Translation error", "Its length over time.", "m");
    let rotation = labels("Rotation error", "Its angle over time.", "deg");
    let pictures = [
        lines(translation, Span::FromZero, &[over_time(&lengths)]),
        lines(rotation, Span::FromZero, &[over_time(&angles)]),
    ];
    page.row(&pictures, &[]);

    page.section("How large the errors are");
    let labels = Labels {
        title: "Translation errors by size",
        description: "Share of the poses, %, over the size of the error, m.",
        x: "m",
        y: "%",
    };
    let row = |name: &str, values: &[f64]| {
        std::iter::once(name.to_owned()).chain(quantiles(values)).collect::<Vec<_>>()
    };
    let rows = vec![row("translation, m", &lengths), row("rotation, deg", &angles)];
    let head = ["error", "count", "median", "90 %", "99 %", "largest"];
    page.row(
        &[histogram(labels, None, &lengths)],
        &[Table::new("Quantiles of the errors", &head, rows)],
    );
}
