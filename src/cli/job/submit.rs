//! `covis job submit`: from the arguments to a job, and to its end where it is waited for. It reads
//! files and uploads them; the server opens no path of a client's.

use std::hash::{BuildHasher, RandomState};
use std::path::PathBuf;
use std::time::Duration;

use anyhow::{Context, bail};
use clap::ValueEnum;

use super::super::choices::number;
use super::super::map::{MapFormat, write_files};
use super::super::output::{show, succeed_if};
use super::super::overwrite::Overwrite;
use super::super::progress::Working;
use super::document::{Document, details, line};
use super::{REPORT, described, files, to_end};
use crate::client::Client;
use crate::wire::v1;
use v1::JobState;
use v1::job_spec::Spec;

/// Arguments of `covis job submit`.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// What to do.
    kind: Kind,
    /// The map that the job works on.
    #[arg(long, value_name = "NAME", conflicts_with = "file")]
    map: Option<String>,
    /// A problem to solve instead of a map: a BAL or g2o file, a folder with a COLMAP sparse model, or
    /// a folder of such problems. It is sent to the server.
    #[arg(long, value_name = "PATH")]
    file: Option<PathBuf>,
    /// The job's name. If you repeat the command with the same name and arguments, and without files, it
    /// returns the existing job [default: a new name].
    #[arg(long, value_name = "NAME")]
    id: Option<String>,
    /// Waiting jobs with a higher priority start first, -100 to 100.
    #[arg(long, value_name = "N", default_value_t = 0, allow_negative_numbers = true)]
    priority: i32,
    /// Wait for the job's end; the exit code is 1 if it does not succeed.
    #[arg(long)]
    wait: bool,
    /// Wait, and write the files that the job makes: solved problems, an export. One file goes to this
    /// path, several into this folder.
    #[arg(long, value_name = "PATH")]
    out: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
    /// optimize-map, optimize-pose-graph on a map: maximum number of iterations [default: until it
    /// converges].
    #[arg(long, value_name = "N")]
    max_iterations: Option<i32>,
    /// optimize-map, optimize-pose-graph on a map: stop after this time with the best state so far
    /// [default: when it converges].
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    time_limit: Option<Duration>,
    /// optimize-map on a map: optimize the cameras' intrinsics too; with files this is always on.
    #[arg(long)]
    refine_intrinsics: bool,
    /// compact: retire a keyframe if three others see this share of its landmarks.
    #[arg(long, value_name = "SHARE")]
    redundant_share: Option<f64>,
    /// compact: keep the journal before the snapshot.
    #[arg(long)]
    keep_journal: bool,
    /// evaluate: the ground truth as a TUM trajectory.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// evaluate: the client whose keyframes are compared [default: the map's only one].
    #[arg(long, value_name = "NAME")]
    client: Option<String>,
    /// evaluate: timestamps match within this many seconds [default: 0.01].
    #[arg(long, value_name = "SECONDS")]
    max_time_difference: Option<f64>,
    /// export: what to write.
    #[arg(long)]
    format: Option<MapFormat>,
    /// export to COLMAP: also the points that fewer than two keyframes observe.
    #[arg(long)]
    all_points: bool,
}

/// What a job does.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Kind {
    /// Global bundle adjustment of a map, or of a BAL file or COLMAP folder.
    OptimizeMap,
    /// Pose-graph optimization of a map, or of a g2o file.
    OptimizePoseGraph,
    /// Make a map smaller: drop the journal behind a snapshot, retire redundant keyframes.
    Compact,
    /// Compare a trajectory of a map with the ground truth: APE and RPE.
    Evaluate,
    /// Write a map to files.
    Export,
    /// Solve problem files of any kind.
    Solve,
    /// Reconstruct the poses and points of a map, or of a BAL file or COLMAP folder, from the observations
    /// alone.
    Rebuild,
}

impl Kind {
    /// As on the command line.
    fn name(self) -> String {
        self.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default()
    }
}

/// Creates the job, waits for it if that is asked for, and prints it.
pub(super) async fn submit(client: &Client, args: Args, json: bool) -> anyhow::Result<()> {
    let spec = Some(v1::JobSpec { spec: Some(spec(client, &args).await?) });
    let random = || format!("{}-{:08x}", args.kind.name(), RandomState::new().hash_one(0u8) >> 32);
    let job_id = args.id.clone().unwrap_or_else(random);
    let request = v1::CreateJobRequest { job_id, spec, priority: args.priority };
    let mut job = client.create_job(request).await?;
    let waits = args.wait || args.out.is_some();
    if waits {
        let working = Working::new(format_args!("job {}", job.job_id));
        job = to_end(client, &job.job_id, |job| {
            working.tell(line(&Document::from(job.clone())));
            tracing::debug!(state = job.state().as_str_name(), progress = ?job.progress, "job");
            Ok(())
        })
        .await?;
    }
    let has_succeeded = job.state() == JobState::Succeeded;
    if let (Some(out), true) = (&args.out, has_succeeded) {
        let mut download = client.download_job_files(&job.job_id, None).await?;
        let all = download.files().iter().map(|file| file.path.clone());
        let paths: Vec<String> = all.filter(|path| path != REPORT).collect();
        // The report is printed, not written.
        let next = async || loop {
            match download.next().await? {
                Some(chunk) if chunk.path == REPORT => {}
                chunk => break Ok(chunk),
            }
        };
        let files = write_files(&paths, next, out, args.overwrite).await?;
        if let Some(format) = args.format {
            format.finish(files)?;
        }
    }
    let document = described(client, job).await?;
    show(json, &document, || details(&document))?;
    succeed_if(has_succeeded || !waits)
}

