//! Observations and landmarks in the order in which the kernels read them.
//!
//! Landmarks are sorted by the first view that sees them and observations within a landmark by view,
//! so that neighbors touch the same views. The order is cut into *chunks*, which threads take, and
//! those into *tiles*, which stay in the first-level cache. Chunks depend on the problem only, never
//! on the number of threads, and so do all sums. No residual is evaluated here.

use std::ops::Range;

use crate::parallel;
use crate::problem::BundleProblem;
use crate::simd::WIDTH;

/// Most chunks.
const MAX_CHUNKS: usize = 32;

/// Fewest observations worth a chunk.
const MIN_CHUNK_OBSERVATIONS: usize = 8192;

/// Landmarks of a tile are handled eight at a time, so many times at most.
pub(super) const GROUPS: usize = 2;

/// Most observations of a tile, unless one landmark has more.
const TILE_OBSERVATIONS: usize = 96;

/// Padding of the arrays, so that eight observations can be read from any index.
const PADDING: usize = WIDTH;

/// A run of landmarks that one task handles.
#[derive(Clone, Debug)]
pub(super) struct Chunk {
    /// Sorted positions of its landmarks.
    pub(super) landmarks: Range<usize>,
    pub(super) observations: Range<usize>,
    pub(super) tiles: Range<usize>,
    /// The views that it meets; their numbers within the chunk are the indices here.
    pub(super) views: Vec<u32>,
}

/// A run of landmarks whose Jacobians are in the cache together: at most 8·[`GROUPS`].
#[derive(Clone, Debug)]
pub(super) struct Tile {
    /// Sorted positions of its landmarks.
    pub(super) landmarks: Range<usize>,
    pub(super) observations: Range<usize>,
}

/// The observations, sorted by landmark and view, padded by eight.
#[derive(Debug, Default)]
pub(super) struct Sorted {
    pub(super) views: Vec<u32>,
    /// Number of the view within the chunk.
    pub(super) locals: Vec<u32>,
    /// Sorted position of the landmark.
    pub(super) positions: Vec<u32>,
    pub(super) u: Vec<f64>,
    pub(super) v: Vec<f64>,
    /// 1/σ_px.
    pub(super) weights: Vec<f64>,
    /// Measured depths; empty where no observation has one.
    pub(super) depths: Vec<f64>,
    /// 1/σ_d; 0 where an observation has no depth; empty where none has.
    pub(super) depth_weights: Vec<f64>,
    /// Problem index of the landmark at each sorted position; landmarks without observations are left
    /// out.
    pub(super) order: Vec<u32>,
    /// Whether it is held fixed.
    pub(super) constant: Vec<bool>,
    /// Observations `starts[k]..starts[k + 1]` see the landmark at sorted position k.
    starts: Vec<u32>,
    /// First landmark of each tile, and the end.
    tile_starts: Vec<u32>,
    pub(super) chunks: Vec<Chunk>,
    /// Most observations of a tile.
    pub(super) longest_tile: usize,
    /// The longest track.
    pub(super) longest_track: usize,
    /// Pairs of observations of one landmark, over all landmarks that move.
    pub(super) pair_count: usize,
}

/// The part of a chunk in every array that is filled in parallel.
struct Fill<'a> {
    chunk: &'a mut Chunk,
    /// Indices of observations in the problem: plain ones first, then those with depth.
    sources: &'a mut [u32],
    views: &'a mut [u32],
    locals: &'a mut [u32],
    positions: &'a mut [u32],
    u: &'a mut [f64],
    v: &'a mut [f64],
    weights: &'a mut [f64],
    depths: &'a mut [f64],
    depth_weights: &'a mut [f64],
}

impl Sorted {
    /// Sorts the observations of `problem`; observation k is seen from view `view_of[k]`.
    pub(super) fn new(problem: &BundleProblem, view_of: &[u32], view_count: usize) -> Self {
        let mut sorted = Self::default();
        let sources = sorted.order_landmarks(problem, view_of, view_count);
        sorted.cut();
        sorted.fill(problem, view_of, view_count, sources);
        sorted
    }

    /// The sorted observations of the landmark at sorted position `k`.
    pub(super) fn track(&self, k: usize) -> Range<usize> {
        self.starts[k] as usize..self.starts[k + 1] as usize
    }

    /// Tile `t`.
    pub(super) fn tile(&self, t: usize) -> Tile {
        let landmarks = self.tile_starts[t] as usize..self.tile_starts[t + 1] as usize;
        let begin = self.starts[landmarks.start] as usize;
        Tile { observations: begin..self.starts[landmarks.end] as usize, landmarks }
    }

