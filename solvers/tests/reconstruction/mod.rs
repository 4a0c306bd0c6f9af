//! Poses and points from observations alone: synthetic rooms, wrong tracks, what cannot be placed, ends.

mod recorded;
mod support;

use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use covis_solvers::factors::{DepthReprojectionBatch, RelativePose};
use covis_solvers::geometry::{LieGroup, Se3, So3};
use covis_solvers::information::Information;
use covis_solvers::interrupt::{Interrupt, Interruption};
use covis_solvers::optimizer::Control;
use covis_solvers::problem::{BundleProblem, SolveError};
use covis_solvers::reconstruction::{
    Frame, Options, Placement, Reconstruction, Scale, Stage, Unplaced, reconstruct,
};
use covis_solvers::testing::random::{normal_vector, seeded, uniform_vector};
use covis_solvers::testing::scene::{Scene, SceneOptions};
use nalgebra::{SVector, Vector2, Vector3};
use rand::RngExt;

use support::{costs_of_kept, forgotten, run};

fn scene(keyframes: usize) -> Scene {
    Scene::generate(&SceneOptions { keyframes, landmarks: 900, ..SceneOptions::default() })
}

/// The true poses with the scene's observations, without depth where `mono`.
fn truth(scene: &Scene, mono: bool) -> BundleProblem {
    let mut problem = scene.to_problem();
    problem.constant_poses.fill(false);
    problem.poses.clone_from(&scene.truth);
    problem.landmarks.clone_from(&scene.landmarks);
    if mono {
        let depth = std::mem::take(&mut problem.depth_reprojections);
        push_plain(&mut problem, &depth);
    }
    problem
}

fn push_plain(problem: &mut BundleProblem, depth: &DepthReprojectionBatch) {
    for k in 0..depth.len() {
        problem.reprojections.push(
            depth.poses[k],
            depth.cameras[k],
            depth.landmarks[k],
            depth.pixels[k],
            depth.sigmas_px[k],
        );
    }
}

/// Gives every fifth observation to another landmark, or to another pixel where the landmark is seen.
fn with_wrong_tracks(problem: &mut BundleProblem) -> Vec<bool> {
    let mut rng = seeded(7);
    let mut is_wrong = Vec::new();
    let count = problem.landmarks.len() as u32;
    let (plain, depth) = (&mut problem.reprojections, &mut problem.depth_reprojections);
    let landmarks = plain.landmarks.iter_mut().chain(&mut depth.landmarks);
    for (landmark, pixel) in landmarks.zip(plain.pixels.iter_mut().chain(&mut depth.pixels)) {
        let wrong = rng.random_range(0..5) == 0;
        if wrong && rng.random_range(0..2) == 0 {
            *landmark = rng.random_range(0..count);
        } else if wrong {
            *pixel = Vector2::new(rng.random_range(0.0..639.0), rng.random_range(0.0..479.0));
        }
        is_wrong.push(wrong);
    }
    is_wrong
}

/// Largest distance of a placed keyframe from the truth, m, in the truth's frame.
fn worst_center(found: &Reconstruction, truth: &BundleProblem) -> f64 {
    let placed = found.poses.iter().zip(&truth.poses);
    let distances = placed.filter_map(|(own, truth)| {
        own.as_ref().map(|own| (own.translation - truth.translation).norm())
    });
    distances.fold(0.0, f64::max)
}

fn in_given_frame() -> Options {
    Options { frame: Frame::Given, ..Options::default() }
}

