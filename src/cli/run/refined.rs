//! `OUT/transforms.json`: the file of a capture with the poses that the run found, in the capture's world.
//!
//! The map's world is another one. Both are aligned by the rigid motion that fits the motions between the
//! two poses of each frame best, so that frames without a new pose still belong to the others. Frames are
//! known by their times.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::ensure;
use covis_solvers::geometry::{LieGroup, Se3, So3};
use fs_err as fs;
use nalgebra::{Matrix3, Vector3};

use super::Source;
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
    let Some(given_from_map) = alignment(pairs) else { return Ok(None) };
    let refined: BTreeMap<&str, Se3> = both
        .iter()
        .map(|(given, pose)| (given.frame.as_str(), given_from_map.compose(pose)))
        .collect();
    let (text, kept) = with_poses(&file, |frame| refined.get(frame).copied())?;
    fs::write(out.join(TRANSFORMS_FILE), text)?;
    Ok(Some(Refined { refined: refined.len(), kept }))
}

/// The rigid motion a_from_b that fits the pairs of poses best: the rotation nearest to the mean of the
/// rotations between them (Moakher, SIAM J. Matrix Anal. 2002), then the mean of the translations.
/// `None` without pairs.
fn alignment<'a>(pairs: impl Iterator<Item = (&'a Se3, &'a Se3)> + Clone) -> Option<Se3> {
    let (mut sum, mut count) = (Matrix3::zeros(), 0.0);
    for (a, b) in pairs.clone() {
        sum += a.rotation.compose(&b.rotation.inverse()).matrix();
        count += 1.0;
    }
    if count == 0.0 {
        return None;
    }
    let rotation = So3::from_matrix(&sum);
    let mean = pairs.map(|(a, b)| a.translation - rotation.rotate(&b.translation));
    let translation = mean.fold(Vector3::zeros(), |sum, t| sum + t) / count;
    Some(Se3::new(rotation, translation))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_worlds_are_aligned_by_the_poses_that_both_have() {
        let at = |x: f64| {
            Se3::new(So3::exp(&Vector3::new(0.3, x, -0.2)), Vector3::new(x, 2.0 * x, 1.0 - x))
        };
        let truth = Se3::new(So3::exp(&Vector3::new(2.0, -1.0, 0.5)), Vector3::new(5.0, 6.0, 7.0));
        let b = [0.0, 0.5, 1.0].map(at);
        let a = b.map(|pose| truth.compose(&pose));
        let found = alignment(a.iter().zip(&b)).unwrap();
        assert!(found.inverse().compose(&truth).log().amax() < 1e-12, "{found:?}");
        // One pair is enough.
        let found = alignment(a[..1].iter().zip(&b)).unwrap();
        assert!(found.inverse().compose(&truth).log().amax() < 1e-12, "{found:?}");
        assert_eq!(alignment(a[..0].iter().zip(&b)), None);
    }
}
