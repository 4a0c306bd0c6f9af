//! Corrections: the volume that followed equals the one of the corrected poses, to the bit.

use covis_solvers::geometry::{LieGroup, PinholeRadialTangential, Se3, So3};
use nalgebra::Vector3;

use super::super::tests::scene::{Rendered, Shape, looking, render, room};
use super::*;
use crate::block::Block;
use crate::image::Image;
use crate::page_cache::Region;

const FRAMES: usize = 24;
/// Every so many frames a keyframe.
const STEP: usize = 6;
const SIZE: (usize, usize) = (96, 72);

fn camera() -> FrameCamera {
    let lens = PinholeRadialTangential::undistorted(78.6, 78.6, 47.5, 35.5);
    FrameCamera::new(lens, SIZE.0, SIZE.1).unwrap()
}

/// A walk through the room, 0.1 m and some 3° a frame.
fn world_from_camera(index: usize) -> Se3 {
    let t = index as f64;
    let position = [-1.4 + 0.07 * t, 0.5 * (0.2 * t).sin(), 0.1 * (0.3 * t).cos()];
    looking(position, 0.05 * t - 0.6, 0.1 * (0.4 * t).sin())
}

/// A frame with a Kinect's noise. A ball flies through the room and is masked; a box that is not masked
/// vanishes, so that voxels are freed.
fn frame(index: usize) -> LoggedFrame {
    let mut scene = room();
    let ball = Vector3::new(0.6, 0.08 * index as f64 - 0.9, 0.2);
    scene.push((Shape::Ball(ball, 0.25), [30, 60, 200]));
    if index < FRAMES / 2 {
        let (center, half) = (Vector3::new(1.2, 0.0, -0.8), Vector3::new(0.3, 0.4, 0.4));
        scene.push((Shape::Box(center, half), [200, 30, 30]));
    }
    let pose = world_from_camera(index);
    let Rendered { depth_m, color, solid } = render(&scene, &camera(), &pose, Some(index as u64));
    let moving = solid.map(|solid| if solid == 1 { 255 } else { 0 });
    LoggedFrame { depth_m, color, moving: Some(moving) }
}

const GRID: VolumeOptions = VolumeOptions { voxel_m: 0.05, truncation_m: 0.3 };

fn mapper() -> DenseMapper {
    DenseMapper::new(&camera(), GRID, IntegrationOptions::default(), None).unwrap()
}

/// Drift: a keyframe's pose is off by this before the loop is closed, 0.3 m at the last.
fn drift(keyframe: usize) -> Se3 {
    let share = keyframe as f64 / (FRAMES / STEP - 1) as f64;
    let turn = So3::exp(&Vector3::new(0.01, -0.03, 0.02).scale(share));
    Se3::new(turn, Vector3::new(0.2, 0.2, 0.1).scale(share))
}

/// Frame `index` as it is handed over, and the true pose of its keyframe.
fn anchored(index: usize) -> (AnchoredFrame, Se3) {
    let keyframe = index / STEP;
    let world_from_keyframe = world_from_camera(keyframe * STEP);
    let keyframe_from_camera = world_from_keyframe.inverse().compose(&world_from_camera(index));
    (AnchoredFrame { frame: frame(index), keyframe, keyframe_from_camera }, world_from_keyframe)
}

fn true_keyframes() -> Vec<(usize, Se3)> {
    (0..FRAMES / STEP).map(|id| (id, world_from_camera(id * STEP))).collect()
}

/// All frames at the keyframes' true poses.
fn at_truth() -> DenseMapper {
    let mut mapper = mapper();
    for index in 0..FRAMES {
        let (frame, world_from_keyframe) = anchored(index);
        mapper.integrate(frame, &world_from_keyframe).unwrap();
    }
    mapper
}

fn assert_same(a: &PagedVolume, b: &PagedVolume) {
    let (a, b) = (a.resident(), b.resident());
    assert_eq!(a.keys(), b.keys());
    assert!(!a.is_empty());
    for &key in a.keys() {
        assert!(a.block(key) == b.block(key), "{key:?} differs");
    }
}

#[test]
fn after_a_loop_closure_the_volume_is_that_of_the_corrected_poses() {
    let mut drifted = mapper();
    for index in 0..FRAMES {
        let (frame, truth) = anchored(index);
        let pose = truth.compose(&drift(frame.keyframe));
        drifted.integrate(frame, &pose).unwrap();
    }
    let truth = at_truth();
    assert!(
        drifted.volume.resident().keys() != truth.volume.resident().keys(),
        "the drift changes nothing"
    );
    drifted.correct(&true_keyframes());
    let mut told = Vec::new();
    drifted.finish(&mut |again, all| told.push((again, all))).unwrap();
    assert_same(&drifted.volume, &truth.volume);
    assert_eq!(told.last(), Some(&(FRAMES - 1, FRAMES)));
    assert_eq!(drifted.rebuilt, 1);
}

