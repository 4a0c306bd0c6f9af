//! SplitMix64 (Steele, Lea and Flood 2014): random numbers that no library's next version changes.
//!
//! The sequence must not change: descriptors in maps depend on it.

/// The generator; its state is the seed.
pub(super) struct SplitMix64(pub(super) u64);

impl SplitMix64 {
    /// The next 64 bits.
    pub(super) fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }
}

#[test]
fn the_sequence_is_the_published_one() {
    let mut generator = SplitMix64(1_234_567);
    let drawn = [(); 3].map(|()| generator.bits());
    let published =
        [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423];
    assert_eq!(drawn, published);
}
