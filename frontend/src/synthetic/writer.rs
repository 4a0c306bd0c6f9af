//! Keeps a sequence as a TUM RGB-D folder: what `frontend::input` reads, and the truth beside it.
//!
//! `rgb/`, `depth/` and `mask/` hold a PNG a frame, named by its time; `rgb.txt`, `depth.txt` and
//! `mask.txt` list them. `groundtruth.txt` is world_from_camera at the frames' times, `camera.txt` the
//! intrinsics. Lists come last: a folder whose writing was cut short is no sequence. It reads nothing
//! back; files of the same names are replaced.

use std::path::{Path, PathBuf};

use covis_solvers::io::IoError;
use covis_solvers::io::trajectory::Trajectory;

use super::{Sequence, sensor};
use crate::input::{SensorTiming, camera_file, encode, tum};

/// What is written of each frame: the folder, and its list's head.
const KINDS: [(&str, &str); 3] =
    [("rgb", "color images"), ("depth", "depth images"), ("mask", "255 where something moves")];

/// A sequence that cannot be written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WriteError {
    /// The operating system refused.
    #[error("{}: cannot be written", path.display())]
    File {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// An image has no PNG.
    #[error("{}: cannot be encoded", path.display())]
    Encode {
        /// The file that it was meant for.
        path: PathBuf,
        /// Why.
        source: png::EncodingError,
    },
    /// The trajectory was refused.
    #[error(transparent)]
    Trajectory(#[from] IoError),
}

/// Writes all frames into `folder`, which is made where it is missing; files of the same names are
/// replaced. `written` hears the number of each frame that is done.
///
/// # Errors
/// [`WriteError`] with the file that could not be written.
pub fn write_sequence(
    sequence: &Sequence,
    folder: &Path,
    mut written: impl FnMut(usize),
) -> Result<(), WriteError> {
    for (kind, _) in KINDS {
        let path = folder.join(kind);
        std::fs::create_dir_all(&path).map_err(|source| WriteError::File { path, source })?;
    }
    let mut lists = KINDS.map(|(_, head)| format!("# {head}\n# timestamp filename\n"));
    let mut truth = Trajectory::default();
    for index in 0..sequence.len() {
        let (frame, mask) = sequence.frame_and_mask(index);
        let stamp = format!("{:.6}", frame.timestamp_s);
        let units = frame.depth_m.map(sensor::to_units);
        let images = [encode::rgb(&frame.color), encode::gray16(&units), encode::gray8(&mask)];
        for (((kind, _), list), image) in KINDS.iter().zip(&mut lists).zip(images) {
            let name = format!("{kind}/{stamp}.png");
            let path = folder.join(&name);
            match image {
                Ok(bytes) => write(path, &bytes)?,
                Err(source) => return Err(WriteError::Encode { path, source }),
            }
            list.push_str(&format!("{stamp} {name}\n"));
        }
        truth.push(frame.timestamp_s, sequence.world_from_camera(index));
        written(index);
    }
    truth.write(&folder.join("groundtruth.txt"))?;
    write(
        folder.join(camera_file::CAMERA_FILE),
        (camera_text(sequence) + &SensorTiming::default().comments()).as_bytes(),
    )?;
    let [color, depth, mask] = lists;
    write(folder.join("mask.txt"), mask.as_bytes())?;
    write(folder.join(tum::DEPTH_LIST), depth.as_bytes())?;
    write(folder.join(tum::COLOR_LIST), color.as_bytes())
}

fn camera_text(sequence: &Sequence) -> String {
    let c = sequence.camera();
    format!(
        "# fx fy cx cy k1 k2 p1 p2 k3, pixels; color and depth share them; depth scale {} per meter\n\
         {} {} {} {} {} {} {} {} {}\n",
        sensor::UNITS_PER_M,
        c.fx,
        c.fy,
        c.cx,
        c.cy,
        c.k1,
        c.k2,
        c.p1,
        c.p2,
        c.k3
    )
}

fn write(path: PathBuf, bytes: &[u8]) -> Result<(), WriteError> {
    std::fs::write(&path, bytes).map_err(|source| WriteError::File { path, source })
}