#[test]
fn a_room_seen_without_depth_comes_out_as_it_is_up_to_scale() {
    let truth = truth(&scene(40), true);
    let found = run(&forgotten(&truth), &Options::default());
    assert_eq!((found.placed(), found.scale, found.ended), (40, Scale::Convention, None));
    assert!(found.adjustment.as_ref().unwrap().solve.termination.is_converged());
    assert_eq!(found.poses[0], Some(Se3::identity()));
    let [own, from_truth] = costs_of_kept(&truth, &found);
    assert!((own / from_truth - 1.0).abs() < 1e-6, "{own} and {from_truth}");
    // Noise is normal and all tracks are right: nearly everything agrees, and the median depth is 1.
    let kept = found.reprojections.iter().filter(|&&agrees| agrees).count();
    assert!(kept as f64 > 0.97 * truth.reprojections.len() as f64, "{kept}");
    let mut depths: Vec<f64> = (0..truth.reprojections.len())
        .filter(|&k| found.reprojections[k])
        .map(|k| {
            let pose = found.poses[truth.reprojections.poses[k] as usize].unwrap();
            let point = found.landmarks[truth.reprojections.landmarks[k] as usize].unwrap();
            pose.inverse_transform(&point).z
        })
        .collect();
    depths.sort_by(f64::total_cmp);
    assert!((depths[depths.len() / 2] - 1.0).abs() < 1e-9);
    // In the truth's frame it lies on the truth, although a tenth of the given poses are wrong.
    let mut given = truth.clone();
    let mut rng = seeded(3);
    for k in [3, 11, 20, 31] {
        given.poses[k] = Se3::new(So3::identity(), uniform_vector(&mut rng, 50.0));
    }
    let found = run(&given, &in_given_frame());
    assert_eq!(found.scale, Scale::Given);
    let worst = worst_center(&found, &truth);
    assert!(worst < 0.15, "{worst} m");
}

#[test]
fn depth_gives_meters() {
    let truth = truth(&scene(30), false);
    let found = run(&forgotten(&truth), &in_given_frame());
    assert_eq!((found.placed(), found.scale), (30, Scale::Depth));
    assert_eq!(found.landmarks.iter().flatten().count(), truth.landmarks.len());
    let length = |poses: &[Se3]| -> f64 {
        poses.windows(2).map(|p| (p[1].translation - p[0].translation).norm()).sum()
    };
    let own: Vec<Se3> = found.poses.iter().map(|pose| pose.unwrap()).collect();
    let ratio = length(&own) / length(&truth.poses);
    assert!((ratio - 1.0).abs() < 0.02, "{ratio}");
    let [own, from_truth] = costs_of_kept(&truth, &found);
    assert!((own / from_truth - 1.0).abs() < 1e-6, "{own} and {from_truth}");
}

#[test]
fn a_fifth_of_wrong_tracks_is_left_out() {
    for mono in [true, false] {
        let truth = truth(&Scene::generate(&SceneOptions::default()), mono);
        let mut start = forgotten(&truth);
        let is_wrong = with_wrong_tracks(&mut start);
        let found = run(&start, &Options::default());
        assert_eq!(found.placed(), 60, "mono {mono}: {:?}", found.placements);
        let kept: Vec<bool> =
            found.reprojections.iter().chain(&found.depth_reprojections).copied().collect();
        let of = |wrong: bool| {
            let own = kept.iter().zip(&is_wrong).filter(|(_, w)| **w == wrong);
            let all = own.clone().count();
            own.filter(|(agrees, _)| **agrees).count() as f64 / all as f64
        };
        // Without depth a right observation of a camera that sees many wrong ones may go with them.
        assert!(of(false) > 0.8 && of(true) < 0.04, "mono {mono}: {} {}", of(false), of(true));
        // What is left is as good as what the truth leads to.
        let mut known = start.clone();
        known.poses.clone_from(&truth.poses);
        known.landmarks.clone_from(&truth.landmarks);
        let [own, from_truth] = costs_of_kept(&known, &found);
        assert!(own < from_truth * 1.001, "mono {mono}: {own} and {from_truth}");
    }
}

#[test]
fn bits_do_not_depend_on_threads() {
    for mono in [true, false] {
        let mut start = forgotten(&truth(&scene(14), mono));
        with_wrong_tracks(&mut start);
        let with = |threads: usize| {
            let mut options = Options::default();
            options.optimizer.threads = Some(threads);
            let found = run(&start, &options);
            let adjustment =
                found.adjustment.as_ref().map(|adjustment| adjustment.solve.final_cost);
            (found.poses, found.landmarks, found.reprojections, found.placements, adjustment)
        };
        let one = with(1);
        assert!(one.0.iter().flatten().count() > 10);
        assert_eq!(one, with(2));
        assert_eq!(one, with(4));
    }
}

