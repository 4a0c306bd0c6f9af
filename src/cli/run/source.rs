//! Where `covis run` gets its frames: `tum:FOLDER` or `synthetic:SCENE`. It reports what it had to
//! assume; [`crate::frontend::input`] does the reading.

use std::collections::VecDeque;
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use anyhow::{Context, bail, ensure};
use covis_solvers::geometry::PinholeRadialTangential;

use super::super::choices::number;
use super::interrupt::Interrupt;
use crate::frontend::camera::FrameCamera;
use crate::frontend::image::RgbdFrame;
use crate::frontend::input::{
    CameraOrigin, FolderOptions, FrameError, FrameSource, SensorTiming, open_folder,
};
use crate::frontend::synthetic::{SceneName, Sequence, SequenceOptions, SyntheticSource};

/// A source as it was named.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::cli) enum Source {
    /// A recorded folder.
    Folder(PathBuf),
    /// A scene, and how it is drawn.
    Synthetic(SceneName, SequenceOptions),
}

/// As it is named on the command line.
impl fmt::Display for Source {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Folder(folder) => write!(f, "tum:{}", folder.display()),
            Self::Synthetic(scene, ..) => write!(f, "synthetic:{scene}"),
        }
    }
}

impl FromStr for Source {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once(':') {
            Some(("tum", folder)) if !folder.is_empty() => Ok(Self::Folder(folder.into())),
            Some(("synthetic", scene)) => {
                let scene = scene.parse().map_err(|error| format!("{error}"))?;
                Ok(Self::Synthetic(scene, SequenceOptions::default()))
            }
            _ => Err("must be tum:FOLDER or synthetic:SCENE".to_owned()),
        }
    }
}

/// What the user knows better than a recorded folder.
#[derive(Clone, Debug, Default, clap::Args)]
pub(in crate::cli) struct Recorded {
    /// Intrinsics, px: a file, or fx,fy,cx,cy[,k1,k2,p1,p2,k3].
    #[arg(long, value_name = "FILE|NUMBERS")]
    camera: Option<String>,
    /// Units of the depth images per meter: 1000 for millimeters [default: 5000 for the TUM layout,
    /// 1000 for 7-Scenes].
    #[arg(long, value_name = "N", value_parser = depth_scale)]
    depth_scale: Option<f32>,
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
    /// The same with a seed and a number of frames, which a folder does not have.
    pub(in crate::cli) fn with(self, drawing: Drawing) -> Self {
        match self {
            Self::Folder(folder) => Self::Folder(folder),
            Self::Synthetic(scene, usual) => {
                let Drawing { seed, frames } = drawing;
                let frames = frames.unwrap_or(usual.frames);
                Self::Synthetic(scene, SequenceOptions { seed, frames, ..usual })
            }
        }
    }

    /// Opens it; says what had to be assumed.
    pub(in crate::cli) fn open(&self, recorded: &Recorded) -> anyhow::Result<Box<dyn FrameSource>> {
        match self {
            Self::Folder(folder) => {
                let options = FolderOptions {
                    camera: recorded.camera.as_deref(),
                    depth_units_per_m: recorded.depth_scale,
                };
                let open = open_folder(folder, options)?;
                if let Some(implausible) = open.implausible_depth {
                    tracing::warn!(
                        "{}: {implausible}, which is unusual for an RGB-D camera: if the depth images have another scale, --depth-scale gives it (1000 for millimeters)",
                        folder.display()
                    );
                }
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
            Self::Synthetic(scene, options) => {
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
