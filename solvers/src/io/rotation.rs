//! Quaternions of files, (x, y, z, w), to rotations and back.
//!
//! A norm within 1e-3 of 1 is rounding of a printed file and is normalized away; any other norm is
//! refused, since it means that columns are mixed up or the data are broken. g2o's files are the exception:
//! g2o normalizes what it reads.

use super::{IoError, Location};
use crate::geometry::So3;

/// How far a quaternion's norm may be from 1.
pub(super) const NORM_TOLERANCE: f64 = 1e-3;

/// Checks the norm of a quaternion in any component order.
pub(super) fn check_norm(
    quaternion: &[f64; 4],
    location: impl FnOnce() -> Location,
) -> Result<(), IoError> {
    let norm = quaternion.iter().map(|c| c * c).sum::<f64>().sqrt();
    if (norm - 1.0).abs() <= NORM_TOLERANCE {
        Ok(())
    } else {
        Err(IoError::BadQuaternion { location: location(), norm })
    }
}

/// A quaternion at norm 1, in any component order; `None` where the norm is within the tolerance already.
///
/// # Errors
/// [`IoError::BadQuaternion`] where it is zero or not finite.
pub(super) fn normalized(
    quaternion: &[f64; 4],
    location: impl FnOnce() -> Location,
) -> Result<Option<[f64; 4]>, IoError> {
    let Err(error) = check_norm(quaternion, location) else { return Ok(None) };
    // Squares of very large or small numbers have no place in 64 bits.
    let largest = quaternion.iter().fold(0.0_f64, |most, c| most.max(c.abs()));
    if largest == 0.0 || !quaternion.iter().all(|c| c.is_finite()) {
        return Err(error);
    }
    let scaled = quaternion.map(|c| c / largest);
    let norm = scaled.iter().map(|c| c * c).sum::<f64>().sqrt();
    Ok(Some(scaled.map(|c| c / norm)))
}

/// The rotation of a quaternion (x, y, z, w).
pub(super) fn from_xyzw(
    quaternion: &[f64; 4],
    location: impl Fn() -> Location,
) -> Result<So3, IoError> {
    check_norm(quaternion, &location)?;
    let [x, y, z, w] = *quaternion;
    So3::from_quaternion_xyzw(x, y, z, w)
        .ok_or_else(|| IoError::BadQuaternion { location: location(), norm: f64::NAN })
}

/// The quaternion (x, y, z, w) of a rotation.
pub(super) fn to_xyzw(rotation: &So3) -> [f64; 4] {
    let q = rotation.quaternion();
    [q.i, q.j, q.k, q.w]
}
