//! Where `covis run` gets its frames: `tum:FOLDER` or `synthetic:SCENE`. Says what had to be
//! assumed; reading is [`crate::frontend::input`]'s.

use std::collections::VecDeque;
use std::path::PathBuf;
use std::str::FromStr;

use anyhow::{Context, bail};
use covis_solvers::geometry::PinholeRadialTangential;

use crate::frontend::camera::FrameCamera;
use crate::frontend::image::RgbdFrame;
use crate::frontend::input::{CameraOrigin, FrameError, FrameSource, SensorTiming, open_folder};
use crate::frontend::synthetic::{SceneName, Sequence, SequenceOptions, SyntheticSource};

/// A source as it was named.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::cli) enum Source {
    /// A recorded folder.
    Folder(PathBuf),
    /// A scene, with seed and number of frames.
    Synthetic(SceneName, u64, Option<usize>),
}

impl FromStr for Source {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        match text.split_once(':') {
            Some(("tum", folder)) if !folder.is_empty() => Ok(Self::Folder(folder.into())),
            Some(("synthetic", scene)) => {
                let scene = scene.parse().map_err(|error| format!("{error}"))?;
                Ok(Self::Synthetic(scene, 0, None))
            }
            _ => Err("must be tum:FOLDER or synthetic:SCENE".to_owned()),
        }
    }
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
            Self::Synthetic(scene, ..) => Self::Synthetic(scene, drawing.seed, drawing.frames),
        }
    }

    /// Opens it; says what had to be assumed.
    pub(in crate::cli) fn open(
        &self,
        camera: Option<&str>,
    ) -> anyhow::Result<Box<dyn FrameSource>> {
        match self {
            Self::Folder(folder) => {
                let open = open_folder(folder, camera)?;
                if open.camera_origin == CameraOrigin::Assumed {
                    tracing::warn!(
                        "{}: no --camera, no camera.txt, no known name: the camera of TUM's fr1 is assumed",
                        folder.display()
                    );
                }
                if open.without_depth > 0 {
                    tracing::warn!("{} color images have no depth in time", open.without_depth);
                }
                Ok(open.source)
            }
            Self::Synthetic(scene, seed, frames) => {
                let usual = SequenceOptions::default();
                let frames = frames.unwrap_or(usual.frames);
                let options = SequenceOptions { frames, seed: *seed, ..usual };
                Ok(Box::new(SyntheticSource::new(Sequence::new(*scene, &options))))
            }
        }
    }
}

/// A source whose first readable frame was looked at for its size.
pub(in crate::cli) struct Peeked {
    pub(super) source: Box<dyn FrameSource>,
    seen: VecDeque<Result<RgbdFrame, FrameError>>,
    size: (usize, usize),
}

impl Peeked {
    pub(in crate::cli) fn new(mut source: Box<dyn FrameSource>) -> anyhow::Result<Self> {
        let mut seen = VecDeque::new();
        while let Some(frame) = source.next_frame() {
            let size = frame.as_ref().ok().map(|frame| frame.color.size());
            seen.push_back(frame);
            if let Some(size) = size {
                return Ok(Self { source, seen, size });
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
        self.seen.pop_front().or_else(|| self.source.next_frame())
    }
}
