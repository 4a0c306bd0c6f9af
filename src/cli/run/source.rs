//! Where `covis run` gets its frames: a recorded folder, a recording of ROS 2, a phone's capture, or a
//! synthetic scene; a path without a word before it is looked at. It reports what it had to assume;
//! [`crate::frontend::input`] does the reading.

use std::collections::VecDeque;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use anyhow::{Context, bail, ensure};
use covis_solvers::geometry::PinholeRadialTangential;

use super::super::choices::number;
use super::super::output::ended_by;
use super::super::progress::Progress;
use super::interrupt::Interrupt;
use crate::frontend::camera::FrameCamera;
use crate::frontend::image::RgbdFrame;
use crate::frontend::input::capture::{OpenCapture, is_capture, open_capture};
use crate::frontend::input::recording::{
    OpenRecording, RecordingOptions, TopicNames, is_bag, open_recording,
};
use crate::frontend::input::{
    CameraOrigin, FolderOptions, FrameError, FrameSource, ImplausibleDepth, SensorTiming,
    open_folder, tum,
};
use crate::frontend::synthetic::{SceneName, Sequence, SequenceOptions, SyntheticSource};

/// A source as it was named.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::cli) enum Source {
    /// A recorded folder.
    Folder(PathBuf),
    /// A recording of ROS 2: an MCAP file, a bag's database or a bag's folder, and how it was named.
    Recording(&'static str, PathBuf),
    /// A phone's capture: a folder or a `transforms.json`.
    Capture(PathBuf),
    /// A scene, and how it is drawn.
    Synthetic(SceneName, SequenceOptions),
}

/// As it is named on the command line.
impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Folder(folder) => write!(f, "tum:{}", folder.display()),
            Self::Recording(kind, path) => write!(f, "{kind}:{}", path.display()),
            Self::Capture(path) => write!(f, "capture:{}", path.display()),
            Self::Synthetic(scene, ..) => write!(f, "synthetic:{scene}"),
        }
    }
}

impl FromStr for Source {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once(':') {
            Some(("tum", folder)) if !folder.is_empty() => Ok(Self::Folder(folder.into())),
            Some(("mcap", file)) if !file.is_empty() => Ok(Self::Recording("mcap", file.into())),
            Some(("bag", path)) if !path.is_empty() => Ok(Self::Recording("bag", path.into())),
            Some(("capture", path)) if !path.is_empty() => Ok(Self::Capture(path.into())),
            Some(("synthetic", scene)) => {
                let scene = scene.parse().map_err(|error| format!("{error}"))?;
                Ok(Self::Synthetic(scene, SequenceOptions::default()))
            }
            _ => Self::of_path(Path::new(text)).ok_or_else(|| MUST.to_owned()),
        }
    }
}

/// What a source can be.
const MUST: &str = "must be mcap:FILE, bag:FOLDER, tum:FOLDER, capture:FOLDER, synthetic:SCENE, or the \
                    path of a recording";

const MEGABYTE: u64 = 1_000_000;

/// What the user knows better than a recorded folder.
#[derive(Clone, Debug, Default, clap::Args)]
pub(in crate::cli) struct Recorded {
    /// Intrinsics, px: a file, or fx,fy,cx,cy[,k1,k2,p1,p2,k3].
    #[arg(long, value_name = "FILE|NUMBERS")]
    camera: Option<String>,
    /// Units of the depth images per meter: 1000 for millimeters [default: 5000 for the TUM layout,
    /// 1000 for 7-Scenes, for captures and for 16-bit depth of ROS, 1 for its 32-bit depth].
    #[arg(long, value_name = "N", value_parser = depth_scale)]
    depth_scale: Option<f32>,
    /// Topic of the color images of an MCAP file or a bag [default: found by type and name].
    #[arg(long, value_name = "TOPIC")]
    color_topic: Option<String>,
    /// Topic of the depth images, registered to color [default: found by type and name].
    #[arg(long, value_name = "TOPIC")]
    depth_topic: Option<String>,
    /// Topic of odometry, where a run is given one.
    #[arg(skip)]
    odometry: Option<String>,
    /// Topic of the camera's intrinsics [default: camera_info beside the color images].
    #[arg(long, value_name = "TOPIC")]
    camera_info_topic: Option<String>,
}

