//! Frames into a volume: which blocks a frame reaches, and what it does to those it sees.
//!
//! Four passes, each parallel over fixed pieces on the pool of the caller: pixels are packed and rays
//! mark blocks; blocks that exist take their marks away; what is left is allocated, in order; all
//! blocks in view are fused. Bits do not depend on the number of threads.

use covis_solvers::geometry::Se3;
use rayon::prelude::*;

use super::fuse::{Frame, Outcome};
use super::lanes::{Class, Kernel, Lanes};
use super::pixels::{self, BAND, PackBand, Scratch, Source};
use super::reach::{Ray, Reach};
use super::sight::{Lens, NEAREST_M, Seen, Sight};
use super::tiles::{Range, TILE, Tiles};
use super::volume::{Piece, Volume};
use crate::frontend::camera::FrameCamera;
use crate::frontend::depth::sigma_m;
use crate::frontend::image::Image;

/// Blocks that a task fuses.
const PIECE: usize = 16;
/// Blocks that a task looks up.
const CLEAR_PIECE: usize = 1024;

/// How frames become a surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IntegrationOptions {
    /// Depth beyond this is not used, meters.
    pub max_depth_m: f32,
    /// Behind a surface voxels are looked at up to the truncation, or to this many standard deviations
    /// of depth where that is more. 0: the truncation is fixed.
    pub truncation_sigmas: f32,
    /// A voxel remembers no more than this many measurements at full weight; at most 255.
    pub max_weight: f32,
    /// Whether measurements weigh less where depth is far or the surface is seen at an angle.
    pub weigh_noise: bool,
    /// Whether voxels forget what is gone, and begin anew where they see something else.
    pub dynamic: bool,
    /// What moves is taken larger by this on each side, pixels.
    pub dilation_px: usize,
}

impl Default for IntegrationOptions {
    fn default() -> Self {
        Self {
            max_depth_m: 4.0,
            truncation_sigmas: 0.0,
            max_weight: 64.0,
            weigh_noise: true,
            dynamic: true,
            dilation_px: 4,
        }
    }
}

/// A frame to be integrated. All images have the camera's size.
#[derive(Clone, Copy, Debug)]
pub struct DenseFrame<'a> {
    /// Along the optical axis, meters; what is not a number, negative or too far is not used.
    pub depth_m: &'a Image<f32>,
    /// Red, green, blue.
    pub color: &'a Image<[u8; 3]>,
    /// Not 0 where something moves: those pixels say nothing.
    pub moving: Option<&'a Image<u8>>,
    /// Where the camera is.
    pub world_from_camera: &'a Se3,
}

/// Why a frame was not integrated; the volume is as before.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum IntegrateError {
    /// An image has another size than the camera.
    #[error(
        "`{image}` is {width} × {height} pixels, the camera's images are {camera_width} × {camera_height}"
    )]
    ImageSize {
        /// Which image.
        image: &'static str,
        /// Its columns.
        width: usize,
        /// Its rows.
        height: usize,
        /// The camera's columns.
        camera_width: usize,
        /// The camera's rows.
        camera_height: usize,
    },
    /// The pose is not finite.
    #[error("`world_from_camera` is not finite")]
    Pose,
    /// The grid does not reach where the camera is.
    #[error("`world_from_camera` is too far from the origin for blocks of this size")]
    TooFar,
    /// A measure is not positive and finite, or does not fit the others.
    #[error("`{option}` is out of range")]
    Options {
        /// Which one.
        option: &'static str,
    },
}

/// Integrates frames of one camera.
#[derive(Debug)]
pub struct Integrator {
    options: IntegrationOptions,
    camera: FrameCamera,
    lens: Lens,
    pixels: Vec<u64>,
    tiles: Tiles,
    reach: Reach,
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
            tiles: Tiles::new(width, height),
            reach: Reach::default(),
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

    /// How frames become a surface.
    #[must_use]
    pub fn options(&self) -> &IntegrationOptions {
        &self.options
    }

