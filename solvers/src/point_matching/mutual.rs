//! Which of two sets are each other's best match, neither of them ambiguous.
//!
//! Pairs are added one by one with their distances; of two equal ones the first is kept. It does not
//! know what the distances measure.

/// The best match by appearance must be closer than the second best by this factor (Lowe, IJCV 2004).
pub(crate) const RATIO: f64 = 0.8;

/// The best match of one element, and the distance of the second best.
#[derive(Clone, Copy)]
struct Best {
    other: usize,
    distance: f64,
    /// What its distance must be of that of the second best, at most.
    ratio: f64,
    second: f64,
}

impl Best {
    fn add(best: &mut Option<Self>, other: usize, distance: f64, ratio: f64) {
        *best = Some(match *best {
            None => Self { other, distance, ratio, second: f64::INFINITY },
            Some(first) if distance < first.distance => {
                Self { other, distance, ratio, second: first.distance }
            }
            Some(first) => Self { second: first.second.min(distance), ..first },
        });
    }

    /// Two that are equally good, be it at distance 0, are ambiguous.
    fn is_clear(&self) -> bool {
        self.distance < self.ratio * self.second
    }
}

/// The best matches of the elements of two sets, as far as pairs were told.
pub(crate) struct MutualBest {
    of_a: Vec<Option<Best>>,
    of_b: Vec<Option<Best>>,
}

impl MutualBest {
    /// For sets of `a` and `b` elements.
    pub(crate) fn new(a: usize, b: usize) -> Self {
        Self { of_a: vec![None; a], of_b: vec![None; b] }
    }

    /// Tells a pair. As a best match it is ambiguous unless its distance is below `ratio` of that of the
    /// second best.
    pub(crate) fn add(&mut self, a: usize, b: usize, distance: f64, ratio: f64) {
        Best::add(&mut self.of_a[a], b, distance, ratio);
        Best::add(&mut self.of_b[b], a, distance, ratio);
    }

    /// The pairs (a, b) that are each other's best match, neither of them ambiguous, by rising a.
    pub(crate) fn pairs(&self) -> Vec<(usize, usize)> {
        let mutual = |(a, best): (usize, &Option<Best>)| {
            let best = best.filter(Best::is_clear)?;
            let back = self.of_b[best.other].filter(Best::is_clear)?;
            (back.other == a).then_some((a, best.other))
        };
        self.of_a.iter().enumerate().filter_map(mutual).collect()
    }
}
