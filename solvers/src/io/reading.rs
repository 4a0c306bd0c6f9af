//! Computes from the bytes of a file, before it is parsed, how much memory reading it takes.
//!
//! A number of two bytes may become sixty in memory, so the length of a file says little. What a parser
//! keeps, and what its conversion makes of it, is bounded by the words of a text and by the bytes of a
//! binary file; both are counted in pieces. The figures of [`Content`] hold for the file that takes most:
//! `tests/memory.rs` compares them with what the parsers allocate. Nothing is parsed here.

/// What a file holds, as far as memory goes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// A BAL file.
    Bal,
    /// A g2o file.
    Graph,
    /// A file of a COLMAP model in text.
    ColmapText,
    /// A file of a COLMAP model in binary.
    ColmapBinary,
    /// A trajectory in text.
    Trajectory,
}

/// Bytes for each word of a text, or for each byte of a binary file.
struct Figures {
    /// The parsed file and the problem that is made of it, with the room that growing lists leave.
    problem: u64,
    /// The file of the solved problem.
    solution: u64,
}

impl Content {
    fn figures(self) -> Figures {
        let (problem, solution) = match self {
            Self::Bal => (28, 72),
            Self::Graph => (60, 72),
            Self::ColmapText => (64, 72),
            Self::ColmapBinary => (9, 3),
            Self::Trajectory => (25, 0),
        };
        Figures { problem, solution }
    }

    fn is_text(self) -> bool {
        self != Self::ColmapBinary
    }
}

/// Bytes and words of a file, or of several that are read together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FileCounts {
    bytes: u64,
    words: u64,
    is_in_word: bool,
}

impl FileCounts {
    /// Counts the next bytes of a file.
    pub fn add(&mut self, piece: &[u8]) {
        self.bytes += piece.len() as u64;
        for byte in piece {
            let is_in_word = !byte.is_ascii_whitespace();
            self.words += u64::from(is_in_word && !self.is_in_word);
            self.is_in_word = is_in_word;
        }
    }

    /// The next bytes are those of another file.
    pub fn end_file(&mut self) {
        self.is_in_word = false;
    }

    /// What reading takes.
    #[must_use]
    pub fn price(&self, content: Content) -> ReadingPrice {
        let Figures { problem, solution } = content.figures();
        let units = if content.is_text() { self.words } else { self.bytes };
        let problem = units.saturating_mul(problem).saturating_add(FIXED);
        let reading = problem.saturating_add(self.bytes);
        ReadingPrice { reading, problem, solution: units.saturating_mul(solution) }
    }
}

/// Bytes of what does not grow with the file: paths, and the least room of lists.
const FIXED: u64 = 16 << 10;

/// What reading a file takes, bytes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ReadingPrice {
    /// While it is read: its bytes, what is parsed, and the problem.
    pub reading: u64,
    /// After that: what was parsed, and the problem.
    pub problem: u64,
    /// The solved problem as a file, beside the problem.
    pub solution: u64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_counted_across_pieces_and_not_across_files() {
        let text = b"VERTEX_SE2 0  1.5\t2 3\n\nFIX 0";
        let mut whole = FileCounts::default();
        whole.add(text);
        assert_eq!((whole.bytes, whole.words), (text.len() as u64, 7));
        for length in 1..text.len() {
            let mut pieces = FileCounts::default();
            text.chunks(length).for_each(|piece| pieces.add(piece));
            assert_eq!(pieces, whole, "{length}");
        }
        whole.end_file();
        whole.add(b"0");
        assert_eq!(whole.words, 8);
    }
}
