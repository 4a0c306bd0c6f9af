//! The pipeline on rendered sequences, without a server: the test makes the corrections.

use std::collections::BTreeSet;
use std::sync::Arc;

use covis_solvers::geometry::{LieGroup, Se3, So3};
use nalgebra::{Vector3, Vector6};

use super::relocalization::Answer;
use super::{Outcome, Pipeline, PipelineOptions, TrackedFrame};
use crate::camera::FrameCamera;
use crate::image::{Image, RgbdFrame};
use crate::local_map::Corrections;
use crate::motion::MotionDetector;
use crate::synthetic::{SceneName, Sequence, SequenceOptions};

const SIZE: (usize, usize) = (320, 240);

fn sequence(scene: SceneName, frames: usize) -> Sequence {
    let (width, height) = SIZE;
    Sequence::new(scene, &SequenceOptions { width, height, frames, seed: 1, noise: false })
}

fn pipeline(sequence: &Sequence) -> Pipeline {
    let camera = FrameCamera::new(*sequence.camera(), SIZE.0, SIZE.1).unwrap();
    Pipeline::new(camera, PipelineOptions::default())
}

fn black(timestamp_s: f64) -> RgbdFrame {
    let color = Image::filled(SIZE.0, SIZE.1, [0; 3]);
    RgbdFrame {
        timestamp_s,
        depth_delay_s: 0.0,
        color,
        depth_m: Image::filled(SIZE.0, SIZE.1, 0.0),
        given_pose: None,
    }
}

/// The error of a pose in m and rad, each trajectory relative to its first frame.
fn error(sequence: &Sequence, index: usize, tracked: &TrackedFrame) -> (f64, f64) {
    let first = sequence.world_from_camera(0).inverse();
    let truth = first.compose(&sequence.world_from_camera(index));
    let error = truth.inverse().compose(&tracked.world_from_camera);
    (error.translation.norm(), error.rotation.log().norm())
}

#[test]
fn a_static_scene_is_tracked_to_millimeters() {
    let sequence = sequence(SceneName::Static, 16);
    let mut pipeline = pipeline(&sequence);
    for index in 0..16 {
        let outcome = pipeline.track(&sequence.frame(index), None);
        let tracked = outcome.tracked.unwrap();
        let (meters, radians) = error(&sequence, index, &tracked);
        assert!(meters < 0.006 && radians < 0.004, "frame {index}: {meters} m, {radians} rad");
        let moving = outcome.moving.unwrap();
        let share = moving.pixels().iter().filter(|&&pixel| pixel > 0).count();
        assert!(share < moving.pixels().len() / 50, "frame {index}: {share} pixels move");
    }
}

#[test]
fn a_correction_moves_the_map_and_odometry_does_not_jump() {
    let sequence = sequence(SceneName::Static, 8);
    let frames: Vec<RgbdFrame> = (0..8).map(|index| sequence.frame(index)).collect();
    let run = |shift: Option<Se3>| -> Vec<TrackedFrame> {
        let mut pipeline = pipeline(&sequence);
        let track = |(index, frame): (usize, &RgbdFrame)| {
            let tracked = pipeline.track(frame, None).tracked.unwrap();
            if let (4, Some(shift)) = (index, shift) {
                let map = pipeline.map();
                let pose = |k: &crate::local_map::MapKeyframe| shift.compose(&k.world_from_camera);
                let keyframes = map.keyframes.iter().map(pose).enumerate().collect();
                let points = map.landmarks.iter().map(|l| shift.transform(&l.point_in_world));
                let landmarks = points.enumerate().collect();
                pipeline.correct(&Corrections { keyframes, landmarks, newer: None });
            }
            tracked
        };
        frames.iter().enumerate().map(track).collect()
    };
    let shift = Se3::exp(&Vector6::new(0.3, -0.2, 0.1, 0.05, -0.1, 0.2));
    let (plain, corrected) = (run(None), run(Some(shift)));
    for (index, (a, b)) in plain.iter().zip(&corrected).enumerate() {
        let odometry = a.odom_from_camera.inverse().compose(&b.odom_from_camera);
        assert!(odometry.log().norm() < 1e-6, "frame {index}: odometry moved by {odometry:?}");
        let expected = if index > 4 { shift } else { Se3::identity() };
        let moved = b.world_from_camera.compose(&a.world_from_camera.inverse());
        assert!(expected.inverse().compose(&moved).log().norm() < 1e-6, "frame {index}");
    }
}

