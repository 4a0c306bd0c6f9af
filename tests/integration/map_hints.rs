//! Hints: mistakes that the data of a client look like are named, and honest data make none. Sequences are
//! made from seeds, or recorded (`closures/fr1_rpy`); each mistake is one that frontends make.

use covis::client::{Client, SessionOptions};
use covis::wire::v1;
use covis_solvers::geometry::{LieGroup, Se3};
use v1::MapHintKind as Kind;
use v1::ingest_request::Item;

use crate::closure_verdicts;
use crate::common::{TestServer, camera, keyframe, run};
use crate::made_sequence::{Course, walls};
use crate::sequence::{Order, Sequence, items, pose, transform};

/// A map that takes items and solves nothing: hints are about what was sent.
fn quiet() -> v1::MapPolicy {
    v1::MapPolicy {
        local_bundle_adjustment: Some(false),
        loop_closure_optimization: Some(false),
        closure_adjustment: Some(false),
        odometry: Some(false),
        place_recognition: Some(v1::PlaceRecognition { enabled: Some(false) }),
        ..Default::default()
    }
}

/// The hints of a map that is made of items.
async fn hints(items: impl IntoIterator<Item = Item>) -> Vec<v1::MapHint> {
    let server = TestServer::start().await;
    let client = Client::connect(&format!("http://{}", server.running.local_addr())).await.unwrap();
    client.create_map("room", Some(quiet())).await.unwrap();
    let mut session = client.ingest("room", "robot", SessionOptions::default()).await.unwrap();
    for item in items {
        session.send(item).await.unwrap();
    }
    let report = session.finish().await.unwrap();
    assert_eq!(report.rejected, 0, "{:?}", report.rejections);
    client.get_map("room").await.unwrap().hints
}

fn kinds(hints: &[v1::MapHint]) -> Vec<Kind> {
    hints.iter().map(v1::MapHint::kind).collect()
}

fn of_pose(message: &v1::RigidTransform) -> Se3 {
    let (t, q) = (message.translation.unwrap(), message.rotation.unwrap());
    pose(&[t.x, t.y, t.z, q.x, q.y, q.z, q.w])
}

/// The items of a sequence, with its keyframes changed.
fn changed(sequence: &Sequence, change: impl Fn(&mut v1::Keyframe)) -> Vec<Item> {
    let mut items = items(sequence, &[], Order::Burst);
    for item in &mut items {
        if let Item::Keyframe(keyframe) = item {
            change(keyframe);
        }
    }
    items
}

fn with_depths_in_millimeters(keyframe: &mut v1::Keyframe) {
    for seen in &mut keyframe.observations {
        seen.depth_m = seen.depth_m.map(|depth| 1000.0 * depth);
        seen.sigma_depth_m = seen.sigma_depth_m.map(|sigma| 1000.0 * sigma);
    }
}

fn with_poses_in_millimeters(keyframe: &mut v1::Keyframe) {
    for pose in [&mut keyframe.world_from_camera, &mut keyframe.odom_from_camera] {
        let translation = pose.as_mut().unwrap().translation.as_mut().unwrap();
        let v1::Vector3 { x, y, z } = *translation;
        *translation = v1::Vector3 { x: 1000.0 * x, y: 1000.0 * y, z: 1000.0 * z };
    }
}

fn with_inverted_poses(keyframe: &mut v1::Keyframe) {
    let inverse = of_pose(keyframe.world_from_camera.as_ref().unwrap()).inverse();
    keyframe.world_from_camera = Some(transform(&inverse));
    keyframe.odom_from_camera = None;
}

fn with_swapped_pixels(keyframe: &mut v1::Keyframe) {
    for seen in &mut keyframe.observations {
        let v1::Vector2 { x, y } = seen.pixel.unwrap();
        seen.pixel = Some(v1::Vector2 { x: y, y: x });
    }
}

fn without_depths(keyframe: &mut v1::Keyframe) {
    for seen in &mut keyframe.observations {
        (seen.depth_m, seen.sigma_depth_m) = (None, None);
    }
}

/// A walk around a block, and one with few points and a poor calibration.
fn courses() -> [Course; 2] {
    let course = Course {
        way: vec![[-1.0, -1.0], [9.0, -1.0], [9.0, 7.0], [-1.0, 7.0], [-1.0, -1.0]],
        walls: [walls([0.0, 0.0], [8.0, 6.0]), walls([-3.0, -3.0], [11.0, 9.0])].concat(),
        copies: Vec::new(),
        points_per_m: 40.0,
        step_m: 0.25,
        closure_step: 1000,
        calibration_error: 0.0,
    };
    let poor = Course { points_per_m: 25.0, calibration_error: 0.02, ..course.clone() };
    [course, poor]
}

