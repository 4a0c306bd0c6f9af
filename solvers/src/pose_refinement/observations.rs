//! What a pose sees: its observations packed by eight, then projected and whitened in lanes.
//!
//! A lane an observation, in the caller's order. What weighs nothing has an infinite sigma: a depth
//! that was not measured, and the lanes past the end, which repeat the last observation's point.
//! Whether a number is finite is only noticed here; `one_by_one` says which. p = R (X − c) with
//! R = `camera_from_world` and c the camera's center; pose and camera are the same in every lane.
//! Kernels over a view are compiled for each camera model, here alone.

use super::PointObservation;
use crate::geometry::{Camera, Se3};
use crate::lanes::models::{
    AnyLanes, LaneModel, LanePoints, LaneProjection, PARAMETERS, PinholeLanes, SnavelyLanes,
    UndistortedLanes,
};
use crate::simd::{Class, Kernel, Lanes, Row, WIDTH};

/// Eight observations.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(super) struct Eight {
    pub(super) point_in_world: [Row; 3],
    pub(super) pixel: [Row; 2],
    /// 1/σ of a pixel coordinate.
    pub(super) weight: Row,
    pub(super) depth: Row,
    /// 1/σ of the depth.
    pub(super) depth_weight: Row,
}

/// The observations of one pose and the camera that made them.
pub(super) struct Observations<'a> {
    camera: &'a Camera,
    blocks: Vec<Eight>,
    count: usize,
    class: Class,
    /// Whether all numbers are finite and all sigmas positive.
    pub(super) sound: bool,
}

impl<'a> Observations<'a> {
    pub(super) fn new(camera: &'a Camera, list: &[PointObservation], class: Class) -> Self {
        let mut sound = true;
        let blocks = list.chunks(WIDTH).map(|chunk| pack(chunk, &mut sound)).collect();
        Self { camera, blocks, count: list.len(), class, sound }
    }

    /// Does `work` with what is seen from `pose`.
    pub(super) fn run<W: ViewWork>(&self, pose: &Se3, work: W) -> W::Output {
        let view = PoseObservations { blocks: &self.blocks, pose, camera: self.camera };
        self.class.run(OnView { view, work })
    }

    /// s, the whitened squared residual, and p_z of each observation at `pose`.
    pub(super) fn fit(&self, pose: &Se3) -> (Vec<f64>, Vec<f64>) {
        let (mut squared, mut depths) = self.run(pose, Fit);
        squared.truncate(self.count);
        depths.truncate(self.count);
        (squared, depths)
    }
}

/// Up to eight observations; `sound` falls where one is not fit to be solved with.
fn pack(chunk: &[PointObservation], sound: &mut bool) -> Eight {
    let mut block = Eight::default();
    let mut sigma = [f64::INFINITY; WIDTH];
    let mut sigma_depth = [f64::INFINITY; WIDTH];
    for lane in 0..WIDTH {
        let Some(o) = chunk.get(lane).or(chunk.last()) else { continue };
        for i in 0..3 {
            block.point_in_world[i][lane] = o.point_in_world[i];
        }
        for i in 0..2 {
            block.pixel[i][lane] = o.pixel[i];
        }
        if lane >= chunk.len() {
            continue;
        }
        let positive = |x: f64| x > 0.0 && x < f64::INFINITY;
        sigma[lane] = o.sigma_px;
        *sound &= positive(o.sigma_px);
        // A sum is finite only if no term is NaN or infinite.
        let mut sum = o.point_in_world.sum() + o.pixel.sum();
        if let Some((depth, sigma)) = o.depth_m {
            block.depth[lane] = depth;
            sigma_depth[lane] = sigma;
            *sound &= positive(sigma);
            sum += depth;
        }
        *sound &= sum.is_finite();
    }
    block.weight = sigma.map(|s| 1.0 / s);
    block.depth_weight = sigma_depth.map(|s| 1.0 / s);
    block
}

/// Observations, from where and by what they are seen.
#[derive(Clone, Copy)]
pub(super) struct PoseObservations<'a> {
    pub(super) blocks: &'a [Eight],
    pose: &'a Se3,
    camera: &'a Camera,
}

/// What is done with a view, for one camera model. `run` must be `#[inline(always)]`.
pub(super) trait ViewWork {
    type Output;

    fn run<L: Lanes, M: LaneModel>(
        self,
        l: L,
        view: &PoseObservations<'_>,
        model: M,
    ) -> Self::Output;
}

/// Work on a view as a kernel.
struct OnView<'a, W> {
    view: PoseObservations<'a>,
    work: W,
}

