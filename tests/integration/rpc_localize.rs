//! `Localize`: a lost robot learns where it is, and each code.

use std::collections::BTreeSet;
use std::time::Duration;

use covis::wire::v1;
use covis_solvers::geometry::{LieGroup, Se3};
use nalgebra::Matrix6;
use tonic::{Code, Request, Status};
use v1::ingest_request::Item;

use crate::common::{Stream, TestServer, check_field, check_status, image_descriptor, run};
use crate::made_sequence::{Course, Made, wire};
use crate::made_verdicts;
use crate::sequence::{Order, Sequence, build, items, pose, state};

/// One and a half times around in a room.
pub(crate) fn walk() -> Made {
    let room = made_verdicts::room();
    let way = room.way[..19].to_vec();
    Course { way, ..room }.make(1)
}

/// The items of the walk without the keyframes `left_out`; the next one of each brings its landmarks.
fn without(sequence: &Sequence, left_out: &[usize]) -> Vec<Item> {
    let mut items = items(sequence, &[], Order::Streamed);
    for &left_out in left_out {
        let is_it = |item: &Item| matches!(item, Item::Keyframe(k) if k.id == left_out as i64);
        let at = items.iter().position(is_it).unwrap();
        let Item::Keyframe(gone) = items.remove(at) else { panic!("not a keyframe") };
        let Item::Keyframe(next) = &mut items[at] else { panic!("not a keyframe") };
        next.landmarks.extend(gone.landmarks);
    }
    items
}

/// A pose of an answer.
fn read_pose(message: &v1::RigidTransform) -> Se3 {
    let (t, q) = (message.translation.unwrap(), message.rotation.unwrap());
    pose(&[t.x, t.y, t.z, q.x, q.y, q.z, q.w])
}

/// A covariance of an answer, whole.
fn read_covariance(message: &v1::Covariance6) -> Matrix6<f64> {
    assert_eq!(message.upper_triangle.len(), 21);
    let mut covariance = Matrix6::zeros();
    let places = (0..6).flat_map(|row| (row..6).map(move |column| (row, column)));
    for ((row, column), &value) in places.zip(&message.upper_triangle) {
        covariance[(row, column)] = value;
        covariance[(column, row)] = value;
    }
    covariance
}

/// What a camera sees at a keyframe of the sequence, as a request.
fn request(sequence: &Sequence, k: usize) -> v1::LocalizeRequest {
    let feature = |(seen, data): (&[f64; 6], &Vec<u8>)| {
        let [_, x, y, depth, sigma_px, sigma_m] = *seen;
        let kind = v1::DescriptorKind::Binary.into();
        v1::Feature {
            pixel: Some(v1::Vector2 { x, y }),
            sigma_px: Some(sigma_px),
            depth_m: Some(depth),
            sigma_depth_m: Some(sigma_m),
            descriptor: Some(v1::Descriptor { kind, name: "orb".to_owned(), data: data.clone() }),
        }
    };
    let seen = sequence.observations[k].iter().zip(&sequence.descriptors[k]);
    v1::LocalizeRequest {
        map_id: "room".to_owned(),
        camera: Some(wire()),
        features: seen.map(feature).collect(),
        global_descriptor: None,
    }
}

async fn localize(
    server: &TestServer,
    request: v1::LocalizeRequest,
) -> Result<v1::LocalizeResponse, Status> {
    Ok(server.optimization().localize(request).await?.into_inner())
}

