//! The index over the descriptors of one type: same name, same length.
//!
//! Each descriptor is in two tables under 32 of its bits, with 32 others beside it that spare most looks at
//! the descriptor itself. A query votes for keyframes by what its descriptors find, weighted by how few
//! keyframes have it; then it is compared with the best of each island in full. Knows nothing of other types,
//! and checks nothing.

use std::collections::BTreeMap;
use std::ops::Range;

use super::PlaceMatch;
use super::buckets::{Buckets, Entry};
use super::hamming::{self, Kernel, distance};
use super::islands::{Island, islands};
use super::matching::Matching;
use crate::EntityId;

/// Share of different bits up to which two descriptors may be of one point. Two views of a point differ
/// in a tenth to a third of their bits; of two unrelated descriptors of 256 bits one pair in a million is
/// below.
pub(super) const SHARE: f64 = 0.35;
/// Different bits of 32 up to which an entry is looked at: a point whose views differ in a fifth of their
/// bits passes in 98 of 100 cases, one of an unrelated descriptor in 6.
const FINGERPRINT_DISTANCE: u32 = 11;
/// Descriptors of a query that vote, evenly chosen: as many as find a place by a twentieth of them. All
/// take part in the matches. Those of several types are so many together.
pub(super) const VOTERS: usize = 1024;
/// A descriptor to whose fingerprint so many others are near does not vote: it tells no places apart. In
/// maps of all sizes some 70 are near to one.
pub(super) const MOST_NEAR: usize = 4096;
/// Descriptors of one type in a keyframe.
pub const DESCRIPTORS: usize = 1 << FEATURE_BITS;
/// Keyframes of one type.
pub(super) const KEYFRAMES: usize = 1 << (32 - FEATURE_BITS);
const FEATURE_BITS: u32 = 12;

/// A keyframe's descriptors, one behind the other.
#[derive(Clone, Debug)]
pub(super) struct Frame {
    id: EntityId,
    time_ns: i64,
    words: Box<[u64]>,
    /// Of each descriptor: its index in what the caller gave.
    numbers: Box<[u16]>,
}

/// A keyframe that a query found.
pub(super) struct FoundKeyframe {
    pub(super) keyframe: EntityId,
    /// Times of the first and the last keyframe of the island.
    pub(super) time_ns: (i64, i64),
    /// Sum of the weights of the matches, over the smaller number of descriptors.
    pub(super) score: f64,
    pub(super) matches: Vec<PlaceMatch>,
}

/// The index.
#[derive(Clone, Debug)]
pub(super) struct DescriptorIndex {
    words: usize,
    /// Which bits are keys and fingerprints.
    bits: [[u16; 32]; 4],
    largest: u32,
    frames: Vec<Option<Frame>>,
    slots: BTreeMap<EntityId, u32>,
    /// Slots by client, time and id.
    order: Vec<u32>,
    tables: [Buckets; 2],
    /// Memory of the frames.
    held: usize,
}

/// A descriptor that a descriptor of the query found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Hit {
    slot: u32,
    distance: u32,
}

impl DescriptorIndex {
    /// For descriptors of `bytes` bytes.
    pub(super) fn new(bytes: usize) -> Self {
        let bits = bytes * 8;
        // Each of the four groups has bits from the whole length: neighboring bits may be alike.
        let bit = |group: usize, k: usize| ((4 * k + group) * bits / 128) as u16;
        Self {
            words: bytes.div_ceil(8),
            bits: std::array::from_fn(|group| std::array::from_fn(|k| bit(group, k))),
            largest: (SHARE * bits as f64) as u32,
            frames: Vec::new(),
            slots: BTreeMap::new(),
            order: Vec::new(),
            tables: [Buckets::new(), Buckets::new()],
            held: 0,
        }
    }

    pub(super) fn len(&self) -> usize {
        self.slots.len()
    }

    pub(super) fn contains(&self, id: EntityId) -> bool {
        self.slots.contains_key(&id)
    }

    /// Memory, bytes.
    pub(super) fn bytes(&self) -> usize {
        // A node of the ordered map is about two thirds full.
        let slots = self.slots.len() * (size_of::<(EntityId, u32)>() * 3 / 2);
        let lists = self.frames.capacity() * size_of::<Option<Frame>>() + self.order.capacity() * 4;
        let tables: usize = self.tables.iter().map(Buckets::bytes).sum();
        self.held + slots + lists + tables
    }

