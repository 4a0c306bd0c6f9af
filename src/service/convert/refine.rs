//! The request of `RefinePose`: one camera, known points, an optional prior.

use covis_solvers::pose_refinement::{PointObservation, Prior};

use super::geometry::{information6, rigid_transform, vector2, vector3};
use super::item::depth;
use super::{Path, Violations, all};
use crate::map::Reason;
use crate::wire::v1;

/// Fewer observations do not determine a pose.
const MIN_OBSERVATIONS: usize = 3;

/// The points that are seen, at least three.
pub(in crate::service) fn observations(
    messages: &[v1::PointObservation],
    out: &mut Violations,
) -> Option<Vec<PointObservation>> {
    let at = Path::root("observations");
    if messages.len() < MIN_OBSERVATIONS {
        let text = format!("{} observations, at least 3 are needed", messages.len());
        return out.report(at, Reason::WrongLength, text);
    }
    all(at, messages, out, |at, m, out| {
        let point = vector3(at.field("point_in_world"), m.point_in_world.as_ref(), out);
        let pixel = vector2(at.field("pixel"), m.pixel.as_ref(), out);
        let sigma = out.positive(at.field("sigma_px"), m.sigma_px.unwrap_or(1.0));
        let depth = depth(at, m.depth_m, m.sigma_depth_m, out);
        Some(PointObservation {
            point_in_world: point?,
            pixel: pixel?,
            sigma_px: sigma?,
            depth_m: depth?.map(|d| (d.depth_m, d.sigma_m)),
        })
    })
}

/// What is expected of the pose, `None` within where nothing is.
pub(in crate::service) fn prior(
    message: Option<&v1::RefinePosePrior>,
    out: &mut Violations,
) -> Option<Option<Prior>> {
    let Some(message) = message else { return Some(None) };
    let at = Path::root("prior");
    let pose = message.world_from_camera.as_ref();
    let pose = rigid_transform(at.field("world_from_camera"), pose, out);
    let information = information6(at.field("information"), message.information.as_ref(), out)?;
    Some(Some(Prior { world_from_camera: pose?, information }))
}
