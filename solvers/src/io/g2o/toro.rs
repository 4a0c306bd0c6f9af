//! Numbers of TORO's lines (`VERTEX2`, `EDGE2`, `VERTEX3`, `EDGE3`) as g2o writes them.
//!
//! In the plane the information of an edge is I11 I12 I22 I33 I13 I23. In space rotations are roll, pitch and
//! yaw, R = Rz(yaw) · Ry(pitch) · Rx(roll), and the information is the upper triangle row by row; near the
//! measurement its angles are those of the rotation vector. (Grisetti, Stachniss and Burgard, "Non-linear
//! constraint network optimization for efficient map learning", 2009, and GTSAM, which reads both so.)

use super::super::IoError;
use super::super::text::Line;

/// The entries of the upper triangle, row by row, among TORO's.
const ORDER: [usize; 6] = [0, 1, 4, 2, 5, 3];

/// A pose: x y θ, or x y z and roll, pitch and yaw as a quaternion.
pub(super) fn pose<const P: usize>(line: &mut Line<'_>, field: &str) -> Result<[f64; P], IoError> {
    let mut pose = [0.0; P];
    let Some(in_space) = pose.first_chunk_mut::<7>() else { return line.numbers(field) };
    let [x, y, z, angles @ ..] = line.numbers::<6>(field)?;
    let [(sr, cr), (sp, cp), (sy, cy)] = angles.map(|angle: f64| (0.5 * angle).sin_cos());
    *in_space = [
        x,
        y,
        z,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    ];
    Ok(pose)
}

/// The upper triangle of an information matrix, row by row.
pub(super) fn information<const U: usize>(line: &mut Line<'_>) -> Result<[f64; U], IoError> {
    let mut upper = line.numbers::<U>("information")?;
    if U == ORDER.len() {
        let numbers = upper;
        upper.iter_mut().zip(ORDER).for_each(|(entry, at)| *entry = numbers[at]);
    }
    Ok(upper)
}