    /// The descriptors as words; missing bytes of the last word are 0.
    pub(super) fn pack<'a>(&self, data: impl Iterator<Item = &'a [u8]>) -> Box<[u64]> {
        let word = |bytes: &[u8]| {
            let mut word = [0; 8];
            word[..bytes.len()].copy_from_slice(bytes);
            u64::from_le_bytes(word)
        };
        data.flat_map(|descriptor| descriptor.chunks(8).map(word)).collect()
    }

    /// 32 bits of a descriptor: group 0 and 1 are the keys of the two tables, 2 and 3 their fingerprints.
    #[inline(always)]
    fn group(&self, group: usize, descriptor: &[u64]) -> u32 {
        let mut bits = 0;
        for (k, &bit) in self.bits[group].iter().enumerate() {
            bits |= ((descriptor[usize::from(bit >> 6)] >> (bit & 63)) as u32 & 1) << k;
        }
        bits
    }

    /// The descriptor of an entry.
    #[inline(always)]
    fn descriptor(&self, value: u32) -> &[u64] {
        let at = (value as usize % DESCRIPTORS) * self.words;
        let frame = self.frames.get(value as usize / DESCRIPTORS).and_then(Option::as_ref);
        frame.and_then(|frame| frame.words.get(at..at + self.words)).unwrap_or(&[])
    }

    fn key_in_order(&self, slot: u32) -> Option<(u32, i64, EntityId)> {
        let frame = self.frames[slot as usize].as_ref()?;
        Some((frame.id.client.0, frame.time_ns, frame.id))
    }

    /// Adds a keyframe that is not held yet; `words` are its descriptors as [`Self::pack`] makes them.
    pub(super) fn add(
        &mut self,
        id: EntityId,
        time_ns: i64,
        words: Box<[u64]>,
        numbers: Box<[u16]>,
    ) {
        let count = numbers.len();
        let free = (self.frames.len() > self.slots.len())
            .then(|| self.frames.iter().position(Option::is_none))
            .flatten();
        let slot = free.unwrap_or_else(|| {
            self.frames.push(None);
            self.frames.len() - 1
        });
        self.held += size_of_val(&*words) + size_of_val(&*numbers);
        self.frames[slot] = Some(Frame { id, time_ns, words, numbers });
        let slot = slot as u32;
        self.slots.insert(id, slot);
        let key = self.key_in_order(slot);
        let index = self.order.partition_point(|&other| self.key_in_order(other) < key);
        self.order.insert(index, slot);
        let mut tables = std::mem::replace(&mut self.tables, [Buckets::new(), Buckets::new()]);
        for feature in 0..count {
            let value = (slot << FEATURE_BITS) | feature as u32;
            let descriptor = self.descriptor(value);
            for (t, table) in tables.iter_mut().enumerate() {
                let entry = Entry { value, fingerprint: self.group(2 + t, descriptor) };
                let key_of = |entry: Entry| self.group(t, self.descriptor(entry.value));
                table.insert(self.group(t, descriptor), entry, key_of);
            }
        }
        self.tables = tables;
    }

    /// Removes a keyframe; false where there is none.
    pub(super) fn remove(&mut self, id: EntityId) -> bool {
        let Some(slot) = self.slots.get(&id).copied() else { return false };
        let key = self.key_in_order(slot);
        let index = self.order.partition_point(|&other| self.key_in_order(other) < key);
        self.order.remove(index);
        self.slots.remove(&id);
        if let Some(frame) = self.frames[slot as usize].take() {
            for descriptor in frame.words.chunks_exact(self.words) {
                for t in 0..2 {
                    let key = self.group(t, descriptor);
                    self.tables[t].remove(key, |entry| entry.value >> FEATURE_BITS == slot);
                }
            }
            self.held -= size_of_val(&*frame.words) + size_of_val(&*frame.numbers);
        }
        while self.frames.last().is_some_and(Option::is_none) {
            self.frames.pop();
        }
        if self.frames.len() * 4 < self.frames.capacity() {
            self.frames.shrink_to_fit();
            self.order.shrink_to_fit();
        }
        true
    }

    /// For each of `voters` descriptors of `query`: the keyframes that have one like it, by slot, nearest
    /// descriptor each. Keyframes that `excluded` names are passed over. Answers how many descriptors were
    /// compared.
    pub(super) fn hits(
        &self,
        query: &[u64],
        voters: usize,
        excluded: impl Fn(EntityId) -> bool,
        each: impl FnMut(usize, &[Hit]),
    ) -> usize {
        hamming::run(Search { index: self, query, voters, excluded, each })
    }

    /// The `count` best keyframes at most, one of each island, and those of `alike` that are not among
    /// them; `voters` descriptors vote.
    pub(super) fn query(
        &self,
        query: &[u64],
        numbers: &[u16],
        voters: usize,
        count: usize,
        alike: &[EntityId],
        excluded: impl Fn(EntityId) -> bool,
    ) -> Vec<FoundKeyframe> {
        let total = self.len() as f64;
        let mut votes = vec![0.0; self.frames.len()];
        let mut weights = vec![None; numbers.len()];
        self.hits(query, voters, excluded, |descriptor, hits| {
            // What nothing else looks like tells most.
            let weight = (1.0 + total / hits.len().max(1) as f64).ln() / (1.0 + total).ln();
            weights[descriptor] = Some(weight);
            for hit in hits {
                votes[hit.slot as usize] += weight;
            }
        });
        let told = weights.iter().flatten();
        let mean = told.clone().sum::<f64>() / (told.count() as f64).max(1.0);
        let weights: Vec<f64> = weights.into_iter().map(|weight| weight.unwrap_or(mean)).collect();
        let ordered: Vec<f64> = self.order.iter().map(|&slot| votes[slot as usize]).collect();
        let mut found = islands(&ordered, &self.runs(), count);
        for slot in alike.iter().filter_map(|id| self.slots.get(id)) {
            let key = self.key_in_order(*slot);
            let at = self.order.partition_point(|&other| self.key_in_order(other) < key);
            if !found.iter().any(|island| island.best == at) {
                found.push(Island { members: at..at + 1, best: at });
            }
        }
        let found =
            found.iter().filter_map(|island| self.compare(query, numbers, &weights, island));
        found.collect()
    }

    /// The keyframes of each client, as indices in the order of time.
    fn runs(&self) -> Vec<Range<usize>> {
        let client = |slot: u32| self.key_in_order(slot).map(|(client, ..)| client);
        let mut end = 0;
        let run = |run: &[u32]| {
            end += run.len();
            end - run.len()..end
        };
        self.order.chunk_by(|&a, &b| client(a) == client(b)).map(run).collect()
    }

    /// The query against the best keyframe of an island; `None` where nothing matches.
    fn compare(
        &self,
        query: &[u64],
        numbers: &[u16],
        weights: &[f64],
        island: &Island,
    ) -> Option<FoundKeyframe> {
        let frame = |at: usize| self.frames[self.order[at] as usize].as_ref();
        let best = frame(island.best)?;
        let first = frame(island.members.start)?.time_ns;
        let last = frame(island.members.end - 1)?.time_ns;
        let (a, b) = (query, &*best.words);
        let pairs = hamming::run(Matching { a, b, words: self.words, largest: self.largest });
        let smaller = numbers.len().min(best.numbers.len());
        let score = pairs.iter().map(|pair| weights[pair.a]).sum::<f64>() / smaller as f64;
        let named = pairs.iter().map(|pair| PlaceMatch {
            query: usize::from(numbers[pair.a]),
            candidate: usize::from(best.numbers[pair.b]),
            distance: pair.distance,
        });
        (!pairs.is_empty()).then(|| FoundKeyframe {
            keyframe: best.id,
            time_ns: (first, last),
            score,
            matches: named.collect(),
        })
    }
}

