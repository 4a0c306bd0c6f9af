//! The work of jobs on maps. Each kind does what its RPC does, without a caller that waits.
//!
//! Whatever changes a map asks [`Cancellation`](crate::service::engine::Cancellation) before it does:
//! a job that is canceled leaves the map as it was.

use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

use covis_solvers::geometry::Se3;
use covis_solvers::io::reading::{Content, FileCounts};
use covis_solvers::io::trajectory::{Trajectory, TrajectoryFormat, seconds_of_nanoseconds};
use covis_solvers::optimizer;
use serde_json::{Value, json};
use tokio::sync::mpsc;

use super::entry::files_bytes;
use super::moved::Positions;
use super::progress::{StagesLeft, TimeLeft};
use super::reading::admit;
use super::run::{Made, Run, add_file, next_output, pause};
use super::uploads::FILE_BYTES;
use super::{reading, report};
use crate::evaluation::{EvaluationError, ape, rpe};
use crate::map::{ClientIndex, LastRequest, Map, Reason};
use crate::service::access::change;
use crate::service::context::{Context, Rpcs};
use crate::service::convert::map::to_counts;
use crate::service::convert::solve::{
    to_certificate, to_iteration, to_iterations, to_reconstruction,
};
use crate::service::convert::{Path as FieldPath, convert, count, merge as merging, trajectory};
use crate::service::engine::{
    Compacted, EngineError, Estimate, MapHandle, OptimizeOptions, OptimizeOutcome, OptimizeProblem,
    Resource, SolveStep,
};
use crate::service::error::ServiceError;
use crate::service::export::{Export, Format, GraphLines, choice};
use crate::service::job_error::JobError;
use crate::service::optimization_service::{map_options, to_result};
use crate::store::JobFile;
use crate::wire::v1;
use v1::job_result::Result as Kind;

/// Largest difference of times that are matched, s.
const TIME_DIFFERENCE_S: f64 = 0.01;
/// Bytes of a pose that is compared, beside the truth: the pose, its pair, and its errors in both lists.
const MATCHED_BYTES: u64 = 1024;

impl Run<'_> {
    fn map(&self, map_id: &str) -> Result<MapHandle, ServiceError> {
        Ok(self.jobs.context.maps.get(&self.caller.engine_name(map_id))?)
    }
}

/// What a solve of a map came to.
enum SolvedMap {
    Now(Box<OptimizeOutcome>),
    /// An earlier attempt applied it, and the server ended before its result was written down.
    Before(LastRequest),
}

/// Iterations of the solve of a whole map that says no number: as many as one may ask for. A tolerance or
/// the job's time ends it.
const UNTIL_CONVERGED: usize = 10_000;

/// What is said where the certificate of a solve is lost.
const LOST: &str = "applied before the server ended; of its certificate only the costs are kept";

/// What a solve made that an earlier attempt applied; `result` makes its result of the map's revision and
/// the certificate.
fn lost(
    map_id: &str,
    applied: &LastRequest,
    result: impl FnOnce(i64, Option<v1::SolveSummary>) -> Kind,
) -> Made {
    let LastRequest { revision, initial_cost, final_cost, .. } = *applied;
    let description = LOST.to_owned();
    let summary = v1::SolveSummary { initial_cost, final_cost, description, ..Default::default() };
    let report = json!({
        "map": map_id,
        "revision": revision,
        "initial_cost": initial_cost,
        "final_cost": final_cost,
        "note": LOST,
    });
    let costs = Some((initial_cost, final_cost));
    Made { costs, ..Made::new(result(revision, Some(summary)), report) }
}

