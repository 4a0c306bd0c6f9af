//! Converts poses, points, cameras and times to messages and back, for frontends in Rust.
//!
//! Both sides use the same conventions (docs/conventions.md), so that only the layout is converted.

use covis_solvers::geometry::{Camera, Se3, So3};
use covis_solvers::io::trajectory::nanoseconds_of_seconds;
use nalgebra::{Vector2, Vector3};

use covis_client::wire::v1;
use v1::camera::Model;

/// A rigid transform, frames as in `transform`.
pub fn rigid(transform: &Se3) -> v1::RigidTransform {
    let q = transform.rotation.quaternion();
    v1::RigidTransform {
        translation: Some(vector3(&transform.translation)),
        rotation: Some(v1::Quaternion { x: q.i, y: q.j, z: q.k, w: q.w }),
    }
}

/// The transform of a message; `None` where a part is missing or the quaternion is zero.
pub fn se3(transform: &v1::RigidTransform) -> Option<Se3> {
    let (t, q) = (transform.translation?, transform.rotation?);
    let rotation = So3::from_quaternion_xyzw(q.x, q.y, q.z, q.w)?;
    Some(Se3::new(rotation, Vector3::new(t.x, t.y, t.z)))
}

/// A vector in space.
pub fn vector3(v: &Vector3<f64>) -> v1::Vector3 {
    v1::Vector3 { x: v.x, y: v.y, z: v.z }
}

/// A pixel (column, row).
pub fn vector2(v: &Vector2<f64>) -> v1::Vector2 {
    v1::Vector2 { x: v.x, y: v.y }
}

/// A camera with its image size in pixels, 0 where it is not known.
pub fn camera(id: i64, camera: &Camera, (width_px, height_px): (i32, i32)) -> v1::Camera {
    let model = match *camera {
        Camera::Pinhole(c) => Model::PinholeRadialTangential(v1::PinholeRadialTangential {
            fx: c.fx,
            fy: c.fy,
            cx: c.cx,
            cy: c.cy,
            k1: c.k1,
            k2: c.k2,
            p1: c.p1,
            p2: c.p2,
            k3: c.k3,
        }),
        Camera::Fisheye(c) => Model::KannalaBrandt(v1::KannalaBrandt {
            fx: c.fx,
            fy: c.fy,
            cx: c.cx,
            cy: c.cy,
            k1: c.k1,
            k2: c.k2,
            k3: c.k3,
            k4: c.k4,
        }),
        Camera::Snavely(c) => Model::Snavely(v1::Snavely { focal: c.focal, k1: c.k1, k2: c.k2 }),
    };
    v1::Camera { id, width_px, height_px, model: Some(model), ..v1::Camera::default() }
}

/// A time in seconds, rounded to nanoseconds; 0 where it is not finite or they have no 64 bits.
pub fn timestamp(seconds: f64) -> prost_types::Timestamp {
    let nanoseconds = nanoseconds_of_seconds(seconds).unwrap_or_default();
    prost_types::Timestamp {
        seconds: nanoseconds.div_euclid(1_000_000_000),
        nanos: nanoseconds.rem_euclid(1_000_000_000) as i32,
    }
}

/// A landmark of the stream's client.
pub fn landmark_ref(id: i64) -> v1::LandmarkRef {
    v1::LandmarkRef { client_id: String::new(), id }
}

/// A keyframe of the stream's client.
pub fn keyframe_ref(id: i64) -> v1::KeyframeRef {
    v1::KeyframeRef { client_id: String::new(), id }
}
