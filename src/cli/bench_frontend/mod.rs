//! `covis bench-frontend`: the reference frontend on sequences whose truth is known, with and
//! without removal of what moves, as the paper's Table 1 has it.
//!
//! | file | role |
//! |---|---|
//! | this | runs each sequence twice, each time on a new map of a server in this process |
//! | `truth` | what is known of a sequence, and what a run's errors are against it |
//! | `table` | the report for people |
//! | `page` | the same as an HTML file, with the trajectories |
//!
//! A run never sees the truth, which is opened when both runs of a sequence have ended. A sequence
//! that cannot be run is reported and the next one follows.

mod page;
mod table;
mod truth;

use std::path::{Path, PathBuf};

use anyhow::Context;
use covis_solvers::io::trajectory::{Trajectory, TrajectoryFormat};
use fs_err as fs;
use serde::Serialize;

use super::config::Config;
use super::connect::Embedded;
use super::html::ReportFlag;
use super::output::{show, succeed_if};
use super::run::{Drawing, RunOptions, Source, report, sequence};
use crate::evaluation::{PaperRow, PoseError, paper_row};
use crate::frontend::mapping::run::RunReport;
use truth::Truth;

/// The share of the frames that a run must have tracked to count.
const LEAST_TRACKED_SHARE: f64 = 0.99;

/// Arguments of `covis bench-frontend`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// tum:FOLDER (TUM RGB-D or 7-Scenes layout), or synthetic:SCENE.
    #[arg(required = true, value_name = "SEQUENCE")]
    sequences: Vec<Source>,
    /// Folder for trajectories and masks; each run gets its own subfolder.
    #[arg(long, value_name = "FOLDER", default_value = "covis-bench-frontend")]
    out: PathBuf,
    /// Threads; a single one decodes and tracks frames in turn.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=64))]
    threads: u16,
    #[command(flatten)]
    drawing: Drawing,
    #[command(flatten)]
    report: ReportFlag,
    /// Print one JSON object instead of tables.
    #[arg(long)]
    json: bool,
}

/// The object of `--json`.
#[derive(Debug, Serialize)]
struct Document<'a> {
    sequences: &'a [Row],
}

/// One sequence. What is not known is null.
#[derive(Debug, Serialize)]
struct Row {
    source: String,
    name: String,
    /// Why there are no figures, or not all.
    error: Option<String>,
    with_mask: Option<RunFigures>,
    without_mask: Option<RunFigures>,
    /// By how much the mask reduces the drift; of runs that count.
    reduction_percent: Reduction,
    /// Mean over the frames whose truth covers at least 2 %.
    mask_iou: Option<f64>,
    /// The paper's row; null where a method failed.
    paper: Option<&'static PaperRow>,
    /// The truth and what each run is off by, for the page.
    #[serde(skip)]
    drawn: Vec<Drawn>,
}

/// A run's trajectory beside the truth.
#[derive(Debug)]
struct Drawn {
    run: &'static str,
    truth: Trajectory,
    errors: Vec<PoseError>,
}

#[derive(Clone, Copy, Debug, Default, Serialize)]
struct Reduction {
    translation: Option<f64>,
    rotation: Option<f64>,
}

/// One run.
#[derive(Clone, Copy, Debug, Serialize)]
struct RunFigures {
    frames: usize,
    skipped: usize,
    tracked: usize,
    lost: usize,
    /// Whether it counts: no frame is lost, and at least 99 % are in the trajectory.
    counts: bool,
    rpe_translation_m_per_s: Option<f64>,
    rpe_rotation_deg_per_s: Option<f64>,
    ate_m: Option<f64>,
    track: report::Quantiles,
}

impl RunFigures {
    fn of(run: &RunReport) -> Self {
        let (frames, tracked, lost) = (run.frames, run.live.len(), run.lost());
        let all = frames + run.skipped;
        Self {
            frames,
            skipped: run.skipped,
            tracked,
            lost,
            counts: lost == 0 && tracked as f64 >= LEAST_TRACKED_SHARE * all as f64,
            rpe_translation_m_per_s: None,
            rpe_rotation_deg_per_s: None,
            ate_m: None,
            track: report::track(run),
        }
    }
}