    /// Number of tiles.
    pub(super) fn tile_count(&self) -> usize {
        self.tile_starts.len() - 1
    }

    /// Number of observations.
    pub(super) fn observation_count(&self) -> usize {
        self.views.len() - PADDING
    }

    /// Orders landmarks by first view; returns the observations' indices by landmark.
    fn order_landmarks(
        &mut self,
        problem: &BundleProblem,
        view_of: &[u32],
        view_count: usize,
    ) -> Vec<u32> {
        let plain = &problem.reprojections.landmarks;
        let depth = &problem.depth_reprojections.landmarks;
        let landmarks = || plain.iter().chain(depth).map(|&l| l as usize);
        let count = problem.landmarks.len();
        let mut first_view = vec![u32::MAX; count];
        let mut lengths = vec![0_u32; count];
        for (l, &view) in landmarks().zip(view_of) {
            first_view[l] = view.min(first_view[l]);
            lengths[l] += 1;
        }
        self.order = counting_sort(&first_view, view_count);
        self.constant =
            self.order.iter().map(|&l| problem.constant_landmarks[l as usize]).collect();
        self.starts = Vec::with_capacity(self.order.len() + 1);
        let mut start = 0;
        self.starts.push(0);
        // From here on `first_view` is the index of the landmark's next observation.
        for (&l, &constant) in self.order.iter().zip(&self.constant) {
            let length = lengths[l as usize];
            first_view[l as usize] = start;
            start += length;
            self.starts.push(start);
            self.longest_track = self.longest_track.max(length as usize);
            if !constant {
                self.pair_count += length as usize * (length as usize - 1) / 2;
            }
        }
        let mut sources = vec![0; view_of.len()];
        for (k, l) in landmarks().enumerate() {
            let next = &mut first_view[l];
            sources[*next as usize] = k as u32;
            *next += 1;
        }
        sources
    }

    /// Cuts the order into chunks and tiles.
    fn cut(&mut self) {
        let landmarks = self.order.len();
        let total = self.starts[landmarks] as usize;
        let count = (total / MIN_CHUNK_OBSERVATIONS).clamp(1, MAX_CHUNKS);
        let mut begin = 0;
        for chunk in 1..=count {
            let target = (total * chunk / count) as u32;
            let end = if chunk == count {
                landmarks
            } else {
                self.starts.partition_point(|&s| s < target).clamp(begin, landmarks)
            };
            let observations = self.starts[begin] as usize..self.starts[end] as usize;
            let first_tile = self.tile_starts.len();
            let mut first = begin;
            while first < end {
                let mut last = first + 1;
                let limit = self.starts[first] as usize + TILE_OBSERVATIONS;
                while last < end
                    && last - first < GROUPS * WIDTH
                    && self.starts[last + 1] as usize <= limit
                {
                    last += 1;
                }
                let length = (self.starts[last] - self.starts[first]) as usize;
                self.longest_tile = self.longest_tile.max(length);
                self.tile_starts.push(first as u32);
                first = last;
            }
            let tiles = first_tile..self.tile_starts.len();
            self.chunks.push(Chunk {
                landmarks: begin..end,
                observations,
                tiles,
                views: Vec::new(),
            });
            begin = end;
        }
        self.tile_starts.push(landmarks as u32);
    }