    /// A frame into a volume, on the current pool of threads. That is one revision.
    ///
    /// # Errors
    ///
    /// Where the frame or an option makes no sense; the volume is as before then.
    pub fn integrate(
        &mut self,
        volume: &mut Volume,
        frame: &DenseFrame<'_>,
    ) -> Result<(), IntegrateError> {
        self.check(volume, frame)?;
        let block_m = volume.options().block_m();
        self.begin_reach(frame.world_from_camera, block_m, volume.options().truncation_m)?;
        self.dilated = frame.moving.map(|moving| dilated(moving, self.options.dilation_px));
        self.pack_and_mark(frame, block_m, volume.options().truncation_m);
        self.tiles.build();
        self.allocate(volume);
        self.fuse(volume, frame.world_from_camera);
        Ok(())
    }

    fn check(&self, volume: &Volume, frame: &DenseFrame<'_>) -> Result<(), IntegrateError> {
        let (camera_width, camera_height) = self.camera.size();
        let sizes = [
            ("depth_m", Some(frame.depth_m.size())),
            ("color", Some(frame.color.size())),
            ("moving", frame.moving.map(Image::size)),
        ];
        for (image, size) in sizes {
            if let Some((width, height)) = size
                && (width, height) != (camera_width, camera_height)
            {
                return Err(IntegrateError::ImageSize {
                    image,
                    width,
                    height,
                    camera_width,
                    camera_height,
                });
            }
        }
        let pose = frame.world_from_camera;
        let finite =
            pose.translation.iter().chain(pose.rotation.matrix().iter()).all(|x| x.is_finite());
        if !finite {
            return Err(IntegrateError::Pose);
        }
        let measures = volume.options();
        let positive = [
            ("voxel_m", measures.voxel_m),
            ("truncation_m", measures.truncation_m),
            ("max_depth_m", self.options.max_depth_m),
            ("max_weight", self.options.max_weight),
        ];
        for (option, value) in positive {
            if !(value > 0.0 && value.is_finite()) {
                return Err(IntegrateError::Options { option });
            }
        }
        if self.options.max_weight > 255.0 {
            return Err(IntegrateError::Options { option: "max_weight" });
        }
        if !(self.options.truncation_sigmas >= 0.0 && self.options.truncation_sigmas <= 100.0) {
            return Err(IntegrateError::Options { option: "truncation_sigmas" });
        }
        Ok(())
    }

    /// How far behind a depth voxels are looked at, meters.
    fn behind_m(&self, depth_m: f32, truncation_m: f32) -> f32 {
        let sigmas = self.options.truncation_sigmas;
        if sigmas == 0.0 {
            return truncation_m;
        }
        truncation_m.max(sigmas * sigma_m(f64::from(depth_m)) as f32)
    }

    fn begin_reach(
        &mut self,
        world_from_camera: &Se3,
        block_m: f64,
        truncation_m: f32,
    ) -> Result<(), IntegrateError> {
        let farthest = self.options.max_depth_m;
        let z = f64::from(farthest + self.behind_m(farthest, truncation_m));
        let [left, right, top, bottom] = self.lens.field.map(f64::from);
        let mut points = vec![[0.0; 3]; 5];
        let rays = [
            [0.0, 0.0, 0.0],
            [left, top, 1.0],
            [right, top, 1.0],
            [left, bottom, 1.0],
            [right, bottom, 1.0],
        ];
        for (point, ray) in points.iter_mut().zip(rays) {
            let at = world_from_camera.transform(&(nalgebra::Vector3::from(ray) * z)) / block_m;
            *point = [at.x, at.y, at.z];
        }
        self.reach.begin(&points).ok_or(IntegrateError::TooFar)
    }

    /// Packs the frame, and marks the blocks that its rays reach.
    fn pack_and_mark(&mut self, frame: &DenseFrame<'_>, block_m: f64, truncation_m: f32) {
        let (width, _) = self.camera.size();
        let stride = pixels::stride(width);
        let source = Source {
            depth_m: frame.depth_m,
            color: frame.color,
            moving: self.dilated.as_ref(),
            nearest_m: NEAREST_M,
            farthest_m: self.options.max_depth_m,
            pinhole: [self.lens.fx, self.lens.fy, self.lens.cx, self.lens.cy],
        };
        let mut tiles = std::mem::take(&mut self.tiles);
        let mut words = std::mem::take(&mut self.pixels);
        let tiles_width = tiles.width();
        let rays = Rays::new(self, frame.world_from_camera, block_m, truncation_m);
        let bands = words
            .par_chunks_mut(BAND * stride)
            .zip(tiles.smallest_mut().par_chunks_mut(BAND / TILE * tiles_width))
            .enumerate();
        bands.for_each_init(
            || Scratch::new(width),
            |scratch, (band, (out, tiles))| {
                let first_row = band * BAND;
                self.class.run(PackBand { source, first_row, scratch, out, tiles });
                rays.mark(first_row, scratch, tiles);
            },
        );
        self.tiles = tiles;
        self.pixels = words;
    }

