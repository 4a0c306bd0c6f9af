//! `covis doctor` and `covis backup`: data directories of servers.
//!
//! The doctor checks one that no server uses, reports what is damaged, and repairs it. A backup
//! copies one, even while a server uses it, and checks the copy, which is a data directory itself:
//! `covis serve --data-dir COPY` restores it. [`crate::store`] does everything; this prints it. The
//! exit code is 1 if something was damaged, even if it has been repaired: a second check then finds
//! nothing.

use std::path::{Path, PathBuf};

use anyhow::{Context, ensure};
use serde::Serialize;

use super::output::{show, succeed_if};
use super::progress::Working;
use crate::store::{
    Damage, JobCheckup, LostEvent, MapCheckup, Repair, back_up, check_up, check_up_jobs,
};

/// Checks the journals, snapshots and jobs of a data directory that no server uses.
#[derive(Debug, clap::Args)]
pub(super) struct DoctorArgs {
    /// The folder that a server keeps its maps in.
    data_dir: PathBuf,
    /// Set damaged files aside, so that their maps continue from what was recovered; nothing is
    /// deleted. Jobs are left as they are: the server does not list a damaged one.
    #[arg(long)]
    repair: bool,
    /// With --repair: if an event of a journal is intact but cannot be read, drop it and all later events,
    /// and list them. The files are set aside; nothing is deleted.
    #[arg(long, requires = "repair")]
    cut: bool,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

/// Copies the maps and jobs of a data directory, even while a server uses it.
#[derive(Debug, clap::Args)]
pub(super) struct BackupArgs {
    /// The folder that a server keeps its maps in.
    data_dir: PathBuf,
    /// The folder to copy them to; it must be missing or empty.
    copy: PathBuf,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

/// The object of `--json`: either folder, and a map each.
#[derive(Debug, Serialize)]
struct Document<'a, M> {
    #[serde(skip_serializing_if = "Option::is_none")]
    data_dir: Option<&'a PathBuf>,
    #[serde(skip_serializing_if = "Option::is_none")]
    copy: Option<&'a PathBuf>,
    damaged_maps: usize,
    maps: Vec<M>,
    damaged_jobs: usize,
    /// Uploads too, which have no name.
    jobs: &'a [JobCheckup],
}

/// A map that was looked at; `null` where its name is lost, or where no snapshot opens.
#[derive(Debug, Serialize)]
struct CheckedMap<'a> {
    map: Option<&'a str>,
    folder: &'a PathBuf,
    revision: u64,
    segments: &'a [String],
    snapshot: Option<u64>,
    damage: Vec<DamagedPart<'a>>,
    /// From the first one that cannot be read.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    unreadable_events: Vec<LostLine<'a>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    failure: Option<&'a str>,
    set_aside: &'a [PathBuf],
}

/// A damaged part; `null` where no event is lost by it.
#[derive(Debug, Serialize)]
struct DamagedPart<'a> {
    file: &'a str,
    byte: u64,
    first_lost: Option<u64>,
    last_lost: Option<u64>,
}

/// An event that is not in the recovered map; `null` where it was the server's own.
#[derive(Debug, Serialize)]
struct LostLine<'a> {
    event: i64,
    kind: &'static str,
    time_ns: i64,
    client: Option<&'a str>,
    sequence: Option<i64>,
}

/// A copied map; its name is `null` where it is lost.
#[derive(Debug, Serialize)]
struct CopiedMap<'a> {
    map: Option<&'a str>,
    revision: u64,
    damage: Vec<String>,
}

/// Looks, and repairs where it is told to; fails where the directory holds no maps, cannot be read,
/// or is in use by a server.
pub(super) fn doctor(args: &DoctorArgs) -> anyhow::Result<()> {
    holds_maps(&args.data_dir)?;
    let working = Working::new(format_args!("looking at {}", args.data_dir.display()));
    let repair = match (args.repair, args.cut) {
        (_, true) => Repair::Cut,
        (true, false) => Repair::Damage,
        (false, false) => Repair::No,
    };
    let checkups = check_up(&args.data_dir, repair)
        .with_context(|| format!("cannot check {}", args.data_dir.display()))?;
    let jobs = &check_up_jobs(&args.data_dir)
        .with_context(|| format!("cannot check {}", args.data_dir.display()))?;
    drop(working);
    let damaged_maps = damaged(&checkups);
    let maps = checkups.iter().map(checked).collect();
    let damaged_jobs = damaged_jobs(jobs).count();
    let data_dir = Some(&args.data_dir);
    let document = Document { data_dir, copy: None, damaged_maps, maps, damaged_jobs, jobs };
    show(args.json, &document, || {
        let mut lines: Vec<String> = checkups.iter().flat_map(describe).collect();
        lines.extend(describe_jobs(jobs));
        lines.push(format!("{} maps, {damaged_maps} of them damaged", checkups.len()));
        lines.push(format!("{} jobs, {damaged_jobs} of them damaged", jobs.len()));
        lines.join("\n")
    })?;
    succeed_if(damaged_maps + damaged_jobs == 0)
}

