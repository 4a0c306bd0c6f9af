//! Eight observations at a time: residuals and Jacobians with a lane an observation.
//!
//! p = R (X − c) with R = `camera_from_world` and c the camera's center. With J = ∂π/∂p whitened by
//! the sigmas, the rows are ∂r/∂t = −J, ∂r/∂φ = J p^ and ∂r/∂X = J R. Depth observations add the row
//! (p_z − d)/σ_d. Losses are folded in. Landmarks and views do not matter here: lanes
//! are neighbors in the sorted order, whatever they see.

use super::sorted::{GROUPS, Sorted};
use crate::geometry::{Camera, FreeParameters, Se3};
use crate::lanes::models::{
    AnyLanes, LaneModel, LanePoints, PARAMETERS, PinholeLanes, SnavelyLanes,
};
use crate::loss::Loss;
use crate::simd::{Class, Kernel, Lanes, Row, Subroutine, WIDTH};

/// A view as the kernels read it: R by rows (9), c (3), camera parameters (9), padding.
pub(super) type ViewRecord = [Row; 3];

/// Fills the record of a view.
pub(super) fn view_record(pose: &Se3, camera: &Camera) -> ViewRecord {
    let mut flat = [0.0; 3 * WIDTH];
    let world_from_camera = pose.rotation.matrix();
    for row in 0..3 {
        for column in 0..3 {
            flat[3 * row + column] = world_from_camera[(column, row)];
        }
        flat[9 + row] = pose.translation[row];
    }
    let parameters = camera.parameters();
    flat[12..12 + parameters.len()].copy_from_slice(&parameters);
    let mut record = [[0.0; WIDTH]; 3];
    for (target, source) in record.iter_mut().zip(flat.chunks_exact(WIDTH)) {
        target.copy_from_slice(source);
    }
    record
}

/// Which formulas project the observations of a problem.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Model {
    /// Every camera is [`Camera::Snavely`], with all parameters free or all cameras constant.
    Snavely,
    /// Every camera is [`Camera::Pinhole`] and known.
    Pinhole,
    /// Any cameras.
    Any,
}

/// What all kernels read.
#[derive(Clone, Copy)]
pub(super) struct Inputs<'a> {
    pub(super) sorted: &'a Sorted,
    pub(super) records: &'a [ViewRecord],
    pub(super) cameras: &'a [Camera],
    /// As those of the problem.
    pub(super) free_parameters: &'a [FreeParameters],
    /// Four numbers a landmark, in sorted order: x, y, z and one that is not read; padded by four.
    pub(super) points: &'a [f64],
    pub(super) loss: Loss,
    /// See [`System::set_stiffness`](crate::optimizer::System::set_stiffness).
    pub(super) stiffness: f64,
    pub(super) model: Model,
    /// The camera of each view.
    pub(super) view_cameras: &'a [u32],
}

impl<'a> Inputs<'a> {
    #[inline(always)]
    fn any(&self) -> AnyLanes<'a> {
        let Self { view_cameras, free_parameters, .. } = *self;
        AnyLanes { view_cameras, free_parameters }
    }

    /// Runs a kernel that linearizes, by code of its own for the problem's cameras where there is one.
    pub(super) fn run<K: LinearizingKernel>(&self, class: Class, kernel: K) -> K::Output {
        let is_special = match self.model {
            // Their three unknowns are three columns.
            Model::Snavely => K::COLUMNS == 9 || (K::COLUMNS == 6 && K::ROWS == 2),
            Model::Pinhole => K::COLUMNS == 6,
            Model::Any => false,
        };
        // The first condition is known to the compiler: it makes no special code for wider views.
        if const { K::COLUMNS <= 9 } && is_special && self.loss == Loss::Trivial {
            class.run(Compiled::<K, true>(kernel))
        } else {
            class.run(Compiled::<K, false>(kernel))
        }
    }
}

/// A kernel that linearizes. It is compiled twice: SPECIAL for the cameras of most problems without a
/// loss, and for everything else. The scalar class has only the latter.
pub(super) trait LinearizingKernel {
    /// Columns of a view.
    const COLUMNS: usize;
    /// Rows of an observation.
    const ROWS: usize;
    type Output;
    /// Must be `#[inline(always)]` down to the operations.
    fn run<L: Lanes, const SPECIAL: bool>(self, l: L) -> Self::Output;
}

struct Compiled<K, const SPECIAL: bool>(K);