#[test]
fn what_cannot_be_placed_is_named_with_its_reason() {
    let scene = scene(30);
    let mut problem = forgotten(&truth(&scene, true));
    // A keyframe without observations.
    let blind = problem.push_pose(Se3::identity());
    // One that shares five landmarks with the first.
    let poor = problem.push_pose(Se3::identity());
    let own: Vec<usize> =
        (0..problem.reprojections.len()).filter(|&k| problem.reprojections.poses[k] == 0).collect();
    for &k in own.iter().take(5) {
        let (landmark, pixel) =
            (problem.reprojections.landmarks[k], problem.reprojections.pixels[k]);
        problem.reprojections.push(poor as u32, 0, landmark, pixel, 0.7);
    }
    // One that sees the first keyframe's landmarks at random pixels.
    let confused = problem.push_pose(Se3::identity());
    let mut rng = seeded(5);
    for &k in &own {
        let pixel = Vector2::new(rng.random_range(0.0..639.0), rng.random_range(0.0..479.0));
        problem.reprojections.push(
            confused as u32,
            0,
            problem.reprojections.landmarks[k],
            pixel,
            0.7,
        );
    }
    // Two that share landmarks with each other alone.
    let apart = [(); 2].map(|()| problem.push_pose(Se3::identity()));
    for _ in 0..60 {
        let landmark = problem.push_landmark(Vector3::zeros()) as u32;
        let point: Vector3<f64> = uniform_vector(&mut rng, 1.0) + Vector3::new(0.0, 0.0, 4.0);
        for (k, &pose) in apart.iter().enumerate() {
            let seen = point - Vector3::new(0.5 * k as f64, 0.0, 0.0);
            let pixel =
                problem.cameras[0].project(&seen).unwrap() + normal_vector::<2>(&mut rng, 0.5);
            problem.reprojections.push(pose as u32, 0, landmark, pixel, 0.7);
        }
    }
    let found = run(&problem, &Options::default());
    assert_eq!(found.placed(), 30);
    assert!(found.placements[..30].iter().all(|placement| *placement == Placement::Views));
    let reason = |pose: usize| {
        let Placement::Unplaced(reason) = found.placements[pose] else {
            panic!("{pose}: {:?}", found.placements[pose]);
        };
        reason
    };
    assert_eq!(reason(blind), Unplaced::NoObservations);
    assert_eq!(reason(poor), Unplaced::TooFewCommon { most: 5, needed: 8 });
    assert!(
        matches!(reason(confused), Unplaced::NoRelativePose { .. } | Unplaced::Inconsistent { .. }),
        "{:?}",
        reason(confused)
    );
    assert_eq!(apart.map(reason), [Unplaced::Disconnected { others: 1 }; 2]);
    let text = reason(poor).to_string();
    assert!(text.contains("at most 5 landmarks"), "{text}");
    // The observations of what is not placed do not agree.
    let mut kept = problem.clone();
    found.apply_to(&mut kept);
    assert!(kept.reprojections.poses.iter().all(|&pose| (pose as usize) < 30));
}

#[test]
fn a_camera_that_only_turns_is_reported_without_parallax() {
    let scene = scene(10);
    let mut problem = BundleProblem::default();
    problem.push_camera(scene.camera, true);
    let mut rng = seeded(2);
    let points: Vec<Vector3<f64>> = (0..200)
        .map(|_| uniform_vector::<3>(&mut rng, 2.0) + Vector3::new(0.0, 0.0, 6.0))
        .collect();
    points.iter().for_each(|_| _ = problem.push_landmark(Vector3::zeros()));
    for k in 0..8 {
        let turn = So3::exp(&Vector3::new(0.01 * f64::from(k), 0.02 * f64::from(k), 0.0));
        let pose = Se3::new(turn, Vector3::zeros());
        let index = problem.push_pose(Se3::identity()) as u32;
        for (landmark, point) in points.iter().enumerate() {
            let noise = normal_vector::<2>(&mut rng, 0.7);
            let pixel = scene.camera.project(&pose.inverse_transform(point)).unwrap() + noise;
            problem.reprojections.push(index, 0, landmark as u32, pixel, 0.7);
        }
    }
    let found = run(&problem, &Options::default());
    assert_eq!(found.placed(), 0);
    let expected = Placement::Unplaced(Unplaced::NoParallax);
    assert!(found.placements.iter().all(|placement| *placement == expected), "{found:?}");
    assert!(found.landmarks.iter().all(Option::is_none) && found.adjustment.is_none());
    assert!(found.reprojections.iter().all(|&agrees| !agrees));
}

