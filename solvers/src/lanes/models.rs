//! Camera models with a lane an observation.
//!
//! Snavely's and the pinhole model are written out; every other model, and mixtures, go through the
//! geometry floor lane by lane. Points behind the camera project like any other, as in that floor.

use crate::geometry::{Camera, FreeParameters};
use crate::simd::{Lanes, Row, Scalar, WIDTH};

/// Most parameters of a camera model.
pub(crate) const PARAMETERS: usize = 9;

/// Pixels and Jacobians of eight points.
pub(crate) struct LaneProjection<L: Lanes> {
    pub(crate) pixel: [L::V; 2],
    pub(crate) d_point: [[L::V; 3]; 2],
    /// By the unknowns of the cameras; zeros after the last.
    pub(crate) d_unknowns: [[L::V; PARAMETERS]; 2],
}

/// Eight points and the cameras that see them.
pub(crate) struct LanePoints<'a, L: Lanes> {
    /// In their cameras' frames.
    pub(crate) point: &'a [L::V; 3],
    /// Of their cameras.
    pub(crate) parameters: &'a [L::V; PARAMETERS],
    pub(crate) views: &'a [u32; WIDTH],
    pub(crate) cameras: &'a [Camera],
}

/// A camera model over lanes.
pub(crate) trait LaneModel: Copy + Send + Sync {
    /// How many camera parameters it reads from the view record.
    const PARAMETERS: usize;

    /// Projects eight points.
    fn project<L: Lanes>(&self, l: L, points: LanePoints<'_, L>) -> LaneProjection<L>;
}

/// (x, y) = (p_x, p_y) / p_z, and 1 / p_z.
#[inline(always)]
fn divided<L: Lanes>(l: L, point: &[L::V; 3]) -> ([L::V; 2], L::V) {
    let inverse_depth = l.div(l.splat(1.0), point[2]);
    ([l.mul(point[0], inverse_depth), l.mul(point[1], inverse_depth)], inverse_depth)
}

/// A row ∂(u or v)/∂(x, y) taken to ∂/∂p, with (x, y) = (p_x, p_y) / p_z.
#[inline(always)]
fn through_division<L: Lanes>(
    l: L,
    [a, b]: [L::V; 2],
    [x, y]: [L::V; 2],
    inverse_depth: L::V,
) -> [L::V; 3] {
    let down = l.sub(l.splat(0.0), l.fma(a, x, l.mul(b, y)));
    [l.mul(a, inverse_depth), l.mul(b, inverse_depth), l.mul(down, inverse_depth)]
}

/// Every camera is [`Camera::Snavely`]: pixel = f (1 + k1 n + k2 n²) (x, y), n = x² + y².
#[derive(Clone, Copy)]
pub(crate) struct SnavelyLanes;

impl LaneModel for SnavelyLanes {
    const PARAMETERS: usize = 3;

    #[inline(always)]
    fn project<L: Lanes>(&self, l: L, points: LanePoints<'_, L>) -> LaneProjection<L> {
        let [f, k1, k2, ..] = *points.parameters;
        let zero = l.splat(0.0);
        let ([x, y], inverse_depth) = divided(l, points.point);
        let n = l.fma(x, x, l.mul(y, y));
        let radial = l.fma(n, l.fma(n, k2, k1), l.splat(1.0));
        // 2 ∂radial/∂n.
        let slope = l.mul(l.splat(2.0), l.fma(l.add(n, n), k2, k1));
        let scale = l.mul(f, radial);
        let (slope_x, slope_y) = (l.mul(l.mul(f, slope), x), l.mul(l.mul(f, slope), y));
        let uu = l.fma(slope_x, x, scale);
        let uv = l.mul(slope_x, y);
        let vv = l.fma(slope_y, y, scale);
        let mut d_unknowns = [[zero; PARAMETERS]; 2];
        for (row, along) in d_unknowns.iter_mut().zip([x, y]) {
            row[0] = l.mul(radial, along);
            row[1] = l.mul(l.mul(f, n), along);
            row[2] = l.mul(l.mul(l.mul(f, n), n), along);
        }
        LaneProjection {
            pixel: [l.mul(scale, x), l.mul(scale, y)],
            d_point: [
                through_division(l, [uu, uv], [x, y], inverse_depth),
                through_division(l, [uv, vv], [x, y], inverse_depth),
            ],
            d_unknowns,
        }
    }
}

/// Every camera is [`Camera::Pinhole`] and known; parameters fx fy cx cy k1 k2 p1 p2 k3.
#[derive(Clone, Copy)]
pub(crate) struct PinholeLanes;

impl LaneModel for PinholeLanes {
    const PARAMETERS: usize = 9;

