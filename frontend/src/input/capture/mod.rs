//! Captures of phones: images with lenses, poses, and depth of a lower resolution.
//!
//! Three layouts: `transforms.json` (nerfstudio, instant-ngp), Polycam's raw data, Record3D. All frames
//! are brought to one size and one lens. The poses are the phone's own odometry, or what another program
//! made of it: each frame carries its pose, from which tracking starts and which it never returns as its
//! own; [`given_poses`] has them as a trajectory.
//!
//! | file | role |
//! |---|---|
//! | `transforms`, `polycam`, `record3d` | a layout: its JSON as frames |
//! | `numbers` | lenses and poses, checked and converted |
//! | `container`, `archive` | the files of a capture, in a folder or in a zip archive |
//! | `resample` | one size and one lens |
//! | `lzfse` | compressed depth |
//! | `source` | the frames |
//! | `error` | what is wrong with a capture or a frame |

mod archive;
mod container;
mod error;
#[cfg(any(test, feature = "fuzzing"))]
pub(super) mod fuzzing;
mod lzfse;
mod numbers;
mod polycam;
mod record3d;
mod resample;
mod source;
#[cfg(test)]
mod tests;
mod transforms;

use std::path::{Path, PathBuf};

use covis_solvers::geometry::Se3;
use serde::de::DeserializeOwned;

pub use error::{CaptureError, Place};
pub use transforms::{TRANSFORMS_FILE, with_poses};

use super::camera_file;
use super::error::InputError;
use super::folder::ImplausibleDepth;
use super::{FolderOptions, FrameSource};
use container::Container;
use numbers::Lens;
use source::CaptureFrames;

/// No file of a capture is longer, bytes.
const MAX_FILE_BYTES: u64 = 256 << 20;

/// A frame of a capture, before its images are read.
#[derive(Clone, Debug)]
struct CapturedFrame {
    /// What the capture calls it.
    name: String,
    timestamp_s: f64,
    /// The names of its files.
    color: String,
    depth: Option<String>,
    confidence: Option<String>,
    lens: Lens,
    /// In the capture's world.
    world_from_camera: Option<Se3>,
}

/// Frames, of which each may be bad.
type Frames = Vec<Result<CapturedFrame, CaptureError>>;

/// How depth is stored.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Depth {
    /// A gray PNG with 16 bits; `is_usual` where the capture does not say its scale.
    Png { units_per_m: f32, is_usual: bool },
    /// Floats of this many columns and rows, meters.
    Lzfse { size: (usize, usize) },
}

/// A capture whose JSON was read.
#[derive(Debug)]
struct Capture {
    container: Container,
    /// What is named where the capture as a whole is wrong.
    path: PathBuf,
    /// In the order of time.
    frames: Frames,
    depth: Depth,
    /// Where depth would be.
    wanted: &'static str,
}

/// A capture, opened.
pub struct OpenCapture {
    /// Its frames.
    pub source: Box<dyn FrameSource>,
    /// Images without depth; they are no frames.
    pub without_depth: usize,
    /// Set where no depth scale was given and millimeters do not fit the first depth images.
    pub implausible_depth: Option<ImplausibleDepth>,
}

/// Which layout the files of a capture have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Layout {
    Transforms,
    Polycam,
    Record3d,
}

impl Layout {
    fn of(container: &Container) -> Option<Self> {
        let has = |name: &str| container.has(name);
        if has(TRANSFORMS_FILE) {
            Some(Self::Transforms)
        } else if has(polycam::IMAGES) {
            Some(Self::Polycam)
        } else {
            (has(record3d::METADATA) && has(record3d::IMAGES)).then_some(Self::Record3d)
        }
    }
}

/// Whether a path is a file with one of these extensions.
fn is_file_of(path: &Path, extensions: &[&str]) -> bool {
    let extension = path.extension().and_then(|extension| extension.to_str()).unwrap_or_default();
    extensions.iter().any(|own| extension.eq_ignore_ascii_case(own)) && path.is_file()
}

