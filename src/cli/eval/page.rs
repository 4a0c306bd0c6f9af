//! The report of `covis eval ape|rpe`: the figures of the table, and where, when and how large the errors
//! are.
//!
//! One estimate has the sections of any trajectory with errors; several are drawn over each other, then each
//! alone.

use covis_solvers::io::trajectory::Trajectory;

use super::Compared;
use super::measure::Measure;
use super::output::{figures, statistics};
use crate::cli::formats::joined;
use crate::cli::html::trajectory::{Course, components, way};
use crate::cli::html::{self, trajectory};
use crate::evaluation::PoseRelation;
use crate::report::{
    Labels, Line, Page, Paths, Role, SERIES, Span, Table, count, lines, number, overlay,
};

pub(super) fn page(measure: &Measure, truth: &Trajectory, compared: &[Compared<'_>]) -> Page {
    match compared {
        [one] => page_of_one(measure, truth, one),
        several => page_of_several(measure, truth, several),
    }
}

/// The title of the page.
fn title(measure: &Measure) -> String {
    let mut title = measure.title();
    if let Some(first) = title.get_mut(..1) {
        first.make_ascii_uppercase();
    }
    title
}

fn page_of_one(measure: &Measure, truth: &Trajectory, compared: &Compared<'_>) -> Page {
    let result = &compared.result;
    let estimate = compared.aligned();
    let compared_truth = within(truth, std::slice::from_ref(&estimate));
    let mut facts = vec![
        ("true poses", format!("{}; {}", count(truth.len()), way(truth))),
        ("estimated poses", format!("{}; {}", count(estimate.len()), way(&estimate))),
        ("pairs", count(result.pairs)),
    ];
    if measure.alignment.correction.has_scale() {
        facts.push(("scale", number(result.truth_from_estimate.scale)));
    }
    let mut page =
        html::page(&title(measure), &verdict(measure, compared, &compared_truth), &facts);
    let relations = measure.relations();
    let heads: Vec<String> = relations.iter().copied().map(trajectory::named).collect();
    let head: Vec<&str> =
        std::iter::once("figure").chain(heads.iter().map(String::as_str)).collect();
    let columns: Vec<_> =
        relations.iter().map(|&relation| figures(&statistics(compared, relation))).collect();
    let row = |(index, (name, _)): (usize, (&str, f64))| {
        let cells = columns.iter().map(|column| number(column[index].1));
        std::iter::once(name.to_owned()).chain(cells).collect()
    };
    let rows = figures(&compared.first).into_iter().enumerate().map(row).collect();
    page.table(&Table::new("Errors", &head, rows));
    let is_absolute = measure.motions.is_none();
    trajectory::errors(&mut page, truth, &result.errors, is_absolute, &relations);
    if is_absolute {
        let course =
            |name: &str, role, trajectory| Course { name: name.to_owned(), role, trajectory };
        let truth = course("truth", Role::Before, &compared_truth);
        components(&mut page, &[truth, course("estimate", Role::After, &estimate)]);
    }
    page
}

fn page_of_several(measure: &Measure, truth: &Trajectory, compared: &[Compared<'_>]) -> Page {
    let truth_way = format!("{}; {}", count(truth.len()), way(truth));
    let facts = [("true poses", truth_way), ("estimates", count(compared.len()))];
    let mut page = html::page(&title(measure), &verdict_of_several(measure, compared), &facts);
    page.table(&figures_of_several(measure, compared));
    let names: Vec<String> = compared
        .iter()
        .take(SERIES)
        .enumerate()
        .map(|(index, one)| format!("{}: {}", index + 1, one.path.display()))
        .collect();
    let names = names.join(", ");
    let is_absolute = measure.motions.is_none();
    if is_absolute {
        page.section("Trajectories");
        together(&mut page, truth, compared, &names);
    }
    page.section("Errors over time");
    over_time(&mut page, measure, compared, &names);
    if is_absolute {
        let estimates: Vec<Trajectory> =
            compared.iter().take(SERIES).map(Compared::aligned).collect();
        let truth = within(truth, &estimates);
        let truth = Course { name: "truth".to_owned(), role: Role::Reference, trajectory: &truth };
        let course = |(index, trajectory): (usize, _)| {
            let (name, role) = ((index + 1).to_string(), Role::Series(index));
            Course { name, role, trajectory }
        };
        let courses = estimates.iter().enumerate().map(course);
        components(&mut page, &std::iter::once(truth).chain(courses).collect::<Vec<_>>());
    }
    for one in compared {
        page.section(&one.path.display().to_string());
        let errors = &one.result.errors;
        trajectory::error_plan_of(&mut page, truth, errors, is_absolute, measure.relation);
    }
    page
}

/// The truth at the times of the estimates, with a second around.
fn within(truth: &Trajectory, estimates: &[Trajectory]) -> Trajectory {
    const AROUND_S: f64 = 1.0;
    let times = || estimates.iter().flat_map(|estimate| estimate.timestamps.iter().copied());
    let first = times().fold(f64::INFINITY, f64::min) - AROUND_S;
    let last = times().fold(f64::NEG_INFINITY, f64::max) + AROUND_S;
    let poses = truth.timestamps.iter().copied().zip(truth.world_from_body.iter().copied());
    joined(poses.filter(|(time, _)| (first..=last).contains(time)))
}

/// What came out for one estimate, in a sentence.
fn verdict(measure: &Measure, compared: &Compared<'_>, truth: &Trajectory) -> String {
    let (rmse, of) = (number(compared.first.rmse), trajectory::named(measure.relation));
    format!("The rmse is {rmse} ({of}) over a true way of {}.", way(truth))
}

/// The best of several, in a sentence.
fn verdict_of_several(measure: &Measure, compared: &[Compared<'_>]) -> String {
    let best = compared.iter().min_by(|a, b| a.first.rmse.total_cmp(&b.first.rmse));
    let best = best.map(|one| {
        let (path, rmse) = (one.path.display(), number(one.first.rmse));
        format!("{path} has the lowest rmse, {rmse} ({}).", trajectory::named(measure.relation))
    });
    best.unwrap_or_default()
}

/// A row an estimate.
fn figures_of_several(measure: &Measure, compared: &[Compared<'_>]) -> Table {
    let has_scale = measure.alignment.correction.has_scale();
    let mut head = vec!["", "estimate", "estimated poses", "pairs"];
    if let Some(one) = compared.first() {
        head.extend(figures(&one.first).map(|(name, _)| name));
    }
    if has_scale {
        head.push("scale");
    }
    let row = |(index, one): (usize, &Compared<'_>)| {
        let mut cells = vec![(index + 1).to_string(), one.path.display().to_string()];
        cells.extend([count(one.estimate.len()), count(one.result.pairs)]);
        cells.extend(figures(&one.first).map(|(_, figure)| number(figure)));
        if has_scale {
            cells.push(number(one.result.truth_from_estimate.scale));
        }
        cells
    };
    let caption = format!("Errors: {}", trajectory::named(measure.relation));
    Table::new(&caption, &head, compared.iter().enumerate().map(row).collect())
}

/// All aligned estimates over the truth.
fn together(page: &mut Page, truth: &Trajectory, compared: &[Compared<'_>], names: &str) {
    let path = |(index, one): (usize, &Compared<'_>)| {
        let positions = one.result.errors.iter().map(|error| error.position.into()).collect();
        ((index + 1).to_string(), positions)
    };
    let paths: Vec<(String, Vec<[f64; 3]>)> =
        compared.iter().take(SERIES).enumerate().map(path).collect();
    let truth: Vec<[f64; 3]> =
        truth.world_from_body.iter().map(|pose| pose.translation.into()).collect();
    let plan = Paths {
        name: "Estimates",
        description: names,
        paths: &paths,
        reference: ("the truth", &truth),
    };
    page.row(&overlay(&plan), &[]);
    if compared.len() > SERIES {
        page.note(&format!("The pictures of all have the first {SERIES} estimates."));
    }
}

/// The errors of all estimates over one time.
fn over_time(page: &mut Page, measure: &Measure, compared: &[Compared<'_>], names: &str) {
    let times = compared.iter().flat_map(|one| one.result.errors.iter().map(|e| e.timestamp_s));
    let start = times.fold(f64::INFINITY, f64::min);
    let line = |relation: PoseRelation, (index, one): (usize, &Compared<'_>)| {
        let errors = one.result.errors.iter();
        let points = errors.filter_map(|e| Some((e.timestamp_s - start, relation.of(e)?)));
        Line {
            name: Some((index + 1).to_string()),
            role: Role::Series(index),
            points: points.collect(),
            marked: Vec::new(),
        }
    };
    let pictures: Vec<_> = measure
        .relations()
        .into_iter()
        .map(|relation| {
            let all = compared.iter().take(SERIES).enumerate();
            let all: Vec<Line> = all.map(|one| line(relation, one)).collect();
            let labels = Labels {
                title: &trajectory::chart_title(relation),
                description: names,
                x: "time, s",
                y: relation.unit().unwrap_or_default(),
            };
            lines(labels, Span::FromZero, &all)
        })
        .collect();
    page.row(&pictures, &[]);
}
