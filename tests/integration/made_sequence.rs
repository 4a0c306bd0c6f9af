//! Sequences made from a seed: a robot with a depth camera walks along walls with points on them.
//!
//! It sees the points with the noise of a Kinect (Khoshelham and Elberink, Sensors 2012), tracks its
//! motion from one keyframe to the next by what both see, gives new ids to what it has lost from sight,
//! and closes loops by a few matches, some of them wrong. Nothing is exact but `truth`, which starts
//! solves and says what is right.

use std::collections::BTreeMap;

use covis::wire::v1;
use covis_solvers::geometry::{Camera, LieGroup, PinholeRadialTangential, Se3, So3};
use covis_solvers::relative_motion::{Match, PointEstimate, RelativeMotion, measure};
use covis_solvers::testing::random::{normal_vector, seeded};
use nalgebra::{Matrix3, Rotation3, Vector2, Vector3};
use rand::RngExt;

use crate::sequence::{Closure, Sequence};

/// Distances at which a Kinect measures, m.
const NEAREST_M: f64 = 0.6;
const FARTHEST_M: f64 = 6.0;
/// Before and behind a corner of the way the robot turns within so much, m.
const TURN_M: f64 = 2.0;
/// Keyframes after which a point that was lost from sight gets a new id.
pub(crate) const MEMORY: usize = 10;
/// Keyframes between the ends of a closure at least.
const GAP: usize = 30;
/// Points that the ends of a closure share at least, and the most that a detector finds in both.
const SHARED: usize = 25;
const MOST_MATCHES: usize = 60;
/// Views of a point in directions further apart do not match.
const LARGEST_ANGLE_RAD: f64 = 0.7;
/// Share of the matches of a closure that are wrong, by so many pixels: what consensus lets through.
const WRONG: f64 = 0.05;
const WRONG_PX: f64 = 6.0;
pub(crate) const SIGMA_PX: f64 = 0.7;
/// Share of a descriptor's bits that differ from one view to the next.
pub(crate) const FLIPPED: f64 = 0.12;

/// Where a robot walks.
#[derive(Clone)]
pub(crate) struct Course {
    /// Corners of the way, m.
    pub(crate) way: Vec<[f64; 2]>,
    /// Ends of each wall, m.
    pub(crate) walls: Vec<[[f64; 2]; 2]>,
    /// Shifts at which the walls stand again with points that look alike, m.
    pub(crate) copies: Vec<[f64; 2]>,
    /// Points per meter of wall, on both sides of it together.
    pub(crate) points_per_m: f64,
    /// Distance of keyframes, m.
    pub(crate) step_m: f64,
    /// Keyframes from one that looks for a closure to the next.
    pub(crate) closure_step: usize,
    /// σ of the relative errors that the frontend's focal length and its depth have.
    pub(crate) calibration_error: f64,
}

/// A sequence, and which point each of its landmarks is.
pub(crate) struct Made {
    pub(crate) sequence: Sequence,
    pub(crate) point_of: BTreeMap<i64, usize>,
}

/// The walls of a box from one corner to the other.
pub(crate) fn walls([x, y]: [f64; 2], [to_x, to_y]: [f64; 2]) -> [[[f64; 2]; 2]; 4] {
    let corners = [[x, y], [to_x, y], [to_x, to_y], [x, to_y]];
    [0, 1, 2, 3].map(|k| [corners[k], corners[(k + 1) % 4]])
}

/// A point of the scene.
#[derive(Clone, Copy)]
struct Point {
    position: Vector3<f64>,
    descriptor: [u8; 32],
}

/// The camera as it is.
struct Device {
    camera: Camera,
    depth_scale: f64,
}

/// A view of a point.
pub(crate) struct Seen {
    pub(crate) point: usize,
    pub(crate) pixel: Vector2<f64>,
    pub(crate) depth_m: f64,
}

impl Seen {
    /// As a row of [`Sequence::observations`].
    pub(crate) fn observation(&self, landmark: i64) -> [f64; 6] {
        let Self { pixel, depth_m, .. } = *self;
        [landmark as f64, pixel.x, pixel.y, depth_m, SIGMA_PX, sigma_depth(depth_m)]
    }
}

pub(crate) fn pinhole() -> PinholeRadialTangential {
    PinholeRadialTangential::undistorted(525.0, 525.0, 319.5, 239.5)
}

