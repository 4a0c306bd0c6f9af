//! Micro-benchmarks of the solvers on synthetic scenes: windows, full bundle adjustment, growth, and
//! the refinement of one pose.
//!
//! Every measured call is a public one and starts from the same clone of a problem; cloning is not
//! measured. Solves run on a pool of one thread that is there before, as a server's is. Throughput
//! counts observations of a whole solve. How covis compares with others is `reference/`'s to say.

#![allow(clippy::unwrap_used, reason = "a scene that cannot be solved has no time")]

use std::f64::consts::TAU;
use std::hint::black_box;
use std::time::Duration;

use covis_solvers::bundle_adjustment::{self, BundleSummary};
use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3, Snavely, So3};
use covis_solvers::optimizer::{self, ignore_iterations};
use covis_solvers::pose_refinement::{self, PointObservation};
use covis_solvers::problem::BundleProblem;
use covis_solvers::testing::random::{normal_vector, perturbed, seeded, uniform_vector};
use covis_solvers::testing::{Scene, SceneObservation, SceneOptions};
use criterion::{BatchSize, BenchmarkId, Criterion, Throughput};
use nalgebra::{Matrix3, SVector, Vector2, Vector3};
use rayon::{ThreadPool, ThreadPoolBuilder};

fn main() {
    let mut criterion = Criterion::default()
        .sample_size(20)
        .warm_up_time(Duration::from_secs(1))
        .measurement_time(Duration::from_secs(3))
        .configure_from_args();
    let pool = ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    windows(&mut criterion, &pool);
    full(&mut criterion, &pool);
    growth(&mut criterion, &pool);
    refine_pose(&mut criterion);
    criterion.final_summary();
}

/// Local bundle adjustment to convergence: known intrinsics, 10 to 30 keyframes.
fn windows(criterion: &mut Criterion, pool: &ThreadPool) {
    let mut group = criterion.benchmark_group("window");
    for keyframes in [10, 20, 30] {
        for (name, depth) in [("pixels", false), ("depth", true)] {
            let problem = window(keyframes, depth);
            group.throughput(Throughput::Elements(problem.observation_count() as u64));
            group.bench_function(BenchmarkId::new(name, keyframes), |bencher| {
                bencher.iter_batched(
                    || problem.clone(),
                    |problem| solve(problem, pool, optimizer::Options::default()),
                    BatchSize::LargeInput,
                );
            });
        }
    }
    group.finish();
}

/// Full bundle adjustment to convergence: 9 unknowns a camera.
fn full(criterion: &mut Criterion, pool: &ThreadPool) {
    let ring = Ring { cameras: 60, landmarks_a_camera: 40, track: 8 };
    let problem = ring.with_unknown_intrinsics();
    let mut group = criterion.benchmark_group("full");
    group.throughput(Throughput::Elements(problem.observation_count() as u64));
    group.bench_function("9 unknowns", |bencher| {
        bencher.iter_batched(
            || problem.clone(),
            |problem| solve(problem, pool, optimizer::Options::default()),
            BatchSize::LargeInput,
        );
    });
    group.finish();
}

/// Three steps on ever longer rings: the time an observation should not grow with them.
fn growth(criterion: &mut Criterion, pool: &ThreadPool) {
    let three_steps = optimizer::Options {
        max_iterations: 3,
        cost_tolerance: 0.0,
        gradient_tolerance: 0.0,
        step_tolerance: 0.0,
        ..optimizer::Options::default()
    };
    let mut group = criterion.benchmark_group("growth, 3 steps");
    group.sample_size(10);
    for cameras in [50, 150, 500, 1500] {
        let problem = Ring { cameras, landmarks_a_camera: 40, track: 5 }.with_known_intrinsics();
        let observations = problem.observation_count();
        group.throughput(Throughput::Elements(observations as u64));
        group.bench_function(BenchmarkId::from_parameter(observations), |bencher| {
            bencher.iter_batched(
                || problem.clone(),
                |problem| solve(problem, pool, three_steps),
                BatchSize::LargeInput,
            );
        });
    }
    group.finish();
}

/// One pose from 500 known landmarks, as `RefinePose` does it.
fn refine_pose(criterion: &mut Criterion) {
    const COUNT: usize = 500;
    let options = pose_refinement::Options::default();
    let mut group = criterion.benchmark_group("refine pose");
    group.throughput(Throughput::Elements(COUNT as u64));
    for (name, depth) in [("pixels", false), ("depth", true)] {
        let (camera, start, observations) = known_landmarks(COUNT, depth);
        group.bench_function(BenchmarkId::new(name, COUNT), |bencher| {
            let observer = &mut ignore_iterations;
            bencher.iter(|| {
                let seen = black_box(&observations);
                pose_refinement::refine(&camera, &start, seen, None, &options, observer).unwrap()
            });
        });
    }
    group.finish();
}

/// Solves on the pool; the problem goes back with the summary, so that dropping it is not measured.
fn solve(
    mut problem: BundleProblem,
    pool: &ThreadPool,
    optimizer: optimizer::Options,
) -> (BundleProblem, BundleSummary) {
    let options = bundle_adjustment::Options { optimizer, ..Default::default() };
    let summary = pool.install(|| {
        bundle_adjustment::solve(&mut problem, &options, &mut ignore_iterations).unwrap()
    });
    (problem, summary)
}

