//! Vectors, rotations, rigid transforms and packed symmetric matrices.
//!
//! Quaternions travel as (x, y, z, w) and are normalized when their norm is within 1e-3 of 1.
//! Symmetric matrices travel as their upper triangle, row by row. Frames and units are not changed
//! here.

use covis_solvers::geometry::{Geodetic, Se2, Se3, So3};
use covis_solvers::information::Information;
use nalgebra::{SMatrix, Vector2, Vector3};

use super::{Path, Violations};
use crate::map::Reason;
use crate::wire::v1;

/// How far a quaternion's norm may be from 1.
const UNIT_TOLERANCE: f64 = 1e-3;

/// A required vector in the plane.
pub(in crate::service) fn vector2(
    at: Path<'_>,
    vector: Option<&v1::Vector2>,
    out: &mut Violations,
) -> Option<Vector2<f64>> {
    let vector = out.required(at, vector)?;
    out.numbers(at, 0, [("x", vector.x), ("y", vector.y)]).map(Vector2::from)
}

/// A required vector in space.
pub(in crate::service) fn vector3(
    at: Path<'_>,
    vector: Option<&v1::Vector3>,
    out: &mut Violations,
) -> Option<Vector3<f64>> {
    let vector = out.required(at, vector)?;
    let fields = [("x", vector.x), ("y", vector.y), ("z", vector.z)];
    out.numbers(at, 0, fields).map(Vector3::from)
}

/// A point by the coordinates of WGS 84.
pub(in crate::service) fn geodetic(
    at: Path<'_>,
    point: &v1::GeodeticPosition,
    out: &mut Violations,
) -> Option<Geodetic> {
    let mut angle = |name, value: f64, limit: f64| {
        let value = out.finite(at.field(name), value)?;
        if value.abs() <= limit {
            return Some(value);
        }
        let text = format!("{value} is not in {} to {limit}", -limit);
        out.report(at.field(name), Reason::OutOfRange, text)
    };
    let latitude_deg = angle("latitude_deg", point.latitude_deg, 90.0);
    let longitude_deg = angle("longitude_deg", point.longitude_deg, 180.0);
    let height_m = out.finite(at.field("height_m"), point.height_m);
    Some(Geodetic {
        latitude_deg: latitude_deg?,
        longitude_deg: longitude_deg?,
        height_m: height_m?,
    })
}

/// The message of a point.
pub(in crate::service) fn to_geodetic(point: &Geodetic) -> v1::GeodeticPosition {
    let Geodetic { latitude_deg, longitude_deg, height_m } = *point;
    v1::GeodeticPosition { latitude_deg, longitude_deg, height_m }
}

fn rotation(
    at: Path<'_>,
    quaternion: Option<&v1::Quaternion>,
    out: &mut Violations,
) -> Option<So3> {
    let q = out.required(at, quaternion)?;
    let fields = [("x", q.x), ("y", q.y), ("z", q.z), ("w", q.w)];
    let [x, y, z, w] = out.numbers(at, 0, fields)?;
    let norm = (x * x + y * y + z * z + w * w).sqrt();
    if (norm - 1.0).abs() <= UNIT_TOLERANCE
        && let Some(rotation) = So3::from_quaternion_xyzw(x, y, z, w)
    {
        return Some(rotation);
    }
    let text = format!("the quaternion's norm is {norm}, not within 1e-3 of 1");
    out.report(at, Reason::NotNormalized, text)
}

/// A required rigid transform of space.
pub(in crate::service) fn rigid_transform(
    at: Path<'_>,
    transform: Option<&v1::RigidTransform>,
    out: &mut Violations,
) -> Option<Se3> {
    let transform = out.required(at, transform)?;
    let translation = vector3(at.field("translation"), transform.translation.as_ref(), out);
    let rotation = rotation(at.field("rotation"), transform.rotation.as_ref(), out);
    Some(Se3::new(rotation?, translation?))
}

/// A required rigid transform of the plane.
pub(in crate::service) fn rigid_transform2(
    at: Path<'_>,
    transform: Option<&v1::RigidTransform2>,
    out: &mut Violations,
) -> Option<Se2> {
    let transform = out.required(at, transform)?;
    let translation = vector2(at.field("translation"), transform.translation.as_ref(), out);
    let angle = out.finite(at.field("angle_rad"), transform.angle_rad);
    let translation = translation?;
    Some(Se2::from_xy_angle(translation.x, translation.y, angle?))
}

/// A required information matrix from its upper triangle, row by row. It must be positive definite.
pub(in crate::service) fn information<const N: usize>(
    at: Path<'_>,
    upper_triangle: Option<&Vec<f64>>,
    out: &mut Violations,
) -> Option<Information<N>> {
    let upper = out.required(at, upper_triangle)?;
    let at = at.field("upper_triangle");
    let expected = N * (N + 1) / 2;
    if upper.len() != expected {
        let text = format!("{} values, {expected} are needed", upper.len());
        return out.report(at, Reason::WrongLength, text);
    }
    let mut matrix = SMatrix::<f64, N, N>::zeros();
    let entries = (0..N).flat_map(|row| (row..N).map(move |column| (row, column)));
    for (index, ((row, column), &entry)) in entries.zip(upper).enumerate() {
        let entry = out.finite(at.index(index), entry)?;
        matrix[(row, column)] = entry;
        matrix[(column, row)] = entry;
    }
    Information::new(&matrix).ok().or_else(|| {
        out.report(at, Reason::NotPositiveDefinite, "the matrix is not positive definite")
    })
}

/// The message of a vector in the plane.
pub(in crate::service) fn to_vector2(vector: &Vector2<f64>) -> v1::Vector2 {
    v1::Vector2 { x: vector.x, y: vector.y }
}

/// The message of a vector in space.
pub(in crate::service) fn to_vector3(vector: &Vector3<f64>) -> v1::Vector3 {
    v1::Vector3 { x: vector.x, y: vector.y, z: vector.z }
}

/// The message of a rigid transform of space.
pub(in crate::service) fn to_rigid_transform(transform: &Se3) -> v1::RigidTransform {
    let q = transform.rotation.quaternion();
    v1::RigidTransform {
        translation: Some(to_vector3(&transform.translation)),
        rotation: Some(v1::Quaternion { x: q.i, y: q.j, z: q.k, w: q.w }),
    }
}

/// The message of a rigid transform of the plane.
pub(in crate::service) fn to_rigid_transform2(transform: &Se2) -> v1::RigidTransform2 {
    v1::RigidTransform2 {
        translation: Some(to_vector2(&transform.translation)),
        angle_rad: transform.rotation.angle(),
    }
}

/// The upper triangle of an information matrix, row by row.
pub(in crate::service) fn to_upper_triangle<const N: usize>(
    information: &Information<N>,
) -> Vec<f64> {
    upper_triangle(information.matrix())
}

fn upper_triangle<const N: usize>(matrix: &SMatrix<f64, N, N>) -> Vec<f64> {
    (0..N).flat_map(|row| (row..N).map(move |column| matrix[(row, column)])).collect()
}

/// The message of the covariance that an information is the inverse of; absent where there is none.
pub(in crate::service) fn to_covariance6(information: &Information<6>) -> Option<v1::Covariance6> {
    let covariance = information.covariance().ok()?;
    Some(v1::Covariance6 { upper_triangle: upper_triangle(covariance.matrix()) })
}

/// The message of a 6 × 6 information matrix.
pub(in crate::service) fn to_information6(information: &Information<6>) -> v1::InformationMatrix6 {
    v1::InformationMatrix6 { upper_triangle: to_upper_triangle(information) }
}
