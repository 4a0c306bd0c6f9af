//! The stages on images with ground truth: rendered sequences, and textures that are functions.

use covis_solvers::geometry::{LieGroup, PinholeRadialTangential, Se3, So3};
use nalgebra::{Matrix2, Vector2, Vector3};

use super::alignment::{FINEST, Reference};
use super::local_matching::CurrentView;
use super::patch_match::WarpedPatch;
use super::points::select_points;
use super::rotation::SmallImage;
use super::surfaces::{CurrentDepth, Surfaces};
use crate::camera::FrameCamera;
use crate::image::{Image, RgbdFrame};
use crate::pyramid::Pyramid;
use crate::shutter::Shutter;
use crate::synthetic::{SceneName, Sequence, SequenceOptions};

/// A smooth texture without repetition: sums of waves of many directions.
fn texture(x: f64, y: f64) -> f64 {
    let waves = [
        (0.11, 0.05, 0.3),
        (-0.07, 0.13, 1.1),
        (0.29, -0.03, 2.0),
        (0.02, 0.31, 0.7),
        (0.17, 0.19, 4.0),
    ];
    let sum: f64 = waves.iter().map(|(a, b, c)| (a * x + b * y + c).sin()).sum();
    120.0 + 24.0 * sum
}

fn drawn(width: usize, height: usize, gray: impl Fn(f64, f64) -> f64) -> Image<u8> {
    let mut image = Image::filled(width, height, 0);
    for v in 0..height {
        for u in 0..width {
            image.set(u, v, gray(u as f64, v as f64).round().clamp(0.0, 255.0) as u8);
        }
    }
    image
}

fn sequence(frames: usize) -> Sequence {
    let options = SequenceOptions { width: 320, height: 240, frames, seed: 3, noise: false };
    Sequence::new(SceneName::Static, &options)
}

fn view<'a>(
    camera: &'a FrameCamera,
    pyramid: &'a Pyramid,
    depth_m: &'a Image<f32>,
) -> CurrentView<'a> {
    CurrentView { camera, pyramid, depth_m, shutter: Shutter::default(), moving: None }
}

#[test]
fn alignment_recovers_a_known_motion_to_a_milliradian_and_a_millimeter() {
    let sequence = sequence(9);
    let camera = FrameCamera::new(*sequence.camera(), 320, 240).unwrap();
    let frames = [0, 8].map(|index| sequence.frame(index));
    let pyramids = frames.each_ref().map(|frame| Pyramid::new(frame.gray(), 4));
    let points = select_points(&view(&camera, &pyramids[0], &frames[0].depth_m));
    assert!(points.len() > 100, "{} points", points.len());
    let truth = sequence.world_from_camera(8).inverse().compose(&sequence.world_from_camera(0));
    let still = Shutter::default();
    let reference = Reference::new(&camera, &pyramids[0], &points, 0);
    let found = reference.align(&camera, &still, &pyramids[1], &Se3::identity()).unwrap();
    let error = truth.inverse().compose(&found.current_from_reference);
    let (angle, distance) = (error.rotation.log().norm(), error.translation.norm());
    let moved = truth.translation.norm();
    assert!(moved > 0.02, "the camera moved {moved} m only");
    assert!(angle < 1e-3 && distance < 1e-3, "{angle} rad, {distance} m of {moved} m");
}

#[test]
fn alignment_tells_a_change_of_exposure_from_a_motion() {
    let sequence = sequence(4);
    let camera = FrameCamera::new(*sequence.camera(), 320, 240).unwrap();
    let frames = [0, 3].map(|index| sequence.frame(index));
    let brighter = frames[1].gray().map(|gray| (f32::from(gray) * 0.8 + 30.0).round() as u8);
    let pyramids = [Pyramid::new(frames[0].gray(), 4), Pyramid::new(brighter, 4)];
    let points = select_points(&view(&camera, &pyramids[0], &frames[0].depth_m));
    let truth = sequence.world_from_camera(3).inverse().compose(&sequence.world_from_camera(0));
    let still = Shutter::default();
    let reference = Reference::new(&camera, &pyramids[0], &points, FINEST);
    let found = reference.align(&camera, &still, &pyramids[1], &Se3::identity()).unwrap();
    let error = truth.inverse().compose(&found.current_from_reference);
    assert!((found.gain - 0.8).abs() < 0.02 && (found.offset - 30.0).abs() < 3.0, "{found:?}");
    assert!(error.rotation.log().norm() < 2e-3 && error.translation.norm() < 4e-3, "{error:?}");
}

#[test]
fn too_few_points_and_flat_images_have_no_alignment() {
    let sequence = sequence(2);
    let camera = FrameCamera::new(*sequence.camera(), 320, 240).unwrap();
    let frame = sequence.frame(0);
    let (pyramid, black) =
        (Pyramid::new(frame.gray(), 4), Pyramid::new(Image::filled(320, 240, 0), 4));
    let points = select_points(&view(&camera, &pyramid, &frame.depth_m));
    let still = Shutter::default();
    let few = Reference::new(&camera, &pyramid, &points[..5], FINEST);
    assert_eq!(few.align(&camera, &still, &pyramid, &Se3::identity()), None);
    // No point is selected in a black image.
    assert!(select_points(&view(&camera, &black, &frame.depth_m)).is_empty());
    let no_depth = Image::filled(320, 240, 0.0);
    assert!(select_points(&view(&camera, &pyramid, &no_depth)).is_empty());
}

