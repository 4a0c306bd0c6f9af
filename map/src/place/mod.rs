//! Place recognition: which earlier keyframes show the place that a keyframe shows.
//!
//! An index over the binary descriptors of keyframes, without a vocabulary: keyframes are added, removed
//! and asked for, in any order. Descriptors of different types (name and length) are not compared. An answer
//! is a function of the calls so far: no clock, no threads, no random numbers.
//! Decision 0023 has the choice and its figures.
//!
//! Whether a candidate is a loop is not decided here: its matches are where a geometric verification
//! begins. Knows ids of the map and nothing else of it.
//!
//! | file | role |
//! |---|---|
//! | `descriptor_index`, `buckets` | the index of one type of descriptor; its hash tables |
//! | `islands` | keyframes that follow each other in time |
//! | `matching`, `hamming` | the full comparison of two keyframes |
//! | `whole_images` | descriptors of whole images |

mod buckets;
mod descriptor_index;
mod hamming;
mod islands;
mod matching;
#[cfg(test)]
mod tests;
mod whole_images;

use std::collections::BTreeMap;

use thiserror::Error;

use crate::{ClientIndex, EntityId};
use descriptor_index::{DescriptorIndex, KEYFRAMES, VOTERS};
use whole_images::WholeImages;

pub use descriptor_index::DESCRIPTORS;
pub use whole_images::is_image_descriptor;

/// Fewest and most bytes of a binary descriptor: 128 bits are what keys and fingerprints take, and 4096 is
/// eight times what the longest in use have.
pub const DESCRIPTOR_BYTES: std::ops::RangeInclusive<usize> = 16..=512;

/// Bytes of the binary descriptors of a keyframe at most: 4096 of 512 bits. It bounds what a query takes,
/// whatever a client sends.
pub const KEYFRAME_BYTES: usize = 256 << 10;

/// Types of descriptors in one index: name and length. Maps have one or two; each costs memory of its own.
pub const MAX_DESCRIPTOR_TYPES: usize = 16;

/// A binary descriptor of a keyframe.
#[derive(Clone, Copy, Debug)]
pub struct Feature<'a> {
    /// What made it, for instance "orb".
    pub name: &'a str,
    /// The descriptor: a string of bits, compared by Hamming distance.
    pub data: &'a [u8],
}

/// Why a keyframe or a query is refused. Nothing has changed then.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[allow(missing_docs, reason = "the messages say what the fields are")]
pub enum PlaceError {
    /// The keyframe is in the index.
    #[error("keyframe {0} is in the index already")]
    Known(EntityId),
    /// A descriptor is too short or too long.
    #[error("descriptor {number} has {bytes} bytes, not 16 to 512")]
    Length { number: usize, bytes: usize },
    /// The descriptor of a whole image has no direction.
    #[error(
        "the {bytes} bytes of the image's descriptor are not finite 32-bit floats, or all are 0"
    )]
    WholeImage { bytes: usize },
    /// Too many features in one keyframe.
    #[error("{count} descriptors named {name:?} in one keyframe, more than 4096")]
    Descriptors { name: String, count: usize },
    /// Too many features in one keyframe.
    #[error("{0} descriptors in one keyframe, more than 65,536")]
    Features(usize),
    /// Too many bytes in one keyframe.
    #[error("{0} bytes of descriptors in one keyframe, more than 262,144")]
    Bytes(usize),
    /// Too many types of descriptors.
    #[error(
        "descriptors named {name:?} of {bytes} bytes would be the 17th type of descriptor in the index"
    )]
    DescriptorTypes { name: String, bytes: usize },
    /// Too many keyframes.
    #[error(
        "the index holds 1,048,576 keyframes with descriptors named {0:?}, which is all it can"
    )]
    Full(String),
}

/// Two descriptors that are each other's best.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PlaceMatch {
    /// Index among the features of the query.
    pub query: usize,
    /// Index among the features of the candidate, as they were added.
    pub candidate: usize,
    /// Different bits.
    pub distance: u32,
}