impl Recorded {
    /// The same with the topic of odometry, which only a run takes.
    pub(super) fn with_odometry(self, odometry: Option<String>) -> Self {
        Self { odometry, ..self }
    }

    /// Whether a topic is named.
    fn names_topics(&self) -> bool {
        [&self.color_topic, &self.depth_topic, &self.camera_info_topic, &self.odometry]
            .iter()
            .any(|topic| topic.is_some())
    }

    /// Refuses topics where there are none.
    fn expect_no_topics(&self, source: impl fmt::Display) -> anyhow::Result<()> {
        ensure!(!self.names_topics(), "topics are named for an MCAP file or a bag; {source}");
        Ok(())
    }

    /// What is known better than a folder of images.
    fn of_folder(&self) -> FolderOptions<'_> {
        FolderOptions { camera: self.camera.as_deref(), depth_units_per_m: self.depth_scale }
    }

    /// Opens a recording of ROS 2; says what is used of it and what is not.
    fn open_recording(
        &self,
        path: &Path,
        interrupt: &Interrupt,
    ) -> anyhow::Result<Box<dyn FrameSource>> {
        let topics = TopicNames {
            color: self.color_topic.as_deref(),
            depth: self.depth_topic.as_deref(),
            camera_info: self.camera_info_topic.as_deref(),
            odometry: self.odometry.as_deref(),
        };
        let options = RecordingOptions {
            camera: self.camera.as_deref(),
            depth_units_per_m: self.depth_scale,
            topics,
        };
        let (mut progress, caught) = (None, interrupt.clone());
        let watch = move |done: u64, all: u64| {
            let new = || Progress::new("MB indexed", u64::div_ceil(all, MEGABYTE));
            progress.get_or_insert_with(new).advance_to(done / MEGABYTE);
            caught.signal().is_none()
        };
        let opened = open_recording(path, options, watch);
        if let Some(signal) = interrupt.signal().filter(|_| opened.is_err()) {
            return Err(ended_by(signal));
        }
        let OpenRecording { source, used, unused, notes, implausible_depth } = opened?;
        for (role, topic) in used {
            tracing::info!("{role} from {topic}");
        }
        for topic in unused {
            let reason = topic.reason_unused().map(|reason| format!("; {reason}"));
            tracing::info!("not used: {topic}{}", reason.unwrap_or_default());
        }
        for note in notes {
            tracing::warn!("{note}");
        }
        warn_of_depth(path, implausible_depth, "--depth-scale gives it");
        Ok(source)
    }
}

/// Says that depth seems to have another scale.
fn warn_of_depth(path: &Path, implausible: Option<ImplausibleDepth>, advice: &str) {
    if let Some(implausible) = implausible {
        tracing::warn!(
            "{}: {implausible}, which is unusual for an RGB-D camera: if the depth images have another scale, {advice}",
            path.display()
        );
    }
}

fn depth_scale(text: &str) -> Result<f32, String> {
    const MUST: &str = "must be a number of units a meter, finite and positive";
    number(text, MUST, |scale: &f32| scale.is_finite() && *scale > 0.0)
}

/// How a synthetic scene is drawn.
#[derive(Clone, Copy, Debug, clap::Args)]
pub(in crate::cli) struct Drawing {
    /// Seed of a synthetic scene.
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Frames of a synthetic scene.
    #[arg(long, value_name = "N")]
    frames: Option<usize>,
}

impl Source {
    /// What is at a path, where there is something.
    fn of_path(path: &Path) -> Option<Self> {
        if path.is_dir() {
            let is_listed = path.join(tum::COLOR_LIST).exists();
            let (is_bag, is_capture) = (!is_listed && is_bag(path), !is_listed && is_capture(path));
            let path = path.to_owned();
            return Some(match (is_bag, is_capture) {
                (true, _) => Self::Recording("bag", path),
                (false, true) => Self::Capture(path),
                (false, false) => Self::Folder(path),
            });
        }
        let extension = path.is_file().then(|| path.extension()).flatten()?;
        match extension.to_str()? {
            "mcap" => Some(Self::Recording("mcap", path.to_owned())),
            // A bag of ROS 1 is refused by name where it is opened.
            "db3" | "bag" => Some(Self::Recording("bag", path.to_owned())),
            _ => is_capture(path).then(|| Self::Capture(path.to_owned())),
        }
    }

