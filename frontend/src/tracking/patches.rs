//! The patches of an alignment on one level, and the sums over their residuals.
//!
//! Patches are processed in batches, one patch per lane: all numbers of one kind are adjacent in
//! memory, so that the compiler vectorizes the loops. The steps are computed in `alignment`.

use covis_solvers::geometry::Se3;
use nalgebra::{Matrix2x3, SMatrix, SVector, Vector3};

use super::points::AlignmentPoint;
use crate::camera::FrameCamera;
use crate::image::Image;
use crate::pyramid::{scale, to_level};
use crate::shutter::Shutter;
use crate::simd::{self, Kernel};

/// Columns and rows of a patch.
const SIDE: usize = 4;
/// Pixels of a patch.
const AREA: usize = SIDE * SIDE;
/// From a patch's center to its first pixel.
const CENTER_OFFSET: f32 = 1.5;
/// Degrees of freedom of the t distribution (Kerl, Sturm and Cremers, ICRA 2013).
const DEGREES_OF_FREEDOM: f32 = 5.0;
/// Patches of a batch.
const LANES: usize = 32;
/// Products of a pixel: those of ∂residual/∂(u, v, gain, offset) with each other, the upper triangle
/// row by row, and with the residual.
const PRODUCTS: usize = 14;
/// Distinct entries of Hessian and gradient over pose, gain and offset.
const ENTRIES: usize = 44;

/// One number of each patch of a batch.
type Lanes = [f32; LANES];

/// Points of the reference as a structure of arrays.
#[derive(Clone, Debug)]
pub(super) struct Points {
    pixels: Vec<[f64; 2]>,
    coordinates: [Vec<f32>; 3],
    /// ∂(u, v)/∂ξ.
    motions: Vec<[[f32; 6]; 2]>,
}

/// Where the current image shows points, pixels of level 0; NaN where it does not.
pub(super) struct PixelPositions {
    u: Vec<f32>,
    v: Vec<f32>,
}

impl Points {
    pub(super) fn new(camera: &FrameCamera, points: &[AlignmentPoint]) -> Self {
        let mut all =
            Self { pixels: Vec::new(), coordinates: Default::default(), motions: Vec::new() };
        for AlignmentPoint { pixel, point_in_reference: point } in points {
            let Some((_, by_point)) = camera.project_with_jacobian(point) else { continue };
            let motion = by_motion(&by_point, point);
            all.pixels.push([pixel.x, pixel.y]);
            all.motions.push([0, 1].map(|axis| std::array::from_fn(|i| motion[(axis, i)] as f32)));
            for (axis, coordinates) in all.coordinates.iter_mut().enumerate() {
                coordinates.push(point[axis] as f32);
            }
        }
        all
    }

    /// Projects the points into a camera at a pose.
    pub(super) fn positions(
        &self,
        camera: &FrameCamera,
        shutter: &Shutter,
        current_from_reference: &Se3,
    ) -> PixelPositions {
        let rotation = current_from_reference.rotation.matrix();
        let rotation = [0, 1, 2].map(|i| [0, 1, 2].map(|j| rotation[(i, j)] as f32));
        let translation = current_from_reference.translation.map(|value| value as f32).into();
        simd::run(Projection { camera, shutter, rotation, translation, points: self })
    }
}

struct Projection<'a> {
    camera: &'a FrameCamera,
    shutter: &'a Shutter,
    rotation: [[f32; 3]; 3],
    translation: [f32; 3],
    points: &'a Points,
}

impl Kernel for Projection<'_> {
    type Output = PixelPositions;

    #[inline(always)]
    fn run(self) -> PixelPositions {
        let Self { camera, shutter, rotation, translation, points } = self;
        let (lens, shutter) = (camera.fast(), *shutter);
        let [x, y, z] = &points.coordinates;
        let count = x.len();
        let (mut u, mut v) = (vec![0.0; count], vec![0.0; count]);
        let points = x.iter().zip(y).zip(z);
        for (((&x, &y), &z), (u, v)) in points.zip(u.iter_mut().zip(&mut v)) {
            let mut point = translation;
            for (value, row) in point.iter_mut().zip(&rotation) {
                *value += row[0] * x + row[1] * y + row[2] * z;
            }
            [*u, *v] = shutter.project_fast(&lens, point);
        }
        PixelPositions { u, v }
    }
}

