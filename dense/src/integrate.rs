//! Integrates frames into a volume: finds the blocks that a frame reaches, and updates those it sees.
//!
//! Four passes, each parallel over fixed pieces on the pool of the caller: pixels are packed and rays
//! mark blocks; existing blocks clear their marks; the blocks still marked are allocated, in order; all
//! blocks in view are fused. Results do not depend on the number of threads, to the bit. A pose is
//! taken as it is given.

use std::sync::{Mutex, PoisonError};

use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::Vector3;
use rayon::prelude::*;

use super::block::{DISTANCE_ONE, WEIGHT_ONE};
use super::fuse::{Frame, Outcome};
use covis_solvers::simd::Class;

use super::lanes::{self, Kernel, Lanes};
use super::pages::PageError;
use super::pixels::{self, BAND, PackBand, Scratch, Source, dilated};
use super::rays::{RayBlocks, Rays};
use super::tiles::{TILE, Tiles};
use super::update::Rules;
use super::visibility::{BlockVisibility, Frustum, Lens, Visibility};
use super::volume::{Piece, Volume, VolumeOptions};
use crate::camera::FrameCamera;
use crate::image::Image;

/// Blocks that a task fuses.
const PIECE: usize = 16;
/// A block with changes of color only counts as changed when these sum up to this much over frames:
/// eight levels of gray, by [`Lanes::color_difference`]. A surface of the block never shows a color
/// that is off by more.
const VISIBLE: u32 = 32;
/// The mask of what moves is dilated by this much, pixels.
const DILATION_PX: usize = 4;
/// Blocks that a task looks up.
const CLEAR_PIECE: usize = 1024;

/// Options of integration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IntegrationOptions {
    /// Depth beyond this is not used, meters; 0.1 to 30. Depth is rounded to this / 65535.
    pub max_depth_m: f32,
    /// Largest weight of a voxel, in measurements at full weight, 1 to 255.
    pub max_weight: f32,
    /// Whether measurements have less weight where depth is large or the surface is oblique.
    pub weigh_noise: bool,
}

impl Default for IntegrationOptions {
    fn default() -> Self {
        Self { max_depth_m: 4.0, max_weight: 64.0, weigh_noise: true }
    }
}

impl IntegrationOptions {
    /// The name of the first option or measure that is out of range.
    pub(super) fn refused(&self, measures: &VolumeOptions) -> Option<&'static str> {
        let within = |x: f32, least: f32, most: f32| x >= least && x <= most;
        let measures = [
            ("voxel_m", measures.voxel_m > 0.0 && measures.voxel_m.is_finite()),
            ("truncation_m", measures.truncation_m > 0.0 && measures.truncation_m.is_finite()),
            ("max_depth_m", within(self.max_depth_m, 0.1, 30.0)),
            ("max_weight", within(self.max_weight, 1.0, 255.0)),
        ];
        measures.into_iter().find_map(|(name, is_good)| (!is_good).then_some(name))
    }
}

/// A frame to be integrated. All images have the camera's size.
#[derive(Clone, Copy, Debug)]
pub struct DenseFrame<'a> {
    /// Along the optical axis, meters; NaN, negative and too large values are ignored.
    pub depth_m: &'a Image<f32>,
    /// Red, green, blue.
    pub color: &'a Image<[u8; 3]>,
    /// Not 0 where something moves: those pixels are ignored.
    pub moving: Option<&'a Image<u8>>,
    /// The pose of the camera.
    pub world_from_camera: &'a Se3,
}

/// Why a frame was not integrated; the volume is unchanged.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum IntegrateError {
    /// An image has another size than the camera: columns and rows of both.
    #[error(
        "`{image}` is {} × {} pixels, the camera's images are {} × {}",
        size.0, size.1, camera.0, camera.1
    )]
    ImageSize {
        /// Which image.
        image: &'static str,
        /// Its size.
        size: (usize, usize),
        /// The camera's.
        camera: (usize, usize),
    },
    /// The pose is not finite.
    #[error("`world_from_camera` is not finite")]
    Pose,
    /// The grid does not reach where the camera is.
    #[error("`world_from_camera` is too far from the origin for blocks of this size")]
    TooFar,
    /// A measure or an option is out of its range.
    #[error("`{option}` is out of range")]
    Options {
        /// Which one.
        option: &'static str,
    },
    /// Blocks that the frame needs cannot be read from disk, or others have no room there.
    #[error(transparent)]
    Pages(#[from] PageError),
}