    /// Makes the blocks that are marked and not there.
    fn allocate(&self, volume: &mut Volume) {
        volume.keys().par_chunks(CLEAR_PIECE).for_each(|keys| {
            for &key in keys {
                self.reach.clear(key);
            }
        });
        self.reach.for_each(|key| {
            volume.allocate(key);
        });
    }

    fn fuse(&self, volume: &mut Volume, world_from_camera: &Se3) {
        let measures = *volume.options();
        let sight = Sight::new(self.lens, world_from_camera, measures.block_m());
        let steps = sight.steps().map(|step| Frame::steps(&self.lens, step));
        let revision = volume.advance();
        let weight_one = f32::from(super::block::WEIGHT_ONE);
        let (full_weight_m, least_weight) =
            if self.options.weigh_noise { (1.0, 1.0) } else { (1.0, weight_one) };
        let lanes: [[f32; 16]; 3] = std::array::from_fn(|k| {
            std::array::from_fn(|i| (i % 8) as f32 * steps[0][k] + (i / 8) as f32 * steps[1][k])
        });
        let frame = Frame {
            lens: self.lens,
            pixels: &self.pixels,
            stride: pixels::stride(self.camera.size().0),
            lanes,
            spread_m: [
                lanes[2].iter().copied().fold(f32::INFINITY, f32::min),
                lanes[2].iter().copied().fold(f32::NEG_INFINITY, f32::max),
            ],
            pair: steps[1].map(|step| 2.0 * step),
            layer: steps[2],
            farthest_m: self.options.max_depth_m,
            truncation_m: measures.truncation_m,
            behind_sigmas: self.options.truncation_sigmas,
            full_weight_m,
            least_weight,
            most_weight: (self.options.max_weight * weight_one).floor(),
            near: (2.0 * measures.voxel_m / measures.truncation_m).min(1.0)
                * super::block::DISTANCE_ONE,
            slack: 3.0 / measures.truncation_m * super::block::DISTANCE_ONE,
            // Van der Corput: each share of the range comes equally often.
            dither: i32::from((revision as u8).reverse_bits()),
            is_dynamic: self.options.dynamic,
        };
        let behind_m = self.behind_m(self.options.max_depth_m, measures.truncation_m);
        let before_m = measures.truncation_m;
        let pieces = volume.pieces_mut(PIECE);
        pieces.into_par_iter().for_each(|piece| {
            let (frame, sight, tiles) = (&frame, &sight, &self.tiles);
            self.class.run(FusePiece { frame, sight, tiles, behind_m, before_m, revision, piece });
        });
    }
}

/// Fuses a frame into what it sees of a piece.
struct FusePiece<'a> {
    frame: &'a Frame<'a>,
    sight: &'a Sight,
    tiles: &'a Tiles,
    behind_m: f32,
    before_m: f32,
    revision: u64,
    piece: Piece<'a>,
}

impl Kernel for FusePiece<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, lanes: L) {
        let Piece { keys, blocks, changed, solid } = self.piece;
        let seen: [Seen; PIECE] = std::array::from_fn(|slot| {
            let corner = keys.get(slot).map(|&key| self.sight.corner(key));
            let seen = corner.map_or(Seen::No, |corner| {
                self.sight.look(corner, self.tiles, self.behind_m, self.before_m)
            });
            // Where there is nothing to forget, nothing is seen through.
            if matches!(seen, Seen::Through(_)) && !solid[slot] { Seen::No } else { seen }
        });
        for slot in 0..blocks.len() {
            let (Seen::Through(range) | Seen::Near(range)) = seen[slot] else { continue };
            if let Some(next) = (slot + 1..blocks.len()).find(|&next| seen[next] != Seen::No) {
                lanes.prefetch(&blocks[next]);
            }
            let corner = Frame::steps(&self.sight.lens, self.sight.corner(keys[slot]));
            let outcome: Outcome = self.frame.fuse(lanes, &mut blocks[slot], corner, range);
            if outcome.changed {
                changed[slot] = self.revision;
            }
            solid[slot] = (solid[slot] || outcome.solid) && !outcome.free;
        }
    }
}