/// Solves a map as soon as no call does, once for each job; `on_step` sees its steps.
async fn solved(
    run: &Run<'_>,
    map_id: &str,
    options: OptimizeOptions,
    phase: &str,
    mut on_step: impl FnMut(SolveStep),
) -> Result<SolvedMap, ServiceError> {
    let request = run.entry.uid;
    loop {
        let map = run.map(map_id)?;
        let last = map.snapshot().await?.last_request().copied();
        if let Some(applied) = last.filter(|last| last.id == request) {
            return Ok(SolvedMap::Before(applied));
        }
        run.phase(phase);
        let (progress, mut steps) = mpsc::unbounded_channel();
        let telling = async {
            while let Some(step) = steps.recv().await {
                on_step(step);
            }
        };
        let cancellation = Arc::clone(&run.entry.cancellation);
        let solving = map.optimize_unless(cancellation, request, options, progress);
        match tokio::join!(solving, telling).0 {
            // By a call, which ends by itself.
            Err(EngineError::OptimizationRunning { .. }) => {
                run.phase("waits for another optimization of the map");
                pause().await;
            }
            outcome => {
                let outcome = outcome?;
                if run.jobs.context.config.holds("hold-applied") {
                    run.phase("held by a test");
                    std::future::pending::<()>().await;
                }
                return Ok(SolvedMap::Now(Box::new(outcome)));
            }
        }
    }
}

/// Adds where keyframes were and are. A map that is gone by now does not make a job fail that was applied.
async fn add_moved(run: &Run<'_>, map_id: &str, before: Positions, report: &mut Value) {
    if let Ok(map) = run.map(map_id)
        && let Ok(now) = map.snapshot().await
    {
        before.add_to_report(&now, report);
    }
}

/// `OptimizeMap`.
pub(super) async fn optimize(
    run: &Run<'_>,
    request: &v1::OptimizeMapRequest,
) -> Result<Made, ServiceError> {
    let threads = run.jobs.context.maps.pool().threads();
    let (map_id, mut options) = map_options(request, threads, None)?;
    // Nobody waits for a job, so that it goes on until it converges.
    let asked = request.options.as_ref().and_then(|options| options.max_iteration_count);
    if asked.is_none() {
        options.optimizer.max_iterations = UNTIL_CONVERGED;
    }
    let mut rows = Vec::new();
    let mut left = TimeLeft::new(asked.map(|_| options.optimizer.max_iterations));
    let on_step = |step| {
        let SolveStep::Iteration(row) = step else { return };
        let time_left_s = left.after(&row);
        let row = to_iteration(&row);
        rows.push(row);
        run.tell(|progress| {
            progress.iteration = Some(row);
            progress.time_left_s = time_left_s;
        });
    };
    let before = Positions::of(&*run.map(&map_id)?.snapshot().await?);
    let outcome = match solved(run, &map_id, options, "optimizes the map", on_step).await? {
        SolvedMap::Now(outcome) => outcome,
        SolvedMap::Before(applied) => {
            return Ok(lost(&map_id, &applied, |revision, summary| {
                Kind::OptimizeMap(v1::OptimizeMapResult { revision, summary, ..Default::default() })
            }));
        }
    };
    let result = to_result(&outcome);
    let costs = result.summary.as_ref().map(|summary| (summary.initial_cost, summary.final_cost));
    let mut report = json!({
        "map": map_id,
        "revision": result.revision,
        "cameras": result.camera_count,
        "keyframes": result.keyframe_count,
        "landmarks": result.landmark_count,
        "observations": result.observation_count,
        "constraints": result.constraint_count,
        "switched_off_constraints": result.switched_off_constraint_count,
    });
    report::join(&mut report, report::solve(result.summary.as_ref(), &rows));
    add_moved(run, &map_id, before, &mut report).await;
    Ok(Made { costs, ..Made::new(Kind::OptimizeMap(result), report) })
}

