//! Masks in files: those that a user gives, and those that a run writes. A file is named by its
//! frame's time; nothing is detected here.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use fs_err as fs;

use super::super::eval::mask::time_of_name;
use crate::frontend::image::{Image, RgbdFrame};
use crate::frontend::input::{decode, encode};

/// How far a mask's name may be from its frame's time, microseconds.
const NEAR_US: i64 = 100;

/// Masks of a folder by the time in their names.
#[derive(Debug)]
pub(super) struct GivenMasks {
    by_time_us: BTreeMap<i64, PathBuf>,
}

/// A time in whole microseconds.
pub(in crate::cli) fn microseconds(seconds: f64) -> i64 {
    (seconds * 1e6).round() as i64
}

impl GivenMasks {
    /// Lists a folder; files that are no PNG, or whose name is no number, are passed over.
    pub(super) fn open(folder: &Path) -> anyhow::Result<Self> {
        let mut by_time_us = BTreeMap::new();
        for entry in fs::read_dir(folder)? {
            let path = entry?.path();
            let is_png = path.extension().is_some_and(|extension| extension == "png");
            if let (true, Some(time)) = (is_png, time_of_name(&path)) {
                by_time_us.insert(microseconds(time), path);
            }
        }
        if by_time_us.is_empty() {
            bail!("{}: no PNG is named by a timestamp", folder.display());
        }
        Ok(Self { by_time_us })
    }

    /// The mask of a time, where there is one.
    pub(super) fn of(&self, timestamp_s: f64) -> anyhow::Result<Option<Image<u8>>> {
        let time = microseconds(timestamp_s);
        let near = self.by_time_us.range(time - NEAR_US..=time + NEAR_US);
        let Some((_, path)) = near.min_by_key(|(other, _)| (*other - time).abs()) else {
            return Ok(None);
        };
        let mask = decode::mask(&fs::read(path)?).with_context(|| path.display().to_string())?;
        Ok(Some(mask))
    }
}

/// Writes the mask of a frame into a folder; all black where nothing was looked for.
pub(super) fn save(
    folder: &Path,
    frame: &RgbdFrame,
    moving: Option<&Image<u8>>,
) -> anyhow::Result<()> {
    let empty = || frame.color.map(|_| 0_u8);
    let mask = moving.map_or_else(empty, Clone::clone);
    let path = folder.join(format!("{:.6}.png", frame.timestamp_s));
    Ok(fs::write(path, encode::gray8(&mask)?)?)
}
