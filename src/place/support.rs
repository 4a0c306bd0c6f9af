//! Temporal consistency: a place is believed when queries that follow each other find it.
//!
//! A robot that is back where it was stays there for some keyframes, and each of them finds the same
//! island or the one beside it; a false candidate is found once. One value for each stream of queries.
//! Knows nothing of descriptors and decides nothing.

use super::{Candidate, Island};

/// Queries that an island stays in mind without being found again: one may see too little.
const PATIENCE: u32 = 1;

/// What the last queries of one client found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Support {
    islands: Vec<Remembered>,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Remembered {
    island: Island,
    support: u32,
    missed: u32,
}

/// Whether two islands overlap in time or border on each other: the time between them is at most the
/// length of the shorter one.
fn meet(a: &Island, b: &Island) -> bool {
    // Times are clients' numbers: differences may not fit.
    let length = |island: &Island| island.last_ns.saturating_sub(island.first_ns).max(0);
    let slack = length(a).min(length(b));
    a.client == b.client
        && a.first_ns <= b.last_ns.saturating_add(slack)
        && b.first_ns <= a.last_ns.saturating_add(slack)
}

impl Support {
    /// Takes what the next query of the client found, and tells for each candidate how many queries in a
    /// row, this one included, have found its island or one beside it.
    ///
    /// After a restart the queries of the last keyframes bring it back.
    pub fn of(&mut self, candidates: &[Candidate]) -> Vec<u32> {
        let support: Vec<u32> = candidates
            .iter()
            .map(|candidate| {
                let met = self.islands.iter().filter(|old| meet(&old.island, &candidate.island));
                met.map(|old| old.support).max().unwrap_or(0).saturating_add(1)
            })
            .collect();
        self.islands.retain_mut(|old| {
            old.missed += 1;
            let found = candidates.iter().any(|candidate| meet(&old.island, &candidate.island));
            !found && old.missed <= PATIENCE
        });
        for (candidate, &support) in candidates.iter().zip(&support) {
            let island = candidate.island;
            self.islands.push(Remembered { island, support, missed: 0 });
        }
        support
    }
}