/// Poses and landmarks anew, from observations alone.
pub(super) async fn rebuild(run: &Run<'_>, map_id: &str) -> Result<Made, ServiceError> {
    let optimizer =
        optimizer::Options { max_iterations: UNTIL_CONVERGED, ..optimizer::Options::default() };
    let problem = OptimizeProblem::Rebuild;
    let options = OptimizeOptions { optimizer, problem, ..OptimizeOptions::default() };
    let mut stages = StagesLeft::default();
    let on_step = |step| {
        if let SolveStep::Reconstruction(step) = step {
            run.tell(|progress| stages.show(&step, "rebuilds the map", progress));
        }
    };
    let before = Positions::of(&*run.map(map_id)?.snapshot().await?);
    let outcome = match solved(run, map_id, options, "rebuilds the map", on_step).await? {
        SolvedMap::Now(outcome) => outcome,
        SolvedMap::Before(applied) => {
            return Ok(lost(map_id, &applied, |revision, summary| {
                Kind::Reconstruct(v1::ReconstructResult { revision, summary, ..Default::default() })
            }));
        }
    };
    let summary = to_certificate(&outcome.certificate);
    let costs = Some((summary.initial_cost, summary.final_cost));
    let mut report = json!({ "map": map_id, "revision": outcome.revision });
    report::join(&mut report, report::reconstruction(outcome.rebuilt.as_ref()));
    let rows = to_iterations(&outcome.certificate.solve, true);
    report::join(&mut report, report::solve(Some(&summary), &rows));
    add_moved(run, map_id, before, &mut report).await;
    let result = Kind::Reconstruct(v1::ReconstructResult {
        revision: outcome.revision,
        summary: Some(summary),
        reconstruction: outcome.rebuilt.as_ref().map(to_reconstruction),
        problems: Vec::new(),
    });
    Ok(Made { costs, ..Made::new(result, report) })
}

/// `MergeMaps`.
pub(super) async fn merge(
    run: &Run<'_>,
    request: &v1::MergeMapsRequest,
) -> Result<Made, ServiceError> {
    let (context, cancellation) = (&run.jobs.context, &run.entry.cancellation);
    let map_id = request.source_map_id.clone();
    let asked = convert(|out| merging::merge(request.clone(), &run.caller, out))?;
    run.phase("merges the maps");
    // A merge that has begun is finished.
    if !cancellation.commit() {
        return Err(EngineError::Cancelled { map: map_id }.into());
    }
    let merged = context.maps.merge(asked, cancellation.interrupt()).await;
    let merged = merged.map_err(ServiceError::from);
    change("MergeMaps", &run.caller, None, &map_id, &merged);
    let merged = merged?;
    let response = merging::to_response(&merged, context.map_message(merged.map.clone()).await?);
    let report = json!({
        "source": map_id,
        "target": request.target_map_id,
        "revision": merged.map.snapshot.revision(),
        "closures": merged.closures,
        "scale": merged.target_from_source.scale,
    });
    Ok(Made::new(Kind::MergeMaps(response), report))
}

/// Makes a map smaller.
pub(super) async fn compact(
    run: &Run<'_>,
    spec: &v1::CompactMapSpec,
) -> Result<Made, ServiceError> {
    let map = run.map(&spec.map_id)?;
    run.phase("compacts the map");
    let tell = |looked: usize, all: usize| {
        run.tell(|progress| progress.share = Some(looked as f64 / all.max(1) as f64));
    };
    let (share, drop_journal) = (spec.redundant_share, spec.drop_old_journal);
    let compacted = map.compact(share, drop_journal, &run.entry.cancellation, tell).await?;
    let Compacted { before, after, retired } = compacted;
    let report = json!({
        "map": spec.map_id,
        "revision": after.revision(),
        "retired_keyframes": retired,
        "keyframes_before": before.keyframes().len(),
        "keyframes_after": after.keyframes().len(),
        "landmarks_before": before.landmarks().len(),
        "landmarks_after": after.landmarks().len(),
        "size_bytes_before": before.usage().bytes,
        "size_bytes_after": after.usage().bytes,
        "journal_dropped": drop_journal,
    });
    let counts = Context::blocking(move || Ok((to_counts(&before), to_counts(&after))));
    let (counts_before, counts_after) = counts.await?;
    let result = v1::CompactMapResult {
        counts_before: Some(counts_before),
        counts_after: Some(counts_after),
        retired_keyframe_count: count(retired),
    };
    Ok(Made::new(Kind::CompactMap(result), report))
}

