//! Standard deviations of measured depths, for `Observation.sigma_depth_m`.
//!
//! Depth along the optical axis from a disparity, z = f b / d, so that its standard deviation grows
//! with the square of the distance. A share of the distance (1 % of z) is a poor substitute: it is too
//! small far away, and distant landmarks then outweigh the pixels. Plain formulas; no message is
//! made here and no camera is known.

/// σ_z / z² of the first Kinect, 1/m: Khoshelham and Elberink, "Accuracy and resolution of Kinect depth
/// data for indoor mapping applications", Sensors 12 (2012): 2.85 · 10⁻⁵ cm⁻¹ times half a step of
/// disparity.
const KINECT_PER_M: f64 = 1.425e-3;

/// Standard deviation of a depth that a structured-light sensor like the first Kinect measured, in
/// meters, for a `depth_m` from 0.5 m to 5 m: 1.425 · 10⁻³ m⁻¹ z².
///
/// It is that of the sensor on a plane. Where the depth is read at a corner of an object, or color and
/// depth are not of the same time, errors are several times as large: `SolveSummary.residuals` of a
/// solve tells by how much.
#[must_use]
pub fn kinect_sigma_m(depth_m: f64) -> f64 {
    KINECT_PER_M * depth_m * depth_m
}

/// Standard deviation of a depth from stereo, in meters: z² σ_d / (f b), to first order.
///
/// `sigma_disparity_px` is the disparity's standard deviation (0.2 to 1 px for most matchers),
/// `focal_px` the rectified focal length, both in pixels of the same image, and `baseline_m` the
/// distance of the cameras in meters; all positive.
#[must_use]
pub fn stereo_sigma_m(
    depth_m: f64,
    sigma_disparity_px: f64,
    focal_px: f64,
    baseline_m: f64,
) -> f64 {
    depth_m * depth_m * sigma_disparity_px / (focal_px * baseline_m)
}

#[cfg(test)]
mod tests {
    use super::{kinect_sigma_m, stereo_sigma_m};

    #[test]
    fn the_kinect_has_the_published_figures() {
        // About 4 cm at the end of the range, a few millimeters near the sensor.
        assert!((kinect_sigma_m(5.0) - 0.0356).abs() < 1e-4);
        assert!(kinect_sigma_m(1.0) < 0.002);
    }

    #[test]
    fn stereo_is_the_derivative_of_depth_by_disparity() {
        let (focal_px, baseline_m, sigma_px) = (700.0, 0.12, 0.3);
        let depth = |disparity: f64| focal_px * baseline_m / disparity;
        for disparity in [5.0, 20.0, 80.0] {
            let h = 1e-5 * disparity;
            let slope = (depth(disparity - h) - depth(disparity + h)) / (2.0 * h);
            let sigma = stereo_sigma_m(depth(disparity), sigma_px, focal_px, baseline_m);
            assert!((sigma / (slope * sigma_px) - 1.0).abs() < 1e-8);
        }
    }
}
