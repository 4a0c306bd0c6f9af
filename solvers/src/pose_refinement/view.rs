//! What a pose sees: eight observations at a time, projected and whitened.
//!
//! p = R (X − c) with R = `camera_from_world` and c the camera's center; pose and camera are the
//! same in every lane. Kernels over a view are compiled for each camera model, here alone.

use super::observations::Eight;
use crate::geometry::{Camera, Se3};
use crate::lanes::models::{
    AnyLanes, LaneModel, LanePoints, LaneProjection, PARAMETERS, PinholeLanes, SnavelyLanes,
    UndistortedLanes,
};
use crate::simd::{Kernel, Lanes, WIDTH};

/// Observations, from where and by what they are seen.
#[derive(Clone, Copy)]
pub(super) struct View<'a> {
    pub(super) blocks: &'a [Eight],
    pub(super) pose: &'a Se3,
    pub(super) camera: &'a Camera,
}

/// What is done with a view, for one camera model. `run` must be `#[inline(always)]`.
pub(super) trait ViewWork {
    /// What it returns.
    type Output;
    /// Does the work.
    fn run<L: Lanes, M: LaneModel>(self, l: L, view: &View<'_>, model: M) -> Self::Output;
}

/// Work on a view as a kernel.
pub(super) struct OnView<'a, W> {
    pub(super) view: View<'a>,
    pub(super) work: W,
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
            Camera::Fisheye(_) => work.run(l, &view, AnyLanes { view_cameras: &[0] }),
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
pub(super) struct Seen<L: Lanes> {
    /// p.
    pub(super) point: [L::V; 3],
    pub(super) projection: LaneProjection<L>,
    /// Whitened (u, v, z); z's is 0 where no depth was measured.
    pub(super) residual: [L::V; 3],
    /// s, the residual's square.
    pub(super) squared: L::V,
}

impl View<'_> {
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
    ) -> Seen<L> {
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
        Seen { point, projection, residual: [u, v, depth], squared }
    }
}

/// Lists s and p_z of each observation, padded by up to seven.
pub(super) struct Fit;

impl ViewWork for Fit {
    type Output = (Vec<f64>, Vec<f64>);

    #[inline(always)]
    fn run<L: Lanes, M: LaneModel>(self, l: L, view: &View<'_>, model: M) -> (Vec<f64>, Vec<f64>) {
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