#[test]
fn a_lost_robot_is_told_where_it_is() {
    const LOST: usize = 30;
    let Made { sequence, point_of } = walk();
    run(async {
        let server = TestServer::lock_step().await;
        server.create_map("room").await;
        let (stream, _) = Stream::open(&server, "room", "robot", 0).await;
        for (number, item) in (1..).zip(without(&sequence, &[LOST])) {
            stream.send(number, item).await;
        }
        assert!(stream.finish().await.unwrap().iter().all(|ack| ack.violations.is_empty()));
        let answer = localize(&server, request(&sequence, LOST)).await.unwrap();

        let found = read_pose(answer.world_from_camera.as_ref().unwrap());
        // In the frame of the map, by the keyframe before.
        let before = state(&server, "room").await.poses[LOST - 1];
        let step = sequence.truth[LOST - 1].inverse().compose(&sequence.truth[LOST]);
        let error = before.compose(&step).inverse().compose(&found);
        let (m, deg) = (error.translation.norm(), error.rotation.log().norm().to_degrees());
        println!("{m:.3} m, {deg:.2} deg, {} inliers", answer.inliers.len());
        assert!(m < 0.05 && deg < 2.0, "{m} m, {deg} deg");

        assert!(answer.covariance.is_some());
        assert!(answer.variance_factor >= 1.0);
        let get = v1::GetMapRequest { map_id: "room".to_owned(), ..Default::default() };
        let map = server.maps().get_map(get).await.unwrap().into_inner().map.unwrap();
        assert_eq!(answer.revision, map.revision);
        let (last, others) = answer.candidates.split_last().unwrap();
        assert!(last.refusal.is_none() && others.len() < 3 && answer.rivals.is_empty());
        assert!(last.score > 0.0 && last.match_count >= 12);
        // Each inlier names a landmark that is the point which the feature shows.
        assert!(answer.inliers.len() >= 30, "{}", answer.inliers.len());
        let is_true = |inlier: &&v1::LocalizedFeature| {
            let landmark = inlier.landmark.as_ref().unwrap();
            let seen = sequence.observations[LOST][inlier.feature as usize][0] as i64;
            landmark.client_id == "robot" && point_of[&landmark.id] == point_of[&seen]
        };
        let right = answer.inliers.iter().filter(is_true).count();
        assert!(20 * right >= 19 * answer.inliers.len(), "{right} of {}", answer.inliers.len());
        // The same again: nothing is drawn by chance, and nothing was changed.
        assert_eq!(localize(&server, request(&sequence, LOST)).await.unwrap(), answer);

        // An image that no keyframe has changes nothing.
        let pictured = v1::LocalizeRequest {
            global_descriptor: Some(image_descriptor(&[0.5, -1.0])),
            ..request(&sequence, LOST)
        };
        assert_eq!(localize(&server, pictured).await.unwrap(), answer);

        // A frozen map is read as any other.
        let update = v1::UpdateMapRequest {
            map_id: "room".to_owned(),
            update_mask: Some(prost_types::FieldMask { paths: vec!["state".to_owned()] }),
            state: v1::MapState::Frozen.into(),
            ..Default::default()
        };
        server.maps().update_map(update).await.unwrap();
        let answer = localize(&server, request(&sequence, LOST)).await.unwrap();
        assert!(answer.world_from_camera.is_some());

        // What nothing looks like, and what nobody described, is nowhere.
        let mut strange = request(&sequence, LOST);
        for (k, feature) in strange.features.iter_mut().enumerate() {
            for byte in &mut feature.descriptor.as_mut().unwrap().data {
                *byte = byte.wrapping_mul(k as u8 | 1) ^ 0x5a;
            }
        }
        let mut silent = request(&sequence, LOST);
        silent.features.iter_mut().for_each(|feature| feature.descriptor = None);
        let features = Vec::new();
        let blind = v1::LocalizeRequest { features, ..request(&sequence, LOST) };
        for nowhere in [strange, silent, blind] {
            let answer = localize(&server, nowhere).await.unwrap();
            assert!(answer.world_from_camera.is_none() && answer.inliers.is_empty());
            assert!(answer.covariance.is_none());
            assert!(answer.candidates.iter().all(|candidate| candidate.refusal.is_some()));
        }
    });
}

