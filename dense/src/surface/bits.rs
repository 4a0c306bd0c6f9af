//! Sign and visibility of voxels as bits: the cells that a surface crosses are found without distances.
//!
//! A block has 512 bits: bit x + 8 y of word z. A field is a block with a border of one voxel of its
//! neighbors, 10³ voxels: bit x + 10 y of plane z, where the block's own begin at (1, 1, 1).
//! Independent of triangles.

use super::super::block::{Block, EDGE, LEAST_WEIGHT, VOXELS};

/// A voxel next to a surface lies within √3 voxels of it, less than this where the truncation is three
/// voxels or more. A farther voxel, next to one of the other sign, lies at a silhouette, between free
/// and hidden space: there is no surface between them.
const STEEP: i16 = i16::MAX / 4 * 3;

/// Voxels along an edge of a field.
pub(super) const SIDE: usize = EDGE + 2;

/// One bit per voxel of a block.
pub(super) type BlockBits = [u64; EDGE];

/// The bits of a block, which are used before its distances are read.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Bits {
    /// Behind the surface: negative distance, seen enough.
    pub(super) inside: BlockBits,
    /// Seen enough, and near enough to a surface.
    pub(super) seen: BlockBits,
}

impl Bits {
    /// The bits of a block.
    pub(super) fn of(block: &Block) -> Self {
        // One byte per voxel, all ones or all zeros, so that the compiler vectorizes these loops.
        let mut seen = [0_u8; VOXELS];
        let voxels = block.weights.iter().zip(&block.distances);
        for (byte, (&weight, &distance)) in seen.iter_mut().zip(voxels) {
            let is_near = (distance < STEEP) & (distance > -STEEP);
            *byte = u8::from((weight >= LEAST_WEIGHT) & is_near).wrapping_neg();
        }
        let mut inside = [0_u8; VOXELS];
        for (byte, &distance) in inside.iter_mut().zip(&block.distances) {
            *byte = u8::from(distance < 0).wrapping_neg();
        }
        let (inside, seen) = (low_bits(&inside), low_bits(&seen));
        Self { inside: std::array::from_fn(|z| inside[z] & seen[z]), seen }
    }

    /// The voxels at which it differs from another.
    pub(super) fn difference(&self, other: &Self) -> BlockBits {
        std::array::from_fn(|z| (self.inside[z] ^ other.inside[z]) | (self.seen[z] ^ other.seen[z]))
    }

    /// Which sides of the surface it has: bit 0 for voxels in front, bit 1 for voxels behind.
    pub(super) fn sides(&self) -> u8 {
        let front = self.seen.iter().zip(&self.inside).any(|(seen, inside)| seen & !inside != 0);
        let behind = self.inside.iter().any(|&inside| inside != 0);
        u8::from(front) | u8::from(behind) << 1
    }
}

/// The lowest bit of each byte.
fn low_bits(bytes: &[u8; VOXELS]) -> BlockBits {
    let mut bits = [0; EDGE];
    for (word, slab) in bits.iter_mut().zip(bytes.as_chunks::<{ EDGE * EDGE }>().0) {
        for (y, row) in slab.as_chunks::<EDGE>().0.iter().enumerate() {
            let firsts = u64::from_le_bytes(*row) & 0x0101_0101_0101_0101;
            *word |= first_of_bytes(firsts) << (EDGE * y);
        }
    }
    bits
}

/// The lowest bits of eight bytes, whose others are zero, as one byte.
pub(super) fn first_of_bytes(word: u64) -> u64 {
    // The product moves bit 8 y to 56 + y.
    word.wrapping_mul(0x0102_0408_1020_4080) >> 56
}

/// Which of the 27 blocks around (order as in [`FieldBits::of`]) lie beside a voxel whose bit is one;
/// the block itself where any bit is.
pub(super) fn borders(bits: &BlockBits) -> u32 {
    const ROWS: [u64; 3] = [0xff, u64::MAX, 0xff << 56];
    const COLUMNS: [u64; 3] = [0x0101_0101_0101_0101, u64::MAX, 0x8080_8080_8080_8080];
    let any = bits.iter().fold(0, |any, word| any | word);
    let mut beside = 0;
    for (z, word) in [bits[0], any, bits[EDGE - 1]].into_iter().enumerate() {
        for (y, rows) in ROWS.into_iter().enumerate() {
            for (x, columns) in COLUMNS.into_iter().enumerate() {
                beside |= u32::from(word & rows & columns != 0) << (x + 3 * y + 9 * z);
            }
        }
    }
    beside
}

/// One bit per voxel of a block and of the voxels around it.
pub(super) type Field = [u128; SIDE];

/// Sign and visibility of a field.
#[derive(Clone, Copy, Debug)]
pub(super) struct FieldBits {
    pub(super) inside: Field,
    pub(super) seen: Field,
}

