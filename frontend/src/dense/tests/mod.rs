//! Fusion against scenes whose truth is known.

mod changes;
mod frames;
mod paging;
mod scene;

use covis_solvers::geometry::Se3;

use super::integrate::{DenseFrame, IntegrationOptions, Integrator};
use super::volume::{Volume, VolumeOptions};
use scene::{Scene, View, camera, distorted_camera, furnished, path, render, rmse_m};

/// A volume with a truncation of eight voxels.
fn volume(voxel_m: f32) -> Volume {
    Volume::new(VolumeOptions { voxel_m, truncation_m: 8.0 * voxel_m })
}

fn plain() -> IntegrationOptions {
    IntegrationOptions { dynamic: false, ..IntegrationOptions::default() }
}

fn fuse(integrator: &mut Integrator, volume: &mut Volume, view: &View, pose: &Se3) {
    let View { depth_m, color, .. } = view;
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
            for options in [plain(), IntegrationOptions::default()] {
                let error = error(&scene, options, voxel_m, lens, false);
                println!(
                    "{voxel_m} m, lens {lens}, dynamic {}: {error:.3} voxels",
                    options.dynamic
                );
                assert!(error <= 0.15, "{error}");
            }
        }
    }
}

#[test]
fn noisy_depth_gives_the_surface_to_half_a_voxel() {
    let scene = furnished();
    let growing = IntegrationOptions { truncation_sigmas: 3.0, ..IntegrationOptions::default() };
    let flat = IntegrationOptions { weigh_noise: false, ..plain() };
    for options in [plain(), flat, IntegrationOptions::default(), growing] {
        let error = error(&scene, options, 0.02, true, true);
        println!("dynamic {}: {error:.3} voxels", options.dynamic);
        assert!(error <= 0.5, "{error}");
    }
}