impl<K: LinearizingKernel, const SPECIAL: bool> Kernel for Compiled<K, SPECIAL> {
    type Output = K::Output;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> K::Output {
        if const { L::IS_FALLBACK } {
            return general(self.0, l);
        }
        self.0.run::<L, SPECIAL>(l)
    }
}

/// A kernel for all cameras, as a function that both kinds share.
#[inline(never)]
fn general<K: LinearizingKernel, L: Lanes>(kernel: K, l: L) -> K::Output {
    kernel.run::<L, false>(l)
}

/// The Jacobians of eight observations, R rows each.
pub(super) struct Linearized<L: Lanes, const R: usize> {
    pub(super) residual: [L::V; R],
    /// ∂r/∂(t, φ).
    pub(super) pose: [[L::V; 6]; R],
    /// ∂r/∂ unknowns of the camera.
    pub(super) camera: [[L::V; PARAMETERS]; R],
    /// ∂r/∂X.
    pub(super) landmark: [[L::V; 3]; R],
}

impl<L: Lanes, const R: usize> Linearized<L, R> {
    /// Column `i` of row `r` of ∂r/∂(pose, camera); zero from column `end` on.
    #[inline(always)]
    pub(super) fn column(&self, l: L, r: usize, i: usize, end: usize) -> L::V {
        match i.checked_sub(6) {
            None => self.pose[r][i],
            Some(c) if i < end && c < PARAMETERS => self.camera[r][c],
            Some(_) => l.splat(0.0),
        }
    }

    /// J_lᵀ x in the first three, zeros after.
    #[inline(always)]
    pub(super) fn onto_landmark(&self, l: L, x: [L::V; R]) -> [L::V; WIDTH] {
        let mut sums = [l.splat(0.0); WIDTH];
        for r in 0..R {
            for c in 0..3 {
                sums[c] = l.fma(self.landmark[r][c], x[r], sums[c]);
            }
        }
        sums
    }
}

/// A lane a view record: the first 8·N numbers of the views of eight observations.
#[inline(always)]
fn gather<L: Lanes>(l: L, records: &[ViewRecord], views: &[u32; WIDTH], row: usize) -> [L::V; 8] {
    let mut rows = [l.splat(0.0); WIDTH];
    for (target, &view) in rows.iter_mut().zip(views) {
        *target = l.load(&records[view as usize][row]);
    }
    l.transpose(rows)
}

/// Eight consecutive numbers of a padded array.
#[inline(always)]
pub(super) fn eight(values: &[f64], first: usize) -> &Row {
    // The arrays are padded by eight, so that the fallback is never taken.
    values[first..].first_chunk().unwrap_or(&[0.0; WIDTH])
}

/// Eight consecutive indices of a padded array.
#[inline(always)]
pub(super) fn eight_indices(indices: &[u32], first: usize) -> &[u32; WIDTH] {
    indices[first..].first_chunk().unwrap_or(&[0; WIDTH])
}

/// Where the eight observations stand and what they see.
struct GatheredInputs<L: Lanes> {
    rotation: [L::V; 9],
    point: [L::V; 3],
    parameters: [L::V; PARAMETERS],
    views: [u32; WIDTH],
}

impl<L: Lanes> GatheredInputs<L> {
    #[inline(always)]
    fn points<'a>(&'a self, cameras: &'a [Camera]) -> LanePoints<'a, L> {
        let Self { point, parameters, views, .. } = self;
        LanePoints { point, parameters, views, cameras }
    }
}

/// Where in [`Inputs::points`] the landmark at a sorted position is.
pub(super) trait PointIndex: Copy {
    fn of(self, position: u32) -> usize;
}

/// All landmarks are there.
#[derive(Clone, Copy)]
pub(super) struct Everywhere;

impl PointIndex for Everywhere {
    #[inline(always)]
    fn of(self, position: u32) -> usize {
        4 * position as usize
    }
}

/// Only the landmarks of a tile are there.
#[derive(Clone, Copy)]
pub(super) struct InTile {
    /// The sorted position of the first.
    pub(super) first: usize,
}

impl PointIndex for InTile {
    #[inline(always)]
    fn of(self, position: u32) -> usize {
        // Lanes past the tile's end read any landmark; what they compute is not used.
        4 * (position as usize).wrapping_sub(self.first).min(GROUPS * WIDTH - 1)
    }
}