/// Integrates frames of one camera.
#[derive(Debug)]
pub struct Integrator {
    options: IntegrationOptions,
    camera: FrameCamera,
    lens: Lens,
    pixels: Vec<u64>,
    /// Buffers that no task uses now: the first access to fresh memory takes longer than packing a band.
    scratches: Mutex<Vec<Scratch>>,
    tiles: Tiles,
    ray_blocks: RayBlocks,
    /// The dilated mask of the current frame.
    dilated: Option<Image<u8>>,
    class: Class,
}

impl Integrator {
    /// For frames of this camera.
    #[must_use]
    pub fn new(camera: &FrameCamera, options: IntegrationOptions) -> Self {
        let (width, height) = camera.size();
        Self {
            options,
            camera: camera.clone(),
            lens: Lens::new(camera),
            pixels: vec![0; pixels::stride(width) * height],
            scratches: Mutex::default(),
            tiles: Tiles::new(width, height),
            ray_blocks: RayBlocks::default(),
            dilated: None,
            class: Class::detect(),
        }
    }

    /// As [`Integrator::new`] with vectors of this class.
    #[cfg(test)]
    pub(super) fn with_class(mut self, class: Class) -> Self {
        self.class = class;
        self
    }

    /// Integrates a frame into a volume, on the current pool of threads. This is one revision.
    ///
    /// # Errors
    /// The frame or an option is invalid; the volume is unchanged then.
    pub fn integrate(
        &mut self,
        volume: &mut Volume,
        frame: &DenseFrame<'_>,
    ) -> Result<(), IntegrateError> {
        self.check(volume.options(), frame)?;
        let measures = *volume.options();
        // All blocks that the camera may see.
        let z = f64::from(self.farthest_m(&measures));
        let [left, right, top, bottom] = self.lens.field.map(f64::from);
        let rays = [
            [0.0, 0.0, 0.0],
            [left, top, 1.0],
            [right, top, 1.0],
            [left, bottom, 1.0],
            [right, bottom, 1.0],
        ];
        let points = rays.map(|ray| {
            (frame.world_from_camera.transform(&(Vector3::from(ray) * z)) / measures.block_m())
                .into()
        });
        self.ray_blocks.begin(&points).ok_or(IntegrateError::TooFar)?;
        self.dilated = frame.moving.map(|moving| dilated(moving, DILATION_PX));
        self.pack_and_mark(frame, &measures);
        self.tiles.build();
        let keys = volume.keys().par_iter().with_min_len(CLEAR_PIECE);
        keys.for_each(|&key| self.ray_blocks.clear(key));
        self.ray_blocks.for_each(|key| {
            volume.allocate(key);
        });
        self.fuse(volume, frame.world_from_camera);
        Ok(())
    }

    fn check(
        &self,
        measures: &VolumeOptions,
        frame: &DenseFrame<'_>,
    ) -> Result<(), IntegrateError> {
        let camera = self.camera.size();
        let sizes = [
            ("depth_m", frame.depth_m.size()),
            ("color", frame.color.size()),
            ("moving", frame.moving.map_or(camera, Image::size)),
        ];
        if let Some(&(image, size)) = sizes.iter().find(|&&(_, size)| size != camera) {
            return Err(IntegrateError::ImageSize { image, size, camera });
        }
        if !frame.world_from_camera.is_finite() {
            return Err(IntegrateError::Pose);
        }
        match self.options.refused(measures) {
            Some(option) => Err(IntegrateError::Options { option }),
            None => Ok(()),
        }
    }

    /// The space that a frame may change, or why the frame or an option is invalid.
    pub(super) fn frustum(
        &self,
        measures: &VolumeOptions,
        frame: &DenseFrame<'_>,
    ) -> Result<Frustum, IntegrateError> {
        self.check(measures, frame)?;
        let farthest_m = f64::from(self.farthest_m(measures));
        // One pixel beyond the centers of the outermost pixels, and a little more.
        let wider = 0.02 + 1.0 / f64::from(self.lens.fx.min(self.lens.fy));
        Ok(Frustum::new(self.lens.field, wider, frame.world_from_camera, farthest_m))
    }

    /// The depth up to which voxels are updated, meters.
    fn farthest_m(&self, measures: &VolumeOptions) -> f32 {
        self.options.max_depth_m + measures.truncation_m
    }

