//! Block structure of a symmetric matrix: its lower triangle with diagonal, by block row.
//!
//! Block (i, j), j ≤ i, has sizes\[i\] rows and sizes\[j\] columns. Blocks are numbered by rows,
//! columns ascending within a row, so the diagonal block ends its row. The pattern also says where
//! each block's values begin, so that every matrix on one pattern has one layout.
//! It holds no values and knows no ordering other than the caller's.

use std::ops::Range;

use crate::lists::Lists;

/// Pairs kept before the first removal of duplicates while a pattern is being built.
const COMPACTION_START: usize = 1 << 20;

/// Which blocks of a symmetric block matrix are stored.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockPattern {
    /// Rows of each block row.
    sizes: Vec<usize>,
    /// First scalar of each block, and the dimension at the end.
    offsets: Vec<usize>,
    /// Block columns of the blocks of each block row.
    rows: Lists<u32>,
    /// First value of each block, and the number of values at the end.
    value_starts: Vec<usize>,
}

impl BlockPattern {
    /// The pattern of the given block `sizes` with the blocks named by `pairs`.
    ///
    /// Pairs come in any order, repeated, from either triangle; the diagonal is always stored.
    /// A pair that names a block out of range is a mistake of the caller: debug builds assert,
    /// release builds leave it out, and looking the block up later answers `None`.
    pub fn new(sizes: Vec<usize>, pairs: impl IntoIterator<Item = (usize, usize)>) -> Self {
        let count = sizes.len();
        let mut keys: Vec<u64> = (0..count as u64).map(|i| i << 32 | i).collect();
        let mut limit = COMPACTION_START.max(2 * count);
        for (a, b) in pairs {
            debug_assert!(a < count && b < count, "block ({a}, {b}) of {count} blocks");
            if a < count && b < count && a != b {
                keys.push((a.max(b) as u64) << 32 | a.min(b) as u64);
                if keys.len() >= limit {
                    keys.sort_unstable();
                    keys.dedup();
                    limit = COMPACTION_START.max(2 * keys.len());
                }
            }
        }
        keys.sort_unstable();
        keys.dedup();
        let mut starts = vec![0; count + 1];
        keys.iter().for_each(|key| starts[(key >> 32) as usize + 1] += 1);
        for i in 0..count {
            starts[i + 1] += starts[i];
        }
        let items = keys.iter().map(|key| (key & 0xffff_ffff) as u32).collect();
        Self::assemble(sizes, Lists { starts, items })
    }

    /// The pattern that stores every block of the lower triangle.
    pub fn full(sizes: Vec<usize>) -> Self {
        let starts = (0..=sizes.len()).map(|i| i * (i + 1) / 2).collect();
        let items = (0..sizes.len() as u32).flat_map(|i| 0..=i).collect();
        Self::assemble(sizes, Lists { starts, items })
    }

    fn assemble(sizes: Vec<usize>, rows: Lists<u32>) -> Self {
        let mut offsets = Vec::with_capacity(sizes.len() + 1);
        offsets.push(0);
        let mut value_starts = Vec::with_capacity(rows.items.len() + 1);
        value_starts.push(0);
        let (mut offset, mut start) = (0, 0);
        for (i, &size) in sizes.iter().enumerate() {
            offset += size;
            offsets.push(offset);
            for &j in rows.of(i) {
                start += size * sizes[j as usize];
                value_starts.push(start);
            }
        }
        Self { sizes, offsets, rows, value_starts }
    }

    /// Bytes that building it took: the stored blocks, and their keys while they are collected.
    pub fn bytes(&self) -> u64 {
        (self.rows.items.len() * (4 + 8 + 24) + self.sizes.len() * 32) as u64
    }

    /// Number of block rows (and columns).
    pub fn block_count(&self) -> usize {
        self.sizes.len()
    }

    /// Rows of each block row.
    pub fn sizes(&self) -> &[usize] {
        &self.sizes
    }

    /// First scalar row of block `i`; for `i == block_count()` the dimension.
    pub fn offset(&self, i: usize) -> usize {
        self.offsets[i]
    }

    /// Number of scalar rows.
    pub fn dimension(&self) -> usize {
        self.offsets[self.sizes.len()]
    }

    /// Columns j ≤ i of the blocks stored in block row `i`, ascending; the last is `i`.
    pub fn row(&self, i: usize) -> &[u32] {
        self.rows.of(i)
    }

    /// Numbers of the blocks stored in block row `i`, in the order of [`Self::row`].
    pub fn row_range(&self, i: usize) -> Range<usize> {
        self.rows.range(i)
    }

    /// Number of stored blocks, diagonal included.
    pub fn stored_block_count(&self) -> usize {
        self.rows.items.len()
    }

    /// Number of stored scalars, diagonal blocks in full.
    pub fn value_count(&self) -> usize {
        self.value_starts[self.rows.items.len()]
    }

    /// Number of block (i, j), or `None` where it is not stored or lies above the diagonal.
    pub fn find(&self, i: usize, j: usize) -> Option<usize> {
        if i >= self.block_count() || j > i {
            return None;
        }
        let k = self.row(i).binary_search(&(j as u32)).ok()?;
        Some(self.rows.starts[i] + k)
    }

    /// Where the values of stored block number `block` lie in a matrix's value array.
    pub fn value_range(&self, block: usize) -> Range<usize> {
        self.value_starts[block]..self.value_starts[block + 1]
    }

    /// First value of each stored block, and the number of values at the end.
    pub(crate) fn value_starts(&self) -> &[usize] {
        &self.value_starts
    }

    /// The block that scalar row `scalar` belongs to.
    pub(crate) fn block_of(&self, scalar: usize) -> usize {
        self.offsets.partition_point(|&offset| offset <= scalar).saturating_sub(1)
    }

    /// Stored blocks over all blocks of the lower triangle, in 0..=1; 1 for an empty matrix.
    pub fn density(&self) -> f64 {
        let count = self.block_count();
        if count == 0 {
            return 1.0;
        }
        self.rows.items.len() as f64 / (count as f64 * (count as f64 + 1.0) / 2.0)
    }
}