/// A stretch of a walk along the walls of a room, about 600 observations a keyframe. The first two
/// keyframes are held where they are in truth, as those outside of a server's window are held.
fn window(keyframes: usize, depth: bool) -> BundleProblem {
    let scene = room(keyframes, 6000);
    let mut problem = scene.to_problem();
    problem.constant_poses[..2].fill(true);
    problem.poses[..2].copy_from_slice(&scene.truth[..2]);
    if depth {
        return problem;
    }
    // The same pixels without their depths; two views and more fix a landmark.
    let with_depth = std::mem::take(&mut problem.depth_reprojections);
    let mut views = vec![0; problem.landmarks.len()];
    for &landmark in &with_depth.landmarks {
        views[landmark as usize] += 1;
    }
    for k in 0..with_depth.len() {
        let landmark = with_depth.landmarks[k];
        if views[landmark as usize] >= 3 {
            let (pose, camera) = (with_depth.poses[k], with_depth.cameras[k]);
            let (pixel, sigma_px) = (with_depth.pixels[k], with_depth.sigmas_px[k]);
            problem.reprojections.push(pose, camera, landmark, pixel, sigma_px);
        }
    }
    problem
}

/// A walk that turns by 6 degrees each keyframe, so that a track is about 7 long.
fn room(keyframes: usize, landmarks: usize) -> Scene {
    Scene::generate(&SceneOptions {
        keyframes,
        laps: keyframes as f64 / 60.0,
        landmarks,
        ..SceneOptions::default()
    })
}

/// A camera, a start a few centimeters off, and what is seen from the true pose.
fn known_landmarks(count: usize, depth: bool) -> (Camera, Se3, Vec<PointObservation>) {
    let scene = room(10, 12_000);
    let observation = |o: &SceneObservation| PointObservation {
        point_in_world: scene.landmarks[o.landmark],
        pixel: o.measurement.pixel,
        sigma_px: o.measurement.sigma_px,
        depth_m: o.measurement.depth_m.filter(|_| depth),
    };
    let observations: Vec<_> = scene.observations[0].iter().take(count).map(observation).collect();
    assert_eq!(observations.len(), count, "the room is too empty");
    let off = Se3::exp(&SVector::from([0.03, -0.02, 0.04, 0.01, -0.02, 0.01]));
    (scene.camera, scene.truth[0].compose(&off), observations)
}

/// Cameras on a circle, half a meter apart, that look outward. A landmark is seen by `track`
/// neighbors, whatever the number of cameras.
struct Ring {
    cameras: usize,
    landmarks_a_camera: usize,
    track: usize,
}

impl Ring {
    /// One camera model with known parameters: 6 unknowns a pose.
    fn with_known_intrinsics(&self) -> BundleProblem {
        let mut problem = BundleProblem::default();
        let camera = Camera::Pinhole(PinholeRadialTangential {
            fx: 500.0,
            fy: 500.0,
            cx: 320.0,
            cy: 240.0,
            k1: -0.02,
            k2: 0.001,
            p1: 0.0,
            p2: 0.0,
            k3: 0.0,
        });
        problem.push_camera(camera, true);
        self.fill(&mut problem, |_pose| 0);
        problem
    }

    /// A camera of its own for each pose, with unknown focal length and distortion.
    fn with_unknown_intrinsics(&self) -> BundleProblem {
        let mut problem = BundleProblem::default();
        for _ in 0..self.cameras {
            let camera = Snavely { focal: 500.0, k1: -0.02, k2: 0.001 };
            problem.push_camera(Camera::Snavely(camera), false);
        }
        self.fill(&mut problem, |pose| pose);
        problem
    }

    /// Adds poses, landmarks and observations with half a pixel of noise, then moves the start off.
    fn fill(&self, problem: &mut BundleProblem, camera_of: impl Fn(usize) -> usize) {
        let mut rng = seeded(5);
        let truth: Vec<Se3> = (0..self.cameras).map(|k| self.pose(k)).collect();
        for pose in &truth {
            let sigmas = SVector::from([0.02, 0.02, 0.02, 0.003, 0.003, 0.003]);
            problem.push_pose(perturbed(&mut rng, pose, &sigmas));
        }
        problem.constant_poses[..2].fill(true);
        problem.poses[..2].copy_from_slice(&truth[..2]);
        for (home, home_pose) in truth.iter().enumerate() {
            for _ in 0..self.landmarks_a_camera {
                let spread: Vector3<f64> = uniform_vector(&mut rng, 1.0);
                let in_home = Vector3::new(1.5 * spread.x, 1.5 * spread.y, 7.5 + 2.5 * spread.z);
                let point = home_pose.transform(&in_home);
                let landmark = problem.push_landmark(point + normal_vector(&mut rng, 0.05));
                for neighbor in 0..self.track {
                    let pose = (home + self.cameras + neighbor - self.track / 2) % self.cameras;
                    let camera = camera_of(pose);
                    let in_camera = truth[pose].inverse_transform(&point);
                    let noise: Vector2<f64> = normal_vector(&mut rng, 0.5);
                    let pixel = problem.cameras[camera].project(&in_camera).unwrap() + noise;
                    let ids = (pose as u32, camera as u32, landmark as u32);
                    problem.reprojections.push(ids.0, ids.1, ids.2, pixel, 0.5);
                }
            }
        }
    }

    fn pose(&self, k: usize) -> Se3 {
        let angle = TAU * k as f64 / self.cameras as f64;
        let radius_m = 0.5 * self.cameras as f64 / TAU;
        let forward = Vector3::new(angle.cos(), angle.sin(), 0.0);
        let down = Vector3::new(0.0, 0.0, -1.0);
        let right = down.cross(&forward);
        let rotation = So3::from_matrix(&Matrix3::from_columns(&[right, down, forward]));
        Se3::new(rotation, forward * radius_m)
    }
}