#[inline(always)]
fn look<L: Lanes, M: LaneModel>(
    l: L,
    inputs: &Inputs<'_>,
    point_index: impl PointIndex,
    first: usize,
) -> GatheredInputs<L> {
    let sorted = inputs.sorted;
    let views = eight_indices(&sorted.views, first);
    let a = gather(l, inputs.records, views, 0);
    let b = gather(l, inputs.records, views, 1);
    let positions = eight_indices(&sorted.positions, first);
    let mut rows = [l.splat(0.0); WIDTH];
    for (row, &position) in rows.iter_mut().zip(positions) {
        *row = l.load(eight(inputs.points, point_index.of(position)));
    }
    let [x, y, z, ..] = l.transpose(rows);
    let offset = [l.sub(x, b[1]), l.sub(y, b[2]), l.sub(z, b[3])];
    let rotation = [a[0], a[1], a[2], a[3], a[4], a[5], a[6], a[7], b[0]];
    let mut point = offset;
    for r in 0..3 {
        let part = l.mul(rotation[3 * r], offset[0]);
        let part = l.fma(rotation[3 * r + 1], offset[1], part);
        point[r] = l.fma(rotation[3 * r + 2], offset[2], part);
    }
    let mut parameters = [l.splat(0.0); PARAMETERS];
    parameters[..4].copy_from_slice(&b[4..8]);
    if M::PARAMETERS > 4 {
        let c = gather(l, inputs.records, views, 2);
        parameters[4..].copy_from_slice(&c[..5]);
    }
    GatheredInputs { rotation, point, parameters, views: *views }
}

/// Σ of squared whitened residuals of eight observations, before the loss.
#[inline(always)]
pub(super) fn squared_errors<L: Lanes, const R: usize>(
    l: L,
    inputs: &Inputs<'_>,
    first: usize,
) -> L::V {
    match inputs.model {
        Model::Snavely if R == 2 => errors_of::<L, _, R>(l, inputs, first, SnavelyLanes),
        Model::Pinhole => errors_of::<L, _, R>(l, inputs, first, PinholeLanes),
        Model::Snavely | Model::Any => errors_of::<L, _, R>(l, inputs, first, inputs.any()),
    }
}

#[inline(always)]
fn errors_of<L: Lanes, M: LaneModel, const R: usize>(
    l: L,
    inputs: &Inputs<'_>,
    first: usize,
    model: M,
) -> L::V {
    let seen = look::<L, M>(l, inputs, Everywhere, first);
    let projection = model.project(l, seen.points(inputs.cameras));
    let residual = whitened::<L, R>(l, inputs, first, &projection.pixel, seen.point[2]);
    squared_norm(l, &residual)
}

#[inline(always)]
pub(super) fn squared_norm<L: Lanes, const R: usize>(l: L, residual: &[L::V; R]) -> L::V {
    let mut sum = l.mul(residual[0], residual[0]);
    for r in &residual[1..] {
        sum = l.fma(*r, *r, sum);
    }
    sum
}

#[inline(always)]
fn whitened<L: Lanes, const R: usize>(
    l: L,
    inputs: &Inputs<'_>,
    first: usize,
    pixel: &[L::V; 2],
    depth: L::V,
) -> [L::V; R] {
    let sorted = inputs.sorted;
    let weight = l.load(eight(&sorted.weights, first));
    let u = l.mul(l.sub(pixel[0], l.load(eight(&sorted.u, first))), weight);
    let v = l.mul(l.sub(pixel[1], l.load(eight(&sorted.v, first))), weight);
    let mut residual = [u; R];
    residual[1] = v;
    if R > 2 {
        let difference = l.sub(depth, l.load(eight(&sorted.depths, first)));
        residual[2] = l.mul(difference, l.load(eight(&sorted.depth_weights, first)));
    }
    residual
}

/// What a kernel does with the Jacobians of eight observations.
pub(super) trait Consumer<L: Lanes, const R: usize> {
    /// Must be `#[inline(always)]`, as a kernel's `run`.
    fn consume(self, l: L, lin: &Linearized<L, R>);
}

/// Linearizes eight observations with D columns a view and hands them to `consumer`.
///
/// A SPECIAL kernel has the formulas in itself, so that Jacobians and constants stay in registers; it is
/// only run for cameras that it has. All others call, which costs little beside their formulas.
#[inline(always)]
pub(super) fn linearize<
    L: Lanes,
    C: Consumer<L, R>,
    const D: usize,
    const R: usize,
    const SPECIAL: bool,