#[test]
fn black_frames_are_lost_and_tracking_resumes_where_the_camera_is() {
    let sequence = sequence(SceneName::Static, 14);
    let mut pipeline = pipeline(&sequence);
    let track = |pipeline: &mut Pipeline, index: usize| {
        pipeline.track(&sequence.frame(index), None).tracked
    };
    for index in 0..6 {
        assert!(track(&mut pipeline, index).is_some(), "frame {index}");
    }
    for index in 6..10 {
        let outcome = pipeline.track(&black(sequence.timestamp_s(index)), None);
        assert_eq!(outcome.tracked, None, "frame {index}");
    }
    // How the camera turned over the first frame is not known: the second one shows it.
    assert_eq!(track(&mut pipeline, 10), None);
    for index in 11..14 {
        let tracked = track(&mut pipeline, index).unwrap();
        let (meters, radians) = error(&sequence, index, &tracked);
        assert!(meters < 0.02 && radians < 0.01, "frame {index}: {meters} m, {radians} rad");
    }
}

/// A camera that turns by 6° a frame is covered after frame 11 and shown again from frame 30 on, where it
/// sees nothing that it has seen before. Returns what it is asked there.
fn covered_and_turned(sequence: &Sequence, pipeline: &mut Pipeline) -> u64 {
    for index in 0..12 {
        assert!(pipeline.track(&sequence.frame(index), None).tracked.is_some(), "frame {index}");
    }
    for index in 12..30 {
        let outcome = pipeline.track(&black(sequence.timestamp_s(index)), None);
        assert_eq!((outcome.tracked, outcome.question), (None, None), "frame {index}");
    }
    let outcome = pipeline.track(&sequence.frame(30), None);
    assert_eq!(outcome.tracked, None);
    let question = outcome.question.unwrap();
    assert!(question.features.len() > 100, "{}", question.features.len());
    question.number
}

/// The true pose of a frame in the map, whose origin is the first frame.
fn truth(sequence: &Sequence, index: usize) -> Se3 {
    sequence.world_from_camera(0).inverse().compose(&sequence.world_from_camera(index))
}

#[test]
fn an_answer_that_comes_late_is_carried_on_to_the_newest_frame() {
    let sequence = sequence(SceneName::Loop, 60);
    let mut pipeline = pipeline(&sequence);
    let number = covered_and_turned(&sequence, &mut pipeline);
    for index in 31..35 {
        let outcome = pipeline.track(&sequence.frame(index), None);
        assert_eq!((outcome.tracked, outcome.question), (None, None), "one question is enough");
    }
    assert!(!pipeline.answer(&Answer { number: number + 1, world_from_camera: None }));
    let answer = Answer { number, world_from_camera: Some(truth(&sequence, 30)) };
    assert!(pipeline.answer(&answer));
    assert!(!pipeline.answer(&answer), "a question has one answer");
    let mut keyframes = 0;
    for index in 35..40 {
        let outcome = pipeline.track(&sequence.frame(index), None);
        let tracked = outcome.tracked.unwrap();
        let (meters, radians) = error(&sequence, index, &tracked);
        assert!(meters < 0.02 && radians < 0.01, "frame {index}: {meters} m, {radians} rad");
        // Odometry has the motion of the map since frame 11.
        let off = tracked.odom_from_camera.inverse().compose(&tracked.world_from_camera);
        assert!(off.log().norm() < 0.02, "frame {index}: {off:?}");
        // A place that the local map does not show is mapped at once.
        assert!(index > 35 || outcome.keyframe.is_some());
        keyframes += usize::from(outcome.keyframe.is_some());
    }
    assert!(keyframes >= 2, "{keyframes}");
}