fn is_json(path: &Path) -> bool {
    is_file_of(path, &["json"])
}

fn is_archive(path: &Path) -> bool {
    is_file_of(path, &["r3d", "zip"])
}

/// Whether there is a capture at a path: a folder of one of the layouts, a `.json` file, or an archive,
/// which is not opened here.
#[must_use]
pub fn is_capture(path: &Path) -> bool {
    is_json(path) || is_archive(path) || Layout::of(&Container::folder(path)).is_some()
}

/// The `transforms.json` of a capture, where it has this layout and is not in an archive.
#[must_use]
pub fn transforms_file(path: &Path) -> Option<PathBuf> {
    if is_json(path) {
        return Some(path.to_owned());
    }
    let layout = Layout::of(&Container::folder(path));
    (layout == Some(Layout::Transforms)).then(|| path.join(TRANSFORMS_FILE))
}

/// Reads a capture's JSON.
fn read(path: &Path) -> Result<Capture, CaptureError> {
    if let Some(name) = path.file_name().and_then(|name| name.to_str()).filter(|_| is_json(path)) {
        return transforms::read(Container::folder(path.parent().unwrap_or(path)), name);
    }
    let mut container = match is_archive(path) {
        true => Container::archive(path)?,
        false => Container::folder(path),
    };
    let mut layout = Layout::of(&container);
    if layout.is_none() {
        // Many programs pack the folder itself.
        container.enter_common_folder();
        layout = Layout::of(&container);
    }
    match layout {
        Some(Layout::Transforms) => transforms::read(container, TRANSFORMS_FILE),
        Some(Layout::Polycam) => polycam::read(container),
        Some(Layout::Record3d) => record3d::read(container),
        None => Err(CaptureError::Layout { path: path.to_owned() }),
    }
}

/// Opens a capture. A camera that is given holds for all color images, in their pixels; a depth scale
/// replaces that of PNG files.
///
/// # Errors
/// [`InputError`] where the JSON, the camera or the depth scale cannot be used, or no frame has depth.
pub fn open_capture(path: &Path, options: FolderOptions<'_>) -> Result<OpenCapture, InputError> {
    let camera = options.camera.map(camera_file::parse_argument).transpose()?;
    let mut capture = read(path)?;
    if let Some(units_per_m) = options.depth_units_per_m {
        if !(units_per_m.is_finite() && units_per_m > 0.0) {
            return Err(InputError::DepthScale { value: units_per_m });
        }
        if matches!(capture.depth, Depth::Png { .. }) {
            capture.depth = Depth::Png { units_per_m, is_usual: false };
        }
    }
    let (mut source, without_depth) = CaptureFrames::new(capture, camera)?;
    let implausible_depth = source.implausible_depth();
    Ok(OpenCapture { source: Box::new(source), without_depth, implausible_depth })
}

/// A pose that a capture gives.
#[derive(Clone, Debug, PartialEq)]
pub struct GivenPose {
    /// The frame, as the capture calls it.
    pub frame: String,
    /// When it was taken, s.
    pub timestamp_s: f64,
    /// In the capture's world, m; the camera looks along z with y down.
    pub world_from_camera: Se3,
}

/// The poses that a capture gives, in the order of time. Frames without one, and bad ones, are left out.
///
/// # Errors
/// [`InputError`] where the JSON cannot be used.
pub fn given_poses(path: &Path) -> Result<Vec<GivenPose>, InputError> {
    let pose = |frame: CapturedFrame| {
        let CapturedFrame { name: frame, timestamp_s, world_from_camera, .. } = frame;
        Some(GivenPose { frame, timestamp_s, world_from_camera: world_from_camera? })
    };
    Ok(read(path)?.frames.into_iter().flatten().filter_map(pose).collect())
}

/// The JSON of a file.
fn parsed<T: DeserializeOwned>(bytes: &[u8], path: &Path) -> Result<T, CaptureError> {
    serde_json::from_slice(bytes)
        .map_err(|source| CaptureError::Json { path: path.to_owned(), source })
}
