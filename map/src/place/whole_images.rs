//! Descriptors of whole images (NetVLAD and its kin): the keyframes whose image is most like a query's.
//!
//! Every keyframe is compared: the cosine with each of 17,500 of 256 numbers takes 0.6 ms, less than what an
//! approximate search saves where the best of each place is wanted. Knows nothing of features.

use std::collections::BTreeMap;
use std::sync::Arc;

use super::islands::REACH;
use super::{Feature, MAX_DESCRIPTOR_TYPES, PlaceError};
use crate::EntityId;

/// What described an image: a name and how many numbers it gives.
type Kind = (Arc<str>, usize);

/// A keyframe's image.
#[derive(Clone, Debug)]
struct Image {
    time_ns: i64,
    id: EntityId,
    /// Of length 1.
    direction: Box<[f32]>,
}

/// The images of a map.
#[derive(Clone, Debug, Default)]
pub(super) struct WholeImages {
    /// Each list by client, then time.
    kinds: BTreeMap<Kind, Vec<Image>>,
    /// The list of each keyframe's image, and its time there.
    kept: BTreeMap<EntityId, (Kind, i64)>,
}

/// Where the image of a keyframe stands in a list, or where it belongs.
fn index(images: &[Image], id: EntityId, time_ns: i64) -> usize {
    let order = (id.client, time_ns, id);
    images.partition_point(|other| (other.id.client, other.time_ns, other.id) < order)
}

/// The direction of a descriptor of little-endian 32-bit floats.
fn direction(descriptor: &Feature<'_>) -> Result<Box<[f32]>, PlaceError> {
    let bytes = descriptor.data;
    let (words, rest) = bytes.as_chunks();
    let numbers: Vec<f32> = words.iter().map(|&word| f32::from_le_bytes(word)).collect();
    let largest = numbers.iter().fold(0.0_f32, |largest, number| largest.max(number.abs()));
    // The squares of what is scaled by the largest neither overflow nor vanish.
    let squares: f32 = numbers.iter().map(|number| (number / largest).powi(2)).sum();
    let norm = largest * squares.sqrt();
    let is_possible = rest.is_empty()
        && numbers.iter().all(|number| number.is_finite())
        && norm.is_finite()
        && norm > 0.0;
    if is_possible {
        Ok(numbers.iter().map(|number| number / norm).collect())
    } else {
        Err(PlaceError::WholeImage { bytes: bytes.len() })
    }
}

/// Whether the data of a descriptor of 32-bit floats can be compared: they have a direction.
#[must_use]
pub fn is_image_descriptor(data: &[u8]) -> bool {
    direction(&Feature { name: "", data }).is_ok()
}

/// A fixed order of sums, which vector registers can hold.
fn cosine(a: &[f32], b: &[f32]) -> f32 {
    const LANES: usize = 16;
    let mut sums = [0.0_f32; LANES];
    let (a_parts, b_parts) = (a.chunks_exact(LANES), b.chunks_exact(LANES));
    let rest: f32 = a_parts.remainder().iter().zip(b_parts.remainder()).map(|(a, b)| a * b).sum();
    for (a, b) in a_parts.zip(b_parts) {
        for lane in 0..LANES {
            sums[lane] += a[lane] * b[lane];
        }
    }
    rest + sums.iter().sum::<f32>()
}

impl WholeImages {
    /// Adds the image of a keyframe that has none here.
    pub(super) fn add(
        &mut self,
        id: EntityId,
        time_ns: i64,
        descriptor: &Feature<'_>,
    ) -> Result<(), PlaceError> {
        let image = Image { time_ns, id, direction: direction(descriptor)? };
        let kind = (Arc::from(descriptor.name), image.direction.len());
        let kind = match self.kinds.get_key_value(&kind) {
            Some((known, _)) => known.clone(),
            None if self.kinds.len() < MAX_DESCRIPTOR_TYPES => kind,
            None => {
                let (name, bytes) = (descriptor.name.to_owned(), descriptor.data.len());
                return Err(PlaceError::DescriptorTypes { name, bytes });
            }
        };
        let images = self.kinds.entry(kind.clone()).or_default();
        images.insert(index(images, id, time_ns), image);
        self.kept.insert(id, (kind, time_ns));
        Ok(())
    }

    /// Removes the image of a keyframe; false where there is none.
    pub(super) fn remove(&mut self, id: EntityId) -> bool {
        let Some((kind, time_ns)) = self.kept.remove(&id) else { return false };
        if let Some(images) = self.kinds.get_mut(&kind) {
            let index = index(images, id, time_ns);
            if images.get(index).is_some_and(|image| image.id == id) {
                images.remove(index);
            }
            if images.is_empty() {
                self.kinds.remove(&kind);
            }
        }
        true
    }

    pub(super) fn contains(&self, id: EntityId) -> bool {
        self.kept.contains_key(&id)
    }

    /// Name and length in bytes of each type, in order.
    pub(super) fn types(&self) -> impl Iterator<Item = (&str, usize)> {
        self.kinds.keys().map(|(name, numbers)| (&**name, 4 * numbers))
    }

    /// Memory, bytes.
    pub(super) fn bytes(&self) -> usize {
        let of = |((name, length), images): (&Kind, &Vec<Image>)| {
            name.len() + images.capacity() * size_of::<Image>() + images.len() * 4 * length
        };
        let kept = self.kept.len() * size_of::<(EntityId, (Kind, i64))>();
        self.kinds.iter().map(of).sum::<usize>() + kept
    }

