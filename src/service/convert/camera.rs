//! Cameras with their projection models.
//!
//! The formulas are in `camera.proto`; pixel centers have integer coordinates on both sides. Whether
//! measured pixels can be projected is checked by `Map::check`.

use covis_solvers::geometry::{Camera, KannalaBrandt, PinholeRadialTangential, Snavely};

use super::{Path, Violations};
use crate::map::CameraEntity;
use crate::wire::v1;
use v1::camera::Model;

/// Widest image, px.
const MAX_IMAGE_PX: i64 = 65_535;

/// A camera's projection and image size; the caller reads its id and client.
pub(in crate::service) fn camera(
    at: Path<'_>,
    camera: &v1::Camera,
    out: &mut Violations,
) -> Option<CameraEntity> {
    let width = out.within(at.field("width_px"), camera.width_px, 0, MAX_IMAGE_PX);
    let height = out.within(at.field("height_px"), camera.height_px, 0, MAX_IMAGE_PX);
    let readout = at.field("rolling_shutter_readout_ms");
    let readout_ms = out.not_negative(readout, camera.rolling_shutter_readout_ms);
    if readout_ms.is_some_and(|ms| ms > 0.0) {
        return out.unimplemented(readout);
    }
    let field = at.field("model");
    let model = out.required(field, camera.model.as_ref()).and_then(|m| model(at, m, out));
    readout_ms?;
    let width_px = u32::try_from(width?).ok()?;
    let height_px = u32::try_from(height?).ok()?;
    Some(CameraEntity { camera: model?, width_px, height_px })
}

/// A projection of the camera at `at`: focal lengths are positive, all other numbers finite.
fn model(at: Path<'_>, model: &Model, out: &mut Violations) -> Option<Camera> {
    match *model {
        Model::PinholeRadialTangential(m) => {
            let focal_and_center = [("fx", m.fx), ("fy", m.fy), ("cx", m.cx), ("cy", m.cy)];
            let distortion = [("k1", m.k1), ("k2", m.k2), ("p1", m.p1), ("p2", m.p2), ("k3", m.k3)];
            let at = at.field("pinhole_radial_tangential");
            let linear = out.numbers(at, 2, focal_and_center);
            let [k1, k2, p1, p2, k3] = out.numbers(at, 0, distortion)?;
            let [fx, fy, cx, cy] = linear?;
            Some(Camera::Pinhole(PinholeRadialTangential { fx, fy, cx, cy, k1, k2, p1, p2, k3 }))
        }
        Model::KannalaBrandt(m) => {
            let focal_and_center = [("fx", m.fx), ("fy", m.fy), ("cx", m.cx), ("cy", m.cy)];
            let distortion = [("k1", m.k1), ("k2", m.k2), ("k3", m.k3), ("k4", m.k4)];
            let at = at.field("kannala_brandt");
            let linear = out.numbers(at, 2, focal_and_center);
            let [k1, k2, k3, k4] = out.numbers(at, 0, distortion)?;
            let [fx, fy, cx, cy] = linear?;
            Some(Camera::Fisheye(KannalaBrandt { fx, fy, cx, cy, k1, k2, k3, k4 }))
        }
        Model::Snavely(m) => {
            let fields = [("focal", m.focal), ("k1", m.k1), ("k2", m.k2)];
            let [focal, k1, k2] = out.numbers(at.field("snavely"), 1, fields)?;
            Some(Camera::Snavely(Snavely { focal, k1, k2 }))
        }
    }
}

/// The message of a camera.
pub(in crate::service) fn to_camera(
    client_id: String,
    id: i64,
    entity: &CameraEntity,
) -> v1::Camera {
    v1::Camera {
        client_id,
        id,
        width_px: i32::try_from(entity.width_px).unwrap_or(0),
        height_px: i32::try_from(entity.height_px).unwrap_or(0),
        rolling_shutter_readout_ms: 0.0,
        model: Some(to_model(&entity.camera)),
    }
}

/// The message of a projection.
pub(super) fn to_model(camera: &Camera) -> Model {
    match *camera {
        Camera::Pinhole(PinholeRadialTangential { fx, fy, cx, cy, k1, k2, p1, p2, k3 }) => {
            let model = v1::PinholeRadialTangential { fx, fy, cx, cy, k1, k2, p1, p2, k3 };
            Model::PinholeRadialTangential(model)
        }
        Camera::Fisheye(KannalaBrandt { fx, fy, cx, cy, k1, k2, k3, k4 }) => {
            Model::KannalaBrandt(v1::KannalaBrandt { fx, fy, cx, cy, k1, k2, k3, k4 })
        }
        Camera::Snavely(Snavely { focal, k1, k2 }) => Model::Snavely(v1::Snavely { focal, k1, k2 }),
    }
}