impl FieldBits {
    /// The field of a block's 27 neighbors, itself in the middle: neighbor (x, y, z) in -1..=1 is at
    /// (x + 1) + 3 (y + 1) + 9 (z + 1).
    pub(super) fn of(around: &[Option<&Bits>; 27]) -> Self {
        let word = |neighbor: usize, z: usize| {
            around[neighbor].map_or((0, 0), |bits| (bits.inside[z], bits.seen[z]))
        };
        let mut field = Self { inside: [0; SIDE], seen: [0; SIDE] };
        for z in 0..SIDE {
            let (layer, z_in_block) = split(z);
            let mut inside = [0; 9];
            let mut seen = [0; 9];
            for k in 0..9 {
                (inside[k], seen[k]) = word(9 * layer + k, z_in_block);
            }
            field.inside[z] = plane(&inside);
            field.seen[z] = plane(&seen);
        }
        field
    }
}

/// A coordinate of a field as that of a neighbor, 0 to 2, and of a voxel in it.
pub(super) fn split(coordinate: usize) -> (usize, usize) {
    let shifted = coordinate + EDGE - 1;
    (shifted / EDGE, shifted % EDGE)
}

/// A plane of a field from the slabs of nine blocks.
fn plane(slabs: &[u64; 9]) -> u128 {
    let lowest = strip(slabs[0] >> 56, slabs[1] >> 56, slabs[2] >> 56) & 0x3ff;
    let highest = strip(slabs[6], slabs[7], slabs[8]) & 0x3ff;
    let lower = strip(slabs[3], slabs[4], slabs[5]);
    let upper = strip(slabs[3] >> 32, slabs[4] >> 32, slabs[5] >> 32);
    u128::from(lowest)
        | u128::from(lower) << 10
        | u128::from(upper) << 50
        | u128::from(highest) << 90
}

/// Four rows of ten bits from the lower four rows of a block and those to its left and right.
fn strip(left: u64, middle: u64, right: u64) -> u64 {
    const FIRST: u64 = 0x0101_0101;
    spread(left >> 7 & FIRST) | spread(middle & 0xffff_ffff) << 1 | spread(right & FIRST) << 9
}

/// Four rows of eight bits to a distance of ten.
fn spread(rows: u64) -> u64 {
    let pairs = (rows & 0xffff) | (rows & 0xffff_0000) << 4;
    (pairs & 0x0ff0_00ff) | (pairs & 0xf_f000_ff00) << 2
}

/// The block's own voxels of a plane of a field, with a distance of eight again.
pub(super) fn own(plane: u128) -> u64 {
    let first = plane >> (SIDE + 1);
    gather(first as u64) | gather((first >> (4 * SIDE)) as u64) << 32
}

/// Four rows of eight bits that have a distance of ten, as [`spread`] makes it, to one of eight.
fn gather(rows: u64) -> u64 {
    let pairs = (rows & 0x0ff0_00ff) | rows >> 2 & 0xf_f000_ff00;
    (pairs & 0xffff) | pairs >> 4 & 0xffff_0000
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(seed: usize) -> u64 {
        (seed as u64 + 1)
            .wrapping_mul(0x9e37_79b9_7f4a_7c15)
            .rotate_left(29)
            .wrapping_mul(0xbf58_476d_1ce4_e5b9)
    }

    #[test]
    fn bits_are_those_of_the_voxels() {
        let mut block = Block::EMPTY;
        for i in 0..VOXELS {
            block.distances[i] = noise(i) as i16;
            block.weights[i] = (noise(i + VOXELS) % 7) as u16;
        }
        let bits = Bits::of(&block);
        for i in 0..VOXELS {
            let (z, bit) = (i / 64, i % 64);
            let is_near = i32::from(block.distances[i]).abs() < i32::from(STEEP);
            let is_seen = block.weights[i] >= 3 && is_near;
            assert_eq!(bits.seen[z] >> bit & 1 == 1, is_seen, "voxel {i}");
            assert_eq!(bits.inside[z] >> bit & 1 == 1, is_seen && block.distances[i] < 0);
        }
    }

    #[test]
    fn a_field_has_the_neighbors_voxels_around() {
        let blocks: Vec<Bits> = (0..27)
            .map(|k| Bits {
                inside: std::array::from_fn(|z| noise(100 * k + z)),
                seen: std::array::from_fn(|z| noise(100 * k + z + 50)),
            })
            .collect();
        for missing in 0..27 {
            let around: [_; 27] = std::array::from_fn(|k| (k != missing).then_some(&blocks[k]));
            let field = FieldBits::of(&around);
            for (x, y, z) in (0..1000).map(|i| (i % 10, i / 10 % 10, i / 100)) {
                let ((i, u), (j, v), (k, w)) = (split(x), split(y), split(z));
                let bit = |bits: &BlockBits| bits[w] >> (u + 8 * v) & 1 == 1;
                let expected = around[i + 3 * j + 9 * k].map(|b| (bit(&b.inside), bit(&b.seen)));
                let at = |field: &Field| field[z] >> (x + 10 * y) & 1 == 1;
                let found = (at(&field.inside), at(&field.seen));
                assert_eq!(found, expected.unwrap_or_default(), "({x}, {y}, {z})");
            }
            assert_eq!(
                std::array::from_fn::<_, 8, _>(|z| own(field.seen[z + 1])),
                if missing == 13 { [0; 8] } else { blocks[13].seen }
            );
        }
    }
}
