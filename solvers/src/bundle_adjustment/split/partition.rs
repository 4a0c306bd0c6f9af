//! Which poses, cameras, landmarks and factors each section of a problem has.
//!
//! Vertices are the diagonal blocks of the reduced system, edges join what sees a common landmark,
//! weighted by how many (covisibility). The graph is cut into parts by small separators; every landmark
//! that moves is then seen from one part and separators only, and goes, with its observations, to that
//! part's section. What is seen from separators alone goes to a section that has them already. It looks
//! at which indices occur together, at no value.

use crate::interrupt::Interrupt;
use crate::linear::ordering::{SEPARATE, parts};
use crate::lists::Lists;
use crate::problem::{BundleProblem, Observation};

use super::super::layout::{Blocks, NO_BLOCK, number_views};

/// Tracks over more blocks than this are not joined pair by pair: each block is joined with some that
/// follow. A landmark that is then seen from two parts makes the smaller side separate too.
const LONG_TRACK: usize = 64;
const JOINED_IN_LONG: usize = 32;

/// A camera of its own block that more than this share of all blocks depend on separates from the
/// first: every part needs it.
const SHARED_BY_MANY: f64 = 0.25;

/// Edges that are collected before duplicates are joined.
const COLLECTED: usize = 1 << 22;

/// What a section has, by index in the whole problem, ascending.
#[derive(Clone, Debug, Default)]
pub struct Members {
    /// Poses.
    pub poses: Vec<u32>,
    /// Cameras.
    pub cameras: Vec<u32>,
    /// Landmarks.
    pub landmarks: Vec<u32>,
    /// Observations: plain ones first, then those with depth.
    pub observations: Vec<u32>,
    /// Relative-pose factors.
    pub relative_poses: Vec<u32>,
    /// Priors on poses.
    pub pose_priors: Vec<u32>,
    /// Priors on positions.
    pub position_priors: Vec<u32>,
}

impl Members {
    fn is_empty(&self) -> bool {
        self.observations.is_empty()
            && self.relative_poses.is_empty()
            && self.pose_priors.is_empty()
            && self.position_priors.is_empty()
    }
}

/// A problem in sections.
#[derive(Debug)]
pub(super) struct Partition {
    pub(super) sections: Vec<Members>,
    pub(super) blocks: Blocks,
    /// Whether each block separates.
    pub(super) is_separator: Vec<bool>,
}

/// Factors that must be in one section, since what they tie together is eliminated there.
struct Unit {
    kind: Kind,
    /// Free blocks, ascending, each once.
    blocks: Vec<u32>,
}

#[derive(Clone, Copy)]
enum Kind {
    /// A landmark that moves, with its observations.
    Track {
        landmark: u32,
        length: u32,
    },
    /// An observation of a constant landmark.
    Observation(u32),
    RelativePose(u32),
    PosePrior(u32),
    PositionPrior(u32),
}

impl Partition {
    /// Cuts a valid `problem` into at most `wanted` sections. `None` once `interrupt` is due.
    pub(super) fn new(
        problem: &BundleProblem,
        wanted: usize,
        interrupt: &Interrupt,
    ) -> Option<Self> {
        let (views, _) = number_views(problem);
        let blocks = Blocks::new(problem, &views, &[]);
        let of_landmark = problem.observations().zip(0..).map(|(o, k)| (o.landmark as usize, k));
        let tracks = Lists::new(problem.landmarks.len(), of_landmark);
        let units = Units { problem, blocks: &blocks, tracks: &tracks };
        let part = units.cut(wanted, interrupt)?;
        let count = part.iter().filter(|&&p| p != SEPARATE).max().map_or(0, |&p| p as usize + 1);
        let count = if blocks.sizes.is_empty() { wanted.max(1) } else { count.max(1) };
        let mut dealer = Dealer::new(&part, count);
        let mut home = Vec::new();
        units.each(|unit| {
            home.push(dealer.inside(&unit).unwrap_or(SEPARATE));
        });
        // Separators are known to sections now.
        let mut next = 0;
        units.each(|unit| {
            if home[next] == SEPARATE {
                home[next] = dealer.outside(&unit, units.landmark_count());
            }
            next += 1;
        });
        let mut sections = vec![Members::default(); count];
        let mut next = 0;
        units.each(|unit| {
            units.give(&unit, &mut sections[home[next] as usize]);
            next += 1;
        });
        sections.retain(|section| !section.is_empty());
        let is_separator = part.iter().map(|&p| p == SEPARATE).collect();
        let mut found = Self { sections, blocks, is_separator };
        found.complete(problem);
        Some(found)
    }

