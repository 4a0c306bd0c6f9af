//! Lines that the reader of a graph changed or left out, for a caller that reports them.
//!
//! It counts; what becomes of a line is the reader's decision.

use std::collections::BTreeMap;

use super::IoError;
use super::error::excerpt;
use super::text::Line;

/// Tags that are listed at most; the others are counted with the last.
const MAX_TAGS: usize = 64;

/// Lines that a reader changed or left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ChangedLines {
    /// How many there were.
    pub count: usize,
    /// The first, from 1.
    pub first_line: u64,
}

impl ChangedLines {
    /// Counts a line that is changed.
    pub(super) fn note(lines: &mut Option<Self>, line: &Line<'_>) {
        let first_line = line.line_number();
        lines.get_or_insert(Self { count: 0, first_line }).count += 1;
    }
}

/// Lines with tags that are not read.
pub(super) struct UnknownTags {
    are_skipped: bool,
    skipped: BTreeMap<String, Option<ChangedLines>>,
}

impl UnknownTags {
    /// None yet. They are refused unless `are_skipped`.
    pub(super) fn new(are_skipped: bool) -> Self {
        Self { are_skipped, skipped: BTreeMap::new() }
    }

    /// Counts a line, or refuses it.
    pub(super) fn take(&mut self, tag: &[u8], line: &Line<'_>) -> Result<(), IoError> {
        if !self.are_skipped {
            return Err(IoError::UnknownTag { location: line.location(), tag: excerpt(tag) });
        }
        let is_full = self.skipped.len() >= MAX_TAGS;
        let tag = if is_full { "others".to_owned() } else { excerpt(tag) };
        ChangedLines::note(self.skipped.entry(tag).or_default(), line);
        Ok(())
    }

    /// The lines that were skipped, by tag.
    pub(super) fn skipped(self) -> Vec<(String, ChangedLines)> {
        self.skipped.into_iter().filter_map(|(tag, lines)| Some((tag, lines?))).collect()
    }
}
