//! What a spec asks for: which role it takes, which maps it reads and changes, which upload.
//!
//! What can be refused when a job is created is refused then: bad fields, maps and clients that are not
//! there, maps that take no changes. Field paths begin at the request.

use super::Jobs;
use crate::map::Reason;
use crate::service::access::{Caller, Role};
use crate::service::context::Context;
use crate::service::convert::{Path, Violations, convert, ids, merge, trajectory};
use crate::service::engine::{EngineError, MapState};
use crate::service::error::ServiceError;
use crate::service::{export, optimization_service};
use crate::wire::v1;
use v1::job_spec::Spec;

/// Most poses of the truth in a spec: a spec stays in memory until its job has ended.
const MAX_TRUTH: usize = 10_000;
/// Least poses of the truth.
const LEAST_TRUTH: usize = 3;
/// The range of priorities.
const PRIORITIES: std::ops::RangeInclusive<i64> = -100..=100;

/// What a request asks for.
pub(super) struct Asked {
    /// The role that it takes.
    pub(super) role: Role,
    /// The upload that it takes.
    pub(super) upload: Option<String>,
}

/// The kinds of jobs that are run, by the names of [`kind`].
pub(super) const KINDS: [&str; 8] = [
    "optimize-map",
    "optimize-pose-graph",
    "merge",
    "compact",
    "evaluate",
    "export",
    "solve",
    "rebuild",
];

/// The name of a spec's kind: on the command line, in metrics and in the log.
pub(crate) fn kind(spec: &v1::JobSpec) -> &'static str {
    match &spec.spec {
        Some(Spec::OptimizeMap(request)) => match request.problem() {
            v1::MapProblem::PoseGraph => "optimize-pose-graph",
            v1::MapProblem::Full | v1::MapProblem::Unspecified => "optimize-map",
        },
        Some(Spec::MergeMaps(_)) => "merge",
        Some(Spec::RebuildMap(_)) => "rebuild-map",
        Some(Spec::CompactMap(_)) => "compact",
        Some(Spec::EvaluateTrajectory(_)) => "evaluate",
        Some(Spec::ExportMap(_)) => "export",
        Some(Spec::SolveFiles(_)) => "solve",
        Some(Spec::Reconstruct(_)) => "rebuild",
        None => "unknown",
    }
}

/// The maps of a spec, as its tenant calls them.
pub(crate) fn maps_of(spec: &v1::JobSpec) -> Vec<&str> {
    match &spec.spec {
        Some(Spec::OptimizeMap(request)) => vec![&request.map_id],
        Some(Spec::MergeMaps(request)) => vec![&request.source_map_id, &request.target_map_id],
        Some(Spec::RebuildMap(spec)) => vec![&spec.source_map_id, &spec.target_map_id],
        Some(Spec::CompactMap(spec)) => vec![&spec.map_id],
        Some(Spec::EvaluateTrajectory(spec)) => vec![&spec.map_id],
        Some(Spec::ExportMap(request)) => vec![&request.map_id],
        Some(Spec::Reconstruct(spec)) if !spec.map_id.is_empty() => vec![&spec.map_id],
        Some(Spec::Reconstruct(_) | Spec::SolveFiles(_)) | None => Vec::new(),
    }
}

/// Whether a job with this spec changes its maps.
fn changes(spec: &Spec) -> bool {
    match spec {
        Spec::OptimizeMap(_)
        | Spec::MergeMaps(_)
        | Spec::RebuildMap(_)
        | Spec::CompactMap(_)
        | Spec::Reconstruct(_) => true,
        Spec::EvaluateTrajectory(_) | Spec::ExportMap(_) | Spec::SolveFiles(_) => false,
    }
}

