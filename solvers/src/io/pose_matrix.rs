//! Poses as 4x4 matrices, one a file, as 7-Scenes and ScanNet have them: row by row, meters.
//!
//! The matrix is world_from_camera, or whatever the data set says. Rotations are made orthonormal
//! where they are off by the rounding of a printed file. Must not know names of files or times.

use std::path::Path;

use nalgebra::{Matrix3, Vector3};

use super::text::Text;
use super::{IoError, Location, files};
use crate::geometry::{Se3, So3};

/// How far an element of RᵀR, and of the last row, may be from what a rigid motion has.
const TOLERANCE: f64 = 1e-3;

/// Reads a file. `None` where the data set marks the pose as unknown by numbers that are not finite.
///
/// # Errors
/// [`IoError::Read`], and those of [`parse`].
pub fn read(path: &Path) -> Result<Option<Se3>, IoError> {
    parse(&files::read(path)?, path)
}

/// Parses a file's bytes; `path` names them in errors. `None` as in [`read`].
///
/// # Errors
/// The first of the 16 elements that is missing or malformed, a seventeenth word, or
/// [`IoError::NotRigid`].
pub fn parse(bytes: &[u8], path: &Path) -> Result<Option<Se3>, IoError> {
    let mut text = Text::new(bytes, path);
    let location = text.location();
    let mut elements = [[0.0; 4]; 4];
    let mut is_known = true;
    for (i, row) in elements.iter_mut().enumerate() {
        for (j, element) in row.iter_mut().enumerate() {
            match text.number(format_args!("element ({i}, {j})")) {
                Ok(number) => *element = number,
                Err(IoError::NotFinite { .. }) => is_known = false,
                Err(error) => return Err(error),
            }
        }
    }
    text.end()?;
    if !is_known {
        return Ok(None);
    }
    let [first, second, third, last] = elements;
    let pose = rigid([first, second, third], || location.clone())?;
    let deviation = last.iter().zip([0.0, 0.0, 0.0, 1.0]);
    let deviation = deviation.fold(0.0_f64, |most, (a, b)| most.max((a - b).abs()));
    if deviation <= TOLERANCE {
        Ok(Some(pose))
    } else {
        Err(IoError::NotRigid { location, deviation })
    }
}

/// The rigid motion of the rows [R | t]; R is made orthonormal where it is off by rounding.
///
/// # Errors
/// How far an element of RᵀR is from that of a rotation, where R is none.
pub fn from_rows(rows: [[f64; 4]; 3]) -> Result<Se3, f64> {
    let rotation = Matrix3::from_fn(|i, j| rows[i][j]);
    let deviation = (rotation.tr_mul(&rotation) - Matrix3::identity()).amax();
    // An overflow is no rigid motion either.
    if !(deviation <= TOLERANCE && rotation.determinant() > 0.0) {
        return Err(deviation);
    }
    let translation = Vector3::from_fn(|i, _| rows[i][3]);
    Ok(Se3::new(So3::from_matrix(&rotation), translation))
}

/// As [`from_rows`], for a file.
///
/// # Errors
/// [`IoError::NotRigid`].
pub(super) fn rigid(
    rows: [[f64; 4]; 3],
    location: impl FnOnce() -> Location,
) -> Result<Se3, IoError> {
    from_rows(rows).map_err(|deviation| IoError::NotRigid { location: location(), deviation })
}

/// The rows [R | t] of a rigid motion.
#[must_use]
pub fn rows(pose: &Se3) -> [[f64; 4]; 3] {
    let (rotation, t) = (pose.rotation.matrix(), pose.translation);
    [0, 1, 2].map(|i| [rotation[(i, 0)], rotation[(i, 1)], rotation[(i, 2)], t[i]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::LieGroup;

    fn of(text: &str) -> Result<Option<Se3>, IoError> {
        parse(text.as_bytes(), Path::new("frame-000001.pose.txt"))
    }

    #[test]
    fn a_matrix_is_read_and_made_orthonormal() {
        // As the data set prints them: tabs, exponents, seven digits.
        let text = "0.6000001\t 0\t 8.0000000e-001\t 1.5\t \n0\t 1\t 0\t -2\t \n\
                    -0.8\t 0\t 0.6\t 3\t \n0\t 0\t 0\t 1\t \n";
        let pose = of(text).unwrap().unwrap();
        assert_eq!(pose.translation, Vector3::new(1.5, -2.0, 3.0));
        let matrix = pose.rotation.matrix();
        assert!((matrix.tr_mul(&matrix) - Matrix3::identity()).amax() < 1e-15);
        let turn = So3::exp(&Vector3::new(0.0, 0.8f64.atan2(0.6), 0.0));
        assert!((matrix - turn.matrix()).amax() < 1e-6, "{matrix}");
    }

    #[test]
    fn a_pose_that_is_marked_unknown_is_none() {
        assert_eq!(of(&"-inf ".repeat(16)).unwrap(), None);
        assert_eq!(of("1 0 0 nan 0 1 0 0 0 0 1 0 0 0 0 1").unwrap(), None);
    }

    #[test]
    fn what_is_no_rigid_motion_is_refused_by_name() {
        let error = |text: &str| of(text).unwrap_err().to_string();
        let zero = error(&"0 ".repeat(16));
        assert!(zero.starts_with("frame-000001.pose.txt, line 1: "), "{zero}");
        for bad in [
            "1 0 0 0 0 1 0 0 0 0 -1 0 0 0 0 1",
            "2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1",
            "1 0 0 0 0 1 0 0 0 0 1 0 1 2 3 1",
            "1e200 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1",
        ] {
            assert!(matches!(of(bad), Err(IoError::NotRigid { .. })), "{bad}");
        }
        assert!(error("1 0 0 0\n0 1 0").contains("line 2: element (1, 3) is missing"));
        assert!(error("1 0 0 x").contains("element (0, 3) cannot be `x`"));
        assert!(error(&"0 ".repeat(17)).contains("unexpected `0`"));
    }
}