    /// Adds the variables that the factors of each section touch.
    fn complete(&mut self, problem: &BundleProblem) {
        for section in &mut self.sections {
            section.observations.sort_unstable();
            for &k in &section.observations {
                let Observation { pose, camera, landmark, .. } = problem.observation(k as usize);
                section.poses.push(pose);
                section.cameras.push(camera);
                section.landmarks.push(landmark);
            }
            for &k in &section.relative_poses {
                let factor = &problem.relative_poses[k as usize];
                section.poses.extend([factor.i as u32, factor.j as u32]);
            }
            let priors = section.pose_priors.iter().map(|&k| problem.pose_priors[k as usize].pose);
            section.poses.extend(priors.map(|pose| pose as u32));
            let positions = section.position_priors.iter();
            let positions = positions.map(|&k| problem.position_priors[k as usize].pose);
            section.poses.extend(positions.map(|pose| pose as u32));
            for list in [&mut section.poses, &mut section.cameras, &mut section.landmarks] {
                list.sort_unstable();
                list.dedup();
                list.shrink_to_fit();
            }
        }
    }
}

struct Units<'a> {
    problem: &'a BundleProblem,
    blocks: &'a Blocks,
    /// The observations of each landmark.
    tracks: &'a Lists<u32>,
}

impl Units<'_> {
    fn landmark_count(&self) -> usize {
        self.problem.landmarks.len()
    }

    /// Shows every unit, always in the same order.
    fn each(&self, mut show: impl FnMut(Unit)) {
        let problem = self.problem;
        let mut blocks = Vec::new();
        let of_observation = |k: u32, blocks: &mut Vec<u32>| {
            let Observation { pose, camera, .. } = problem.observation(k as usize);
            let camera_block = self.blocks.of_camera[camera as usize].0;
            blocks.extend([self.blocks.of_pose[pose as usize], camera_block]);
        };
        let mut tell = |kind: Kind, blocks: &mut Vec<u32>| {
            blocks.retain(|&block| block != NO_BLOCK);
            blocks.sort_unstable();
            blocks.dedup();
            show(Unit { kind, blocks: std::mem::take(blocks) });
        };
        for landmark in 0..self.landmark_count() {
            let track = self.tracks.of(landmark);
            if problem.constant_landmarks[landmark] {
                for &k in track {
                    of_observation(k, &mut blocks);
                    tell(Kind::Observation(k), &mut blocks);
                }
            } else if !track.is_empty() {
                track.iter().for_each(|&k| of_observation(k, &mut blocks));
                let (landmark, length) = (landmark as u32, track.len() as u32);
                tell(Kind::Track { landmark, length }, &mut blocks);
            }
        }
        let of_pose = |pose: usize| self.blocks.of_pose[pose];
        for (k, factor) in problem.relative_poses.iter().enumerate() {
            blocks.extend([of_pose(factor.i), of_pose(factor.j)]);
            tell(Kind::RelativePose(k as u32), &mut blocks);
        }
        for (k, factor) in problem.pose_priors.iter().enumerate() {
            blocks.push(of_pose(factor.pose));
            tell(Kind::PosePrior(k as u32), &mut blocks);
        }
        for (k, factor) in problem.position_priors.iter().enumerate() {
            blocks.push(of_pose(factor.pose));
            tell(Kind::PositionPrior(k as u32), &mut blocks);
        }
    }

    /// The part of each block, or [`SEPARATE`].
    fn cut(&self, wanted: usize, interrupt: &Interrupt) -> Option<Vec<u32>> {
        let count = self.blocks.sizes.len();
        let mut edges = Edges::default();
        self.each(|unit| {
            let blocks = &unit.blocks;
            let reach = if blocks.len() > LONG_TRACK { JOINED_IN_LONG } else { blocks.len() };
            for (i, &a) in blocks.iter().enumerate() {
                blocks[i + 1..].iter().take(reach).for_each(|&b| edges.push(b, a));
            }
        });
        let mut edges = edges.finish();
        if interrupt.is_due() {
            return None;
        }
        let mut degrees = vec![0_u32; count];
        for &(later, earlier, _) in &edges {
            degrees[later as usize] += 1;
            degrees[earlier as usize] += 1;
        }
        let many = SHARED_BY_MANY * count as f64;
        let mut is_shared = vec![false; count];
        for &(block, column) in &self.blocks.of_camera {
            if block != NO_BLOCK && column == 0 && f64::from(degrees[block as usize]) > many {
                is_shared[block as usize] = true;
            }
        }
        edges.retain(|&(a, b, _)| !is_shared[a as usize] && !is_shared[b as usize]);
        let mut part = parts(count, &edges, wanted, interrupt)?;
        for (part, &is_shared) in part.iter_mut().zip(&is_shared) {
            if is_shared {
                *part = SEPARATE;
            }
        }
        // Only long tracks can still be seen from two parts.
        self.each(|unit| {
            let inside =
                || unit.blocks.iter().map(|&b| part[b as usize]).filter(|&p| p != SEPARATE);
            let Some(first) = inside().next() else { return };
            if inside().all(|p| p == first) {
                return;
            }
            let mut found: Vec<u32> = inside().collect();
            found.sort_unstable();
            let size = |p: u32| found.iter().filter(|&&q| q == p).count();
            let kept = found.iter().copied().max_by_key(|&p| (size(p), u32::MAX - p));
            for &block in &unit.blocks {
                if Some(part[block as usize]) != kept {
                    part[block as usize] = SEPARATE;
                }
            }
        });
        renumber(&mut part);
        Some(part)
    }

    /// Puts the factors of a unit into a section.
    fn give(&self, unit: &Unit, section: &mut Members) {
        match unit.kind {
            Kind::Track { landmark, .. } => {
                section.observations.extend(self.tracks.of(landmark as usize));
            }
            Kind::Observation(k) => section.observations.push(k),
            Kind::RelativePose(k) => section.relative_poses.push(k),
            Kind::PosePrior(k) => section.pose_priors.push(k),
            Kind::PositionPrior(k) => section.position_priors.push(k),
        }
    }
}