/// Runs all sequences, compares, prints. The exit code is 1 where one of them failed.
/// Fails for an output folder that cannot be written; what fails in a sequence is in its row.
pub(super) fn run(args: &Args, config: &Config) -> anyhow::Result<()> {
    fs::create_dir_all(&args.out)?;
    let runtime = tokio::runtime::Builder::new_multi_thread()
        .worker_threads(usize::from(args.threads))
        .enable_all()
        .build()
        .context("the async runtime")?;
    let mut sequences = Vec::new();
    for (index, source) in args.sequences.iter().enumerate() {
        let source = source.clone().with(args.drawing);
        let name = name(&source);
        tracing::info!("{name}");
        let mut row = Row {
            source: source.to_string(),
            error: None,
            with_mask: None,
            without_mask: None,
            reduction_percent: Reduction::default(),
            mask_iou: None,
            paper: paper_row(&name).filter(|_| matches!(source, Source::Folder(_))),
            name,
            drawn: Vec::new(),
        };
        // Two folders may have one name.
        let out = args.out.join(format!("{}-{}", index + 1, row.name));
        let threads = usize::from(args.threads);
        if let Err(error) = runtime.block_on(measure(&source, &out, threads, config, &mut row)) {
            let error = format!("{error:#}").replace('\n', " ");
            tracing::error!("{}: {error}", row.source);
            row.error = Some(error);
        }
        sequences.push(row);
    }
    let is_whole = sequences.iter().all(|row| row.error.is_none());
    args.report.write(|| page::page(&sequences))?;
    show(args.json, &Document { sequences: &sequences }, || table::text(&sequences))?;
    args.report.tell(args.json)?;
    succeed_if(is_whole)
}

/// Both runs of a sequence, then their errors.
async fn measure(
    source: &Source,
    out: &Path,
    threads: usize,
    config: &Config,
    row: &mut Row,
) -> anyhow::Result<()> {
    let masks = out.join("with_mask").join("masks");
    if masks.exists() {
        // Those of an earlier run, which may have had other frames.
        fs::remove_dir_all(&masks)?;
    }
    let with_mask = once(source, &out.join("with_mask"), Some(masks.clone()), threads, config)
        .await
        .context("with the mask")?;
    row.with_mask = Some(RunFigures::of(&with_mask));
    let without_mask = once(source, &out.join("without_mask"), None, threads, config)
        .await
        .context("without the mask")?;
    row.without_mask = Some(RunFigures::of(&without_mask));

    let truth = Truth::open(source, &out.join("truth"))?;
    let runs = [
        ("with the mask", &mut row.with_mask, &with_mask),
        ("without the mask", &mut row.without_mask, &without_mask),
    ];
    for (name, figures, run) in runs {
        if let Some(figures) = figures
            && let Some((truth, errors)) = truth.compare(run, figures)
        {
            row.drawn.push(Drawn { run: name, truth, errors });
        }
    }
    row.mask_iou = truth.mask_iou(&masks)?;
    row.reduction_percent = Reduction {
        translation: reduction(row, |run| run.rpe_translation_m_per_s),
        rotation: reduction(row, |run| run.rpe_rotation_deg_per_s),
    };
    Ok(())
}

/// One run through a server of its own. Masks are saved where the mask is on.
async fn once(
    source: &Source,
    out: &Path,
    saved_masks: Option<PathBuf>,
    threads: usize,
    config: &Config,
) -> anyhow::Result<RunReport> {
    fs::create_dir_all(out)?;
    let removes_motion = saved_masks.is_some();
    let options = RunOptions {
        removes_motion,
        saved_masks,
        lock_step: true,
        threads,
        ..RunOptions::default()
    };
    let server = Embedded::start(config).await?;
    let run = sequence(source, &options, &server.client, "bench").await.map(|(report, _)| report);
    server.stop().await;
    let run = run?;
    report::write(&run, out, TrajectoryFormat::Tum)?;
    Ok(run)
}

/// By how much the mask makes a figure smaller, where both runs count.
fn reduction(row: &Row, figure: fn(&RunFigures) -> Option<f64>) -> Option<f64> {
    let of = |run: &Option<RunFigures>| run.as_ref().filter(|run| run.counts).and_then(figure);
    let (with, without) = (of(&row.with_mask)?, of(&row.without_mask)?);
    (without > 0.0).then(|| 100.0 * (1.0 - with / without))
}

/// The folder's or the scene's name.
fn name(source: &Source) -> String {
    match source {
        Source::Folder(folder) | Source::Recording(_, folder) | Source::Capture(folder) => {
            // `.` has a name as well.
            let whole = fs::canonicalize(folder).unwrap_or_else(|_| folder.clone());
            let name = whole.file_name().map(|name| name.to_string_lossy().into_owned());
            name.unwrap_or_else(|| "sequence".to_owned())
        }
        Source::Synthetic(scene, ..) => scene.to_string(),
    }
}
