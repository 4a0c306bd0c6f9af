//! `covis eval`: the errors of trajectories, or of masks of what moves, against the truth.
//!
//! The figures agree with `evo_ape tum …` and `evo_rpe tum …`, by default with those of `evo_ape -a` and
//! `evo_rpe`; with `--per-second` or `--delta-s` with `evaluate_rpe.py` of the TUM RGB-D benchmark. All
//! mathematics is in [`crate::evaluation`]. Arguments are here, `measure` is what they ask for in words,
//! `output` prints it and `page` is the report.

pub(super) mod mask;
mod measure;
mod output;
mod page;
pub(super) mod truth;

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::builder::TypedValueParser;
use covis_solvers::io::trajectory::{Trajectory, TrajectoryFormat};

use self::measure::{Measure, Motions};
use super::choices::{self, Choices, choice, choice_of};
use super::formats::{joined, of_trajectories, read_trajectory};
use super::html::ReportFlag;
use super::output::show;
use crate::evaluation::{
    self, Correction, DeltaUnit, Evaluation, EvaluationError, MotionPairs, PoseRelation, Statistics,
};

/// Arguments of `covis eval`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    #[command(subcommand)]
    metric: Metric,
}

#[derive(Debug, clap::Subcommand)]
enum Metric {
    /// Absolute pose error of aligned trajectories.
    Ape(Absolute),
    /// Relative pose error from one matched pose to the next, or over a number of poses, a path, an angle or
    /// a time.
    Rpe(Relative),
    /// Intersection over union of masks of moving objects, and the share that they mask falsely.
    Mask(mask::Args),
    /// Write the ground-truth poses beside recorded images as a trajectory.
    Truth(truth::Args),
}

#[derive(Debug, clap::Args)]
struct Absolute {
    #[command(flatten)]
    files: Files,
    /// What is corrected before the comparison.
    #[arg(long, value_name = "HOW", value_parser = choice(CORRECTIONS), default_value = "se3")]
    align: Correction,
    /// The error that stands first and that reports draw, by evo's names.
    #[arg(long, value_name = "RELATION", value_parser = of_poses(), default_value = "trans_part")]
    pose_relation: PoseRelation,
}

#[derive(Debug, clap::Args)]
struct Relative {
    #[command(flatten)]
    files: Files,
    /// What is corrected before the comparison. Only the scale changes relative errors.
    #[arg(long, value_name = "HOW", value_parser = choice(CORRECTIONS), default_value = "none")]
    align: Correction,
    /// The error that stands first and that reports draw, by evo's names.
    #[arg(long, value_name = "RELATION", value_parser = choice(RELATIONS))]
    #[arg(default_value = "trans_part")]
    pose_relation: PoseRelation,
    /// How far apart the poses of a pair are, in the unit of --delta-unit.
    #[arg(long, value_name = "NUMBER", default_value_t = 1.0, value_parser = distance)]
    delta: f64,
    /// Unit of --delta.
    #[arg(long, value_name = "UNIT", value_parser = choice(UNITS), default_value = "f")]
    delta_unit: DeltaUnit,
    /// Begin a pair at each pose; otherwise each begins where the last one ended.
    #[arg(long)]
    all_pairs: bool,
    /// With --all-pairs, path or angle may differ from --delta by this share of it.
    #[arg(long, value_name = "SHARE", default_value_t = 0.1, value_parser = share)]
    #[arg(requires = "all_pairs")]
    delta_tol: f64,
    /// Measure path and angle along the truth, so that all estimates have the same pairs; otherwise along
    /// the estimate.
    #[arg(long)]
    pairs_from_reference: bool,
    /// Measure over one second, as the TUM scripts do: the drift in m/s and deg/s.
    #[arg(long, conflicts_with_all = ["delta_s", "max_time_difference"])]
    #[arg(conflicts_with_all = PAIRING)]
    per_second: bool,
    /// Measure over this time.
    #[arg(long, value_name = "SECONDS", value_parser = time_delta)]
    #[arg(conflicts_with = "max_time_difference", conflicts_with_all = PAIRING)]
    delta_s: Option<f64>,
}