impl<W: ViewWork> Kernel for OnView<'_, W> {
    type Output = W::Output;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> W::Output {
        let Self { view, work } = self;
        match view.camera {
            Camera::Pinhole(c) if c.is_undistorted() => work.run(l, &view, UndistortedLanes),
            Camera::Pinhole(_) => work.run(l, &view, PinholeLanes),
            Camera::Snavely(_) => work.run(l, &view, SnavelyLanes),
            Camera::Fisheye(_) => {
                work.run(l, &view, AnyLanes { view_cameras: &[0], free_parameters: &[] })
            }
        }
    }
}

/// Pose and camera in every lane.
pub(super) struct Splatted<L: Lanes> {
    /// `camera_from_world` by rows.
    rotation: [L::V; 9],
    center: [L::V; 3],
    parameters: [L::V; PARAMETERS],
}

/// Eight observations from the pose.
pub(super) struct EightResiduals<L: Lanes> {
    /// p.
    pub(super) point: [L::V; 3],
    pub(super) projection: LaneProjection<L>,
    /// Whitened (u, v, z); z's is 0 where no depth was measured.
    pub(super) residual: [L::V; 3],
    /// s, the residual's square.
    pub(super) squared: L::V,
}

impl PoseObservations<'_> {
    #[inline(always)]
    pub(super) fn splat<L: Lanes>(&self, l: L) -> Splatted<L> {
        let zero = l.splat(0.0);
        let mut at =
            Splatted { rotation: [zero; 9], center: [zero; 3], parameters: [zero; PARAMETERS] };
        // Columns of world_from_camera are rows of its inverse.
        for (entry, x) in at.rotation.iter_mut().zip(&self.pose.rotation.matrix()) {
            *entry = l.splat(*x);
        }
        for (entry, x) in at.center.iter_mut().zip(&self.pose.translation) {
            *entry = l.splat(*x);
        }
        for (entry, x) in at.parameters.iter_mut().zip(&self.camera.parameters().values) {
            *entry = l.splat(*x);
        }
        at
    }

    /// Projects `block` and compares it with what was measured.
    #[inline(always)]
    pub(super) fn see<L: Lanes, M: LaneModel>(
        &self,
        l: L,
        model: M,
        at: &Splatted<L>,
        block: &Eight,
    ) -> EightResiduals<L> {
        let [x, y, z] = &block.point_in_world;
        let [cx, cy, cz] = at.center;
        let (x, y, z) = (l.sub(l.load(x), cx), l.sub(l.load(y), cy), l.sub(l.load(z), cz));
        let mut point = [x, y, z];
        for (entry, row) in point.iter_mut().zip(at.rotation.as_chunks::<3>().0) {
            *entry = l.fma(row[2], z, l.fma(row[1], y, l.mul(row[0], x)));
        }
        let cameras = std::slice::from_ref(self.camera);
        let parameters = &at.parameters;
        let points = LanePoints { point: &point, parameters, views: &[0; WIDTH], cameras };
        let projection = model.project(l, points);
        let weight = l.load(&block.weight);
        let depth_weight = l.load(&block.depth_weight);
        let u = l.mul(l.sub(projection.pixel[0], l.load(&block.pixel[0])), weight);
        let v = l.mul(l.sub(projection.pixel[1], l.load(&block.pixel[1])), weight);
        let depth = l.mul(l.sub(point[2], l.load(&block.depth)), depth_weight);
        let squared = l.fma(depth, depth, l.fma(v, v, l.mul(u, u)));
        EightResiduals { point, projection, residual: [u, v, depth], squared }
    }
}

/// Lists s and p_z of each observation, padded by up to seven.
struct Fit;

impl ViewWork for Fit {
    type Output = (Vec<f64>, Vec<f64>);

    #[inline(always)]
    fn run<L: Lanes, M: LaneModel>(
        self,
        l: L,
        view: &PoseObservations<'_>,
        model: M,
    ) -> (Vec<f64>, Vec<f64>) {
        let at = view.splat(l);
        let count = view.blocks.len() * WIDTH;
        let (mut squared, mut depths) = (vec![0.0; count], vec![0.0; count]);
        let rows = squared.as_chunks_mut().0.iter_mut().zip(depths.as_chunks_mut().0);
        for (block, (squared, depths)) in view.blocks.iter().zip(rows) {
            let seen = view.see(l, model, &at, block);
            l.store(seen.squared, squared);
            l.store(seen.point[2], depths);
        }
        (squared, depths)
    }
}