/// What `voters` descriptors of a query find.
struct Search<'a, X, F> {
    index: &'a DescriptorIndex,
    query: &'a [u64],
    voters: usize,
    excluded: X,
    each: F,
}

impl<X: Fn(EntityId) -> bool, F: FnMut(usize, &[Hit])> Kernel for Search<'_, X, F> {
    type Output = usize;

    #[inline(always)]
    fn run(mut self) -> usize {
        let held = self.index;
        // Each keyframe is asked for once.
        let mut asked: Vec<Option<bool>> = vec![None; held.frames.len()];
        let mut candidates: Vec<u32> = Vec::new();
        let mut hits: Vec<Hit> = Vec::new();
        let count = self.query.len() / held.words;
        let voters = count.min(self.voters.max(1));
        let mut compared = 0;
        for voter in 0..voters {
            let index = voter * count / voters;
            let descriptor = &self.query[index * held.words..(index + 1) * held.words];
            candidates.clear();
            hits.clear();
            for (t, table) in held.tables.iter().enumerate() {
                let (key, fingerprint) = (held.group(t, descriptor), held.group(2 + t, descriptor));
                table.near(key, fingerprint, FINGERPRINT_DISTANCE, &mut candidates);
            }
            if candidates.len() > MOST_NEAR {
                continue;
            }
            compared += candidates.len();
            for &value in &candidates {
                let slot = value >> FEATURE_BITS;
                let Some(frame) = &held.frames[slot as usize] else { continue };
                let excluded = &self.excluded;
                if *asked[slot as usize].get_or_insert_with(|| excluded(frame.id)) {
                    continue;
                }
                let distance = distance(descriptor, held.descriptor(value));
                if distance <= held.largest {
                    hits.push(Hit { slot, distance });
                }
            }
            hits.sort_unstable();
            hits.dedup_by_key(|hit| hit.slot);
            (self.each)(index, &hits);
        }
        compared
    }
}

#[cfg(test)]
mod tests;
