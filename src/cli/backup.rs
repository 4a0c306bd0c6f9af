//! `covis backup`: copies a data directory, also while a server uses it, and looks at the copy.
//!
//! The copy is a data directory of its own: `covis serve --data-dir COPY` is how it is restored.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use serde::Serialize;

use super::output::print;
use crate::store::back_up;

/// Copies the maps of a data directory, also while a server uses it.
#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The folder that a server keeps its maps in.
    data_dir: PathBuf,
    /// The folder to copy them to; missing or empty.
    copy: PathBuf,
    /// Print one JSON object instead of text.
    #[arg(long)]
    json: bool,
}

/// The object of `--json`.
#[derive(Debug, Serialize)]
struct Document {
    copy: PathBuf,
    damaged_maps: usize,
    maps: Vec<MapDocument>,
}

/// A copied map; its name is `null` where it is lost.
#[derive(Debug, Serialize)]
struct MapDocument {
    map: Option<String>,
    revision: u64,
    damage: Vec<String>,
}

/// Copies and looks.
///
/// # Errors
/// A directory that holds no maps or cannot be read, a copy that is not empty or cannot be written.
pub(super) fn run(args: &Args) -> anyhow::Result<ExitCode> {
    let checkups = back_up(&args.data_dir, &args.copy)
        .with_context(|| format!("cannot back up {}", args.data_dir.display()))?;
    let damaged_maps = checkups.iter().filter(|checkup| checkup.is_damaged()).count();
    let maps = checkups.into_iter().map(|checkup| {
        let damage = checkup.damage.iter().map(ToString::to_string).chain(checkup.failure);
        MapDocument { map: checkup.map, revision: checkup.revision, damage: damage.collect() }
    });
    let document = Document { copy: args.copy.clone(), damaged_maps, maps: maps.collect() };
    if args.json {
        print(serde_json::to_string(&document)?)?;
    } else {
        for map in &document.maps {
            let name = map.map.as_deref().unwrap_or("(a map that has lost its name)");
            print(format_args!("{name}: revision {}", map.revision))?;
            for damage in &map.damage {
                print(format_args!("  {damage}"))?;
            }
        }
        let (count, copy) = (document.maps.len(), document.copy.display());
        print(format_args!("{count} maps copied to {copy}, {damaged_maps} of them damaged"))?;
    }
    Ok(if damaged_maps == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