#[test]
fn a_correction_is_followed_while_frames_come_two_for_each() {
    let mut mapper = mapper();
    let (before, after) = (FRAMES / 2, FRAMES);
    for index in 0..before {
        let (frame, truth) = anchored(index);
        let pose = truth.compose(&drift(frame.keyframe));
        mapper.integrate(frame, &pose).unwrap();
        assert!(!mapper.follow().unwrap(), "nothing was corrected");
    }
    mapper.correct(&true_keyframes());
    let mut behind = 0;
    for index in before..after {
        let (frame, truth) = anchored(index);
        mapper.integrate(frame, &truth).unwrap();
        behind += usize::from(mapper.follow().unwrap());
    }
    // Two again for each that comes: as many frames later as there were before, it has caught up.
    assert_eq!((mapper.rebuilt, behind), (1, before - 1));
    assert_same(&mapper.volume, &at_truth().volume);
}

#[test]
fn a_correction_below_a_quarter_of_a_voxel_waits_for_the_end() {
    let mut mapper = at_truth();
    let nudge = Se3::new(So3::identity(), Vector3::new(0.004, 0.0, 0.0));
    let moved: Vec<_> =
        true_keyframes().into_iter().map(|(id, pose)| (id, nudge.compose(&pose))).collect();
    mapper.correct(&moved);
    assert!(!mapper.follow().unwrap());
    mapper.finish(&mut |_, _| {}).unwrap();
    assert_eq!(mapper.rebuilt, 1);
}

#[test]
fn a_frame_that_makes_no_sense_is_refused_and_leaves_nothing() {
    let mut mapper = mapper();
    let (mut odd, pose) = anchored(0);
    odd.frame.color = Image::filled(5, 5, [0; 3]);
    assert!(mapper.integrate(odd, &pose).is_err());
    let (odd, mut pose) = anchored(0);
    pose.translation.x = f64::NAN;
    assert!(matches!(mapper.integrate(odd, &pose), Err(DenseError::Frame(_))));
    for index in 0..FRAMES {
        let (frame, pose) = anchored(index);
        mapper.integrate(frame, &pose).unwrap();
    }
    mapper.finish(&mut |_, _| {}).unwrap();
    assert_same(&mapper.volume, &at_truth().volume);
}

#[test]
fn under_a_ceiling_corrections_are_followed_to_the_same_blocks() {
    // The same rooms again, one for each keyframe.
    let room =
        |keyframe: usize| Se3::new(So3::identity(), Vector3::new(12.0 * keyframe as f64, 0.0, 0.0));
    let run = |ceiling: Option<MemoryCeiling>, is_true: bool| {
        let options = IntegrationOptions::default();
        let mut mapper = DenseMapper::new(&camera(), GRID, options, ceiling).unwrap();
        for index in 0..FRAMES {
            let (frame, truth) = anchored(index);
            let keyframe = frame.keyframe;
            let drift = if is_true { Se3::identity() } else { drift(keyframe) };
            mapper.integrate(frame, &room(keyframe).compose(&truth).compose(&drift)).unwrap();
            mapper.follow().unwrap();
        }
        let moved = true_keyframes();
        let moved: Vec<_> = moved.iter().map(|(id, pose)| (*id, room(*id).compose(pose))).collect();
        mapper.correct(&moved);
        mapper.finish(&mut |_, _| {}).unwrap();
        mapper
    };
    let truth = run(None, true);
    let truth = truth.volume.resident();
    // While there are two volumes each has room for more than the blocks of one room.
    let ceiling = MemoryCeiling { bytes: truth.len() * size_of::<Block>() * 3 / 4, folder: None };
    let corrected = run(Some(ceiling), false);
    assert_eq!(corrected.rebuilt, 1);
    let mut paged = corrected.volume;
    let figures = paged.paging().unwrap();
    println!("{} blocks, {figures:?}", paged.len());
    assert!(figures.blocks_on_disk > 0 && figures.frames_above_ceiling == 0, "{figures:?}");
    assert_eq!(paged.len(), truth.len());
    for (&key, block) in truth.keys().iter().zip(truth.blocks().iter()) {
        let part = paged.bring(&[Region::of(key)]).unwrap();
        assert!(part.block(key) == Some(block), "{key:?} differs");
    }
}