/// The error of a pose is taken relative to the keyframe that shows the place, as its covariance is.
#[test]
fn the_covariance_of_a_found_pose_is_as_large_as_its_error() {
    const LOST: [usize; 5] = [24, 29, 34, 39, 44];
    // Quantiles of the chi-square distribution with six degrees of freedom: 99.99 % of one answer, and
    // 99.9 % of the mean of 15.
    const LARGEST: f64 = 27.86;
    const MEAN: f64 = 9.16;
    let mut all = Vec::new();
    run(async {
        let server = TestServer::lock_step().await;
        for seed in 1..=3 {
            let room = made_verdicts::room();
            let way = room.way[..19].to_vec();
            let sequence = Course { way, ..room }.make(seed).sequence;
            let map_id = format!("room-{seed}");
            server.create_map(&map_id).await;
            let (stream, _) = Stream::open(&server, &map_id, "robot", 0).await;
            for (number, item) in (1..).zip(without(&sequence, &LOST)) {
                stream.send(number, item).await;
            }
            assert!(stream.finish().await.unwrap().iter().all(|ack| ack.violations.is_empty()));
            let list = v1::ListKeyframesRequest { map_id: map_id.clone(), ..Default::default() };
            let mut list = server.maps().list_keyframes(list).await.unwrap().into_inner();
            let keyframes = list.message().await.unwrap().unwrap().keyframes;
            for lost in LOST {
                let request =
                    v1::LocalizeRequest { map_id: map_id.clone(), ..request(&sequence, lost) };
                let answer = localize(&server, request).await.unwrap();
                let Some(found) = answer.world_from_camera.as_ref().map(read_pose) else {
                    continue;
                };
                let shown = answer.candidates.last().unwrap().keyframe.as_ref().unwrap().id;
                let keyframe = keyframes.iter().find(|k| k.id == shown).unwrap();
                let place = read_pose(keyframe.world_from_camera.as_ref().unwrap());
                let step = sequence.truth[shown as usize].inverse().compose(&sequence.truth[lost]);
                let error = place.compose(&step).inverse().compose(&found).log();

                let covariance = read_covariance(answer.covariance.as_ref().unwrap());
                let factor = covariance.cholesky().expect("positive definite");
                let sigma = covariance.diagonal().map(f64::sqrt);
                // A room whose walls are 2 m away, seen with 0.7 px and a focal length that is 1 % off.
                assert!((0..3).all(|k| (2e-4..0.05).contains(&sigma[k])), "{sigma}");
                assert!((3..6).all(|k| (5e-5..0.02).contains(&sigma[k])), "{sigma}");
                all.push(error.dot(&factor.solve(&error)));
            }
        }
    });
    println!("squared errors over their covariance: {all:.2?}");
    assert!(all.len() >= 12, "{} of 15 are found", all.len());
    assert!(all.iter().all(|&s| s < LARGEST), "{all:?}");
    let mean = all.iter().sum::<f64>() / all.len() as f64;
    assert!((0.6..MEAN).contains(&mean), "{mean}");
}