    #[inline(always)]
    fn project<L: Lanes>(&self, l: L, points: LanePoints<'_, L>) -> LaneProjection<L> {
        let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = *points.parameters;
        let zero = l.splat(0.0);
        let one = l.splat(1.0);
        let two = l.splat(2.0);
        let ([x, y], inverse_depth) = divided(l, points.point);
        let n = l.fma(x, x, l.mul(y, y));
        let radial = l.fma(n, l.fma(n, l.fma(n, k3, k2), k1), one);
        // ∂radial/∂n = k1 + 2 k2 n + 3 k3 n².
        let slope = l.fma(n, l.fma(l.mul(l.splat(3.0), n), k3, l.mul(two, k2)), k1);
        let xy2 = l.mul(l.mul(two, x), y);
        let xx2 = l.fma(l.mul(two, x), x, n);
        let yy2 = l.fma(l.mul(two, y), y, n);
        let u = l.fma(p2, xx2, l.fma(p1, xy2, l.mul(x, radial)));
        let v = l.fma(p2, xy2, l.fma(p1, yy2, l.mul(y, radial)));
        let (p1x, p1y) = (l.mul(l.mul(two, p1), x), l.mul(l.mul(two, p1), y));
        let (p2x, p2y) = (l.mul(l.mul(two, p2), x), l.mul(l.mul(two, p2), y));
        let slope2 = l.mul(two, slope);
        let cross = l.fma(l.mul(slope2, x), y, l.add(p1x, p2y));
        let three = l.splat(3.0);
        let uu = l.add(l.fma(l.mul(slope2, x), x, radial), l.fma(three, p2x, p1y));
        let vv = l.add(l.fma(l.mul(slope2, y), y, radial), l.fma(three, p1y, p2x));
        LaneProjection {
            pixel: [l.fma(fx, u, cx), l.fma(fy, v, cy)],
            d_point: [
                through_division(l, [l.mul(fx, uu), l.mul(fx, cross)], [x, y], inverse_depth),
                through_division(l, [l.mul(fy, cross), l.mul(fy, vv)], [x, y], inverse_depth),
            ],
            d_unknowns: [[zero; PARAMETERS]; 2],
        }
    }
}

/// Every camera is [`Camera::Pinhole`], known and without distortion; parameters fx fy cx cy.
#[derive(Clone, Copy)]
pub(crate) struct UndistortedLanes;

impl LaneModel for UndistortedLanes {
    const PARAMETERS: usize = 4;

    #[inline(always)]
    fn project<L: Lanes>(&self, l: L, points: LanePoints<'_, L>) -> LaneProjection<L> {
        let [fx, fy, cx, cy, ..] = *points.parameters;
        let zero = l.splat(0.0);
        let ([x, y], inverse_depth) = divided(l, points.point);
        let (du, dv) = (l.mul(fx, inverse_depth), l.mul(fy, inverse_depth));
        LaneProjection {
            pixel: [l.fma(fx, x, cx), l.fma(fy, y, cy)],
            d_point: [[du, zero, l.fnma(du, x, zero)], [zero, dv, l.fnma(dv, y, zero)]],
            d_unknowns: [[zero; PARAMETERS]; 2],
        }
    }
}

/// Any camera in any lane, through the geometry floor.
#[derive(Clone, Copy)]
pub(crate) struct AnyLanes<'a> {
    /// The camera of each view.
    pub(crate) view_cameras: &'a [u32],
    /// Of each camera, or empty where every parameter is free.
    pub(crate) free_parameters: &'a [FreeParameters],
}

impl LaneModel for AnyLanes<'_> {
    const PARAMETERS: usize = 0;

    #[inline(always)]
    fn project<L: Lanes>(&self, l: L, points: LanePoints<'_, L>) -> LaneProjection<L> {
        let mut point = [[0.0; WIDTH]; 3];
        for (row, v) in point.iter_mut().zip(points.point) {
            l.store(*v, row);
        }
        let out = self.each(points.cameras, points.views, &point);
        let mut d_unknowns = [[l.splat(0.0); PARAMETERS]; 2];
        let mut d_point = [[l.splat(0.0); 3]; 2];
        for r in 0..2 {
            for c in 0..3 {
                d_point[r][c] = l.load(&out.d_point[r][c]);
            }
            for c in 0..PARAMETERS {
                d_unknowns[r][c] = l.load(&out.d_unknowns[r][c]);
            }
        }
        LaneProjection {
            pixel: [l.load(&out.pixel[0]), l.load(&out.pixel[1])],
            d_point,
            d_unknowns,
        }
    }
}

impl AnyLanes<'_> {
    /// A projection that is not finite becomes NaN, which makes the cost infinite.
    #[inline(never)]
    fn each(
        &self,
        cameras: &[Camera],
        views: &[u32; WIDTH],
        points: &[Row; 3],
    ) -> LaneProjection<Scalar> {
        let mut out = LaneProjection::<Scalar> {
            pixel: [[f64::NAN; WIDTH]; 2],
            d_point: [[[0.0; WIDTH]; 3]; 2],
            d_unknowns: [[[0.0; WIDTH]; PARAMETERS]; 2],
        };
        for lane in 0..WIDTH {
            let index = self.view_cameras[views[lane] as usize] as usize;
            let camera = &cameras[index];
            let point = nalgebra::Vector3::new(points[0][lane], points[1][lane], points[2][lane]);
            let Some(projection) = camera.project_with_jacobians(&point) else { continue };
            let d_unknowns = match self.free_parameters.get(index) {
                Some(free) => free.of_unknowns(&projection.d_parameters),
                None => projection.d_parameters,
            };
            for r in 0..2 {
                out.pixel[r][lane] = projection.pixel[r];
                for c in 0..3 {
                    out.d_point[r][c][lane] = projection.d_point[(r, c)];
                }
                for c in 0..PARAMETERS {
                    out.d_unknowns[r][c][lane] = d_unknowns[(r, c)];
                }
            }
        }
        out
    }
}