/// An island in time: the candidate and its neighbors, which were voted for together.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Island {
    /// The client whose keyframes they are.
    pub client: ClientIndex,
    /// Capture time of the first one, ns.
    pub first_ns: i64,
    /// Capture time of the last one, ns.
    pub last_ns: i64,
}

/// A keyframe that may show the place of the query.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// The keyframe with most votes of its island.
    pub keyframe: EntityId,
    /// Share of the descriptors of query or candidate, whichever has fewer, that match the other; each
    /// counts with ln(N/n)/ln(N), where n of N keyframes were found to have one like it. From 0 to 1.
    pub score: f64,
    /// The matches, by their index in the query.
    pub matches: Vec<PlaceMatch>,
    /// What was voted for together.
    pub island: Island,
}

/// The index over the keyframes of one map.
#[derive(Clone, Debug, Default)]
pub struct PlaceIndex {
    indexes: BTreeMap<(String, usize), DescriptorIndex>,
    whole: WholeImages,
}

/// The features of one type by name and length: their numbers in the list.
type Sorted<'a> = BTreeMap<(&'a str, usize), Vec<u16>>;

fn sorted<'a>(features: &[Feature<'a>]) -> Result<Sorted<'a>, PlaceError> {
    if features.len() > usize::from(u16::MAX) + 1 {
        return Err(PlaceError::Features(features.len()));
    }
    let mut sorted = Sorted::new();
    for (number, feature) in features.iter().enumerate() {
        let bytes = feature.data.len();
        if !DESCRIPTOR_BYTES.contains(&bytes) {
            return Err(PlaceError::Length { number, bytes });
        }
        sorted.entry((feature.name, bytes)).or_default().push(number as u16);
    }
    for ((name, _), numbers) in &sorted {
        if numbers.len() > DESCRIPTORS {
            let (name, count) = ((*name).to_owned(), numbers.len());
            return Err(PlaceError::Descriptors { name, count });
        }
    }
    let bytes = features.iter().map(|feature| feature.data.len()).sum();
    if bytes > KEYFRAME_BYTES {
        return Err(PlaceError::Bytes(bytes));
    }
    Ok(sorted)
}

