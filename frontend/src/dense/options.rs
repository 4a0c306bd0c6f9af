//! The options of integration, and their validation. Lengths are in meters. Nothing is allocated here.

use super::volume::VolumeOptions;
use crate::depth::sigma_m;

/// Options of integration.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IntegrationOptions {
    /// Depth beyond this is not used, meters; 0.1 to 30. Depth is rounded to this / 65535.
    pub max_depth_m: f32,
    /// Voxels behind a surface are updated up to the truncation, or up to this many standard deviations
    /// of depth where that is more. 0: the truncation is fixed.
    pub truncation_sigmas: f32,
    /// Largest weight of a voxel, in measurements at full weight, 1 to 255.
    pub max_weight: f32,
    /// Whether measurements have less weight where depth is large or the surface is oblique.
    pub weigh_noise: bool,
    /// Whether voxels forget what is gone, and are reset where the scene has changed.
    pub dynamic: bool,
    /// The mask of what moves is dilated by this much, pixels.
    pub dilation_px: usize,
}

impl Default for IntegrationOptions {
    fn default() -> Self {
        Self {
            max_depth_m: 4.0,
            truncation_sigmas: 0.0,
            max_weight: 64.0,
            weigh_noise: true,
            dynamic: true,
            dilation_px: 4,
        }
    }
}

impl IntegrationOptions {
    /// How far behind a depth voxels are updated, meters.
    pub(super) fn behind_m(&self, depth_m: f32, truncation_m: f32) -> f32 {
        if self.truncation_sigmas == 0.0 {
            return truncation_m;
        }
        truncation_m.max(self.truncation_sigmas * sigma_m(f64::from(depth_m)) as f32)
    }

    /// The name of the first option or measure that is out of range.
    pub(super) fn refused(&self, measures: &VolumeOptions) -> Option<&'static str> {
        let within = |x: f32, least: f32, most: f32| x >= least && x <= most;
        let measures = [
            ("voxel_m", measures.voxel_m > 0.0 && measures.voxel_m.is_finite()),
            ("truncation_m", measures.truncation_m > 0.0 && measures.truncation_m.is_finite()),
            ("max_depth_m", within(self.max_depth_m, 0.1, 30.0)),
            ("max_weight", within(self.max_weight, 1.0, 255.0)),
            ("truncation_sigmas", within(self.truncation_sigmas, 0.0, 100.0)),
        ];
        measures.into_iter().find_map(|(name, is_good)| (!is_good).then_some(name))
    }
}
