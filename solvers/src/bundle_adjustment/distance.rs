//! How far apart views are: how many landmarks lie between the two that are farthest from each other.
//!
//! A product with the reduced system carries what a view knows to the views that share a landmark with it,
//! and no farther. So conjugate gradients need as many products as there are such hops, about, before an
//! error at one end is seen at the other. It reads indices, no values.

use super::layout::Layout;

/// The longest shortest way between two views, in landmarks, as two sweeps find it: from any view to the
/// farthest, and from there. Exact on chains, a lower bound elsewhere; the largest of all components.
pub(super) fn longest_way(layout: &Layout) -> usize {
    let sorted = &layout.sorted;
    let count = layout.views.len();
    // Tracks of each view.
    let mut starts = vec![0_u32; count + 1];
    // The kernels' list is padded: only tracks have what was observed.
    let landmarks = 0..sorted.constant.len();
    let pairs = || landmarks.clone().flat_map(|k| sorted.track(k).map(move |o| (k, o)));
    for (_, o) in pairs() {
        starts[sorted.views[o] as usize + 1] += 1;
    }
    for view in 0..count {
        starts[view + 1] += starts[view];
    }
    let mut next = starts.clone();
    let mut tracks = vec![0_u32; sorted.observation_count()];
    for (k, o) in pairs() {
        let at = &mut next[sorted.views[o] as usize];
        tracks[*at as usize] = k as u32;
        *at += 1;
    }
    let (seen, used) = (vec![0; count], vec![0; sorted.constant.len()]);
    let mut search = Search { layout, starts, tracks, seen, used, sweep: 0 };
    let mut longest = 0;
    for view in 0..count {
        // A view of a component that was searched is marked.
        if search.seen[view] == 0 && layout.active[view] {
            let (farthest, _) = search.sweep(view);
            longest = longest.max(search.sweep(farthest).1);
        }
    }
    longest
}

/// Breadth-first searches, each of which marks what it reaches with its number.
struct Search<'a> {
    layout: &'a Layout,
    /// First of each view's tracks.
    starts: Vec<u32>,
    tracks: Vec<u32>,
    seen: Vec<u32>,
    used: Vec<u32>,
    sweep: u32,
}

impl Search<'_> {
    /// The last view that is reached from `view`, and in how many hops.
    fn sweep(&mut self, view: usize) -> (usize, usize) {
        self.sweep += 1;
        let sorted = &self.layout.sorted;
        let mut level = vec![view];
        let (mut farthest, mut hops) = (view, 0);
        self.seen[view] = self.sweep;
        loop {
            let mut following = Vec::new();
            for &view in &level {
                let range = self.starts[view] as usize..self.starts[view + 1] as usize;
                for &track in &self.tracks[range] {
                    let track = track as usize;
                    if sorted.constant[track] || self.used[track] == self.sweep {
                        continue;
                    }
                    self.used[track] = self.sweep;
                    for o in sorted.track(track) {
                        let other = sorted.views[o] as usize;
                        if self.layout.active[other] && self.seen[other] != self.sweep {
                            self.seen[other] = self.sweep;
                            following.push(other);
                        }
                    }
                }
            }
            match following.last() {
                None => return (farthest, hops),
                Some(&last) => (farthest, hops, level) = (last, hops + 1, following),
            }
        }
    }
}