/// σ of a Kinect's depth, m.
pub(crate) fn sigma_depth(depth_m: f64) -> f64 {
    0.001_425 * depth_m * depth_m + 0.002
}

fn vector([x, y]: [f64; 2]) -> Vector2<f64> {
    Vector2::new(x, y)
}

/// Looking along an angle in the plane: x right, y down, z forward.
pub(crate) fn looking(angle: f64, at: Vector2<f64>) -> Se3 {
    let forward = Vector3::new(angle.cos(), angle.sin(), 0.0);
    let down = -Vector3::z();
    let axes = Matrix3::from_columns(&[down.cross(&forward), down, forward]);
    let q = nalgebra::UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes));
    let rotation = So3::from_quaternion_xyzw(q.i, q.j, q.k, q.w).unwrap();
    Se3::new(rotation, Vector3::new(at.x, at.y, 0.0))
}

/// Whether the wall stands between two places.
fn hides(wall: &[[f64; 2]; 2], from: Vector2<f64>, to: Vector2<f64>) -> bool {
    let [a, b] = wall.map(vector);
    let side = |a: Vector2<f64>, b: Vector2<f64>, c: Vector2<f64>| (b - a).perp(&(c - a)) > 0.0;
    side(from, to, a) != side(from, to, b) && side(a, b, from) != side(a, b, to)
}

impl Course {
    /// The poses of the keyframes.
    fn truth(&self) -> Vec<Se3> {
        let way: Vec<Vector2<f64>> = self.way.iter().copied().map(vector).collect();
        let legs: Vec<Vector2<f64>> = way.windows(2).map(|ends| ends[1] - ends[0]).collect();
        // Unwrapped; a turn by half a circle is to the left.
        let mut angles = vec![legs[0].y.atan2(legs[0].x)];
        for pair in legs.windows(2) {
            let turn = pair[0].perp(&pair[1]).atan2(pair[0].dot(&pair[1]));
            angles.push(angles[angles.len() - 1] + turn);
        }
        let mut truth = Vec::new();
        let (mut leg, mut rest) = (0, 0.0);
        while leg < legs.len() {
            let length = legs[leg].norm();
            if rest >= length {
                (leg, rest) = (leg + 1, rest - length);
                continue;
            }
            let mut angle = angles[leg];
            let reach = |other: usize| TURN_M.min(0.5 * length).min(0.5 * legs[other].norm());
            if leg > 0 {
                let share = 0.5 * (1.0 - rest / reach(leg - 1)).max(0.0);
                angle += share * (angles[leg - 1] - angles[leg]);
            }
            if leg + 1 < legs.len() {
                let share = 0.5 * (1.0 - (length - rest) / reach(leg + 1)).max(0.0);
                angle += share * (angles[leg + 1] - angles[leg]);
            }
            truth.push(looking(angle, way[leg] + rest / length * legs[leg]));
            rest += self.step_m;
        }
        truth
    }

    /// The walls and their copies.
    fn all_walls(&self) -> impl Iterator<Item = [[f64; 2]; 2]> {
        let shifts = std::iter::once([0.0, 0.0]).chain(self.copies.iter().copied());
        let shifted =
            |[x, y]: [f64; 2]| self.walls.iter().map(move |wall| wall.map(|[a, b]| [a + x, b + y]));
        shifts.flat_map(shifted)
    }

    fn points(&self, rng: &mut impl rand::Rng) -> Vec<Point> {
        let mut points = Vec::new();
        for wall in &self.walls {
            let [a, b] = wall.map(vector);
            let along = (b - a).normalize();
            for _ in 0..((b - a).norm() * self.points_per_m) as usize {
                let side = if rng.random::<bool>() { 1.0 } else { -1.0 };
                let offset = side * (0.01 + 0.3 * rng.random::<f64>());
                let at =
                    a + rng.random::<f64>() * (b - a) + offset * Vector2::new(-along.y, along.x);
                let height = 3.0 * rng.random::<f64>() - 1.2;
                let position = Vector3::new(at.x, at.y, height);
                points.push(Point { position, descriptor: rng.random() });
            }
        }
        let originals = points.len();
        for &[x, y] in &self.copies {
            for k in 0..originals {
                let Point { position, descriptor } = points[k];
                points.push(Point { position: position + Vector3::new(x, y, 0.0), descriptor });
            }
        }
        points
    }