/// ∂pixel/∂ξ of a point that ξ moves: ∂pixel/∂point · [I, −p×].
fn by_motion(by_point: &Matrix2x3<f64>, p: &Vector3<f64>) -> SMatrix<f64, 2, 6> {
    let mut motion = SMatrix::<f64, 2, 6>::zeros();
    motion.fixed_view_mut::<2, 3>(0, 0).copy_from(by_point);
    for row in 0..2 {
        let d: Vector3<f64> = by_point.row(row).transpose();
        // dᵀ (ω × p) = ωᵀ (p × d).
        let turned = p.cross(&d);
        motion.fixed_view_mut::<1, 3>(row, 3).copy_from(&turned.transpose());
    }
    motion
}

/// Squares of N × N pixels, one per lane, and the fraction of a pixel at which each begins.
struct Squares<const N: usize> {
    pixels: [[[u8; LANES]; N]; N],
    between: [Lanes; 2],
    /// 1 where the square is inside the image, 0 elsewhere.
    is_inside: Lanes,
}

impl<const N: usize> Squares<N> {
    /// Reads the squares that begin at these positions.
    #[inline(always)]
    fn read(image: &Image<u8>, u: &Lanes, v: &Lanes) -> Self {
        let mut all = Self {
            pixels: [[[0; LANES]; N]; N],
            between: [[0.0; LANES]; 2],
            is_inside: [0.0; LANES],
        };
        let (width, height) = image.size();
        let (right, bottom) = (width as f32 - (N - 1) as f32, height as f32 - (N - 1) as f32);
        for lane in 0..LANES {
            let (u, v) = (u[lane], v[lane]);
            if !(u >= 0.0 && v >= 0.0 && u < right && v < bottom) {
                continue;
            }
            let (left, top) = (u as usize, v as usize);
            for (row, out) in all.pixels.iter_mut().enumerate() {
                let pixels = &image.pixels()[(top + row) * width + left..][..N];
                for (out, &pixel) in out.iter_mut().zip(pixels) {
                    out[lane] = pixel;
                }
            }
            all.between[0][lane] = u - left as f32;
            all.between[1][lane] = v - top as f32;
            all.is_inside[lane] = 1.0;
        }
        all
    }

    /// The value of a lane, interpolated between a pixel and the three to its right and below.
    #[inline(always)]
    fn value(&self, row: usize, column: usize, lane: usize) -> f32 {
        let at = |row: usize, column: usize| f32::from(self.pixels[row][column][lane]);
        let [s, t] = [self.between[0][lane], self.between[1][lane]];
        let (a, b) = (at(row, column), at(row, column + 1));
        let (c, d) = (at(row + 1, column), at(row + 1, column + 1));
        let (above, below) = (a + s * (b - a), c + s * (d - c));
        above + t * (below - above)
    }
}

/// Reference intensities and Jacobians of up to [`LANES`] points on one pyramid level.
#[derive(Clone, Debug)]
struct Batch {
    points: Vec<usize>,
    intensity: [Lanes; AREA],
    /// Per pixel of the level, along u and v.
    gradient: [[Lanes; AREA]; 2],
    /// ∂(pixel of the level)/∂ξ.
    motion: [[Lanes; 6]; 2],
}

impl Batch {
    /// Reads the patches at these positions; each lies inside the image.
    #[inline(always)]
    fn new(image: &Image<u8>, (u, v): (&Lanes, &Lanes)) -> Self {
        // One pixel more on each side for the gradients, and one for the interpolation.
        let around = Squares::<{ SIDE + 3 }>::read(image, u, v);
        let mut intensity = [[0.0; LANES]; AREA];
        let mut gradient = [[[0.0; LANES]; AREA]; 2];
        for row in 0..SIDE {
            for column in 0..SIDE {
                let at = row * SIDE + column;
                for lane in 0..LANES {
                    let value = |r: usize, c: usize| around.value(row + r, column + c, lane);
                    intensity[at][lane] = value(1, 1);
                    gradient[0][at][lane] = 0.5 * (value(1, 2) - value(1, 0));
                    gradient[1][at][lane] = 0.5 * (value(2, 1) - value(0, 1));
                }
            }
        }
        Self {
            points: Vec::with_capacity(LANES),
            intensity,
            gradient,
            motion: [[[0.0; LANES]; 6]; 2],
        }
    }
}

/// The patches of one level.
#[derive(Clone, Debug)]
pub(super) struct Patches {
    batches: Vec<Batch>,
    level: usize,
}

