//! A small vertex separator by the multilevel scheme (Karypis and Kumar, "A fast and high quality
//! multilevel scheme for partitioning irregular graphs", 1998).
//!
//! Vertices are matched along heavy edges and merged until few are left; there, regions grown from
//! several seeds give a first cut; on the way back each level's cut is refined. Ties go to the lower
//! index, so the same graph always gives the same cut. It cuts a graph once; recursion is in
//! `dissection`.

use super::graph::{Graph, Level};
use super::refinement::{Cut, SEPARATOR};
use crate::interrupt::Interrupt;
use crate::lists::Lists;

/// Merging ends at so many vertices, or when a level is hardly smaller than the last.
const COARSEST: usize = 60;
const LEAST_SHRINKAGE: f64 = 0.9;

/// Seeds from which regions are grown.
const SEEDS: usize = 8;

impl Level {
    /// The next coarser level, and which of its vertices each vertex went into.
    fn coarsened(&self) -> (Self, Vec<u32>) {
        let count = self.graph.count();
        let mate = self.matching();
        let mut coarse_of = vec![u32::MAX; count];
        let mut first_of = Vec::with_capacity(count);
        for v in 0..count {
            if coarse_of[v] == u32::MAX {
                coarse_of[v] = first_of.len() as u32;
                coarse_of[mate[v] as usize] = first_of.len() as u32;
                first_of.push(v as u32);
            }
        }
        let mut graph = Graph { starts: vec![0], items: Vec::new() };
        let (mut weights, mut edge_weights) = (Vec::new(), Vec::new());
        // Where each neighbor of the vertex at hand stands in its list.
        let mut index_in_list = vec![usize::MAX; first_of.len()];
        for (k, &v) in first_of.iter().enumerate() {
            let begin = graph.items.len();
            let mut weight = 0;
            let pair = [v, mate[v as usize]];
            let members = if pair[0] == pair[1] { &pair[..1] } else { &pair[..] };
            for &member in members {
                weight += self.weights[member as usize];
                for at in self.graph.range(member as usize) {
                    let to = coarse_of[self.graph.items[at] as usize];
                    if to as usize == k {
                        continue;
                    }
                    let slot = &mut index_in_list[to as usize];
                    // Positions from earlier lists do not count.
                    if *slot == usize::MAX || *slot < begin {
                        *slot = graph.items.len();
                        graph.items.push(to);
                        edge_weights.push(0);
                    }
                    edge_weights[*slot] += self.edge_weights[at];
                }
            }
            weights.push(weight);
            graph.starts.push(graph.items.len());
        }
        (Self { graph, weights, edge_weights }, coarse_of)
    }

    /// For each vertex the one that it is merged with, itself where there is none: along the
    /// heaviest edge, then the lightest neighbor; vertices of few neighbors choose first.
    fn matching(&self) -> Vec<u32> {
        let count = self.graph.count();
        let total: u32 = self.weights.iter().sum();
        // Heavier ones would leave nothing to balance with.
        let heaviest = total / COARSEST as u32 * 2 + 2;
        let mut mate: Vec<u32> = vec![u32::MAX; count];
        for v in by_degree(&self.graph) {
            let v = v as usize;
            if mate[v] != u32::MAX {
                continue;
            }
            let mut best: Option<(u32, u32, u32)> = None;
            for at in self.graph.range(v) {
                let w = self.graph.items[at];
                let weight = self.weights[w as usize];
                if mate[w as usize] != u32::MAX || weight + self.weights[v] > heaviest {
                    continue;
                }
                let candidate = (self.edge_weights[at], u32::MAX - weight, u32::MAX - w);
                best = Some(best.map_or(candidate, |best| best.max(candidate)));
            }
            let w = best.map_or(v as u32, |(_, _, w)| u32::MAX - w);
            mate[v] = w;
            mate[w as usize] = v as u32;
        }
        mate
    }
}

/// Vertices by ascending degree, then index.
fn by_degree(graph: &Graph) -> Vec<u32> {
    let degree = |v: u32| graph.of(v as usize).len().min(63);
    Lists::new(64, (0..graph.count() as u32).map(|v| (degree(v), v))).items
}

/// The side of each vertex: 0, 1 or [`SEPARATOR`]. A side may be empty. `None` once `interrupt` is due.
pub(super) fn separate(finest: &Level, interrupt: &Interrupt) -> Option<Vec<u8>> {
    let mut coarser: Vec<(Level, Vec<u32>)> = Vec::new();
    loop {
        let level = coarser.last().map_or(finest, |(level, _)| level);
        let count = level.graph.count();
        if count <= COARSEST {
            break;
        }
        if interrupt.is_due() {
            return None;
        }
        let (next, coarse_of) = level.coarsened();
        let stalls = next.graph.count() as f64 > LEAST_SHRINKAGE * count as f64;
        if next.graph.count() < count {
            coarser.push((next, coarse_of));
        }
        if stalls {
            break;
        }
    }
    let coarsest = coarser.last().map_or(finest, |(level, _)| level);
    let mut sides = first_cut(coarsest);
    while let Some((_, coarse_of)) = coarser.pop() {
        if interrupt.is_due() {
            return None;
        }
        let level = coarser.last().map_or(finest, |(level, _)| level);
        let projected = coarse_of.iter().map(|&k| sides[k as usize]).collect();
        let mut cut = Cut::new(level, projected);
        cut.refine();
        sides = cut.sides;
    }
    Some(sides)
}

/// The best refined cut around regions grown from a few seeds.
fn first_cut(level: &Level) -> Vec<u8> {
    let count = level.graph.count();
    let mut best: Option<Cut<'_>> = None;
    for seed in 0..SEEDS.min(count) {
        let mut cut = Cut::new(level, grown(level, seed * count / SEEDS.min(count)));
        cut.refine();
        if best.as_ref().is_none_or(|best| cut.score() < best.score()) {
            best = Some(cut);
        }
    }
    best.map_or_else(Vec::new, |cut| cut.sides)
}

/// Side 0 is grown around `seed` to half of the weight; what it touches separates.
fn grown(level: &Level, seed: usize) -> Vec<u8> {
    let count = level.graph.count();
    let total = level.weights.iter().map(|&weight| u64::from(weight)).sum::<u64>();
    let mut sides = vec![1u8; count];
    let mut reached = vec![false; count];
    let mut queue = Vec::with_capacity(count);
    let (mut next, mut start, mut weight) = (0, 0, 0);
    while 2 * weight < total {
        if next == queue.len() {
            // The piece is used up: on with the seed at first, then with the lowest vertex left.
            let found =
                if queue.is_empty() { Some(seed) } else { (start..count).find(|&v| !reached[v]) };
            let Some(v) = found else { break };
            if !queue.is_empty() {
                start = v;
            }
            reached[v] = true;
            queue.push(v as u32);
        }
        let v = queue[next] as usize;
        next += 1;
        sides[v] = 0;
        weight += u64::from(level.weights[v]);
        for &w in level.graph.of(v) {
            if !reached[w as usize] {
                reached[w as usize] = true;
                queue.push(w);
            }
        }
    }
    for &v in &queue[next..] {
        sides[v as usize] = SEPARATOR;
    }
    sides
}