    /// Where the points of a seed are.
    pub(crate) fn positions(&self, points: u64) -> Vec<Vector3<f64>> {
        self.points(&mut seeded(points)).into_iter().map(|point| point.position).collect()
    }

    /// What the camera sees at a pose.
    fn views(
        &self,
        points: &[Point],
        pose: &Se3,
        device: &Device,
        rng: &mut impl rand::Rng,
    ) -> Vec<Seen> {
        let mut views = Vec::new();
        for (point, Point { position, .. }) in points.iter().enumerate() {
            let in_camera = pose.inverse_transform(position);
            if !(NEAREST_M..FARTHEST_M).contains(&in_camera.z) {
                continue;
            }
            let Some(pixel) = device.camera.project(&in_camera) else { continue };
            let pixel = pixel + normal_vector::<2>(rng, SIGMA_PX);
            if !(0.0..640.0).contains(&pixel.x) || !(0.0..480.0).contains(&pixel.y) {
                continue;
            }
            if self.all_walls().any(|wall| hides(&wall, pose.translation.xy(), position.xy())) {
                continue;
            }
            let noise = normal_vector::<1>(rng, sigma_depth(in_camera.z)).x;
            views.push(Seen { point, pixel, depth_m: device.depth_scale * in_camera.z + noise });
        }
        views
    }

    /// The sequence of a seed. Its closures have the information that their matches give.
    pub(crate) fn make(&self, seed: u64) -> Made {
        let mut rng = seeded(seed);
        let points = self.points(&mut rng);
        self.walked(&points, &mut rng)
    }

    /// A robot of `seed` that walks here, where the points are those of another seed.
    pub(crate) fn walk_of(&self, points: u64, seed: u64) -> Made {
        let points = self.points(&mut seeded(points));
        self.walked(&points, &mut seeded(seed))
    }

    fn walked(&self, points: &[Point], rng: &mut impl rand::Rng) -> Made {
        let truth = self.truth();
        let [focal, depth_scale] =
            normal_vector::<2>(rng, self.calibration_error).map(|error| 1.0 + error).into();
        let PinholeRadialTangential { fx, fy, cx, cy, .. } = pinhole();
        let model = PinholeRadialTangential::undistorted(focal * fx, focal * fy, cx, cy);
        let device = Device { camera: Camera::Pinhole(model), depth_scale };
        let seen: Vec<Vec<Seen>> =
            truth.iter().map(|pose| self.views(points, pose, &device, rng)).collect();
        let camera = Camera::Pinhole(pinhole());
        let mut odometry = vec![(0.0, truth[0])];
        for (k, views) in seen.windows(2).enumerate() {
            let start = truth[k].inverse().compose(&truth[k + 1]);
            let common = common(&views[0], &views[1]);
            let matches: Vec<Match> = common.iter().map(|[a, b]| matched(a, b, true)).collect();
            let motion = measure(&camera, &matches, &start).unwrap();
            odometry.push((0.1 * (k + 1) as f64, odometry[k].1.compose(&motion.a_from_b)));
        }
        let (closures, matches) = self.close(&truth, points, &seen, rng);
        let mut last_seen: BTreeMap<usize, (usize, i64)> = BTreeMap::new();
        let mut point_of = BTreeMap::new();
        let mut observations = Vec::new();
        let mut descriptors = Vec::new();
        for (k, views) in seen.iter().enumerate() {
            let observation = |seen: &Seen| {
                let known = last_seen.get(&seen.point).filter(|(last, _)| k - last <= MEMORY);
                let landmark = known.map_or(point_of.len() as i64, |&(_, id)| id);
                point_of.insert(landmark, seen.point);
                last_seen.insert(seen.point, (k, landmark));
                seen.observation(landmark)
            };
            observations.push(views.iter().map(observation).collect());
            let mut flipped = |byte: u8| {
                (0..8).fold(byte, |byte, bit| byte ^ u8::from(rng.random_bool(FLIPPED)) << bit)
            };
            let mut descriptor =
                |seen: &Seen| points[seen.point].descriptor.map(&mut flipped).to_vec();
            descriptors.push(views.iter().map(&mut descriptor).collect());
        }
        let sequence = Sequence {
            camera: wire(),
            odometry,
            truth,
            observations,
            descriptors,
            closures,
            matches,
        };
        Made { sequence, point_of }
    }