/// What has no meaning where pairs are told by time.
const PAIRING: [&str; 5] =
    ["delta", "delta_unit", "all_pairs", "delta_tol", "pairs_from_reference"];

impl Relative {
    fn motions(&self) -> Motions {
        match if self.per_second { Some(1.0) } else { self.delta_s } {
            Some(delta_s) => Motions::Over { delta_s },
            None => Motions::Between(MotionPairs {
                delta: self.delta,
                unit: self.delta_unit,
                all_pairs: self.all_pairs,
                tolerance: self.delta_tol,
                from_truth: self.pairs_from_reference,
            }),
        }
    }
}

#[derive(Debug, clap::Args)]
struct Files {
    /// The ground truth: a TUM, KITTI or EuRoC file, a recorded folder with groundtruth.txt (TUM) or
    /// frame-*.pose.txt (7-Scenes), or a recording of ROS 2 with poses, as PATH or PATH:TOPIC.
    truth: PathBuf,
    /// The estimated trajectories, each in any frame, and in a file or a recording as above.
    #[arg(required = true, value_name = "ESTIMATE")]
    estimates: Vec<PathBuf>,
    /// Format of all files [default: detected from names and first lines].
    #[arg(long, value_name = "FORMAT", value_parser = of_trajectories())]
    format: Option<TrajectoryFormat>,
    /// Timestamps match within this many seconds.
    #[arg(long, value_name = "SECONDS", default_value_t = 0.01, value_parser = time_difference)]
    max_time_difference: f64,
    /// Fit the alignment to this many matched poses from the start [default: all].
    #[arg(long, value_name = "COUNT", value_parser = poses)]
    n_to_align: Option<NonZeroUsize>,
    #[command(flatten)]
    report: ReportFlag,
    /// Print one JSON object instead of a table.
    #[arg(long)]
    json: bool,
}

const CORRECTIONS: &Choices<Correction> = &[
    ("se3", Correction::Se3, "Rotation and translation (evo's -a)"),
    ("sim3", Correction::Sim3, "Rotation, translation and scale (-as), for one camera"),
    ("scale", Correction::Scale, "The scale alone (-s)"),
    ("none", Correction::None, "Nothing: both are in one frame"),
    ("origin", Correction::Origin, "The first matched pose becomes the true one (--align_origin)"),
];

const RELATIONS: &Choices<PoseRelation> = &[
    ("trans_part", PoseRelation::TranslationPart, "Length of the translation error, m"),
    ("rot_part", PoseRelation::RotationPart, "Frobenius norm of R - I of the error"),
    ("full", PoseRelation::Full, "Frobenius norm of E - I of the error"),
    ("angle_deg", PoseRelation::AngleDeg, "Angle of the rotation error, degrees"),
    ("angle_rad", PoseRelation::AngleRad, "Angle of the rotation error, radians"),
    ("point_distance", PoseRelation::PointDistance, "Difference of the distances moved, m"),
    (
        "point_distance_error_ratio",
        PoseRelation::PointDistanceErrorRatio,
        "The same over the true distance, percent",
    ),
];

const UNITS: &Choices<DeltaUnit> = &[
    ("f", DeltaUnit::Frames, "Matched poses"),
    ("m", DeltaUnit::Meters, "Meters of path"),
    ("d", DeltaUnit::Degrees, "Degrees of rotation"),
    ("r", DeltaUnit::Radians, "Radians of rotation"),
];

/// Takes a relation that single poses have.
fn of_poses() -> impl TypedValueParser<Value = PoseRelation> {
    let is_ratio = |relation| relation == PoseRelation::PointDistanceErrorRatio;
    choice_of(RELATIONS.iter().copied().filter(move |&(_, relation, _)| !is_ratio(relation)))
}

fn time_difference(text: &str) -> Result<f64, String> {
    const MUST: &str = "must be a number of seconds, finite and not negative";
    choices::number(text, MUST, |s: &f64| s.is_finite() && *s >= 0.0)
}