    /// Packs the frame, and marks the blocks that its rays reach.
    fn pack_and_mark(&mut self, frame: &DenseFrame<'_>, measures: &VolumeOptions) {
        let (width, _) = self.camera.size();
        let stride = pixels::stride(width);
        let source = Source {
            depth_m: frame.depth_m,
            color: frame.color,
            moving: self.dilated.as_ref(),
            farthest_m: self.options.max_depth_m,
            pinhole: [self.lens.fx, self.lens.fy, self.lens.cx, self.lens.cy],
        };
        let rays = Rays::new(&self.ray_blocks, &self.camera, frame.world_from_camera, measures);
        let tiles_a_band = BAND / TILE * self.tiles.width();
        let bands = self.pixels.par_chunks_mut(BAND * stride);
        let bands = bands.zip(self.tiles.smallest_mut().par_chunks_mut(tiles_a_band));
        let scratches = || self.scratches.lock().unwrap_or_else(PoisonError::into_inner);
        bands.enumerate().for_each(|(band, (out, tiles))| {
            let first_row = band * BAND;
            let mut scratch = scratches().pop().unwrap_or_else(|| Scratch::new(width));
            lanes::run(
                self.class,
                PackBand { source, first_row, scratch: &mut scratch, out, tiles },
            );
            rays.mark(first_row, &scratch, tiles);
            scratches().push(scratch);
        });
    }

    fn fuse(&self, volume: &mut Volume, world_from_camera: &Se3) {
        let measures = *volume.options();
        let visibility = Visibility::new(self.lens, world_from_camera, measures.block_m());
        let steps = visibility.steps().map(|step| Frame::steps(&self.lens, step));
        let revision = volume.advance();
        let weight_one = f32::from(WEIGHT_ONE);
        let lanes: [[f32; 16]; 3] = std::array::from_fn(|k| {
            std::array::from_fn(|i| (i % 8) as f32 * steps[0][k] + (i / 8) as f32 * steps[1][k])
        });
        let frame = Frame {
            lens: self.lens,
            pixels: &self.pixels,
            stride: pixels::stride(self.camera.size().0),
            lanes,
            spread_m: [
                lanes[2].into_iter().fold(f32::INFINITY, f32::min),
                lanes[2].into_iter().fold(f32::NEG_INFINITY, f32::max),
            ],
            pair: steps[1].map(|step| 2.0 * step),
            layer: steps[2],
            farthest_m: self.options.max_depth_m,
            truncation_m: measures.truncation_m,
            least_weight: if self.options.weigh_noise { 1.0 } else { weight_one },
            rules: Rules {
                most_weight: (self.options.max_weight * weight_one).floor(),
                near: (2.0 * measures.voxel_m / measures.truncation_m).min(1.0) * DISTANCE_ONE,
                slack: 3.0 / measures.truncation_m * DISTANCE_ONE,
                // Van der Corput sequence: values are evenly distributed over the range.
                dither: i32::from((revision as u8).reverse_bits()),
            },
        };
        let (frame, visibility, tiles) = (&frame, &visibility, &self.tiles);
        volume.pieces_mut(PIECE).for_each(|piece| {
            lanes::run(
                self.class,
                FusePiece {
                    frame,
                    visibility,
                    tiles,
                    truncation_m: measures.truncation_m,
                    revision,
                    piece,
                },
            );
        });
    }
}

/// Fuses a frame into the blocks of a piece that it sees.
struct FusePiece<'a> {
    frame: &'a Frame<'a>,
    visibility: &'a Visibility,
    tiles: &'a Tiles,
    truncation_m: f32,
    revision: u64,
    piece: Piece<'a>,
}

impl Kernel for FusePiece<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Piece { keys, blocks, states } = self.piece;
        let seen: [BlockVisibility; PIECE] = std::array::from_fn(|slot| {
            let corner = keys.get(slot).map(|&key| self.visibility.corner(key));
            let seen = corner.map_or(BlockVisibility::No, |corner| {
                self.visibility.look(corner, self.tiles, self.truncation_m)
            });
            // In a block without solid voxels, seeing through it changes nothing.
            match seen {
                BlockVisibility::Through(_) if !states[slot].is_solid => BlockVisibility::No,
                BlockVisibility::Through(_) | BlockVisibility::Near(_) | BlockVisibility::No => {
                    seen
                }
            }
        });
        for slot in 0..blocks.len() {
            let (BlockVisibility::Through(range) | BlockVisibility::Near(range)) = seen[slot]
            else {
                continue;
            };
            if let Some(next) =
                (slot + 1..blocks.len()).find(|&next| seen[next] != BlockVisibility::No)
            {
                lanes.prefetch(&blocks[next]);
            }
            let corner = Frame::steps(&self.visibility.lens, self.visibility.corner(keys[slot]));
            let outcome: Outcome = self.frame.fuse(lanes, &mut blocks[slot], corner, range);
            let state = &mut states[slot];
            let moved = u32::from(state.recolored) + outcome.recolored;
            if outcome.changed || moved >= VISIBLE {
                (state.changed, state.recolored) = (self.revision, 0);
            } else {
                state.recolored = moved as u8;
            }
            state.is_solid = (state.is_solid || outcome.solid) && !outcome.free;
        }
    }
}