/// Compares a trajectory with the truth.
pub(super) async fn evaluate(
    run: &Run<'_>,
    spec: &v1::EvaluateTrajectorySpec,
) -> Result<Made, ServiceError> {
    let map = run.map(&spec.map_id)?.snapshot().await?;
    let client = map.client_named(&spec.client_id).ok_or_else(|| {
        let (map, client) = (spec.map_id.clone(), spec.client_id.clone());
        ServiceError::ClientNotFound { map, client }
    })?;
    run.phase("compares the trajectories");
    let at = FieldPath::root("truth");
    let given = convert(|out| trajectory::poses(at, &spec.truth, out))?;
    let upload = run.entry.upload.clone();
    let (jobs, uid) = (run.jobs, run.entry.uid);
    let counts = match &upload {
        None => FileCounts::default(),
        Some(_) => reading::count(&jobs.files, uid, vec![0]).await?,
    };
    let most = spec.max_time_difference_s.unwrap_or(TIME_DIFFERENCE_S);
    let matched = (map.trajectory(client).len() as u64).saturating_mul(MATCHED_BYTES);
    let bytes = counts.price(Content::Trajectory).reading.saturating_add(matched);
    let ceiling = jobs.context.config.engine.ceiling();
    let price = admit("spec.evaluate_trajectory", bytes, &ceiling)?;
    let files = Arc::clone(&jobs.files);
    let compare = move || {
        let truth = match upload.as_ref().and_then(|upload| upload.files.first()) {
            None => of_poses(given.iter().map(|(time, pose)| (*time, pose))),
            Some((path, _)) => {
                let bytes = files.bytes(&uid, JobFile::Input(0)).map_err(JobError::from)?;
                let format = TrajectoryFormat::Tum;
                let parsed = Trajectory::parse_poses_as(&bytes, Path::new(path), format);
                parsed.map_err(|error| JobError::BadFile { text: error.to_string() })?
            }
        };
        let estimate = of_client(&map, client);
        let unlike =
            |e: EvaluationError| ServiceError::field("truth", Reason::Inconsistent, e.to_string());
        let ape = ape(&truth, &estimate, most).map_err(unlike)?;
        let rpe = rpe(&truth, &estimate, most).map_err(unlike)?;
        Ok::<_, ServiceError>((truth.len(), estimate.len(), map.revision(), ape, rpe))
    };
    let pool = jobs.context.maps.pool();
    let account = jobs.account(&run.entry.key.0);
    let compared = pool.run(&account, Estimate::new(price, 1, &ceiling), compare);
    let (truth, estimate, revision, ape, rpe) = compared.await??;
    let statistics = |evaluation: &crate::evaluation::Evaluation| {
        json!({
            "translation_m": evaluation.translation_m,
            "angle_deg": evaluation.angle_deg,
            "rotation_part": evaluation.rotation_part,
        })
    };
    let report = json!({
        "map": spec.map_id,
        "client": spec.client_id,
        "revision": revision,
        "truth_poses": truth,
        "estimate_poses": estimate,
        "pairs": ape.pairs,
        "ape": statistics(&ape),
        "rpe": statistics(&rpe),
    });
    let result = v1::EvaluateTrajectoryResult {
        matched_pose_count: count(ape.pairs),
        absolute_translation_rmse_m: ape.translation_m.rmse,
        relative_translation_rmse_m: rpe.translation_m.rmse,
        relative_rotation_rmse_rad: rpe.angle_deg.rmse.to_radians(),
    };
    Ok(Made::new(Kind::EvaluateTrajectory(result), report))
}

/// The poses of a client by time.
fn of_client(map: &Map, client: ClientIndex) -> Trajectory {
    let keyframes = map.trajectory(client);
    of_poses(keyframes.iter().map(|(_, k)| (k.capture_time_ns, &k.world_from_camera)))
}