/// Checks the fields of a request.
///
/// # Errors
/// INVALID_ARGUMENT and UNIMPLEMENTED.
pub(super) fn read(
    request: &v1::CreateJobRequest,
    context: &Context,
) -> Result<Asked, ServiceError> {
    convert(|out| {
        let name = ids::name(Path::root("job_id"), &request.job_id, out);
        let priority = i64::from(request.priority);
        if !PRIORITIES.contains(&priority) {
            let text = format!("{priority} is not in -100 to 100");
            let _: Option<()> = out.report(Path::root("priority"), Reason::OutOfRange, text);
        }
        let spec = request.spec.as_ref().and_then(|spec| spec.spec.as_ref());
        out.required(Path::root("spec"), spec)?;
        name
    })?;
    let Some(spec) = request.spec.as_ref().and_then(|spec| spec.spec.as_ref()) else {
        return Err(ServiceError::field("spec", Reason::Missing, "required"));
    };
    let at = Path::root("spec");
    match spec {
        Spec::OptimizeMap(request) => {
            let threads = context.maps.pool().threads();
            optimization_service::map_options(request, threads, None)
                .map_err(|error| within("spec.optimize_map", error))?;
            Ok(Asked { role: Role::Write, upload: None })
        }
        Spec::MergeMaps(request) => {
            let caller = Caller::of_tenant("");
            convert(|out| merge::merge(request.clone(), &caller, out))
                .map_err(|error| within("spec.merge_maps", error.into()))?;
            Ok(Asked { role: Role::Admin, upload: None })
        }
        Spec::RebuildMap(_) => {
            convert(|out| out.unimplemented::<()>(at.field("rebuild_map")))?;
            Err(ServiceError::Unserved { what: "spec.rebuild_map" })
        }
        Spec::CompactMap(spec) => {
            let at = at.field("compact_map");
            convert(|out| {
                let map = ids::name(at.field("map_id"), &spec.map_id, out);
                let at = at.field("redundant_share");
                let share = match spec.redundant_share {
                    None => Some(1.0),
                    Some(share) => out.positive(at, share),
                };
                if share? > 1.0 {
                    return out.report(at, Reason::OutOfRange, "at most 1");
                }
                map
            })?;
            Ok(Asked { role: Role::Admin, upload: None })
        }
        Spec::EvaluateTrajectory(spec) => {
            let upload = convert(|out| evaluation(at.field("evaluate_trajectory"), spec, out))?;
            Ok(Asked { role: Role::Write, upload })
        }
        Spec::ExportMap(request) => {
            let at = at.field("export_map");
            convert(|out| ids::name(at.field("map_id"), &request.map_id, out))?;
            export::choice(request).map_err(|error| within("spec.export_map", error))?;
            Ok(Asked { role: Role::Write, upload: None })
        }
        Spec::SolveFiles(spec) => {
            let at = at.field("solve_files");
            let upload = convert(|out| {
                let kind = out.known::<v1::ProblemFileKind>(at.field("kind"), spec.kind);
                let upload = upload_id(at.field("upload_id"), &spec.upload_id, out);
                kind?;
                upload
            })?;
            Ok(Asked { role: Role::Write, upload: Some(upload) })
        }
        Spec::Reconstruct(spec) => {
            let upload = convert(|out| reconstruction(at.field("reconstruct"), spec, out))?;
            Ok(Asked { role: Role::Write, upload })
        }
    }
}

/// The upload of a reconstruction, if it is not of a map.
fn reconstruction(
    at: Path<'_>,
    spec: &v1::ReconstructSpec,
    out: &mut Violations,
) -> Option<Option<String>> {
    let of_upload = at.field("upload_id");
    match (spec.map_id.as_str(), spec.upload_id.as_str()) {
        ("", "") => out.missing(at.field("map_id")),
        ("", id) => upload_id(of_upload, id, out).map(Some),
        (map, "") if spec.keep_solutions => {
            ids::name(at.field("map_id"), map, out)?;
            let text = "a map keeps its solution itself";
            out.report(at.field("keep_solutions"), Reason::Inconsistent, text)
        }
        (map, "") => ids::name(at.field("map_id"), map, out).map(|_name| None),
        _ => out.report(of_upload, Reason::Inconsistent, "map_id is given too"),
    }
}