/// The rays of a frame over the grid.
struct Rays<'a> {
    integrator: &'a Integrator,
    /// The camera's center and axes in blocks, from the corner of the reach.
    origin: [f32; 3],
    axes: [[f32; 3]; 3],
    /// Pixels that a block covers at one meter.
    block_px: f32,
    block_m: f32,
    truncation_m: f32,
}

impl<'a> Rays<'a> {
    fn new(
        integrator: &'a Integrator,
        world_from_camera: &Se3,
        block_m: f64,
        truncation_m: f32,
    ) -> Self {
        let corner = integrator.reach.origin();
        let center = world_from_camera.translation / block_m;
        let rotation = world_from_camera.rotation.matrix();
        Self {
            integrator,
            origin: std::array::from_fn(|k| (center[k] - f64::from(corner[k])) as f32),
            axes: std::array::from_fn(|axis| {
                std::array::from_fn(|k| (rotation[(k, axis)] / block_m) as f32)
            }),
            block_px: block_m as f32 * integrator.lens.fx.min(integrator.lens.fy),
            block_m: block_m as f32,
            truncation_m,
        }
    }

    /// Marks what the rays of a band reach: at least two a block along each axis of the image, more
    /// where depth is uneven.
    fn mark(&self, first_row: usize, scratch: &Scratch, tiles: &[Range]) {
        let rays = self.integrator.camera.rays();
        let (width, height) = rays.size();
        let tiles_width = width.div_ceil(TILE);
        let mut before = [[i32::MIN; 3]; 2];
        for (i, &[nearest, farthest]) in tiles.iter().enumerate() {
            if farthest == 0.0 {
                continue;
            }
            let (left, top) = (i % tiles_width * TILE, i / tiles_width * TILE);
            let wide = self.block_px / farthest;
            let mut step = if wide >= 16.0 {
                8
            } else if wide >= 8.0 {
                4
            } else if wide >= 4.0 {
                2
            } else {
                1
            };
            if farthest - nearest > 0.5 * self.block_m {
                step = (step / 2).max(1);
            }
            for row in (top + step / 2..top + TILE).step_by(step) {
                if first_row + row >= height {
                    break;
                }
                let depth = scratch.row(row);
                let rays = rays.row(first_row + row);
                for u in (left + step / 2..(left + TILE).min(width)).step_by(step) {
                    if depth[u] > 0.0 {
                        before = self.mark_one(rays[u], depth[u], before);
                    }
                }
            }
        }
    }

    fn mark_one(&self, [a, b]: [f32; 2], depth: f32, before: [[i32; 3]; 2]) -> [[i32; 3]; 2] {
        let [x, y, z] = self.axes;
        let direction = std::array::from_fn(|k| a * x[k] + b * y[k] + z[k]);
        let behind = self.integrator.behind_m(depth, self.truncation_m);
        let ray = Ray { origin: self.origin, direction };
        let from = (depth - self.truncation_m).max(NEAREST_M);
        self.integrator.reach.mark(&ray, from, depth + behind, before)
    }
}

/// 255 within `by` pixels of what is not 0, along rows and columns.
fn dilated(mask: &Image<u8>, by: usize) -> Image<u8> {
    let (width, height) = mask.size();
    let mut wide = Image::filled(width, height, 0);
    for v in 0..height {
        let (row, out) = (mask.row(v), wide.row_mut(v));
        // How many columns ago the last one was.
        let mut spread = |columns: &mut dyn Iterator<Item = usize>| {
            let mut left = 0;
            for u in columns {
                left = if row[u] > 0 { by + 1 } else { left };
                if left > 0 {
                    out[u] = 255;
                    left -= 1;
                }
            }
        };
        spread(&mut (0..width));
        spread(&mut (0..width).rev());
    }
    let mut tall = Image::filled(width, height, 0);
    for v in 0..height {
        let out = tall.row_mut(v);
        for row in v.saturating_sub(by)..(v + by + 1).min(height) {
            for (out, &value) in out.iter_mut().zip(wide.row(row)) {
                *out |= value;
            }
        }
    }
    tall
}
