//! What `covis run --report` shows: the trajectory with what corrections moved, the closures with their
//! verdicts, the server's solves, residuals on the final map, and where the time went.
//!
//! The map is asked after the run; its residuals are the evaluator's, over the model that `ExportMap` gives.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Context;
use covis_solvers::evaluation::ObservationLengths;
use covis_solvers::io::colmap::{ColmapEncoding, ColmapModel};

use super::report::{self, Document, Quantiles};
use crate::cli::formats::joined;
use crate::cli::html;
use crate::cli::html::solve::{Iteration, Residuals, cost, residuals, rms};
use crate::cli::html::trajectory::{Course, components};
use crate::client::Client;
use crate::frontend::mapping::run::RunReport;
use crate::frontend::mapping::solves::LocalSolve;
use crate::report::{
    Bar, Labels, Line, Link, Page, Plan, Role, Span, Table, bars, count, lines, number, views,
};
use crate::wire::v1;
use v1::constraint::Constraint;

/// What the map knows after a run.
pub(super) struct FinalMap {
    closures: Vec<Closure>,
    lengths: ObservationLengths,
}

/// A loop closure of the map.
struct Closure {
    name: String,
    link: Option<Link>,
    off: Option<v1::SwitchedOff>,
}

impl FinalMap {
    /// Root mean square of the pixels' residuals, px; `None` without any.
    pub(super) fn rms_px(&self) -> Option<f64> {
        let all = &self.lengths.pixels_px;
        (!all.is_empty()).then(|| rms(all))
    }

    /// Asks the server.
    ///
    /// # Errors
    /// Those of the calls; a model that cannot be read.
    pub(super) async fn of(client: &Client, map: &str) -> anyhow::Result<Self> {
        let positions: BTreeMap<(String, i64), [f64; 3]> =
            client.trajectory(map, None).await?.poses.into_iter().filter_map(position).collect();
        let constraints = client.constraints(map).await?.constraints;
        let closures = constraints.into_iter().filter_map(|message| match message.constraint? {
            Constraint::RelativePose(pose) if pose.kind() == v1::ConstraintKind::LoopClosure => {
                closure(pose, &positions)
            }
            Constraint::RelativePose(_)
            | Constraint::PosePrior(_)
            | Constraint::PositionPrior(_) => None,
        });
        let closures = closures.collect();
        Ok(Self { closures, lengths: lengths(client, map).await? })
    }
}

fn position(pose: v1::KeyframePose) -> Option<((String, i64), [f64; 3])> {
    let (keyframe, position) = (pose.keyframe?, pose.world_from_camera?.translation?);
    Some(((keyframe.client_id, keyframe.id), [position.x, position.y, position.z]))
}

fn closure(
    pose: v1::RelativePoseConstraint,
    positions: &BTreeMap<(String, i64), [f64; 3]>,
) -> Option<Closure> {
    let (i, j) = (pose.keyframe_i?, pose.keyframe_j?);
    let name = format!("{}/{} to {}/{}", i.client_id, i.id, j.client_id, j.id);
    let position =
        |keyframe: v1::KeyframeRef| positions.get(&(keyframe.client_id, keyframe.id)).copied();
    let counts = pose.switched_off.is_none();
    let link = position(i).zip(position(j)).map(|(from, to)| Link { from, to, counts });
    Some(Closure { name, link, off: pose.switched_off })
}

/// The residuals of the map's pixels, by the COLMAP model that the server exports.
async fn lengths(client: &Client, map: &str) -> anyhow::Result<ObservationLengths> {
    let request = v1::ExportMapRequest {
        map_id: map.to_owned(),
        format: v1::MapFormat::ColmapBinary.into(),
        all_landmarks: true,
    };
    let mut export = client.export_map_with(request).await?;
    let mut files: BTreeMap<String, Vec<u8>> = BTreeMap::new();
    while let Some(chunk) = export.next().await? {
        files.entry(chunk.path).or_default().extend(chunk.data);
    }
    let encoding = ColmapEncoding::Binary;
    let bytes = encoding.file_names().map(|name| files.get(name).map_or(&[][..], |b| b));
    let model = ColmapModel::parse(encoding, bytes, Path::new(map)).context("the map's model")?;
    Ok(ObservationLengths::of(&model.to_problem()?.problem))
}

/// The page of a run; `map` is absent where the server could not be asked.
pub(super) fn page(
    title: &str,
    document: &Document,
    report: &RunReport,
    map: Option<&FinalMap>,
) -> Page {
    let mut page = html::page(title, &document.verdict(map), &document.facts());
    trajectory(&mut page, report, map);
    if let Some(map) = map {
        closures(&mut page, &map.closures);
    }
    solves(&mut page, report);
    if let Some(map) = map {
        let after = &map.lengths.pixels_px;
        residuals(
            &mut page,
            &[Residuals { name: "pixels on the final map", unit: "px", before: None, after }],
        );
    }
    times(&mut page, report, &document.stages);
    page
}

fn trajectory(page: &mut Page, run: &RunReport, map: Option<&FinalMap>) {
    let positions: Vec<[f64; 3]> =
        run.trajectory.iter().map(|(_, pose)| pose.translation.into()).collect();
    let live: Vec<[f64; 3]> =
        run.live.iter().map(|frame| frame.world_from_camera.translation.into()).collect();
    let moved: Vec<f64> = run
        .trajectory
        .iter()
        .zip(&run.live)
        .map(|((_, last), live)| (last.translation - live.world_from_camera.translation).norm())
        .collect();
    let links: Vec<Link> =
        map.iter().flat_map(|map| &map.closures).filter_map(|closure| closure.link).collect();
    page.section("Trajectory");
    let plan = Plan {
        name: "Camera on the final map",
        positions: &positions,
        errors: &moved,
        error_name: "correction since it was tracked, m",
        is_path: true,
        reference: Some(("where tracking said it was at the time", &live)),
        points: &[],
        links: &links,
    };
    page.row(&views(&plan), &[]);
    let live = joined(run.live.iter().map(|frame| (frame.timestamp_s, frame.world_from_camera)));
    let last = report::trajectory(run);
    let course = |name: &str, role, trajectory| Course { name: name.to_owned(), role, trajectory };
    components(
        page,
        &[course("at the time", Role::Before, &live), course("final map", Role::After, &last)],
    );
}

