//! Random numbers by position: a hash of where, instead of a stream of how many before.
//!
//! So a pixel's noise and a cell's color do not depend on which thread came first.

/// A hash of a cell of a lattice.
#[inline]
pub(super) fn cell(i: i32, j: i32, k: i32, seed: u32) -> u32 {
    let mut h = (i as u32).wrapping_mul(0x85eb_ca6b)
        ^ (j as u32).wrapping_mul(0xc2b2_ae35).rotate_left(11)
        ^ (k as u32).wrapping_mul(0x27d4_eb2f).rotate_left(21)
        ^ seed.wrapping_mul(0x1656_67b1);
    h = (h ^ (h >> 15)).wrapping_mul(0x2c1b_3c6d);
    h = (h ^ (h >> 12)).wrapping_mul(0x297a_2d39);
    h ^ (h >> 15)
}

/// A hash of a number of a stream (the finalizer of SplitMix64).
#[inline]
pub(super) fn number(stream: u64, index: u64) -> u64 {
    let mut h = stream.wrapping_add(index.wrapping_add(1).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    h ^ (h >> 31)
}

/// From 0 to 1.
pub(super) fn uniform(bits: u64) -> f64 {
    (bits >> 11) as f64 / (1_u64 << 53) as f64
}

/// Two numbers of mean 0 and deviation 1, nearly normal: sums of four bytes each, which end at 3.45.
pub(super) fn normal_pair(bits: u64) -> [f32; 2] {
    // The variance of a uniform byte is (256² − 1) / 12.
    const DEVIATION: f32 = 147.8;
    let bytes = bits.to_le_bytes();
    let sum = |four: &[u8]| four.iter().map(|&byte| f32::from(byte)).sum::<f32>();
    [(sum(&bytes[..4]) - 510.0) / DEVIATION, (sum(&bytes[4..]) - 510.0) / DEVIATION]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_numbers_have_mean_0_and_deviation_1() {
        let count = 100_000;
        let (mut sum, mut squares, mut product) = (0.0, 0.0, 0.0);
        for i in 0..count {
            let [a, b] = normal_pair(number(5, i)).map(f64::from);
            sum += a + b;
            squares += a * a + b * b;
            product += a * b;
        }
        let count = count as f64;
        assert!((sum / count).abs() < 0.01, "{sum}");
        assert!((squares / (2.0 * count) - 1.0).abs() < 0.01, "{squares}");
        assert!((product / count).abs() < 0.01, "{product}");
    }

    #[test]
    fn uniform_numbers_fill_their_range() {
        let mut bins = [0; 10];
        for i in 0..10_000 {
            bins[(uniform(number(9, i)) * 10.0) as usize] += 1;
        }
        assert!(bins.iter().all(|count| (850..1150).contains(count)), "{bins:?}");
    }
}