/// The spec that the arguments describe; files are sent first.
async fn spec(client: &Client, args: &Args) -> anyhow::Result<Spec> {
    let map = || args.map.clone().with_context(|| format!("{} needs --map", args.kind.name()));
    if let Some(path) = &args.file {
        let kind = match args.kind {
            Kind::OptimizeMap => v1::ProblemFileKind::Bundle,
            Kind::OptimizePoseGraph => v1::ProblemFileKind::PoseGraph,
            // What the files are is told by their names; a reconstruction takes bundles only.
            Kind::Solve | Kind::Rebuild => v1::ProblemFileKind::Unspecified,
            Kind::Compact | Kind::Evaluate | Kind::Export => {
                bail!("{} works on a map, not on files: --map names it", args.kind.name())
            }
        };
        let upload_id = files::upload(client, files::find(path)?).await?;
        let keep_solutions = args.out.is_some();
        if args.kind == Kind::Rebuild {
            let map_id = String::new();
            let spec = v1::ReconstructSpec { map_id, upload_id, keep_solutions };
            return Ok(Spec::Reconstruct(spec));
        }
        let spec = v1::SolveFilesSpec { upload_id, kind: kind.into(), keep_solutions };
        return Ok(Spec::SolveFiles(spec));
    }
    Ok(match args.kind {
        Kind::OptimizeMap => Spec::OptimizeMap(optimization(map()?, v1::MapProblem::Full, args)),
        Kind::OptimizePoseGraph => {
            Spec::OptimizeMap(optimization(map()?, v1::MapProblem::PoseGraph, args))
        }
        Kind::Compact => Spec::CompactMap(v1::CompactMapSpec {
            map_id: map()?,
            redundant_share: args.redundant_share,
            drop_old_journal: !args.keep_journal,
        }),
        Kind::Evaluate => Spec::EvaluateTrajectory(evaluation(client, map()?, args).await?),
        Kind::Export => {
            let format = args.format.context("export needs --format")?;
            let format = v1::MapFormat::from(format).into();
            Spec::ExportMap(v1::ExportMapRequest {
                map_id: map()?,
                format,
                all_landmarks: args.all_points,
            })
        }
        Kind::Rebuild => {
            Spec::Reconstruct(v1::ReconstructSpec { map_id: map()?, ..Default::default() })
        }
        Kind::Solve => bail!("solve needs --file"),
    })
}

fn optimization(map_id: String, problem: v1::MapProblem, args: &Args) -> v1::OptimizeMapRequest {
    let limit = |time: Duration| i64::try_from(time.as_millis()).unwrap_or(i64::MAX).max(1);
    let options = v1::SolverOptions {
        max_iteration_count: args.max_iterations,
        deadline_ms: args.time_limit.map(limit),
        ..v1::SolverOptions::default()
    };
    let options = (options != v1::SolverOptions::default()).then_some(options);
    v1::OptimizeMapRequest {
        map_id,
        options,
        problem: problem.into(),
        refine_intrinsics: args.refine_intrinsics,
        ..v1::OptimizeMapRequest::default()
    }
}

/// A time above 0.
fn seconds(text: &str) -> Result<Duration, String> {
    let positive = number(text, "it must be a number of seconds above 0", |&s: &f64| s > 0.0)?;
    Duration::try_from_secs_f64(positive).map_err(|error| error.to_string())
}

async fn evaluation(
    client: &Client,
    map_id: String,
    args: &Args,
) -> anyhow::Result<v1::EvaluateTrajectorySpec> {
    let truth = args.truth.as_ref().context("evaluate needs --truth")?;
    let client_id = match &args.client {
        Some(name) => name.clone(),
        None => {
            let map = client.get_map(&map_id).await?;
            match &map.clients[..] {
                [only] => only.client_id.clone(),
                clients => bail!("map {map_id} has {} clients: --client names one", clients.len()),
            }
        }
    };
    let truth_upload_id = files::upload(client, files::find(truth)?).await?;
    Ok(v1::EvaluateTrajectorySpec {
        map_id,
        client_id,
        max_time_difference_s: args.max_time_difference,
        truth_upload_id,
        ..v1::EvaluateTrajectorySpec::default()
    })
}
