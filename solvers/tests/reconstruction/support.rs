//! Problems for reconstructions, and how far a reconstruction is from what is known.

use std::path::Path;

use covis_solvers::bundle_adjustment::{self, solve};
use covis_solvers::evaluation::bundle_cost;
use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3, So3};
use covis_solvers::initialization::{TriangulationOptions, View, triangulate};
use covis_solvers::interrupt::Interrupt;
use covis_solvers::optimizer::{Control, ignore_iterations};
use covis_solvers::problem::BundleProblem;
use covis_solvers::reconstruction::{Options, Reconstruction, reconstruct};
use nalgebra::{Matrix3, Vector2, Vector3};

/// Forgets poses and landmarks.
pub(crate) fn forgotten(problem: &BundleProblem) -> BundleProblem {
    let mut forgotten = problem.clone();
    forgotten.poses.fill(Se3::identity());
    forgotten.landmarks.fill(Vector3::zeros());
    forgotten.constant_poses.fill(false);
    forgotten.constant_landmarks.fill(false);
    forgotten
}

pub(crate) fn run(problem: &BundleProblem, options: &Options) -> Reconstruction {
    reconstruct(problem, options, &Interrupt::NEVER, &mut |_| Control::Continue).unwrap()
}

/// The cost over all observations of placed keyframes, those included that the reconstruction left out,
/// after a solve that starts from it. Landmarks without a position get one from all that see them.
pub(crate) fn cost_of_all(problem: &BundleProblem, reconstruction: &Reconstruction) -> f64 {
    let mut all = problem.clone();
    let mut kept = problem.clone();
    reconstruction.apply_to(&mut kept);
    (all.poses, all.cameras) = (kept.poses, kept.cameras);
    all.landmarks = kept.landmarks;
    let plain = &problem.reprojections;
    let mut views = vec![Vec::new(); all.landmarks.len()];
    for k in 0..plain.len() {
        views[plain.landmarks[k] as usize].push(View {
            world_from_camera: all.poses[plain.poses[k] as usize],
            camera: all.cameras[plain.cameras[k] as usize],
            pixel: plain.pixels[k],
            sigma_px: plain.sigmas_px[k],
            depth_m: None,
        });
    }
    for (landmark, views) in views.iter().enumerate() {
        if reconstruction.landmarks[landmark].is_none() {
            let options = TriangulationOptions {
                min_parallax_rad: 0.0,
                max_whitened_rms: 1e9,
                max_whitened_error: 1e9,
            };
            let found = triangulate(views, &options).map(|found| found.point_in_world);
            // A few meters ahead of the first view where the rays do not meet.
            let ahead = views.first().map(|view| {
                let ray = view.camera.unproject(&view.pixel).unwrap();
                view.world_from_camera.transform(&(ray.normalize() * 10.0))
            });
            all.landmarks[landmark] = found.ok().or(ahead).unwrap_or_default();
        }
    }
    let mut options = bundle_adjustment::Options::default();
    options.optimizer.max_iterations = 300;
    solve(&mut all, &options, &mut ignore_iterations).unwrap();
    bundle_cost(&all).total
}

/// One of Blender's problems, with its shared camera held; the format is told in the data's README.
pub(crate) fn libmv(path: &Path) -> BundleProblem {
    let bytes = std::fs::read(path).unwrap();
    assert_eq!(&bytes[..2], b"vP");
    let mut at = 2;
    let mut word = || {
        at += 4;
        <[u8; 4]>::try_from(&bytes[at - 4..at]).unwrap()
    };
    let float = |word: [u8; 4]| f64::from(f32::from_le_bytes(word));
    let [focal, cx, cy, k1, k2, k3, p1, p2] = [(); 8].map(|()| float(word()));
    let mut problem = BundleProblem::default();
    let camera = PinholeRadialTangential { fx: focal, fy: focal, cx, cy, k1, k2, p1, p2, k3 };
    problem.push_camera(Camera::Pinhole(camera), true);
    let mut pose_of = std::collections::HashMap::new();
    for _ in 0..i32::from_le_bytes(word()) {
        let image = i32::from_le_bytes(word());
        let rotation = [(); 9].map(|()| float(word()));
        let rotation = So3::from_matrix(&Matrix3::from_column_slice(&rotation));
        let translation = Vector3::from([(); 3].map(|()| float(word())));
        pose_of.insert(image, problem.push_pose(Se3::new(rotation, translation).inverse()));
    }
    let mut landmark_of = std::collections::HashMap::new();
    for _ in 0..i32::from_le_bytes(word()) {
        let track = i32::from_le_bytes(word());
        let point = Vector3::from([(); 3].map(|()| float(word())));
        landmark_of.insert(track, problem.push_landmark(point));
    }
    for _ in 0..i32::from_le_bytes(word()) {
        let (image, track) = (i32::from_le_bytes(word()), i32::from_le_bytes(word()));
        let pixel = Vector2::from([(); 2].map(|()| float(word())));
        let (pose, landmark) = (pose_of[&image] as u32, landmark_of[&track] as u32);
        problem.reprojections.push(pose, 0, landmark, pixel, 1.0);
    }
    problem
}

/// The cost over what agrees by the reconstruction, after a solve from it and after one from the values
/// that `known` has.
pub(crate) fn costs_of_kept(known: &BundleProblem, reconstruction: &Reconstruction) -> [f64; 2] {
    let mut own = known.clone();
    reconstruction.apply_to(&mut own);
    let mut other = own.clone();
    other.poses.clone_from(&known.poses);
    other.landmarks.clone_from(&known.landmarks);
    other.cameras.clone_from(&known.cameras);
    [own, other].map(|mut problem| {
        let mut options = bundle_adjustment::Options::default();
        options.optimizer.max_iterations = 300;
        solve(&mut problem, &options, &mut ignore_iterations).unwrap();
        bundle_cost(&problem).total
    })
}