fn of_poses<'a>(poses: impl Iterator<Item = (i64, &'a Se3)>) -> Trajectory {
    let mut trajectory = Trajectory::default();
    poses.for_each(|(time_ns, pose)| trajectory.push(seconds_of_nanoseconds(time_ns), *pose));
    trajectory
}

/// `ExportMap`, into files of the job.
pub(super) async fn export(
    run: &Run<'_>,
    request: &v1::ExportMapRequest,
) -> Result<Made, ServiceError> {
    let choice = choice(request)?;
    let map = run.map(&request.map_id)?;
    let reservation = map.account().reserve(Resource::Exports, 1)?;
    run.phase("exports the map");
    let snapshot = map.snapshot().await?;
    let mut export = {
        let (map_id, snapshot) = (request.map_id.clone(), Arc::clone(&snapshot));
        Context::blocking(move || Export::new(map_id, snapshot, choice)).await?
    };
    if choice.format == Format::G2o {
        let rpcs = Rpcs { context: Arc::clone(&run.jobs.context) };
        let lines: GraphLines = rpcs.graph_lines(&map, snapshot).await?;
        export = export.with_graph(lines);
    }
    let (revision, paths) = (export.revision(), export.paths());
    let all = paths.len().max(1);
    let mut sizes = HashMap::new();
    // Files of an attempt that a restart cut off are written again.
    forget_files(run).await?;
    for (done, path) in paths.iter().enumerate() {
        let (files, uid) = (Arc::clone(&run.jobs.files), run.entry.uid);
        let file = next_output(&run.entry.files());
        let (entry, cancellation) = (Arc::clone(run.entry), Arc::clone(&run.entry.cancellation));
        run.reserve(FILE_BYTES)?;
        let written = Context::blocking(move || {
            let (mut size, mut grown, mut refused) = (0_u64, 0_u64, None);
            let written = files.write(&uid, file, |out| {
                loop {
                    let made = match export.next_chunk() {
                        Ok(Some(chunk)) if !cancellation.is_canceled() => chunk,
                        Ok(_) => return Err(std::io::ErrorKind::Interrupted.into()),
                        Err(error) => {
                            refused = Some(error);
                            return Err(std::io::ErrorKind::InvalidData.into());
                        }
                    };
                    let length = made.data.len() as u64;
                    if let Err(error) = entry.grow(length) {
                        refused = Some(error.into());
                        return Err(std::io::ErrorKind::QuotaExceeded.into());
                    }
                    grown += length;
                    out.write_all(&made.data)?;
                    size += length;
                    if made.last_chunk {
                        return Ok(());
                    }
                }
            });
            let error = match (refused, written) {
                (None, Ok(_)) => return Ok((size, export)),
                (Some(error), _) => error,
                (None, Err(error)) => JobError::from(error).into(),
            };
            // It may be tried again.
            entry.shrink(FILE_BYTES + grown);
            Err(error)
        });
        let size;
        (size, export) = written.await?;
        sizes.insert(path.clone(), size);
        let size_bytes = i64::try_from(size).unwrap_or(i64::MAX);
        run.change(|job, _| add_file(&mut job.files, path.clone(), size_bytes)).await?;
        run.tell(|progress| progress.share = Some((done + 1) as f64 / all as f64));
    }
    drop(reservation);
    let files: Vec<_> = paths
        .iter()
        .map(|path| json!({ "path": path, "size_bytes": sizes.get(path).copied().unwrap_or(0) }))
        .collect();
    let report = json!({ "map": request.map_id, "revision": revision, "files": files });
    Ok(Made::new(Kind::ExportMap(v1::ExportMapResult { revision }), report))
}

/// Takes the files of an earlier attempt out of the record.
async fn forget_files(run: &Run<'_>) -> Result<(), ServiceError> {
    let files = run.entry.files();
    // The report is the first file, which is written after them.
    let Some((_report, made)) = files.split_first() else { return Ok(()) };
    run.change(|job, _| job.files.clear()).await?;
    run.entry.shrink(files_bytes(made));
    Ok(())
}