    /// Closures between keyframes that share points, and the matches of each.
    fn close(
        &self,
        truth: &[Se3],
        points: &[Point],
        seen: &[Vec<Seen>],
        rng: &mut impl rand::Rng,
    ) -> (Vec<Closure>, Vec<Vec<[f64; 7]>>) {
        let camera = Camera::Pinhole(pinhole());
        let (mut closures, mut all_matches) = (Vec::new(), Vec::new());
        for j in (GAP..truth.len()).step_by(self.closure_step) {
            let shared = |i: usize| {
                let is_alike = |[a, _]: &[&Seen; 2]| {
                    let from = |k: usize| points[a.point].position - truth[k].translation;
                    from(i).angle(&from(j)) < LARGEST_ANGLE_RAD
                };
                let mut shared = common(&seen[i], &seen[j]);
                shared.retain(is_alike);
                shared
            };
            let candidates: Vec<usize> =
                (0..=j - GAP).filter(|&i| shared(i).len() >= SHARED).collect();
            if candidates.is_empty() {
                continue;
            }
            let i = candidates[rng.random_range(0..candidates.len())];
            let mut shared = shared(i);
            let count = rng.random_range(SHARED / 2..MOST_MATCHES.min(shared.len()));
            for k in 0..count {
                let other = rng.random_range(k..shared.len());
                shared.swap(k, other);
            }
            let mut matches: Vec<Match> =
                shared[..count].iter().map(|[a, b]| matched(a, b, false)).collect();
            for seen in &mut matches {
                if rng.random_bool(WRONG) {
                    seen.pixel += normal_vector::<2>(rng, WRONG_PX);
                }
            }
            let start = truth[i].inverse().compose(&truth[j]);
            let Some(found) = measure(&camera, &matches, &start) else { continue };
            closures.push(closure([i, j], &found));
            let row = |seen: &Match| {
                let (point, pixel) = (seen.landmark.point, seen.pixel);
                [point.x, point.y, point.z, pixel.x, pixel.y, 0.0, SIGMA_PX]
            };
            all_matches.push(matches.iter().map(row).collect());
        }
        (closures, all_matches)
    }
}

/// A true closure as its matches give it.
pub(crate) fn closure([i, j]: [usize; 2], found: &RelativeMotion) -> Closure {
    let matrix = found.information.matrix();
    let upper = (0..6).flat_map(|r| (r..6).map(move |c| (r, c)));
    let information = upper.map(|at| matrix[at]).collect();
    Closure { i, j, measured: found.a_from_b, information, is_true: true }
}

/// What both see.
pub(crate) fn common<'a>(a: &'a [Seen], b: &'a [Seen]) -> Vec<[&'a Seen; 2]> {
    // Both are in the order of the points.
    let mut rest = a.iter().peekable();
    let pair = |seen: &'a Seen| {
        while rest.next_if(|first| first.point < seen.point).is_some() {}
        rest.next_if(|first| first.point == seen.point).map(|first| [first, seen])
    };
    b.iter().filter_map(pair).collect()
}

/// The match of a point by its depth in `a` with the view of `b`.
pub(crate) fn matched(a: &Seen, b: &Seen, with_depth: bool) -> Match {
    let model = pinhole();
    let (z, sigma_z) = (a.depth_m, sigma_depth(a.depth_m));
    let ray =
        Vector3::new((a.pixel.x - model.cx) / model.fx, (a.pixel.y - model.cy) / model.fy, 1.0);
    let lateral = SIGMA_PX * z / model.fx;
    let covariance = sigma_z * sigma_z * ray * ray.transpose()
        + lateral * lateral * Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, 0.0))
        + 1e-12 * Matrix3::identity();
    Match {
        landmark: PointEstimate { point: z * ray, covariance },
        pixel: b.pixel,
        sigma_px: SIGMA_PX,
        depth_m: with_depth.then(|| (b.depth_m, sigma_depth(b.depth_m))),
    }
}

pub(crate) fn wire() -> v1::Camera {
    let PinholeRadialTangential { fx, fy, cx, cy, .. } = pinhole();
    let pinhole = v1::PinholeRadialTangential { fx, fy, cx, cy, ..Default::default() };
    let model = v1::camera::Model::PinholeRadialTangential(pinhole);
    v1::Camera { width_px: 640, height_px: 480, model: Some(model), ..Default::default() }
}
