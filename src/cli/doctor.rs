//! `covis doctor`: looks at a data directory without a server, tells what is damaged, and repairs it.
//!
//! Everything is found out by [`crate::store`]; this prints it. Exit code 1 where something was
//! damaged, also when it has been repaired: a second look then finds nothing.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use serde::Serialize;

use super::output::print;
use crate::store::{Damage, MapCheckup, check_up};

/// Looks at the journals and snapshots of a data directory that no server uses.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The folder that a server keeps its maps in.
    data_dir: PathBuf,
    /// Set damaged files aside and let their maps go on from what could be brought back; nothing is
    /// deleted.
    #[arg(long)]
    repair: bool,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

/// The object of `--json`.
#[derive(Debug, Serialize)]
struct Document {
    data_dir: PathBuf,
    damaged_maps: usize,
    maps: Vec<MapDocument>,
}

/// A map; `null` where its name is lost, or where no snapshot opens.
#[derive(Debug, Serialize)]
struct MapDocument {
    map: Option<String>,
    folder: PathBuf,
    revision: u64,
    segments: Vec<String>,
    snapshot: Option<u64>,
    damage: Vec<DamageDocument>,
    #[serde(skip_serializing_if = "Option::is_none")]
    failure: Option<String>,
    set_aside: Vec<PathBuf>,
}

/// A damaged place; `null` where no event is lost by it.
#[derive(Debug, Serialize)]
struct DamageDocument {
    file: String,
    byte: u64,
    first_lost: Option<u64>,
    last_lost: Option<u64>,
}

/// Looks, and repairs where it is told to.
///
/// # Errors
/// A directory that holds no maps, cannot be read, or is in use by a server.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let checkups = check_up(&args.data_dir, args.repair)
        .with_context(|| format!("cannot look at {}", args.data_dir.display()))?;
    let damaged_maps = checkups.iter().filter(|checkup| checkup.is_damaged()).count();
    if args.json {
        let maps = checkups.into_iter().map(MapDocument::from).collect();
        let document = Document { data_dir: args.data_dir.clone(), damaged_maps, maps };
        print(serde_json::to_string(&document)?)?;
    } else {
        for checkup in &checkups {
            print(describe(checkup))?;
        }
        print(format_args!("{} maps, {damaged_maps} of them damaged", checkups.len()))?;
    }
    Ok(if damaged_maps == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

impl From<MapCheckup> for MapDocument {
    fn from(checkup: MapCheckup) -> Self {
        let MapCheckup { map, folder, revision, segments, snapshot, damage, failure, set_aside } =
            checkup;
        let damage = damage.into_iter().map(|Damage { file, offset, lost }| DamageDocument {
            file,
            byte: offset,
            first_lost: lost.map(|(first, _)| first),
            last_lost: lost.map(|(_, last)| last),
        });
        let damage = damage.collect();
        Self { map, folder, revision, segments, snapshot, damage, failure, set_aside }
    }
}

fn describe(checkup: &MapCheckup) -> String {
    let name = checkup.map.as_deref().unwrap_or("(a map that has lost its name)");
    let snapshot = match checkup.snapshot {
        Some(revision) => format!("a snapshot at {revision}"),
        None => "no snapshot".to_owned(),
    };
    let files = checkup.segments.len();
    let mut lines = vec![format!(
        "{name}: revision {}, {files} journal files, {snapshot}, in {}",
        checkup.revision,
        checkup.folder.display()
    )];
    lines.extend(checkup.damage.iter().map(|damage| format!("  {damage}")));
    lines.extend(checkup.failure.iter().map(|failure| format!("  {failure}")));
    let aside = |path: &PathBuf| format!("  set aside: {}", path.display());
    lines.extend(checkup.set_aside.iter().map(aside));
    lines.join("\n")
}
