//! A hash table that grows and shrinks a bucket at a time (linear hashing, Litwin 1980), whose keys are
//! bits of a descriptor.
//!
//! The lowest L or L+1 bits of a key are its bucket, so that a key with one different bit is found in
//! one of L+1 other buckets. Nothing is moved but one bucket: no call is slow because a table doubles.
//! Entries are opaque. Knows nothing of keyframes or distances.

/// Entries of a page; with the two other fields a page is 128 bytes, two lines of the cache.
const PAGE: usize = 14;
/// Mean number of entries of a bucket. At 10 of 14 one bucket in twelve has a second page, and a page
/// is 13 to 14 bytes an entry.
const LOAD: usize = 11;
/// Buckets of one allocation.
const CHUNK: usize = 128;
/// Buckets for which the first allocation has room at least.
const LEAST: usize = 4;
/// A bucket takes no further entry past this number: what so many descriptors share does not tell places
/// apart, and a flood of equal descriptors costs no more than this at each probe.
pub(super) const FULL: usize = 256;

/// An entry: what it stands for, and some more bits of the descriptor.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Entry {
    /// What the entry stands for.
    pub(super) value: u32,
    /// Bits of the descriptor that are not in the key.
    pub(super) fingerprint: u32,
}

/// Some entries of a bucket, and the rest of it.
#[derive(Clone, Debug, Default)]
#[repr(align(128))]
pub(super) struct Page {
    entries: [Entry; PAGE],
    /// Entries used in this page.
    used: u32,
    /// Entries of the whole bucket, kept in its first page.
    total: u32,
    next: Option<Box<Page>>,
}

/// The table.
#[derive(Clone, Debug)]
pub(super) struct Buckets {
    chunks: Vec<Vec<Page>>,
    buckets: usize,
    entries: usize,
    /// Pages beyond the first of their buckets.
    further: usize,
}

/// Bucket of a key among `buckets` of them.
#[inline(always)]
fn address(key: u32, buckets: usize) -> usize {
    let level = buckets.ilog2();
    let key = key as usize;
    let fine = key & ((2 << level) - 1);
    if fine < buckets { fine } else { key & ((1 << level) - 1) }
}

impl Buckets {
    /// A table without entries.
    pub(super) fn new() -> Self {
        let mut table = Self { chunks: Vec::new(), buckets: 0, entries: 0, further: 0 };
        table.open();
        table
    }

    /// Memory, bytes.
    pub(super) fn bytes(&self) -> usize {
        self.chunks.capacity() * size_of::<Vec<Page>>()
            + (self.pages() + self.further) * size_of::<Page>()
    }

    /// Room for first pages.
    fn pages(&self) -> usize {
        let rest = self.chunks.len().saturating_sub(1) * CHUNK;
        self.chunks.first().map_or(0, Vec::capacity) + rest
    }

    #[inline(always)]
    fn page(&self, bucket: usize) -> &Page {
        &self.chunks[bucket / CHUNK][bucket % CHUNK]
    }

    fn open(&mut self) {
        if self.buckets.is_multiple_of(CHUNK) {
            // A small table takes little.
            let capacity = if self.chunks.is_empty() { LEAST } else { CHUNK };
            self.chunks.push(Vec::with_capacity(capacity));
        }
        if let Some(last) = self.chunks.last_mut() {
            last.push(Page::default());
            self.buckets += 1;
        }
    }

    fn close(&mut self) {
        if let Some(last) = self.chunks.last_mut() {
            last.pop();
            self.buckets -= 1;
            if last.is_empty() {
                self.chunks.pop();
            }
        }
        if let [only] = &mut self.chunks[..]
            && 2 * only.len() <= only.capacity()
        {
            only.shrink_to(LEAST.max(only.len()));
        }
        if self.chunks.len() * 4 < self.chunks.capacity() {
            self.chunks.shrink_to_fit();
        }
    }

    /// Empties a bucket; its entries in the order in which they came.
    fn take(&mut self, bucket: usize) -> Vec<Entry> {
        let mut page = std::mem::take(&mut self.chunks[bucket / CHUNK][bucket % CHUNK]);
        let mut taken = Vec::with_capacity(page.total as usize);
        taken.extend_from_slice(&page.entries[..page.used as usize]);
        while let Some(next) = page.next {
            self.further -= 1;
            page = *next;
            taken.extend_from_slice(&page.entries[..page.used as usize]);
        }
        taken
    }

    /// Appends to a bucket, full or not.
    fn push(&mut self, bucket: usize, entry: Entry) {
        let mut page = &mut self.chunks[bucket / CHUNK][bucket % CHUNK];
        page.total += 1;
        while page.used as usize == PAGE {
            let further = &mut self.further;
            page = page.next.get_or_insert_with(|| {
                *further += 1;
                Box::default()
            });
        }
        page.entries[page.used as usize] = entry;
        page.used += 1;
    }

    /// Enters `entry` under `key`, unless its bucket is full. `key_of` tells the key of an entry again.
    pub(super) fn insert(&mut self, key: u32, entry: Entry, key_of: impl Fn(Entry) -> u32) {
        let bucket = address(key, self.buckets);
        if self.page(bucket).total as usize >= FULL {
            return;
        }
        self.push(bucket, entry);
        self.entries += 1;
        while self.entries > LOAD * self.buckets {
            let split = self.buckets - (1 << self.buckets.ilog2());
            self.open();
            for moved in self.take(split) {
                self.push(address(key_of(moved), self.buckets), moved);
            }
        }
    }

    /// Takes the entries with `key` that `gone` names out.
    pub(super) fn remove(&mut self, key: u32, gone: impl Fn(Entry) -> bool) {
        let bucket = address(key, self.buckets);
        let held = self.take(bucket);
        self.entries -= held.len();
        for entry in held.into_iter().filter(|&entry| !gone(entry)) {
            self.push(bucket, entry);
            self.entries += 1;
        }
        // The last bucket goes back to the one that it was split from.
        while self.buckets > 1 && self.entries <= LOAD * (self.buckets - 1) {
            let last = self.buckets - 1;
            let moved = self.take(last);
            self.close();
            for entry in moved {
                self.push(address(last as u32, self.buckets), entry);
            }
        }
    }

    /// Appends the values of the entries whose keys begin as `key` does, up to one different bit, and of
    /// some others, as far as at most `largest` bits of their fingerprints differ from `fingerprint`.
    #[inline(always)]
    pub(super) fn near(&self, key: u32, fingerprint: u32, largest: u32, values: &mut Vec<u32>) {
        let home = address(key, self.buckets);
        let mut at = [home; 33];
        let mut count = 1;
        // The buckets lie far from each other: the first pass asks the memory for all of them at once.
        let mut held = self.page(home).total;
        for bit in 0..=self.buckets.ilog2() {
            let bucket = address(key ^ (1 << bit), self.buckets);
            if bucket != home {
                at[count] = bucket;
                count += 1;
                held += self.page(bucket).total;
            }
        }
        values.reserve(held as usize);
        for &bucket in &at[..count] {
            let mut page = Some(self.page(bucket));
            while let Some(open) = page {
                for entry in &open.entries[..open.used as usize] {
                    if (entry.fingerprint ^ fingerprint).count_ones() <= largest {
                        values.push(entry.value);
                    }
                }
                page = open.next.as_deref();
            }
        }
    }
}

#[cfg(test)]
mod tests;