#[test]
fn an_answer_is_of_no_use_once_the_motion_since_the_question_is_lost() {
    let sequence = sequence(SceneName::Loop, 60);
    let mut pipeline = pipeline(&sequence);
    let number = covered_and_turned(&sequence, &mut pipeline);
    pipeline.track(&black(sequence.timestamp_s(31)), None);
    let outcome = pipeline.track(&sequence.frame(32), None);
    let again = outcome.question.unwrap();
    assert!(again.number > number);
    let world_from_camera = Some(truth(&sequence, 30));
    assert!(!pipeline.answer(&Answer { number, world_from_camera }));
    // Nobody knows where the second one is: the next frame is asked for.
    assert!(!pipeline.answer(&Answer { number: again.number, world_from_camera: None }));
    let outcome = pipeline.track(&sequence.frame(33), None);
    assert!(outcome.question.is_some_and(|question| question.number > again.number));
}

#[test]
fn without_answers_tracking_resumes_where_the_camera_comes_back_to() {
    let sequence = sequence(SceneName::Loop, 60);
    let mut pipeline = pipeline(&sequence);
    let number = covered_and_turned(&sequence, &mut pipeline);
    let back = |index: usize, shown: usize| RgbdFrame {
        timestamp_s: sequence.timestamp_s(index),
        ..sequence.frame(shown)
    };
    let outcome = pipeline.track(&back(31, 11), None);
    assert_eq!((outcome.tracked, outcome.question), (None, None));
    let tracked = pipeline.track(&back(32, 12), None).tracked.unwrap();
    let (meters, radians) = error(&sequence, 12, &tracked);
    assert!(meters < 0.02 && radians < 0.01, "{meters} m, {radians} rad");
    let world_from_camera = Some(truth(&sequence, 30));
    assert!(!pipeline.answer(&Answer { number, world_from_camera }), "it is known already");
}

#[test]
fn a_sequence_may_begin_in_the_dark() {
    let sequence = sequence(SceneName::Static, 3);
    let mut pipeline = pipeline(&sequence);
    assert_eq!(pipeline.track(&black(-1.0), None).tracked, None);
    assert!(pipeline.track(&sequence.frame(0), None).tracked.is_some());
    let second = pipeline.track(&sequence.frame(1), None);
    assert_eq!(second.tracked.unwrap().keyframe, 0);
    // Only the second frame shows how the first was exposed.
    assert_eq!(second.keyframe.unwrap().timestamp_s, sequence.timestamp_s(0));
}

#[test]
fn an_image_of_another_size_has_no_pose_and_changes_nothing() {
    let sequence = sequence(SceneName::Static, 3);
    let mut pipeline = pipeline(&sequence);
    pipeline.track(&sequence.frame(0), None);
    let mut small = black(sequence.timestamp_s(1));
    small.color = Image::filled(100, 80, [9; 3]);
    let outcome = pipeline.track(&small, None);
    assert_eq!(Outcome { seconds: outcome.seconds, ..Outcome::default() }, outcome);
    assert!(pipeline.track(&sequence.frame(2), None).tracked.is_some());
}

#[test]
fn a_frame_without_depth_is_tracked_by_its_gray_levels() {
    let sequence = sequence(SceneName::Static, 6);
    let mut pipeline = pipeline(&sequence);
    for index in 0..6 {
        let mut frame = sequence.frame(index);
        if index == 3 {
            frame.depth_m = Image::filled(SIZE.0, SIZE.1, 0.0);
        }
        let tracked = pipeline.track(&frame, None).tracked.unwrap();
        let (meters, _) = error(&sequence, index, &tracked);
        assert!(meters < 0.01, "frame {index}: {meters} m");
    }
}

#[test]
fn a_given_mask_is_merged_and_one_that_covers_everything_is_ignored() {
    let sequence = sequence(SceneName::Static, 4);
    let mut half = Image::filled(SIZE.0, SIZE.1, 0_u8);
    for v in 0..SIZE.1 {
        half.row_mut(v)[..SIZE.0 / 2].fill(255);
    }
    let all = Image::filled(SIZE.0, SIZE.1, 255_u8);
    let mut masked = pipeline(&sequence);
    for index in 0..4 {
        let outcome = masked.track(&sequence.frame(index), Some(&half));
        let moving = outcome.moving.unwrap();
        assert!(moving.pixels().iter().zip(half.pixels()).all(|(m, h)| m >= h));
        let keyframes = outcome.keyframe.iter();
        for observation in keyframes.flat_map(|keyframe| &keyframe.observations) {
            let pixel = observation.seen.pixel;
            assert!(pixel.x > (SIZE.0 / 2) as f64 - 1.0, "frame {index}: {pixel:?}");
        }
    }
    let mut covered = pipeline(&sequence);
    for index in 0..4 {
        let tracked = covered.track(&sequence.frame(index), Some(&all)).tracked.unwrap();
        assert!(error(&sequence, index, &tracked).0 < 0.01);
    }
}

