//! `OUT/transforms.json`: the file of a capture with the poses that the run found, in the capture's world.
//!
//! The map's world is another one. Both are aligned by the rigid motion that fits the motions between the
//! two poses of each frame best, so that frames without a new pose still belong to the others. Frames are
//! known by their times.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::ensure;
use covis_solvers::geometry::{LieGroup, Se3};

use super::super::overwrite::write_whole;
use super::Source;
use crate::evaluation::align_poses;
use crate::frontend::input::capture::{TRANSFORMS_FILE, given_poses, transforms_file, with_poses};

/// How many frames have a refined pose, and how many kept theirs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub(super) struct Refined {
    refined: usize,
    kept: usize,
}

impl Refined {
    /// As a sentence.
    pub(super) fn text(&self) -> String {
        let Self { refined, kept } = self;
        format!("{TRANSFORMS_FILE}: {refined} poses refined, {kept} as they were")
    }
}

/// Refuses a folder for the results in which the capture's own file lies: it is not replaced.
pub(super) fn check(source: &Source, out: &Path) -> anyhow::Result<()> {
    let Source::Capture(path) = source else { return Ok(()) };
    let file = transforms_file(path).and_then(|file| file.canonicalize().ok());
    let target = out.join(TRANSFORMS_FILE);
    ensure!(
        file.is_none() || target.canonicalize().ok() != file,
        "{}: this is the capture's own file, which is not replaced: --out names another folder",
        target.display()
    );
    Ok(())
}

/// Writes the file, where the source is a capture that has one. `trajectory` is that on the final map.
pub(super) fn write(
    source: &Source,
    trajectory: &[(f64, Se3)],
    out: &Path,
) -> anyhow::Result<Option<Refined>> {
    let Source::Capture(path) = source else { return Ok(None) };
    let Some(file) = transforms_file(path) else { return Ok(None) };
    let found: BTreeMap<u64, &Se3> =
        trajectory.iter().map(|(time, pose)| (time.to_bits(), pose)).collect();
    let given = given_poses(path)?;
    let both =
        given.iter().filter_map(|given| Some((given, *found.get(&given.timestamp_s.to_bits())?)));
    let both: Vec<_> = both.collect();
    let pairs = both.iter().map(|(given, pose)| (&given.world_from_camera, *pose));
    let Some(given_from_map) = align_poses(pairs) else { return Ok(None) };
    let refined: BTreeMap<&str, Se3> = both
        .iter()
        .map(|(given, pose)| (given.frame.as_str(), given_from_map.compose(pose)))
        .collect();
    let (text, kept) = with_poses(&file, |frame| refined.get(frame).copied())?;
    write_whole(&out.join(TRANSFORMS_FILE), text.as_ref())?;
    Ok(Some(Refined { refined: refined.len(), kept }))
}