#[test]
fn a_patch_is_found_to_a_tenth_of_a_pixel() {
    let keyframe = Pyramid::new(drawn(200, 160, texture), 3);
    // x' = A (x − c) + c + t, another exposure, and an expectation that is off by more than a pixel.
    let center = Vector2::new(100.0, 80.0);
    for (angle, zoom) in [(0.0, 1.0), (0.15, 1.0), (-0.1, 1.12), (0.05, 0.9)] {
        let (sin, cos) = f64::sin_cos(angle);
        let warp = Matrix2::new(cos, -sin, sin, cos) * zoom;
        let back = warp.try_inverse().unwrap();
        let shift = Vector2::new(7.3, -4.6);
        let current = drawn(200, 160, |u, v| {
            let source = back * (Vector2::new(u, v) - center - shift) + center;
            texture(source.x, source.y) + 12.0
        });
        let current = Pyramid::new(current, 3);
        let mut count = 0;
        for at in 0..16 {
            let pixel =
                Vector2::new(85.0 + 10.0 * f64::from(at % 4), 65.0 + 10.0 * f64::from(at / 4));
            let truth = warp * (pixel - center) + center + shift;
            let patch = WarpedPatch::new(&keyframe, &pixel, &warp, 0).unwrap();
            let expected = truth + Vector2::new(1.1, -1.1);
            let Some((found, correlation)) = patch.find(&current, &expected) else { continue };
            let error = (found - truth).norm();
            assert!(error < 0.1 && correlation > 0.95, "{angle} {zoom} {pixel}: {error} px");
            count += 1;
        }
        // The texture is flat at the others.
        assert!(count >= 10, "{angle} {zoom}: {count} of 16 found");
    }
}

#[test]
fn flat_patches_and_other_places_are_not_matched() {
    let keyframe = Pyramid::new(drawn(120, 120, texture), 3);
    let flat = Pyramid::new(drawn(120, 120, |u, _| 100.0 + 0.2 * u), 3);
    let pixel = Vector2::new(60.0, 60.0);
    let one = Matrix2::identity();
    let patch = WarpedPatch::new(&flat, &pixel, &one, 0).unwrap();
    assert!(patch.find(&flat, &pixel).is_none());
    let elsewhere = Pyramid::new(drawn(120, 120, |u, v| texture(u + 400.0, 300.0 - v)), 3);
    let patch = WarpedPatch::new(&keyframe, &pixel, &one, 0).unwrap();
    assert!(patch.find(&elsewhere, &pixel).is_none());
    // Near the border there is no patch.
    assert!(WarpedPatch::new(&keyframe, &Vector2::new(2.0, 60.0), &one, 0).is_none());
}

#[test]
fn the_first_guess_finds_rotations_of_many_pixels() {
    let lens = PinholeRadialTangential::undistorted(260.0, 260.0, 159.5, 119.5);
    let camera = FrameCamera::new(lens, 320, 240).unwrap();
    let scene = |rotation: &So3| {
        let back = rotation.inverse().matrix();
        Pyramid::new(
            drawn(320, 240, |u, v| {
                let ray = back * Vector3::new((u - 159.5) / 260.0, (v - 119.5) / 260.0, 1.0);
                texture(0.4 * 260.0 * ray.x / ray.z, 0.4 * 260.0 * ray.y / ray.z)
            }),
            4,
        )
    };
    for turn in [[0.03, -0.08, 0.02], [-0.06, 0.05, -0.05], [0.0, 0.1, 0.0]] {
        let truth = So3::exp(&Vector3::from(turn));
        let [first, second] =
            [So3::identity(), truth].map(|rotation| SmallImage::new(&scene(&rotation)));
        let found = first.rotation_to(&second, &camera, &So3::identity(), |_| false).unwrap();
        let error = truth.inverse().compose(&found).log().norm();
        assert!(error < 0.005, "{turn:?}: {error} rad");
    }
}

/// Two frames of a static room, half a second apart, and current_from_last.
fn two_frames() -> (FrameCamera, [RgbdFrame; 2], Se3) {
    let sequence = sequence(9);
    let camera = FrameCamera::new(*sequence.camera(), 320, 240).unwrap();
    let frames = [0, 8].map(|index| sequence.frame(index));
    let truth = sequence.world_from_camera(8).inverse().compose(&sequence.world_from_camera(0));
    (camera, frames, truth)
}

#[test]
fn surfaces_agree_with_the_motion_of_the_camera_and_with_no_other() {
    let (camera, frames, truth) = two_frames();
    let pyramid = Pyramid::new(frames[0].gray(), 4);
    let surfaces = Surfaces::new(&view(&camera, &pyramid, &frames[0].depth_m));
    let depth_m = &frames[1].depth_m;
    let current = CurrentDepth { camera: &camera, depth_m, delay_share: 0.0 };
    let share = |motion: &Se3| surfaces.agreement(&current, motion).unwrap();
    assert!(share(&truth) > 0.9, "{} agree with the truth", share(&truth));
    let wrong = truth.compose(&Se3::new(
        So3::exp(&Vector3::new(0.03, -0.02, 0.01)),
        Vector3::new(0.01, -0.02, 0.03),
    ));
    assert!(share(&wrong) < 0.7, "{} agree with what is wrong", share(&wrong));
    // Without depth there is no result.
    let nothing = Image::filled(320, 240, 0.0);
    let blind = CurrentDepth { depth_m: &nothing, ..current };
    assert_eq!(surfaces.agreement(&blind, &truth), None);
}