    /// The keyframes most like the query: the best ones, none within the reach in time of a better one,
    /// none that is `excluded`. Empty where the query is no descriptor.
    pub(super) fn nearest(
        &self,
        query: &Feature<'_>,
        count: usize,
        excluded: impl Fn(EntityId) -> bool,
    ) -> Vec<EntityId> {
        let Ok(query_direction) = direction(query) else { return Vec::new() };
        let kind = (Arc::from(query.name), query_direction.len());
        let Some(images) = self.kinds.get(&kind) else { return Vec::new() };
        let likeness = |image: &Image| match excluded(image.id) {
            true => f32::NEG_INFINITY,
            false => cosine(&query_direction, &image.direction),
        };
        let mut likeness: Vec<f32> = images.iter().map(likeness).collect();
        let mut nearest = Vec::new();
        while nearest.len() < count {
            let best = likeness.iter().enumerate().max_by(|a, b| {
                // The first of equal ones.
                a.1.total_cmp(b.1).then_with(|| b.0.cmp(&a.0))
            });
            let Some((at, &found)) = best else { break };
            if found <= 0.0 {
                break;
            }
            nearest.push(images[at].id);
            let around = at.saturating_sub(REACH)..(at + REACH + 1).min(images.len());
            for near in around.filter(|&near| images[near].id.client == images[at].id.client) {
                likeness[near] = f32::NEG_INFINITY;
            }
        }
        nearest
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ClientIndex;

    fn bytes(numbers: &[f32]) -> Vec<u8> {
        numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
    }

    fn id(id: i64) -> EntityId {
        EntityId::new(ClientIndex(0), id)
    }

    #[test]
    fn the_most_alike_of_each_place_is_found() {
        let mut images = WholeImages::default();
        // Forty places in a row; the directions turn by 4 degrees from one to the next.
        let turned = |degrees: f32| {
            let angle = degrees.to_radians();
            bytes(&[1e30 * angle.cos(), 1e30 * angle.sin(), 0.0])
        };
        let at = |k: i64| turned(4.0 * k as f32);
        for k in (0..40).rev() {
            images.add(id(k), k, &Feature { name: "vlad", data: &at(k) }).unwrap();
        }
        let data = turned(79.0);
        let query = Feature { name: "vlad", data: &data };
        assert_eq!(images.nearest(&query, 2, |_| false), [id(20), id(14)]);
        assert_eq!(images.nearest(&query, 1, |other| other == id(20)), [id(19)]);
        // Of another type or length nothing is known.
        assert_eq!(images.nearest(&Feature { name: "gem", ..query }, 2, |_| false), []);
        assert_eq!(images.nearest(&Feature { data: &data[4..], ..query }, 2, |_| false), []);
        assert!(images.remove(id(20)) && !images.remove(id(20)) && !images.contains(id(20)));
        assert_eq!(images.nearest(&query, 1, |_| false), [id(19)]);
        assert_eq!((0..40).filter(|&k| images.remove(id(k))).count(), 39);
        assert_eq!(images.bytes(), 0);
    }

    #[test]
    fn a_seventeenth_kind_of_descriptors_is_refused_by_name() {
        let mut images = WholeImages::default();
        let data = bytes(&[1.0, 0.0]);
        let names: Vec<String> =
            (0..=MAX_DESCRIPTOR_TYPES).map(|kind| format!("net-{kind}")).collect();
        for (k, name) in (0..).zip(&names[..MAX_DESCRIPTOR_TYPES]) {
            images.add(id(k), k, &Feature { name, data: &data }).unwrap();
        }
        let name = &names[MAX_DESCRIPTOR_TYPES];
        let refused = images.add(id(99), 99, &Feature { name, data: &data });
        assert_eq!(refused, Err(PlaceError::DescriptorTypes { name: name.clone(), bytes: 8 }));
        assert!(!images.contains(id(99)));
        // One of a known kind has room, and so has the new one once another kind is gone.
        images.add(id(98), 0, &Feature { name: &names[3], data: &data }).unwrap();
        assert!(images.remove(id(0)));
        images.add(id(99), 99, &Feature { name, data: &data }).unwrap();
    }

    #[test]
    fn what_has_no_direction_is_refused() {
        let mut images = WholeImages::default();
        let cases: [&[u8]; 5] =
            [&[], &bytes(&[0.0; 4]), &bytes(&[f32::NAN]), &bytes(&[f32::INFINITY, 1.0]), &[1; 6]];
        for data in cases {
            let error = images.add(id(1), 0, &Feature { name: "vlad", data }).unwrap_err();
            assert_eq!(error, PlaceError::WholeImage { bytes: data.len() });
        }
        images
            .add(id(1), 0, &Feature { name: "vlad", data: &bytes(&[f32::MIN_POSITIVE]) })
            .unwrap();
    }

    #[test]
    fn the_order_of_a_sum_does_not_depend_on_where_it_runs() {
        let a: Vec<f32> = (0..67).map(|k| (k as f32 * 0.37).sin()).collect();
        let exact: f64 = a.iter().map(|&a| f64::from(a) * f64::from(a)).sum();
        assert!((f64::from(cosine(&a, &a)) - exact).abs() < 1e-5);
    }
}