impl Patches {
    pub(super) fn new(image: &Image<u8>, level: usize, points: &Points) -> Self {
        Self { batches: simd::run(ReadPatches { image, level, points }), level }
    }

    /// Its level.
    pub(super) fn level(&self) -> usize {
        self.level
    }

    /// Sums over the residuals of all patches, weighted by their scale (equally where it is infinite).
    pub(super) fn sums(
        &self,
        image: &Image<u8>,
        positions: &PixelPositions,
        exposure: (f32, f32),
        scale: f32,
    ) -> Sums {
        simd::run(SumResiduals { patches: self, image, positions, exposure, scale })
    }
}

/// Reads the patches around points.
struct ReadPatches<'a> {
    image: &'a Image<u8>,
    level: usize,
    points: &'a Points,
}

impl Kernel for ReadPatches<'_> {
    type Output = Vec<Batch>;

    #[inline(always)]
    fn run(self) -> Vec<Batch> {
        let Self { image, level, points } = self;
        let first = |coordinate: f64| to_level(coordinate, level) as f32 - CENTER_OFFSET - 1.0;
        let needed = (SIDE + 2) as f32;
        let (right, bottom) = (image.width() as f32 - needed, image.height() as f32 - needed);
        let positions = points.pixels.iter().map(|&[u, v]| (first(u), first(v)));
        let is_inside =
            |&(_, (u, v)): &(usize, (f32, f32))| u >= 0.0 && v >= 0.0 && u < right && v < bottom;
        let inside: Vec<_> = positions.enumerate().filter(is_inside).collect();
        let per_pixel = 1.0 / scale(level) as f32;
        let batch = |part: &[(usize, (f32, f32))]| {
            // The patch of a lane without a point is never visible.
            let (mut u, mut v) = ([-1.0; LANES], [-1.0; LANES]);
            for (lane, &(_, pixel)) in part.iter().enumerate() {
                (u[lane], v[lane]) = pixel;
            }
            let mut batch = Batch::new(image, (&u, &v));
            for (lane, &(point, _)) in part.iter().enumerate() {
                batch.points.push(point);
                for (axis, motion) in batch.motion.iter_mut().enumerate() {
                    for (i, motion) in motion.iter_mut().enumerate() {
                        motion[lane] = points.motions[point][axis][i] * per_pixel;
                    }
                }
            }
            batch
        };
        inside.chunks(LANES).map(batch).collect()
    }
}

/// Sums over the residuals of all visible patches.
pub(super) struct Sums {
    /// Over pose, gain and offset.
    pub(super) hessian: SMatrix<f64, 8, 8>,
    pub(super) gradient: SVector<f64, 8>,
    /// Counts of absolute residuals per whole gray level.
    pub(super) histogram: [u32; 256],
    /// Patches that the image shows.
    pub(super) visible: usize,
}

/// Sums up residuals.
struct SumResiduals<'a> {
    patches: &'a Patches,
    image: &'a Image<u8>,
    positions: &'a PixelPositions,
    exposure: (f32, f32),
    scale: f32,
}

impl Kernel for SumResiduals<'_> {
    type Output = Sums;

    #[inline(always)]
    fn run(self) -> Sums {
        let mut histogram = [0_u32; 256];
        let mut visible = 0;
        let mut entries = [[0.0; LANES]; ENTRIES];
        let factor = 1.0 / scale(self.patches.level) as f32;
        let first = |coordinate: f32| (coordinate + 0.5) * factor - 0.5 - CENTER_OFFSET;
        for batch in &self.patches.batches {
            let (mut u, mut v) = ([-1.0; LANES], [-1.0; LANES]);
            for (lane, &point) in batch.points.iter().enumerate() {
                (u[lane], v[lane]) =
                    (first(self.positions.u[point]), first(self.positions.v[point]));
            }
            let seen = Squares::<{ SIDE + 1 }>::read(self.image, &u, &v);
            let mut bins = [[0_u8; LANES]; AREA];
            let products = self.products(batch, &seen, &mut bins);
            for lane in 0..LANES {
                if seen.is_inside[lane] > 0.0 {
                    visible += 1;
                    bins.iter().for_each(|bins| histogram[usize::from(bins[lane])] += 1);
                }
            }
            add_products(&products, &batch.motion, &mut entries);
        }
        let (hessian, gradient) = assembled(&entries);
        Sums { hessian, gradient, histogram, visible }
    }
}