/// The upload of an evaluation, if the truth is one.
fn evaluation(
    at: Path<'_>,
    spec: &v1::EvaluateTrajectorySpec,
    out: &mut Violations,
) -> Option<Option<String>> {
    let map = ids::name(at.field("map_id"), &spec.map_id, out);
    let client = ids::name(at.field("client_id"), &spec.client_id, out);
    let difference = match spec.max_time_difference_s {
        None => Some(0.0),
        Some(seconds) => out.positive(at.field("max_time_difference_s"), seconds),
    };
    let of_truth = at.field("truth");
    let upload = match spec.truth_upload_id.as_str() {
        "" if spec.truth.len() < LEAST_TRUTH => {
            let text = format!("{} poses, at least {LEAST_TRUTH} are needed", spec.truth.len());
            out.report(of_truth, Reason::Missing, text)
        }
        "" => {
            let fits = out.at_most(of_truth, &spec.truth, MAX_TRUTH);
            fits.and_then(|()| trajectory::poses(of_truth, &spec.truth, out)).map(|_| None)
        }
        _ if !spec.truth.is_empty() => {
            out.report(of_truth, Reason::Inconsistent, "the truth is given twice")
        }
        id => upload_id(at.field("truth_upload_id"), id, out).map(Some),
    };
    (map.is_some() && client.is_some() && difference.is_some()).then_some(())?;
    upload
}

fn upload_id(at: Path<'_>, id: &str, out: &mut Violations) -> Option<String> {
    if id.is_empty() {
        return out.missing(at);
    }
    let is_ours = id.len() == 32 && id.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
    if is_ours {
        return Some(id.to_owned());
    }
    out.report(at, Reason::OutOfRange, "32 hexadecimal digits are expected")
}

/// The error with field paths that begin at the request.
fn within(path: &str, error: ServiceError) -> ServiceError {
    let ServiceError::Rejected(mut rejection) = error else { return error };
    for violation in &mut rejection.violations {
        violation.field = format!("{path}.{}", violation.field);
    }
    ServiceError::Rejected(rejection)
}

/// Checks a spec against what is there; answers the maps that the job changes, by the engine's names.
///
/// # Errors
/// NOT_FOUND and FAILED_PRECONDITION.
pub(super) async fn check(
    spec: &v1::JobSpec,
    asked: &Asked,
    jobs: &Jobs,
    caller: &Caller,
) -> Result<Vec<String>, ServiceError> {
    if let Some(id) = &asked.upload {
        jobs.check_upload(caller.tenant(), id)?;
    }
    let Some(kind) = &spec.spec else { return Ok(Vec::new()) };
    let mut changed = Vec::new();
    for map_id in maps_of(spec) {
        let map = jobs.context.maps.find(&caller.engine_name(map_id)).await?;
        let info = map.info().await?;
        if let Spec::EvaluateTrajectory(spec) = kind
            && info.snapshot.client_named(&spec.client_id).is_none()
        {
            let (map, client) = (map_id.to_owned(), spec.client_id.clone());
            return Err(ServiceError::ClientNotFound { map, client });
        }
        if !changes(kind) {
            continue;
        }
        let map_id = map_id.to_owned();
        match info.state {
            MapState::Open => changed.push(map.name().to_owned()),
            MapState::Frozen => return Err(EngineError::Frozen { map: map_id }.into()),
            MapState::Poisoned => return Err(EngineError::Poisoned { map: map_id }.into()),
        }
    }
    Ok(changed)
}

/// The maps that a job changes, after a restart: those that are gone by the names that they had.
pub(super) fn changed_maps(spec: &v1::JobSpec, context: &Context, caller: &Caller) -> Vec<String> {
    if !spec.spec.as_ref().is_some_and(changes) {
        return Vec::new();
    }
    let name = |map_id: &str| {
        let name = caller.engine_name(map_id);
        context.maps.get(&name).map_or(name, |map| map.name().to_owned())
    };
    maps_of(spec).into_iter().map(name).collect()
}