#[test]
fn relative_poses_place_what_views_leave_open_and_give_meters() {
    let scene = scene(30);
    let truth = truth(&scene, true);
    let mut problem = truth.clone();
    // The last three keyframes see a wall without features, but the odometry goes on.
    problem.reprojections.retain(|k| truth.reprojections.poses[k] < 27);
    let sigmas = SVector::from([0.01, 0.01, 0.01, 0.005, 0.005, 0.005]);
    for i in 0..29 {
        problem.relative_poses.push(RelativePose {
            i,
            j: i + 1,
            i_from_j: truth.poses[i].inverse().compose(&truth.poses[i + 1]),
            information: Information::from_sigmas(&sigmas).unwrap(),
            loss: None,
        });
    }
    let found = run(&problem, &in_given_frame());
    assert_eq!((found.placed(), found.scale), (30, Scale::RelativePoses));
    assert!(found.placements[..27].iter().all(|placement| *placement == Placement::Views));
    assert_eq!(found.placements[27..], [Placement::RelativePoses; 3]);
    let worst = worst_center(&found, &truth);
    assert!(worst < 0.15, "{worst} m");
}

#[test]
fn an_end_before_the_time_is_an_outcome() {
    let start = forgotten(&truth(&scene(20), true));
    let never = &mut |_: &_| Control::Continue;
    // A deadline that has passed.
    let due = Interrupt::at(Some(Instant::now()));
    let found = reconstruct(&start, &Options::default(), &due, never).unwrap();
    assert_eq!((found.placed(), found.ended), (0, Some(Interruption::Deadline)));
    let expected = Placement::Unplaced(Unplaced::Interrupted);
    assert!(found.placements.iter().all(|placement| *placement == expected));
    // A caller that left.
    let left = Interrupt::NEVER.or_when(Arc::new(AtomicBool::new(true)));
    let found = reconstruct(&start, &Options::default(), &left, never).unwrap();
    assert_eq!(found.ended, Some(Interruption::Cancelled));
    // An observer that has enough at any stage: what there is then is sound.
    let stages = [
        Stage::ViewGraph,
        Stage::RelativePoses,
        Stage::Rotations,
        Stage::Positions,
        Stage::Adjustment,
        Stage::Resection,
    ];
    for (index, stage) in stages.into_iter().enumerate() {
        let mut seen = Vec::new();
        let found = reconstruct(&start, &Options::default(), &Interrupt::NEVER, &mut |progress| {
            seen.push(progress.stage);
            if progress.stage == stage { Control::Cancel } else { Control::Continue }
        })
        .unwrap();
        assert_eq!(found.ended, Some(Interruption::Cancelled), "{stage:?}");
        assert_eq!(seen.last(), Some(&stage));
        assert_eq!(found.placed(), if index < 4 { 0 } else { 20 }, "{stage:?}");
        let mut kept = start.clone();
        found.apply_to(&mut kept);
        assert!(kept.validate().is_ok() || kept.observation_count() == 0, "{stage:?}");
    }
}

#[test]
fn problems_without_two_views_and_wrong_options_are_reported() {
    let mut problem = BundleProblem::default();
    assert!(
        reconstruct(&problem, &Options::default(), &Interrupt::NEVER, &mut |_| Control::Continue)
            .is_err()
    );
    problem.push_camera(scene(3).camera, true);
    problem.push_pose(Se3::identity());
    problem.push_landmark(Vector3::zeros());
    problem.reprojections.push(0, 0, 0, Vector2::new(10.0, 10.0), 1.0);
    let found = run(&problem, &Options::default());
    let reason = Unplaced::TooFewCommon { most: 0, needed: 8 };
    assert_eq!(found.placements, [Placement::Unplaced(reason)]);
    let options = Options { sigma_allowance: 0.5, ..Options::default() };
    let error = options.validate().unwrap_err();
    assert!(matches!(error, SolveError::InvalidOption { field: "sigma_allowance", .. }));
}
