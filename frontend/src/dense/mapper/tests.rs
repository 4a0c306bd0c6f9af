//! Corrections: the volume that followed equals the one of the corrected poses, to the bit.

use covis_solvers::geometry::{LieGroup, Se3, So3};
use nalgebra::Vector3;

use super::*;
use crate::dense::block::Block;
use crate::dense::page_cache::Region;
use crate::image::Image;
use crate::synthetic::{SceneName, Sequence, SequenceOptions};

const FRAMES: usize = 24;
/// Every so many frames a keyframe.
const STEP: usize = 6;

fn sequence() -> (Sequence, FrameCamera) {
    let options = SequenceOptions { width: 96, height: 72, frames: FRAMES, seed: 3, noise: true };
    let sequence = Sequence::new(SceneName::Walking, &options);
    let camera = FrameCamera::new(*sequence.camera(), 96, 72).unwrap();
    (sequence, camera)
}

const GRID: VolumeOptions = VolumeOptions { voxel_m: 0.05, truncation_m: 0.3 };

fn mapper(camera: &FrameCamera) -> DenseMapper {
    DenseMapper::new(camera, GRID, IntegrationOptions::default(), None).unwrap()
}

/// Drift: a keyframe's pose is off by this before the loop is closed, 0.3 m at the last.
fn drift(keyframe: usize) -> Se3 {
    let share = keyframe as f64 / (FRAMES / STEP - 1) as f64;
    let turn = So3::exp(&Vector3::new(0.01, -0.03, 0.02).scale(share));
    Se3::new(turn, Vector3::new(0.2, 0.2, 0.1).scale(share))
}

/// Frame `index` as it is handed over, and the true pose of its keyframe.
fn anchored(sequence: &Sequence, index: usize) -> (AnchoredFrame, Se3) {
    let keyframe = index / STEP;
    let world_from_keyframe = sequence.world_from_camera(keyframe * STEP);
    let camera = sequence.world_from_camera(index);
    let frame = sequence.frame(index);
    let frame = LoggedFrame {
        depth_m: frame.depth_m,
        color: frame.color,
        moving: Some(sequence.moving_mask(index)),
    };
    let keyframe_from_camera = world_from_keyframe.inverse().compose(&camera);
    (AnchoredFrame { frame, keyframe, keyframe_from_camera }, world_from_keyframe)
}

fn true_keyframes(sequence: &Sequence) -> Vec<(usize, Se3)> {
    (0..FRAMES / STEP).map(|id| (id, sequence.world_from_camera(id * STEP))).collect()
}

