//! `covis eval`: the errors of a trajectory, or of masks of what moves, against the truth.
//!
//! The figures agree with `evo_ape tum … -a` and `evo_rpe tum …`; with `--per-second` or
//! `--delta-s` with `evaluate_rpe.py` of the TUM RGB-D benchmark. All mathematics is in
//! [`crate::evaluation`].

pub(super) mod mask;
pub(super) mod truth;

use std::path::PathBuf;

use anyhow::{Context, bail};
use covis_solvers::io::trajectory::{Trajectory, TrajectoryFormat};
use serde::Serialize;

use super::choices;
use super::formats::{of_trajectories, read_trajectory};
use super::html::{self, ReportFlag};
use super::output::show;
use crate::evaluation::{self, Evaluation, Statistics};
use crate::report::{Page, Table, count, number};

/// Arguments of `covis eval`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(subcommand)]
    metric: Metric,
}

#[derive(Debug, clap::Subcommand)]
enum Metric {
    /// Absolute pose error after SE(3) alignment.
    Ape(Files),
    /// Relative pose error from one matched pose to the next, or over a fixed time.
    Rpe(Relative),
    /// Intersection over union of masks of moving objects, and the share that they mask falsely.
    Mask(mask::Args),
    /// Write the ground-truth poses beside recorded images as a trajectory.
    Truth(truth::Args),
}

#[derive(Debug, clap::Args)]
struct Relative {
    #[command(flatten)]
    files: Files,
    /// Measure over one second, as the TUM scripts do: the drift in m/s and deg/s.
    #[arg(long, conflicts_with_all = ["delta_s", "max_time_difference"])]
    per_second: bool,
    /// Measure over this time.
    #[arg(long, value_name = "SECONDS", value_parser = time_delta)]
    #[arg(conflicts_with = "max_time_difference")]
    delta_s: Option<f64>,
}

impl Relative {
    fn delta_s(&self) -> Option<f64> {
        if self.per_second { Some(1.0) } else { self.delta_s }
    }
}

#[derive(Debug, clap::Args)]
struct Files {
    /// The ground truth: a TUM, KITTI or EuRoC file, or a recorded folder with groundtruth.txt (TUM) or
    /// frame-*.pose.txt (7-Scenes).
    truth: PathBuf,
    /// The estimated trajectory, in any frame.
    estimate: PathBuf,
    /// Format of both files [default: detected from names and first lines].
    #[arg(long, value_name = "FORMAT", value_parser = of_trajectories())]
    format: Option<TrajectoryFormat>,
    /// Timestamps match within this many seconds.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.01, value_parser = time_difference)]
    max_time_difference: f64,
    #[command(flatten)]
    report: ReportFlag,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
}

fn time_difference(text: &str) -> Result<f64, String> {
    const MUST: &str = "must be a number of seconds, finite and not negative";
    choices::number(text, MUST, |s: &f64| s.is_finite() && *s >= 0.0)
}

fn time_delta(text: &str) -> Result<f64, String> {
    const MUST: &str = "must be a number of seconds, finite and positive";
    choices::number(text, MUST, |s: &f64| s.is_finite() && *s > 0.0)
}

/// The object of `--json`. evo's default, the translation, also stands at the top level.
#[derive(Debug, Serialize)]
struct Document {
    metric: &'static str,
    /// The time between the poses of a pair; without it, they are neighbors.
    #[serde(skip_serializing_if = "Option::is_none")]
    delta_s: Option<f64>,
    truth_poses: usize,
    estimate_poses: usize,
    pairs: usize,
    #[serde(flatten)]
    default: Statistics,
    translation_m: Statistics,
    angle_deg: Statistics,
    rotation_part: Statistics,
    #[serde(skip_serializing_if = "Option::is_none")]
    alignment: Option<Alignment>,
}

/// `truth_from_estimate`.
#[derive(Debug, Serialize)]
struct Alignment {
    rotation: [[f64; 3]; 3],
    translation: [f64; 3],
}

/// What is measured of a trajectory.
#[derive(Clone, Copy)]
enum Measure {
    Absolute,
    Neighbors,
    Over { delta_s: f64 },
}