fn time_delta(text: &str) -> Result<f64, String> {
    const MUST: &str = "must be a number of seconds, finite and positive";
    choices::number(text, MUST, |s: &f64| s.is_finite() && *s > 0.0)
}

fn poses(text: &str) -> Result<NonZeroUsize, String> {
    choices::number(text, "must be a number of poses, at least 1", |_| true)
}

fn distance(text: &str) -> Result<f64, String> {
    choices::number(text, "must be finite and positive", |d: &f64| d.is_finite() && *d > 0.0)
}

fn share(text: &str) -> Result<f64, String> {
    choices::number(text, "must be finite and not negative", |s: &f64| s.is_finite() && *s >= 0.0)
}

/// An estimate and what was found about it.
struct Compared<'a> {
    path: &'a Path,
    /// As it is in the file.
    estimate: Trajectory,
    result: Evaluation,
    /// Statistics of the relation that was asked for.
    first: Statistics,
}

impl Compared<'_> {
    /// The estimate in the frame of the truth, as far as it was corrected.
    fn aligned(&self) -> Trajectory {
        let Trajectory { timestamps, world_from_body } = &self.estimate;
        let poses = world_from_body.iter();
        let poses = poses.map(|pose| self.result.truth_from_estimate.transform_pose(pose));
        joined(timestamps.iter().copied().zip(poses))
    }
}

/// Reads the files, compares, prints.
pub(super) fn run(args: &Args) -> anyhow::Result<()> {
    let (measure, files) = match &args.metric {
        Metric::Mask(args) => return mask::run(args),
        Metric::Truth(args) => return truth::run(args),
        Metric::Ape(absolute) => {
            (Measure::new(None, absolute.align, absolute.pose_relation), &absolute.files)
        }
        Metric::Rpe(relative) => {
            let motions = Some(relative.motions());
            (Measure::new(motions, relative.align, relative.pose_relation), &relative.files)
        }
    };
    let measure = measure.by_first_poses(files.n_to_align)?;
    let (truth, has_times) = truth::read(&files.truth, files.format)?;
    let compared =
        files.estimates.iter().map(|path| compare(&measure, files, &truth, has_times, path));
    let compared: Vec<Compared<'_>> = compared.collect::<anyhow::Result<_>>()?;
    files.report.write(|| page::page(&measure, &truth, &compared))?;
    let document = output::document(&measure, truth.len(), &compared);
    show(files.json, &document, || output::table(&measure, truth.len(), &compared))?;
    files.report.tell(files.json)
}

fn compare<'a>(
    measure: &Measure,
    files: &Files,
    truth: &Trajectory,
    truth_has_times: bool,
    path: &'a Path,
) -> anyhow::Result<Compared<'a>> {
    let (estimate, format) = read_trajectory(path, files.format)?;
    if truth_has_times != format.has_times() {
        let (truth, estimate) = (files.truth.display(), path.display());
        let without = if truth_has_times { &estimate } else { &truth };
        bail!(
            "{truth} and {estimate}: KITTI's poses have no times and cannot be matched with others; \
             `covis convert {without} OUT.txt --times FILE` adds times"
        );
    }
    let evaluate = || -> Result<_, EvaluationError> {
        let (most, alignment) = (files.max_time_difference, measure.alignment);
        let result = match &measure.motions {
            None => evaluation::ape_aligned(truth, &estimate, most, alignment),
            Some(Motions::Between(pairs)) => {
                evaluation::rpe_between(truth, &estimate, most, alignment, pairs)
            }
            Some(Motions::Over { delta_s }) => {
                evaluation::rpe_over_aligned(truth, &estimate, *delta_s, alignment)
            }
        }?;
        let first = result.statistics(measure.relation)?;
        Ok((result, first))
    };
    let (result, first) =
        evaluate().with_context(|| format!("{} and {}", files.truth.display(), path.display()))?;
    let left_out = result.errors.len() - first.count;
    if left_out > 0 {
        let (path, relation) = (path.display(), measure.relation.name());
        tracing::warn!("{path}: {left_out} pairs without a true motion are left out of {relation}");
    }
    Ok(Compared { path, estimate, result, first })
}