    /// The same with a seed and a number of frames, which a folder does not have.
    pub(in crate::cli) fn with(self, drawing: Drawing) -> Self {
        match self {
            Self::Folder(_) | Self::Recording(..) | Self::Capture(_) => self,
            Self::Synthetic(scene, usual) => {
                let Drawing { seed, frames } = drawing;
                let frames = frames.unwrap_or(usual.frames);
                Self::Synthetic(scene, SequenceOptions { seed, frames, ..usual })
            }
        }
    }

    /// Opens it; says what had to be assumed. A signal ends the pass over a recording.
    pub(in crate::cli) fn open(
        &self,
        recorded: &Recorded,
        interrupt: &Interrupt,
    ) -> anyhow::Result<Box<dyn FrameSource>> {
        match self {
            Self::Folder(folder) => {
                recorded
                    .expect_no_topics(format_args!("{} is a folder of images", folder.display()))?;
                let open = open_folder(folder, recorded.of_folder())?;
                let advice = "--depth-scale gives it (1000 for millimeters)";
                warn_of_depth(folder, open.implausible_depth, advice);
                if open.camera_origin == CameraOrigin::Assumed {
                    tracing::warn!(
                        "{}: no --camera, no camera.txt, no known name: the camera of TUM's fr1 is assumed",
                        folder.display()
                    );
                }
                if open.without_depth > 0 {
                    tracing::warn!(
                        "{} color images have no depth image close in time",
                        open.without_depth
                    );
                }
                Ok(open.source)
            }
            Self::Recording(_, path) => recorded.open_recording(path, interrupt),
            Self::Capture(path) => {
                recorded.expect_no_topics(format_args!("{} is a capture", path.display()))?;
                let open = open_capture(path, recorded.of_folder())?;
                let OpenCapture { source, without_depth, implausible_depth } = open;
                warn_of_depth(path, implausible_depth, "--depth-scale gives it");
                if without_depth > 0 {
                    tracing::warn!("{without_depth} color images have no depth image");
                }
                Ok(source)
            }
            Self::Synthetic(scene, options) => {
                recorded.expect_no_topics(format_args!("{scene} is drawn"))?;
                ensure!(
                    recorded.depth_scale.is_none(),
                    "--depth-scale is for recorded folders; {scene} is drawn in meters"
                );
                Ok(Box::new(SyntheticSource::new(Sequence::new(*scene, options))))
            }
        }
    }
}

/// A source whose first readable frame was looked at for its size, and that has no more frames after a signal.
pub(in crate::cli) struct Peeked {
    pub(super) source: Box<dyn FrameSource>,
    seen: VecDeque<Result<RgbdFrame, FrameError>>,
    size: (usize, usize),
    interrupt: Interrupt,
}

impl Peeked {
    pub(in crate::cli) fn new(
        mut source: Box<dyn FrameSource>,
        interrupt: Interrupt,
    ) -> anyhow::Result<Self> {
        let mut seen = VecDeque::new();
        while let Some(frame) = source.next_frame() {
            let size = frame.as_ref().ok().map(|frame| frame.color.size());
            seen.push_back(frame);
            if let Some(size) = size {
                return Ok(Self { source, seen, size, interrupt });
            }
        }
        match seen.pop_front() {
            Some(Err(error)) => Err(error).context("no frame can be read; the first"),
            _ => bail!("the source has no frames"),
        }
    }

    /// The lens at the frames' size.
    pub(in crate::cli) fn frame_camera(&self) -> anyhow::Result<FrameCamera> {
        let (width, height) = self.size;
        FrameCamera::new(*self.source.camera(), width, height)
            .context("the camera leaves pixels without a ray: check its numbers")
    }
}

impl FrameSource for Peeked {
    fn camera(&self) -> &PinholeRadialTangential {
        self.source.camera()
    }

    fn timing(&self) -> SensorTiming {
        self.source.timing()
    }

    fn has_odometry(&self) -> bool {
        self.source.has_odometry()
    }

    fn len(&self) -> usize {
        self.source.len()
    }

    fn next_frame(&mut self) -> Option<Result<RgbdFrame, FrameError>> {
        if self.interrupt.signal().is_some() {
            return None;
        }
        self.seen.pop_front().or_else(|| self.source.next_frame())
    }
}
