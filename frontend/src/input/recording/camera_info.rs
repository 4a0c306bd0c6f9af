//! The lens of a `sensor_msgs/msg/CameraInfo`: of its raw image by K and the distortion, of its rectified
//! image by P.
//!
//! The model `plumb_bob` is that of the solvers. `rational_polynomial` is the same where the
//! denominator's coefficients are 0, as drivers often have it. Others are refused by name.

use covis_solvers::geometry::PinholeRadialTangential;

use super::error::MessageError;
use super::messages::CameraInfo;

/// Models without coefficients that have effect.
const PINHOLE: [&str; 2] = ["", "none"];

/// The camera of a topic's images.
pub(super) fn camera(
    info: &CameraInfo<'_>,
    is_rectified: bool,
) -> Result<PinholeRadialTangential, MessageError> {
    if !info.is_whole {
        return Err(MessageError::Binned);
    }
    let [fx, skew, cx, _, fy, cy, ..] = info.k;
    let mut camera = PinholeRadialTangential::undistorted(fx, fy, cx, cy);
    if is_rectified {
        let [fx, _, cx, _, _, fy, cy, ..] = info.p;
        camera = PinholeRadialTangential::undistorted(fx, fy, cx, cy);
    } else {
        let used = info.d.iter().rposition(|&d| d != 0.0).map_or(0, |last| last + 1);
        let is_known = match info.model {
            "plumb_bob" | "rational_polynomial" => used <= 5,
            model => used == 0 && PINHOLE.contains(&model),
        };
        if !is_known {
            return Err(MessageError::Distortion { found: info.model.chars().take(40).collect() });
        }
        let [k1, k2, p1, p2, k3, ..] = info.d;
        camera = PinholeRadialTangential { k1, k2, p1, p2, k3, ..camera };
        if skew != 0.0 {
            return Err(MessageError::Calibration { field: "the skew", value: skew });
        }
    }
    let PinholeRadialTangential { fx, fy, cx, cy, k1, k2, p1, p2, k3 } = camera;
    for (field, value) in [("fx", fx), ("fy", fy)] {
        if !(value > 0.0 && value.is_finite()) {
            return Err(MessageError::Calibration { field, value });
        }
    }
    let others =
        [("cx", cx), ("cy", cy), ("k1", k1), ("k2", k2), ("p1", p1), ("p2", p2), ("k3", k3)];
    match others.into_iter().find(|(_, value)| !value.is_finite()) {
        Some((field, value)) => Err(MessageError::Calibration { field, value }),
        None => Ok(camera),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn info<'a>(model: &'a str, coefficients: &[f64]) -> CameraInfo<'a> {
        let mut d = [0.0; 14];
        d[..coefficients.len()].copy_from_slice(coefficients);
        let k = [500.0, 0.0, 320.0, 0.0, 501.0, 240.0, 0.0, 0.0, 1.0];
        let p = [400.0, 0.0, 300.0, 0.0, 0.0, 401.0, 200.0, 0.0, 0.0, 0.0, 1.0, 0.0];
        CameraInfo { model, d, k, p, is_whole: true }
    }

    #[test]
    fn the_raw_image_has_k_and_distortion_and_the_rectified_one_p() {
        let raw = camera(&info("plumb_bob", &[0.1, -0.2, 0.01, 0.02, 0.3]), false).unwrap();
        assert_eq!((raw.fx, raw.fy, raw.cx, raw.cy), (500.0, 501.0, 320.0, 240.0));
        assert_eq!((raw.k1, raw.k2, raw.p1, raw.p2, raw.k3), (0.1, -0.2, 0.01, 0.02, 0.3));
        let flat = camera(&info("plumb_bob", &[0.1, -0.2]), true).unwrap();
        assert_eq!(flat, PinholeRadialTangential::undistorted(400.0, 401.0, 300.0, 200.0));
        let rational = info("rational_polynomial", &[0.1, 0.0, 0.0, 0.0, 0.3, 0.0, 0.0, 0.0]);
        assert_eq!(camera(&rational, false).unwrap().k3, 0.3);
        assert_eq!(camera(&info("", &[]), false).unwrap().fx, 500.0);
    }

    #[test]
    fn lenses_that_are_not_modeled_are_refused_by_name() {
        for (model, d) in [
            ("equidistant", &[0.1, 0.0, 0.0, 0.0][..]),
            ("fisheye", &[]),
            ("rational_polynomial", &[0.1, 0.0, 0.0, 0.0, 0.3, 0.5]),
            ("", &[0.1]),
        ] {
            let error = camera(&info(model, d), false).unwrap_err().to_string();
            assert!(error.contains(&format!("`{model}`")), "{error}");
        }
        // A driver that was never calibrated.
        let mut blank = info("plumb_bob", &[]);
        blank.k = [0.0; 9];
        assert!(camera(&blank, false).unwrap_err().to_string().contains("fx is 0"));
        let binned = CameraInfo { is_whole: false, ..info("plumb_bob", &[]) };
        assert!(matches!(camera(&binned, false), Err(MessageError::Binned)));
    }
}
