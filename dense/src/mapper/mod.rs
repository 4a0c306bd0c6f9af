//! A volume that follows corrections of its frames' poses (decision 0017).
//!
//! Frames move with their keyframes. When keyframes are corrected, a second volume is built from the
//! log of frames at the current poses, a few frames with each new one. Once it has caught up, it
//! replaces the first volume. The result is, to the bit, that of integrating at the corrected poses
//! from the start, voxels that are freed included. Independent of the server and of threads.

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::io;
use std::path::PathBuf;

use covis_solvers::geometry::{LieGroup, Se3};

use super::frame_log::{FrameLog, LoggedFrame};
use super::integrate::{DenseFrame, IntegrateError, IntegrationOptions, Integrator};
use super::paged::PagedVolume;
use super::volume::VolumeOptions;
use crate::camera::FrameCamera;

/// Frames that are integrated again with each new one. With one the second volume would never catch
/// up; two bound the time of a frame to three integrations.
const AGAIN_A_FRAME: usize = 2;
/// The volume is rebuilt only if a frame is off by more than this, in voxels at [`USUAL_RANGE_M`]; the
/// second value is for the end of a run.
const TOLERANCE_VOXELS: f64 = 0.25;
const FINAL_TOLERANCE_VOXELS: f64 = 0.02;
/// The usual distance of surfaces, meters: a rotation counts by the displacement there.
const USUAL_RANGE_M: f64 = 2.0;

/// Why a frame is not in the volume.
#[derive(Debug, thiserror::Error)]
pub enum DenseError {
    /// The frame cannot be integrated.
    #[error(transparent)]
    Frame(#[from] IntegrateError),
    /// The log of frames cannot be written or read.
    #[error("the log of dense mapping's frames: {0}")]
    Log(#[from] io::Error),
    /// No page file can be made for blocks on disk.
    #[error("the page file cannot be created: {0}")]
    PageFile(io::Error),
}

/// How much memory the blocks may use, those of a volume that is being rebuilt included.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MemoryCeiling {
    /// Bytes. While a volume is rebuilt, each of the two has half of them.
    pub bytes: usize,
    /// The folder for the rest; `None` is the system's folder for temporary files.
    pub folder: Option<PathBuf>,
}

impl MemoryCeiling {
    /// An empty volume with one of `shares` equal shares.
    ///
    /// # Errors
    /// No page file can be made.
    pub fn volume(&self, options: VolumeOptions, shares: usize) -> io::Result<PagedVolume> {
        PagedVolume::with_ceiling(options, self.bytes / shares.max(1), self.folder.as_deref())
    }
}

/// A frame, and its pose relative to a keyframe.
#[derive(Clone, Debug, PartialEq)]
pub struct AnchoredFrame {
    /// Its images.
    pub frame: LoggedFrame,
    /// Its keyframe.
    pub keyframe: usize,
    /// Its pose relative to the keyframe.
    pub keyframe_from_camera: Se3,
}

/// A frame of the log.
#[derive(Clone, Copy, Debug)]
struct IntegratedFrame {
    keyframe: usize,
    keyframe_from_camera: Se3,
    /// The pose at which it was integrated.
    world_from_camera: Se3,
}

/// A volume that is being rebuilt.
#[derive(Debug)]
struct Rebuild {
    volume: PagedVolume,
    /// The poses of the frames that it has, in the order of the log.
    poses: Vec<Se3>,
}

/// Builds a volume from frames whose poses are relative to keyframes, and rebuilds it when keyframes move.
#[derive(Debug)]
pub struct DenseMapper {
    integrator: Integrator,
    pub(super) volume: PagedVolume,
    ceiling: Option<MemoryCeiling>,
    log: FrameLog,
    frames: Vec<IntegratedFrame>,
    keyframes: BTreeMap<usize, Se3>,
    /// Whether keyframes moved since the last check found no frame that is off.
    moved: bool,
    rebuild: Option<Rebuild>,
    /// How many times the volume was rebuilt.
    pub(super) rebuilt: usize,
}

impl DenseMapper {
    /// An empty volume for frames of this camera.
    ///
    /// # Errors
    /// [`DenseError::Log`] and [`DenseError::PageFile`] where these files cannot be made.
    pub fn new(
        camera: &FrameCamera,
        volume: VolumeOptions,
        integration: IntegrationOptions,
        ceiling: Option<MemoryCeiling>,
    ) -> Result<Self, DenseError> {
        Ok(Self {
            integrator: Integrator::new(camera, integration),
            volume: empty(volume, ceiling.as_ref(), 1)?,
            ceiling,
            log: FrameLog::new()?,
            frames: Vec::new(),
            keyframes: BTreeMap::new(),
            moved: false,
            rebuild: None,
            rebuilt: 0,
        })
    }

