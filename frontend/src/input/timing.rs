//! When the rows of an image, and its depth, are taken beside the timestamps.
//!
//! Times other than [`SensorTiming::KINECT`] stand in the folder's `camera.txt`, in comments that other
//! readers of such files ignore: `# readout_s 0.02` and `# depth_late_s 0`. Nothing is measured from
//! the images.

use std::path::{Path, PathBuf};

use super::camera_file::CAMERA_FILE;
use super::error::InputError;

/// Neither is longer than this, seconds.
const LONGEST_S: f64 = 0.1;

/// When a frame's rows and its depth are taken.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SensorTiming {
    /// From the first row's exposure to the last row's, seconds; 0 for a global shutter.
    pub readout_s: f64,
    /// How much later than their timestamps say, beside those of color, depth images are taken,
    /// seconds.
    pub depth_late_s: f64,
}

impl SensorTiming {
    /// The first Kinect. Its color camera's readout is that of Ringaby and Forssén (ICCV 2011); its
    /// depth stamps are late by what aligns edges of depth and color best (docs/benchmarking.md).
    pub const KINECT: Self = Self { readout_s: 0.0261, depth_late_s: -0.015 };

    /// These two, where they can be.
    #[must_use]
    pub fn new(readout_s: f64, depth_late_s: f64) -> Option<Self> {
        let is_fit = (0.0..=LONGEST_S).contains(&readout_s) && depth_late_s.abs() <= LONGEST_S;
        is_fit.then_some(Self { readout_s, depth_late_s })
    }

    /// What a folder's camera file says, and `usual` of what it does not say.
    pub(super) fn of_folder(folder: &Path, usual: Self) -> Result<Self, InputError> {
        let path = folder.join(CAMERA_FILE);
        let Ok(bytes) = std::fs::read(&path) else { return Ok(usual) };
        Self::parse(&String::from_utf8_lossy(&bytes), path, usual)
    }

    /// What the text of a camera file says, and `usual` of what it does not say.
    pub(super) fn parse(text: &str, path: PathBuf, usual: Self) -> Result<Self, InputError> {
        let mut timing = usual;
        for (line, words) in (1..).zip(text.lines().map(words)) {
            let field = match words[..] {
                ["readout_s", _] => &mut timing.readout_s,
                ["depth_late_s", _] => &mut timing.depth_late_s,
                _ => continue,
            };
            let value = words[1].parse::<f64>().ok().filter(|v| v.abs() <= LONGEST_S);
            *field = value.ok_or_else(|| InputError::Timing { path: path.clone(), line })?;
        }
        Self::new(timing.readout_s, timing.depth_late_s).ok_or(InputError::Timing { path, line: 0 })
    }

    /// As comments of a camera file.
    pub(crate) fn comments(&self) -> String {
        format!("# readout_s {}\n# depth_late_s {}\n", self.readout_s, self.depth_late_s)
    }
}

/// The words of a comment.
fn words(line: &str) -> Vec<&str> {
    line.strip_prefix('#').map_or_else(Vec::new, |rest| rest.split_whitespace().collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_file_tells_when_rows_and_depth_are_taken_else_it_is_a_kinect() {
        let folder = tempfile::tempdir().unwrap();
        let read = |text: &str| {
            std::fs::write(folder.path().join(CAMERA_FILE), text).unwrap();
            SensorTiming::of_folder(folder.path(), SensorTiming::KINECT)
        };
        assert_eq!(
            SensorTiming::of_folder(folder.path(), SensorTiming::KINECT).unwrap(),
            SensorTiming::KINECT
        );
        assert_eq!(read("# fx fy readout_s\n1 1 1 1\n").unwrap(), SensorTiming::KINECT);
        let given = SensorTiming { readout_s: 0.0, depth_late_s: 0.004 };
        assert_eq!(read(&format!("1 1 1 1\n{}", given.comments())).unwrap(), given);
        for bad in ["1\n# readout_s fast\n", "1\n# readout_s 3\n", "1\n# depth_late_s NaN\n"] {
            let error = read(bad).unwrap_err().to_string();
            assert!(error.contains("camera.txt") && error.contains("line 2"), "{error}");
        }
        assert!(read("# readout_s -0.01\n").is_err());
    }
}
