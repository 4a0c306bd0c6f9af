//! Bundle adjustment problems: of a window, of the whole map, and around a keyframe to be removed.
//!
//! Keyframes of a window come first in the problem, then the fixed ones, each group by id; cameras and
//! landmarks by id. Relative-pose constraints enter when both keyframes are in the problem and one of
//! them may move, priors when theirs may move, those that are switched off never. A pose with too few
//! measurements is held constant, and an observation without finite projection at the current estimates
//! is left out: neither may stop the whole solve.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use covis_solvers::factors::{PosePrior, PositionPrior, RelativePose, Reprojection};
use covis_solvers::geometry::Se3;
use covis_solvers::loss::Loss;
use covis_solvers::problem::{BundleProblem, DisjointSets};
use covis_solvers::robust::default_threshold;

use super::{GlobalOptions, Held, MapProblem};
use crate::gauge::held_poses;
use crate::odometry;
use crate::view_noise::widened;
use crate::window::is_usable;
use crate::{ClientIndex, ConstraintKind, Depth, EntityId, Gauge, Map, Noise, Prior, View, Window};

/// With fewer observations and no other measurement a pose is held constant: three points fix six
/// unknowns.
const MIN_OBSERVATIONS: usize = 3;

/// Most neighbors by shared landmarks. The keyframe has little information on the others.
const NEIGHBORS: usize = 20;

/// The problem of a window, with the policy's losses and constant intrinsics.
///
/// A client's prior that the current estimates do not fit waits for the pose graph that it started: in
/// a window, whose rim is held, it would bend what the whole map should take. Where the policy lets
/// priors start none, it counts.
///
/// Landmarks and keyframes that were removed from the map are left out.
#[must_use]
pub fn local_problem(map: &Map, window: &Window) -> MapProblem {
    let poses = window.free.iter().map(|&id| (id, false));
    let poses = poses.chain(window.fixed.iter().map(|&id| (id, true)));
    let mut builder = Builder::new(map, map.policy().observation_loss);
    builder.strained_priors_wait = map.policy().loop_closure;
    (builder.ties_odometry, builder.believes_residuals) = (true, true);
    poses.for_each(|(id, constant)| builder.keyframe(id, constant));
    window.landmarks.iter().for_each(|&id| builder.landmark(id));
    builder.window_frame = window_frame(map, window);
    MapProblem { carried: window.carried.clone(), ..builder.finish(true) }
}

/// The problem of the whole map.
///
/// By default the first keyframe of each piece of the map is held that no prior places in the world;
/// see [`Gauge`].
#[must_use]
pub fn global_problem(map: &Map, options: &GlobalOptions) -> MapProblem {
    let mut builder = Builder::new(map, options.loss);
    (builder.ties_odometry, builder.gauge) = (true, Some(options.gauge));
    map.keyframes().keys().for_each(|&id| builder.keyframe(id, false));
    map.landmarks().keys().filter(|&&id| is_usable(map, id)).for_each(|&id| builder.landmark(id));
    match options.gauge {
        Gauge::FirstKeyframeFixed | Gauge::FixedPoses => builder.fix_pieces(options.gauge),
        Gauge::Free | Gauge::Priors => {}
    }
    MapProblem { held: Vec::new(), ..builder.finish(options.fix_intrinsics) }
}

/// The observations of the whole map, for a reconstruction that looks at no estimate: of landmarks without
/// position too. Of what else was measured it has odometry. Loop closures and priors are left out: one
/// that was believed wrongly may be the reason for the reconstruction, and views of the same landmarks
/// close loops too.
#[must_use]
pub fn observation_problem(map: &Map) -> MapProblem {
    let mut builder = Builder::new(map, map.policy().observation_loss);
    builder.looks_at_estimates = false;
    map.keyframes().keys().for_each(|&id| builder.keyframe(id, false));
    let seen = map.landmarks().iter().filter(|(_, landmark)| !landmark.observers.is_empty());
    seen.for_each(|(&id, _)| builder.landmark(id));
    builder.finish(true)
}

/// What the fixed keyframes of a window are: those that the map's gauge holds, or those around it.
fn window_frame(map: &Map, window: &Window) -> Option<Gauge> {
    let gauge = map.policy().gauge;
    // The gauge holds at most one keyframe of a client.
    let may_be_held = window.fixed.len() <= map.clients().len();
    let is_held = may_be_held && {
        let fixed = window.fixed.iter().copied().collect();
        map.held_among(gauge, &fixed).len() == window.fixed.len()
    };
    match window.fixed.is_empty() {
        true => None,
        false => Some(if is_held { gauge } else { Gauge::FixedPoses }),
    }
}

