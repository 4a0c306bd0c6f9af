//! A folder of the TUM RGB-D benchmark: `rgb.txt` and `depth.txt` list the images with their times.
//!
//! Color is PNG or JPEG, depth a 16-bit PNG with 5000 units a meter, unless the caller says
//! otherwise, and 0 where none was measured. A frame has the time of its color image; its depth image
//! is the one nearest in time. The lists may have any rate. Opens the two lists only.

use std::path::Path;

use super::camera_file::Fallback;
use super::error::InputError;
use super::folder::{FrameFiles, Listing};
use super::pair::DepthScale;
use super::{SensorTiming, association, list};

/// The list of color images.
pub const COLOR_LIST: &str = "rgb.txt";
/// The list of depth images.
pub const DEPTH_LIST: &str = "depth.txt";
/// Units of a depth image a meter.
pub const DEPTH_UNITS_PER_M: f32 = 5000.0;

/// Reads the lists. Fails where one is missing or malformed or no two images belong together.
pub(super) fn listing(folder: &Path) -> Result<Listing, InputError> {
    if folder.is_dir() && !folder.join(COLOR_LIST).exists() {
        return Err(InputError::NotASequence { path: folder.to_owned() });
    }
    let color = list::read(folder, COLOR_LIST)?;
    let depth = list::read(folder, DEPTH_LIST)?;
    let times =
        [&color, &depth].map(|list| list.iter().map(|entry| entry.timestamp_s).collect::<Vec<_>>());
    let [color_times, depth_times] = &times;
    let max_difference_s = association::max_difference_s(color_times, depth_times);
    let partner = association::nearest_pairs(color_times, depth_times, max_difference_s);
    let colors = color.len();
    let frame = |(color, partner): (list::Entry, Option<usize>)| {
        let depth = &depth[partner?];
        Some(FrameFiles {
            timestamp_s: color.timestamp_s,
            depth_delay_s: depth.timestamp_s - color.timestamp_s,
            color: color.path,
            depth: depth.path.clone(),
            line: color.line,
        })
    };
    let frames: Vec<_> = color.into_iter().zip(partner).filter_map(frame).collect();
    if frames.is_empty() {
        return Err(InputError::NoFrames { path: folder.to_owned(), max_difference_s });
    }
    Ok(Listing {
        without_depth: colors - frames.len(),
        frames,
        list: folder.join(COLOR_LIST),
        scale: DepthScale { units_per_m: DEPTH_UNITS_PER_M, none: None },
        usual_timing: SensorTiming::KINECT,
        usual_camera: Fallback::FolderName,
    })
}

#[cfg(test)]
mod tests;
