//! The frames of a capture, one by one, at one size and through one lens.
//!
//! The lens is the median of the frames' lenses; each frame is brought to it. A frame that cannot be
//! read is an answer, and the next one follows.

use std::path::Path;
use std::vec::IntoIter;

use covis_solvers::geometry::PinholeRadialTangential;

use super::container::Container;
use super::error::{CaptureError, Place};
use super::lzfse::Lzfse;
use super::numbers::Lens;
use super::resample::{Resampler, scaled, target_size};
use super::{Capture, CapturedFrame, Depth};
use crate::image::{Image, RgbdFrame};
use crate::input::folder::{ImplausibleDepth, SCALE_IMAGES};
use crate::input::{FrameError, FrameSource, SensorTiming, decode};

/// The frames of a capture.
#[derive(Debug)]
pub(super) struct CaptureFrames {
    container: Container,
    depth: Depth,
    frames: IntoIter<Result<CapturedFrame, CaptureError>>,
    /// How many there are in all.
    count: usize,
    /// The first frame's: that of all color images.
    first: Lens,
    /// What the caller knows better than the capture, in pixels of the color images.
    given: Option<PinholeRadialTangential>,
    camera: PinholeRadialTangential,
    size: (usize, usize),
    latest_s: Option<f64>,
    lzfse: Lzfse,
}

/// The median of the frames' focal lengths and principal points, with the distortion of the first.
fn median(first: &Lens, frames: &[Result<CapturedFrame, CaptureError>]) -> PinholeRadialTangential {
    let of = |number: fn(&PinholeRadialTangential) -> f64| {
        let good = frames.iter().flatten().filter(|frame| frame.lens.size == first.size);
        let mut all: Vec<f64> = good.map(|frame| number(&frame.lens.camera)).collect();
        all.sort_unstable_by(f64::total_cmp);
        all.get(all.len() / 2).copied().unwrap_or_else(|| number(&first.camera))
    };
    PinholeRadialTangential {
        fx: of(|c| c.fx),
        fy: of(|c| c.fy),
        cx: of(|c| c.cx),
        cy: of(|c| c.cy),
        ..first.camera
    }
}

/// Whether two lenses bend rays alike.
fn bend_alike(a: &PinholeRadialTangential, b: &PinholeRadialTangential) -> bool {
    let distortion = |c: &PinholeRadialTangential| [c.k1, c.k2, c.p1, c.p2, c.k3];
    distortion(a) == distortion(b)
}

impl CaptureFrames {
    /// The frames of a capture that have depth, and how many images have none. Fails where none has.
    pub(super) fn new(
        capture: Capture,
        given: Option<PinholeRadialTangential>,
    ) -> Result<(Self, usize), CaptureError> {
        let Capture { container, path, mut frames, depth, wanted } = capture;
        let images = frames.len();
        if images == 0 {
            return Err(CaptureError::Empty { path });
        }
        frames.retain(|frame| frame.as_ref().map_or(true, |frame| frame.depth.is_some()));
        let count = frames.len();
        let Some(first) = frames.iter().flatten().next().map(|frame| frame.lens) else {
            return Err(match frames.into_iter().next() {
                Some(Err(error)) => error,
                _ => CaptureError::NoDepth { path, frames: images, wanted },
            });
        };
        let size = target_size(first.size);
        let camera = scaled(&given.unwrap_or_else(|| median(&first, &frames)), first.size, size);
        let source = Self {
            container,
            depth,
            frames: frames.into_iter(),
            count,
            first,
            given,
            camera,
            size,
            latest_s: None,
            lzfse: Lzfse::default(),
        };
        Ok((source, images - count))
    }

    /// Why the usual scale of depth does not seem to be the capture's, by its first depth images.
    pub(super) fn implausible_depth(&mut self) -> Option<ImplausibleDepth> {
        let Depth::Png { units_per_m, is_usual: true } = self.depth else { return None };
        let mut values = Vec::new();
        let frames = self.frames.as_slice().iter().flatten();
        for name in frames.filter_map(|frame| frame.depth.as_ref()).take(SCALE_IMAGES) {
            let image = decode::depth(&self.container.read(name).ok()?).ok()?;
            let measured = |value: &u16| ![0, u16::MAX].contains(value);
            values.extend(image.pixels().iter().copied().filter(measured));
        }
        ImplausibleDepth::of(values, units_per_m)
    }