/// The problem whose marginal is the information of `keyframe`, which is pose 0, on its neighbors:
/// those that share most landmarks with it, those that a constraint ties to it, and every landmark that
/// it sees. Nothing is held constant: the result is information, not a solution.
#[must_use]
pub fn retirement_problem(map: &Map, keyframe: EntityId) -> MapProblem {
    let mut near: Vec<(EntityId, u32)> = map.covisibility().neighbors(keyframe).collect();
    near.sort_unstable_by_key(|&(id, shared)| (Reverse(shared), id));
    near.truncate(NEIGHBORS);
    let near = near.into_iter().map(|(id, _)| id);
    let neighbors: BTreeSet<EntityId> = near.chain(map.tied(keyframe)).collect();
    let mut builder = Builder::new(map, map.policy().observation_loss);
    builder.keyframe(keyframe, false);
    neighbors.into_iter().for_each(|id| builder.keyframe(id, false));
    let seen = map.keyframes().get(&keyframe).map(|k| &*k.observations).unwrap_or_default();
    let seen: BTreeSet<EntityId> = seen.iter().map(|o| o.landmark).collect();
    seen.into_iter().for_each(|id| builder.landmark(id));
    let mut problem = builder.finish(true);
    problem.problem.constant_poses.fill(false);
    problem
}

struct Builder<'a> {
    map: &'a Map,
    problem: BundleProblem,
    keyframes: Vec<EntityId>,
    landmarks: Vec<EntityId>,
    pose_of: BTreeMap<EntityId, usize>,
    landmark_of: BTreeMap<EntityId, u32>,
    duplicates: Vec<(EntityId, usize)>,
    /// Whether odometry ties poses, and the relative poses that do.
    ties_odometry: bool,
    odometry: Vec<usize>,
    /// Whether deviations count as found instead of as stated.
    believes_residuals: bool,
    /// Whether priors are left out that the estimates do not fit.
    strained_priors_wait: bool,
    /// Whether what depends on estimates counts: which landmarks have one, which observations they do not
    /// fit at all, closures and priors.
    looks_at_estimates: bool,
    /// The gauge that was asked for.
    gauge: Option<Gauge>,
    /// The poses that `gauge` holds in a problem of the whole map.
    held: Vec<usize>,
    /// What the fixed poses of a window are.
    window_frame: Option<Gauge>,
}

impl<'a> Builder<'a> {
    fn new(map: &'a Map, observation_loss: Loss) -> Self {
        let problem = BundleProblem {
            observation_loss,
            relative_pose_loss: map.policy().constraint_loss,
            ..BundleProblem::default()
        };
        Self {
            map,
            problem,
            keyframes: Vec::new(),
            landmarks: Vec::new(),
            pose_of: BTreeMap::new(),
            landmark_of: BTreeMap::new(),
            duplicates: Vec::new(),
            ties_odometry: false,
            odometry: Vec::new(),
            believes_residuals: false,
            strained_priors_wait: false,
            looks_at_estimates: true,
            gauge: None,
            held: Vec::new(),
            window_frame: None,
        }
    }

    fn keyframe(&mut self, id: EntityId, constant: bool) {
        let Some(keyframe) = self.map.keyframes().get(&id) else { return };
        let index = self.problem.push_pose(keyframe.world_from_camera);
        self.problem.constant_poses[index] = constant;
        self.keyframes.push(id);
        self.pose_of.insert(id, index);
    }

    /// Adds a landmark, or joins it with one of its group.
    fn landmark(&mut self, id: EntityId) {
        let group = self.map.duplicates().group(id);
        if let Some(&joined) = group.iter().find_map(|id| self.landmark_of.get(id)) {
            self.landmark_of.insert(id, joined);
            self.duplicates.push((id, joined as usize));
            return;
        }
        let Some(landmark) = self.map.landmarks().get(&id) else { return };
        if landmark.position.is_none() && self.looks_at_estimates {
            return;
        }
        let index = self.problem.push_landmark(landmark.position.unwrap_or_default());
        // The solver's batches index by u32; a map that large does not fit memory.
        if let Ok(index) = u32::try_from(index) {
            self.landmarks.push(id);
            self.landmark_of.insert(id, index);
        }
    }