/// All frames at the keyframes' true poses.
fn at_truth(sequence: &Sequence, camera: &FrameCamera) -> DenseMapper {
    let mut mapper = mapper(camera);
    for index in 0..FRAMES {
        let (frame, world_from_keyframe) = anchored(sequence, index);
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
    let (sequence, camera) = sequence();
    let mut drifted = mapper(&camera);
    for index in 0..FRAMES {
        let (frame, truth) = anchored(&sequence, index);
        let pose = truth.compose(&drift(frame.keyframe));
        drifted.integrate(frame, &pose).unwrap();
    }
    let truth = at_truth(&sequence, &camera);
    assert!(
        drifted.volume().resident().keys() != truth.volume().resident().keys(),
        "the drift changes nothing"
    );
    drifted.correct(&true_keyframes(&sequence));
    let mut told = Vec::new();
    drifted.finish(&mut |again, all| told.push((again, all))).unwrap();
    assert_same(drifted.volume(), truth.volume());
    assert_eq!(told.last(), Some(&(FRAMES - 1, FRAMES)));
    assert_eq!(drifted.rebuilt(), 1);
}

#[test]
fn a_correction_is_followed_while_frames_come_two_for_each() {
    let (sequence, camera) = sequence();
    let mut mapper = mapper(&camera);
    let (before, after) = (FRAMES / 2, FRAMES);
    for index in 0..before {
        let (frame, truth) = anchored(&sequence, index);
        let pose = truth.compose(&drift(frame.keyframe));
        mapper.integrate(frame, &pose).unwrap();
        assert!(!mapper.follow().unwrap(), "nothing was corrected");
    }
    mapper.correct(&true_keyframes(&sequence));
    let mut behind = 0;
    for index in before..after {
        let (frame, truth) = anchored(&sequence, index);
        mapper.integrate(frame, &truth).unwrap();
        behind += usize::from(mapper.follow().unwrap());
    }
    // Two again for each that comes: as many frames later as there were before, it has caught up.
    assert_eq!((mapper.rebuilt(), behind), (1, before - 1));
    assert_same(mapper.volume(), at_truth(&sequence, &camera).volume());
}

#[test]
fn a_correction_below_a_quarter_of_a_voxel_waits_for_the_end() {
    let (sequence, camera) = sequence();
    let mut mapper = at_truth(&sequence, &camera);
    let nudge = Se3::new(So3::identity(), Vector3::new(0.004, 0.0, 0.0));
    let moved: Vec<_> = true_keyframes(&sequence)
        .into_iter()
        .map(|(id, pose)| (id, nudge.compose(&pose)))
        .collect();
    mapper.correct(&moved);
    assert!(!mapper.follow().unwrap());
    mapper.finish(&mut |_, _| {}).unwrap();
    assert_eq!(mapper.rebuilt(), 1);
}

#[test]
fn a_frame_that_makes_no_sense_is_refused_and_leaves_nothing() {
    let (sequence, camera) = sequence();
    let mut mapper = mapper(&camera);
    let (mut odd, pose) = anchored(&sequence, 0);
    odd.frame.color = Image::filled(5, 5, [0; 3]);
    assert!(mapper.integrate(odd, &pose).is_err());
    let (odd, mut pose) = anchored(&sequence, 0);
    pose.translation.x = f64::NAN;
    assert!(matches!(mapper.integrate(odd, &pose), Err(DenseError::Frame(_))));
    for index in 0..FRAMES {
        let (frame, pose) = anchored(&sequence, index);
        mapper.integrate(frame, &pose).unwrap();
    }
    mapper.finish(&mut |_, _| {}).unwrap();
    assert_same(mapper.volume(), at_truth(&sequence, &camera).volume());
}

#[test]
fn under_a_ceiling_corrections_are_followed_to_the_same_blocks() {
    let (sequence, camera) = sequence();
    // The same rooms again, one for each keyframe.
    let room =
        |keyframe: usize| Se3::new(So3::identity(), Vector3::new(12.0 * keyframe as f64, 0.0, 0.0));
    let run = |ceiling: Option<MemoryCeiling>, is_true: bool| {
        let options = IntegrationOptions::default();
        let mut mapper = DenseMapper::new(&camera, GRID, options, ceiling).unwrap();
        for index in 0..FRAMES {
            let (frame, truth) = anchored(&sequence, index);
            let keyframe = frame.keyframe;
            let drift = if is_true { Se3::identity() } else { drift(keyframe) };
            mapper.integrate(frame, &room(keyframe).compose(&truth).compose(&drift)).unwrap();
            mapper.follow().unwrap();
        }
        let moved = true_keyframes(&sequence);
        let moved: Vec<_> = moved.iter().map(|(id, pose)| (*id, room(*id).compose(pose))).collect();
        mapper.correct(&moved);
        mapper.finish(&mut |_, _| {}).unwrap();
        mapper
    };
    let truth = run(None, true);
    let truth = truth.volume().resident();
    // While there are two volumes each has room for more than the blocks of one room.
    let ceiling = MemoryCeiling { bytes: truth.len() * size_of::<Block>() * 3 / 4, folder: None };
    let corrected = run(Some(ceiling), false);
    assert_eq!(corrected.rebuilt(), 1);
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