/// Copies and looks; fails where the directory holds no maps or cannot be read, and where the copy
/// is not empty or cannot be written.
pub(super) fn backup(args: &BackupArgs) -> anyhow::Result<()> {
    holds_maps(&args.data_dir)?;
    let working = Working::new(format_args!("copying {}", args.data_dir.display()));
    let checkups = back_up(&args.data_dir, &args.copy)
        .with_context(|| format!("cannot back up {}", args.data_dir.display()))?;
    drop(working);
    let damaged_maps = damaged(&checkups);
    let maps = checkups.iter().map(|checkup| CopiedMap {
        map: checkup.map.as_deref(),
        revision: checkup.revision,
        damage: complaints(checkup).collect(),
    });
    let maps = maps.collect();
    let jobs = &check_up_jobs(&args.copy)
        .with_context(|| format!("cannot check {}", args.copy.display()))?;
    let damaged_jobs = damaged_jobs(jobs).count();
    let copy = Some(&args.copy);
    let document = Document { data_dir: None, copy, damaged_maps, maps, damaged_jobs, jobs };
    show(args.json, &document, || {
        let mut lines = Vec::new();
        for checkup in &checkups {
            lines.push(format!("{}: revision {}", name(checkup), checkup.revision));
            lines.extend(complaints(checkup).map(|damage| format!("  {damage}")));
        }
        let (count, copy) = (checkups.len(), args.copy.display());
        lines.extend(describe_jobs(jobs));
        lines.push(format!("{count} maps copied to {copy}, {damaged_maps} of them damaged"));
        let count = jobs.len();
        lines.push(format!("{count} jobs copied to {copy}, {damaged_jobs} of them damaged"));
        lines.join("\n")
    })?;
    succeed_if(damaged_maps + damaged_jobs == 0)
}

/// Refuses a folder that no server has kept maps in.
fn holds_maps(data_dir: &Path) -> anyhow::Result<()> {
    ensure!(
        data_dir.join("maps").is_dir(),
        "{}: is not a folder in which a server keeps maps; `covis serve` prints its folder when \
         it starts",
        data_dir.display()
    );
    Ok(())
}

fn damaged(checkups: &[MapCheckup]) -> usize {
    checkups.iter().filter(|checkup| checkup.is_damaged()).count()
}

fn damaged_jobs(jobs: &[JobCheckup]) -> impl Iterator<Item = &JobCheckup> {
    jobs.iter().filter(|job| !job.damage.is_empty())
}

/// What is damaged of jobs, a line a job and a file.
fn describe_jobs(jobs: &[JobCheckup]) -> impl Iterator<Item = String> {
    damaged_jobs(jobs).flat_map(|job| {
        let name = job.job.as_deref().unwrap_or("(a job without a name)");
        let first = format!("job {name} in {}", job.folder.display());
        std::iter::once(first).chain(job.damage.iter().map(|damage| format!("  {damage}")))
    })
}

fn name(checkup: &MapCheckup) -> &str {
    checkup.map.as_deref().unwrap_or("(a map that has lost its name)")
}

/// What is damaged, and why the map does not open.
fn complaints(checkup: &MapCheckup) -> impl Iterator<Item = String> {
    checkup.damage.iter().map(ToString::to_string).chain(checkup.failure.clone())
}

fn checked(checkup: &MapCheckup) -> CheckedMap<'_> {
    let damage =
        checkup.damage.iter().map(|Damage { file, offset, lost, unreadable: _ }| DamagedPart {
            file,
            byte: *offset,
            first_lost: lost.map(|(first, _)| first),
            last_lost: lost.map(|(_, last)| last),
        });
    CheckedMap {
        map: checkup.map.as_deref(),
        folder: &checkup.folder,
        revision: checkup.revision,
        segments: &checkup.segments,
        snapshot: checkup.snapshot,
        damage: damage.collect(),
        unreadable_events: checkup.unreadable.iter().map(lost_line).collect(),
        failure: checkup.failure.as_deref(),
        set_aside: &checkup.set_aside,
    }
}

fn lost_line(LostEvent { event, client }: &LostEvent) -> LostLine<'_> {
    let sequence = event.cause.map(|(_, sequence)| sequence);
    let (kind, time_ns) = (event.kind, event.time_ns);
    LostLine { event: event.revision, kind, time_ns, client: client.as_deref(), sequence }
}

/// An event that is not in the recovered map, in a line.
fn lost_event(LostEvent { event, client }: &LostEvent) -> String {
    let item = match (event.cause, client) {
        (Some((_, sequence)), Some(client)) => format!(", item {sequence} of client {client:?}"),
        (Some((_, sequence)), None) => format!(", item {sequence}"),
        (None, _) => String::new(),
    };
    format!("not in the map: event {} ({}){item}", event.revision, event.kind)
}

fn describe(checkup: &MapCheckup) -> Vec<String> {
    let snapshot = match checkup.snapshot {
        Some(revision) => format!("a snapshot at {revision}"),
        None => "no snapshot".to_owned(),
    };
    let (files, folder) = (checkup.segments.len(), checkup.folder.display());
    let (name, revision) = (name(checkup), checkup.revision);
    let first =
        format!("{name}: revision {revision}, {files} journal files, {snapshot}, in {folder}");
    let aside = checkup.set_aside.iter().map(|path| format!("set aside: {}", path.display()));
    let lost = checkup.unreadable.iter().map(lost_event);
    let further = complaints(checkup).chain(lost).chain(aside).map(|line| format!("  {line}"));
    std::iter::once(first).chain(further).collect()
}
