//! Samples of matches, drawn with a probability in proportion to their weights or all alike, and how many
//! are needed.
//!
//! SplitMix64 (Steele, Lea and Flood, OOPSLA 2014) from the caller's seed: the same samples on every
//! machine and on any number of threads. Knows nothing of geometry.

/// Draws for one sample: where few matches carry all the weight, one comes again and again.
const MAX_DRAWS: usize = 64;

/// Probability that no sample without wrong matches was drawn when a search ends.
const MISSED: f64 = 1e-3;

/// The stream of random numbers of a seed.
pub(crate) struct Numbers(u64);

impl Numbers {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    /// Uniform in [0, 1).
    pub(crate) fn share(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^= z >> 31;
        // The upper 53 bits are the digits of a number with 53.
        (z >> 11) as f64 / (1_u64 << 53) as f64
    }
}

/// `N` different indices below `count`, which is at least `N`.
pub(crate) fn distinct<const N: usize>(numbers: &mut Numbers, count: usize) -> [usize; N] {
    let mut sample = [usize::MAX; N];
    let mut k = 0;
    while k < N {
        let drawn = ((numbers.share() * count as f64) as usize).min(count.saturating_sub(1));
        if !sample[..k].contains(&drawn) {
            sample[k] = drawn;
            k += 1;
        }
    }
    sample
}

/// Samples of `size` matches, `inlying` of which are right, after which one without wrong matches was
/// drawn but for [`MISSED`]; at most `most`.
pub(crate) fn samples_needed(inlying: f64, size: i32, most: usize) -> usize {
    let good = inlying.clamp(0.0, 1.0).powi(size);
    if good >= 1.0 {
        return 1;
    }
    // ln(1 − good) is 0 for the smallest good by subtraction, with the wrong sign.
    let needed = MISSED.ln() / (-good).ln_1p();
    if needed < most as f64 { needed.ceil() as usize } else { most }
}

/// Draws indices in proportion to weights.
pub(super) struct Sampler {
    /// Sums of the weights up to each index.
    sums: Vec<f64>,
}

impl Sampler {
    /// `weights` are finite and not negative.
    pub(super) fn new(weights: impl Iterator<Item = f64>) -> Self {
        let sums = weights.scan(0.0, |sum, weight| {
            *sum += weight;
            Some(*sum)
        });
        Self { sums: sums.collect() }
    }

    fn draw(&self, numbers: &mut Numbers) -> usize {
        let total = self.sums.last().copied().unwrap_or(0.0);
        let drawn = numbers.share() * total;
        self.sums.partition_point(|&sum| sum <= drawn).min(self.sums.len().saturating_sub(1))
    }

    /// Three different indices; `None` where fewer than three have a weight worth speaking of.
    pub(super) fn three(&self, numbers: &mut Numbers) -> Option<[usize; 3]> {
        let mut sample = [usize::MAX; 3];
        let mut count = 0;
        for _ in 0..MAX_DRAWS {
            let drawn = self.draw(numbers);
            if drawn < self.sums.len() && !sample[..count].contains(&drawn) {
                sample[count] = drawn;
                count += 1;
            }
            if count == 3 {
                return Some(sample);
            }
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn indices_come_as_often_as_their_weights_say() {
        let weights = [1.0, 0.0, 2.0, 4.0, 1.0];
        let sampler = Sampler::new(weights.into_iter());
        let mut numbers = Numbers::new(1);
        let mut counts = [0_u32; 5];
        for _ in 0..80_000 {
            counts[sampler.draw(&mut numbers)] += 1;
        }
        for (count, weight) in counts.into_iter().zip(weights) {
            // The standard deviation is at most 142.
            assert!((f64::from(count) - weight * 10_000.0).abs() < 600.0, "{counts:?}");
        }
        for _ in 0..100 {
            let [a, b, c] = sampler.three(&mut numbers).unwrap();
            assert!(a != b && b != c && a != c && ![a, b, c].contains(&1));
        }
    }

    #[test]
    fn fewer_than_three_weights_have_no_sample() {
        let mut numbers = Numbers::new(1);
        for weights in [vec![], vec![1.0], vec![1.0, 3.0], vec![1.0, 0.0, 2.0, 0.0], vec![0.0; 5]] {
            assert_eq!(Sampler::new(weights.into_iter()).three(&mut numbers), None);
        }
    }

    #[test]
    fn a_search_ends_early_only_where_much_agrees() {
        let needed = |share: f64| samples_needed(share, 3, 2400);
        assert_eq!([1.0, 0.5, 1.0 / 7.0].map(needed), [1, 52, 2366]);
        // A share whose cube is rounded away in 1 − x.
        assert_eq!([0.1, 1e-5, 1e-6, 1e-300, 0.0].map(needed), [2400; 5]);
    }
}