fn packed(index: &DescriptorIndex, features: &[Feature<'_>], numbers: &[u16]) -> Box<[u64]> {
    index.pack(numbers.iter().map(|&number| features[usize::from(number)].data))
}

impl PlaceIndex {
    /// Whether the keyframe is in the index. One without descriptors never is.
    #[cfg(test)]
    fn contains(&self, keyframe: EntityId) -> bool {
        self.indexes.values().any(|index| index.contains(keyframe)) || self.whole.contains(keyframe)
    }

    /// Name and length in bytes of each type of binary descriptor that the keyframes have, in order.
    pub fn descriptor_types(&self) -> impl Iterator<Item = (&str, usize)> {
        self.indexes.keys().map(|(name, bytes)| (name.as_str(), *bytes))
    }

    /// The same of the descriptors of whole images.
    pub fn image_descriptor_types(&self) -> impl Iterator<Item = (&str, usize)> {
        self.whole.types()
    }

    /// Memory, bytes: descriptors, tables and lists.
    pub fn bytes(&self) -> usize {
        // A node of the ordered map beside what each index holds.
        let bytes = self
            .indexes
            .iter()
            .map(|((name, _), index)| name.len() + size_of::<DescriptorIndex>() + index.bytes());
        bytes.sum::<usize>() + self.whole.bytes()
    }

    /// Adds a keyframe. `capture_time_ns` orders the keyframes of a client; late ones are legal.
    ///
    /// # Errors
    ///
    /// [`PlaceError`], and the index is as it was.
    pub fn add(
        &mut self,
        keyframe: EntityId,
        capture_time_ns: i64,
        features: &[Feature<'_>],
    ) -> Result<(), PlaceError> {
        if self.indexes.values().any(|index| index.contains(keyframe)) {
            return Err(PlaceError::Known(keyframe));
        }
        let sorted = sorted(features)?;
        let mut made = self.indexes.len();
        for &(name, bytes) in sorted.keys() {
            match self.indexes.get(&(name.to_owned(), bytes)) {
                Some(index) if index.len() >= KEYFRAMES => {
                    return Err(PlaceError::Full(name.to_owned()));
                }
                Some(_) => {}
                None => made += 1,
            }
            if made > MAX_DESCRIPTOR_TYPES {
                return Err(PlaceError::DescriptorTypes { name: name.to_owned(), bytes });
            }
        }
        for ((name, bytes), numbers) in sorted {
            let index = self
                .indexes
                .entry((name.to_owned(), bytes))
                .or_insert_with(|| DescriptorIndex::new(bytes));
            let words = packed(index, features, &numbers);
            index.add(keyframe, capture_time_ns, words, numbers.into());
        }
        Ok(())
    }

    /// Adds what the whole image of a keyframe looks like, by little-endian 32-bit floats.
    ///
    /// # Errors
    ///
    /// [`PlaceError::Known`], [`PlaceError::DescriptorTypes`], [`PlaceError::WholeImage`], and the
    /// index is as it was.
    pub fn add_image(
        &mut self,
        keyframe: EntityId,
        capture_time_ns: i64,
        image: &Feature<'_>,
    ) -> Result<(), PlaceError> {
        if self.whole.contains(keyframe) {
            return Err(PlaceError::Known(keyframe));
        }
        self.whole.add(keyframe, capture_time_ns, image)
    }

    /// Removes a keyframe and gives its memory back; false where it is not in the index.
    pub fn remove(&mut self, keyframe: EntityId) -> bool {
        let mut removed = self.whole.remove(keyframe);
        for index in self.indexes.values_mut() {
            removed |= index.remove(keyframe);
        }
        self.indexes.retain(|_, index| index.len() > 0);
        removed
    }

    /// The keyframes that may show what `features` show: at most `count` of each type of descriptor, best
    /// first, equal scores by id. Those that `excluded` names are left out: recent ones, covisible ones, the query's
    /// own. A keyframe that has features of several types is listed once. The keyframes whose image is most
    /// like `image` are compared as well, whatever the features voted for. An image that cannot be compared is
    /// not.
    ///
    /// # Errors
    ///
    /// [`PlaceError`] where the features could not be a keyframe's.
    pub fn query(
        &self,
        features: &[Feature<'_>],
        image: Option<&Feature<'_>>,
        count: usize,
        excluded: impl Fn(EntityId) -> bool,
    ) -> Result<Vec<Candidate>, PlaceError> {
        let mut candidates: BTreeMap<EntityId, Candidate> = BTreeMap::new();
        let alike = image.map(|image| self.whole.nearest(image, count, &excluded));
        let alike = alike.unwrap_or_default();
        for ((name, bytes), numbers) in sorted(features)? {
            let Some(index) = self.indexes.get(&(name.to_owned(), bytes)) else { continue };
            let words = packed(index, features, &numbers);
            // Scores of several types are shares of all features.
            let share = numbers.len() as f64 / features.len() as f64;
            let voters = VOTERS * numbers.len() / features.len();
            for found in index.query(&words, &numbers, voters, count, &alike, &excluded) {
                let (first_ns, last_ns) = found.time_ns;
                let island = Island { client: found.keyframe.client, first_ns, last_ns };
                let keyframe = found.keyframe;
                let empty = || Candidate { keyframe, score: 0.0, matches: Vec::new(), island };
                let candidate = candidates.entry(keyframe).or_insert_with(empty);
                candidate.score += share * found.score;
                candidate.island.first_ns = candidate.island.first_ns.min(first_ns);
                candidate.island.last_ns = candidate.island.last_ns.max(last_ns);
                candidate.matches.extend(found.matches);
            }
        }
        let mut candidates: Vec<Candidate> = candidates.into_values().collect();
        for candidate in &mut candidates {
            candidate.matches.sort_unstable_by_key(|matched| matched.query);
        }
        candidates.sort_unstable_by(|a, b| {
            b.score.total_cmp(&a.score).then_with(|| a.keyframe.cmp(&b.keyframe))
        });
        Ok(candidates)
    }
}