/// Each mistake in turn, on one sequence.
async fn mistakes_are_named(sequence: &Sequence) {
    let as_it_is = |_: &mut v1::Keyframe| {};
    let honest =
        [hints(changed(sequence, as_it_is)).await, hints(changed(sequence, without_depths)).await];
    assert_eq!(honest.map(|hints| kinds(&hints)), [vec![], vec![]]);
    type Mistake = fn(&mut v1::Keyframe);
    let mistakes: [(Mistake, Kind); 5] = [
        (with_depths_in_millimeters, Kind::DepthUnit),
        (with_poses_in_millimeters, Kind::DepthUnit),
        (with_inverted_poses, Kind::PosesInverted),
        (with_swapped_pixels, Kind::PixelsSwapped),
        (
            |keyframe| {
                with_depths_in_millimeters(keyframe);
                with_poses_in_millimeters(keyframe);
            },
            Kind::SceneSize,
        ),
    ];
    for (mistake, kind) in mistakes {
        let named = hints(changed(sequence, mistake)).await;
        assert_eq!(kinds(&named), [kind], "{named:?}");
        assert_eq!(named[0].client_id, "robot");
    }
    let inverted = changed(sequence, |keyframe| {
        without_depths(keyframe);
        with_inverted_poses(keyframe);
    });
    assert_eq!(kinds(&hints(inverted).await), [Kind::PosesInverted], "without depths too");
}

#[test]
fn each_mistake_of_a_frontend_is_named_and_honest_sequences_are_not() {
    run(async {
        for (seed, course) in (1..).zip(courses()) {
            let mut sequence = course.make(seed).sequence;
            sequence.odometry.truncate(60);
            mistakes_are_named(&sequence).await;
        }
    });
}

#[test]
fn each_mistake_is_named_on_a_recorded_sequence() {
    run(async {
        let Some(sequence) = closure_verdicts::read() else { return };
        mistakes_are_named(&sequence).await;
    });
}

#[test]
fn depths_in_millimeters_and_their_factor_are_told() {
    run(async {
        let sequence = courses()[0].make(3).sequence;
        let named = hints(changed(&sequence, with_depths_in_millimeters)).await;
        let text = &named[0].text;
        assert!(text.contains("depths in millimeters?"), "{text}");
        let factor: f64 = text.split_whitespace().nth(4).unwrap().parse().unwrap();
        assert!((900.0..1100.0).contains(&factor), "{text}");
    });
}

#[test]
fn the_scene_of_the_other_tests_makes_no_hint() {
    run(async {
        let keyframes = (0..20).map(|id| Item::Keyframe(keyframe(id)));
        let named = hints([Item::Camera(camera(0))].into_iter().chain(keyframes)).await;
        assert_eq!(named, []);
    });
}

#[test]
fn pixels_outside_the_image_are_named() {
    run(async {
        // The images were halved, the pixels were not.
        let half = v1::Camera { width_px: 320, height_px: 240, ..camera(0) };
        let keyframes = (0..4).map(|id| Item::Keyframe(keyframe(id)));
        let named = hints([Item::Camera(half)].into_iter().chain(keyframes)).await;
        assert_eq!(kinds(&named), [Kind::PixelsOutsideImage], "{named:?}");
    });
}

#[test]
fn landmarks_behind_the_camera_are_named() {
    run(async {
        // A camera that looks along -z, as in computer graphics.
        let turned = |id: i64| {
            let mut keyframe = keyframe(id);
            let pose = keyframe.world_from_camera.as_mut().unwrap();
            pose.rotation = Some(v1::Quaternion { x: 1.0, y: 0.0, z: 0.0, w: 0.0 });
            Item::Keyframe(keyframe)
        };
        let named = hints([Item::Camera(camera(0))].into_iter().chain((0..4).map(turned))).await;
        assert_eq!(kinds(&named), [Kind::LandmarksBehindCamera], "{named:?}");
    });
}

#[test]
fn a_clock_that_goes_back_is_named_and_the_odometry_frame_goes_on() {
    run(async {
        // From keyframe 5 on the clock is an hour behind; the robot has moved by then.
        let late = |id: i64| {
            let mut keyframe = keyframe(id);
            let hour = if id < 5 { 0 } else { 3600 };
            keyframe.capture_time.as_mut().unwrap().seconds -= hour;
            keyframe.odom_from_camera = keyframe.world_from_camera;
            let pose = keyframe.odom_from_camera.as_mut().unwrap();
            pose.translation.as_mut().unwrap().y += 0.01 * id as f64;
            keyframe
        };
        let server = TestServer::start().await;
        let client =
            Client::connect(&format!("http://{}", server.running.local_addr())).await.unwrap();
        client.create_map("room", Some(quiet())).await.unwrap();
        let mut session = client.ingest("room", "robot", SessionOptions::default()).await.unwrap();
        session.send(camera(0)).await.unwrap();
        for id in 0..30 {
            session.send(late(id)).await.unwrap();
            session.flush().await.unwrap();
            let map = client.get_map("room").await.unwrap();
            let offset = map.clients[0].map_from_odom.unwrap().translation.unwrap().y;
            // Fifteen keyframes may be late; the sixteenth says that it is the clock.
            let newest = if (5..20).contains(&id) { 4 } else { id };
            assert!((offset + 0.01 * newest as f64).abs() < 1e-9, "{id}: {offset}");
            // In the end landmarks leave the image as well.
            let is_named = kinds(&map.hints).contains(&Kind::ClockWentBack);
            assert_eq!(is_named, id >= 20, "{id}: {:?}", map.hints);
        }
        let text = client.get_map("room").await.unwrap().hints.pop().unwrap().text;
        assert!(text.contains("the last 25 keyframes") && text.contains("3575.000 s"), "{text}");
        session.finish().await.unwrap();
    });
}
