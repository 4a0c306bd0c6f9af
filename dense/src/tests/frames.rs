//! Frames of all kinds: threads, vectors, bad numbers, places far away.

use covis_solvers::geometry::Se3;
use nalgebra::Vector3;

use super::scene::{Rendered, camera, distorted_camera, furnished, looking, path, render, surface};
use super::{fuse, volume};
use crate::block::{BlockKey, DISTANCE_ONE};
use crate::image::Image;
use crate::integrate::{DenseFrame, IntegrateError, IntegrationOptions, Integrator};
use crate::volume::{Volume, VolumeOptions};
use covis_solvers::simd::Class;

fn same(a: &Volume, b: &Volume) -> bool {
    a.keys() == b.keys() && a.states() == b.states() && a.blocks().iter().eq(b.blocks().iter())
}

fn fused(threads: usize, class: Class, lens: bool) -> Volume {
    let camera = if lens { distorted_camera() } else { camera() };
    let options = IntegrationOptions::default();
    let mut integrator = Integrator::new(&camera, options).with_class(class);
    let mut volume = volume(0.04);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
    for i in 0..10 {
        let mut scene = furnished();
        // Something goes, so that voxels are freed.
        scene.truncate(if i < 5 { 3 } else { 1 });
        let view = render(&scene, &camera, &path(i), Some(i as u64));
        pool.install(|| fuse(&mut integrator, &mut volume, &view, &path(i)));
    }
    volume
}

#[test]
fn bits_do_not_depend_on_threads_or_vectors() {
    for lens in [false, true] {
        let reference = fused(1, Class::Scalar, lens);
        assert!(reference.len() > 100);
        for class in Class::ALL.into_iter().filter(|class| class.is_available()) {
            for threads in [1, 2, 3] {
                assert!(same(&fused(threads, class, lens), &reference), "{class:?}");
            }
        }
    }
}

#[test]
fn depth_that_is_none_leaves_no_trace() {
    let camera = camera();
    let pose = path(0);
    let mut view = render(&furnished(), &camera, &pose, None);
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1.0, 0.0, 1e30, 4.1, 1e-30, f32::MAX] {
        view.depth_m.pixels_mut().fill(bad);
        let mut volume = volume(0.02);
        fuse(
            &mut Integrator::new(&camera, IntegrationOptions::default()),
            &mut volume,
            &view,
            &pose,
        );
        assert!(volume.is_empty(), "{bad}");
        assert_eq!(volume.revision(), 1);
    }
}

#[test]
fn what_moves_is_not_integrated() {
    let camera = camera();
    let pose = path(0);
    let scene = furnished();
    let Rendered { depth_m, color, solid } = render(&scene, &camera, &pose, None);
    let moving = solid.map(|solid| if solid == 2 { 255 } else { 0 });
    let mut volume = volume(0.02);
    let frame = DenseFrame {
        depth_m: &depth_m,
        color: &color,
        moving: Some(&moving),
        world_from_camera: &pose,
    };
    Integrator::new(&camera, IntegrationOptions::default()).integrate(&mut volume, &frame).unwrap();
    let (ball, _) = scene[2];
    let points = surface(&volume);
    assert!(points.len() > 1000);
    assert!(points.iter().all(|(point, _)| ball.distance(point) > 0.05));
}

#[test]
fn frames_that_make_no_sense_are_refused() {
    let camera = camera();
    let mut integrator = Integrator::new(&camera, IntegrationOptions::default());
    let mut volume = volume(0.02);
    let (depth, color) = (Image::filled(320, 240, 1.0), Image::filled(320, 240, [0; 3]));
    let pose = path(0);
    let frame =
        DenseFrame { depth_m: &depth, color: &color, moving: None, world_from_camera: &pose };
    let small = Image::filled(319, 240, 1.0);
    let small_color = Image::filled(320, 241, [0; 3]);
    let small_mask = Image::filled(1, 1, 0);
    let mut refused = |frame: DenseFrame<'_>| {
        let error = integrator.integrate(&mut volume, &frame).unwrap_err();
        assert!(volume.is_empty() && volume.revision() == 0);
        error
    };
    for (frame, name) in [
        (DenseFrame { depth_m: &small, ..frame }, "depth_m"),
        (DenseFrame { color: &small_color, ..frame }, "color"),
        (DenseFrame { moving: Some(&small_mask), ..frame }, "moving"),
    ] {
        let error = refused(frame);
        assert!(
            matches!(error, IntegrateError::ImageSize { image, .. } if image == name),
            "{error}"
        );
    }
    for bad in [f64::NAN, f64::INFINITY] {
        let pose = Se3 { translation: Vector3::new(0.0, bad, 0.0), ..pose };
        assert_eq!(refused(DenseFrame { world_from_camera: &pose, ..frame }), IntegrateError::Pose);
    }
    for far in [1e9, -1e12, 1e300] {
        let pose = Se3 { translation: Vector3::new(0.0, far, 0.0), ..pose };
        assert_eq!(
            refused(DenseFrame { world_from_camera: &pose, ..frame }),
            IntegrateError::TooFar
        );
    }
    for (voxel_m, truncation_m) in
        [(0.0, 0.1), (f32::NAN, 0.1), (0.01, -1.0), (0.01, f32::INFINITY)]
    {
        let mut volume = Volume::new(VolumeOptions { voxel_m, truncation_m });
        let error = integrator.integrate(&mut volume, &frame).unwrap_err();
        assert!(matches!(error, IntegrateError::Options { .. }), "{error}");
    }
    // So many blocks that their marks alone would fill the memory.
    let mut volume = Volume::new(VolumeOptions { voxel_m: 1e-6, truncation_m: 8e-6 });
    assert_eq!(integrator.integrate(&mut volume, &frame), Err(IntegrateError::TooFar));
}

#[test]
fn a_place_far_away_is_like_any_other() {
    let camera = camera();
    // A whole number of blocks: the same grid.
    let far = Vector3::new(1e6, -2e6, 4e5) * volume(0.02).options().block_m();
    let [near, away] = [Vector3::zeros(), far].map(|offset| {
        let mut volume = volume(0.02);
        let mut integrator = Integrator::new(&camera, IntegrationOptions::default());
        let pose = looking([-1.0, 0.1, 0.2], 0.1, -0.1);
        let view = render(&furnished(), &camera, &pose, None);
        let pose = Se3 { translation: pose.translation + offset, ..pose };
        fuse(&mut integrator, &mut volume, &view, &pose);
        volume
    });
    let mut errors = (0.0, 0.0);
    for (key, block) in near.keys().iter().zip(near.blocks().iter()) {
        let BlockKey { x, y, z } = *key;
        let key = BlockKey { x: x + 1_000_000, y: y - 2_000_000, z: z + 400_000 };
        let Some(other) = away.block(key) else { continue };
        for (a, b) in block.distances.iter().zip(&other.distances) {
            errors.0 += f64::from(a.abs_diff(*b)) / f64::from(DISTANCE_ONE);
            errors.1 += 1.0;
        }
    }
    assert!(near.len().abs_diff(away.len()) < near.len() / 50, "{} {}", near.len(), away.len());
    assert!(
        errors.1 > 0.98 * 512.0 * near.len() as f64 && errors.0 < 0.01 * errors.1,
        "{errors:?}"
    );
}