    /// Copies the observations into their order, chunk by chunk on all threads.
    fn fill(
        &mut self,
        problem: &BundleProblem,
        view_of: &[u32],
        view_count: usize,
        mut sources: Vec<u32>,
    ) {
        let total = sources.len();
        let room = total + PADDING;
        let depth_room = if problem.depth_reprojections.is_empty() { 0 } else { room };
        for indices in [&mut self.views, &mut self.locals, &mut self.positions] {
            *indices = vec![0; room];
        }
        for values in [&mut self.u, &mut self.v, &mut self.weights] {
            *values = vec![0.0; room];
        }
        for values in [&mut self.depths, &mut self.depth_weights] {
            *values = vec![0.0; depth_room];
        }
        let mut chunks = std::mem::take(&mut self.chunks);
        let lengths: Vec<usize> = chunks.iter().map(|c| c.observations.len()).collect();
        let depth_lengths = || lengths.iter().map(|&n| if depth_room == 0 { 0 } else { n });
        let plain_lengths = || lengths.iter().copied();
        let mut views = split(&mut self.views, plain_lengths()).into_iter();
        let mut locals = split(&mut self.locals, plain_lengths()).into_iter();
        let mut positions = split(&mut self.positions, plain_lengths()).into_iter();
        let mut u = split(&mut self.u, plain_lengths()).into_iter();
        let mut v = split(&mut self.v, plain_lengths()).into_iter();
        let mut weights = split(&mut self.weights, plain_lengths()).into_iter();
        let mut depths = split(&mut self.depths, depth_lengths()).into_iter();
        let mut depth_weights = split(&mut self.depth_weights, depth_lengths()).into_iter();
        let mut pieces = split(&mut sources, plain_lengths()).into_iter();
        let mut fills = Vec::with_capacity(chunks.len());
        for chunk in &mut chunks {
            fills.push(Fill {
                chunk,
                sources: pieces.next().unwrap_or_default(),
                views: views.next().unwrap_or_default(),
                locals: locals.next().unwrap_or_default(),
                positions: positions.next().unwrap_or_default(),
                u: u.next().unwrap_or_default(),
                v: v.next().unwrap_or_default(),
                weights: weights.next().unwrap_or_default(),
                depths: depths.next().unwrap_or_default(),
                depth_weights: depth_weights.next().unwrap_or_default(),
            });
        }
        let starts = &self.starts;
        parallel::for_each(fills.into_iter(), |fill| {
            fill.run(problem, view_of, view_count, starts);
        });
        self.chunks = chunks;
        self.pad(total);
    }

    /// Repeats the last observation, so that padding lanes compute something finite.
    fn pad(&mut self, total: usize) {
        let Some(last) = total.checked_sub(1) else { return };
        for indices in [&mut self.views, &mut self.locals, &mut self.positions] {
            let value = indices[last];
            indices[total..].fill(value);
        }
        let values = [
            &mut self.u,
            &mut self.v,
            &mut self.weights,
            &mut self.depths,
            &mut self.depth_weights,
        ];
        for values in values {
            if let Some(&value) = values.get(last) {
                values[total..].fill(value);
            }
        }
    }
}

impl Fill<'_> {
    fn run(self, problem: &BundleProblem, view_of: &[u32], view_count: usize, starts: &[u32]) {
        let (plain, depth) = (&problem.reprojections, &problem.depth_reprojections);
        let base = self.chunk.observations.start;
        let mut local_of = vec![u32::MAX; view_count];
        for position in self.chunk.landmarks.clone() {
            let track = starts[position] as usize - base..starts[position + 1] as usize - base;
            self.positions[track.clone()].fill(position as u32);
            let sources = &mut self.sources[track.clone()];
            // Two observations of one view keep the problem's order.
            sources.sort_unstable_by_key(|&k| (view_of[k as usize], k));
            for (o, &k) in track.zip(sources.iter()) {
                let k = k as usize;
                let view = view_of[k];
                let local = &mut local_of[view as usize];
                if *local == u32::MAX {
                    *local = self.chunk.views.len() as u32;
                    self.chunk.views.push(view);
                }
                (self.views[o], self.locals[o]) = (view, *local);
                let (pixel, sigma) = match k.checked_sub(plain.len()) {
                    None => (plain.pixels[k], plain.sigmas_px[k]),
                    Some(k) => {
                        self.depths[o] = depth.depths_m[k];
                        self.depth_weights[o] = 1.0 / depth.sigmas_depth_m[k];
                        (depth.pixels[k], depth.sigmas_px[k])
                    }
                };
                (self.u[o], self.v[o]) = (pixel.x, pixel.y);
                self.weights[o] = 1.0 / sigma;
            }
        }
    }
}

/// Cuts `values` into consecutive pieces of the given lengths.
pub(super) fn split<T>(
    mut values: &mut [T],
    lengths: impl Iterator<Item = usize>,
) -> Vec<&mut [T]> {
    let mut pieces = Vec::new();
    for length in lengths {
        let (head, tail) = values.split_at_mut(length);
        pieces.push(head);
        values = tail;
    }
    pieces
}

/// The indices of keys below `limit`, in stable order of the keys.
fn counting_sort(keys: &[u32], limit: usize) -> Vec<u32> {
    let mut next = vec![0_u32; limit + 1];
    for &key in keys {
        if let Some(count) = next.get_mut(key as usize + 1) {
            *count += 1;
        }
    }
    for k in 0..limit {
        next[k + 1] += next[k];
    }
    let mut order = vec![0; next[limit] as usize];
    for (k, &key) in keys.iter().enumerate() {
        if (key as usize) < limit {
            let slot = &mut next[key as usize];
            order[*slot as usize] = k as u32;
            *slot += 1;
        }
    }
    order
}