#[test]
fn a_long_run_keeps_images_and_landmarks_of_the_local_map_only() {
    const MOST: usize = 5;
    let sequence = sequence(SceneName::Loop, 50);
    let camera = FrameCamera::new(*sequence.camera(), SIZE.0, SIZE.1).unwrap();
    let options = PipelineOptions { most_keyframes: MOST, ..PipelineOptions::default() };
    let mut pipeline = Pipeline::new(camera, options);
    let mut images = Vec::new();
    for index in 0..50 {
        let outcome = pipeline.track(&sequence.frame(index), None);
        let (meters, radians) = error(&sequence, index, &outcome.tracked.unwrap());
        assert!(meters < 0.03 && radians < 0.02, "frame {index}: {meters} m, {radians} rad");
        let map = pipeline.map();
        if outcome.keyframe.is_some() {
            images.push(Arc::downgrade(&map.reference().unwrap().pyramid));
        }
        // Beside the local map the detection of movement keeps data of keyframes.
        let kept = pipeline.detector.as_ref().map_or(0, MotionDetector::kept);
        assert!(map.keyframes.len() <= MOST && kept <= MOST);
        // One more is the last frame's own.
        let alive = images.iter().filter(|image| image.upgrade().is_some()).count();
        assert!(alive <= MOST + 1, "frame {index}: {alive} images");
        let mut seen = BTreeSet::new();
        let views = map.keyframes.iter().flat_map(|keyframe| &keyframe.observations);
        seen.extend(views.map(|(landmark, _)| *landmark));
        assert_eq!(seen.len(), map.landmarks.len(), "a landmark that no keyframe sees");
    }
    let map = pipeline.map();
    let last = map.reference().unwrap().id;
    assert!(last + 1 >= 2 * MOST, "the last keyframe is {last}");
    assert!(map.next_landmark() > map.landmarks.len());
}

/// Tracks every `step`th frame, with the poses that a source gives; how many were tracked, and the largest
/// error, m.
fn track_few(step: usize, given: impl Fn(&Sequence, usize) -> Option<Se3>) -> (usize, f64) {
    let sequence = sequence(SceneName::Loop, 160);
    let mut pipeline = pipeline(&sequence);
    let (mut tracked, mut most) = (0, 0.0);
    for index in (0..160).step_by(step) {
        let given_pose = given(&sequence, index);
        let outcome = pipeline.track(&RgbdFrame { given_pose, ..sequence.frame(index) }, None);
        let Some(found) = outcome.tracked else { continue };
        tracked += 1;
        most = f64::max(most, error(&sequence, index, &found).0);
    }
    (tracked, most)
}

#[test]
fn given_poses_carry_tracking_where_frames_are_far_apart() {
    // A phone's pose is off by some millimeters and tenths of a degree, in a world of its own.
    let world = Se3::new(So3::exp(&Vector3::new(1.0, 2.0, -0.5)), Vector3::new(4.0, 5.0, 6.0));
    let given = |sequence: &Sequence, index: usize| {
        let k = index as f64;
        let turn = Vector3::new((1.7 * k).sin(), (2.3 * k).cos(), (0.7 * k).sin()) * 0.004;
        let off = Se3::new(So3::exp(&turn), turn);
        Some(world.compose(&sequence.world_from_camera(index)).compose(&off))
    };
    // At a quarter of the frames both are tracked; at an eighth constant velocity goes astray.
    let (tracked, most_m) = track_few(4, given);
    assert!(tracked == 40 && most_m < 0.03, "{tracked} tracked, {most_m} m");
    let ((without, astray_m), (with, most_m)) = (track_few(8, |_, _| None), track_few(8, given));
    assert!(astray_m > 0.1, "{without} tracked, {astray_m} m: this asks nothing of the poses");
    assert!(with > without && most_m < 0.03, "{with} tracked, {most_m} m; {without} without");
}
