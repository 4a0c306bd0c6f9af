//! Cameras with their projection models.
//!
//! The formulas are in `camera.proto`; pixel centers have integer coordinates on both sides.

use covis_solvers::geometry::{Camera, KannalaBrandt, PinholeRadialTangential, Snavely};

use super::{Path, Violations};
use crate::map::CameraEntity;
use crate::wire::v1;

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
    let model = match &camera.model {
        None => out.missing(at.field("model")),
        Some(v1::camera::Model::PinholeRadialTangential(model)) => {
            pinhole(at.field("pinhole_radial_tangential"), model, out)
        }
        Some(v1::camera::Model::KannalaBrandt(model)) => {
            fisheye(at.field("kannala_brandt"), model, out)
        }
        Some(v1::camera::Model::Snavely(model)) => snavely(at.field("snavely"), model, out),
    };
    readout_ms?;
    let width_px = u32::try_from(width?).ok()?;
    let height_px = u32::try_from(height?).ok()?;
    Some(CameraEntity { camera: model?, width_px, height_px })
}

fn pinhole(at: Path<'_>, m: &v1::PinholeRadialTangential, out: &mut Violations) -> Option<Camera> {
    let fx = out.positive(at.field("fx"), m.fx);
    let fy = out.positive(at.field("fy"), m.fy);
    let cx = out.finite(at.field("cx"), m.cx);
    let cy = out.finite(at.field("cy"), m.cy);
    let k1 = out.finite(at.field("k1"), m.k1);
    let k2 = out.finite(at.field("k2"), m.k2);
    let p1 = out.finite(at.field("p1"), m.p1);
    let p2 = out.finite(at.field("p2"), m.p2);
    let k3 = out.finite(at.field("k3"), m.k3);
    Some(Camera::Pinhole(PinholeRadialTangential {
        fx: fx?,
        fy: fy?,
        cx: cx?,
        cy: cy?,
        k1: k1?,
        k2: k2?,
        p1: p1?,
        p2: p2?,
        k3: k3?,
    }))
}

fn fisheye(at: Path<'_>, m: &v1::KannalaBrandt, out: &mut Violations) -> Option<Camera> {
    let fx = out.positive(at.field("fx"), m.fx);
    let fy = out.positive(at.field("fy"), m.fy);
    let cx = out.finite(at.field("cx"), m.cx);
    let cy = out.finite(at.field("cy"), m.cy);
    let k1 = out.finite(at.field("k1"), m.k1);
    let k2 = out.finite(at.field("k2"), m.k2);
    let k3 = out.finite(at.field("k3"), m.k3);
    let k4 = out.finite(at.field("k4"), m.k4);
    Some(Camera::Fisheye(KannalaBrandt {
        fx: fx?,
        fy: fy?,
        cx: cx?,
        cy: cy?,
        k1: k1?,
        k2: k2?,
        k3: k3?,
        k4: k4?,
    }))
}

fn snavely(at: Path<'_>, m: &v1::Snavely, out: &mut Violations) -> Option<Camera> {
    let focal = out.positive(at.field("focal"), m.focal);
    let k1 = out.finite(at.field("k1"), m.k1);
    let k2 = out.finite(at.field("k2"), m.k2);
    Some(Camera::Snavely(Snavely { focal: focal?, k1: k1?, k2: k2? }))
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
pub(super) fn to_model(camera: &Camera) -> v1::camera::Model {
    match *camera {
        Camera::Pinhole(PinholeRadialTangential { fx, fy, cx, cy, k1, k2, p1, p2, k3 }) => {
            v1::camera::Model::PinholeRadialTangential(v1::PinholeRadialTangential {
                fx,
                fy,
                cx,
                cy,
                k1,
                k2,
                p1,
                p2,
                k3,
            })
        }
        Camera::Fisheye(KannalaBrandt { fx, fy, cx, cy, k1, k2, k3, k4 }) => {
            v1::camera::Model::KannalaBrandt(v1::KannalaBrandt { fx, fy, cx, cy, k1, k2, k3, k4 })
        }
        Camera::Snavely(Snavely { focal, k1, k2 }) => {
            v1::camera::Model::Snavely(v1::Snavely { focal, k1, k2 })
        }
    }
}