/// Reads both files, compares, prints.
pub(super) fn run(args: &Args) -> anyhow::Result<()> {
    let (measure, files) = match &args.metric {
        Metric::Mask(args) => return mask::run(args),
        Metric::Truth(args) => return truth::run(args),
        Metric::Ape(files) => (Measure::Absolute, files),
        Metric::Rpe(relative) => {
            let over = relative.delta_s().map(|delta_s| Measure::Over { delta_s });
            (over.unwrap_or(Measure::Neighbors), &relative.files)
        }
    };
    let (truth, truth_has_times) = truth::read(&files.truth, files.format)?;
    let (estimate, format) = read_trajectory(&files.estimate, files.format)?;
    if truth_has_times != format.has_times() {
        let (truth, estimate) = (files.truth.display(), files.estimate.display());
        let without = if truth_has_times { &estimate } else { &truth };
        bail!(
            "{truth} and {estimate}: KITTI's poses have no times and cannot be matched with others; \
             `covis convert {without} OUT.txt --times FILE` adds times"
        );
    }
    let result = match measure {
        Measure::Absolute => evaluation::ape(&truth, &estimate, files.max_time_difference),
        Measure::Neighbors => evaluation::rpe(&truth, &estimate, files.max_time_difference),
        Measure::Over { delta_s } => evaluation::rpe_over(&truth, &estimate, delta_s),
    };
    let result = result
        .with_context(|| format!("{} and {}", files.truth.display(), files.estimate.display()))?;
    let poses = (truth.len(), estimate.len());
    files.report.write(|| page(measure, &truth, poses, &result))?;
    show(files.json, &document(measure, poses, &result), || table(measure, poses, &result))?;
    files.report.tell(files.json)
}

fn document(measure: Measure, poses: (usize, usize), result: &Evaluation) -> Document {
    let motion = &result.truth_from_estimate;
    let matrix = motion.rotation.matrix();
    let alignment = Alignment {
        rotation: [0, 1, 2].map(|row| [0, 1, 2].map(|column| matrix[(row, column)])),
        translation: motion.translation.into(),
    };
    let (metric, delta_s) = match measure {
        Measure::Absolute => ("ape", None),
        Measure::Neighbors => ("rpe", None),
        Measure::Over { delta_s } => ("rpe", Some(delta_s)),
    };
    Document {
        metric,
        delta_s,
        truth_poses: poses.0,
        estimate_poses: poses.1,
        pairs: result.pairs,
        default: result.translation_m,
        translation_m: result.translation_m,
        angle_deg: result.angle_deg,
        rotation_part: result.rotation_part,
        alignment: matches!(measure, Measure::Absolute).then_some(alignment),
    }
}

/// The page: the figures of the table, and where, when and how large the errors are.
fn page(
    measure: Measure,
    truth: &Trajectory,
    (true_poses, estimated_poses): (usize, usize),
    result: &Evaluation,
) -> Page {
    let counts = [
        ("true poses", count(true_poses)),
        ("estimated poses", count(estimated_poses)),
        ("pairs", count(result.pairs)),
    ];
    let mut title = title(measure);
    if let Some(first) = title.get_mut(..1) {
        first.make_ascii_uppercase();
    }
    let mut page = html::page(&title, &counts);
    let row = |(name, translation, angle): (&str, f64, f64)| {
        vec![name.to_owned(), number(translation), number(angle)]
    };
    let head = ["figure", "translation, m", "rotation, deg"];
    page.table(&Table::new("Errors", &head, rows(result).map(row).into()));
    let is_absolute = matches!(measure, Measure::Absolute);
    html::trajectory::errors(&mut page, truth, &result.errors, is_absolute);
    page
}

fn title(measure: Measure) -> String {
    match measure {
        Measure::Absolute => "absolute pose error, SE(3) aligned".to_owned(),
        Measure::Neighbors => "relative pose error, one matched pose to the next".to_owned(),
        Measure::Over { delta_s } => format!("relative pose error over {delta_s} s"),
    }
}

/// The figures by their names, of translations and of rotations.
fn rows(result: &Evaluation) -> [(&'static str, f64, f64); 7] {
    let (translations, angles) = (&result.translation_m, &result.angle_deg);
    [
        ("rmse", translations.rmse, angles.rmse),
        ("mean", translations.mean, angles.mean),
        ("median", translations.median, angles.median),
        ("std", translations.std, angles.std),
        ("min", translations.min, angles.min),
        ("max", translations.max, angles.max),
        ("sse", translations.sse, angles.sse),
    ]
}

fn table(measure: Measure, poses: (usize, usize), result: &Evaluation) -> String {
    let title = title(measure);
    let mut text = format!(
        "{title}\n{} pairs of {} true and {} estimated poses\n\n{:>8}  {:>16}  {:>14}",
        result.pairs, poses.0, poses.1, "", "translation (m)", "rotation (deg)"
    );
    for (name, translation, angle) in rows(result) {
        text.push_str(&format!("\n{name:>8}  {translation:>16.6}  {angle:>14.6}"));
    }
    text
}
