//! Lengths in a client's own unit, and in the map's.
//!
//! A camera alone measures no length: a map that was made without depth has a unit of its own. Where such
//! a map becomes part of another one it is scaled, and its clients keep their unit. What a client
//! sends is converted by the functions here, on its way into the map ([`super::check`]) and where maps
//! merge. Its `scale` is [`Client::scale`](super::Client::scale), the length in the map of its unit.
//! Pixels, angles and weights have no unit of length. Nothing is estimated here.

use covis_solvers::geometry::{LieGroup, Se3, Sim3};
use covis_solvers::information::Information;
use nalgebra::{SMatrix, Vector3};

use super::numbers::is_depth;
use super::{ClientIndex, Depth, Map, Observation, Observations, Prior};

/// Scales of clients that are possible: numbers of a map stay far from where `f64` ends.
pub(super) const SCALES: std::ops::RangeInclusive<f64> = 1e-9..=1e9;

/// Distance of two measured positions, in standard deviations, from which on they measure a length.
const APART: f64 = 3.0;

impl Map {
    /// The length in the map of a unit of length of a client, [`Client::scale`](super::Client::scale).
    pub fn scale_of(&self, client: ClientIndex) -> f64 {
        self.client(client).map_or(1.0, |client| client.scale)
    }

    /// Whether something measured lengths: a depth, or two positions in the world that are apart. One
    /// prior holds the frame only. Odometry tells nothing, since a camera's has a unit of its own, and
    /// priors that are the server's own come from keyframes that were retired.
    pub fn has_metric_scale(&self) -> bool {
        let has_depth = |seen: &Observation| seen.depth.is_some();
        self.keyframes().values().any(|keyframe| keyframe.observations.iter().any(has_depth))
            || self.has_distant_priors()
    }

    fn has_distant_priors(&self) -> bool {
        let counts = self
            .priors()
            .iter()
            .filter(|(id, _)| id.id >= 0 && !self.switched_off().contains_key(id));
        let positions: Vec<(Vector3<f64>, f64)> =
            counts.filter_map(|(_, prior)| measured_position(prior)).collect();
        let Some(best) = positions.iter().min_by(|a, b| a.1.total_cmp(&b.1)) else { return false };
        let is_apart = |other: &(Vector3<f64>, f64)| {
            (other.0 - best.0).norm_squared() > APART * APART * (best.1 + other.1)
        };
        positions.iter().any(is_apart)
    }
}

/// A position that a prior measured, and its largest variance; `None` where it leaves a direction open.
fn measured_position(prior: &Prior) -> Option<(Vector3<f64>, f64)> {
    let (position, information) = match prior {
        Prior::Pose { world_from_camera, information, .. } => {
            let of_position = information.matrix().fixed_view::<3, 3>(0, 0).into_owned();
            (world_from_camera.translation, of_position)
        }
        Prior::Position { position_in_world, information, .. } => {
            (*position_in_world, *information.matrix())
        }
    };
    let least = information.symmetric_eigenvalues().min();
    (least > 0.0).then(|| (position, 1.0 / least))
}

/// A pose whose frame keeps its axes.
pub(super) fn pose(scale: f64, pose: &Se3) -> Se3 {
    Se3::new(pose.rotation, pose.translation * scale)
}

/// A measured depth; `None` where it or its deviation is out of range.
pub(super) fn depth(scale: f64, depth: Depth) -> Option<Depth> {
    let Depth { depth_m, sigma_m } = depth;
    let scaled = Depth { depth_m: depth_m * scale, sigma_m: sigma_m * scale };
    is_depth(&scaled).then_some(scaled)
}

/// Information on a tangent whose first three entries are lengths: of a pose's error, or of a point's.
/// `None` where numbers overflow. The error r becomes D·r with D = diag(s, s, s, 1, …), and Ω D⁻¹ΩD⁻¹.
pub(super) fn information<const N: usize>(
    scale: f64,
    information: &Information<N>,
) -> Option<Information<N>> {
    if scale == 1.0 {
        return Some(*information);
    }
    let by = |k: usize| if k < 3 { 1.0 / scale } else { 1.0 };
    let matrix = information.matrix();
    let scaled = SMatrix::<f64, N, N>::from_fn(|i, j| {
        // The factors first: a product of three would not be symmetric to the bit.
        matrix[(i, j)] * (by(i) * by(j))
    });
    match Information::new(&scaled) {
        Ok(scaled) => Some(scaled),
        // It knew nothing in some direction before. One that knew something has underflowed.
        Err(_) if Information::new(matrix).is_err() => Information::semidefinite(&scaled).ok(),
        Err(_) => None,
    }
}

/// A measurement in the world. `None` where numbers overflow.
pub(super) fn prior(scale: f64, prior: &Prior) -> Option<Prior> {
    let mut scaled = *prior;
    match &mut scaled {
        Prior::Pose { world_from_camera, information: of, .. } => {
            *world_from_camera = pose(scale, world_from_camera);
            *of = information(scale, of)?;
        }
        Prior::Position { position_in_world, point_in_camera, information: of, .. } => {
            *position_in_world *= scale;
            *point_in_camera *= scale;
            *of = information(scale, of)?;
        }
    }
    Some(scaled)
}

/// Observations with their depths; `None` where one is out of range.
pub(super) fn observations(scale: f64, seen: &Observations) -> Option<Observations> {
    let scaled = |seen: &Observation| {
        let depth = match seen.depth {
            Some(measured) => Some(depth(scale, measured)?),
            None => None,
        };
        Some(Observation { depth, ..seen.clone() })
    };
    seen.iter().map(scaled).collect()
}

/// The change of unit alone.
pub(super) fn similarity(scale: f64) -> Sim3 {
    Sim3 { scale, ..Sim3::identity() }
}