/// Numbers the parts that have blocks from 0 on without gaps.
fn renumber(part: &mut [u32]) {
    let mut found: Vec<u32> = part.iter().copied().filter(|&p| p != SEPARATE).collect();
    found.sort_unstable();
    found.dedup();
    for p in part.iter_mut() {
        if let Ok(number) = found.binary_search(p) {
            *p = number as u32;
        }
    }
}

/// Pairs of blocks with how often they occur.
#[derive(Default)]
struct Edges {
    /// Ascending: later, earlier, weight.
    joined: Vec<(u32, u32, u32)>,
    new: Vec<(u32, u32)>,
}

impl Edges {
    fn push(&mut self, later: u32, earlier: u32) {
        self.new.push((later, earlier));
        if self.new.len() >= COLLECTED {
            self.join();
        }
    }

    fn join(&mut self) {
        self.new.sort_unstable();
        let new = std::mem::take(&mut self.new);
        let mut all = std::mem::take(&mut self.joined);
        all.extend(new.into_iter().map(|(later, earlier)| (later, earlier, 1)));
        // Two sorted runs: this sort finds and merges them.
        all.sort_by_key(|&(later, earlier, _)| (later, earlier));
        all.dedup_by(|next, kept| {
            let is_same = (next.0, next.1) == (kept.0, kept.1);
            if is_same {
                kept.2 = kept.2.saturating_add(next.2);
            }
            is_same
        });
        self.joined = all;
    }

    fn finish(mut self) -> Vec<(u32, u32, u32)> {
        self.join();
        self.joined
    }
}

/// Deals units to sections.
struct Dealer<'a> {
    part: &'a [u32],
    /// Observations of each section so far.
    loads: Vec<usize>,
    /// Sections that each block of a separator is in.
    known_to: Vec<Vec<u32>>,
}

impl<'a> Dealer<'a> {
    fn new(part: &'a [u32], count: usize) -> Self {
        Self { part, loads: vec![0; count], known_to: vec![Vec::new(); part.len()] }
    }

    /// The section of a unit that touches a block inside of one.
    fn inside(&mut self, unit: &Unit) -> Option<u32> {
        let parts = unit.blocks.iter().map(|&block| self.part[block as usize]);
        let section = parts.into_iter().find(|&part| part != SEPARATE)?;
        self.add(unit, section);
        Some(section)
    }

    /// The section of a unit that touches separators at most: of those that know all of them, or else
    /// most of them, the one with the least to do. What touches no free block is spread by landmark.
    fn outside(&mut self, unit: &Unit, landmarks: usize) -> u32 {
        let count = self.loads.len();
        let mut best = (0, usize::MAX, 0);
        if unit.blocks.is_empty() {
            let at = match unit.kind {
                Kind::Track { landmark, .. } => landmark as usize,
                // Nothing of it moves.
                Kind::Observation(_)
                | Kind::RelativePose(_)
                | Kind::PosePrior(_)
                | Kind::PositionPrior(_) => 0,
            };
            best.2 = (at * count / landmarks.max(1)).min(count - 1) as u32;
        } else {
            let mut candidates: Vec<u32> = Vec::new();
            for &block in &unit.blocks {
                candidates.extend(&self.known_to[block as usize]);
            }
            candidates.sort_unstable();
            candidates.dedup();
            for section in candidates {
                let knows = |&&block: &&u32| self.known_to[block as usize].contains(&section);
                let known = unit.blocks.iter().filter(knows).count();
                let load = self.loads[section as usize];
                if known > best.0 || (known == best.0 && load < best.1) {
                    best = (known, load, section);
                }
            }
        }
        self.add(unit, best.2);
        best.2
    }

    fn add(&mut self, unit: &Unit, section: u32) {
        self.loads[section as usize] += match unit.kind {
            Kind::Track { length, .. } => length as usize,
            Kind::Observation(_)
            | Kind::RelativePose(_)
            | Kind::PosePrior(_)
            | Kind::PositionPrior(_) => 1,
        };
        for &block in &unit.blocks {
            let known_to = &mut self.known_to[block as usize];
            if self.part[block as usize] == SEPARATE && !known_to.contains(&section) {
                known_to.push(section);
            }
        }
    }
}