impl SumResiduals<'_> {
    /// Sums the products of each patch; `bins` receives the absolute residuals of its pixels.
    #[inline(always)]
    fn products(
        &self,
        batch: &Batch,
        seen: &Squares<{ SIDE + 1 }>,
        bins: &mut [[u8; LANES]; AREA],
    ) -> [Lanes; PRODUCTS] {
        let (gain, offset) = self.exposure;
        let relative = 1.0 / (self.scale * self.scale);
        let mut products = [[0.0; LANES]; PRODUCTS];
        for row in 0..SIDE {
            for column in 0..SIDE {
                let at = row * SIDE + column;
                let intensity = &batch.intensity[at];
                let [along, down] = [&batch.gradient[0][at], &batch.gradient[1][at]];
                let mut residuals = [0.0; LANES];
                for lane in 0..LANES {
                    let residual = gain * intensity[lane] + offset - seen.value(row, column, lane);
                    residuals[lane] = residual;
                    let weight = seen.is_inside[lane] * (DEGREES_OF_FREEDOM + 1.0)
                        / (DEGREES_OF_FREEDOM + residual * residual * relative);
                    let d = [gain * along[lane], gain * down[lane], intensity[lane], 1.0];
                    let mut entry = 0;
                    for i in 0..4 {
                        let weighed = weight * d[i];
                        for &other in &d[i..] {
                            products[entry][lane] += weighed * other;
                            entry += 1;
                        }
                        products[10 + i][lane] += weighed * residual;
                    }
                }
                for (bin, residual) in bins[at].iter_mut().zip(&residuals) {
                    *bin = simd::floor(residual.abs().min(255.0)) as u8;
                }
            }
        }
        products
    }
}

/// Adds the entries of a batch of patches: the upper triangle of the pose's Hessian row by row, pose
/// with gain, offset and residual, then exposure.
#[inline(always)]
fn add_products(
    products: &[Lanes; PRODUCTS],
    motion: &[[Lanes; 6]; 2],
    entries: &mut [Lanes; ENTRIES],
) {
    let [uu, uv, ua, ub, vv, va, vb, aa, ab, bb, u, v, a, b] = products;
    let mut entry = 0;
    for i in 0..6 {
        let (along, down) = (&motion[0][i], &motion[1][i]);
        let (mut left, mut right) = ([0.0; LANES], [0.0; LANES]);
        for lane in 0..LANES {
            left[lane] = along[lane] * uu[lane] + down[lane] * uv[lane];
            right[lane] = along[lane] * uv[lane] + down[lane] * vv[lane];
        }
        for j in i..6 {
            add_sums(&mut entries[entry], (&left, &motion[0][j]), (&right, &motion[1][j]));
            entry += 1;
        }
        for (along_other, down_other) in [(ua, va), (ub, vb), (u, v)] {
            add_sums(&mut entries[entry], (along, along_other), (down, down_other));
            entry += 1;
        }
    }
    for other in [aa, ab, bb, a, b] {
        for lane in 0..LANES {
            entries[entry][lane] += other[lane];
        }
        entry += 1;
    }
}

/// out += a · b + c · d.
#[inline(always)]
fn add_sums(out: &mut Lanes, (a, b): (&Lanes, &Lanes), (c, d): (&Lanes, &Lanes)) {
    for lane in 0..LANES {
        out[lane] += a[lane] * b[lane] + c[lane] * d[lane];
    }
}

/// Hessian and gradient from their distinct entries.
fn assembled(entries: &[Lanes; ENTRIES]) -> (SMatrix<f64, 8, 8>, SVector<f64, 8>) {
    let mut values = entries.iter().map(|lanes| f64::from(simd::sum(lanes)));
    let mut next = || values.next().unwrap_or_default();
    let mut hessian = SMatrix::<f64, 8, 8>::zeros();
    let mut gradient = SVector::<f64, 8>::zeros();
    for i in 0..6 {
        for j in i..8 {
            hessian[(i, j)] = next();
            hessian[(j, i)] = hessian[(i, j)];
        }
        gradient[i] = next();
    }
    for (i, j) in [(6, 6), (6, 7), (7, 7)] {
        hessian[(i, j)] = next();
        hessian[(j, i)] = hessian[(i, j)];
    }
    gradient[6] = next();
    gradient[7] = next();
    (hessian, gradient)
}