#[test]
fn a_camera_in_one_of_two_rooms_that_are_alike_is_told_both_poses() {
    const SHIFT_M: f64 = 10.0;
    let (sequence, mut twin) = (walk().sequence, walk().sequence);
    for (_, odom_from_camera) in &mut twin.odometry {
        odom_from_camera.translation.x += SHIFT_M;
    }
    run(async {
        let server = TestServer::lock_step().await;
        // Without recognition, so that nothing joins the two rooms.
        build(&server, "room", (&sequence, &[]), Order::Streamed, v1::MapPolicy::default()).await;
        let (stream, _) = Stream::open(&server, "room", "twin", 0).await;
        for (number, item) in (1..).zip(items(&twin, &[], Order::Streamed)) {
            stream.send(number, item).await;
        }
        assert!(stream.finish().await.unwrap().iter().all(|ack| ack.violations.is_empty()));
        let enabled = v1::PlaceRecognition { enabled: Some(true) };
        let update = v1::UpdateMapRequest {
            map_id: "room".to_owned(),
            update_mask: Some(prost_types::FieldMask {
                paths: vec!["policy.place_recognition.enabled".to_owned()],
            }),
            policy: Some(v1::MapPolicy { place_recognition: Some(enabled), ..Default::default() }),
            ..Default::default()
        };
        server.maps().update_map(update).await.unwrap();

        let answer = localize(&server, request(&sequence, 12)).await.unwrap();
        assert!(answer.world_from_camera.is_none() && answer.inliers.is_empty(), "{answer:?}");
        let clients: BTreeSet<&str> = answer
            .rivals
            .iter()
            .map(|rival| rival.keyframe.as_ref().unwrap().client_id.as_str())
            .collect();
        assert_eq!(clients, BTreeSet::from(["robot", "twin"]));
        let x = |rival: &v1::RivalPose| {
            rival.world_from_camera.as_ref().unwrap().translation.unwrap().x
        };
        let apart = (x(&answer.rivals[0]) - x(&answer.rivals[1])).abs();
        assert!((apart - SHIFT_M).abs() < 0.1, "{apart} m");
        let is_sure =
            |rival: &v1::RivalPose| rival.inlier_count >= 30 && rival.covariance.is_some();
        assert!(answer.rivals.iter().all(is_sure));
        let reason = |c: &v1::PlaceCandidate| c.refusal.as_ref().unwrap().reason.clone();
        let reasons: Vec<String> = answer.candidates.iter().map(reason).collect();
        let ambiguous = reasons.iter().filter(|reason| *reason == "ambiguous").count();
        assert!(ambiguous >= 2, "{reasons:?}");
    });
}

#[test]
fn descriptors_of_a_name_that_no_keyframe_has_are_refused_with_the_names_that_there_are() {
    let sequence = walk().sequence;
    let renamed = |name: &str, bytes: usize, count: usize| {
        let mut request = request(&sequence, 12);
        for feature in request.features.iter_mut().take(count) {
            let descriptor = feature.descriptor.as_mut().unwrap();
            descriptor.name = name.to_owned();
            descriptor.data.resize(bytes, 0);
        }
        request
    };
    let all = sequence.descriptors[12].len();
    run(async {
        let server = TestServer::lock_step().await;
        let policy = v1::PlaceRecognition { enabled: Some(true) };
        let policy = v1::MapPolicy { place_recognition: Some(policy), ..Default::default() };
        server.create_map_with("room", policy).await;
        // A map without descriptors refuses none.
        localize(&server, renamed("ORB", 32, all)).await.unwrap();
        let (stream, _) = Stream::open(&server, "room", "robot", 0).await;
        for (number, item) in (1..).zip(items(&sequence, &[], Order::Streamed).into_iter().take(20))
        {
            stream.send(number, item).await;
        }
        stream.finish().await.unwrap();
        for (name, bytes) in [("ORB", 32), ("", 32), ("orb", 64)] {
            let refused = localize(&server, renamed(name, bytes, all)).await.unwrap_err();
            check_field(&refused, "features[0].descriptor.name", "UNKNOWN_VALUE");
            let text = refused.message();
            assert!(text.contains("\"orb\" of 32 bytes"), "{text}");
        }
        // Features of another kind beside those that can be compared are no mistake.
        let answer = localize(&server, renamed("ORB", 32, 5)).await.unwrap();
        assert!(answer.world_from_camera.is_some());
    });
}