    /// Integrates a frame. A new keyframe has the pose `world_from_keyframe` until it is corrected.
    ///
    /// # Errors
    /// [`DenseError`]; the volume is unchanged then.
    pub fn integrate(
        &mut self,
        anchored: AnchoredFrame,
        world_from_keyframe: &Se3,
    ) -> Result<(), DenseError> {
        let AnchoredFrame { mut frame, keyframe, keyframe_from_camera } = anchored;
        let known = self.keyframes.get(&keyframe).unwrap_or(world_from_keyframe);
        let world_from_camera = known.compose(&keyframe_from_camera);
        self.log.append(&mut frame)?;
        let integrated =
            self.volume.integrate(&mut self.integrator, &posed(&frame, &world_from_camera));
        integrated.inspect_err(|_| self.log.forget_last())?;
        self.keyframes.entry(keyframe).or_insert(*world_from_keyframe);
        self.frames.push(IntegratedFrame { keyframe, keyframe_from_camera, world_from_camera });
        Ok(())
    }

    /// Sets the current poses of keyframes; unknown keyframes are ignored.
    pub fn correct(&mut self, poses: &[(usize, Se3)]) {
        for (id, pose) in poses {
            if let Some(known) = self.keyframes.get_mut(id) {
                self.moved |= *known != *pose;
                *known = *pose;
            }
        }
    }

    /// Follows the keyframes by a bounded number of frames. Returns whether there is more to do.
    ///
    /// # Errors
    /// [`DenseError::Log`].
    pub fn follow(&mut self) -> Result<bool, DenseError> {
        if self.rebuild.is_none() {
            // All frames are checked only after keyframes moved, not after each frame of a long run.
            self.moved = self.moved && self.is_stale(TOLERANCE_VOXELS);
            if !self.moved {
                return Ok(false);
            }
        }
        for _ in 0..AGAIN_A_FRAME {
            if self.integrate_again()? {
                break;
            }
        }
        Ok(self.rebuild.is_some())
    }

    /// Follows the keyframes to their current poses. After each frame `done` is called with the number
    /// of frames that were integrated again, and of all.
    ///
    /// # Errors
    /// [`DenseError::Log`].
    pub fn finish(&mut self, done: &mut dyn FnMut(usize, usize)) -> Result<(), DenseError> {
        // A rebuild that began at older poses would have to be repeated.
        self.rebuild = None;
        self.share_memory(1);
        if self.is_stale(FINAL_TOLERANCE_VOXELS) {
            while !self.integrate_again()? {
                let again = self.rebuild.as_ref().map_or(0, |rebuild| rebuild.poses.len());
                done(again, self.frames.len());
            }
        }
        Ok(())
    }

    /// Gives the volume one of `volumes` equal shares of the memory.
    fn share_memory(&mut self, volumes: usize) {
        if let Some(ceiling) = &self.ceiling {
            self.volume.set_ceiling(ceiling.bytes / volumes);
        }
    }

    /// The current pose of a frame.
    fn pose(&self, frame: &IntegratedFrame) -> Se3 {
        match self.keyframes.get(&frame.keyframe) {
            Some(keyframe) => keyframe.compose(&frame.keyframe_from_camera),
            None => frame.world_from_camera,
        }
    }

    /// Whether a frame's pose differs from the one at which it was integrated.
    fn is_stale(&self, tolerance_voxels: f64) -> bool {
        let tolerance_m = tolerance_voxels * f64::from(self.volume.options().voxel_m);
        self.frames.iter().any(|frame| {
            let moved = frame.world_from_camera.inverse().compose(&self.pose(frame));
            let turned = moved.rotation.log().norm() * USUAL_RANGE_M;
            moved.translation.norm() + turned > tolerance_m
        })
    }

    /// Integrates one more frame into the second volume. Returns whether it has caught up and replaced
    /// the first.
    fn integrate_again(&mut self) -> Result<bool, DenseError> {
        let next = self.rebuild.as_ref().map_or(0, |rebuild| rebuild.poses.len());
        if let Some(frame) = self.frames.get(next) {
            let pose = self.pose(frame);
            let frame = self.log.read(next)?;
            if self.rebuild.is_none() {
                self.share_memory(2);
                let volume = empty(*self.volume.options(), self.ceiling.as_ref(), 2)?;
                self.rebuild = Some(Rebuild { volume, poses: Vec::new() });
            }
            if let Some(rebuild) = &mut self.rebuild {
                rebuild.volume.integrate(&mut self.integrator, &posed(&frame, &pose))?;
                rebuild.poses.push(pose);
            }
        }
        let caught_up = |rebuild: &mut Rebuild| rebuild.poses.len() == self.frames.len();
        let Some(rebuild) = self.rebuild.take_if(caught_up) else { return Ok(false) };
        for (frame, pose) in self.frames.iter_mut().zip(rebuild.poses) {
            frame.world_from_camera = pose;
        }
        self.volume = rebuild.volume;
        self.share_memory(1);
        self.rebuilt += 1;
        Ok(true)
    }
}

/// An empty volume with one of `volumes` equal shares of the memory.
fn empty(
    options: VolumeOptions,
    ceiling: Option<&MemoryCeiling>,
    volumes: usize,
) -> Result<PagedVolume, DenseError> {
    let volume = ceiling.map(|ceiling| ceiling.volume(options, volumes)).transpose();
    Ok(volume.map_err(DenseError::PageFile)?.unwrap_or_else(|| PagedVolume::new(options)))
}

fn posed<'a>(frame: &'a LoggedFrame, world_from_camera: &'a Se3) -> DenseFrame<'a> {
    let LoggedFrame { depth_m, color, moving } = frame;
    DenseFrame { depth_m, color, moving: moving.as_ref(), world_from_camera }
}
