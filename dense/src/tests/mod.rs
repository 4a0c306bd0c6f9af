//! Fusion against scenes whose truth is known.

mod changes;
mod frames;
mod paging;
pub(crate) mod scene;

use covis_solvers::geometry::Se3;

use super::integrate::{DenseFrame, IntegrationOptions, Integrator};
use super::surface::{self, Mesh};
use super::volume::{Volume, VolumeOptions};
use scene::{Rendered, Scene, camera, distorted_camera, furnished, path, render, rmse_m};

/// A volume with a truncation of eight voxels.
fn volume(voxel_m: f32) -> Volume {
    Volume::new(VolumeOptions { voxel_m, truncation_m: 8.0 * voxel_m })
}

/// The surface of a volume in memory.
pub(super) fn extract(volume: &Volume) -> Mesh {
    surface::extract(&mut volume.clone().into()).unwrap()
}

fn fuse(integrator: &mut Integrator, volume: &mut Volume, view: &Rendered, pose: &Se3) {
    let Rendered { depth_m, color, .. } = view;
    let frame = DenseFrame { depth_m, color, moving: None, world_from_camera: pose };
    integrator.integrate(volume, &frame).unwrap();
}

/// Root mean square error of the surface in voxels after `frames` on the path.
fn error(scene: &Scene, options: IntegrationOptions, voxel_m: f32, lens: bool, noise: bool) -> f64 {
    let camera = if lens { distorted_camera() } else { camera() };
    let mut integrator = Integrator::new(&camera, options);
    let mut volume = volume(voxel_m);
    for i in 0..40 {
        let pose = path(2 * i);
        let view = render(scene, &camera, &pose, noise.then_some(i as u64));
        fuse(&mut integrator, &mut volume, &view, &pose);
    }
    rmse_m(scene, &volume) / f64::from(voxel_m)
}

#[test]
fn exact_depth_gives_the_surface_to_a_fraction_of_a_voxel() {
    let scene = furnished();
    for voxel_m in [0.02, 0.04] {
        for lens in [false, true] {
            let error = error(&scene, IntegrationOptions::default(), voxel_m, lens, false);
            println!("{voxel_m} m, lens {lens}: {error:.3} voxels");
            assert!(error <= 0.15, "{error}");
        }
    }
}

#[test]
fn noisy_depth_gives_the_surface_to_half_a_voxel() {
    let scene = furnished();
    let flat = IntegrationOptions { weigh_noise: false, ..IntegrationOptions::default() };
    for options in [flat, IntegrationOptions::default()] {
        let error = error(&scene, options, 0.02, true, true);
        println!("weighed {}: {error:.3} voxels", options.weigh_noise);
        assert!(error <= 0.5, "{error}");
    }
}
