//! A frame of a camera that sees color and depth. Its images come from `covis-dense`.
//!
//! Knows nothing of lenses, and of poses only what a source gives.

pub use covis_dense::image::Image;
use covis_solvers::geometry::Se3;

use super::simd::{self, Kernel};

/// What a camera that sees color and depth delivers at one time. Both images have one size and show
/// the same rays, lens distortion included.
#[derive(Clone, Debug, PartialEq)]
pub struct RgbdFrame {
    /// Middle of the exposure, seconds of the camera's clock.
    pub timestamp_s: f64,
    /// How much later the depth was taken than the color, seconds.
    pub depth_delay_s: f64,
    /// Red, green, blue.
    pub color: Image<[u8; 3]>,
    /// Distance along the optical axis (z, not the range), in meters; 0 where none was measured.
    pub depth_m: Image<f32>,
    /// The pose that the source itself gives, as a phone or a robot's odometry does: world_from_camera in a
    /// world of its own, meters. Tracking starts from the motion between two of them; it is no result.
    pub given_pose: Option<Se3>,
}

impl RgbdFrame {
    /// Luma of the color (ITU-R BT.601), rounded.
    #[must_use]
    pub fn gray(&self) -> Image<u8> {
        let (width, height) = self.color.size();
        let mut gray = Image::filled(width, height, 0);
        simd::run(Luma { color: self.color.pixels(), gray: gray.pixels_mut() });
        gray
    }
}

struct Luma<'a> {
    color: &'a [[u8; 3]],
    gray: &'a mut [u8],
}

impl Kernel for Luma<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (gray, &[r, g, b]) in self.gray.iter_mut().zip(self.color) {
            // In 16-bit fixed point; the weights sum to 2^16.
            let sum = 19_595 * u32::from(r) + 38_470 * u32::from(g) + 7_471 * u32::from(b);
            *gray = ((sum + 32_768) >> 16) as u8;
        }
    }
}
