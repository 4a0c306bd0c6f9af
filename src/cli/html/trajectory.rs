//! What pages show of trajectories: positions from above and from the side, errors over time and by size.
//! The errors are those of [`crate::evaluation`].

use covis_solvers::geometry::Se3;
use covis_solvers::io::trajectory::Trajectory;

use crate::evaluation::{PoseError, PoseRelation};
use crate::report::{
    Labels, Line, Page, Plan, Role, Span, Table, histogram, lines, number, quantiles, views,
};

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

/// A trajectory for [`components`].
pub(in crate::cli) struct Course<'a> {
    pub(in crate::cli) name: String,
    pub(in crate::cli) role: Role,
    pub(in crate::cli) trajectory: &'a Trajectory,
}

/// A way in words: "18.88 m in 99.18 s".
pub(in crate::cli) fn way(trajectory: &Trajectory) -> String {
    format!("{} m in {} s", number(trajectory.length_m()), number(trajectory.duration_s()))
}

/// A section with x, y, z, and roll, pitch, yaw of bodies over time, all in one frame. The angles are about
/// the fixed axes x, y and z in this order, as evo has them.
pub(in crate::cli) fn components(page: &mut Page, courses: &[Course<'_>]) {
    const NAMES: [(&str, &str); 6] =
        [("x", "m"), ("y", "m"), ("z", "m"), ("Roll", "deg"), ("Pitch", "deg"), ("Yaw", "deg")];
    let begins = courses.iter().filter_map(|course| course.trajectory.timestamps.first());
    let start_s = begins.copied().fold(f64::INFINITY, f64::min);
    page.section("Position and orientation");
    let figure = |pose: &Se3, component: usize| match component {
        0..3 => pose.translation[component],
        _ => {
            let (roll, pitch, yaw) = pose.rotation.quaternion().euler_angles();
            [roll, pitch, yaw][component - 3].to_degrees()
        }
    };
    let picture = |(component, (name, unit)): (usize, &(&str, &str))| {
        let of = |course: &Course<'_>| {
            let Trajectory { timestamps, world_from_body } = course.trajectory;
            let poses = timestamps.iter().zip(world_from_body);
            let points: Vec<(f64, f64)> =
                poses.map(|(time, pose)| (time - start_s, figure(pose, component))).collect();
            // An angle that goes on at the other end of the circle does not go through the middle.
            let runs = points.chunk_by(|a, b| component < 3 || (b.1 - a.1).abs() < 180.0);
            let line = |(number, run): (usize, &[(f64, f64)])| Line {
                name: (number == 0).then(|| course.name.clone()),
                role: course.role,
                points: run.to_vec(),
                marked: Vec::new(),
            };
            runs.enumerate().map(line).collect::<Vec<_>>()
        };
        let all: Vec<Line> = courses.iter().flat_map(of).collect();
        let title = if component < 3 { format!("Position along {name}") } else { name.to_string() };
        let description = "Over time, in the frame of the map or of the truth.";
        let labels = Labels { title: &title, description, x: "time, s", y: unit };
        lines(labels, Span::Linear, &all)
    };
    page.row(&NAMES.iter().enumerate().map(picture).collect::<Vec<_>>(), &[]);
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
