//! The newest two states of a section by their numbers; worker and coordinator forget alike.
//!
//! It knows the numbers, not what the states hold.

use super::message::Version;

/// Values of at most two versions.
#[derive(Clone, Debug)]
pub(super) struct Kept<T>(Vec<(Version, T)>);

impl<T> Default for Kept<T> {
    fn default() -> Self {
        Self(Vec::new())
    }
}

impl<T> Kept<T> {
    /// The values of a version.
    pub(super) fn get(&self, version: Version) -> Option<&T> {
        self.0.iter().find(|(kept, _)| *kept == version).map(|(_, values)| values)
    }

    /// The values that were kept last.
    pub(super) fn newest(&self) -> Option<&T> {
        self.0.last().map(|(_, values)| values)
    }

    /// Keeps the values of one more version, and the last one's before.
    pub(super) fn push(&mut self, version: Version, values: T) {
        self.0.retain(|(kept, _)| *kept != version);
        if self.0.len() > 1 {
            self.0.remove(0);
        }
        self.0.push((version, values));
    }

    /// Keeps the values of a version that was made from `base`, and those of the base.
    pub(super) fn push_beside(&mut self, base: Version, version: Version, values: T) {
        self.0.retain(|(kept, _)| *kept == base);
        self.0.push((version, values));
    }

    /// Forgets all.
    pub(super) fn clear(&mut self) {
        self.0.clear();
    }
}