    fn read(&mut self, frame: &CapturedFrame) -> Result<RgbdFrame, FrameError> {
        let CapturedFrame { name, timestamp_s, color, depth, confidence, lens, .. } = frame;
        let place = || Place { path: self.container.path(color), frame: Some(name.clone()) };
        if self.latest_s.is_some_and(|latest| *timestamp_s <= latest) {
            let must = "later than the time of the frame before";
            let (field, value) = ("timestamp", *timestamp_s);
            return Err(CaptureError::Number { place: place(), field, value, must }.into());
        }
        self.latest_s = Some(*timestamp_s);
        if !bend_alike(&lens.camera, &self.first.camera) {
            return Err(CaptureError::OtherLens { place: place() }.into());
        }
        let color_path = self.container.path(color);
        let image = decode::color(&self.container.read(color)?)
            .map_err(|source| FrameError::Decode { path: color_path.clone(), source })?;
        for expected in [lens.size, self.first.size] {
            if image.size() != expected {
                return Err(FrameError::Size { path: color_path, found: image.size(), expected });
            }
        }
        let camera = self.given.unwrap_or(lens.camera);
        let resampler = Resampler::new((&camera, lens.size), (&self.camera, self.size));
        let depth = depth.as_deref().unwrap_or_default();
        let depth_m = self.depth_m(depth, confidence.as_deref(), lens.size)?;
        Ok(RgbdFrame {
            timestamp_s: *timestamp_s,
            depth_delay_s: 0.0,
            color: resampler.color(&image),
            depth_m: resampler.depth(&depth_m, 0.0),
            given_pose: frame.world_from_camera,
        })
    }

    /// Depth at its own resolution, where the sensor is sure of it.
    fn depth_m(
        &mut self,
        name: &str,
        confidence: Option<&str>,
        color: (usize, usize),
    ) -> Result<Image<f32>, FrameError> {
        let path = self.container.path(name);
        let bytes = self.container.read(name)?;
        let mut depth_m = match self.depth {
            Depth::Png { units_per_m, .. } => decode::depth(&bytes)
                .map_err(|source| FrameError::Decode { path: path.clone(), source })?
                .map(|value| if value == u16::MAX { 0.0 } else { f32::from(value) / units_per_m }),
            Depth::Lzfse { size } => self.lzfse.depth(&bytes, size, &path)?,
        };
        check_shape(&path, depth_m.size(), color)?;
        let Some(name) = confidence else { return Ok(depth_m) };
        let path = self.container.path(name);
        let bytes = self.container.read(name)?;
        let confidence = match self.depth {
            Depth::Png { .. } => decode::mask(&bytes)
                .map_err(|source| FrameError::Decode { path: path.clone(), source })?,
            Depth::Lzfse { size } => self.lzfse.confidence(&bytes, size, &path)?,
        };
        if confidence.size() != depth_m.size() {
            let (found, expected) = (confidence.size(), depth_m.size());
            return Err(FrameError::Size { path, found, expected });
        }
        for (depth, &confidence) in depth_m.pixels_mut().iter_mut().zip(confidence.pixels()) {
            if confidence == 0 {
                *depth = 0.0;
            }
        }
        Ok(depth_m)
    }
}

/// Depth must have the shape of its color image, to a pixel of either.
fn check_shape(
    path: &Path,
    depth: (usize, usize),
    color: (usize, usize),
) -> Result<(), CaptureError> {
    let difference = (depth.0 * color.1).abs_diff(depth.1 * color.0);
    if difference <= color.0.max(color.1) {
        return Ok(());
    }
    Err(CaptureError::Shape { path: path.to_owned(), depth, color })
}

impl FrameSource for CaptureFrames {
    fn camera(&self) -> &PinholeRadialTangential {
        &self.camera
    }

    /// A capture does not say: rows and depth are taken at the timestamps.
    fn timing(&self) -> SensorTiming {
        SensorTiming::default()
    }

    fn len(&self) -> usize {
        self.count
    }

    fn next_frame(&mut self) -> Option<Result<RgbdFrame, FrameError>> {
        let frame = self.frames.next()?;
        Some(frame.map_err(FrameError::from).and_then(|frame| self.read(&frame)))
    }
}