#[test]
fn the_answer_to_each_bad_request_says_what_is_wrong() {
    let sequence = walk().sequence;
    let good = request(&sequence, 0);
    run(async {
        let server = TestServer::start().await;
        let lost = localize(&server, good.clone()).await.unwrap_err();
        check_status(&lost, Code::NotFound, "MAP_NOT_FOUND");
        server.create_map("room").await;
        // A map without keyframes.
        let answer = localize(&server, good.clone()).await.unwrap();
        assert!(answer.world_from_camera.is_none() && answer.candidates.is_empty());

        let mut cases = Vec::new();
        let mut case = |field: &'static str, reason, change: &dyn Fn(&mut v1::LocalizeRequest)| {
            let mut bad = good.clone();
            change(&mut bad);
            cases.push((field, reason, bad));
        };
        case("map_id", "MISSING", &|bad| bad.map_id.clear());
        case("camera", "MISSING", &|bad| bad.camera = None);
        case("features[1].pixel", "MISSING", &|bad| bad.features[1].pixel = None);
        case("features[2].pixel.y", "NOT_FINITE", &|bad| {
            bad.features[2].pixel.as_mut().unwrap().y = f64::NAN;
        });
        case("features[0].sigma_px", "OUT_OF_RANGE", &|bad| {
            bad.features[0].sigma_px = Some(0.0);
        });
        case("features[3].sigma_depth_m", "INCONSISTENT", &|bad| {
            bad.features[3].sigma_depth_m = None
        });
        case("features[4].descriptor.kind", "MISSING", &|bad| {
            bad.features[4].descriptor.as_mut().unwrap().kind = 0;
        });
        case("features[4].descriptor.data", "TOO_LARGE", &|bad| {
            bad.features[4].descriptor.as_mut().unwrap().data = vec![0; 4097];
        });
        case("features[4].descriptor.data", "MISSING", &|bad| {
            bad.features[4].descriptor.as_mut().unwrap().data.clear();
        });
        for kind in [v1::DescriptorKind::Float32, v1::DescriptorKind::Uint8] {
            case("features[4].descriptor.kind", "OUT_OF_RANGE", &|bad| {
                bad.features[4].descriptor.as_mut().unwrap().kind = kind.into();
                bad.features[4].descriptor.as_mut().unwrap().data = vec![0; 32];
            });
        }
        case("global_descriptor.kind", "OUT_OF_RANGE", &|bad| {
            bad.global_descriptor.clone_from(&bad.features[4].descriptor);
        });
        for (data, reason) in [
            (vec![0; 6], "WRONG_LENGTH"),
            (f32::INFINITY.to_le_bytes().to_vec(), "NOT_FINITE"),
            (vec![0; 8], "OUT_OF_RANGE"),
        ] {
            case("global_descriptor.data", reason, &|bad| {
                let data = data.clone();
                bad.global_descriptor = Some(v1::Descriptor { data, ..image_descriptor(&[]) });
            });
        }
        case("features", "TOO_LARGE", &|bad| {
            bad.features = vec![bad.features[0].clone(); 4097];
        });
        for (field, reason, bad) in cases {
            check_field(&localize(&server, bad).await.unwrap_err(), field, reason);
        }
        // As many as are taken, all alike, and descriptors that no index holds.
        let most = vec![good.features[0].clone(); 4096];
        let mut odd = good.clone();
        for (k, feature) in odd.features.iter_mut().enumerate() {
            feature.descriptor.as_mut().unwrap().data = vec![7; [1, 15, 513, 4096][k % 4]];
        }
        // More bytes than a keyframe may have.
        let mut long = v1::LocalizeRequest { features: most.clone(), ..good.clone() };
        for feature in &mut long.features {
            feature.descriptor.as_mut().unwrap().data = vec![7; 512];
        }
        for extreme in [v1::LocalizeRequest { features: most, ..good.clone() }, odd, long] {
            let answer = localize(&server, extreme).await.unwrap();
            assert!(answer.world_from_camera.is_none());
        }
        let mut late = Request::new(good.clone());
        late.set_timeout(Duration::from_nanos(1));
        let late = server.optimization().localize(late).await.unwrap_err();
        assert!(matches!(late.code(), Code::DeadlineExceeded | Code::Cancelled), "{late:?}");

        let off = v1::PlaceRecognition { enabled: Some(false) };
        let policy = v1::MapPolicy { place_recognition: Some(off), ..Default::default() };
        server.create_map_with("without", policy).await;
        let without = v1::LocalizeRequest { map_id: "without".to_owned(), ..good.clone() };
        let refused = localize(&server, without).await.unwrap_err();
        check_status(&refused, Code::FailedPrecondition, "NO_PLACE_RECOGNITION");

        let server = TestServer::with_poisoned_map("room").await;
        let answer = localize(&server, good).await.unwrap();
        assert!(answer.world_from_camera.is_none(), "a poisoned map can be read");
    });
}
