//! What pages show of trajectories: positions from above and from the side, errors over time and by size.
//! The errors are those of [`crate::evaluation`].

use covis_solvers::io::trajectory::Trajectory;

use crate::evaluation::{PoseError, PoseRelation};
use crate::report::{Labels, Line, Page, Plan, Span, Table, histogram, lines, quantiles, views};

/// A relation with its unit: "translation, m".
pub(in crate::cli) fn named(relation: PoseRelation) -> String {
    match relation.unit() {
        Some(unit) => format!("{}, {unit}", relation.title()),
        None => relation.title().to_owned(),
    }
}

/// The title of a chart of errors: "Translation error".
pub(in crate::cli) fn chart_title(relation: PoseRelation) -> String {
    let mut title = format!("{} error", relation.title());
    if let Some(first) = title.get_mut(..1) {
        first.make_ascii_uppercase();
    }
    title
}

/// Where the errors of the translation are: [`error_plan_of`].
pub(in crate::cli) fn error_plan(
    page: &mut Page,
    truth: &Trajectory,
    errors: &[PoseError],
    is_absolute: bool,
) {
    error_plan_of(page, truth, errors, is_absolute, PoseRelation::TranslationPart);
}

/// Where the errors are: the trajectory beside the truth. `is_absolute` says that they are of single
/// poses, otherwise they are of motions and are shown along the truth. Poses without this figure are left
/// out.
pub(in crate::cli) fn error_plan_of(
    page: &mut Page,
    truth: &Trajectory,
    errors: &[PoseError],
    is_absolute: bool,
    relation: PoseRelation,
) {
    let seen = errors.iter().filter_map(|e| Some((<[f64; 3]>::from(e.position), relation.of(e)?)));
    let (estimate, sizes): (Vec<_>, Vec<f64>) = seen.unzip();
    let truth: Vec<[f64; 3]> =
        truth.world_from_body.iter().map(|pose| pose.translation.into()).collect();
    let error_name = match (relation, is_absolute) {
        (PoseRelation::TranslationPart, true) => "position error, m".to_owned(),
        (PoseRelation::TranslationPart, false) => "error of the motion, m".to_owned(),
        (other, _) => format!("error of the {}", named(other)),
    };
    let plan = Plan {
        name: if is_absolute { "Estimate" } else { "Truth" },
        positions: &estimate,
        errors: &sizes,
        error_name: &error_name,
        is_path: true,
        reference: Some(("the truth", &truth)),
        points: &[],
        links: &[],
    };
    page.row(&views(&plan), &[]);
}

/// Sections about the errors of a trajectory: where they are, when, and how large. The first of the
/// relations is drawn, all of them are over time and in the table.
pub(in crate::cli) fn errors(
    page: &mut Page,
    truth: &Trajectory,
    errors: &[PoseError],
    is_absolute: bool,
    relations: &[PoseRelation],
) {
    let first = relations.first().copied().unwrap_or_default();
    let figures =
        |relation: PoseRelation| errors.iter().filter_map(move |error| relation.of(error));
    page.section("Trajectory");
    error_plan_of(page, truth, errors, is_absolute, first);

    page.section("Errors over time");
    let start = errors.first().map_or(0.0, |e| e.timestamp_s);
    let over_time = |&relation: &PoseRelation| {
        let points = errors.iter().filter_map(|e| Some((e.timestamp_s - start, relation.of(e)?)));
        let line = Line { points: points.collect(), ..Line::default() };
        let is_angle = matches!(relation, PoseRelation::AngleDeg | PoseRelation::AngleRad);
        let description = match (relation, is_angle) {
            (PoseRelation::TranslationPart, _) => "Its length over time.",
            (_, true) => "Its angle over time.",
            (_, false) => "Its size over time.",
        };
        let (title, y) = (chart_title(relation), relation.unit().unwrap_or_default());
        lines(Labels { title: &title, description, x: "time, s", y }, Span::FromZero, &[line])
    };
    page.row(&relations.iter().map(over_time).collect::<Vec<_>>(), &[]);

    page.section("How large the errors are");
    let unit = first.unit();
    let over = unit.map(|unit| format!(", {unit}")).unwrap_or_default();
    let labels = Labels {
        title: &format!("{}s by size", chart_title(first)),
        description: &format!("Share of the poses, %, over the size of the error{over}."),
        x: unit.unwrap_or("size"),
        y: "%",
    };
    let row = |&relation: &PoseRelation| {
        let values: Vec<f64> = figures(relation).collect();
        std::iter::once(named(relation)).chain(quantiles(&values)).collect::<Vec<_>>()
    };
    let rows = relations.iter().map(row).collect();
    let head = ["error", "count", "median", "90 %", "99 %", "largest"];
    page.row(
        &[histogram(labels, None, &figures(first).collect::<Vec<_>>())],
        &[Table::new("Quantiles of the errors", &head, rows)],
    );
}