fn closures(page: &mut Page, closures: &[Closure]) {
    page.section("Closures");
    if closures.is_empty() {
        return page.note("The server recognized no place to which the camera returned.");
    }
    let row = |closure: &Closure| {
        let (verdict, chi2, weight) = match &closure.off {
            None => ("counts".to_owned(), String::new(), String::new()),
            Some(off) => {
                let name = if off.provisional { "found false, provisional" } else { "found false" };
                (name.to_owned(), number(off.chi2), number(off.weight))
            }
        };
        vec![closure.name.clone(), verdict, chi2, weight]
    };
    let mut head = vec!["keyframes", "verdict", "chi2", "weight"];
    if closures.iter().all(|closure| closure.off.is_none()) {
        // Only those that are off have figures.
        head.truncate(2);
    }
    let row = |closure: &Closure| row(closure).into_iter().take(head.len()).collect();
    page.table(&Table::new("Loop closures of the map", &head, closures.iter().map(row).collect()));
}

/// The last optimization with its residuals before and after, then the local ones.
fn solves(page: &mut Page, report: &RunReport) {
    if let Some(last) = &report.last_solve {
        let row = |row: &v1::IterationSummary| Iteration {
            iteration: usize::try_from(row.iteration).unwrap_or(0),
            cost: row.cost,
            seconds: row.elapsed_us as f64 * 1e-6,
            accepted: row.accepted,
            damping: row.damping,
        };
        cost(page, &last.iterations.iter().map(row).collect::<Vec<_>>());
        let row = |kind: &v1::ResidualStatistics| {
            vec![
                kind.kind().as_str_name().trim_start_matches("RESIDUAL_KIND_").to_lowercase(),
                kind.factor_count.to_string(),
                kind.initial_rms.map_or_else(|| "–".to_owned(), number),
                number(kind.final_rms),
                number(kind.reduced_chi2),
            ]
        };
        let head = ["residuals", "count", "rms before", "rms after", "reduced chi2"];
        let rows = last.summary.residuals.iter().map(row).collect();
        page.table(&Table::new("The optimization of the whole map at the end", &head, rows));
    }
    if report.local_solves.is_empty() {
        return;
    }
    page.section("Local solves");
    let start_s = report.live.first().map_or(0.0, |frame| frame.timestamp_s);
    let line = |name: Option<&str>, role, figure: fn(&LocalSolve) -> f64| {
        let all = report.local_solves.iter();
        let points = all.map(|s| (s.newest_keyframe_s - start_s, figure(s))).collect();
        Line { name: name.map(str::to_owned), role, points, ..Line::default() }
    };
    let costs = Labels {
        title: "Cost of the server's local solves",
        description: "Before and after each solve, over the newest keyframe when its answer came.",
        x: "time of the sequence, s",
        y: "cost",
    };
    let times = Labels {
        title: "Time of the server's local solves",
        description: "How long each solve took, over the newest keyframe when its answer came.",
        x: "time of the sequence, s",
        y: "ms",
    };
    let before = line(Some("before"), Role::Before, |solve| solve.initial_cost);
    let after = line(Some("after"), Role::After, |solve| solve.final_cost);
    let took = line(None, Role::After, |solve| solve.solve_s * 1e3);
    page.row(
        &[lines(costs, Span::OfValues, &[before, after]), lines(times, Span::FromZero, &[took])],
        &[],
    );
}

/// Where the time went: stages, and frames one after the other.
fn times(page: &mut Page, report: &RunReport, stages: &BTreeMap<&'static str, Quantiles>) {
    page.section("Time");
    let bar = |(name, quantiles): (&&'static str, &Quantiles)| Bar {
        name: (*name).to_owned(),
        value: quantiles.p50_ms,
        mark: Some(quantiles.p99_ms),
    };
    let labels = Labels {
        title: "Stages of a frame",
        description: "Bars are medians, marks 99 % quantiles, ms.",
        x: "ms",
        y: "",
    };
    let row = |(name, quantiles): (&&'static str, &Quantiles)| {
        vec![
            (*name).to_owned(),
            format!("{:.2}", quantiles.p50_ms),
            format!("{:.2}", quantiles.p99_ms),
        ]
    };
    let table =
        Table::new("Stages, ms", &["stage", "median", "99 %"], stages.iter().map(row).collect());
    page.row(&[bars(labels, &stages.iter().map(bar).collect::<Vec<_>>())], &[table]);
    let frames = &report.durations.frame;
    let labels = Labels {
        title: "Time of each frame",
        description: "All that the tracking thread does for a frame; of many frames the slowest are shown.",
        x: "frame",
        y: "ms",
    };
    let points = frames.iter().enumerate().map(|(k, s)| (k as f64, s * 1e3)).collect();
    let line = Line { points, ..Line::default() };
    let late = count(report.late());
    page.row(&[lines(labels, Span::FromZero, &[line])], &[]);
    page.note(&format!("{late} of {} frames took longer than 33 ms.", count(frames.len())));
}
