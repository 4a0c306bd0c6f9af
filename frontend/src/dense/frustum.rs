//! The frustum of a camera: space between four planes through its center, up to a depth.
//!
//! Answers are conservative: a box that is reported outside is not seen. Independent of frames and
//! blocks.

use covis_solvers::geometry::Se3;
use nalgebra::Vector3;

/// A view frustum.
#[derive(Clone, Debug)]
pub(super) struct Frustum {
    /// Inward normals, and offsets that are added to the product with a point.
    planes: [(Vector3<f64>, f64); 6],
}

impl Frustum {
    /// The frustum of a camera. `field` has the least and greatest x/z, then y/z of its rays, and
    /// `wider` is added on each side; the largest depth is in meters.
    pub(super) fn new(
        field: [f32; 4],
        wider: f64,
        world_from_camera: &Se3,
        farthest_m: f64,
    ) -> Self {
        let [left, right, top, bottom] = field.map(f64::from);
        let planes = [
            ([1.0, 0.0, wider - left], 0.0),
            ([-1.0, 0.0, wider + right], 0.0),
            ([0.0, 1.0, wider - top], 0.0),
            ([0.0, -1.0, wider + bottom], 0.0),
            ([0.0, 0.0, 1.0], 0.0),
            ([0.0, 0.0, -1.0], farthest_m),
        ];
        Self {
            planes: planes.map(|(normal, offset)| {
                let normal = world_from_camera.rotation.matrix() * Vector3::from(normal);
                (normal, offset - normal.dot(&world_from_camera.translation))
            }),
        }
    }

    /// Whether a box along the world's axes may intersect it, by its center and half its edge, meters.
    pub(super) fn meets(&self, center: &Vector3<f64>, half_m: f64) -> bool {
        self.planes.iter().all(|(normal, offset)| {
            normal.dot(center) + offset + half_m * normal.abs().sum() >= 0.0
        })
    }
}

#[cfg(test)]
mod tests {
    use covis_solvers::geometry::{LieGroup, So3};

    use super::*;

    #[test]
    fn what_a_pixel_sees_is_met_and_what_lies_behind_is_not() {
        let turn = So3::exp(&Vector3::new(0.4, -1.1, 0.3));
        let pose = Se3 { rotation: turn, translation: Vector3::new(1.0, 2.0, -3.0) };
        let frustum = Frustum::new([-0.6, 0.5, -0.4, 0.45], 0.02, &pose, 4.0);
        for i in 0..1000 {
            let share = |k: usize| (i / 10_usize.pow(k as u32) % 10) as f64 / 9.0;
            let (a, b, z) = (-0.6 + 1.1 * share(0), -0.4 + 0.85 * share(1), 3.99 * share(2));
            let seen = pose.transform(&Vector3::new(a * z, b * z, z));
            assert!(frustum.meets(&seen, 0.0), "{a} {b} {z}");
            assert!(frustum.meets(&(seen + Vector3::repeat(0.3)), 0.3));
        }
        for away in [[0.0, 0.0, -0.1], [0.0, 0.0, 4.1], [-3.0, 0.0, 4.0], [0.0, 2.1, 4.0]] {
            assert!(!frustum.meets(&pose.transform(&Vector3::from(away)), 0.001), "{away:?}");
        }
    }
}