    /// Holds the first keyframe of each piece that `gauge` wants held.
    fn fix_pieces(&mut self, gauge: Gauge) {
        let mut pieces = DisjointSets::new(self.keyframes.len());
        for id in self.landmark_of.keys() {
            let Some(landmark) = self.map.landmarks().get(id) else { continue };
            for pair in landmark.observers.windows(2) {
                self.join(&mut pieces, pair[0], pair[1]);
            }
        }
        for &(id, joined) in &self.duplicates {
            let first = |id| self.map.landmarks().get(&id)?.observers.first().copied();
            let other = self.landmarks.get(joined).copied().and_then(first);
            if let (Some(a), Some(b)) = (first(id), other) {
                self.join(&mut pieces, a, b);
            }
        }
        for (_, constraint) in self.map.active_constraints() {
            self.join(&mut pieces, constraint.keyframe_i, constraint.keyframe_j);
        }
        for tie in self.odometry_ties() {
            pieces.join(tie.i, tie.j);
        }
        let active =
            self.map.priors().iter().filter(|(id, _)| self.map.active_prior(**id).is_some());
        let placed = active.filter_map(|(_, prior)| self.pose_of.get(&prior.keyframe()).copied());
        let held = held_poses(self.map, gauge, &self.keyframes, pieces, placed);
        held.iter().for_each(|&pose| self.problem.constant_poses[pose] = true);
        self.held = held;
    }

    fn join(&self, pieces: &mut DisjointSets, a: EntityId, b: EntityId) {
        if let (Some(&a), Some(&b)) = (self.pose_of.get(&a), self.pose_of.get(&b)) {
            pieces.join(a, b);
        }
    }

    /// Adds cameras and every factor between the variables so far.
    fn finish(mut self, fix_intrinsics: bool) -> MapProblem {
        let map = self.map;
        let used: BTreeMap<EntityId, _> = self
            .keyframes
            .iter()
            .filter_map(|id| map.keyframes().get(id))
            .flat_map(|keyframe| map.views(keyframe))
            .map(|view| (view.camera_id, view.camera))
            .collect();
        let mut camera_of = BTreeMap::new();
        for (&id, entity) in &used {
            camera_of.insert(id, self.problem.push_camera(entity.camera, fix_intrinsics));
        }
        let mut measured = vec![0; self.keyframes.len()];
        for pose in 0..self.keyframes.len() {
            let Some(keyframe) = map.keyframes().get(&self.keyframes[pose]) else { continue };
            for view in map.views(keyframe) {
                if let Some(&camera) = camera_of.get(&view.camera_id) {
                    measured[pose] += self.observations(&view, pose, camera);
                }
            }
        }
        self.pose_factors(&mut measured);
        self.odometry(&mut measured);
        let mut held = Vec::new();
        for (pose, &count) in measured.iter().enumerate() {
            let constant = &mut self.problem.constant_poses[pose];
            if count < MIN_OBSERVATIONS && !std::mem::replace(constant, true) {
                held.push((self.keyframes[pose], Held::Unmeasured));
            }
        }
        let start_cameras = self.problem.cameras.clone();
        let (whole, positions) = (&self.problem.pose_priors, &self.problem.position_priors);
        let has_priors = !(whole.is_empty() && positions.is_empty());
        let otherwise = if has_priors { Gauge::Priors } else { Gauge::Free };
        // A keyframe alone fixes no frame but its own.
        let holds = self.held.iter().any(|&pose| measured[pose] >= MIN_OBSERVATIONS);
        let frame = self.window_frame.or(self.gauge.filter(|_| holds));
        let clients: BTreeSet<ClientIndex> = self.keyframes.iter().map(|id| id.client).collect();
        let noise: BTreeMap<ClientIndex, Noise> =
            clients.into_iter().filter_map(|c| Some((c, map.client(c)?.noise))).collect();
        if self.believes_residuals {
            let views = noise.values().map(|noise| noise.views);
            self.problem.observation_loss = widened(self.problem.observation_loss, views);
        }
        MapProblem {
            odometry: self.odometry,
            metric_odometry: map.policy().metric_odometry,
            start_noise: noise.clone(),
            noise,
            carried: BTreeSet::new(),
            frame: frame.unwrap_or(otherwise),
            gauge: self.gauge,
            start_poses: self.problem.poses.clone(),
            start_landmarks: self.problem.landmarks.clone(),
            problem: self.problem,
            keyframes: self.keyframes,
            cameras: camera_of.into_keys().collect(),
            start_cameras,
            landmarks: self.landmarks,
            held,
            duplicates: self.duplicates,
            start_revision: map.revision(),
        }
    }

    /// Adds the observations of a view and returns how many there are.
    fn observations(&mut self, view: &View<'_>, pose: usize, camera: usize) -> usize {
        let (Ok(pose), Ok(camera)) = (u32::try_from(pose), u32::try_from(camera)) else { return 0 };
        let model = self.problem.cameras[camera as usize];
        let client = self.keyframes.get(pose as usize).and_then(|id| self.map.client(id.client));
        let noise = client.filter(|_| self.believes_residuals).map(|client| client.noise.views);
        let (pixels, depths) = noise.unwrap_or_default().counted();
        let mut count = 0;
        for observation in view.observations.iter() {
            let Some(&landmark) = self.landmark_of.get(&observation.landmark) else { continue };
            let position = &self.problem.landmarks[landmark as usize];
            let point_in_camera = view.world_from_camera.inverse_transform(position);
            if self.looks_at_estimates && model.project(&point_in_camera).is_none() {
                continue;
            }
            let (pixel, sigma_px) = (observation.pixel, pixels * observation.sigma_px);
            let depth_m =
                observation.depth.map(|Depth { depth_m, sigma_m }| (depth_m, depths * sigma_m));
            let seen = Reprojection { pixel, sigma_px, depth_m };
            self.problem.push_observation(pose, camera, landmark, seen);
            count += 1;
        }
        count
    }