>(
    l: L,
    inputs: &Inputs<'_>,
    first: usize,
    consumer: C,
) {
    let point_index = Everywhere;
    if !SPECIAL {
        return consumer.consume(l, &l.call(LinearizeAny::<R> { inputs, first, columns: D }));
    }
    if D == 9 || (R == 2 && inputs.model == Model::Snavely) {
        let model = SnavelyLanes;
        return consumer
            .consume(l, &Linearize::<_, _, R> { inputs, first, model, point_index }.run(l));
    }
    let model = PinholeLanes;
    consumer.consume(l, &Linearize::<_, _, R> { inputs, first, model, point_index }.run(l));
}

/// The Jacobians of eight observations by one camera model.
struct Linearize<'a, M, P, const R: usize> {
    inputs: &'a Inputs<'a>,
    first: usize,
    model: M,
    point_index: P,
}

impl<L: Lanes, M: LaneModel, P: PointIndex, const R: usize> Subroutine<L>
    for Linearize<'_, M, P, R>
{
    type Output = Linearized<L, R>;

    #[inline(always)]
    fn run(self, l: L) -> Linearized<L, R> {
        let Self { inputs, first, model, point_index } = self;
        let seen = look::<L, M>(l, inputs, point_index, first);
        let projection = model.project(l, seen.points(inputs.cameras));
        let residual = whitened::<L, R>(l, inputs, first, &projection.pixel, seen.point[2]);
        let weight = l.load(eight(&inputs.sorted.weights, first));
        let mut depth_weight = weight;
        if R > 2 {
            depth_weight = l.load(eight(&inputs.sorted.depth_weights, first));
        }
        let zero = l.splat(0.0);
        let mut out = Linearized {
            residual,
            pose: [[zero; 6]; R],
            camera: [[zero; PARAMETERS]; R],
            landmark: [[zero; 3]; R],
        };
        let [px, py, pz] = seen.point;
        for r in 0..R {
            let j = if r < 2 {
                let d = &projection.d_point[r];
                [l.mul(d[0], weight), l.mul(d[1], weight), l.mul(d[2], weight)]
            } else {
                [zero, zero, depth_weight]
            };
            out.pose[r] = [
                l.sub(zero, j[0]),
                l.sub(zero, j[1]),
                l.sub(zero, j[2]),
                l.fnma(j[2], py, l.mul(j[1], pz)),
                l.fnma(j[0], pz, l.mul(j[2], px)),
                l.fnma(j[1], px, l.mul(j[0], py)),
            ];
            for c in 0..3 {
                let m = &seen.rotation;
                let part = l.mul(j[0], m[c]);
                out.landmark[r][c] = l.fma(j[2], m[6 + c], l.fma(j[1], m[3 + c], part));
            }
            if r < 2 {
                for c in 0..PARAMETERS {
                    out.camera[r][c] = l.mul(projection.d_unknowns[r][c], weight);
                }
            }
        }
        out
    }
}

/// The Jacobians of eight observations by any camera model, under the loss; see [`super::under_loss`].
struct LinearizeAny<'a, const R: usize> {
    inputs: &'a Inputs<'a>,
    first: usize,
    /// Columns of a view.
    columns: usize,
}

impl<L: Lanes, const R: usize> Subroutine<L> for LinearizeAny<'_, R> {
    type Output = Linearized<L, R>;

    #[inline(always)]
    fn run(self, l: L) -> Linearized<L, R> {
        let Self { inputs, first, columns } = self;
        let mut out = by_model(l, inputs, first, Everywhere);
        if inputs.loss != Loss::Trivial {
            out.weigh(l, &inputs.loss, inputs.stiffness, columns);
        }
        out
    }
}

/// The Jacobians of eight observations before the loss.
#[inline(always)]
pub(super) fn by_model<L: Lanes, P: PointIndex, const R: usize>(
    l: L,
    inputs: &Inputs<'_>,
    first: usize,
    point_index: P,
) -> Linearized<L, R> {
    match inputs.model {
        Model::Snavely if R == 2 => {
            Linearize { inputs, first, model: SnavelyLanes, point_index }.run(l)
        }
        Model::Pinhole => Linearize { inputs, first, model: PinholeLanes, point_index }.run(l),
        Model::Snavely | Model::Any => {
            Linearize { inputs, first, model: inputs.any(), point_index }.run(l)
        }
    }
}