    /// What odometry says of the poses so far. In a problem of the whole map it counts once windows have found
    /// its noise, and where the estimates agree with it: a client whose odometry began anew is there in two
    /// pieces.
    fn odometry_ties(&self) -> Vec<RelativePose<Se3, 6>> {
        if !self.ties_odometry {
            return Vec::new();
        }
        let tie = |(j, &keyframe): (usize, &EntityId)| {
            let tie = self.map.odometry_tie(keyframe)?;
            let is_window = self.gauge.is_none();
            let known = self.map.client(keyframe.client).map(|client| client.noise.odometry);
            known.filter(|noise| is_window || noise.is_found())?;
            let &i = self.pose_of.get(&tie.before)?;
            let (i_from_j, information) = (tie.before_from_keyframe, tie.information);
            let tie = RelativePose { i, j, i_from_j, information, loss: Some(odometry::LOSS) };
            let poses = &self.problem.poses;
            let counts = is_window || odometry::holds(tie.chi2(&poses[i], &poses[j]));
            counts.then_some(tie)
        };
        self.keyframes.iter().enumerate().filter_map(tie).collect()
    }

    /// Ties free poses to those before and after them by odometry.
    fn odometry(&mut self, measured: &mut [usize]) {
        for tie in self.odometry_ties() {
            let constant = &self.problem.constant_poses;
            if constant[tie.i] && constant[tie.j] {
                continue;
            }
            measured[tie.i] += MIN_OBSERVATIONS;
            measured[tie.j] += MIN_OBSERVATIONS;
            self.odometry.push(self.problem.relative_poses.len());
            self.problem.relative_poses.push(tie);
        }
    }

    /// Adds constraints and priors; a pose that one of them ties fully counts as measured.
    fn pose_factors(&mut self, measured: &mut [usize]) {
        let constant = self.problem.constant_poses.clone();
        let free = self.keyframes.iter().zip(&constant).filter(|&(_, &constant)| !constant);
        let ties: BTreeSet<EntityId> =
            free.flat_map(|(&keyframe, _)| self.map.ties().of(keyframe)).collect();
        let active = ties.iter().filter_map(|&id| Some((id, self.map.active_constraint(id)?)));
        for (id, constraint) in active {
            let is_closure = constraint.kind == ConstraintKind::LoopClosure;
            if is_closure && !self.looks_at_estimates {
                continue;
            }
            let sender = self.map.client(id.client).filter(|_| is_closure);
            let variance = sender.map_or(1.0, |sender| sender.closure_variance);
            let i = self.pose_of.get(&constraint.keyframe_i).copied();
            let j = self.pose_of.get(&constraint.keyframe_j).copied();
            let (Some(i), Some(j)) = (i, j) else { continue };
            self.problem.relative_poses.push(RelativePose {
                i,
                j,
                i_from_j: constraint.keyframe_i_from_keyframe_j,
                information: constraint.information.scaled(1.0 / variance),
                loss: constraint.loss,
            });
            measured[i] += MIN_OBSERVATIONS;
            measured[j] += MIN_OBSERVATIONS;
        }
        if !self.looks_at_estimates {
            return;
        }
        for (id, prior) in ties.iter().filter_map(|&id| Some((id, self.map.active_prior(id)?))) {
            let Some(&pose) = self.pose_of.get(&prior.keyframe()) else { continue };
            // What a removed keyframe left is the server's own, and fits.
            let may_wait = self.strained_priors_wait && id.id >= 0;
            let at = self.problem.poses[pose];
            match *prior {
                Prior::Pose { world_from_camera, information, loss, .. } => {
                    let prior = PosePrior { pose, world_from_camera, information, loss };
                    if may_wait && prior.chi2(&at) > default_threshold(6) {
                        continue;
                    }
                    self.problem.pose_priors.push(prior);
                    measured[pose] += MIN_OBSERVATIONS;
                }
                Prior::Position {
                    position_in_world, point_in_camera, information, loss, ..
                } => {
                    let prior = PositionPrior {
                        pose,
                        position_in_world,
                        point_in_camera,
                        information,
                        loss,
                    };
                    if may_wait && prior.chi2(&at) > default_threshold(3) {
                        continue;
                    }
                    self.problem.position_priors.push(prior);
                }
            }
        }
    }
}
